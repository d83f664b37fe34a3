"""Mass properties about a fixed pivot, and those about the CG that a weighed mass makes of them.

With s = c − b from the pivot b to the CG, κ = m s and S(s) = |s|² 1 − s sᵀ: ``I_p = I + m S(s)`` (parallel axis). The motion on a pedestal
depends on I_p and κ alone, so an error of the weighed mass moves c by ``−s/m`` and I by ``S(s)`` for each kg, and neither I_p nor κ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import MOMENTS, elements, spread, spread_by_arm
from massprop_cli.inputs.vehicle import Vehicle

UPDATES = 8
"""Of an iterated update."""
RULED_OUT = 40.0
"""−2 log likelihood beyond which one of two scales is ruled out."""
UNSIZED = 0.3
"""Sigmas of the size of all, over the change of it that known inertia asks for, beyond which the log tells ratios alone."""


class AboutCg(NamedTuple):
    """The ten quantities of K rows, and what else makes them uncertain."""

    values: Array
    """(K, 10) ixx … mass; mass is NaN where it wasn't weighed, and inertia then about the pivot."""
    covariance: Array
    """(K, 10, 10) by the log's noise."""
    by_mass: Array
    """(K, 10, 10) by the weighed mass' sigma, and by what else a swing may be the swing of."""


def about_cg(mean: Array, covariance: Array, vehicle: Vehicle) -> AboutCg:
    """Of the state parameters (K, 10) about the pivot, and their covariance (K, 10, 10)."""
    weighed, count = vehicle.known.get("mass"), len(mean)
    values, slope = mean.copy(), np.zeros((count, 10, 10))
    slope[:, range(9), range(9)] = 1.0
    if weighed is None:
        values[:, 9] = slope[:, 9, 9] = np.nan
        return AboutCg(values, slope @ covariance @ slope.transpose(0, 2, 1), np.zeros((count, 10, 10)))
    pivot, assumed = np.array(vehicle.environment.bearing_position_m), 1 / mean[:, 9, None]
    slope[:, range(6, 9), range(6, 9)] = assumed
    moments = np.concatenate([mean[:, :6], (mean[:, 6:9] - pivot) * assumed], 1)
    nine = (slope @ covariance @ slope.transpose(0, 2, 1))[:, :9, :9]
    known = {i: vehicle.known[name] for i, name in enumerate(INERTIA) if name in vehicle.known}
    if not known:
        return beside_mass(moments, nine, pivot, weighed.value, weighed.sigma)
    wanted, sigma = (np.array([getattr(one, part) for one in known.values()]) for part in ("value", "sigma"))
    own = _Inertia(list(known), wanted, sigma, weighed.value)
    each = [_scaled(moments, nine, factor, own) for factor in _factors(moments, own).T]
    cost = np.array([one.cost for one in each])
    best = _chosen(each, cost.argmin(0))
    found = beside_mass(best.about, best.covariance, pivot, weighed.value, weighed.sigma, best.at)
    # a pendulum swings alike about two points of a line, and only the moment along it tells which one it is
    with np.errstate(invalid="ignore"):
        beyond = cost - cost.min(0)
        odds = np.where(beyond < RULED_OUT, np.exp(-beyond / 2), 0.0)
        apart = np.stack([_ten(one.at, pivot, weighed.value) - _ten(best.at, pivot, weighed.value) for one in each])
        apart = np.nan_to_num(apart * np.sqrt(odds / np.maximum(odds.sum(0), 1.0))[..., None])
    return found._replace(by_mass=found.by_mass + np.einsum("nki,nkj->kij", apart, apart))


class _Inertia(NamedTuple):
    """What is known of inertia about the CG: which elements, their values and sigmas, kg m²; and the mass, kg."""

    which: list[int]
    wanted: Array
    sigma: Array
    mass: float


class _Scaled(NamedTuple):
    """What a log tells about the pivot (K, 9) by one scale of all, what that is conditioned to, and −2 log likelihood of this, (K,)."""

    about: Array
    covariance: Array
    at: Array
    cost: Array


def _chosen(found: Sequence[_Scaled], place: NDArray[np.intp]) -> _Scaled:
    """Row by row, the one at its ``place`` (K,)."""
    rows = np.arange(len(place))
    return _Scaled(*(np.stack([getattr(one, part) for one in found])[place, rows] for part in _Scaled._fields))


def _factors(about: Array, known: _Inertia) -> Array:
    """(K, 3) by which all of ``about`` (K, 9) may have to be scaled for inertia about the CG to be most like what is known; or 1.

    A swing tells ratios alone. With the factor s it is ``s a − s² b``, so what it leaves of what is known is least where a cubic in 1/s is
    zero.
    """
    a = about[:, known.which] / known.sigma
    b = known.mass * elements(spread(about[:, 6:9] / known.mass))[:, known.which] / known.sigma
    w = known.wanted / known.sigma
    cubic = np.stack([-(a * w).sum(1), (a * a + 2 * b * w).sum(1), -3 * (a * b).sum(1), 2 * (b * b).sum(1)], 1)
    companion = np.zeros((len(about), 3, 3))
    with np.errstate(invalid="ignore"):
        companion[:, 0] = -cubic[:, 1:] / cubic[:, :1]
    companion[:, [1, 2], [0, 1]] = 1.0
    found = np.linalg.eigvals(np.where(np.isfinite(companion), companion, 0.0))
    real = (np.abs(found.imag) < np.abs(found.real)) & (found.real > 0)
    return 1 / np.where(real, found.real, 1.0)


def _scaled(about: Array, covariance: Array, factor: Array, known: _Inertia) -> _Scaled:
    """By a factor (K,), but where the log tells the size: then that is only where the search begins.

    Inertia about the CG, I = I_p − m S, is of second order in a first moment that is hardly told: an iterated Kalman update (Bell & Cathey
    1993). What tells ratios alone tells as much of them at any size.
    """
    size, sigma = about[:, MOMENTS].sum(1), np.sqrt(covariance[:, MOMENTS][..., MOMENTS].sum((1, 2)))
    found, by = factor[:, None] * about, np.where(sigma > UNSIZED * np.abs(factor - 1) * size, factor, 1.0)
    about, covariance = by[:, None] * about, by[:, None, None] ** 2 * covariance
    for _ in range(UPDATES):
        slope = np.zeros((len(about), 6, 9))
        slope[:, range(6), range(6)], slope[:, :, 6:] = 1.0, -spread_by_arm(found[:, 6:] / known.mass)
        slope = slope[:, known.which]
        left = known.wanted - _inertia(found, known.mass)[:, known.which] - (slope @ (about - found)[..., None])[..., 0]
        across = covariance @ slope.transpose(0, 2, 1)
        spread_of = slope @ across + np.diag(known.sigma**2)
        weighted = np.linalg.solve(spread_of, left[..., None])
        found = np.asarray(about + (across @ weighted)[..., 0])
    with np.errstate(invalid="ignore"):
        cost = (left * weighted[..., 0]).sum(1) + np.linalg.slogdet(spread_of / np.outer(known.sigma, known.sigma))[1]
    return _Scaled(about, covariance, found, np.where(np.isfinite(cost), cost, np.inf))


def _ten(about: Array, pivot: Array, mass: float) -> Array:
    """(K, 10) the ten quantities."""
    return np.column_stack([_inertia(about, mass), pivot + about[:, 6:9] / mass, np.full(len(about), mass)])


def _inertia(about: Array, mass: float) -> Array:
    """(K, 6) about the CG."""
    return about[:, :6] - mass * elements(spread(about[:, 6:9] / mass))


def beside_mass(about: Array, covariance: Array, pivot: Array, mass: float, sigma: float, at: Array | None = None) -> AboutCg:
    """Of inertia about the pivot (3,) and first moment, K rows (K, 9), their covariance (K, 9, 9), and a mass that was weighed, kg.

    Linear about ``at`` (K, 9), by default ``about``.
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
    """(…, 10) derivative of the ten quantities (…, 10) by the common scale of all thrust: inertia and κ about the pivot follow it."""
    found = values.copy()
    arm = values[..., 6:9] - np.array(vehicle.environment.bearing_position_m)
    if (weighed := vehicle.known.get("mass")) is not None:
        found[..., :6] -= weighed.value * elements(spread(arm))
    found[..., 6:9], found[..., 9] = arm, 0.0
    return found


def about_pivot(values: Array, covariance: Array, pivot: Array, assumed_kg: Array) -> tuple[Array, Array]:
    """(…, 9) inertia about the pivot (3,) and first moment, and their covariance (…, 9, 9), of the ten quantities (…, 10) and theirs.

    Where the mass wasn't weighed (NaN), inertia is about the pivot already, and the CG is the first moment's over ``assumed_kg`` (…,).
    """
    about, slope = by_ten(values, pivot, assumed_kg)
    shared = np.where(np.isfinite(covariance) | np.isfinite(values[..., 9])[..., None, None], covariance, 0.0)
    return about, slope @ shared @ np.swapaxes(slope, -1, -2)


def by_ten(values: Array, pivot: Array, assumed_kg: Array) -> tuple[Array, Array]:
    """The same nine (…, 9), and their derivative (…, 9, 10) by the ten."""
    arm, weighed = values[..., 6:9] - pivot, np.isfinite(values[..., 9])
    mass, shifted = np.where(weighed, values[..., 9], assumed_kg), np.where(weighed, values[..., 9], 0.0)
    slope = np.zeros((*values.shape[:-1], 9, 10))
    slope[..., range(6), range(6)], slope[..., range(6, 9), range(6, 9)] = 1.0, mass[..., None]
    slope[..., :6, 6:9] = shifted[..., None, None] * spread_by_arm(arm)
    slope[..., :6, 9], slope[..., 6:, 9] = elements(spread(arm)), arm
    slope[~weighed, :, 9] = 0.0
    about = values[..., :6] + shifted[..., None] * elements(spread(arm))
    return np.concatenate([about, mass[..., None] * arm], -1), slope
