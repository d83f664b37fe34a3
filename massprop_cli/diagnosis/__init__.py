"""Whether log and vehicle file fit each other: timing, faults, changes, and what mends them."""

UNKNOWN = "cause-unknown"
"""The code of what fits no cause, or several that have nothing in common."""
