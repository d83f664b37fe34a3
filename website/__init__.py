"""The documentation as a site of static pages that load nothing from elsewhere: ``python -m website``.

docs/ and the README are its pages; reference pages are made from the code. ``stage`` puts both into one folder, ``mathml`` makes formulas
markup while Zensical builds.
"""
