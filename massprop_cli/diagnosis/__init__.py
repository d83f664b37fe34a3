"""Diagnosis: whether log and vehicle file fit each other, the causes where they do not, and their corrections."""

UNKNOWN = "cause-unknown"
"""The code of what fits no cause, or several that have nothing in common."""
