"""Mass properties about a fixed pivot, and those about the CG that a weighed mass makes of them.

With s = c − b from the pivot b to the CG, κ = m s and S(s) = |s|² 1 − s sᵀ: ``I_p = I + m S(s)`` (parallel axis). The motion on a pedestal
depends on I_p and κ alone, so an error of the weighed mass moves c by ``−s/m`` and I by ``S(s)`` for each kg, and neither I_p nor κ.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements
from massprop_cli.inputs.vehicle import Vehicle


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
    return beside_mass(moments, nine, pivot, weighed.value, weighed.sigma)


def beside_mass(about: Array, covariance: Array, pivot: Array, mass: float, sigma: float) -> AboutCg:
    """Of inertia about the pivot (3,) and first moment, K rows (K, 9), their covariance (K, 9, 9), and a mass that was weighed, kg."""
    count, arm = len(about), about[:, 6:9] / mass
    values = np.column_stack([about[:, :6] - mass * elements(_spread(arm)), pivot + arm, np.full(count, mass)])
    slope = np.zeros((count, 10, 9))
    slope[:, range(9), range(9)] = np.repeat([1.0, 1 / mass], [6, 3])
    slope[:, :6, 6:9] = -_spread_by_arm(arm)
    by_mass = sigma * np.column_stack([elements(_spread(arm)), -arm / mass, np.ones(count)])
    return AboutCg(values, slope @ covariance @ slope.transpose(0, 2, 1), by_mass[:, :, None] * by_mass[:, None, :])


def by_thrust_scale(values: Array, vehicle: Vehicle) -> Array:
    """(…, 10) derivative of the ten quantities (…, 10) by the common scale of all thrust: inertia and κ about the pivot follow it."""
    found = values.copy()
    arm = values[..., 6:9] - np.array(vehicle.environment.bearing_position_m)
    if (weighed := vehicle.known.get("mass")) is not None:
        found[..., :6] -= weighed.value * elements(_spread(arm))
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
    slope[..., :6, 6:9] = shifted[..., None, None] * _spread_by_arm(arm)
    slope[..., :6, 9], slope[..., 6:, 9] = elements(_spread(arm)), arm
    slope[~weighed, :, 9] = 0.0
    about = values[..., :6] + shifted[..., None] * elements(_spread(arm))
    return np.concatenate([about, mass[..., None] * arm], -1), slope


def _spread(arm: Array) -> Array:
    """(…, 3, 3) S of arms (…, 3)."""
    found: Array = (arm**2).sum(-1)[..., None, None] * np.eye(3) - arm[..., :, None] * arm[..., None, :]
    return found


def _spread_by_arm(arm: Array) -> Array:
    """(…, 6, 3) derivative of the elements of S."""
    unit = np.eye(3)
    outer = unit[:, :, None] * arm[..., None, None, :]
    change = 2 * arm[..., :, None, None] * unit - outer - np.swapaxes(outer, -1, -2)
    return np.swapaxes(elements(change), -1, -2)
