"""When commands act, as the log shows it: the delay from command to execution, and the lag of the thrust.

A coarse search asks which whole delay and which lag let commands explain the motion at all; from there both are unknowns of the fit
(:mod:`massprop_cli.diagnosis.fit`) like any other, their derivatives differences of two alignments, until they stand still.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.fit import PASSES, Extra, fit, response
from massprop_cli.estimate.initial import first_reference
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.geometry import Wrenches, uncertain_jets
from massprop_cli.model.lifted import lifted
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import wrench_columns
from massprop_cli.prepare.align import LAGS_FORGOTTEN, Impulses, impulses
from massprop_cli.prepare.compensate import Samples, acceleration
from massprop_cli.prepare.timing import Timing

LONGEST = 20
"""Cycles of delay searched."""
DELAYS = tuple(float(cycles) for cycles in range(LONGEST + 1))
LAGS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Cycles of lag searched."""
LEAST = 30
"""Cycles that a search needs beyond those whose commands it doesn't know."""
STEP = 0.02
"""Cycles; half the difference behind the derivative."""
PRIOR = 1.0
"""Cycles; one sigma of what a single step may change."""
LEAP = 0.5
"""Cycles, or this part of the lag; the largest step."""
SHARPEST = 1e-12
"""Cycles; no log tells a delay better."""
STEPS = 6
MORE_STEPS = 20
"""Most steps for a delay, and for a lag: the two look alike, so that they creep."""
SETTLED = 1e-3
"""Cycles."""
MISMATCH = 0.1
"""Cycles by which a stated delay may be off and what the log says of it still be linear."""


@dataclass(frozen=True)
class Found:
    """The timing that the log shows, control cycles."""

    at: Timing
    sigma: Timing
    """One standard deviation; zero for what was given."""
    chi_square: float
    """Mean squared residual over stated noise of the fit there."""
    chi_square_before: float
    """The same where the search began."""
    correlation: float = 0.0
    """Of the errors of delay and lag, where both were sought."""


def detect(log: Log, vehicle: Resolved, pieces: Sequence[slice], start: Timing, unknown: Sequence[str]) -> Found | None:
    """The ``unknown`` entries of the timing, from ``start`` on, pooled over ``pieces`` (cycles of each phase).

    None where the log can't tell.
    """
    now, before = start, None
    for _ in range(MORE_STEPS if "lag" in unknown else STEPS):
        found = _move(log, vehicle, pieces, now, unknown)
        if found is None:
            return None
        before = found.before if before is None else before
        leap = [max(LEAP, LEAP * now.lag) if name == "lag" else LEAP for name in unknown]
        then = now.moved(unknown, np.clip(found.steps, [-most for most in leap], leap))
        still = max(abs(a - b) for a, b in zip(then, now, strict=True)) < SETTLED
        now = then
        if still:
            break
    else:
        return None
    sigma = Timing(0.0, 0.0).moved(unknown, found.sigmas)
    limits = [PRIOR / 2 * max(1.0, now.lag) if name == "lag" else PRIOR / 2 for name in unknown]
    return Found(now, sigma, found.after, before, found.correlation) if (found.sigmas < limits).all() else None


def near(stated: Timing, later: float, sigma: float, before: float, after: float) -> Found | None:
    """A delay ``later`` than stated by so many cycles, ± ``sigma``; None where the log can't tell."""
    if not SHARPEST < sigma < PRIOR / 2:
        return None
    return Found(stated._replace(delay=stated.delay + later), Timing(sigma, 0.0), after, before)


def search(
    log: Log,
    vehicle: Vehicle,
    lags: Sequence[float],
    delays: Sequence[float] = DELAYS,
    pieces: Sequence[slice] | None = None,
) -> Timing | None:
    """The candidates at which a plain regression of motion on commands leaves least; over the whole log without ``pieces``."""
    candidates = [Timing(float(delay), lag) for lag in lags for delay in delays if delay <= max(log.cycles // 4, min(delays))]
    unknown = LONGEST + int(LAGS_FORGOTTEN * max(lags))
    costs, motion = [], None
    for candidate in candidates:
        try:
            made = impulses(log, vehicle, candidate.delay, candidate.lag_s(vehicle))
            # what the IMU felt is the same whenever the commands act
            motion = _motion(candidate.of(log, vehicle, made), vehicle) if motion is None else motion
        except InputError:
            costs.append(np.inf)
            continue
        whole = [slice(p.start + unknown, p.stop) for p in pieces or [slice(0, log.cycles)]]  # the same cycles for every candidate
        parts = [_unexplained(motion, made, piece) for piece in whole if piece.stop - piece.start > LEAST]
        costs.append(float(np.sum(parts)) if parts else np.inf)
    return candidates[int(np.argmin(costs))] if np.isfinite(costs).any() else None


class _Motion(NamedTuple):
    """Of a log's K cycles."""

    rate: Array
    """(K, 3)"""
    up: Array
    """(K, 3) mean of the vertical."""
    acceleration: Array
    """(K, 3) of the rotation centre."""


def _motion(samples: Samples, vehicle: Vehicle) -> _Motion:
    return _Motion(samples.rate_rad_s, (samples.up_b[:-1] + samples.up_b[1:]) / 2, acceleration(samples, vehicle))


def _unexplained(motion: _Motion, made: Impulses, piece: slice) -> float:
    """Log of what is left of rate growth and acceleration when both are regressed on impulses, with nothing known of the body."""
    rate, up = motion.rate[piece], motion.up[piece]
    products = rate[:, [0, 0, 0, 1, 1, 2]] * rate[:, [0, 1, 2, 1, 2, 2]]
    if made.stored is not None:
        products = np.hstack([products, made.stored.precession(motion.rate)[piece]])
    rising, falling, whole = (part[piece] for part in (made.rising, made.falling, made.whole))
    impulse = rising[:-1] + falling[1:]
    load = (products[1:] + products[:-1]) / 2
    cost = 0.0
    for moved, causes in (
        (np.diff(rate, axis=0), np.hstack([impulse, load, (up[1:] + up[:-1]) / 2, np.ones((len(load), 1))])),
        (motion.acceleration[piece], np.hstack([whole, products, np.ones((len(rate), 1))])),
    ):
        size = np.sqrt((causes**2).sum(0))
        basis, _ = np.linalg.qr(causes[:, size > 0] / size[size > 0])
        left = moved - basis @ (basis.T @ moved)
        cost += len(moved) * float(np.log((left**2).mean(0) + 1e-300).sum())
    return cost


class _Move(NamedTuple):
    """By how much a fit would move the unknowns, and one sigma of each, cycles; chi-square before and after."""

    steps: Array
    sigmas: Array
    correlation: float
    before: float
    after: float


def _first(samples: Samples, cycles: slice, vehicle: Vehicle) -> Reference | None:
    """What a fit may begin about; None where nothing tells, or what is told runs away."""
    try:
        return first_reference(samples, cycles, vehicle) if cycles.stop - cycles.start > 20 else None
    except np.linalg.LinAlgError:
        return None


def _move(log: Log, vehicle: Resolved, pieces: Sequence[slice], now: Timing, unknown: Sequence[str]) -> _Move | None:
    """The move from ``now`` that fits best, pooled over pieces; None where no piece can tell."""
    size = len(unknown)
    sides = [tuple(now.moved([name], [sign * STEP]) for sign in (-1, 1)) for name in unknown]
    try:
        at = {timing: timing.of(log, vehicle) for timing in {now, *(side for pair in sides for side in pair)}}
    except InputError:
        return None
    first = max(int(np.argmax(samples.executed.usable)) for samples in at.values())
    information, moment = np.zeros((size, size)), np.zeros(size)
    before = after = 0.0
    rows = 0
    for piece in pieces:
        cycles = slice(max(piece.start, first), piece.stop)
        reference = _first(at[now], cycles, vehicle)
        if reference is None:
            continue
        plain = fit(at[now], cycles, reference, vehicle, passes=PASSES)
        if plain is None:
            continue  # a response that runs away tells nothing
        changes = [_change(at[low], at[high], (low, high), cycles, plain.reference, vehicle) for low, high in sides]
        jets = _of_jets(log, at[now], cycles, plain.reference, vehicle)
        growth, force = (np.concatenate([*each, own], -1) for each, own in zip(zip(*changes, strict=True), jets, strict=True))
        extra = Extra(growth, force, np.repeat([PRIOR, 1.0], [size, growth.shape[-1] - size]))
        moved = fit(at[now], cycles, plain.reference, vehicle, extra, passes=0)
        if moved is None:
            continue
        spread = moved.extra_covariance[:size, :size] * max(moved.chi_square, 1.0)
        if np.linalg.eigvalsh(spread)[0] < SHARPEST**2:
            continue
        count = cycles.stop - cycles.start
        before, after, rows = before + count * plain.chi_square, after + count * moved.chi_square, rows + count
        part = np.linalg.inv(spread)
        information = information + part
        moment = moment + part @ moved.extra[:size]
    if rows == 0:
        return None
    covariance = np.linalg.inv(information)
    sigmas = np.sqrt(np.diag(covariance))
    correlation = float(covariance[0, 1] / (sigmas[0] * sigmas[1])) if size == 2 else 0.0
    return _Move(covariance @ moment, sigmas, correlation, before / rows, after / rows)


def _of_jets(log: Log, samples: Samples, cycles: slice, reference: Reference, vehicle: Resolved) -> tuple[Array, Array]:
    """What is uncertain of single jets does by one sigma of each: (K − 1, 3, g) rad/s and (K, 3, g) m/s².

    Taken as exact it would move the timing, by far more than its sigma.
    """
    changes = uncertain_jets(vehicle) if log.command_kind == "jets" else Wrenches()
    if not changes.kinds:
        count = cycles.stop - cycles.start
        return np.zeros((count - 1, 3, 0)), np.zeros((count, 3, 0))
    return wrench_columns(samples, cycles, reference, vehicle, lifted(samples, cycles, reference, vehicle), changes)


def _change(
    early: Samples, late: Samples, between: tuple[Timing, Timing], cycles: slice, reference: Reference, vehicle: Vehicle
) -> tuple[Array, Array]:
    """Derivative of the response, (K − 1, 3, 1) and (K, 3, 1), per cycle of what differs between two timings."""
    step = sum(between[1]) - sum(between[0])
    (growth_early, push_early), (growth_late, push_late) = (response(s, cycles, reference, vehicle) for s in (early, late))
    return (growth_late - growth_early)[..., None] / step, (push_late - push_early)[..., None] / step
