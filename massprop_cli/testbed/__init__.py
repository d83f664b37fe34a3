"""Simulator: flies a scenario and writes a telemetry log with known true mass properties.

::

    scenario ─ mission ─ demand ─ actuators ─ executed wrench ─ motion ─ imu ─ Flight ─ output

Arrays hold all seeds of a scenario: vectors are (3, S, …), S members, one per seed. Units, frames and symbols as in
:mod:`massprop_cli`. The simulator uses none of the estimator's models, so that each can be tested against the other.
"""
