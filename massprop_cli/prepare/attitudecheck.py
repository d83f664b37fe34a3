"""Consistency check of logged attitudes with the gyro; an inconsistency names the vehicle file key that explains it."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import AttitudeError, InputError
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.attitudefilter import FilterInput, LinearFilter, Noise, linear_filter
from massprop_cli.prepare.referenceattitude import START, filter_input, reference_attitude

REFUTED = 50.0
"""Chi-square limit, 3 degrees of freedom, of a bias, misalignment or latency against its stated prior; false-alarm rate 1e-10."""
EXPLAINED = 6.0
"""Limit of the innovations' chi-square above its expectation, in its standard deviations, for a model that explains the log."""
ROUNDS = 4
"""Maximum number of relinearisations about the estimated latency."""
BIAS, TURN, LATENCY = 0.1, 0.2, 0.5
"""Prior sigmas of the search: gyro bias, rad/s; misalignment, rad; latency, s."""


class NoiseAndLatency(NamedTuple):
    """Noise and latency of a logged attitude."""

    noise: Noise
    """As stated, or estimated from the log."""
    latency_s: float
    latency_sigma_s: float


def check_attitude(log: Log, vehicle: Vehicle) -> NoiseAndLatency | None:
    """Estimate noise and latency of a logged attitude; None without logged attitudes or without a pivot.

    Raises :class:`InputError` if a bias, misalignment or latency exceeds its stated prior and explains the log.
    """
    auto = vehicle.imu.attitude_latency_s == "auto"
    # an unknown latency adds to the scatter, so the stated sigma does not apply
    assumed = _with(vehicle, attitude_latency_s=0.0, attitude_sigma_rad=None) if auto else vehicle
    inputs = filter_input(log, assumed)
    if inputs is None:
        return None
    for _ in range(ROUNDS):
        estimate, count = _linear(log, assumed)
        explained = estimate.chi_square - count < EXPLAINED * (2 * count) ** 0.5
        latency_s = max(assumed.imu.attitude_latency + float(estimate.states[-1, 9]), 0.0)
        if explained:
            break
        # the model is linear only for a latency well below a cycle's motion
        assumed = _with(assumed, attitude_latency_s=latency_s)
    imu, sigma_s = vehicle.imu, float(estimate.covariance[-1, 9, 9]) ** 0.5
    excess = (0.0 if auto else latency_s - imu.attitude_latency, (sigma_s**2 + imu.attitude_latency_sigma_s**2) ** 0.5)
    chi_square, what, remedy = max(_unstated(inputs, estimate, latency_s, excess))
    if chi_square > REFUTED and explained:
        raise AttitudeError(
            f"{log.path}, columns quat_w … quat_z: attitude and gyro contradict each other by {chi_square**0.5:.2g} sigma, but agree "
            f"{what}; {remedy}, or leave the columns out"
        )
    at_latency = filter_input(log, _with(vehicle, attitude_latency_s=latency_s)) if auto else inputs
    return None if at_latency is None else NoiseAndLatency(at_latency.noise, latency_s, sigma_s)


def _with(vehicle: Vehicle, **imu: float | None) -> Vehicle:
    """The vehicle with other values of ``imu`` keys."""
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=imu)})


def _linear(log: Log, vehicle: Vehicle) -> tuple[LinearFilter, int]:
    """Estimates of bias, misalignment and latency with wide priors, and the number of innovations."""
    known, about = filter_input(log, vehicle), reference_attitude(log, vehicle)
    if known is None or about is None:  # a latency beyond the log
        raise InputError(
            f"{log.path}: imu.attitude_latency_s = {vehicle.imu.attitude_latency:g} puts all attitudes before the log; correct it"
        )
    return linear_filter(known, about, START**2 * np.eye(3), (BIAS, TURN, LATENCY)), 3 * int(np.isfinite(about.noise_rad).sum())


def _unstated(inputs: FilterInput, estimate: LinearFilter, latency_s: float, excess: tuple[float, float]) -> list[tuple[float, str, str]]:
    """Chi-square of bias, misalignment and latency against their priors, with a description and a remedy each.

    ``excess``: estimated less stated latency, and its sigma, s.
    """
    bias, turn, last, covariance = slice(3, 6), slice(6, 9), estimate.states[-1], estimate.covariance[-1]

    def chi_square(states: slice, sigma: float) -> float:
        expected = covariance[states, states] + sigma**2 * np.eye(states.stop - states.start)
        return float(last[states] @ np.linalg.solve(expected, last[states]))

    walk = inputs.bias_walk * float(inputs.motion.duration_s.sum()) ** 0.5
    by_bias, by_turn = chi_square(bias, float(np.hypot(inputs.bias_sigma, walk))), chi_square(turn, inputs.misalignment_sigma)
    turned = f"with the attitude's axes turned by {_listed(last[turn])} rad from the body's"
    causes = [
        (by_bias, f"with a gyro bias of {_listed(last[bias])} rad/s", "state imu.gyro_bias_sigma_rad_s"),
        (by_turn, turned, "state imu.attitude_misalignment_sigma_rad"),
    ]
    if latency_s > 0:
        causes.append(
            ((excess[0] / excess[1]) ** 2, f"with a latency of {latency_s:.3g} s", f"state imu.attitude_latency_s = {latency_s:.3g}")
        )
    return causes


def _listed(numbers: Array) -> str:
    """Numbers as text, in parentheses."""
    return "(" + ", ".join(f"{number:.2g}" for number in numbers) + ")"
