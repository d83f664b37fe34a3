"""Exit codes of the command line; if several apply, the first of :data:`GRAVITY`."""

BUG, USAGE, INPUT, NOT_CONVERGED, NOT_EXPECTED, CONTRADICTED = 1, 2, 3, 4, 5, 6
SIGNALLED = 128
"""Base of the exit code of a process that a signal ended; the signal's number is added."""
INTERRUPTED, PIPE = SIGNALLED + 2, SIGNALLED + 13
"""SIGINT, SIGPIPE."""
GRAVITY = (BUG, INPUT, CONTRADICTED, NOT_CONVERGED, NOT_EXPECTED)
"""Codes of one log, in descending order of severity."""
