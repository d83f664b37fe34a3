"""From samples to a history: causal estimator, off-line fits, noise levels, and the filters of the thesis."""
