"""Whether logged attitudes and the gyro agree within their noise; if not, and one key of the vehicle file explains it, which."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import AttitudeError, InputError
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.attitudefilter import Given, LinearFilter, Noise, linear
from massprop_cli.prepare.measured import START, given, measured

REFUTED = 50.0
"""Chi-square of a bias, a misalignment or a latency beyond what is stated; of three degrees of freedom, by chance once in 10¹⁰ logs."""
EXPLAINED = 6.0
"""Standard deviations of chi-square up to which the innovations are explained."""
ROUNDS = 4
"""In which a latency is looked for."""
BIAS, TURN, LATENCY = 0.1, 0.2, 0.5
"""rad/s, rad, s; one sigma of what is looked for."""


class NoiseAndLatency(NamedTuple):
    """Of a logged attitude."""

    noise: Noise
    """As stated, or as the log shows it."""
    latency_s: float
    latency_sigma_s: float


def checked(log: Log, vehicle: Vehicle) -> NoiseAndLatency | None:
    """Noise and latency of a logged attitude; None where none is logged on an air bearing.

    :class:`InputError` where a bias, a misalignment or a latency shows that isn't stated, and explains all.
    """
    auto = vehicle.imu.attitude_latency_s == "auto"
    # a latency that is still to be found scatters, too
    supposed = _with(vehicle, attitude_latency_s=0.0, attitude_sigma_rad=None) if auto else vehicle
    known = given(log, supposed)
    if known is None:
        return None
    for _ in range(ROUNDS):
        found, count = _linear(log, supposed)
        explained = found.chi_square - count < EXPLAINED * (2 * count) ** 0.5
        latency_s = max(supposed.imu.attitude_latency + float(found.states[-1, 9]), 0.0)
        if explained:
            break
        # a latency of many cycles is not linear
        supposed = _with(supposed, attitude_latency_s=latency_s)
    imu, sigma_s = vehicle.imu, float(found.covariance[-1, 9, 9]) ** 0.5
    beyond = (0.0 if auto else latency_s - imu.attitude_latency, (sigma_s**2 + imu.attitude_latency_sigma_s**2) ** 0.5)
    left, what, remedy = max(_unstated(known, found, latency_s, beyond))
    if left > REFUTED and explained:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: attitude and gyro contradict each other by {left**0.5:.2g} sigma, and agree {what}; "
            f"{remedy}, or leave the columns out"
        )
    at_it = given(log, _with(vehicle, attitude_latency_s=latency_s)) if auto else known
    return None if at_it is None else NoiseAndLatency(at_it.noise, latency_s, sigma_s)


def _with(vehicle: Vehicle, **imu: float | None) -> Vehicle:
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=imu)})


def _linear(log: Log, vehicle: Vehicle) -> tuple[LinearFilter, int]:
    """What shows of bias, misalignment and latency where none is known, and the number of innovations."""
    known, about = given(log, vehicle), measured(log, vehicle)
    if known is None or about is None:  # a latency beyond the log
        raise InputError(f"{log.path}: imu.attitude_latency_s = {vehicle.imu.attitude_latency:g} leaves no attitude within the log")
    return linear(known, about, START**2 * np.eye(3), (BIAS, TURN, LATENCY)), 3 * int(np.isfinite(about.noise_rad).sum())


def _unstated(known: Given, found: LinearFilter, latency_s: float, beyond: tuple[float, float]) -> list[tuple[float, str, str]]:
    """Chi-square of each that isn't stated, what it is, and what to state; ``beyond`` the stated latency, and its sigma."""
    bias, turn, last, covariance = slice(3, 6), slice(6, 9), found.states[-1], found.covariance[-1]

    def chi_square(own: slice, sigma: float) -> float:
        expected = covariance[own, own] + sigma**2 * np.eye(own.stop - own.start)
        return float(last[own] @ np.linalg.solve(expected, last[own]))

    walked = known.bias_walk * float(known.motion.duration_s.sum()) ** 0.5
    by_bias, by_turn = chi_square(bias, float(np.hypot(known.bias_sigma, walked))), chi_square(turn, known.misalignment_sigma)
    turned = f"with the attitude's axes turned by {_listed(last[turn])} rad from the body's"
    told = [
        (by_bias, f"with a gyro bias of {_listed(last[bias])} rad/s", "state imu.gyro_bias_sigma_rad_s"),
        (by_turn, turned, "state imu.attitude_misalignment_sigma_rad"),
    ]
    if latency_s > 0:
        told.append(
            ((beyond[0] / beyond[1]) ** 2, f"with a latency of {latency_s:.3g} s", f"state imu.attitude_latency_s = {latency_s:.3g}")
        )
    return told


def _listed(numbers: Array) -> str:
    return "(" + ", ".join(f"{number:.2g}" for number in numbers) + ")"
