"""Thrust that remembers: what comes of one supply falls with all that was taken from it, and a jet that has rested may give less.

Most of such an error is a factor common to all thrust, which no log tells: mass and inertia are as far off. The rest of it goes with the
commands, and a disturbance that stands for it as noise leaves values converged that are off by per cents.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.conclude.assumedvalue import AssumedValue
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.sensitivity import Side, Variant
from massprop_cli.prepare.stream import Stream

DROOP = "thrust-droop"
STEP = 0.01
"""Part of its thrust that a jet loses, behind the derivative."""
MEMORIES_S = (0.3, 1.0, 3.0)
"""How long a supply may remember what was taken from it."""
RESTED_S = 1.0
"""After how long a jet may have cooled, or its line emptied."""


def memory(setup: Setup, samples: Stream) -> Iterator[AssumedValue]:
    """Thrust that falls with what was taken before, or that is less after a rest: tested where something else than noise is left.

    A pulse that gives less is taken for a shorter one, which is as much less, and ends but little sooner.
    """
    log, vehicle, timing = setup[:3]
    of_supply = {f"thrust after use in the last {memory_s:g} s": _use(log, vehicle, memory_s)[:, None] for memory_s in MEMORIES_S}
    for what, factor in (of_supply | {"thrust after rest": _rest(log, vehicle)}).items():
        less = Side(Stream.of(replace(log, command=log.command * (1 - STEP * factor)), vehicle, timing))
        yield AssumedValue(what, what, "1 %", False, Variant(Side(samples), less, STEP), STEP, part_of=DROOP)


def _use(log: Log, vehicle: Vehicle, memory_s: float) -> Array:
    """(K,) what all jets took before each cycle, forgotten in so many seconds, over the most."""
    taken = log.command @ np.linalg.norm(vehicle.jet_wrench[:, 3:], axis=1)
    kept, held, found = float(np.exp(-vehicle.cycle.period_s / memory_s)), 0.0, np.empty(len(taken))
    for k, now in enumerate(taken.tolist()):
        found[k], held = held, kept * held + now
    return found / max(float(found.max()), np.finfo(float).tiny)


def _rest(log: Log, vehicle: Vehicle) -> Array:
    """(K, C) how far each jet has rested before each cycle: 0 where it has just fired, 1 after long."""
    count = len(log.command)
    cycle = np.arange(count)[:, None]
    last = np.maximum.accumulate(np.where(log.command > 0, cycle, -count), axis=0)
    before = np.vstack([np.full((1, last.shape[1]), -count), last[:-1]])
    found: Array = -np.expm1(-(cycle - before - 1) * vehicle.cycle.period_s / RESTED_S)
    return found
