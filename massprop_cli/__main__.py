"""``python -m massprop_cli``."""

from massprop_cli.cli import main

main()
