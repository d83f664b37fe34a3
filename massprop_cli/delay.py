"""The delay from command to execution, as the log shows it.

A coarse search over whole cycles asks which alignment lets commands explain the motion at all; from there the delay is one more unknown of
the fit (:mod:`massprop_cli.fit`), its derivative a difference of two alignments, until it stands still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from massprop_cli.align import align
from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples, acceleration, compensate
from massprop_cli.errors import InputError
from massprop_cli.fit import PASSES, Extra, fit, response
from massprop_cli.plant import Reference
from massprop_cli.start import first_reference
from massprop_cli.telemetry import Log, Notice
from massprop_cli.vehicle import Vehicle

LONGEST = 20
"""Cycles searched."""
STEP = 0.02
"""Cycles; half the difference behind the derivative."""
PRIOR = 1.0
"""Cycles; one sigma of what a single step may change."""
STEPS = 6
SETTLED = 1e-3
"""Cycles."""
EXPLAINED = 0.5
"""... and if the delay found leaves at most this part of the misfit."""
MISMATCH = (0.1, 5.0)
"""A stated delay is contradicted if it is off by this many cycles and this many sigmas."""


@dataclass(frozen=True)
class Delay:
    """A delay found in the log."""

    cycles: float
    sigma: float
    chi_square: float
    """Mean squared residual over stated noise of the fit there."""
    chi_square_before: float
    """The same at the delay from which the search began."""


def detect(log: Log, vehicle: Vehicle, pieces: Sequence[slice], start: float, references: Sequence[Reference] = ()) -> Delay | None:
    """The delay from the log, from ``start`` on, pooled over ``pieces`` (cycles of each phase). None where the log can't tell.

    Noise levels must be set in ``vehicle``. With ``references`` of the pieces ``start`` is a stated delay to be checked: if it is right
    within the tolerance no last digit is sought, and if it is far off the search begins anew.
    """
    checked = bool(references)
    found = _shift(log, vehicle, pieces, start, references)
    if found is None:
        return None
    before = found.before
    now = start + found.cycles
    if not checked or abs(found.cycles) > MISMATCH[0]:
        now = (search(log, vehicle, pieces) or 0.0) if checked else now
        for _ in range(STEPS):
            found = _shift(log, vehicle, pieces, max(now, 0.0), ())
            if found is None:
                return None
            step = float(np.clip(found.cycles, -0.5, 0.5))
            now = max(now + step, 0.0)
            if abs(step) < SETTLED:
                break
    return Delay(max(now, 0.0), found.sigma, found.after, before) if found.sigma < PRIOR / 2 else None


def mismatch(stated: float, found: Delay | None) -> list[Notice]:
    """A warning if the log contradicts the stated delay, from which ``found`` was sought."""
    if found is None or abs(found.cycles - stated) <= max(MISMATCH[0], MISMATCH[1] * found.sigma):
        return []
    if found.chi_square - 1 > EXPLAINED * (found.chi_square_before - 1):
        return []  # some other fault, which a shift makes hardly better
    message = (
        f"cycle.command_delay_cycles = {stated:g}, but the log shows {found.cycles:.3g} ± {found.sigma:.2g} cycles; "
        "mend it, or let --delay auto find it. A lag of the thrust that isn't stated looks the same"
    )
    return [Notice("delay-mismatch", message)]


def search(log: Log, vehicle: Vehicle, pieces: Sequence[slice] | None = None) -> float | None:
    """The whole number of cycles at which a plain regression of motion on commands leaves least; over the whole log without ``pieces``."""
    costs = []
    for delay in range(min(LONGEST, log.cycles // 4) + 1):
        try:
            samples = compensate(align(log, vehicle, float(delay)), vehicle)
        except InputError:
            break
        parts = [_unexplained(samples, p, vehicle) for p in pieces or [slice(0, log.cycles)] if p.stop - p.start > LONGEST + 30]
        costs.append(float(np.sum(parts)) if parts else np.inf)
    return float(np.argmin(costs)) if costs and np.isfinite(min(costs)) else None


def _unexplained(samples: Samples, piece: slice, vehicle: Vehicle) -> float:
    """Log of what is left of rate growth and acceleration when both are regressed on impulses, with nothing known of the body."""
    piece = slice(piece.start + LONGEST, piece.stop)  # the same cycles whatever the delay
    executed = samples.executed
    rate = samples.rate_rad_s[piece]
    products = rate[:, [0, 0, 0, 1, 1, 2]] * rate[:, [0, 1, 2, 1, 2, 2]]
    impulse = executed.rising[piece][:-1] + executed.falling[piece][1:]
    load = (products[1:] + products[:-1]) / 2
    up = (samples.up_b[:-1][piece][1:] + samples.up_b[1:][piece][:-1]) / 2
    cost = 0.0
    for motion, causes in (
        (np.diff(rate, axis=0), np.hstack([impulse, load, up, np.ones((len(load), 1))])),
        (acceleration(samples, vehicle)[piece], np.hstack([executed.impulse[piece], products, np.ones((len(rate), 1))])),
    ):
        size = np.sqrt((causes**2).sum(0))
        basis, _ = np.linalg.qr(causes[:, size > 0] / size[size > 0])
        left = motion - basis @ (basis.T @ motion)
        cost += len(motion) * float(np.log((left**2).mean(0) + 1e-300).sum())
    return cost


class _Shift(NamedTuple):
    """By how much a fit would move the delay, and one sigma, cycles; chi-square before and after."""

    cycles: float
    sigma: float
    before: float
    after: float


def _shift(log: Log, vehicle: Vehicle, pieces: Sequence[slice], delay: float, references: Sequence[Reference]) -> _Shift | None:
    """The move from ``delay`` that fits best, pooled over pieces; None where no piece can tell."""
    low, high = max(delay - STEP, 0.0), delay + STEP
    at = {d: compensate(align(log, vehicle, d), vehicle) for d in {low, delay, high}}
    weight = moment = before = after = 0.0
    rows = 0
    for i, piece in enumerate(pieces):
        first = int(np.argmax(at[high].executed.usable))
        cycles = slice(max(piece.start, first), piece.stop)
        reference = (
            references[i] if references else first_reference(at[delay], cycles, vehicle) if cycles.stop - cycles.start > 20 else None
        )
        if reference is None:
            continue
        plain = fit(at[delay], cycles, reference, vehicle, passes=0 if references else PASSES)
        reference = plain.reference
        (early, push_early), (late, push_late) = (response(at[d], cycles, reference, vehicle) for d in (low, high))
        change = Extra(_column(late - early, high - low), _column(push_late - push_early, high - low), PRIOR)
        shifted = fit(at[delay], cycles, reference, vehicle, change, passes=0)
        if not np.isfinite(plain.chi_square + shifted.chi_square):
            continue
        count = cycles.stop - cycles.start
        before, after, rows = before + count * plain.chi_square, after + count * shifted.chi_square, rows + count
        variance = float(shifted.extra_covariance[0, 0]) * max(shifted.chi_square, 1.0)
        if variance > 0:
            weight += 1 / variance
            moment += float(shifted.extra[0]) / variance
    return _Shift(moment / weight, float(np.sqrt(1 / weight)), before / rows, after / rows) if weight > 0 else None


def _column(difference: Array, step: float) -> Array:
    column: Array = difference[..., None] / step
    return column
