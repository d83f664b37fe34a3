"""The assumptions that an estimate rests on, and how each is varied: by a percent, a millimetre, a degree, a tenth of a cycle."""

from __future__ import annotations

from collections.abc import Iterator

from massprop_cli.conclude import supply
from massprop_cli.conclude.assumedvalue import AssumedValue
from massprop_cli.errorparameters.parameter import ErrorParameter, Step
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import TABLE
from massprop_cli.model.sensitivity import variant
from massprop_cli.prepare.stream import Stream


def assumed(setup: Setup, samples: Stream, more: bool = False) -> Iterator[AssumedValue]:
    """What is varied, each about the log as it was read; ``more`` of it where something else than noise is left."""
    for one in TABLE:
        if one.step is not None and one.step.applies(setup):
            yield from _steps(one, one.step, setup, samples)
    if more and setup.log.command_kind == "jets":
        yield from supply.memory(setup, samples)


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
            yield AssumedValue(step.code, said, step.words.format(axis=axis), stated, changed, step.size, sigma, step.most, step.part_of)
    if step.by_axis != "alone":
        yield AssumedValue(step.code, message.format(along=""), step.words, stated, None, step.size)
