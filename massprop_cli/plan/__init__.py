"""Design of a test: choose motions by the sum of their information matrices, and simulate the whole plan.

::

    vehicle, guess ─ Rehearsal ─ MotionLibrary ─ choose ─ SimulatedPlan ─ scenario.toml, plan.json, plan.html
"""
