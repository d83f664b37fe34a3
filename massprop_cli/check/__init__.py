"""Check of a recording: findings from its table and signals (:class:`Finding`), and the sigmas of an estimate of it."""
