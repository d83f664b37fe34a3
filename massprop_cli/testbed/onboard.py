"""Simulated attitude control of the vehicle: attitude integrated from the gyro, gains stated or computed from assumed mass properties."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.inputs.vehicle import Nominal, Vehicle
from massprop_cli.testbed.conditions import Control
from massprop_cli.testbed.motion import compose, cross, quaternions

MOMENTS = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz")]
CG = slice(6, 9)


class Running(Protocol):
    """Recursive on-board estimator of S vehicles, each with its own log."""

    def step(self, end_s: float, issued: Array, angle_imu_rad: Array, velocity_imu_m_s: Array) -> tuple[Array, BoolArray]:
        """Process the next cycle: its end, issued commands (S, C), and increments (S, 3) of the IMU, IMU axes.

        Returns (S, 10) estimates in the order of :data:`massprop_cli.QUANTITIES`, arbitrary if not estimable, and whether each has
        converged.
        """


RunningOf = Callable[[Vehicle, str, int], Running]
"""Constructor of an estimator from the logged vehicle, its source (for messages) and S; raises :class:`InputError` if unsupported."""


class Gains(NamedTuple):
    """Gains of ``τ = ω × Î ω − D ω − K q_vec + ĉ × F``, (3, 1) or (3, S) each."""

    inertia: Array
    """Diagonal of Î, kg m²."""
    rate: Array
    """Diagonal of D, N m s."""
    attitude: Array
    """Diagonal of K, N m."""
    cg: Array
    """ĉ, m."""


def gains(control: Control, body: Array) -> Gains:
    """Stated gains, or gains of bodies (S, 10): ``D = 2 ζ w Î``, ``K = 2 w² Î`` (q_vec is half the angle), Î the moments of inertia."""
    if control.model is None:
        stated = control.inertia_kg_m2, control.rate_gain_n_m_s, control.attitude_gain_n_m, np.zeros(3)
        return Gains(*(np.array(values)[:, None] for values in stated))
    assert control.natural_frequency_rad_s is not None
    assert control.damping is not None
    inertia, frequency = body.T[MOMENTS], control.natural_frequency_rad_s
    return Gains(inertia, 2 * control.damping * frequency * inertia, 2 * frequency**2 * inertia, body.T[CG])


def nominal(stated: Nominal) -> Array:
    """(10,) nominal (CAD) values of the vehicle file, 0 if not stated."""
    return np.array([stated.value(name) or 0.0 for name in QUANTITIES])


class Onboard:
    """Attitude control of S vehicles, with the rates measured in the previous cycle."""

    def __init__(self, control: Control | None, attitude: Array, body: Array, running: Running | None) -> None:
        """``attitude``: (4, S) target attitude. ``body``: (S, 10) body for the gains, until the estimator ``running`` converges."""
        self.control, self.attitude, self.body, self.running = control, attitude, body, running
        self.target, self.rate = attitude.copy(), np.zeros((3, attitude.shape[1]))

    def sense(self, angle_imu: Array, body_from_imu: Array, period_s: float) -> None:
        """Update rate and attitude with a cycle's angle increment (3, S), IMU axes, rad."""
        if self.control is None:
            return
        angle = np.einsum("ij,js->is", body_from_imu, angle_imu)
        self.rate = angle / period_s
        self.attitude = compose(self.attitude, quaternions(angle))

    def learn(self, end_s: float, issued: Array, angle_imu: Array, velocity_imu: Array) -> None:
        """Update the on-board estimate with a cycle's commands (S, C) and increments (S, 3); only converged estimates are used."""
        if self.running is not None:
            values, converged = self.running.step(end_s, issued, angle_imu, velocity_imu)
            self.body = np.where(converged, values, self.body)

    def torque(self, force: Array) -> Array:
        """(S, 3) control torque about O, N m, while the plan demands ``force`` (S, 3), N."""
        assert self.control is not None
        gain = gains(self.control, self.body)
        error = compose(self.target * np.array([1.0, -1.0, -1.0, -1.0])[:, None], self.attitude)
        error = error * np.where(error[0] < 0, -1.0, 1.0)
        torque: Array = cross(self.rate, gain.inertia * self.rate) - gain.rate * self.rate - gain.attitude * error[1:]
        if self.control.model is not None:
            torque = torque + cross(gain.cg, force.T)
        return torque.T
