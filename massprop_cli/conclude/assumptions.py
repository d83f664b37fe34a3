"""Assumptions: sensitivity of each estimate to the assumed values, and whether the log tests them.

Each assumption is varied by one step (a percent, a millimetre, a degree) and carried through the filter beside the estimate
(:mod:`massprop_cli.model.sensitivity`). What of the change no mass properties absorb stays in the innovations: so many sigmas would the log
itself misfit, which says whether it would notice.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.conclude.assumed import AssumedValue, assumed
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import TABLE
from massprop_cli.estimate.history import History
from massprop_cli.estimate.offline import assumption_response
from massprop_cli.estimate.quantities import by_scale, left_by_known
from massprop_cli.estimate.regression import KNOWN
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

UNSEEN = 5.0
"""Sigmas of misfit that a log does not show."""
ANOTHER = 4.0
"""Times what the fit leaves, from which on a body leaves something else: where all axes are known it is 1.0."""
SHOWN = 0.01
"""A change below this part of a sigma is none."""


@dataclass(frozen=True)
class PhaseEffect:
    """Of one step on one phase."""

    phase: str
    change: dict[str, float]
    """Of each value that it moves, in its unit."""
    seen_sigma: float | None
    """How far the log would misfit, in sigmas; None where it can't."""


@dataclass(frozen=True)
class AssumptionEffects:
    """Something taken for granted."""

    code: str
    message: str
    step: str
    stated: bool
    """Whether the vehicle file states it; else it is a default."""
    effects: tuple[PhaseEffect, ...]


class Later(NamedTuple):
    """What the log says of the stated delay."""

    cycles: float
    """By which commands come later than they were read."""
    sigma: float
    """Of that, by the noise levels in use."""
    before: float
    """Chi-square of what is left as it was read, over all channels and cycles."""
    after: float
    """The same so much later."""


@dataclass(frozen=True)
class Examined:
    """What is taken for granted, and what each of it does to each phase."""

    taken: tuple[AssumedValue, ...]
    responses: tuple[AssumptionResponse | None, ...]
    """To one unit of each variant, then of the scale of each of the accelerometer's axes, then of each channel's thrust; None of a phase
    without a reference."""
    count: int
    """How many innovations there are in all."""
    noise: tuple[Array, ...]
    """(6,) of each phase: sum of squared innovations, normalised, along each axis of the gyro and of the accelerometer."""

    @property
    def scatter(self) -> float:
        """Mean square of what is left of all phases, normalised."""
        return float(np.sum([part.sum() for part in self.noise]) / max(self.count, 1))

    @property
    def varied(self) -> list[AssumedValue]:
        """Those that have a variant."""
        return [t for t in self.taken if t.variant is not None]

    def step(self, taken: AssumedValue, columns: int) -> Array:
        """(e,) units of each column that make one step."""
        found, first = np.zeros(columns), len(self.varied)
        own = [i for i, t in enumerate(self.varied) if t is taken]
        parts = [i for i, t in enumerate(self.varied) if t.part_of == taken.code]
        found[own or parts or [first, first + 1, first + 2]] = taken.size
        return found

    def delay(self) -> Later | None:
        """None where nothing tells."""
        at = next((i for i, t in enumerate(self.varied) if t.code == "command-delay"), None)
        grams = [response.gram[np.ix_([0, at + 1], [0, at + 1])] for response in self.responses if response is not None and at is not None]
        if not grams or not sum(gram[1, 1] for gram in grams) > 0:
            return None
        (before, cross), (_, own) = np.sum(grams, 0)
        return Later(float(-cross / own), float(own**-0.5), float(before), float(before - cross**2 / own))


def examined(
    log: Log,
    vehicle: Resolved,
    timing: Timing,
    samples: Stream,
    settled: Sequence[History],
    consider: Consider = Consider(),  # noqa: B008
    more: bool = False,
) -> Examined:
    """One pass through each phase about its off-line fit; of ``more`` assumptions where something else than noise is left.

    The geometry that is uncertain in ``consider`` is unknown beside what is varied.
    """
    taken = tuple(assumed(Setup(log, vehicle, timing), samples, more))
    consider = consider.about(Consider(tuple(t.variant for t in taken if t.variant is not None), scales=True))
    responses = [
        None if history.reference is None else assumption_response(samples, history.cycles, history.reference, vehicle, consider)
        for history in settled
    ]
    mounting = np.array(vehicle.imu.body_from_imu)
    turned = force_axes(log, vehicle)
    felt = mounting if turned is None else turned @ mounting

    def by_imu(history: History) -> tuple[Array, int]:
        read = int((~history.unread).sum())
        parts = [((np.hstack([z[:, :3] @ mounting, z[:, 3:] @ felt]) ** 2).sum(0), read * len(z)) for z in history.whitened()]
        return np.sum([power for power, _ in parts], 0), sum(count for _, count in parts)

    noise, counts = zip(*map(by_imu, settled), strict=True)
    return Examined(taken, tuple(responses), sum(counts), noise)


def sound(found: Examined, settled: Sequence[History]) -> Examined:
    """Without phases in which an axis was never driven, and the body leaves something else than its fit did; or nothing finite.

    What such an axis' inertia makes of a spin stayed free in the fit. The response of what no body is, heavier bearing than whole, may grow
    without end.
    """

    def untold(history: History, response: AssumptionResponse) -> bool:
        if not all(np.isfinite(part).all() for part in (response.gram, response.shift)):
            return True
        values, sigmas = history.bare[0][MOMENTS], np.sqrt(np.diag(history.bare[1]))[MOMENTS]
        left = sum(float((z**2).sum()) for z in history.whitened())
        return bool((sigmas > KNOWN * np.abs(values)).any()) and response.gram[0, 0] > ANOTHER * left + UNSEEN**2

    kept = zip(found.responses, settled, strict=True)
    return replace(found, responses=tuple(None if one is None or untold(history, one) else one for one, history in kept))


def assumptions(
    found: Examined | None, log: Log, vehicle: Vehicle, settled: Sequence[History], conclusions: Sequence[Conclusion]
) -> tuple[AssumptionEffects, ...]:
    """All of a log; nothing where nothing was examined. Without a reference in any phase only what needs none."""
    if found is None:
        return ()
    listed = _thrust_scale(vehicle, conclusions) if log.command.any() and not vehicle.spinning else []
    effects: list[list[PhaseEffect]] = [[] for _ in found.taken]
    for history, conclusion, response in zip(settled, conclusions, found.responses, strict=True):
        if response is None:
            continue
        for of_one, t in zip(effects, found.taken, strict=True):
            of_one.append(_effect(history, conclusion, vehicle, response, found.step(t, response.shift.shape[1])))
        listed += _mass_thrust(log, vehicle, history, conclusion, response, len(found.varied) + 3)
        listed += _beside(history, conclusion, response)
    told = zip(found.taken, effects, strict=True)
    return (*listed, *(AssumptionEffects(t.code, t.message, t.step, t.stated, tuple(e)) for t, e in told if e and not t.part_of))


def _thrust_scale(vehicle: Vehicle, conclusions: Sequence[Conclusion]) -> list[AssumptionEffects]:
    """The scale common to all thrust: mass and inertia are proportional to it, and nothing in a log depends on it."""
    effects = []
    sigma = vehicle.thrust.scale_sigma
    for conclusion in conclusions:
        known: dict[str, float] = {name: one.sigma for name, one in vehicle.in_phase(conclusion.phase).known.items()}
        if sigma > 0 and any(name not in CG for name in known):
            continue  # which calibrates it
        moved = 0.01 * left_by_known(by_scale(conclusion.values, vehicle), conclusion.covariance, known)
        change = {
            name: float(part)
            for (name, e), part in zip(conclusion.estimates.items(), moved, strict=True)
            if abs(part) > SHOWN * (e.sigma or 0.0) and name not in known
        }
        effects.append(PhaseEffect(conclusion.phase.name, change, None))
    if not effects:
        return []
    message = "mass and inertia are proportional to the thrust that the vehicle file states; a scale common to all thrust can't be seen"
    if vehicle.bearing_mass_kg > 0:
        message += ", and moves the CG by the part of the mass that does not turn"
    said = f"; its stated uncertainty, {100 * sigma:g} %, is in every sigma" if sigma else "; no uncertainty of it is stated"
    return [AssumptionEffects("thrust-scale", message + said, "1 %", sigma > 0, tuple(effects))]


def _mass_thrust(
    log: Log, vehicle: Vehicle, history: History, conclusion: Conclusion, response: AssumptionResponse, first: int
) -> list[AssumptionEffects]:
    """The command channels (columns from ``first`` on) on which the mass rests alone, with what one percent of their thrust does."""
    fired = np.diag(response.misfit)[first:] > 0  # what never acted leaves nothing
    fired[len(fired) - len(vehicle.momentum_wrench) :] = False  # and what stores momentum doesn't push
    chosen = np.zeros(len(fired), dtype=bool)
    chosen[fired] = _alone(response.misfit[first:, first:][np.ix_(fired, fired)], response.shift[:, first:][:, fired], conclusion)
    if conclusion.estimates["mass"].value is None or not chosen.any() or (chosen == fired).all():
        return []
    names = channel_names(log, vehicle)
    listed = ", ".join(name for name, is_one in zip(names, chosen, strict=True) if is_one)
    step = 0.01 * np.concatenate([np.zeros(first), chosen])
    several = f" of phase {history.phase.name}" if len(vehicle.phases) > 1 else ""
    message = f"the mass{several} rests on the thrust of {listed} alone; an error common to these can't be seen"
    return [AssumptionEffects("mass-thrust", message, "1 %", True, (_effect(history, conclusion, vehicle, response, step),))]


BESIDE = {one.uncertain[0]: (one.uncertain[1], one.sigma_key) for one in TABLE if one.uncertain[0]} | {
    RESTATED: ("the values under uncertain are estimated with the mass properties, from one sigma each", "uncertain")
}
"""What is unknown beside the mass properties and found with them, and the key that says by how much."""


def _beside(history: History, conclusion: Conclusion, response: AssumptionResponse) -> list[AssumptionEffects]:
    """What the stated uncertainty of jets and IMU, and damping, add to each sigma, squares added; it is in every sigma."""
    found = []
    damping = ", ".join(f"{axis}: {value:.4g} ± {sigma:.2g}" for axis, (value, sigma) in zip("XYZ", response.damping, strict=False))
    for kind, variance in response.added.items():
        part = np.sqrt(np.maximum(variance, 0.0))
        part[MU] = part[MU] / history.reference.mu**2 if history.reference is not None else np.nan
        change = {
            name: float(size)
            for name, size in zip(QUANTITIES, part, strict=True)
            if (sigma := conclusion.estimates[name].sigma) is not None and size > SHOWN * sigma
        }
        message, key = BESIDE[kind]
        said = f"{message.format(damping=damping)}; that is in every sigma, and so much of it"
        found.append(AssumptionEffects(f"uncertain-{kind}", said, f"its {key}", True, (PhaseEffect(history.phase.name, change, None),)))
    return found


def _alone(misfit: Array, shift: Array, conclusion: Conclusion) -> BoolArray:
    """(C,) which channels' thrust the mass takes its scale from, if it is not the one that the inertia takes its own from.

    Among changes of the channels' thrust that a percent of would not show in the log, that one is sought which moves the mass and leaves
    the inertia's trace: it is one for the channels that count and zero for the others. ``misfit`` (C, C), ``shift`` (10, C) per unit.
    """
    values = conclusion.bare[0]
    sizes, axes = np.linalg.eigh(misfit)
    weak = axes[:, 1e-4 * sizes < UNSEEN**2]
    by_mass, by_trace = -shift[MU] * values[9], shift[MOMENTS].sum(0) / values[MOMENTS].sum()
    targets = np.stack([by_mass, by_trace]) @ weak
    if not np.isfinite(targets).all() or np.linalg.matrix_rank(targets, tol=1e-3) < 2:
        return np.zeros(len(misfit), dtype=bool)
    found = weak @ np.linalg.pinv(targets) @ np.array([1.0, 0.0])
    alone: BoolArray = found > 0.5
    return alone if np.abs(found - alone).max() < 0.5 else np.zeros(len(misfit), dtype=bool)


def _effect(history: History, conclusion: Conclusion, vehicle: Vehicle, response: AssumptionResponse, step: Array) -> PhaseEffect:
    """Of ``step`` (e,) units of each column of the response."""
    moved = response.shift @ step
    reference = history.reference
    moved[MU] = -moved[MU] / reference.mu**2 if reference is not None else np.nan
    known = vehicle.in_phase(history.phase).known
    change = {}
    for name, value, size in zip(QUANTITIES, moved, history.natural_sizes, strict=True):
        estimate = conclusion.estimates[name]
        least = max(SHOWN * (estimate.sigma or 0.0), 1e-9 * size)
        if estimate.value is not None and name not in known and abs(value) > least:
            change[name] = float(value)
    return PhaseEffect(history.phase.name, change, float(np.sqrt(max(float(step @ response.misfit @ step), 0.0))))
