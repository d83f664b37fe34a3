"""Whether log and vehicle file fit each other: timing, faults, changes, and what mends them."""
