"""A test planned before it is flown: motions are chosen by adding their information, and the plan is flown whole.

::

    vehicle, guess ─ Rehearsal ─ what each motion tells ─ choose ─ draft ─ flown whole ─ Plan ─ scenario.toml, plan.json, plan.html
"""
