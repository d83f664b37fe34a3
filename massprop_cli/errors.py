"""Errors that a user can act on; the command line turns them into one line and an exit code."""


class InputError(Exception):
    """Unusable input or configuration (exit 3). The message names file, place, value and remedy."""


class UsageError(Exception):
    """A command line that makes no sense (exit 2)."""
