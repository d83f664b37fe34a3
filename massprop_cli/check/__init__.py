"""Whether a recording is good, before the testbed is taken down: what table and signals show, and an estimate of it.

Each room looks at one kind of fault and gives :class:`massprop_cli.check.finding.Finding`; what an estimate finds is taken as it is.
"""
