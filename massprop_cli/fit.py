"""A whole stretch of the log fitted at once, about a reference, with whatever else is asked for beside the mass properties.

The filter's linear system without process noise is one least-squares problem in the state at the start: mass properties, rate, nuisances,
and extra unknowns such as a shift of the delay or a factor on a jet's thrust. Quick enough to try one supposition after another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.linearise import PARAMETERS, RATE, Layout, Linear, linearise, natural_sizes, parameters, stepped
from massprop_cli.plant import Reference
from massprop_cli.vehicle import Vehicle

PASSES = 8
"""Most Gauss–Newton steps."""
SETTLED = 1e-5
"""Relative change of chi-square at which they end."""
PRIOR = 100.0
"""Prior sigma of the mass properties over their natural size."""


@dataclass(frozen=True)
class Extra:
    """Further unknowns: what one unit of each does."""

    growth: Array
    """(K − 1, 3, e) growth of the mean rate from cycle to cycle, rad/s."""
    force: Array
    """(K, 3, e) specific force, m/s²."""
    sigma: float
    """Prior sigma of each."""


@dataclass(frozen=True)
class Fit:
    """What fits best."""

    reference: Reference
    chi_square: float
    """Mean squared residual over the noise that the vehicle file states, all six channels; 1 if noise explains them."""
    channels: Array
    """(6,) the same for each channel: rate x y z, specific force x y z."""
    extra: Array
    """(e,)"""
    extra_covariance: Array
    """(e, e) from the stated noise."""


def response(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array]:
    """(K − 1, 3) growth of the rate and (K, 3) specific force that a reference expects of its commands and the measured rates."""
    system = linearise(samples, cycles, reference, vehicle)
    force = samples.specific_force_m_s2[cycles] - system.measured[:, 3:]
    return system.steps, force + np.einsum("kij,j->ki", system.observation[:, 3:, PARAMETERS], parameters(reference))


def fit(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle, extra: Extra | None = None, passes: int = PASSES) -> Fit:
    """Gauss–Newton from ``reference``, or one linear fit about it with no ``passes``; the extra unknowns are linear about zero.

    Noise levels must be set in ``vehicle``.
    """
    found, target = _step(samples, cycles, reference, vehicle, extra)
    for _ in range(passes):
        # the residual of a linear fit about a poor reference may be too small: only that of a reference that stands still counts
        renewed = stepped(found.reference, target)
        if renewed is None:
            break
        before = found.chi_square
        found, target = _step(samples, cycles, renewed, vehicle, extra)
        if not np.isfinite(found.chi_square) or abs(found.chi_square - before) < SETTLED * before:
            break
    return found


def _step(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle, extra: Extra | None) -> tuple[Fit, Array]:
    """The linear fit about ``reference``, and the parameters (10,) that it finds."""
    system = linearise(samples, cycles, reference, vehicle)
    layout = Layout.of(samples, vehicle)
    count = 0 if extra is None else extra.growth.shape[-1]
    with np.errstate(all="ignore"):  # a supposition far off may run away; its chi-square is then infinite, which says enough
        rows, target = _stacked(system, vehicle, extra)
    if not (np.isfinite(rows).all() and np.isfinite(target).all()):
        return Fit(reference, np.inf, np.full(6, np.inf), np.zeros(count), np.full((count, count), np.inf)), parameters(reference)
    sigma = np.concatenate([_prior(layout, reference, vehicle), np.full(count, extra.sigma if extra else 1.0)])
    mean = np.zeros(layout.size + count)
    mean[PARAMETERS], mean[RATE] = parameters(reference), samples.rate_rad_s[cycles.start]
    known = sigma > 0
    joint = np.vstack([rows[:, known] * sigma[known], np.eye(int(known.sum()))])
    aim = np.concatenate([target - rows @ mean, np.zeros(int(known.sum()))])
    basis, triangle = np.linalg.qr(joint)
    scaled = np.linalg.solve(triangle, basis.T @ aim)
    state = mean.copy()
    state[known] += sigma[known] * scaled
    left = target - rows @ state
    root = np.zeros((layout.size + count, int(known.sum())))
    root[known] = np.linalg.inv(triangle) * sigma[known][:, None]
    tail = root[layout.size :]
    with np.errstate(over="ignore"):
        channels = (left.reshape(-1, 6) ** 2).mean(0)
    return Fit(reference, float(channels.mean()), channels, state[layout.size :], tail @ tail.T), state[PARAMETERS]


def _stacked(system: Linear, vehicle: Vehicle, extra: Extra | None) -> tuple[Array, Array]:
    """Whitened rows (6 K, n + e) and target (6 K,) in terms of the state at the start."""
    cycles, size = len(system.measured), system.drive.shape[1]
    count = 0 if extra is None else extra.growth.shape[-1]
    to_state, offset = np.eye(size, size + count), np.zeros(size)
    rows, target = np.empty((cycles, 6, size + count)), np.empty((cycles, 6))
    for k in range(cycles):
        if k > 0:
            to_state = system.transition[k - 1] @ to_state
            offset = system.transition[k - 1] @ offset + system.drive[k - 1]
            if extra is not None:
                to_state[RATE, size:] += extra.growth[k - 1]
        rows[k] = system.observation[k] @ to_state
        target[k] = system.measured[k] - system.observation[k] @ offset
    if extra is not None:
        rows[:, 3:, size:] += extra.force
    noise = np.repeat([vehicle.imu.gyro_noise_rad_s or 1.0, vehicle.imu.accel_noise_m_s2 or 1.0], 3)
    return (rows / noise[:, None]).reshape(-1, size + count), (target / noise).ravel()


def _prior(layout: Layout, reference: Reference, vehicle: Vehicle) -> Array:
    """(n,) prior sigmas; zero for what is known."""
    sigma = np.zeros(layout.size)
    sigma[PARAMETERS] = PRIOR * natural_sizes(reference)
    sigma[RATE] = 1.0
    sigma[layout.gyro_bias] = vehicle.imu.gyro_bias_sigma_rad_s
    sigma[layout.accel_bias] = vehicle.imu.accel_bias_sigma_m_s2
    return sigma
