"""Estimation of the command delay and of the thrust lag from a log.

A coarse search asks which whole delay and which lag let commands explain the motion at all; from there both are unknowns of the fit
(:mod:`massprop_cli.diagnosis.fit`) like any other, their derivatives differences of two alignments, until they stand still.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import field, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.fit import PASSES, Extra, Fit, fit, response
from massprop_cli.diagnosis.freeresponse import LEAST, line_minimum, motion_of, unexplained, unexplained_by
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.errorparameters.table import BY_NAME
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.residualtest import REFUTED, deviate, threshold
from massprop_cli.inputs.equipment import LATEST_S, Imu
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.geometry import WrenchChanges, uncertain_jets
from massprop_cli.model.plant import Reference
from massprop_cli.model.regressors import regressors
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import wrench_columns
from massprop_cli.prepare.align import LAGS_FORGOTTEN, impulses
from massprop_cli.prepare.compensate import Samples, Source
from massprop_cli.prepare.timing import Timing

LONGEST = 20
"""Cycles of delay searched."""
DELAYS = tuple(float(cycles) for cycles in range(LONGEST + 1))
LAGS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Cycles of lag searched."""
PRIOR = 1.0
"""Cycles; one sigma of what a single step may change."""
LEAP = 0.5
"""Cycles, or this part of the lag; the largest step."""
BADLY = 10.0
"""Chi-square beyond which a fit may have run into another minimum."""
CLEARLY = 3.0
"""−2 log likelihood, per cycle, by which a delay a cycle away is less likely where commands by themselves tell it: each of three channels,
all that move on a table, is left with e times the variance. Of real flights, whose model is no better, it is less than a fifth of that."""
FINEST = 1 / 512
"""Cycles at which the search by commands alone ends."""
SHARPEST = 1e-12
"""Cycles; no log tells a delay better."""
STEPS = 6
MORE_STEPS = 20
"""Most steps for a delay, and for a lag: the two look alike, so that they creep."""
SETTLED = 1e-3
"""Cycles."""
SHORT, FARTHER = 0.1, 2.0
"""Cycles below which a low-pass hardly differs from a delay, so that its derivative tells little of a longer one; and times its time
constant by which that one is longer."""
LITTLE = 0.05
"""Sigmas of a cutoff."""
BELOW = 4.0
"""Sigmas by which chance puts a lag below none at most."""
CUTOFFS_HZ = (300.0, 180.0, 110.0, 70.0, 45.0, 28.0, 18.0, 11.0, 7.0)
"""Of low-passes searched."""
LATENCIES_S = (0.0, 0.0015, 0.003, 0.006, 0.012)
LATENCIES = (-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Of sensors searched; and cycles of it where no cutoff is sought."""
SENSORS = ("gyro", "accel")
AT_ANY_TIME = ("delay", "gyro_latency", "accel_latency")
"""Shifts in time, whose steps their own size does not bound."""
MISMATCH = 0.1
"""Cycles by which a stated delay may be off and what the log says of it still be linear."""


@dataclass(frozen=True)
class FoundTiming:
    """The timing that the log shows, control cycles."""

    at: Timing
    sigma: Timing
    """One standard deviation; zero for what was given."""
    chi_square: float
    """Mean squared residual over stated noise of the fit there; infinite where none stands."""
    unknown: tuple[str, ...] = ("delay",)
    """Error parameters that were sought, ..."""
    covariance: Array = field(default_factory=lambda: np.zeros((1, 1)))
    """(n, n) of their errors, cycles²."""
    imu: Imu | None = None
    """With the low-passes as found; None: as stated."""

    def correlation(self, one: str, other: str) -> float:
        """Of the errors of two, where both were sought."""
        if not {one, other} <= set(self.unknown):
            return 0.0
        both = [self.unknown.index(name) for name in (one, other)]
        part = self.covariance[np.ix_(both, both)]
        return float(part[0, 1] / np.sqrt(part[0, 0] * part[1, 1])) if part[0, 0] * part[1, 1] > 0 else 0.0

    def setup(self, given: Setup) -> Setup:
        """As ``given``, with this timing and its low-passes."""
        return given._replace(vehicle=given.vehicle if self.imu is None else stating(given.vehicle, {"imu": self.imu}), timing=self.at)

    def between(self, moved: Array, covariance: Array, given: Setup) -> FoundTiming:
        """What the log and what was ``given`` come to: that moved by so much, cycles."""
        setup = shifted(given, self.unknown, moved)
        sigma, imu = _sigmas(self.unknown, covariance), None if self.imu is None else setup.vehicle.imu
        return replace(self, at=setup.timing, sigma=sigma, covariance=covariance, imu=imu)


def _sigmas(unknown: Sequence[str], covariance: Array) -> Timing:
    found = dict(zip(unknown, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    return Timing(found.get("delay", 0.0), found.get("lag", 0.0))


def shifted(setup: Setup, names: Sequence[str], steps: Sequence[float] | Array) -> Setup:
    """With some error parameters changed by so many cycles each, as far as they may be."""
    for name, step in zip(names, steps, strict=True):
        setup = BY_NAME[name].apply(setup, np.array([float(step)])) or setup
    return setup


def cycles_of(setup: Setup, name: str) -> float:
    """One of them, in cycles."""
    value = float(setup.value(BY_NAME[name].key or "")[0])
    return 1 / (2 * np.pi * value * setup.period_s) if name.endswith("_cutoff") else value / BY_NAME[name].scale(setup.vehicle)


def apart(one: Setup, other: Setup, names: Sequence[str]) -> Array:
    """(n,) by how many cycles some error parameters of one are beyond those of the other."""
    return np.array([cycles_of(one, name) - cycles_of(other, name) for name in names])


def detect(setup: Setup, pieces: Sequence[slice], unknown: Sequence[str], prior: Sequence[float] | None = None) -> FoundTiming | None:
    """The ``unknown`` delay, lag and cutoffs, from those of ``setup`` on, pooled over ``pieces`` (cycles of each phase).

    ``prior``: one sigma of what is stated of each, cycles; 0: nothing is. None where the log can't tell.
    """
    now = setup
    last: Array = np.zeros(len(unknown))
    references = dict[int, Reference]()
    sharp = np.array([1 / sigma**2 if sigma else 0.0 for sigma in prior or [0.0] * len(unknown)])
    first = np.array([cycles_of(setup, name) for name in unknown])
    for _ in range(STEPS if list(unknown) == ["delay"] else MORE_STEPS):
        found = _move(now, pieces, unknown, references)
        if found is None:
            return None
        at = np.array([cycles_of(now, name) for name in unknown])
        information = np.linalg.inv(found.covariance) + np.diag(sharp)
        covariance = np.linalg.inv(information)
        steps = covariance @ (information @ found.steps - sharp * (found.steps + at - first))
        # two that look alike go to and fro, and one at a whole cycle, where what the motion depends on has a corner
        steps = steps / 2 if steps @ last < -(last @ last) * (len(unknown) == 1) / 2 else steps
        last = bounded(steps, covariance, LEAP * np.array([*map(_size, unknown, at, steps)]))
        before, now = now, shifted(now, unknown, last)
        moved = np.abs(apart(now, before, unknown))
        sigmas = np.sqrt(np.diag(covariance))
        small = np.where([name in ("delay", "lag") for name in unknown], SETTLED, LITTLE * sigmas)
        if (moved < np.maximum(small, SETTLED)).all():
            break
    else:
        return None
    limits = [PRIOR / 2 * max(1.0, now.timing.lag) if name == "lag" else PRIOR / 2 for name in unknown]
    if not (sigmas < limits).all() or now.timing.lag < -BELOW * _sigmas(unknown, covariance).lag:
        return None
    imu = now.vehicle.imu if set(unknown) - {"delay", "lag"} else None
    return FoundTiming(now.timing, _sigmas(unknown, covariance), found.after, tuple(unknown), covariance, imu)


def _size(name: str, own: float, step: float) -> float:
    """What the largest step is a part of, cycles: of a time constant itself, or one that delays visibly where it becomes longer."""
    if name in AT_ANY_TIME:
        return 1.0
    return max(own, 1.0 if name == "lag" else SHORT * (step > 0))


def bounded(steps: Array, covariance: Array, most: Array) -> Array:
    """(n,) steps of which none is larger than ``most`` (n,), and the others are the likeliest with those that are as large.

    Those are the conditional means of a normal distribution of mean ``steps`` (n,) and ``covariance`` (n, n), all in cycles. Bounded by
    itself, a delay that is to be exchanged for time constants would go by half a cycle, and these by thousandths of one.
    """
    found, held = steps.copy(), np.zeros(len(steps), dtype=bool)
    while (over := np.where(held, 0.0, np.abs(found) / most)).max() > 1:
        worst = int(over.argmax())
        held[worst], found[worst] = True, np.copysign(most[worst], found[worst])
        gain = covariance[np.ix_(~held, held)] @ np.linalg.inv(covariance[np.ix_(held, held)])
        found[~held] = steps[~held] + gain @ (found - steps)[held]
    return found


def contradicted(log: Log, vehicle: Resolved, pieces: Sequence[slice], found: FoundTiming, names: Sequence[str]) -> bool:
    """Whether the log refutes the stated cutoffs ``names``, the timing that was ``found`` moved beside them (score test).

    Time constants are all longer by as much: both sensors are mostly in one chip.
    """
    setup = Setup(log, vehicle, found.at)
    shortest = min(cycles_of(setup, name) for name in names)
    steps = [BY_NAME[names[0]].difference, *([FARTHER * shortest] if shortest < SHORT else [])]
    try:
        longer = [(samples_of(shifted(setup, names, [by] * len(names))), by) for by in steps]
    except InputError:
        return False
    move = _move(setup, pieces, found.unknown, {}, longer)
    if move is None:
        return False
    count = len(longer)
    mean = move.steps[-count:] @ np.linalg.solve(move.covariance[-count:, -count:], move.steps[-count:]) / count
    return bool(deviate(mean, count) > threshold(REFUTED, 1))


def by_commands_alone(log: Log, vehicle: Vehicle, near: Timing) -> FoundTiming | None:
    """The delay by how much commands explain of the motion, with nothing known of the body; None where others explain nearly as much.

    For logs of which no fit stands, so that what it says of the delay is worth nothing.
    """

    def cost(cycles: float) -> float:
        return sum(unexplained_by(log, vehicle, near._replace(delay=cycles), LONGEST)) if cycles >= 0 else np.inf

    try:
        at = line_minimum(cost, [near.delay], 1.0, FINEST)
        least, bent = cost(at), (cost(at - FINEST) - 2 * cost(at) + cost(at + FINEST)) / FINEST**2
        clear = min(cost(at - 1), cost(at + 1)) - least > CLEARLY * log.cycles
    except InputError:
        return None  # of a log that is too short
    if not (np.isfinite(bent) and bent > 0 and clear):
        return None
    sigma = float(np.sqrt(2 / bent))
    return FoundTiming(near._replace(delay=at), Timing(sigma, 0.0), np.inf, covariance=np.array([[sigma**2]]))


def low_passes(log: Log, vehicle: Vehicle, timing: Timing, cutoffs: Sequence[str], latencies: Sequence[str]) -> Vehicle:
    """The vehicle with the low-passes of :data:`CUTOFFS_HZ` and :data:`LATENCIES_S` by which commands explain most.

    ``cutoffs`` and ``latencies``: sensors of which each is to be found.
    """
    for place, sensor in enumerate(SENSORS):
        keys = [f"imu.{sensor}_filter.{key}" for key, own in (("cutoff_hz", cutoffs), ("latency_s", latencies)) if sensor in own]
        late = (*LATENCIES_S, *(cycles * vehicle.cycle.period_s for cycles in (() if sensor in cutoffs else LATENCIES)))
        late = tuple(one for one in late if abs(one) <= LATEST_S)
        grid = [values for values, own in ((CUTOFFS_HZ, cutoffs), (late, latencies)) if sensor in own]
        best = (np.inf, vehicle)
        for values in itertools.product(*grid) if keys else ():
            tried = stating(vehicle, dict(zip(keys, values, strict=True)))
            best = min(best, (unexplained_by(log, tried, timing)[place], tried), key=itemgetter(0))
        vehicle = best[1]
    return vehicle


def near(stated: Timing, later: float, sigma: float, after: float) -> FoundTiming | None:
    """A delay ``later`` than stated by so many cycles, ± ``sigma``; None where the log can't tell."""
    if not SHARPEST < sigma < PRIOR / 2:
        return None
    return FoundTiming(stated._replace(delay=stated.delay + later), Timing(sigma, 0.0), after, covariance=np.array([[sigma**2]]))


class Rated(NamedTuple):
    """A timing that was tried."""

    at: Timing
    cost: float
    """−2 log likelihood, but for a constant."""


def search(
    log: Log,
    vehicle: Vehicle,
    lags: Sequence[float],
    delays: Sequence[float] = DELAYS,
    pieces: Sequence[slice] | None = None,
) -> list[Rated]:
    """The candidates, those first at which a plain regression of motion on commands leaves least; over the whole log without ``pieces``."""
    candidates = [Timing(float(delay), lag) for lag in lags for delay in delays if delay <= max(log.cycles // 4, min(delays))]
    unknown = LONGEST + int(LAGS_FORGOTTEN * max(lags))
    costs, motion = [], None
    for candidate in candidates:
        try:
            made = impulses(log, vehicle, candidate.delay, candidate.lag_s(vehicle))
            # what the IMU felt is the same whenever the commands act
            motion = motion_of(candidate.of(log, vehicle, made)) if motion is None else motion
        except InputError:
            costs.append(np.inf)
            continue
        whole = [slice(p.start + unknown, p.stop) for p in pieces or [slice(0, log.cycles)]]  # the same cycles for every candidate
        parts = [sum(unexplained(motion, made, piece)) for piece in whole if piece.stop - piece.start > LEAST]
        costs.append(float(np.sum(parts)) if parts else np.inf)
    return [Rated(candidates[i], costs[i]) for i in np.argsort(costs, kind="stable") if np.isfinite(costs[i])]


class _Move(NamedTuple):
    """By how much a fit would move the unknowns, cycles, and the covariance of that; chi-square after it."""

    steps: Array
    covariance: Array
    after: float


def first_of(samples: Source, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """What a fit may begin about; None where nothing tells, or what is told runs away."""
    try:
        return first_reference(samples, cycles, vehicle) if cycles.stop - cycles.start > 20 else None
    except np.linalg.LinAlgError:
        return None


def _move(
    setup: Setup,
    pieces: Sequence[slice],
    unknown: Sequence[str],
    references: dict[int, Reference],
    others: Sequence[tuple[Samples, float]] = (),
) -> _Move | None:
    """The move that fits best, pooled over pieces, with ``others``: readings that are so many cycles on. None where no piece can tell.

    Each piece is fitted from the reference that the move before left in ``references``, and from the first one where that fits badly.
    """
    size, vehicle = len(unknown) + len(others), setup.vehicle
    assert isinstance(vehicle, Resolved)
    pairs = [tuple(shifted(setup, [name], [sign * BY_NAME[name].difference]) for sign in (-1, 1)) for name in unknown]
    try:
        stated, sides = samples_of(setup), [(samples_of(low), samples_of(high)) for low, high in pairs]
    except InputError:
        return None
    apart = [cycles_of(high, name) - cycles_of(low, name) for name, (low, high) in zip(unknown, pairs, strict=True)]
    sides, apart = [*sides, *((stated, other) for other, _ in others)], [*apart, *(by for _, by in others)]
    first = max(int(np.argmax(samples.executed.usable)) for samples in (stated, *(one for pair in sides for one in pair)))
    information, moment = np.zeros((size, size)), np.zeros(size)
    after = 0.0
    rows = 0
    for number, piece in enumerate(pieces):
        cycles = slice(max(piece.start, first), piece.stop)
        plain = fitted(stated, cycles, references.get(number), vehicle)
        if plain is None:
            continue
        references[number] = plain.reference
        changes = [_change(*pair, by, cycles, plain.reference, vehicle) for pair, by in zip(sides, apart, strict=True)]
        jets = _of_jets(setup.log, stated, cycles, plain.reference, vehicle)
        growth, force = (np.concatenate([*each, own], -1) for each, own in zip(zip(*changes, strict=True), jets, strict=True))
        extra = Extra(growth, force, np.repeat([PRIOR, 1.0], [size, growth.shape[-1] - size]))
        moved = fit(stated, cycles, plain.reference, vehicle, extra, passes=0)
        if moved is None:
            continue
        spread = moved.extra_covariance[:size, :size] * max(moved.chi_square, 1.0)
        if np.linalg.eigvalsh(spread)[0] < SHARPEST**2:
            continue
        count = cycles.stop - cycles.start
        after, rows = after + count * moved.chi_square, rows + count
        part = np.linalg.inv(spread)
        information = information + part
        moment = moment + part @ moved.extra[:size]
    if rows == 0:
        return None
    covariance = np.linalg.inv(information)
    return _Move(covariance @ moment, covariance, after / rows)


def fitted(samples: Samples, cycles: slice, reference: Reference | None, vehicle: Resolved) -> Fit | None:
    """About a reference, or about the first one where that is none or fits badly; None where a response that runs away tells nothing."""
    plain = None if reference is None else fit(samples, cycles, reference, vehicle, passes=PASSES)
    if plain is not None and plain.chi_square <= BADLY:
        return plain
    first = first_of(samples, cycles, vehicle)
    again = None if first is None else fit(samples, cycles, first, vehicle, passes=PASSES)
    return min((one for one in (plain, again) if one is not None), key=lambda one: one.chi_square, default=None)


def samples_of(setup: Setup) -> Samples:
    """As its timing has the log read."""
    return setup.timing.of(setup.log, setup.vehicle)


def _of_jets(log: Log, samples: Samples, cycles: slice, reference: Reference, vehicle: Resolved) -> tuple[Array, Array]:
    """What is uncertain of single jets does by one sigma of each: (K − 1, 3, g) rad/s and (K, 3, g) m/s².

    Taken as exact it would move the timing, by far more than its sigma.
    """
    changes = uncertain_jets(vehicle) if log.command_kind == "jets" else WrenchChanges()
    if not changes.kinds:
        count = cycles.stop - cycles.start
        return np.zeros((count - 1, 3, 0)), np.zeros((count, 3, 0))
    return wrench_columns(samples, cycles, reference, vehicle, regressors(samples, cycles, reference, vehicle), changes)


def _change(early: Samples, late: Samples, step: float, cycles: slice, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array]:
    """Derivative of the response less what was read, (K − 1, 3, 1) and (K, 3, 1), per cycle by which two readings are ``step`` apart.

    On a bearing the specific force is read as it was when the gyro's motion was, so that it differs by a sensor's own lateness, too.
    """
    (growth_early, push_early), (growth_late, push_late) = (response(s, cycles, reference, vehicle) for s in (early, late))
    read_early, read_late = (s.part(cycles).specific_force_m_s2 for s in (early, late))
    return (growth_late - growth_early)[..., None] / step, (push_late - read_late - push_early + read_early)[..., None] / step
