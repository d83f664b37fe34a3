"""Simulated environments: one module for each, and the selection by the vehicle file."""

from collections.abc import Callable

import numpy as np

from massprop_cli.testbed.environment.bearing import Bearing, OnBearing, OnPedestal
from massprop_cli.testbed.environment.table import OnTable, TablePlant
from massprop_cli.testbed.motion import Bodies, Dynamics
from massprop_cli.testbed.scenario import Scenario


def dynamics_in(scenario: Scenario) -> Callable[[Bodies], Dynamics]:
    """Constructor of the dynamics of bodies in the environment of the vehicle file."""
    stated, real = scenario.vehicle.environment, scenario.disturbance
    if stated.kind == "free":
        return Dynamics
    if stated.kind == "planar":
        about_x, about_y = real.table_tilt_rad
        table = TablePlant(stated.gravity_m_s2, real.table_hold * stated.gravity_m_s2 * np.array([-about_y, about_x, 0.0]))
        return lambda bodies: OnTable(bodies, table)
    bearing = Bearing(np.array(stated.bearing_position_m), stated.bearing_mass_kg, stated.gravity_m_s2)
    dynamics = OnPedestal if stated.kind == "pedestal" else OnBearing
    return lambda bodies: dynamics(bodies, bearing)
