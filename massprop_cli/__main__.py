"""``massprop`` and ``python -m massprop_cli``."""

import gc
import os
import signal

# what is imported stays: to look through it for rubbish again and again would take a sixth of a short run's time
gc.set_threshold(100_000, 50, 50)
# nor have plug-ins of other packages any business in how files are read, and to look for them takes time
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
# an interrupt ends the process, without a traceback out of the middle of an import
signal.signal(signal.SIGINT, signal.SIG_DFL)

from massprop_cli.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
