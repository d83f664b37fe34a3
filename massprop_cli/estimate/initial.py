"""Initial reference from the first cycles, without starting values.

The growth of the mean rate is regressed on impulses and on products of rates,

    w[k+1] − w[k]  =  J τ̄ + K F̄ + G (w w) + b,          J = I⁻¹,  K = −J [c]×  (on a bearing K acts on m_r f: K = J [c − b]×… )

with noise on the left alone, so the fit is unbiased and converges from nothing. A weak prior of the vehicle's own scale keeps axes
that were never driven at a sensible value. The result only serves to linearise: it is never reported.
"""

from __future__ import annotations

import numpy as np

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross, spread, tensor
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import gamma, products
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.prepare.compensate import Samples, Source, acceleration

SIGNIFICANT = 6.0
"""An axis' response to its command must exceed its own sigma this many times before anything is said."""
COUPLE = 1e-3
"""Part of the force of a couple, torque over the jets' reach, below which a force is what a couple has left, and tells no mass: the body
turns about its CG, whose own acceleration exceeds what that force makes."""
FIRST = 4096
"""Cycles in which most vehicles have moved."""
DISTANCES = np.geomspace(0.01, 10, 4)
"""From a pivot to the CG, radii of gyration, that a swing is looked at for."""
FARTHEST = 30.0
"""... and that a CG may be away."""
_SPREAD = 30.0
"""Largest ratio of a reference's principal moments to the common scale."""


def first_reference(samples: Source, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """A reference from ``cycles``, or None while neither the rates answer to torques nor the accelerations to forces."""
    here = samples.part(cycles)
    rate, duration = here.rate_rad_s, here.executed.duration_s
    growth = np.diff(rate, axis=0)
    impulse = here.executed.rising[:-1] + here.executed.falling[1:]
    plant = plant_of(vehicle)
    torque: Array = plant.command_input(impulse)[:, :3]
    if here.executed.stored is not None:
        torque = torque + _mean_step(here.executed.stored.precession(rate), duration)
    load: Array = impulse[:, 3:]
    turned = _mean_step(products(rate), duration)
    if plant.pivoted:
        felt = vehicle.environment.gravity_m_s2 * (here.up_b[:-1] + here.up_b[1:]) / 2  # of a vehicle that stands still
        load = _mean_step(felt if here.unread[3:].any() else felt + acceleration(here, vehicle), duration)
    scale = _response(growth, torque, np.hstack([load, turned, duration[1:, None]]))
    mu = _mu(here, torque, vehicle) if plant.translates else None
    if scale is None:
        if vehicle.swings:
            return released(growth, load, turned, vehicle)
        return None if mu is None else _unturned(mu, vehicle)
    mu = mu or _fallback_mu(vehicle, scale)
    reach = np.sqrt(3 * mu / scale)
    if plant.pivoted:
        load = plant.rotating_mass(Reference(np.eye(3), plant.pivot, mu)) * load
        reach = 0.01 * reach
    regressors = np.hstack([torque, load, turned, duration[1:, None]])
    prior = np.concatenate([[scale] * 3, [scale * reach] * 3, [1.0] * 6, [np.abs(growth).max() / duration.mean()]])
    fit = _ridge(regressors, growth, prior, scale)
    values, axes = np.linalg.eigh((fit[:3] + fit[:3].T) / 2)
    inertia = (axes / np.clip(values, scale / _SPREAD, scale * _SPREAD)) @ axes.T
    couple = inertia @ fit[3:6].T
    cg = -0.5 * np.array([couple[2, 1] - couple[1, 2], couple[0, 2] - couple[2, 0], couple[1, 0] - couple[0, 1]])
    return Reference(inertia, cg + plant.pivot, mu)


def beginning(samples: Source, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """A reference from no more of ``cycles`` than it takes: the first :data:`FIRST`, or four times as many, and so on."""
    length = FIRST
    while length < cycles.stop - cycles.start:
        found = first_reference(samples, slice(cycles.start, cycles.start + length), vehicle)
        if found is not None:
            return found
        length *= 4
    return first_reference(samples, cycles, vehicle)


def _response(motion: Array, cause: Array, others: Array | None = None) -> float | None:
    """Slope of a motion on its cause (rate growth on torque impulse, acceleration on force) where it is significant.

    What ``others`` (gyroscopic terms, loads) explain of both is taken out first. Each axis is judged alone, and the significant ones are
    pooled, so that an elongated body's unequal slopes don't count as noise.
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
    """1/m by regressing acceleration on force (noise on the left), in the horizontal plane on a bearing.

    ``torque`` (K − 1, 3), N m s: beside couples a force must be one, and not what rounding leaves of many jets'.
    """
    force = samples.executed.whole[:, 3:] / samples.executed.duration_s[:, None]
    felt = acceleration(samples, vehicle)
    if plant_of(vehicle).pivoted:
        up = samples.up_b[:-1]
        force, felt = (v - (v * up).sum(1, keepdims=True) * up for v in (force, felt))
    couple = (torque**2).sum() / (samples.executed.duration_s.mean() * reach(vehicle)) ** 2
    return _response(felt, force) if (force**2).sum() > COUPLE**2 * couple else None


def fallback(vehicle: Vehicle) -> Reference:
    """What stands in while the log has said nothing: of the size that the jets' reach gives, and of the known mass or one kilogram."""
    return _unturned(_fallback_mu(vehicle, 3 / reach(vehicle) ** 2), vehicle)


def _unturned(mu: float, vehicle: Vehicle) -> Reference:
    """A body that has felt forces but no torques yet: its radius of gyration is its jets' reach."""
    return Reference(reach(vehicle) ** 2 / (3 * mu) * np.eye(3), plant_of(vehicle).pivot, mu)


def released(growth: Array, load: Array, turned: Array, vehicle: Vehicle) -> Reference:
    """A body of known mass and inertia about its CG that its weight alone swings: what its CG r from the pivot explains most of.

        w[k+1] − w[k]  =  J⁻¹ (l × m r − Γ(J) (w w)),          J = I + m (r² 1 − r rᵀ)

    Sought from several distances below or above the pivot, as it stands in the mean. ``growth``, ``load`` l, the integral of what carries
    the weight, and ``turned`` (K − 1, ...).
    """
    from scipy.optimize import least_squares

    known: dict[str, float] = {name: one.value for name, one in vehicle.known.items()}
    mass, own = vehicle.pedestal_mass_kg, tensor(np.array([known.get(name, 0.0) for name in INERTIA]))

    def inertia(arm: Array) -> Array:
        return np.asarray(own + mass * spread(arm))

    def left(arm: Array) -> Array:
        about = inertia(arm)
        torque = cross(load, mass * arm) - turned @ gamma(about).T
        return np.asarray((growth - np.linalg.solve(about, torque.T).T).ravel())

    up, size = load.mean(0) / np.linalg.norm(load.mean(0)), np.sqrt(np.trace(own) / mass)
    # a body swings alike about two points of a line
    fits = [least_squares(left, by * size * up, x_scale=abs(by) * size, method="lm") for by in (*-DISTANCES, *DISTANCES)]
    # what hardly moves tells of none
    told = [fit for fit in fits if np.linalg.norm(fit.x) < FARTHEST * size]
    arm = min(told, key=lambda fit: float(fit.cost)).x if told else np.zeros(3)
    return Reference(inertia(arm), plant_of(vehicle).pivot + arm, 1 / mass)


def reach(vehicle: Vehicle) -> float:
    """Distance of the farthest jet from O, m; a decimetre where there is none."""
    return max((float(np.linalg.norm(jet.position_m)) for jet in vehicle.jets), default=0.0) or 0.1


def _fallback_mu(vehicle: Vehicle, scale: float) -> float:
    """1/m where no force has been felt: the known mass, else a body whose radius of gyration is its jets' reach."""
    known = vehicle.known.get("mass")
    if vehicle.on_pedestal:
        return 1 / vehicle.pedestal_mass_kg
    return 1 / known.value if known else reach(vehicle) ** 2 * scale / 3


def _mean_step(values: Array, duration: Array) -> Array:
    """Trapezoid of cycle means over each step, (K − 1, ...)."""
    area = values * duration[:, None]
    return (area[:-1] + area[1:]) / 2


def _ridge(regressors: Array, growth: Array, prior_sigma: Array, scale: float) -> Array:
    """Least squares with a zero-mean prior, but ``scale`` × identity for J; two passes to find the noise."""
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
