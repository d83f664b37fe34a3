"""Sensitivity of the estimates to the assumed values, and the misfit by which a log shows an error of each.

The estimator carries the derivative with respect to each assumption (:mod:`massprop_cli.model.sensitivity`). One step of an assumption (a
percent, a millimetre, a degree) changes the estimates, and changes the residuals by as much as the estimates do not absorb.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CERTAIN, GROSS, KNOWN
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.conclude.assumed import AssumedValue, assumed_values
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import TABLE
from massprop_cli.estimate.history import History
from massprop_cli.estimate.offline import assumption_response
from massprop_cli.estimate.quantities import by_scale, left_by_known
from massprop_cli.estimate.rows import AssumptionResponse
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import MU
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import RESTATED, Consider
from massprop_cli.prepare.absentaxes import force_axes
from massprop_cli.prepare.actuators import channel_names
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

SHOWN = 0.01
"""Least reported change, as a part of a sigma."""


@dataclass(frozen=True)
class PhaseEffect:
    """Effect of one step of an assumption on one phase."""

    phase: str
    change: dict[str, float]
    """Change of each quantity, in its unit."""
    seen_sigma: float | None
    """Misfit that the step would cause, sigmas; None where it causes none."""


@dataclass(frozen=True)
class AssumptionEffects:
    """Effects of one step of an assumption on all phases."""

    code: str
    message: str
    step: str
    """Step in words."""
    stated: bool
    """Whether the vehicle file states the value; else it is a default."""
    effects: tuple[PhaseEffect, ...]


class DelayEstimate(NamedTuple):
    """Maximum likelihood estimate of the error of the stated delay, from its score test."""

    cycles: float
    """Additional delay of the commands, cycles."""
    sigma: float
    """Its sigma by the noise levels in use, cycles."""
    before: float
    """Chi-square of the residuals with the stated delay, over all channels and cycles."""
    after: float
    """Chi-square with the estimated delay."""


@dataclass(frozen=True)
class SensitivityAnalysis:
    """Assumptions of a log, and the response of each phase's fit to them."""

    assumed: tuple[AssumedValue, ...]
    responses: tuple[AssumptionResponse | None, ...]
    """By phase; None without a reference. Columns: one unit of each variant, the scale of each accelerometer axis, each channel's
    thrust."""
    count: int
    """Number of innovations of all phases."""
    chi_squares: tuple[Array, ...]
    """(6,) by phase: sum of squared whitened innovations along each axis of the gyro and of the accelerometer."""

    @property
    def scatter(self) -> float:
        """Mean squared whitened innovation of all phases."""
        return float(np.sum([part.sum() for part in self.chi_squares]) / max(self.count, 1))

    @property
    def varied(self) -> list[AssumedValue]:
        """Assumptions with a variant, in the order of the columns."""
        return [one for one in self.assumed if one.variant is not None]

    def step(self, assumption: AssumedValue, columns: int) -> Array:
        """(e,) units of each of e ``columns`` in one step of an assumption."""
        units, first = np.zeros(columns), len(self.varied)
        own = [i for i, one in enumerate(self.varied) if one is assumption]
        parts = [i for i, one in enumerate(self.varied) if one.part_of == assumption.code]
        units[own or parts or [first, first + 1, first + 2]] = assumption.size
        return units

    def delay(self) -> DelayEstimate | None:
        """Estimate of the delay's error; None if the log does not inform it."""
        at = next((i for i, one in enumerate(self.varied) if one.code == "command-delay"), None)
        grams = [response.gram[np.ix_([0, at + 1], [0, at + 1])] for response in self.responses if response is not None and at is not None]
        if not grams or not sum(gram[1, 1] for gram in grams) > 0:
            return None
        (before, product), (_, information) = np.sum(grams, 0)
        after = before - product**2 / information
        return DelayEstimate(float(-product / information), float(information**-0.5), float(before), float(after))


def sensitivity_analysis(
    log: Log,
    vehicle: Resolved,
    timing: Timing,
    samples: Stream,
    settled: Sequence[History],
    consider: Consider = Consider(),  # noqa: B008
    misfit: bool = False,
) -> SensitivityAnalysis:
    """Responses of each phase to all assumptions, linear about its off-line fit; a ``misfit`` adds assumptions.

    Uncertain geometry in ``consider`` is a nuisance parameter.
    """
    assumed = tuple(assumed_values(Setup(log, vehicle, timing), samples, misfit))
    consider = consider.about(Consider(tuple(one.variant for one in assumed if one.variant is not None), scales=True))
    responses = [
        None if history.reference is None else assumption_response(samples, history.cycles, history.reference, vehicle, consider)
        for history in settled
    ]
    mounting = np.array(vehicle.imu.body_from_imu)
    rotation = force_axes(log, vehicle)
    force_mounting = mounting if rotation is None else rotation @ mounting

    def by_imu_axis(history: History) -> tuple[Array, int]:
        present = int((~history.unread).sum())
        parts = [((np.hstack([z[:, :3] @ mounting, z[:, 3:] @ force_mounting]) ** 2).sum(0), present * len(z)) for z in history.whitened()]
        return np.sum([power for power, _ in parts], 0), sum(count for _, count in parts)

    chi_squares, counts = zip(*map(by_imu_axis, settled), strict=True)
    return SensitivityAnalysis(assumed, tuple(responses), sum(counts), chi_squares)


def without_invalid(analysis: SensitivityAnalysis, settled: Sequence[History]) -> SensitivityAnalysis:
    """The analysis without invalid responses: not finite, or with an uninformed axis and a much larger chi-square than the fit.

    The fit left the inertia of an uninformed axis free, and the pass about its estimate does not. The response of an impossible body may
    diverge.
    """

    def invalid(history: History, response: AssumptionResponse) -> bool:
        if not all(np.isfinite(part).all() for part in (response.gram, response.shift)):
            return True
        values, sigmas = history.bare[0][MOMENTS], np.sqrt(np.diag(history.bare[1]))[MOMENTS]
        chi_square = sum(float((z**2).sum()) for z in history.whitened())
        return bool((sigmas > KNOWN * np.abs(values)).any()) and response.gram[0, 0] > GROSS * chi_square + CERTAIN**2

    pairs = zip(analysis.responses, settled, strict=True)
    return replace(analysis, responses=tuple(None if one is None or invalid(history, one) else one for one, history in pairs))


def assumptions(
    analysis: SensitivityAnalysis | None, log: Log, vehicle: Vehicle, settled: Sequence[History], conclusions: Sequence[Conclusion]
) -> tuple[AssumptionEffects, ...]:
    """Effects of all assumptions of a log; empty without an ``analysis``."""
    if analysis is None:
        return ()
    listed = _thrust_scale(vehicle, conclusions) if log.command.any() and not vehicle.spinning else []
    effects: list[list[PhaseEffect]] = [[] for _ in analysis.assumed]
    for history, conclusion, response in zip(settled, conclusions, analysis.responses, strict=True):
        if response is None:
            continue
        for of_one, one in zip(effects, analysis.assumed, strict=True):
            of_one.append(_effect(history, conclusion, vehicle, response, analysis.step(one, response.shift.shape[1])))
        listed += _mass_thrust(log, vehicle, history, conclusion, response, len(analysis.varied) + 3)
        listed += _stated_uncertainties(history, conclusion, response)
    pairs = zip(analysis.assumed, effects, strict=True)
    return (*listed, *(AssumptionEffects(a.code, a.message, a.step, a.stated, tuple(e)) for a, e in pairs if e and not a.part_of))


def _thrust_scale(vehicle: Vehicle, conclusions: Sequence[Conclusion]) -> list[AssumptionEffects]:
    """Effect of a scale common to all thrust. Mass and inertia are proportional to it, and it does not change the residuals."""
    effects = []
    sigma = vehicle.thrust.scale_sigma
    for conclusion in conclusions:
        known: dict[str, float] = {name: one.sigma for name, one in vehicle.in_phase(conclusion.phase).known.items()}
        if sigma > 0 and any(name not in CG for name in known):
            continue  # the known value calibrates the thrust
        changes = 0.01 * left_by_known(by_scale(conclusion.values, vehicle), conclusion.covariance, known)
        change = {
            name: float(part)
            for (name, e), part in zip(conclusion.estimates.items(), changes, strict=True)
            if abs(part) > SHOWN * (e.sigma or 0.0) and name not in known
        }
        effects.append(PhaseEffect(conclusion.phase.name, change, None))
    if not effects:
        return []
    message = (
        "mass and inertia are proportional to the thrust that the vehicle file states; the log cannot show a scale common to all thrust"
    )
    if vehicle.bearing_mass_kg > 0:
        message += ", and it also moves the CG, because the bearing's mass does not turn"
    stated = f"every sigma includes its stated uncertainty, {100 * sigma:g} %" if sigma else "the vehicle file states no uncertainty of it"
    message += f"; {stated}"
    return [AssumptionEffects("thrust-scale", message, "1 %", sigma > 0, tuple(effects))]


def _mass_thrust(
    log: Log, vehicle: Vehicle, history: History, conclusion: Conclusion, response: AssumptionResponse, first: int
) -> list[AssumptionEffects]:
    """Effect of 1 % of the thrust of the command channels that alone determine the mass; their columns begin at ``first``."""
    active = np.diag(response.misfit)[first:] > 0
    active[len(active) - len(vehicle.momentum_wrench) :] = False  # momentum devices give no force
    decisive = np.zeros(len(active), dtype=bool)
    misfit, shift = response.misfit[first:, first:][np.ix_(active, active)], response.shift[:, first:][:, active]
    decisive[active] = _mass_channels(misfit, shift, conclusion)
    if conclusion.estimates["mass"].value is None or not decisive.any() or (decisive == active).all():
        return []
    names = channel_names(log, vehicle)
    listed = ", ".join(name for name, is_one in zip(names, decisive, strict=True) if is_one)
    step = 0.01 * np.concatenate([np.zeros(first), decisive])
    several = f" of phase {history.phase.name}" if len(vehicle.phases) > 1 else ""
    message = f"the mass{several} depends only on the thrust of {listed}; the log cannot show an error common to these"
    return [AssumptionEffects("mass-thrust", message, "1 %", True, (_effect(history, conclusion, vehicle, response, step),))]


UNCERTAIN = {one.uncertain[0]: (one.uncertain[1], one.sigma_key) for one in TABLE if one.uncertain[0]} | {
    RESTATED: ("the values under uncertain are estimated with the mass properties, from one sigma each", "uncertain")
}
"""Message and key of the stated sigma of each kind of nuisance parameter that the estimator includes."""


def _stated_uncertainties(history: History, conclusion: Conclusion, response: AssumptionResponse) -> list[AssumptionEffects]:
    """Part of each sigma that comes from each kind of nuisance parameter: jets, IMU, damping."""
    listed = []
    damping = ", ".join(f"{axis}: {value:.4g} ± {sigma:.2g}" for axis, (value, sigma) in zip("XYZ", response.damping, strict=False))
    for kind, variance in response.added.items():
        part = np.sqrt(np.maximum(variance, 0.0))
        part[MU] = part[MU] / history.reference.mu**2 if history.reference is not None else np.nan
        change = {
            name: float(size)
            for name, size in zip(QUANTITIES, part, strict=True)
            if (sigma := conclusion.estimates[name].sigma) is not None and size > SHOWN * sigma
        }
        template, key = UNCERTAIN[kind]
        message = f"{template.format(damping=damping)}; every sigma includes this uncertainty, by the amounts shown"
        listed.append(AssumptionEffects(f"uncertain-{kind}", message, f"its {key}", True, (PhaseEffect(history.phase.name, change, None),)))
    return listed


def _mass_channels(misfit: Array, shift: Array, conclusion: Conclusion) -> BoolArray:
    """(C,) channels whose thrust gives the mass its scale, if others give the inertia its scale; else none.

    The thrust change that alters the mass, keeps the trace of inertia, and does not show at 1 %, is one for these channels and zero for the
    others. ``misfit`` (C, C) and ``shift`` (10, C) are per unit of relative thrust.
    """
    values = conclusion.bare[0]
    sizes, axes = np.linalg.eigh(misfit)
    unseen = axes[:, 1e-4 * sizes < CERTAIN**2]
    by_mass, by_trace = -shift[MU] * values[9], shift[MOMENTS].sum(0) / values[MOMENTS].sum()
    targets = np.stack([by_mass, by_trace]) @ unseen
    if not np.isfinite(targets).all() or np.linalg.matrix_rank(targets, tol=1e-3) < 2:
        return np.zeros(len(misfit), dtype=bool)
    change = unseen @ np.linalg.pinv(targets) @ np.array([1.0, 0.0])
    decisive: BoolArray = change > 0.5
    return decisive if np.abs(change - decisive).max() < 0.5 else np.zeros(len(misfit), dtype=bool)


def _effect(history: History, conclusion: Conclusion, vehicle: Vehicle, response: AssumptionResponse, step: Array) -> PhaseEffect:
    """Effect of ``step`` (e,) units of each column of the response."""
    shift = response.shift @ step
    reference = history.reference
    shift[MU] = -shift[MU] / reference.mu**2 if reference is not None else np.nan
    known = vehicle.in_phase(history.phase).known
    change = {}
    for name, value, size in zip(QUANTITIES, shift, history.natural_sizes, strict=True):
        estimate = conclusion.estimates[name]
        least = max(SHOWN * (estimate.sigma or 0.0), 1e-9 * size)
        if estimate.value is not None and name not in known and abs(value) > least:
            change[name] = float(value)
    return PhaseEffect(history.phase.name, change, float(np.sqrt(max(float(step @ response.misfit @ step), 0.0))))
