"""Whether a recording is good: what table and signals show (a module for each kind of :class:`Finding`), and an estimate of it."""
