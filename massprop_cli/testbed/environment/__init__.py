"""What the simulated environments change in the motion of a free body: one file for each, and the one that a vehicle file states."""

from collections.abc import Callable

import numpy as np

from massprop_cli.testbed.environment.bearing import Bearing, OnBearing, OnPedestal
from massprop_cli.testbed.environment.table import OnTable, TablePlant
from massprop_cli.testbed.motion import Bodies, Dynamics
from massprop_cli.testbed.scenario import Scenario


def dynamics_in(scenario: Scenario) -> Callable[[Bodies], Dynamics]:
    """How bodies move in the environment that the vehicle file states."""
    stated, real = scenario.vehicle.environment, scenario.disturbance
    if stated.kind == "free":
        return Dynamics
    if stated.kind == "planar":
        about_x, about_y = real.table_tilt_rad
        table = TablePlant(stated.gravity_m_s2, real.table_hold * stated.gravity_m_s2 * np.array([-about_y, about_x, 0.0]))
        return lambda bodies: OnTable(bodies, table)
    bearing = Bearing(np.array(stated.bearing_position_m), stated.bearing_mass_kg, stated.gravity_m_s2)
    held = OnPedestal if stated.kind == "pedestal" else OnBearing
    return lambda bodies: held(bodies, bearing)
