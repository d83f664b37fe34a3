"""Initial reference from the first cycles, without initial values.

The growth of the mean rate is regressed on impulses and rate products,

    w[k+1] − w[k]  =  J τ̄ + K F̄ + G (w w) + b,          J = I⁻¹,  K = −J [c]×  (on a bearing K acts on m_r f: K = J [c − b]×… )

Only the left side has noise, so the fit is unbiased and needs no initial values. A weak prior on the vehicle's own scale gives axes without
excitation a plausible value. The result serves as reference of the linearisation and is never reported.
"""

from __future__ import annotations

import numpy as np

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import LONG
from massprop_cli.base.rigidbody import cross, spread, tensor
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import gamma, products
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.prepare.compensate import Samples, Source, acceleration

SIGNIFICANT = 6.0
"""Ratio of an axis' response to its sigma, above which it counts; as in the kernel."""
COUPLE = 1e-3
"""Force over that of the couples (torque over the jets' reach), below which it does not inform the mass. It may be rounding of many jets'
forces, and the CG's acceleration by the rotation exceeds it."""
DISTANCES = np.geomspace(0.01, 10, 4)
"""Initial distances from pivot to CG of the search for a free oscillation, in radii of gyration."""
FARTHEST = 30.0
"""Largest distance from pivot to CG that the search may give, in radii of gyration."""


def first_reference(samples: Source, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """A reference from ``cycles``; None unless rates respond to torques, or accelerations to forces."""
    here = samples.part(cycles)
    rate, duration = here.rate_rad_s, here.executed.duration_s
    growth = np.diff(rate, axis=0)
    impulse = here.executed.rising[:-1] + here.executed.falling[1:]
    plant = plant_of(vehicle)
    torque: Array = plant.command_input(impulse)[:, :3]
    if here.executed.stored is not None:
        torque = torque + _mean_step(here.executed.stored.precession(rate), duration)
    load: Array = impulse[:, 3:]
    rotated = _mean_step(products(rate), duration)
    if plant.pivoted:
        weight = vehicle.environment.gravity_m_s2 * (here.up_b[:-1] + here.up_b[1:]) / 2  # specific force at rest
        load = _mean_step(weight if here.unread[3:].any() else weight + acceleration(here, vehicle), duration)
    scale = _response(growth, torque, np.hstack([load, rotated, duration[1:, None]]))
    mu = _mu(here, torque, vehicle) if plant.translates else None
    if scale is None:
        if vehicle.swings:
            return oscillating_reference(growth, load, rotated, vehicle)
        return None if mu is None else _without_torques(mu, vehicle)
    mu = mu or _fallback_mu(vehicle, scale)
    reach = np.sqrt(3 * mu / scale)
    if plant.pivoted:
        load = plant.rotating_mass(Reference(np.eye(3), plant.pivot, mu)) * load
        reach = 0.01 * reach
    regressors = np.hstack([torque, load, rotated, duration[1:, None]])
    prior = np.concatenate([[scale] * 3, [scale * reach] * 3, [1.0] * 6, [np.abs(growth).max() / duration.mean()]])
    fit = _ridge(regressors, growth, prior, scale)
    values, axes = np.linalg.eigh((fit[:3] + fit[:3].T) / 2)
    inertia = (axes / np.clip(values, scale / FARTHEST, scale * FARTHEST)) @ axes.T
    couple = inertia @ fit[3:6].T
    cg = -0.5 * np.array([couple[2, 1] - couple[1, 2], couple[0, 2] - couple[2, 0], couple[1, 0] - couple[0, 1]])
    return Reference(inertia, cg + plant.pivot, mu)


def early_reference(samples: Source, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """A reference from as few of ``cycles`` as it needs: the first :data:`LONG`, four times as many, and so on."""
    length = LONG
    while length < cycles.stop - cycles.start:
        reference = first_reference(samples, slice(cycles.start, cycles.start + length), vehicle)
        if reference is not None:
            return reference
        length *= 4
    return first_reference(samples, cycles, vehicle)


def _response(motion: Array, cause: Array, others: Array | None = None) -> float | None:
    """Slope of a motion on its cause (rate growth on torque impulse, acceleration on force); None where it is not significant.

    Regressors ``others`` (gyroscopic terms, loads) are projected out first. Each axis is tested alone, and the significant ones are pooled,
    so that the unequal slopes of an elongated body do not count as noise.
    """
    freedom = len(motion) - 1
    if others is not None:
        size = np.sqrt((others**2).sum(0))
        basis, _ = np.linalg.qr(others[:, size > 0] / size[size > 0])
        motion, cause = (v - basis @ (basis.T @ v) for v in (motion, cause))
        freedom -= basis.shape[1]
    power = (cause**2).sum(0)
    driven = power > 1e-12 * power.max()
    if freedom < 3 or not driven.any() or power.max() == 0:
        return None
    motion, cause, power = motion[:, driven], cause[:, driven], power[driven]
    slope = (motion * cause).sum(0) / power
    sigma = np.sqrt(((motion - slope * cause) ** 2).sum(0) / freedom / power)
    clear = slope > SIGNIFICANT * sigma
    return float((slope * power)[clear].sum() / power[clear].sum()) if clear.any() else None


def _mu(samples: Samples, torque: Array, vehicle: Vehicle) -> float | None:
    """1/m from the regression of acceleration on force, on a bearing in the horizontal plane; None where forces are negligible.

    ``torque`` (K − 1, 3) are the torque impulses, N m s, against which the forces are compared.
    """
    force = samples.executed.whole[:, 3:] / samples.executed.duration_s[:, None]
    measured = acceleration(samples, vehicle)
    if plant_of(vehicle).pivoted:
        up = samples.up_b[:-1]
        force, measured = (v - (v * up).sum(1, keepdims=True) * up for v in (force, measured))
    couple = (torque**2).sum() / (samples.executed.duration_s.mean() * reach(vehicle)) ** 2
    return _response(measured, force) if (force**2).sum() > COUPLE**2 * couple else None


def fallback(vehicle: Vehicle) -> Reference:
    """The reference without any information from the log: radius of gyration from the jets' reach, and the known mass or one kilogram."""
    return _without_torques(_fallback_mu(vehicle, 3 / reach(vehicle) ** 2), vehicle)


def _without_torques(mu: float, vehicle: Vehicle) -> Reference:
    """A body that has shown no response to torques yet: its radius of gyration is the jets' reach."""
    return Reference(reach(vehicle) ** 2 / (3 * mu) * np.eye(3), plant_of(vehicle).pivot, mu)


def oscillating_reference(growth: Array, load: Array, rotated: Array, vehicle: Vehicle) -> Reference:
    """Reference of a body with known mass and inertia about the CG that oscillates freely under its weight.

        w[k+1] − w[k]  =  J⁻¹ (l × m r − Γ(J) (w w)),          J = I + m (r² 1 − r rᵀ)

    r, from pivot to CG, is found by least squares from several distances below and above the pivot. ``growth``, the load's integral
    ``load`` l and the rate products' integral ``rotated`` are (K − 1, ...).
    """
    from scipy.optimize import least_squares

    known: dict[str, float] = {name: one.value for name, one in vehicle.known.items()}
    mass, central = vehicle.pedestal_mass_kg, tensor(np.array([known.get(name, 0.0) for name in INERTIA]))

    def inertia(arm: Array) -> Array:
        return np.asarray(central + mass * spread(arm))

    def residuals(arm: Array) -> Array:
        about = inertia(arm)
        torque = cross(load, mass * arm) - rotated @ gamma(about).T
        return np.asarray((growth - np.linalg.solve(about, torque.T).T).ravel())

    up, size = load.mean(0) / np.linalg.norm(load.mean(0)), np.sqrt(np.trace(central) / mass)
    # a pendulum has the same frequency about two points of a line
    fits = [least_squares(residuals, by * size * up, x_scale=abs(by) * size, method="lm") for by in (*-DISTANCES, *DISTANCES)]
    # a body that hardly moves gives no bounded distance
    bounded = [fit for fit in fits if np.linalg.norm(fit.x) < FARTHEST * size]
    arm = min(bounded, key=lambda fit: float(fit.cost)).x if bounded else np.zeros(3)
    return Reference(inertia(arm), plant_of(vehicle).pivot + arm, 1 / mass)


def reach(vehicle: Vehicle) -> float:
    """Distance of the farthest jet from O, m; 0.1 m without jets."""
    return max((float(np.linalg.norm(jet.position_m)) for jet in vehicle.jets), default=0.0) or 0.1


def _fallback_mu(vehicle: Vehicle, scale: float) -> float:
    """1/m without a response to forces: from the known mass, else with the jets' reach as radius of gyration."""
    known = vehicle.known.get("mass")
    if vehicle.on_pedestal:
        return 1 / vehicle.pedestal_mass_kg
    return 1 / known.value if known else reach(vehicle) ** 2 * scale / 3


def _mean_step(values: Array, duration: Array) -> Array:
    """(K − 1, ...) trapezoidal integral of cycle means over each step."""
    area = values * duration[:, None]
    return (area[:-1] + area[1:]) / 2


def _ridge(regressors: Array, growth: Array, prior_sigma: Array, scale: float) -> Array:
    """Ridge regression with prior mean zero, and ``scale`` times identity for J; two passes, of which the first gives the noise level."""
    target = np.zeros((regressors.shape[1], 3))
    target[:3] = scale * np.eye(3)
    residual = growth - regressors @ target
    fit = target
    for _ in range(2):
        weight = np.sqrt((residual**2).mean()) / prior_sigma
        rows = np.vstack([regressors, np.diag(weight)])
        size = np.sqrt((rows**2).sum(0))
        size[size == 0] = 1.0
        basis, triangle = np.linalg.qr(rows / size)
        fit = np.linalg.solve(triangle, basis.T @ np.vstack([growth, weight[:, None] * target])) / size[:, None]
        residual = growth - regressors @ fit
    return fit
