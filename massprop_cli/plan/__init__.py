"""A test planned before it is flown: the motions that tell what is wanted, in the time and within the limits that there are.

::

    vehicle, guess ─ Rehearsal ─ what each motion tells ─ choose ─ draft ─ flown whole ─ Plan ─ scenario.toml, plan.json, plan.html

Information adds up (:func:`massprop_cli.testbed.bound.information`), so motions are chosen by adding; what is told of the plan comes from
flying it whole.
"""
