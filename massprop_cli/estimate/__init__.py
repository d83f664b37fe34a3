"""Samples → History: the causal estimator, the off-line fits, noise levels, and the thesis's own filters."""
