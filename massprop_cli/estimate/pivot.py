"""Mass properties about a fixed pivot, and those about the CG that a weighed mass makes of them.

With s = c − b from the pivot b to the CG, κ = m s and S(s) = |s|² 1 − s sᵀ: ``I_p = I + m S(s)`` (parallel axis). The motion on a pedestal
depends on I_p and κ alone, so an error of the weighed mass moves c by ``−s/m`` and I by ``S(s)`` for each kg, and neither I_p nor κ.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, spread, spread_by_arm
from massprop_cli.inputs.vehicle import Known, Vehicle

SCALED, FACTORS, UPDATES = 100.0, 200, 8
"""Largest factor by which what a log tells in ratios may have to be scaled, how many are compared, and updates from the best of them."""


class AboutCg(NamedTuple):
    """The ten quantities of K rows, and what else makes them uncertain."""

    values: Array
    """(K, 10) ixx … mass; mass is NaN where it wasn't weighed, and inertia then about the pivot."""
    covariance: Array
    """(K, 10, 10) by the log's noise."""
    by_mass: Array
    """(K, 10, 10) by the weighed mass' sigma."""


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
    at = _with_inertia(moments, nine, weighed.value, known) if known else moments
    return beside_mass(moments, nine, pivot, weighed.value, weighed.sigma, at)


def _with_inertia(about: Array, covariance: Array, mass: float, known: Mapping[int, Known]) -> Array:
    """(K, 9) where inertia about the CG is ``known`` by its element, to second order: what ``about`` (K, 9) is conditioned to.

    A free swing tells ratios alone, so all of ``about`` may have to be scaled by a large factor, and I = I_p − m S is of second order in
    it. The search begins at the factor that leaves least, and goes on as an iterated Kalman update (Bell & Cathey 1993).
    """
    index, wanted, sigma = list(known), *(np.array([getattr(one, part) for one in known.values()]) for part in ("value", "sigma"))
    factors = np.append(np.geomspace(1 / SCALED, SCALED, FACTORS), 1.0)
    left = [(((_inertia(factor * about, mass)[:, index] - wanted) / sigma) ** 2).sum(1) for factor in factors]
    found: Array = factors[np.argmin(left, 0)][:, None] * about
    for _ in range(UPDATES):
        slope = np.zeros((len(about), 6, 9))
        slope[:, range(6), range(6)], slope[:, :, 6:] = 1.0, -spread_by_arm(found[:, 6:] / mass)
        slope = slope[:, index]
        expected = _inertia(found, mass)[:, index] + (slope @ (about - found)[..., None])[..., 0]
        across = covariance @ slope.transpose(0, 2, 1)
        found = about + (across @ np.linalg.solve(slope @ across + np.diag(sigma**2), (wanted - expected)[..., None]))[..., 0]
    return found


def _inertia(about: Array, mass: float) -> Array:
    """(K, 6) about the CG."""
    return about[:, :6] - mass * elements(spread(about[:, 6:9] / mass))


def beside_mass(about: Array, covariance: Array, pivot: Array, mass: float, sigma: float, at: Array | None = None) -> AboutCg:
    """Of inertia about the pivot (3,) and first moment, K rows (K, 9), their covariance (K, 9, 9), and a mass that was weighed, kg.

    Linear about ``at`` (K, 9), by default ``about``.
    """
    at = about if at is None else at
    count, arm = len(about), at[:, 6:9] / mass
    values = np.column_stack([_inertia(at, mass), pivot + arm, np.full(count, mass)])
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
