"""The two filters of the thesis, as written (A. M. Wright, MIT 2000), for comparison.

Nine parameters from torque balance, mass from force balance (eq. 4.5–4.7, 4.13–4.14). The gain is the thesis's P⁺ Hᵀ R⁻¹ (eq. 3.1, 3.2),
where P⁺ includes Q; it is not the Kalman gain. Angular acceleration is the difference of consecutive cycle-mean rates, paired with the
torque of the later cycle. On the bearing the reaction m̂ g along world +Z is added to the force columns. P is propagated as a square root.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, tensor, torque_regressor
from massprop_cli.estimate.history import History
from massprop_cli.estimate.kalman import Innovation, State, predict, update
from massprop_cli.inputs.estimatorsettings import ThesisSettings
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.observability import observable
from massprop_cli.model.parameters import sizes_of_quantities
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.compensate import Source, acceleration

DIVERGENT = 2.0
"""Eigenvalue of H P⁺ Hᵀ R⁻¹ above which a step of the thesis's gain overshoots by more than it corrects."""


class Filters(NamedTuple):
    """Both filters' states: nine parameters, and mass."""

    rotation: State
    mass: State


def step(state: State, measured: Array, regressor: Array, q_root: Array, r: float) -> tuple[State, Innovation, float]:
    """One update: P⁺ = P − P Hᵀ (R + H P Hᵀ)⁻¹ H P + Q, θ⁺ = θ + P⁺ Hᵀ R⁻¹ (u − H θ), R = r·1 (thesis eq. 3.1, 3.2).

    Also returns the largest eigenvalue of H P⁺ Hᵀ R⁻¹.
    """
    noise = np.sqrt(r) * np.eye(len(measured))
    conditioned, innovation = update(state, measured, regressor, noise)
    root = predict(conditioned, np.eye(len(state.mean)), np.zeros(len(state.mean)), q_root).root
    spread = regressor @ root
    gain = root @ spread.T / r
    return State(state.mean + gain @ innovation.value, root), innovation, float(np.linalg.eigvalsh(spread @ spread.T / r)[-1])


def replay(source: Source, cycles: slice, phase: Phase, vehicle: Vehicle, before: Filters | None = None) -> tuple[History, Filters]:
    """Run both filters through ``cycles``; estimates continue from ``before``, covariances start again."""
    settings = vehicle.estimator.thesis
    filters = _start(settings, before)
    q_roots = np.diag(np.sqrt(settings.q1)), np.sqrt([[settings.q2]])
    samples = source.part(slice(0, cycles.stop))
    rate, duration = samples.rate_rad_s, samples.executed.duration_s
    rate_dot = samples.rate_step_rad_s / duration[:, None]
    wrench = samples.executed.whole / duration[:, None]
    if samples.executed.stored is not None:
        wrench[:, :3] += samples.executed.stored.precession(rate)
    specific_force = acceleration(samples, vehicle)
    weight = (samples.up_b[:-1] + samples.up_b[1:]) / 2 * vehicle.environment.gravity_m_s2

    count = cycles.stop - cycles.start
    values, sigmas = np.full((count, 10), np.nan), np.full((count, 10), np.nan)
    innovation, innovation_sigma, normalised = (np.full((count, 6), np.nan) for _ in range(3))
    worst = 0.0
    for row, k in enumerate(range(cycles.start, cycles.stop)):
        if k > 0:
            force = wrench[k, 3:] + filters.mass.mean[0] * weight[k]
            regressor = torque_regressor(rate[k], rate_dot[k], force)
            rotation, torque_innovation, torque_worst = step(filters.rotation, wrench[k, :3], regressor, q_roots[0], settings.r1)
            mass, force_innovation, force_worst = step(filters.mass, wrench[k, 3:], specific_force[k][:, None], q_roots[1], settings.r2)
            filters = Filters(rotation, mass)
            worst = max(worst, torque_worst, force_worst)
            normalised[row] = np.concatenate([torque_innovation.normalised, force_innovation.normalised])
            innovation[row] = np.concatenate([torque_innovation.value, force_innovation.value])
            innovation_sigma[row] = np.concatenate([np.sqrt((i.root**2).sum(1)) for i in (torque_innovation, force_innovation)])
        values[row] = np.concatenate([filters.rotation.mean, filters.mass.mean])
        sigmas[row] = np.concatenate([np.sqrt((s.root**2).sum(1)) for s in filters])
    history = History(
        phase=phase,
        cycles=cycles,
        time_s=samples.executed.end_s[cycles],
        values=values,
        sigmas=sigmas,
        covariance=_joint(filters),
        innovation=innovation,
        innovation_sigma=innovation_sigma,
        normalised=normalised,
        natural_sizes=sizes_of_quantities(_body(values[-1])),
        information_share=np.full((10, 6), 1 / 6),
        drowned=np.zeros(6, dtype=bool),
        observable=observable(source.capability, _body(values[-1]), vehicle),
        bare=(values[-1], _joint(filters)),
        notices=_notices(phase, worst),
    )
    return history, filters


def _start(settings: ThesisSettings, before: Filters | None) -> Filters:
    initial = np.array(settings.initial)
    if before is None:
        return Filters(State(initial[:9], np.diag(np.sqrt(settings.p1))), State(initial[9:], np.sqrt([[settings.p2]])))
    p1, p2 = settings.p1_again or settings.p1, settings.p2_again or settings.p2
    return Filters(State(before.rotation.mean, np.diag(np.sqrt(p1))), State(before.mass.mean, np.sqrt([[p2]])))


def _joint(filters: Filters) -> Array:
    covariance = np.zeros((10, 10))
    covariance[:9, :9], covariance[9:, 9:] = filters.rotation.covariance, filters.mass.covariance
    return covariance


def _body(values: Array) -> Reference:
    """A body near the estimate, with inertia and mass made positive."""
    principal, axes = np.linalg.eigh(tensor(values[:6]))
    inertia = (axes * np.maximum(principal, 1e-3 * max(principal[-1], 1e-12))) @ axes.T
    return Reference(tensor(elements(inertia)), values[6:9], 1 / max(float(values[9]), 1e-9))


def _notices(phase: Phase, worst: float) -> tuple[Notice, ...]:
    if worst <= DIVERGENT:
        return ()
    return (
        Notice(
            "thesis-gain-divergent",
            f"phase {phase.name}: H P+ H' R^-1 reaches {worst:.3g}, above {DIVERGENT:g}; the gain of the thesis, with Q inside P+, then "
            "overshoots. Lower estimator.thesis.q1/q2 or raise r1/r2, or use the default method",
        ),
    )
