"""Whether the sigmas hold: what a wrong model leaves, looked for where it would stand, and what it may have done to the values.

A model that is wrong (a delay, a rise, a low-pass, a jet, a tilt, a lever arm, a torque that nobody stated) leaves residuals that follow
what drives the motion: each channel's commands, those of neighbouring cycles, rates and their products, gravity, a constant. Noise that
nobody stated does not. So residuals are regressed on such *probes*, and the sum of squares Q that d of them explain in a channel is held
against chance (lack of fit against pure error, as regression analysis has it).
:func:`innovation_test` looks into the whitened innovations about the final estimate. Where disturbances were sized until innovations
fit, the misfit is in the disturbances, so :func:`hidden_error` looks into what plain least squares leaves of rate growth and specific
force, with the pure error taken from the residuals themselves. As much of a misfit may have gone into the values as is still
visible: the least-squares error that a residual of size √Q, aligned with the regressors as badly as can be, would cause,

    δ_i² = [(AᵀA)⁻¹]_ii Q .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.dynamics import times
from massprop_cli.history import History
from massprop_cli.lift import products
from massprop_cli.linearise import MU, PARAMETERS, RATE, linearise, parameters
from massprop_cli.plant import Reference, plant_of
from massprop_cli.vehicle import Vehicle

LAGS = (0, 1, 2)
"""Cycles by which commands are shifted: pulses that come late or smeared. Not those still to come: a controller's answer to a disturbance
follows it."""
SIGNIFICANT = 5.5
"""Normal deviate that a channel must exceed: one of 50 million clean ones does by chance. benchmarks/faults.py moves if it is changed."""
WANDER = 21
"""Cycles within which what wanders hardly moves, and pulses begin and end."""
SPARE = 3
"""Residuals that there must be for each probe."""


def innovation_test(history: History, samples: Samples) -> Array:
    """(6,) √(Q/d) of each channel's whitened innovations where it is more than chance, else 1: rate x y z, specific force x y z.

    By so much are the sigmas too small that the channel gives: noise and model promise 1 for each direction.
    """
    cycles = history.cycles
    told = np.isfinite(history.normalised).all(1)
    basis = _orthonormal(_probes(_lagged(samples.executed.channels.whole), samples)[cycles][told])
    if basis.shape[1] == 0 or told.sum() < SPARE * basis.shape[1]:
        return np.ones(6)
    innovation = history.normalised[told]
    mean = ((basis.T @ innovation) ** 2).mean(0)
    return np.where(_deviate(mean, basis.shape[1]) > SIGNIFICANT, np.sqrt(mean), 1.0)


def hidden_error(history: History, samples: Samples, vehicle: Vehicle) -> Array:
    """(10,) by how much each quantity may be off through what the model does not hold, in its unit; 0 where nothing but chance is left.

    Rates and specific force each give their own; they count as each told the quantity (``history.information_share``).
    """
    reference = history.reference
    if reference is None or any(getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields):
        return np.zeros(10)  # a body that is stated to change leaves what it should
    cycles, share, channels = history.cycles, history.information_share, samples.executed.channels
    system = linearise(samples, cycles, reference, vehicle)
    window = np.zeros_like(channels.whole)
    window[:-1] = channels.rising[:-1] + (channels.whole - channels.rising)[1:]
    growth = np.diff(samples.rate_rad_s[cycles], axis=0) - system.steps
    felt = system.measured[:, 3:] - times(system.observation[:, 3:, PARAMETERS], parameters(reference))
    # what wanders and is known to: a slow torque, biases, and on a bearing the attitude that the gyro gives
    tilted = vehicle.on_air_bearing and samples.executed.attitude_wxyz is None
    slow = tilted or vehicle.environment.disturbance_walk_n_m > 0
    biased = tilted or vehicle.imu.accel_bias_sigma_m_s2 > 0
    turning, pushing = _weights(samples, cycles, reference, vehicle)
    rates = _Rows(system.transition[:, RATE, PARAMETERS], growth, _probes(_lagged(window), samples)[cycles][:-1])
    forces = _Rows(system.observation[:, 3:, PARAMETERS], felt, _probes(_lagged(channels.whole), samples)[cycles])
    parts = _hidden(rates.weighted(turning), share[:, :3], slow), _hidden(forces.weighted(pushing), share[:, 3:], biased)
    weight = np.stack([share[:, :3].sum(1), share[:, 3:].sum(1)])
    found: Array = np.sqrt((weight * np.stack(parts)).sum(0))
    found[MU] /= reference.mu**2
    return found


def _weights(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array]:
    """(K − 1,) and (K,) weights that make stated pulse errors as large in every cycle as the IMU's noise alone is."""
    covariance = samples.executed.pulse_covariance
    count = cycles.stop - cycles.start
    if covariance is None:
        return np.ones(count - 1), np.ones(count)
    moment = np.linalg.inv(reference.inertia) @ plant_of(vehicle).jet_moment(reference)
    turned = np.trace(moment @ covariance[cycles] @ moment.T, axis1=1, axis2=2) / 3
    pushed = reference.mu**2 * np.trace(covariance[cycles, 3:, 3:], axis1=1, axis2=2) / 3 / samples.executed.duration_s[cycles] ** 2
    gyro, accel = 2 * (vehicle.imu.gyro_noise_rad_s or 0.0) ** 2, (vehicle.imu.accel_noise_m_s2 or 0.0) ** 2
    return np.sqrt(gyro / (gyro + turned[:-1] + turned[1:])), np.sqrt(accel / (accel + pushed))


@dataclass(frozen=True)
class _Rows:
    """Regressors (N, 3, 10), residual (N, 3) and probes (N, d) of one kind of measurement."""

    regressors: Array
    residual: Array
    probes: Array

    def weighted(self, weight: Array) -> _Rows:
        return _Rows(self.regressors * weight[:, None, None], self.residual * weight[:, None], self.probes * weight[:, None])

    def quick(self) -> _Rows:
        return _Rows(_quick(self.regressors), _quick(self.residual), _quick(self.probes))


def _hidden(rows: _Rows, share: Array, slow: bool) -> Array:
    """(10,) δ² of one kind of measurement; ``slow``: something in it is known to wander, so only what is quick counts."""
    rows = rows.quick() if slow else rows
    regressors, residual, probes = rows.regressors, rows.residual, rows.probes
    size = np.sqrt((regressors**2).sum((0, 1)))
    seen = size > 0
    flat = (regressors[:, :, seen] / size[seen]).reshape(-1, int(seen.sum()))
    left, singular, right = np.linalg.svd(flat, full_matrices=False)
    kept = singular > 1e-6 * singular.max(initial=0.0)
    left, singular, right = left[:, kept], singular[kept], right[kept]
    residual = residual - (left @ (left.T @ residual.ravel())).reshape(residual.shape)
    basis = _orthonormal(probes)
    count, freedom = basis.shape[1], len(residual) - basis.shape[1]
    if count == 0 or len(residual) < SPARE * count:
        return np.zeros(10)
    explained = ((basis.T @ residual) ** 2).sum(0)
    pure = np.maximum(((residual**2).sum(0) - explained) / freedom, 1e-300)
    excess = np.where(_deviate(explained / count / pure, count) > SIGNIFICANT, explained - count * pure, 0.0)
    found = np.zeros(10)
    gain = ((right / singular[:, None]) ** 2).sum(0) / size[seen] ** 2
    told = np.maximum(share[seen].sum(1), 1e-300)
    found[seen] = gain * (share[seen] @ excess) / told
    return found


def _quick(values: Array) -> Array:
    """Less the mean of the :data:`WANDER` rows around each."""
    half = min(WANDER, len(values) - 1) // 2
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    first = np.maximum(np.arange(len(values)) - half, 0)
    last = np.minimum(np.arange(len(values)) + half + 1, len(values))
    mean = (total[last] - total[first]) / (last - first).reshape(-1, *(1,) * (values.ndim - 1))
    quick: Array = values - mean
    return quick


def _lagged(values: Array) -> Array:
    """(K, lags × C) the same, shifted by each of :data:`LAGS`; zeros beyond the ends."""
    found = []
    for lag in LAGS:
        shifted = np.roll(values, lag, axis=0)
        shifted[:lag] = 0.0
        found.append(shifted)
    return np.hstack(found)


def _probes(commands: Array, samples: Samples) -> Array:
    """(K, d) what a wrong model could leave: commands, rates and their products, the vertical, a constant.

    The rates are those of the cycle before: noise in a cycle's own is in what is left of it, and would be taken for a misfit where a
    spin is so steady that nothing but noise is left of it beside the constant.
    """
    rate = np.concatenate([samples.rate_rad_s[:1], samples.rate_rad_s[:-1]])
    return np.hstack([commands, rate, products(rate), samples.up_b[:-1], np.ones((len(rate), 1))])


def _orthonormal(columns: Array) -> Array:
    """(N, r) basis of what the columns span."""
    size = np.sqrt((columns**2).sum(0))
    left, singular, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    basis: Array = left[:, singular > 1e-6 * singular.max(initial=0.0)]
    return basis


def _deviate(mean: Array, count: int) -> Array:
    """Normal deviate of a mean of ``count`` squares of standard normals (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * count)
    found: Array = (np.cbrt(mean) - (1 - spread)) / np.sqrt(spread)
    return found
