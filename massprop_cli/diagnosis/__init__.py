"""Diagnosis: whether log and vehicle file fit each other, the causes where they do not, and their corrections."""

NO_CAUSE = "the vehicle file does not explain the log and no cause was found"
"""How each message of that code begins."""
UNKNOWN = "cause-unknown"
"""The code of what fits no cause, or several that have nothing in common."""
