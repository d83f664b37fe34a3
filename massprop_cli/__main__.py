"""``massprop`` and ``python -m massprop_cli``."""

import signal

# an interrupt ends the process, without a traceback out of the middle of an import
signal.signal(signal.SIGINT, signal.SIG_DFL)

from massprop_cli.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
