"""Thrust that rotors can give, and the rotors that the simulator refuses."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.actuators.rotor import Rotor
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.conditions import TrueActuators

CURVE = 2001
"""Values of x at which thrust is inverted."""


def thrust(rotor: Rotor, x: Array) -> Array:
    """N."""
    return np.polynomial.Polynomial(rotor.thrust_n)(x)


def curve(rotor: Rotor, real: TrueActuators) -> tuple[Array, Array]:
    """Values of x up to ``max_rotor_command``, and thrust there, N."""
    x = np.linspace(0.0, real.max_rotor_command or 0.0, CURVE)
    return x, thrust(rotor, x)


def full_thrust(vehicle: Vehicle, real: TrueActuators) -> Array:
    """(2, R) least and largest thrust of each, N."""
    return np.array([curve(rotor, real)[1][[0, -1]] for rotor in vehicle.rotors]).T


def problem(vehicle: Vehicle, real: TrueActuators, at_once: bool) -> str:
    """Why they can't be flown, ``at_once`` without thrust lag; empty where they can."""
    if not vehicle.rotors:
        return (
            "" if real.max_rotor_command is None and real.hover_force_n is None else "max_rotor_command and hover_force_n need [[rotors]]"
        )
    if vehicle.jets or real.max_torque_n_m or real.max_force_n:
        return "a log has commands of rotors, or of jets or a wrench: drop one kind"
    if real.max_rotor_command is None or real.hover_force_n is None:
        return "give actuators.max_rotor_command, and actuators.hover_force_n, the force of all rotors about which the plan's pulses go"
    unsteady = next((one.name for one in vehicle.rotors if (np.diff(curve(one, real)[1]) <= 0).any()), None)
    if unsteady is not None:
        return f"thrust_n of rotor {unsteady!r} does not rise all the way to actuators.max_rotor_command = {real.max_rotor_command:g}"
    jumping = next((one.name for one in vehicle.rotors if one.column == "speed" and at_once), None)
    return "" if jumping is None else f"rotor {jumping!r} logs its speed: give actuators.lag_s, with which it follows commands"
