"""Estimation of command delay, thrust lag and low-passes from a log.

A coarse search finds the whole delay and the lag of least free-response cost. From there they are extra unknowns of the fit
(:mod:`massprop_cli.diagnosis.fit`), with difference quotients of two alignments, and are iterated until they converge.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import field, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CONTRADICTION, ENOUGH, ITERATIONS, SLOW_ITERATIONS, STILL
from massprop_cli.diagnosis.fit import Extra, Fit, fit, response
from massprop_cli.diagnosis.freeresponse import line_minimum, log_costs, motion_costs, motion_of
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.errorparameters.table import BY_NAME
from massprop_cli.estimate.initial import first_reference
from massprop_cli.estimate.residualtest import REFUTED, deviate, threshold
from massprop_cli.inputs.equipment import LATEST_S, Imu
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.assumptioncolumns import wrench_columns
from massprop_cli.model.geometry import WrenchChanges, uncertain_jets
from massprop_cli.model.plant import Reference
from massprop_cli.model.regressors import regressors
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.align import LAGS_FORGOTTEN, impulses
from massprop_cli.prepare.compensate import Samples, Source
from massprop_cli.prepare.timing import Timing

LONGEST = 20
"""Longest delay that is searched, cycles."""
DELAYS = tuple(float(cycles) for cycles in range(LONGEST + 1))
LAGS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Lags that are searched, cycles."""
PRIOR = 1.0
"""Prior sigma of one step, cycles."""
LARGEST_STEP = 0.5
"""Largest step, cycles or relative to the lag."""
MISFIT = 10.0
"""Chi-square beyond which a fit may be in another minimum."""
SIGNIFICANT = 3.0
"""−2 log likelihood ratio per cycle of a delay one cycle away, if commands alone give the delay: e times the variance in each of three
channels, all that move on a table. Real flights, whose model is no better, have less than a fifth of it."""
FINEST = 1 / 512
"""Final step of the search by commands alone, cycles."""
SETTLED = 1e-3
"""Largest step at convergence, cycles."""
SHORT, FARTHER = 0.1, 2.0
"""Time constant, cycles, below which a low-pass is nearly a delay, so that its derivative does not describe a longer one; and the longer
time constant that is tested, relative to it."""
CUTOFFS_HZ = (300.0, 180.0, 110.0, 70.0, 45.0, 28.0, 18.0, 11.0, 7.0)
"""Cutoffs of the coarse search, Hz."""
LATENCIES_S = (0.0, 0.0015, 0.003, 0.006, 0.012)
LATENCIES = (-3.0, -2.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Latencies of the coarse search, s; and cycles in addition if no cutoff is estimated."""
SENSORS = ("gyro", "accel")
AT_ANY_TIME = ("delay", "gyro_latency", "accel_latency")
"""Time shifts, whose steps their own size does not limit."""
MISMATCH = 0.1
"""Largest error of a stated delay, cycles, for which its linear estimate is valid."""


@dataclass(frozen=True)
class FoundTiming:
    """Timing estimated from the log, control cycles."""

    at: Timing
    sigma: Timing
    """Standard deviations; zero for what was stated."""
    chi_square: float
    """Mean squared residual over stated noise; infinite without a fit."""
    unknown: tuple[str, ...] = ("delay",)
    """Names of the n estimated error parameters."""
    covariance: Array = field(default_factory=lambda: np.zeros((1, 1)))
    """(n, n) their covariance, cycles²."""
    imu: Imu | None = None
    """IMU with the estimated low-passes; None: as stated."""

    def correlation(self, one: str, other: str) -> float:
        """Correlation of two parameters; 0 if not both were estimated."""
        if not {one, other} <= set(self.unknown):
            return 0.0
        both = [self.unknown.index(name) for name in (one, other)]
        part = self.covariance[np.ix_(both, both)]
        return float(part[0, 1] / np.sqrt(part[0, 0] * part[1, 1])) if part[0, 0] * part[1, 1] > 0 else 0.0

    def setup(self, given: Setup) -> Setup:
        """``given`` with this timing and these low-passes."""
        return given._replace(vehicle=given.vehicle if self.imu is None else stating(given.vehicle, {"imu": self.imu}), timing=self.at)

    def between(self, moved: Array, covariance: Array, given: Setup) -> FoundTiming:
        """Timing moved by ``moved`` cycles from ``given``, with another covariance."""
        setup = shifted(given, self.unknown, moved)
        sigma, imu = _sigmas(self.unknown, covariance), None if self.imu is None else setup.vehicle.imu
        return replace(self, at=setup.timing, sigma=sigma, covariance=covariance, imu=imu)


def _sigmas(unknown: Sequence[str], covariance: Array) -> Timing:
    found = dict(zip(unknown, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    return Timing(found.get("delay", 0.0), found.get("lag", 0.0))


def shifted(setup: Setup, names: Sequence[str], steps: Sequence[float] | Array) -> Setup:
    """Setup with error parameters changed by ``steps`` cycles, within their limits."""
    for name, step in zip(names, steps, strict=True):
        setup = BY_NAME[name].apply(setup, np.array([float(step)])) or setup
    return setup


def cycles_of(setup: Setup, name: str) -> float:
    """Value of an error parameter, cycles."""
    value = float(setup.value(BY_NAME[name].key or "")[0])
    return 1 / (2 * np.pi * value * setup.period_s) if name.endswith("_cutoff") else value / BY_NAME[name].scale(setup.vehicle)


def differences(one: Setup, other: Setup, names: Sequence[str]) -> Array:
    """(n,) difference of error parameters between two setups, cycles."""
    return np.array([cycles_of(one, name) - cycles_of(other, name) for name in names])


def detect(setup: Setup, pieces: Sequence[slice], unknown: Sequence[str], prior: Sequence[float] | None = None) -> FoundTiming | None:
    """Estimate the ``unknown`` delay, lag and cutoffs from those of ``setup`` on, jointly over ``pieces``.

    ``prior``: sigma of each stated value, cycles; 0: no prior. None if the iteration does not converge or the log determines too little.
    """
    setup_now = setup
    last_steps: Array = np.zeros(len(unknown))
    references = dict[int, Reference]()
    prior_information = np.array([1 / sigma**2 if sigma else 0.0 for sigma in prior or [0.0] * len(unknown)])
    initial = np.array([cycles_of(setup, name) for name in unknown])
    for _ in range(ITERATIONS if list(unknown) == ["delay"] else SLOW_ITERATIONS):
        move = _joint_step(setup_now, pieces, unknown, references)
        if move is None:
            return None
        values = np.array([cycles_of(setup_now, name) for name in unknown])
        information = np.linalg.inv(move.covariance) + np.diag(prior_information)
        covariance = np.linalg.inv(information)
        steps = covariance @ (information @ move.steps - prior_information * (move.steps + values - initial))
        # collinear unknowns oscillate, and so does one at a whole cycle, where the motion has a corner
        steps = steps / 2 if steps @ last_steps < -(last_steps @ last_steps) * (len(unknown) == 1) / 2 else steps
        last_steps = bounded_steps(steps, covariance, LARGEST_STEP * np.array([*map(_size, unknown, values, steps)]))
        setup_before, setup_now = setup_now, shifted(setup_now, unknown, last_steps)
        moved = np.abs(differences(setup_now, setup_before, unknown))
        sigmas = np.sqrt(np.diag(covariance))
        tolerance = np.where([name in ("delay", "lag") for name in unknown], SETTLED, STILL * sigmas)
        if (moved < np.maximum(tolerance, SETTLED)).all():
            break
    else:
        return None
    limits = [PRIOR / 2 * max(1.0, setup_now.timing.lag) if name == "lag" else PRIOR / 2 for name in unknown]
    if not (sigmas < limits).all() or setup_now.timing.lag < -CONTRADICTION * _sigmas(unknown, covariance).lag:
        return None
    imu = setup_now.vehicle.imu if set(unknown) - {"delay", "lag"} else None
    return FoundTiming(setup_now.timing, _sigmas(unknown, covariance), move.chi_square, tuple(unknown), covariance, imu)


def _size(name: str, value: float, step: float) -> float:
    """Scale of the largest step, cycles: of a time constant its own size, or a size that delays visibly if it grows."""
    if name in AT_ANY_TIME:
        return 1.0
    return max(value, 1.0 if name == "lag" else SHORT * (step > 0))


def bounded_steps(steps: Array, covariance: Array, most: Array) -> Array:
    """(n,) steps within ``most`` (n,): too large ones are cut, the others take their conditional means.

    The distribution has mean ``steps`` (n,) and ``covariance`` (n, n), cycles. Without the conditional means, a delay that trades against
    time constants would change by half a cycle, and these by thousandths.
    """
    limited, cut = steps.copy(), np.zeros(len(steps), dtype=bool)
    while (excess := np.where(cut, 0.0, np.abs(limited) / most)).max() > 1:
        worst = int(excess.argmax())
        cut[worst], limited[worst] = True, np.copysign(most[worst], limited[worst])
        gain = covariance[np.ix_(~cut, cut)] @ np.linalg.inv(covariance[np.ix_(cut, cut)])
        limited[~cut] = steps[~cut] + gain @ (limited - steps)[cut]
    return limited


def cutoffs_refuted(log: Log, vehicle: Resolved, pieces: Sequence[slice], found: FoundTiming, names: Sequence[str]) -> bool:
    """Whether the log refutes the stated cutoffs ``names``, with the timing re-estimated (score test).

    All time constants change together, since both sensors are mostly in one chip.
    """
    setup = Setup(log, vehicle, found.at)
    shortest = min(cycles_of(setup, name) for name in names)
    steps = [BY_NAME[names[0]].difference, *([FARTHER * shortest] if shortest < SHORT else [])]
    try:
        longer = [(samples_of(shifted(setup, names, [by] * len(names))), by) for by in steps]
    except InputError:
        return False
    move = _joint_step(setup, pieces, found.unknown, {}, longer)
    if move is None:
        return False
    count = len(longer)
    mean = move.steps[-count:] @ np.linalg.solve(move.covariance[-count:, -count:], move.steps[-count:]) / count
    return bool(deviate(mean, count) > threshold(REFUTED, 1))


def by_free_response(log: Log, vehicle: Vehicle, timing: Timing) -> FoundTiming | None:
    """Delay of least free-response cost; None if other delays explain nearly as much.

    It serves logs that no body fits.
    """

    def cost(cycles: float) -> float:
        return sum(log_costs(log, vehicle, timing._replace(delay=cycles), LONGEST)) if cycles >= 0 else np.inf

    try:
        best = line_minimum(cost, [timing.delay], 1.0, FINEST)
        least, curvature = cost(best), (cost(best - FINEST) - 2 * cost(best) + cost(best + FINEST)) / FINEST**2
        clear = min(cost(best - 1), cost(best + 1)) - least > SIGNIFICANT * log.cycles
    except InputError:
        return None  # of a log that is too short
    if not (np.isfinite(curvature) and curvature > 0 and clear):
        return None
    sigma = float(np.sqrt(2 / curvature))
    return FoundTiming(timing._replace(delay=best), Timing(sigma, 0.0), np.inf, covariance=np.array([[sigma**2]]))


def low_passes(log: Log, vehicle: Vehicle, timing: Timing, cutoffs: Sequence[str], latencies: Sequence[str]) -> Vehicle:
    """The vehicle with the low-passes of :data:`CUTOFFS_HZ` and :data:`LATENCIES_S` of least free-response cost.

    ``cutoffs`` and ``latencies``: sensors for which each is estimated.
    """
    for number, sensor in enumerate(SENSORS):
        keys = [f"imu.{sensor}_filter.{key}" for key, sensors in (("cutoff_hz", cutoffs), ("latency_s", latencies)) if sensor in sensors]
        latencies_s = (*LATENCIES_S, *(cycles * vehicle.cycle.period_s for cycles in (() if sensor in cutoffs else LATENCIES)))
        latencies_s = tuple(one for one in latencies_s if abs(one) <= LATEST_S)
        values_of_keys = [values for values, sensors in ((CUTOFFS_HZ, cutoffs), (latencies_s, latencies)) if sensor in sensors]
        best = (np.inf, vehicle)
        for values in itertools.product(*values_of_keys) if keys else ():
            candidate = stating(vehicle, dict(zip(keys, values, strict=True)))
            best = min(best, (log_costs(log, candidate, timing)[number], candidate), key=itemgetter(0))
        vehicle = best[1]
    return vehicle


def timing_near(stated: Timing, change: float, sigma: float, chi_square: float) -> FoundTiming | None:
    """Timing with a delay ``change`` than stated, ± ``sigma``, cycles; None if the log does not determine it."""
    if not ROUNDING < sigma < PRIOR / 2:
        return None
    return FoundTiming(stated._replace(delay=stated.delay + change), Timing(sigma, 0.0), chi_square, covariance=np.array([[sigma**2]]))


class Rated(NamedTuple):
    """A timing and its cost."""

    at: Timing
    cost: float
    """−2 log likelihood up to a constant."""


def search(
    log: Log, vehicle: Vehicle, lags: Sequence[float], delays: Sequence[float] = DELAYS, pieces: Sequence[slice] | None = None
) -> list[Rated]:
    """Timings in ascending order of free-response cost over ``pieces``, or over the whole log."""
    candidates = [Timing(float(delay), lag) for lag in lags for delay in delays if delay <= max(log.cycles // 4, min(delays))]
    unknown = LONGEST + int(LAGS_FORGOTTEN * max(lags))
    costs, motion = [], None
    for candidate in candidates:
        try:
            impulse = impulses(log, vehicle, candidate.delay, candidate.lag_s(vehicle))
            # the measured motion does not depend on the timing
            motion = motion_of(candidate.of(log, vehicle, impulse)) if motion is None else motion
        except InputError:
            costs.append(np.inf)
            continue
        usable = [slice(p.start + unknown, p.stop) for p in pieces or [slice(0, log.cycles)]]  # the same cycles for every candidate
        parts = [sum(motion_costs(motion, impulse, piece)) for piece in usable if piece.stop - piece.start > ENOUGH]
        costs.append(float(np.sum(parts)) if parts else np.inf)
    return [Rated(candidates[i], costs[i]) for i in np.argsort(costs, kind="stable") if np.isfinite(costs[i])]


class _TimingStep(NamedTuple):
    """Step of the unknowns, cycles, its covariance, and chi-square after it."""

    steps: Array
    covariance: Array
    chi_square: float


def initial_reference(samples: Source, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """Initial reference for a fit; None if the segment is too short or regression fails."""
    try:
        return first_reference(samples, cycles, vehicle) if cycles.stop - cycles.start > 20 else None
    except np.linalg.LinAlgError:
        return None


def _joint_step(
    setup: Setup,
    pieces: Sequence[slice],
    unknown: Sequence[str],
    references: dict[int, Reference],
    others: Sequence[tuple[Samples, float]] = (),
) -> _TimingStep | None:
    """Linear step of the unknowns, jointly over pieces; None if no piece determines it.

    ``others``: samples with further changes and their size, cycles. Each piece is fitted from its reference in ``references``, which is
    updated in place, or from the initial one if that fits badly.
    """
    size, vehicle = len(unknown) + len(others), setup.vehicle
    assert isinstance(vehicle, Resolved)
    pairs = [tuple(shifted(setup, [name], [sign * BY_NAME[name].difference]) for sign in (-1, 1)) for name in unknown]
    try:
        stated, sample_pairs = samples_of(setup), [(samples_of(low), samples_of(high)) for low, high in pairs]
    except InputError:
        return None
    apart = [cycles_of(high, name) - cycles_of(low, name) for name, (low, high) in zip(unknown, pairs, strict=True)]
    sample_pairs, apart = [*sample_pairs, *((stated, other) for other, _ in others)], [*apart, *(by for _, by in others)]
    first = max(int(np.argmax(samples.executed.usable)) for samples in (stated, *(one for pair in sample_pairs for one in pair)))
    information, moment = np.zeros((size, size)), np.zeros(size)
    after = 0.0
    rows = 0
    for number, piece in enumerate(pieces):
        cycles = slice(max(piece.start, first), piece.stop)
        current = fit_near(stated, cycles, references.get(number), vehicle)
        if current is None:
            continue
        references[number] = current.reference
        changes = [_derivative(*pair, by, cycles, current.reference, vehicle) for pair, by in zip(sample_pairs, apart, strict=True)]
        jets = _jet_columns(setup.log, stated, cycles, current.reference, vehicle)
        growth, force = (np.concatenate([*each, own], -1) for each, own in zip(zip(*changes, strict=True), jets, strict=True))
        extra = Extra(growth, force, np.repeat([PRIOR, 1.0], [size, growth.shape[-1] - size]))
        linear = fit(stated, cycles, current.reference, vehicle, extra, passes=0)
        if linear is None:
            continue
        spread = linear.extra_covariance[:size, :size] * max(linear.chi_square, 1.0)
        if np.linalg.eigvalsh(spread)[0] < ROUNDING**2:
            continue
        count = cycles.stop - cycles.start
        after, rows = after + count * linear.chi_square, rows + count
        piece_information = np.linalg.inv(spread)
        information = information + piece_information
        moment = moment + piece_information @ linear.extra[:size]
    if rows == 0:
        return None
    covariance = np.linalg.inv(information)
    return _TimingStep(covariance @ moment, covariance, after / rows)


def fit_near(samples: Samples, cycles: slice, reference: Reference | None, vehicle: Resolved) -> Fit | None:
    """Fit about a reference, or about the initial one if there is none or it fits badly; None if the response diverges."""
    current = None if reference is None else fit(samples, cycles, reference, vehicle, passes=ITERATIONS)
    if current is not None and current.chi_square <= MISFIT:
        return current
    initial = initial_reference(samples, cycles, vehicle)
    from_initial = None if initial is None else fit(samples, cycles, initial, vehicle, passes=ITERATIONS)
    return min((one for one in (current, from_initial) if one is not None), key=lambda one: one.chi_square, default=None)


def samples_of(setup: Setup) -> Samples:
    """Samples of a log under its timing."""
    return setup.timing.of(setup.log, setup.vehicle)


def _jet_columns(log: Log, samples: Samples, cycles: slice, reference: Reference, vehicle: Resolved) -> tuple[Array, Array]:
    """Response to one sigma of each uncertainty of single jets: (K − 1, 3, g) rad/s and (K, 3, g) m/s².

    Without these nuisance parameters, an error of a jet would move the timing by far more than its sigma.
    """
    changes = uncertain_jets(vehicle) if log.command_kind == "jets" else WrenchChanges()
    if not changes.kinds:
        count = cycles.stop - cycles.start
        return np.zeros((count - 1, 3, 0)), np.zeros((count, 3, 0))
    return wrench_columns(samples, cycles, reference, vehicle, regressors(samples, cycles, reference, vehicle), changes)


def _derivative(early: Samples, late: Samples, step: float, cycles: slice, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array]:
    """Derivative of response less measured force by a change, per cycle: (K − 1, 3, 1) and (K, 3, 1).

    On a bearing the measured specific force depends on the sensor's delay, too, since the gyro's motion does.
    """
    (growth_early, push_early), (growth_late, push_late) = (response(s, cycles, reference, vehicle) for s in (early, late))
    read_early, read_late = (s.part(cycles).specific_force_m_s2 for s in (early, late))
    return (growth_late - growth_early)[..., None] / step, (push_late - read_late - push_early + read_early)[..., None] / step
