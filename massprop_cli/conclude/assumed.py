"""Assumed values of a vehicle file, and the step by which the sensitivity analysis varies each of them."""

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
"""Relative loss of thrust in the finite difference."""
SUPPLY_MEMORIES_S = (0.3, 1.0, 3.0)
"""Tested time constants of the supply's recovery, s."""
REST_S = 1.0
"""Time constant in which a resting jet cools or its line empties, s."""


@dataclass(frozen=True)
class AssumedValue:
    """An assumption and its variation."""

    code: str
    message: str
    step: str
    """Step in words."""
    stated: bool
    """Whether the vehicle file states the value; else it is a default."""
    variant: Variant | Reading | None
    """Derivative per unit. None: the parts have it, or the columns behind all variants."""
    size: float
    """Size of one step, units."""
    sigma: float = 0.0
    """Stated sigma, units."""
    most: float = np.inf
    """Largest possible error, units. A log whose sigma of it is larger does not test it."""
    part_of: str = ""
    """Code of the assumption that reports the effect; this one is tested only."""
    rare: bool = False
    """Whether few vehicle files have this error."""

    @property
    def reported_code(self) -> str:
        """Code of the assumption that reports the effect."""
        return self.part_of or self.code


def assumed_values(setup: Setup, samples: Stream, misfit: bool = False) -> Iterator[AssumedValue]:
    """Assumptions that apply to a log and its vehicle; with a ``misfit``, also the memory of the thrust."""
    for one in TABLE:
        if one.step is not None and one.step.applies(setup):
            yield from _steps(one, one.step, setup, samples)
    if misfit and setup.log.command_kind == "jets":
        yield from thrust_memory(setup, samples)


def _steps(one: ErrorParameter, step: Step, setup: Setup, samples: Stream) -> Iterator[AssumedValue]:
    """Yield the assumption of each axis of a parameter; or its parts by axis, then the whole."""
    stated, message = one.stated_in(setup), step.message(setup)
    sigma = one.sigma(setup.vehicle) if one.considered else 0.0
    for i, axis in enumerate("" if step.by_axis == "columns" else step.axes[: one.size]):
        changed = variant(one, setup, samples, i)
        if changed is None:
            continue
        if step.by_axis == "parts":
            text = message.format(along=f" along {axis}")
            yield AssumedValue(f"{step.code} {axis}", text, step.words, stated, changed, step.size, part_of=step.code)
        else:
            text = message.format(axis=axis)
            words = step.words.format(axis=axis)
            yield AssumedValue(step.code, text, words, stated, changed, step.size, sigma, step.most, step.part_of, step.rare)
    if step.by_axis != "alone":
        yield AssumedValue(step.code, message.format(along=""), step.words, stated, None, step.size)


def thrust_memory(setup: Setup, samples: Stream) -> Iterator[AssumedValue]:
    """Dependence of the thrust on earlier commands: it falls with recent use of the supply, or after a jet's rest.

    Most of such an error is a factor common to all thrust, which biases mass and inertia and does not show in a log. The rest correlates
    with the commands; an estimated disturbance would treat it as noise. A weaker pulse is modelled as a shorter one of the same impulse.
    """
    log, vehicle, timing = setup[:3]
    of_supply = {f"thrust after use in the last {memory_s:g} s": _use(log, vehicle, memory_s)[:, None] for memory_s in SUPPLY_MEMORIES_S}
    for name, factor in (of_supply | {"thrust after rest": _rest(log, vehicle)}).items():
        weaker = OtherReading(Stream.of(replace(log, command=log.command * (1 - STEP * factor)), vehicle, timing))
        yield AssumedValue(name, name, "1 %", False, Variant(OtherReading(samples), weaker, STEP), STEP, part_of=DROOP)


def _use(log: Log, vehicle: Vehicle, memory_s: float) -> Array:
    """(M,) impulse of all jets before each command, decaying with the time constant ``memory_s``, over its maximum."""
    impulses = log.command @ np.linalg.norm(vehicle.jet_wrench[:, 3:], axis=1)
    decays = np.exp(-np.diff(log.command_start_s, prepend=-np.inf) / memory_s).tolist()
    level, use = 0.0, np.empty(len(impulses))
    for k, impulse in enumerate(impulses.tolist()):
        use[k] = level = decays[k] * level
        level += impulse
    return use / max(float(use.max()), np.finfo(float).tiny)


def _rest(log: Log, vehicle: Vehicle) -> Array:
    """(M, C) rest of each jet before each command: from 0 right after a pulse to 1 after a long pause."""
    start_s = log.command_start_s[:, None]
    last = np.maximum.accumulate(np.where(log.command > 0, start_s, -np.inf), axis=0)
    before = np.vstack([np.full((1, last.shape[1]), -np.inf), last[:-1]])
    return np.asarray(-np.expm1(-np.maximum(start_s - before - vehicle.cycle.period_s, 0.0) / REST_S))
