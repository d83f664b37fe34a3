"""Whether logged attitudes and the gyro agree within their noise; if not, and one key of the vehicle file explains it, which."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import AttitudeError, InputError
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.measured import START, Given, LinearFilter, Noise, given, linear, measured

REFUTED = 50.0
"""Chi-square of a bias, a misalignment or a latency beyond what is stated; of three degrees of freedom, by chance once in 10¹⁰ logs."""
EXPLAINED = 6.0
"""Standard deviations of chi-square up to which the innovations are explained."""
ROUNDS = 4
"""In which a latency is looked for."""
BIAS, TURN, LATENCY = 0.1, 0.2, 0.5
"""rad/s, rad, s; one sigma of what is looked for."""


def checked(log: Log, vehicle: Vehicle) -> Noise | None:
    """The noise of attitude and gyro, as stated or as the log shows it; None where no attitude is logged on an air bearing.

    :class:`InputError` where a bias, a misalignment or a latency shows that isn't stated, and explains all.
    """
    known = given(log, vehicle)
    if known is None:
        return None
    supposed = vehicle
    for _ in range(ROUNDS):
        found, count = _linear(log, supposed)
        explained = found.chi_square - count < EXPLAINED * (2 * count) ** 0.5
        latency_s = max(supposed.imu.attitude_latency_s + float(found.states[-1, 9]), 0.0)
        if explained:
            break
        # a latency of many cycles is not linear
        supposed = supposed.model_copy(update={"imu": supposed.imu.model_copy(update={"attitude_latency_s": latency_s})})
    left, what, remedy = max(_unstated(known, found, latency_s, latency_s - vehicle.imu.attitude_latency_s))
    if left > REFUTED and explained:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: attitude and gyro contradict each other by {left**0.5:.2g} sigma, and agree {what}; "
            f"{remedy}, or leave the columns out"
        )
    return known.noise


def _linear(log: Log, vehicle: Vehicle) -> tuple[LinearFilter, int]:
    """What shows of bias, misalignment and latency where none is known, and the number of innovations."""
    known, about = given(log, vehicle), measured(log, vehicle)
    if known is None or about is None:  # a latency beyond the log
        raise InputError(f"{log.path}: imu.attitude_latency_s = {vehicle.imu.attitude_latency_s:g} leaves no attitude within the log")
    return linear(known, about, START**2 * np.eye(3), (BIAS, TURN, LATENCY)), 3 * int(np.isfinite(about.noise_rad).sum())


def _unstated(known: Given, found: LinearFilter, latency_s: float, late_s: float) -> list[tuple[float, str, str]]:
    """Chi-square of each that isn't stated, what it is, and what to state."""
    bias, turn, last, covariance = slice(3, 6), slice(6, 9), found.states[-1], found.covariance[-1]

    def chi_square(own: slice, sigma: float) -> float:
        expected = covariance[own, own] + sigma**2 * np.eye(own.stop - own.start)
        return float(last[own] @ np.linalg.solve(expected, last[own]))

    by_bias, by_turn = chi_square(bias, known.bias_sigma), chi_square(turn, known.misalignment_sigma)
    turned = f"with the attitude's axes turned by {_listed(last[turn])} rad from the body's"
    told = [
        (by_bias, f"with a gyro bias of {_listed(last[bias])} rad/s", "state imu.gyro_bias_sigma_rad_s"),
        (by_turn, turned, "state imu.attitude_misalignment_sigma_rad"),
    ]
    if latency_s > 0:
        by_latency = late_s**2 / float(covariance[9, 9])
        told.append((by_latency, f"with a latency of {latency_s:.3g} s", f"state imu.attitude_latency_s = {latency_s:.3g}"))
    return told


def _listed(numbers: Array) -> str:
    return "(" + ", ".join(f"{number:.2g}" for number in numbers) + ")"
