"""What the simulated environments change in the motion of a free body: one file for each, and the one that a vehicle file states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.environment.bearing import Bearing, OnBearing
from massprop_cli.testbed.motion import Bodies, Dynamics


def dynamics_in(vehicle: Vehicle) -> Callable[[Bodies], Dynamics]:
    """How bodies move in the environment that the vehicle file states."""
    stated = vehicle.environment
    if stated.kind == "free":
        return Dynamics
    bearing = Bearing(np.array(stated.bearing_position_m), stated.bearing_mass_kg, stated.gravity_m_s2)
    return lambda bodies: OnBearing(bodies, bearing)
