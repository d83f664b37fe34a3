"""Mass properties about a fixed pivot, and those about the CG that follow from a known mass.

With s = c − b from the pivot b to the CG, κ = m s and S(s) = |s|² 1 − s sᵀ: ``I_p = I + m S(s)`` (parallel axis theorem). The motion on a
pedestal depends on I_p and κ only. An error of the known mass moves c by ``−s/m`` and I by ``S(s)`` per kg; I_p and κ do not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import ITERATIONS, UNINFORMED
from massprop_cli.base.rigidbody import MOMENTS, elements, spread, spread_by_arm
from massprop_cli.inputs.vehicle import Vehicle

RULED_OUT = 40.0
"""Excess of −2 log likelihood above which a scale is ruled out."""


class AboutCg(NamedTuple):
    """The ten quantities of K rows about the CG."""

    values: Array
    """(K, 10) ixx … mass; without a known mass, the mass is NaN and the inertia is about the pivot."""
    covariance: Array
    """(K, 10, 10) covariance by the log's noise."""
    by_mass: Array
    """(K, 10, 10) covariance by the known mass' sigma, and by other scales that explain a free oscillation as well."""


def about_cg(mean: Array, covariance: Array, vehicle: Vehicle) -> AboutCg:
    """The ten quantities, from the state parameters (K, 10) about the pivot and their covariance (K, 10, 10)."""
    known_mass, count = vehicle.known.get("mass"), len(mean)
    values, slope = mean.copy(), np.zeros((count, 10, 10))
    slope[:, range(9), range(9)] = 1.0
    if known_mass is None:
        values[:, 9] = slope[:, 9, 9] = np.nan
        return AboutCg(values, slope @ covariance @ slope.transpose(0, 2, 1), np.zeros((count, 10, 10)))
    pivot, assumed = np.array(vehicle.environment.bearing_position_m), 1 / mean[:, 9, None]
    slope[:, range(6, 9), range(6, 9)] = assumed
    moments = np.concatenate([mean[:, :6], (mean[:, 6:9] - pivot) * assumed], 1)
    nine = (slope @ covariance @ slope.transpose(0, 2, 1))[:, :9, :9]
    known = {i: vehicle.known[name] for i, name in enumerate(INERTIA) if name in vehicle.known}
    if not known:
        return with_mass(moments, nine, pivot, known_mass.value, known_mass.sigma)
    value, sigma = (np.array([getattr(one, part) for one in known.values()]) for part in ("value", "sigma"))
    inertia = _KnownInertia(list(known), value, sigma, known_mass.value)
    each = [_scaled(moments, nine, factor, inertia) for factor in _factors(moments, inertia).T]
    cost = np.array([one.cost for one in each])
    best = _chosen(each, cost.argmin(0))
    result = with_mass(best.about, best.covariance, pivot, known_mass.value, known_mass.sigma, best.at)
    # a pendulum has the same frequency about two points of a line: only the moment of inertia along it distinguishes them
    with np.errstate(invalid="ignore"):
        excess = cost - cost.min(0)
        odds = np.where(excess < RULED_OUT, np.exp(-excess / 2), 0.0)
        apart = np.stack([_ten(one.at, pivot, known_mass.value) - _ten(best.at, pivot, known_mass.value) for one in each])
        apart = np.nan_to_num(apart * np.sqrt(odds / np.maximum(odds.sum(0), 1.0))[..., None])
    return result._replace(by_mass=result.by_mass + np.einsum("nki,nkj->kij", apart, apart))


class _KnownInertia(NamedTuple):
    """Known inertia about the CG, and known mass."""

    which: list[int]
    """Indices of the known elements."""
    value: Array
    """(n,) kg m²"""
    sigma: Array
    """(n,) kg m²"""
    mass: float
    """kg"""


class _Scaled(NamedTuple):
    """Inertia and first moment about the pivot at one scale, K rows."""

    about: Array
    """(K, 9) from the log, scaled."""
    covariance: Array
    """(K, 9, 9) of ``about``."""
    at: Array
    """(K, 9) conditioned on the known inertia."""
    cost: Array
    """(K,) −2 log likelihood."""


def _chosen(scaled: Sequence[_Scaled], place: NDArray[np.intp]) -> _Scaled:
    """Row by row, the element of ``scaled`` with index ``place`` (K,)."""
    rows = np.arange(len(place))
    return _Scaled(*(np.stack([getattr(one, part) for one in scaled])[place, rows] for part in _Scaled._fields))


def _factors(about: Array, known: _KnownInertia) -> Array:
    """(K, 3) scale factors of ``about`` (K, 9) at which the inertia about the CG is closest to the known one; 1 where there is none.

    A free oscillation informs ratios only. With the factor s the inertia about the CG is ``s a − s² b``. Its squared distance to the known
    inertia is stationary where a cubic in 1/s is zero.
    """
    a = about[:, known.which] / known.sigma
    b = known.mass * elements(spread(about[:, 6:9] / known.mass))[:, known.which] / known.sigma
    w = known.value / known.sigma
    cubic = np.stack([-(a * w).sum(1), (a * a + 2 * b * w).sum(1), -3 * (a * b).sum(1), 2 * (b * b).sum(1)], 1)
    companion = np.zeros((len(about), 3, 3))
    with np.errstate(invalid="ignore"):
        companion[:, 0] = -cubic[:, 1:] / cubic[:, :1]
    companion[:, [1, 2], [0, 1]] = 1.0
    roots = np.linalg.eigvals(np.where(np.isfinite(companion), companion, 0.0))
    real = (np.abs(roots.imag) < np.abs(roots.real)) & (roots.real > 0)
    return 1 / np.where(real, roots.real, 1.0)


def _scaled(about: Array, covariance: Array, factor: Array, known: _KnownInertia) -> _Scaled:
    """Condition ``about`` (K, 9), scaled by ``factor`` (K,), on the known inertia; where the log informs the size, the scale stays 1.

    I = I_p − m S is of second order in a poorly known first moment, so the Kalman update is iterated (Bell & Cathey 1993). It starts from
    the scaled value in any case. A log that informs ratios only does so equally well at any size.
    """
    size, sigma = about[:, MOMENTS].sum(1), np.sqrt(covariance[:, MOMENTS][..., MOMENTS].sum((1, 2)))
    at, by = factor[:, None] * about, np.where(sigma > UNINFORMED * np.abs(factor - 1) * size, factor, 1.0)
    about, covariance = by[:, None] * about, by[:, None, None] ** 2 * covariance
    for _ in range(ITERATIONS):
        slope = np.zeros((len(about), 6, 9))
        slope[:, range(6), range(6)], slope[:, :, 6:] = 1.0, -spread_by_arm(at[:, 6:] / known.mass)
        slope = slope[:, known.which]
        innovation = known.value - _inertia(at, known.mass)[:, known.which] - (slope @ (about - at)[..., None])[..., 0]
        cross_covariance = covariance @ slope.transpose(0, 2, 1)
        innovation_covariance = slope @ cross_covariance + np.diag(known.sigma**2)
        weighted = np.linalg.solve(innovation_covariance, innovation[..., None])
        at = np.asarray(about + (cross_covariance @ weighted)[..., 0])
    with np.errstate(invalid="ignore"):
        determinant = np.linalg.slogdet(innovation_covariance / np.outer(known.sigma, known.sigma))[1]
        cost = (innovation * weighted[..., 0]).sum(1) + determinant
    return _Scaled(about, covariance, at, np.where(np.isfinite(cost), cost, np.inf))


def _ten(about: Array, pivot: Array, mass: float) -> Array:
    """(K, 10) the ten quantities, from inertia about the pivot and first moment (K, 9)."""
    return np.column_stack([_inertia(about, mass), pivot + about[:, 6:9] / mass, np.full(len(about), mass)])


def _inertia(about: Array, mass: float) -> Array:
    """(K, 6) inertia about the CG, from inertia about the pivot and first moment (K, 9)."""
    return about[:, :6] - mass * elements(spread(about[:, 6:9] / mass))


def with_mass(about: Array, covariance: Array, pivot: Array, mass: float, sigma: float, at: Array | None = None) -> AboutCg:
    """The ten quantities, from inertia about the pivot (3,) and first moment (K, 9), their covariance (K, 9, 9), and a known mass, kg.

    Linearised about ``at`` (K, 9), by default ``about``.
    """
    at = about if at is None else at
    count, arm = len(about), at[:, 6:9] / mass
    values = _ten(at, pivot, mass)
    slope = np.zeros((count, 10, 9))
    slope[:, range(9), range(9)] = np.repeat([1.0, 1 / mass], [6, 3])
    slope[:, :6, 6:9] = -spread_by_arm(arm)
    values += (slope @ (about - at)[..., None])[..., 0]
    by_mass = sigma * np.column_stack([elements(spread(arm)), -arm / mass, np.ones(count)])
    return AboutCg(values, slope @ covariance @ slope.transpose(0, 2, 1), by_mass[:, :, None] * by_mass[:, None, :])


def by_thrust_scale(values: Array, vehicle: Vehicle) -> Array:
    """(…, 10) derivative of the ten quantities (…, 10) with respect to the thrust scale; I_p and κ are proportional to it."""
    slope = values.copy()
    arm = values[..., 6:9] - np.array(vehicle.environment.bearing_position_m)
    if (known_mass := vehicle.known.get("mass")) is not None:
        slope[..., :6] -= known_mass.value * elements(spread(arm))
    slope[..., 6:9], slope[..., 9] = arm, 0.0
    return slope


def about_pivot(values: Array, covariance: Array, pivot: Array, assumed_kg: Array) -> tuple[Array, Array]:
    """(…, 9) inertia about the pivot (3,) and first moment, and their covariance (…, 9, 9), from the ten quantities (…, 10) and theirs.

    Without a known mass (NaN), the inertia is about the pivot already, and ``assumed_kg`` (…,) is the mass of the CG's first moment.
    """
    about, slope = pivot_quantities(values, pivot, assumed_kg)
    shared = np.where(np.isfinite(covariance) | np.isfinite(values[..., 9])[..., None, None], covariance, 0.0)
    return about, slope @ shared @ np.swapaxes(slope, -1, -2)


def pivot_quantities(values: Array, pivot: Array, assumed_kg: Array) -> tuple[Array, Array]:
    """(…, 9) inertia about the pivot and first moment, and (…, 9, 10) their derivative with respect to the ten quantities."""
    arm, known = values[..., 6:9] - pivot, np.isfinite(values[..., 9])
    mass, shifted = np.where(known, values[..., 9], assumed_kg), np.where(known, values[..., 9], 0.0)
    slope = np.zeros((*values.shape[:-1], 9, 10))
    slope[..., range(6), range(6)], slope[..., range(6, 9), range(6, 9)] = 1.0, mass[..., None]
    slope[..., :6, 6:9] = shifted[..., None, None] * spread_by_arm(arm)
    slope[..., :6, 9], slope[..., 6:, 9] = elements(spread(arm)), arm
    slope[~known, :, 9] = 0.0
    about = values[..., :6] + shifted[..., None] * elements(spread(arm))
    return np.concatenate([about, mass[..., None] * arm], -1), slope
