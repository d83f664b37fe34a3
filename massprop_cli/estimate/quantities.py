"""Ten reported quantities from the state parameters: inertia, CG, mass, with known values and the thrust scale.

Inertia and mass are proportional to the stated thrust. With a common relative thrust error κ ~ N(0, scale_sigma²), the reported quantities
are (1 + κ) times the filter's, so κ adds ``scale_sigma² θ θᵀ`` to their covariance. A known quantity (such as a weighed mass) is a
measurement of the whole set, and calibrates the scale through that covariance. The CG depends on κ only where a part m_b of the mass does
not rotate with a bearing: the weight gives (m − m_b)(c − b), where m and the product are proportional to 1 + κ and m_b is not.

Known values condition a Gaussian that is linear in J = I⁻¹. Where the log informs J poorly, the interval of I for J ± 2 sigma is wider than
the linear one. That factor is applied last, from the remaining sigma of J: different factors by axis would make the gains of the
conditioning wrong.

With momentum devices, the filter estimates the scale itself (:mod:`massprop_cli.model.momentum`). Its inertia is the one in the equations
of motion; the reported inertia includes the devices as the vehicle file defines it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import UNINFORMED
from massprop_cli.base.rigidbody import COLUMNS, MOMENTS, ROWS, elements
from massprop_cli.estimate.pivot import AboutCg, about_cg, by_thrust_scale
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.vehicle import Quantity, Vehicle
from massprop_cli.model.momentum import relative_scales

T = TypeVar("T")
MASS_WEAK = 0.03
"""Relative sigma of 1/m above which a known mass replaces it on a bearing: the regression linearised all else about the known mass."""
HARDLY = 0.4
"""Relative sigma of an axis' J up to which the sigma of I = 1/J comes from the interval J ± 2 sigma; above, I is poorly informed."""


def quantities(parameters: Parameters, vehicle: Vehicle) -> tuple[Array, Array]:
    """(K, 10) values and (K, 10, 10) covariances of ixx … mass, from the state parameters ixx … cg_z, 1/m.

    The mass is NaN where 1/m is poorly known. So is then the CG on a bearing, unless the mass is known: the weight gives only the product
    of mass and distance from the bearing.
    """
    reported = about_cg(parameters.mean, parameters.covariance, vehicle) if vehicle.on_pedestal else _translating(parameters, vehicle)
    values, data = reported.values, reported.covariance
    if vehicle.spinning:  # the filter estimated the scale, whose uncertainty is in the covariance
        values[:, :6] -= sum(elements(device.beyond_reported) for device in vehicle.spinning)
        shared = np.zeros_like(data)
    else:
        proportional = by_scale(values, vehicle)
        shared = open_scale(vehicle) ** 2 * proportional[:, :, None] * proportional[:, None, :]
    full: Array = data + shared + reported.by_mass
    before = _moments(data)
    for name, known in mass_first(vehicle.known):
        if vehicle.on_pedestal and name == "mass":
            continue
        stated = values
        values, full, data = _condition(values, full, data, QUANTITIES.index(name), known.value, known.sigma)
        if vehicle.on_air_bearing:
            values, slope = by_first_moment(name, stated, values, vehicle.bearing_mass_kg)
            full, data = transformed(full, slope), transformed(data, slope)
    # a known value reduces the sigma of J, and with it the curvature
    kept = _moments(data) / np.maximum(before, np.finfo(float).tiny)
    wider = _curved(parameters.relative * np.sqrt(np.maximum(kept, 0.0)))
    full = full + data * (wider[:, :, None] * wider[:, None, :] - 1)
    return values, (full + full.transpose(0, 2, 1)) / 2  # rounding may make it asymmetric where a known value removes a large variance


def mass_first(known: Mapping[Quantity, T]) -> list[tuple[Quantity, T]]:
    """Known quantities in the order of conditioning: the mass first, because on a bearing a CG informs the mass."""
    return sorted(known.items(), key=lambda one: one[0] != "mass")


def by_first_moment(name: str, before: Array, after: Array, bearing_mass_kg: float) -> tuple[Array, Array]:
    """Ten quantities (K, 10) of a body on a bearing after conditioning, and their (K, 10, 10) derivative with respect to ``after``.

    ``after`` (kg m², m, kg) is linearly conditioned from ``before`` on the known quantity ``name``. A log informs the first moment m_r s,
    s = c − b, m_r = m − m_b, much better than s or m_r. So the step must be linear in m_r s:
    ``s' = (m_r s + m_r δs + s δm) / (m_r + δm) = s + δs m_r / (m_r + δm)``. A known CG, and rows without a mass, keep the linear step.
    """
    with np.errstate(invalid="ignore"):
        informed = (before[:, 9] > bearing_mass_kg) & (after[:, 9] > bearing_mass_kg) & (name not in CG)
    rotating = after[informed, 9:] - bearing_mass_kg
    part = (before[informed, 9:] - bearing_mass_kg) / rotating
    moved = part * (after - before)[informed, 6:9]
    corrected, slope = after.copy(), np.repeat(np.eye(10)[None], len(after), 0)
    block = np.repeat(np.eye(10)[None], len(rotating), 0)
    corrected[informed, 6:9] = before[informed, 6:9] + moved
    block[:, range(6, 9), range(6, 9)], block[:, 6:9, 9] = part, -moved / rotating
    slope[informed] = block
    return corrected, slope


def transformed(covariance: Array, slope: Array) -> Array:
    """Covariances (K, 10, 10) transformed by derivatives (K, 10, 10); rows with a unit derivative keep their NaN."""
    result, changed = covariance.copy(), (slope != np.eye(10)).any((1, 2))
    result[changed] = slope[changed] @ covariance[changed] @ slope[changed].transpose(0, 2, 1)
    return result


def _translating(parameters: Parameters, vehicle: Vehicle) -> AboutCg:
    """The ten quantities of a vehicle that forces accelerate, before thrust scale and known values other than the mass."""
    mean, covariance, _ = parameters
    mu = mean[:, 9].copy()
    sigma = np.sqrt(covariance[:, 9, 9])
    limit = MASS_WEAK if vehicle.on_air_bearing and "mass" in vehicle.known else UNINFORMED
    with np.errstate(invalid="ignore"):
        uninformed = ~(mu > 0) | (sigma > limit * mu)
    if "mass" in vehicle.known:  # inertia and CG are linear in 1/m: rows that do not inform it are conditioned on it here
        known = vehicle.known["mass"]
        known_mu = 1 / known.value, np.hypot(known.sigma / known.value, vehicle.thrust.scale_sigma) / known.value
        mean, covariance = mean.copy(), covariance.copy()
        conditioned = _condition(mean[uninformed], covariance[uninformed], covariance[uninformed], 9, *known_mu)
        mean[uninformed], covariance[uninformed], _ = conditioned
    mu[uninformed] = np.nan
    values: Array = mean.copy()
    values[:, 9] = 1 / mu
    jacobian = np.ones((len(mean), 10))
    jacobian[:, 9] = -1 / mu**2
    if vehicle.on_air_bearing and "mass" not in vehicle.known:
        values[uninformed, 6:9] = jacobian[uninformed, 6:9] = np.nan
    data: Array = covariance * jacobian[:, :, None] * jacobian[:, None, :]
    return AboutCg(values, data, np.zeros_like(data))


def _moments(covariance: Array) -> Array:
    """(K, 3) variances of the moments of inertia."""
    return np.diagonal(covariance, 0, 1, 2)[:, MOMENTS]


def _curved(relative: Array) -> Array:
    """(K, 10) factor on the sigmas of I = J⁻¹: half the interval of I for J ± 2 sigma, over the linear sigma.

    ``relative`` (K, 3) are the relative sigmas of J_xx, J_yy, J_zz.
    """
    near = 1 / (1 - 2 * np.minimum(relative, HARDLY))
    factor = np.sqrt(np.maximum(near, near * (relative / HARDLY) ** 2))
    wider = np.ones((len(relative), 10))
    wider[:, :6] = factor[:, ROWS] * factor[:, COLUMNS]
    return wider


def by_scale(values: Array, vehicle: Vehicle) -> Array:
    """(…, 10) derivative of the ten quantities (…, 10) [kg m², m, kg] with respect to the thrust scale κ."""
    if vehicle.on_pedestal:
        return by_thrust_scale(values, vehicle)
    return by_scale_beside(values, vehicle.bearing_mass_kg, np.array(vehicle.environment.bearing_position_m))


def by_scale_beside(values: Array, bearing_mass_kg: float, bearing_position_m: Array) -> Array:
    """:func:`by_scale` for a bearing of this mass (0 without one) at this point (3,).

    Inertia and mass are proportional to 1 + κ. The derivative of the CG is ``−(c − b) m_b / (m − m_b)``, or zero without a mass.
    """
    slope = values.copy()
    slope[..., 6:9] = 0.0
    if bearing_mass_kg > 0:
        rotating = values[..., 9:] - bearing_mass_kg
        offset = values[..., 6:9] - bearing_position_m
        slope[..., 6:9] = np.where(rotating > 0, -offset * bearing_mass_kg / rotating, 0.0)
    return slope


def open_scale(vehicle: Vehicle) -> float:
    """Relative sigma of the thrust scale where no log informs it; 0 with momentum devices, whose filter includes it."""
    return 0.0 if vehicle.spinning else vehicle.thrust.scale_sigma


def in_common(slope: Array, covariance: Array, known: Mapping[str, float], vehicle: Vehicle, onto: Array | None = None) -> Array:
    """(10,) sigma of the errors that all logs of a vehicle share: of its scales and its known values; NaN without a value.

    ``slope`` (10,) is the derivative of the log's own values with respect to the thrust scale κ, ``covariance`` (10, 10) the reported one.
    κ contributes (slope − K H slope) κ (:func:`left_by_known`), and the error ε of a known value K ε. With momentum devices a log informs
    the scales: if a scale alone contributes s to a value of remaining variance V, its part is V/s, and at most s. ``onto`` (n, 10) is the
    derivative of n other quantities with respect to the ten; the result is then theirs.
    """
    index, gain = _gain(covariance, known)
    remaining = slope - gain @ slope[index]
    if onto is not None:
        gain, remaining, covariance = onto @ gain, onto @ remaining, onto @ covariance @ onto.T
    by_known, remaining = ((gain * np.array(list(known.values()))) ** 2).sum(1), np.abs(remaining)
    if not vehicle.spinning:
        return np.asarray(np.hypot(open_scale(vehicle) * remaining, np.sqrt(by_known)))
    variance = np.maximum(np.diag(covariance) - by_known, 0.0)
    prior = remaining[:, None] * relative_scales(vehicle)
    posterior = np.minimum(prior, variance[:, None] / np.where(prior > 0, prior, np.inf))
    return np.asarray(np.sqrt(by_known + np.minimum((posterior**2).sum(1), variance)))


def left_by_known(slope: Array, covariance: Array, known: Mapping[str, float]) -> Array:
    """(10,) effect on the reported values of an effect ``slope`` (10,) on those of the log alone.

    For ``known`` values z = H θ + ε, ε ~ N(0, R) (sigma by quantity), the gain is K = P⁺ Hᵀ R⁻¹ with the reported covariance P⁺ (10, 10):
    Bar-Shalom, Li and Kirubarajan, Estimation with Applications, eq. 5.2.3-15. The effect is slope − K H slope.
    """
    index, gain = _gain(covariance, known)
    return slope - gain @ slope[index]


def _gain(covariance: Array, known: Mapping[str, float]) -> tuple[list[int], Array]:
    """Indices of the known quantities, and (10, n) gain of each."""
    index = [QUANTITIES.index(name) for name in known]
    return index, covariance[:, index] / np.array(list(known.values())) ** 2


def alone(vehicle: Vehicle) -> Vehicle:
    """The vehicle without known values and with an exact thrust: settings of an estimate from the log alone.

    On a pedestal the mass stays known: the log does not inform it, and CG and inertia need it.
    """
    known = {name: one for name, one in vehicle.known.items() if vehicle.on_pedestal and name == "mass"}
    return vehicle.model_copy(update={"known": known, "thrust": vehicle.thrust.model_copy(update={"scale_sigma": 0.0})})


def condition(value: Array, covariance: Array, slope: Array, measured: float, expected: float, sigma: float) -> tuple[Array, Array]:
    """A Gaussian (n,), (n, n) conditioned on a scalar ``measured`` ± ``sigma``, predicted as ``expected``; derivative ``slope``."""
    cross_covariance = covariance @ slope
    gain = cross_covariance / (slope @ cross_covariance + sigma**2)
    return value + gain * (measured - expected), covariance - np.outer(gain, cross_covariance)


def _condition(values: Array, covariance: Array, data: Array, index: int, value: float, sigma: float) -> tuple[Array, Array, Array]:
    """Condition every row on one quantity known as ``value`` ± ``sigma``; rows without an estimate of it take the known value.

    ``data`` (K, 10, 10) is the part of the covariance by the log's noise.
    """
    values, covariance, data = values.copy(), covariance.copy(), data.copy()
    missing = np.isnan(values[:, index])
    column = np.where(missing[:, None], 0.0, covariance[:, :, index])
    gain = np.where(missing[:, None], 0.0, column / (covariance[:, index, index] + sigma**2)[:, None])
    values = values + gain * np.where(missing, 0.0, value - values[:, index])[:, None]
    covariance = covariance - gain[:, :, None] * column[:, None, :]
    data = data - gain[:, :, None] * np.where(missing[:, None], 0.0, data[:, index])[:, None, :]
    data = data - np.where(missing[:, None], 0.0, data[:, :, index])[:, :, None] * gain[:, None, :]
    values[missing, index] = value
    for part in (covariance, data):
        part[missing, index, :] = 0.0
        part[missing, :, index] = 0.0
    covariance[missing, index, index] = sigma**2
    return values, covariance, data
