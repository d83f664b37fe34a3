"""Filter parameters (inertia, c, 1/m at the stated thrust) to the ten reported quantities.

Inertia and mass are proportional to the thrust that the vehicle file claims. With a common relative thrust error κ ~ N(0, scale_sigma²)
the reported quantities are (1 + κ) times what the filter finds, so κ adds ``scale_sigma² θ θᵀ`` to their covariance; a quantity
known from elsewhere (a weighed mass) is then a measurement of the whole set, and calibrates the scale through that covariance. The CG
doesn't depend on κ but where a part m_b of the mass doesn't turn with a bearing: what the weight shows is (m − m_b)(c − b), of which m and
the product are (1 + κ) times what the filter finds and m_b isn't.

What is known conditions a Gaussian, linear in the slopes of I = J⁻¹. Where the log hardly tells J, I ± 2 sigma is wider than these make it;
that comes last, by what is then left of J's sigma: widened before, each axis by its own factor, gains would be wrong by their ratios.

Where there are momentum devices, the filter itself follows the scale as far as these tell it (:mod:`massprop_cli.model.momentum`); its
inertia is the one that answers to their columns; the reported one has them in it as the vehicle file says.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import COLUMNS, MOMENTS, ROWS, elements
from massprop_cli.estimate.pivot import AboutCg, about_cg, by_thrust_scale
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.vehicle import Quantity, Vehicle
from massprop_cli.model.momentum import relative_scales

T = TypeVar("T")
UNTOLD = 0.3
"""A relative sigma of 1/m above this says nothing about m; ..."""
FAINT = 0.03
"""... above this, on a bearing, a known mass tells it: there the rest was judged beside that one (estimate/regression)."""
HARDLY = 0.4
"""A relative sigma of an axis' response J up to which that of I = 1/J is taken from the interval ± 2 sigma; beyond, I is hardly told."""


def quantities(told: Parameters, vehicle: Vehicle) -> tuple[Array, Array]:
    """(K, 10) values and (K, 10, 10) covariances of ixx … mass from those of the state parameters ixx … cg_z, 1/m.

    Mass is NaN where its reciprocal is not known well enough to say anything. On a bearing the CG then is too, unless the mass is known
    from elsewhere: what the weight's moment says of it is its distance from the bearing times the mass.
    """
    found = about_cg(told.mean, told.covariance, vehicle) if vehicle.on_pedestal else _translating(told, vehicle)
    values, data = found.values, found.covariance
    if vehicle.spinning:  # these told the scale, and its uncertainty is in the covariance
        values[:, :6] -= sum(elements(device.beyond_reported) for device in vehicle.spinning)
        shared = np.zeros_like(data)
    else:
        proportional = by_scale(values, vehicle)
        shared = open_scale(vehicle) ** 2 * proportional[:, :, None] * proportional[:, None, :]
    full: Array = data + shared + found.by_mass
    before = _moments(data)
    for name, known in mass_first(vehicle.known):
        if vehicle.on_pedestal and name == "mass":
            continue
        stated = values
        values, full, data = _condition(values, full, data, QUANTITIES.index(name), known.value, known.sigma)
        if vehicle.on_air_bearing:
            values, slope = by_first_moment(name, stated, values, vehicle.bearing_mass_kg)
            full, data = transformed(full, slope), transformed(data, slope)
    # an axis is no more uncertain than what is known leaves it
    kept = _moments(data) / np.maximum(before, np.finfo(float).tiny)
    wider = _curved(told.relative * np.sqrt(np.maximum(kept, 0.0)))
    full = full + data * (wider[:, :, None] * wider[:, None, :] - 1)
    return values, (full + full.transpose(0, 2, 1)) / 2  # of a swing's wide scale little is left, and rounding of that


def mass_first(known: Mapping[Quantity, T]) -> list[tuple[Quantity, T]]:
    """What is known, in the order in which it is taken in: on a bearing a CG tells of a mass that is not weighed yet."""
    return sorted(known.items(), key=lambda one: one[0] != "mass")


def by_first_moment(name: str, before: Array, after: Array, bearing_mass_kg: float) -> tuple[Array, Array]:
    """Ten quantities (K, 10) of a body on a bearing, and their (K, 10, 10) derivative by those ``after`` a straight step from ``before``.

    The step (kg m², m, kg) is to a known quantity of this ``name``. A log tells the first moment m_r s, s = c − b, m_r = m − m_b, far
    better than s or m_r, so that the step is straight in that: ``s' = (m_r s + m_r δs + s δm) / (m_r + δm) = s + δs m_r / (m_r + δm)``.
    It is as it was to a CG that is known, and where no mass is told.
    """
    with np.errstate(invalid="ignore"):
        told = (before[:, 9] > bearing_mass_kg) & (after[:, 9] > bearing_mass_kg) & (name not in CG)
    later = after[told, 9:] - bearing_mass_kg
    part = (before[told, 9:] - bearing_mass_kg) / later
    moved = part * (after - before)[told, 6:9]
    found, slope, own = after.copy(), np.repeat(np.eye(10)[None], len(after), 0), np.repeat(np.eye(10)[None], len(later), 0)
    found[told, 6:9] = before[told, 6:9] + moved
    own[:, range(6, 9), range(6, 9)], own[:, 6:9, 9] = part, -moved / later
    slope[told] = own
    return found, slope


def transformed(covariance: Array, slope: Array) -> Array:
    """Covariances (K, 10, 10) by the derivatives (K, 10, 10) of what they are of; NaN of what is not told spreads no further."""
    found, turned = covariance.copy(), (slope != np.eye(10)).any((1, 2))
    found[turned] = slope[turned] @ covariance[turned] @ slope[turned].transpose(0, 2, 1)
    return found


def _translating(told: Parameters, vehicle: Vehicle) -> AboutCg:
    """The ten quantities where forces move the vehicle, but for the scale of the thrust and what is known beside the mass."""
    mean, covariance, _ = told
    mu = mean[:, 9].copy()
    sigma = np.sqrt(covariance[:, 9, 9])
    faint = FAINT if vehicle.on_air_bearing and "mass" in vehicle.known else UNTOLD
    with np.errstate(invalid="ignore"):
        untold = ~(mu > 0) | (sigma > faint * mu)
    if "mass" in vehicle.known:  # inertia and CG are linear in its reciprocal: rows that tell nothing of it take it here
        known = vehicle.known["mass"]
        weighed = 1 / known.value, np.hypot(known.sigma / known.value, vehicle.thrust.scale_sigma) / known.value
        mean, covariance = mean.copy(), covariance.copy()
        mean[untold], covariance[untold], _ = _condition(mean[untold], covariance[untold], covariance[untold], 9, *weighed)
    mu[untold] = np.nan
    values: Array = mean.copy()
    values[:, 9] = 1 / mu
    jacobian = np.ones((len(mean), 10))
    jacobian[:, 9] = -1 / mu**2
    if vehicle.on_air_bearing and "mass" not in vehicle.known:
        values[untold, 6:9] = jacobian[untold, 6:9] = np.nan
    data: Array = covariance * jacobian[:, :, None] * jacobian[:, None, :]
    return AboutCg(values, data, np.zeros_like(data))


def _moments(covariance: Array) -> Array:
    """(K, 3) variance of the moments of inertia."""
    return np.diagonal(covariance, 0, 1, 2)[:, MOMENTS]


def _curved(relative: Array) -> Array:
    """(K, 10) by how much wider the sigmas of I = J⁻¹ are than its slope makes them: half the interval that J ± 2 sigma leads to.

    ``relative`` (K, 3): sigmas of J_xx, J_yy, J_zz over these.
    """
    near = 1 / (1 - 2 * np.minimum(relative, HARDLY))
    factor = np.sqrt(np.maximum(near, near * (relative / HARDLY) ** 2))
    found = np.ones((len(relative), 10))
    found[:, :6] = factor[:, ROWS] * factor[:, COLUMNS]
    return found


def by_scale(values: Array, vehicle: Vehicle) -> Array:
    """(…, 10) derivative by κ of the ten quantities (…, 10): kg m², m, kg."""
    if vehicle.on_pedestal:
        return by_thrust_scale(values, vehicle)
    return by_scale_beside(values, vehicle.bearing_mass_kg, np.array(vehicle.environment.bearing_position_m))


def by_scale_beside(values: Array, bearing_mass_kg: float, bearing_position_m: Array) -> Array:
    """The same beside a bearing of this mass (0 where there is none), at this point (3,).

    Inertia and mass are proportional to the thrust; of the CG it is ``−(c − b) m_b / (m − m_b)`` where the mass is told, else nothing.
    """
    found = values.copy()
    found[..., 6:9] = 0.0
    if bearing_mass_kg > 0:
        turning = values[..., 9:] - bearing_mass_kg
        away = values[..., 6:9] - bearing_position_m
        found[..., 6:9] = np.where(turning > 0, -away * bearing_mass_kg / turning, 0.0)
    return found


def open_scale(vehicle: Vehicle) -> float:
    """Relative sigma of the thrust's scale that no log tells; none beside wheels, where the filter has it in its covariance."""
    return 0.0 if vehicle.spinning else vehicle.thrust.scale_sigma


def in_common(slope: Array, covariance: Array, known: Mapping[str, float], vehicle: Vehicle, onto: Array | None = None) -> Array:
    """(10,) sigma of the errors that all estimates of a vehicle have alike: of its scales, and of what is known. NaN where nothing is.

    ``slope`` (10,) is the derivative of the log's own values by the scale of the thrust κ, ``covariance`` (10, 10) the reported one. κ
    leaves (slope − K H slope) κ (:func:`left_by_known`), an error ε of what is known K ε. Beside wheels a log tells the scales of thrust
    and wheels: of one that makes s of a value by itself, of which V is left, its estimate holds V/s, and never more than s. ``onto``
    (n, 10): the same of n other quantities, by their derivative by the ten.
    """
    index, gain = _gain(covariance, known)
    moved = slope - gain @ slope[index]
    if onto is not None:
        gain, moved, covariance = onto @ gain, onto @ moved, onto @ covariance @ onto.T
    given, moved = ((gain * np.array(list(known.values()))) ** 2).sum(1), np.abs(moved)
    if not vehicle.spinning:
        return np.asarray(np.hypot(open_scale(vehicle) * moved, np.sqrt(given)))
    own = np.maximum(np.diag(covariance) - given, 0.0)
    alone = moved[:, None] * relative_scales(vehicle)
    held = np.minimum(alone, own[:, None] / np.where(alone > 0, alone, np.inf))
    return np.asarray(np.sqrt(given + np.minimum((held**2).sum(1), own)))


def left_by_known(slope: Array, covariance: Array, known: Mapping[str, float]) -> Array:
    """(10,) what is left in the reported values of ``slope`` (10,), what something does to those of the log alone.

    Where z = H θ + ε, ε ~ N(0, R), is ``known`` (by quantity, its sigma) the gain of its conditioning is K = P⁺ Hᵀ R⁻¹ with the reported
    covariance P⁺ (10, 10): Bar-Shalom, Li and Kirubarajan, Estimation with Applications, eq. 5.2.3-15. What is left is slope − K H slope.
    """
    index, gain = _gain(covariance, known)
    return slope - gain @ slope[index]


def _gain(covariance: Array, known: Mapping[str, float]) -> tuple[list[int], Array]:
    """Which quantities are known, and (10, n) what an error of each does to all."""
    index = [QUANTITIES.index(name) for name in known]
    return index, covariance[:, index] / np.array(list(known.values())) ** 2


def alone(vehicle: Vehicle) -> Vehicle:
    """The vehicle with nothing known from elsewhere and its thrust taken as exact: what the log says by itself.

    On a pedestal a log says nothing of the mass, by which it says all else.
    """
    known = {name: one for name, one in vehicle.known.items() if vehicle.on_pedestal and name == "mass"}
    return vehicle.model_copy(update={"known": known, "thrust": vehicle.thrust.model_copy(update={"scale_sigma": 0.0})})


def condition(value: Array, covariance: Array, slope: Array, measured: float, expected: float, sigma: float) -> tuple[Array, Array]:
    """A Gaussian (n,), (n, n) conditioned on a scalar: ``measured`` ± ``sigma``, and ``expected`` with derivative ``slope`` (n,)."""
    across = covariance @ slope
    gain = across / (slope @ across + sigma**2)
    return value + gain * (measured - expected), covariance - np.outer(gain, across)


def _condition(values: Array, covariance: Array, data: Array, index: int, value: float, sigma: float) -> tuple[Array, Array, Array]:
    """Condition every row on one quantity measured as ``value`` ± ``sigma``; rows that can't say anything of it take it as it is.

    ``data`` (K, 10, 10) is the part of the covariance that the log's noise makes.
    """
    values, covariance, data = values.copy(), covariance.copy(), data.copy()
    untold = np.isnan(values[:, index])
    column = np.where(untold[:, None], 0.0, covariance[:, :, index])
    gain = np.where(untold[:, None], 0.0, column / (covariance[:, index, index] + sigma**2)[:, None])
    values = values + gain * np.where(untold, 0.0, value - values[:, index])[:, None]
    covariance = covariance - gain[:, :, None] * column[:, None, :]
    data = data - gain[:, :, None] * np.where(untold[:, None], 0.0, data[:, index])[:, None, :]
    data = data - np.where(untold[:, None], 0.0, data[:, :, index])[:, :, None] * gain[:, None, :]
    values[untold, index] = value
    for part in (covariance, data):
        part[untold, index, :] = 0.0
        part[untold, :, index] = 0.0
    covariance[untold, index, index] = sigma**2
    return values, covariance, data
