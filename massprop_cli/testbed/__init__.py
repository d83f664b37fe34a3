"""The testbed in software: a scenario flown to a telemetry log with known truth.

::

    scenario ─ mission ─ demand ─ actuators ─ executed wrench ─ motion ─ imu ─ Flight ─ output

Arrays carry all seeds of a scenario at once: vectors are (3, S, …), S members. Units, frames and symbols as in
:mod:`massprop_cli`. Nothing of the estimator's own models is used here, so that each can be tested against the other.
"""
