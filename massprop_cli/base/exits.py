"""Exit codes of the contract; where several fit, the first of :data:`GRAVITY` counts."""

BUG, USAGE, INPUT, NOT_CONVERGED, NOT_EXPECTED, CONTRADICTED = 1, 2, 3, 4, 5, 6
SIGNALLED = 128
"""To which a shell adds the number of the signal that ended it."""
INTERRUPTED, PIPE = SIGNALLED + 2, SIGNALLED + 13
"""SIGINT, SIGPIPE."""
GRAVITY = (BUG, INPUT, CONTRADICTED, NOT_CONVERGED, NOT_EXPECTED)
"""Codes that one log may end with, from the worst on."""
