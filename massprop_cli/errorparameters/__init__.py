"""The table of error parameters: everything that may differ from what log and vehicle file state, each declared once.

A module per family; :mod:`massprop_cli.errorparameters.table` puts them together. Priors, keys, ranges, steps, sentences and remedies
are read from there by diagnosis, by the assumptions of an estimate, and by docs/error-parameters.md.
"""
