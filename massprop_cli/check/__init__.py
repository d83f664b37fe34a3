"""Whether a recording is good: what table and signals show, each as a :class:`Finding`, and an estimate of it."""
