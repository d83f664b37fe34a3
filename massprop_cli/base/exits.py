"""Exit codes of the contract; where several fit, the first of :data:`GRAVITY` counts."""

BUG, USAGE, INPUT, NOT_CONVERGED, NOT_EXPECTED, CONTRADICTED = 1, 2, 3, 4, 5, 6
INTERRUPTED, PIPE = 130, 141
"""128 and the number of the signal that ended it, as a shell has it: SIGINT, SIGPIPE."""
GRAVITY = (BUG, INPUT, CONTRADICTED, NOT_CONVERGED, NOT_EXPECTED)
"""Codes that one log may end with, from the worst on."""
