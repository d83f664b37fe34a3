"""The vehicle's own attitude control: attitude integrated from the gyro, gains as stated or made of what it takes its body to be."""

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
    """The running estimate of S vehicles, each from its own records up to now."""

    def step(self, end_s: float, issued: Array, angle_imu_rad: Array, velocity_imu_m_s: Array) -> tuple[Array, BoolArray]:
        """Take the next cycle: its end, commands (S, C) issued in it, increments (S, 3) that the IMU sensed in it, IMU axes.

        (S, 10) values in the order of :data:`massprop_cli.QUANTITIES`, anything where nothing can be said, and whether each has converged.
        """


RunningOf = Callable[[Vehicle, str, int], Running]
"""Of a vehicle as its log's users get it, where it is from (for messages), and S; :class:`InputError` where it can't be held."""


class Gains(NamedTuple):
    """Of ``τ = ω × Î ω − D ω − K q_vec + ĉ × F``, (3, 1) or (3, S)."""

    inertia: Array
    """Diagonal of Î, kg m²."""
    rate: Array
    """Diagonal of D, N m s."""
    attitude: Array
    """Diagonal of K, N m."""
    cg: Array
    """ĉ, m."""


def gains(control: Control, body: Array) -> Gains:
    """As stated; or of bodies (S, 10): ``D = 2 ζ w Î``, ``K = 2 w² Î`` (q_vec is half the angle), Î the moments of inertia."""
    if control.model is None:
        stated = control.inertia_kg_m2, control.rate_gain_n_m_s, control.attitude_gain_n_m, np.zeros(3)
        return Gains(*(np.array(values)[:, None] for values in stated))
    assert control.natural_frequency_rad_s is not None
    assert control.damping is not None
    inertia, frequency = body.T[MOMENTS], control.natural_frequency_rad_s
    return Gains(inertia, 2 * control.damping * frequency * inertia, 2 * frequency**2 * inertia, body.T[CG])


def nominal(stated: Nominal) -> Array:
    """(10,) the vehicle file's CAD values, 0 where there is none."""
    return np.array([stated.value(name) or 0.0 for name in QUANTITIES])


class Onboard:
    """Attitude control of S vehicles, by the rates of the cycle before."""

    def __init__(self, control: Control | None, attitude: Array, body: Array, running: Running | None) -> None:
        """``attitude`` (4, S) is held; ``body`` (S, 10) is what the gains are of, until ``running`` says better."""
        self.control, self.attitude, self.body, self.running = control, attitude, body, running
        self.target, self.rate = attitude.copy(), np.zeros((3, attitude.shape[1]))

    def sense(self, angle_imu: Array, body_from_imu: Array, period_s: float) -> None:
        """Take a cycle's angle increment, (3, S) IMU axes."""
        if self.control is None:
            return
        angle = np.einsum("ij,js->is", body_from_imu, angle_imu)
        self.rate = angle / period_s
        self.attitude = compose(self.attitude, quaternions(angle))

    def learn(self, end_s: float, issued: Array, angle_imu: Array, velocity_imu: Array) -> None:
        """Take what a cycle tells the running estimate, arrays with members first; a value is used from when it has converged."""
        if self.running is not None:
            values, converged = self.running.step(end_s, issued, angle_imu, velocity_imu)
            self.body = np.where(converged, values, self.body)

    def torque(self, force: Array) -> Array:
        """(S, 3) about O, N m, while pushing with ``force`` (S, 3) in N."""
        assert self.control is not None
        own = gains(self.control, self.body)
        error = compose(self.target * np.array([1.0, -1.0, -1.0, -1.0])[:, None], self.attitude)
        error = error * np.where(error[0] < 0, -1.0, 1.0)
        torque: Array = cross(self.rate, own.inertia * self.rate) - own.rate * self.rate - own.attitude * error[1:]
        if self.control.model is not None:
            torque = torque + cross(own.cg, force.T)
        return torque.T
