"""Balancing a table on a fixed pedestal: what to move or add, and whether what moved is what was predicted."""
