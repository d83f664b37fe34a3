"""The assumed values of a vehicle file, and by how much each is varied: one percent, millimetre, degree or tenth of a cycle."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.errorparameters.parameter import ErrorParameter, Step
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import TABLE
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.sensitivity import OtherReading, Reading, Variant, variant
from massprop_cli.prepare.stream import Stream

DROOP = "thrust-droop"
STEP = 0.01
"""Part of its thrust that a jet loses, behind the derivative."""
MEMORIES_S = (0.3, 1.0, 3.0)
"""How long a supply may remember what was taken from it."""
RESTED_S = 1.0
"""After how long a jet may have cooled, or its line emptied."""


@dataclass(frozen=True)
class AssumedValue:
    """An assumption, and how it is varied: ``size`` units make one step."""

    code: str
    message: str
    step: str
    stated: bool
    variant: Variant | Reading | None
    """None: of its parts, or of the columns that follow all variants."""
    size: float
    sigma: float = 0.0
    """One sigma, units, by which it is stated to be uncertain."""
    most: float = np.inf
    """Units by which it may be off at most: of a log that tells it no better than that, it is not tested."""
    part_of: str = ""
    """Code of that which it is a part of, whose effect is told: it is but tested by itself."""
    rare: bool = False
    """Whether few vehicle files are wrong in it."""

    @property
    def whole(self) -> str:
        """Code of what is told."""
        return self.part_of or self.code


def assumed(setup: Setup, samples: Stream, more: bool = False) -> Iterator[AssumedValue]:
    """What is varied, each about the log as it was read; ``more`` of it where something else than noise is left."""
    for one in TABLE:
        if one.step is not None and one.step.applies(setup):
            yield from _steps(one, one.step, setup, samples)
    if more and setup.log.command_kind == "jets":
        yield from memory(setup, samples)


def _steps(one: ErrorParameter, step: Step, setup: Setup, samples: Stream) -> Iterator[AssumedValue]:
    """Of each axis of a parameter, or of its parts and then of all together."""
    stated, message = one.stated_in(setup), step.message(setup)
    sigma = one.sigma(setup.vehicle) if one.considered else 0.0
    for i, axis in enumerate("" if step.by_axis == "columns" else step.axes[: one.size]):
        changed = variant(one, setup, samples, i)
        if changed is None:
            continue
        if step.by_axis == "parts":
            said = message.format(along=f" along {axis}")
            yield AssumedValue(f"{step.code} {axis}", said, step.words, stated, changed, step.size, part_of=step.code)
        else:
            said = message.format(axis=axis)
            words = step.words.format(axis=axis)
            yield AssumedValue(step.code, said, words, stated, changed, step.size, sigma, step.most, step.part_of, step.rare)
    if step.by_axis != "alone":
        yield AssumedValue(step.code, message.format(along=""), step.words, stated, None, step.size)


def memory(setup: Setup, samples: Stream) -> Iterator[AssumedValue]:
    """Thrust that remembers: it falls with what was taken from its supply before, or a jet that has rested gives less.

    Tested where something else than noise is left. Most of such an error is a factor common to all thrust, which no log tells: mass and
    inertia are as far off. The rest goes with the commands, and a disturbance that stands for it as noise leaves values converged that are
    off by per cents. A pulse that gives less is taken for a shorter one, which is as much less, and ends but little sooner.
    """
    log, vehicle, timing = setup[:3]
    of_supply = {f"thrust after use in the last {memory_s:g} s": _use(log, vehicle, memory_s)[:, None] for memory_s in MEMORIES_S}
    for what, factor in (of_supply | {"thrust after rest": _rest(log, vehicle)}).items():
        less = OtherReading(Stream.of(replace(log, command=log.command * (1 - STEP * factor)), vehicle, timing))
        yield AssumedValue(what, what, "1 %", False, Variant(OtherReading(samples), less, STEP), STEP, part_of=DROOP)


def _use(log: Log, vehicle: Vehicle, memory_s: float) -> Array:
    """(M,) what all jets took before each command, forgotten in so many seconds, over the most."""
    taken = log.command @ np.linalg.norm(vehicle.jet_wrench[:, 3:], axis=1)
    kept = np.exp(-np.diff(log.command_start_s, prepend=-np.inf) / memory_s).tolist()
    held, found = 0.0, np.empty(len(taken))
    for k, now in enumerate(taken.tolist()):
        found[k] = held = kept[k] * held
        held += now
    return found / max(float(found.max()), np.finfo(float).tiny)


def _rest(log: Log, vehicle: Vehicle) -> Array:
    """(M, C) how far each jet has rested before each command: 0 where it has just fired, 1 after long."""
    start_s = log.command_start_s[:, None]
    last = np.maximum.accumulate(np.where(log.command > 0, start_s, -np.inf), axis=0)
    before = np.vstack([np.full((1, last.shape[1]), -np.inf), last[:-1]])
    return np.asarray(-np.expm1(-np.maximum(start_s - before - vehicle.cycle.period_s, 0.0) / RESTED_S))
