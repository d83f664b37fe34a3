"""A recording whose streams have clocks of their own, put on records and control cycles as its map states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample, units
from massprop_cli.inputs.formats.mapfile import Records
from massprop_cli.inputs.formats.onrows import wrenches
from massprop_cli.inputs.formats.signals import GAP, Signal, Signals

LOST = 1.5
"""Times the usual interval: more is told of as a lost sample, even where it is no gap."""
_LIKE = 0.2
"""Commands that come as often as control cycles, to this part of a cycle, begin them."""
_SAME = 1e-3
"""Part of a gyro sample by which instants may differ that are the same: clocks are rounded."""
_STAMPED = 0.15
"""Of a cycle, by which stamps of commands may scatter that come once in each: a controller's commands act in step with its cycles."""
_EARLY = 0.25
"""Of a cycle: an on-time stamped so much before a cycle begins is still that cycle's."""


@dataclass(frozen=True)
class _Command:
    """One commanded quantity."""

    signal: Signal
    holds: resample.Holds
    names: tuple[str, ...]
    kind: str
    """mean, on_time or share (of a cycle)."""


def columns_of(signals: Signals, records: Records) -> dict[str, Array]:
    """The log's columns by the contract's names; :class:`massprop_cli.base.errors.InputError` where nothing was recorded in between."""
    said = signals.map
    gyro = signals.sensor("gyro", said.gyro, units.RATE, units.ANGLE)
    accelerometer = signals.sensor("accelerometer", said.accelerometer, units.ACCELERATION, units.SPEED)
    attitude = None if said.attitude is None else signals.attitude(said.attitude)
    commands, instants = _commands(signals, attitude), _instants(signals)
    slow = [*([] if attitude is None else [attitude]), *(signal for signal, _ in instants)]
    spans = [_Span(gyro, resample.knots(gyro.times.s, said.gyro.values))]
    spans += [_Span(accelerometer, resample.knots(accelerometer.times.s, said.accelerometer.values))]
    spans += [_Span(signal, signal.times.s) for signal in slow]
    spans += [_Span(each.signal, resample.span(each.signal.times.s, each.holds)) for each in commands if each.signal.paths]
    edges = _edges(signals, records, spans, [command.signal for command in commands])
    _check(signals, edges, [gyro, accelerometer], slow)
    zero = edges[0] if records.zero == "start" else 0.0
    made: dict[str, Array] = {columns.TIME: edges[1:] - zero}
    length = median(np.diff(edges))
    if zero:
        signals.made.append(f"time_s counts from {edges[0] + gyro.times.zero_s:.13g} s by {gyro.times.path!r}")
    for signal, kind, names in (
        (gyro, said.gyro.values, columns.DELTA_THETA),
        (accelerometer, said.accelerometer.values, columns.DELTA_V),
    ):
        found = resample.increments(signal.values, signal.times.s, kind, edges)
        made |= dict(zip(names, found.T, strict=True))
        signals.made.append(
            f"{signal.key}: {len(signal.values)} values ({kind}) every {signal.times.step_s:.6g} s by {signal.times.path!r}, "
            f"{'summed' if kind == 'increment' else 'integrated'} over {len(edges) - 1} records of {length:.6g} s"
        )
    if attitude is not None and said.attitude is not None:
        turned = resample.z_up(resample.attitude_at(attitude.values, attitude.times.s, edges[1:]), said.attitude.world)
        made |= dict(zip(columns.QUATERNION, turned.T, strict=True))
        signals.made.append(f"attitude: every {attitude.times.step_s:.6g} s, interpolated to the records' ends")
    for signal, column in instants:
        made[column] = np.interp(edges[1:], signal.times.s, signal.values[:, 0])
        signals.made.append(f"{signal.key}: every {signal.times.step_s:.6g} s, interpolated to the records' ends")
    cycles = edges[:: records.per_cycle]
    for command in commands:
        values = _on_cycles(signals, command, cycles)
        made |= dict(zip(command.names, np.repeat(values, records.per_cycle, 0).T, strict=True))
    return made


def _commands(signals: Signals, attitude: Signal | None) -> list[_Command]:
    found = []
    for key, wrench, known, names in wrenches(signals):
        signal = signals.wrench(key, wrench, known)
        if wrench.frame == "world" and attitude is not None:
            at = resample.attitude_at(attitude.values, attitude.times.s, signal.times.s)
            signal = replace(signal, values=resample.into_body(signal.values, at))
            signals.made.append(f"{key}: turned from world into body axes with the logged attitude at each command's time")
        found.append(_Command(signal, wrench.holds, names, "mean"))
    for name, jet in signals.map.jets.items():
        signal, share = signals.jet(name, jet)
        found.append(_Command(signal, jet.holds, (columns.jet(name),), "share" if share else "on_time"))
    found += [_Command(signal, holds, (column,), "mean") for signal, column, kind, holds in signals.spinners() if kind == "mean"]
    return found


def _instants(signals: Signals) -> list[tuple[Signal, str]]:
    """What is read off at the ends of records, with its column."""
    return [(signal, column) for signal, column, kind, _ in signals.spinners() if kind == "instant"]


@dataclass(frozen=True)
class _Span:
    """When a signal is there."""

    signal: Signal
    at_s: Array


def _edges(signals: Signals, records: Records, spans: Sequence[_Span], commands: Sequence[Signal]) -> Array:
    """Where records begin and end, whole control cycles of them within all streams; the gyro's span is the first."""
    gyro, knots = spans[0].signal, spans[0].at_s
    first, last = max(spans, key=lambda one: one.at_s[0]), min(spans, key=lambda one: one.at_s[-1])
    late, early = first.signal, last.signal
    start, end = float(first.at_s[0]), float(last.at_s[-1])
    if start >= end:
        raise signals.error(
            f"{late.key}.clock",
            late.times.path,
            f"two clocks don't overlap: {late.key} is {late.times.span()}, {early.key} {early.times.span()}; "
            "mend clock.unit, or state the clock.offset_s between them",
        )
    zero = gyro.times.zero_s
    start = start if records.start_s is None else max(start, records.start_s - zero)
    end = end if records.end_s is None else min(end, records.end_s - zero)
    length = records.interval_s or (records.samples or 1) * gyro.times.step_s
    cycle = length * records.per_cycle
    driving = next((one.times for one in commands if abs(one.times.step_s / cycle - 1) < _LIKE), None)
    slack = _SAME * gyro.times.step_s
    if driving is not None and (driving.s >= start - slack).any():
        start = _begun(driving.s[driving.s >= start - slack], start - slack, cycle)
        signals.made.append(f"control cycles begin with the first command by {driving.path!r}, at {start + zero:.13g} s")
    if records.samples is None:
        edges = start + length * np.arange(max(int((end - start + slack) / length), 0) + 1)
    else:
        # commands are stamped with less care than a cycle is long; without any, nothing before the start is taken
        near = int(np.argmin(np.abs(knots - start))) if driving is not None else int(np.searchsorted(knots, start - slack))
        edges = knots[near :: records.samples]
        edges = edges[edges <= end + slack]
    whole = (len(edges) - 1) // records.per_cycle * records.per_cycle
    if whole < 2 * records.per_cycle:
        raise signals.error(
            "records",
            gyro.times.path,
            f"from {start + zero:.13g} to {end + zero:.13g} s, where all streams are there, are not two control cycles of {cycle:.6g} s; "
            f"gyro is {gyro.times.span()}, {early.key} {early.times.span()}, {late.key} {late.times.span()}",
        )
    return edges[: whole + 1]


def _check(signals: Signals, edges: Array, sensors: Sequence[Signal], slow: Sequence[Signal]) -> None:
    """Sensors must be at least as fast as records, and nothing may have a gap."""
    length = median(np.diff(edges))
    for signal in sensors:
        if signal.paths and signal.times.step_s > 1.01 * length:
            raise signals.error(
                signal.key,
                signal.paths[0],
                f"comes every {signal.times.step_s:.6g} s; records of {length:.6g} s would be made up. Make records at least as long",
            )
    for signal in (*sensors, *slow):
        times = signal.times
        inside = times.s[(times.s >= edges[0]) & (times.s <= edges[-1])]
        if not signal.paths:
            continue
        steps = np.diff(inside)
        lost = np.flatnonzero(steps > LOST * times.step_s)
        wide = lost[(steps[lost] > length) & (steps[lost] > GAP * times.step_s)]
        if wide.size:
            at = inside[wide[0]]
            raise signals.error(
                signal.key,
                signal.paths[0],
                f"a gap of {steps[wide[0]]:.6g} s after {at + times.zero_s:.13g} s (usual interval {times.step_s:.6g} s); "
                "take one side of it with records.start_s or end_s",
            )
        if lost.size:
            signals.made.append(
                f"{signal.key}: {lost.size} gap(s) of up to {steps[lost].max():.6g} s, shorter than a record, are bridged evenly; "
                f"the first after {inside[lost[0]] + times.zero_s:.13g} s"
            )


def _on_cycles(signals: Signals, command: _Command, cycles: Array) -> Array:
    """(K, n) the command of each control cycle."""
    signal, step, length = command.signal, command.signal.times.step_s, median(np.diff(cycles))
    said = f"{signal.key}: {len(signal.values)} values every {step:.6g} s by {signal.times.path!r}"
    if command.kind == "on_time":
        count, first = resample.in_each(signal.times.s, cycles, _EARLY)
        wrong = np.flatnonzero(count != 1)
        if wrong.size:
            at = cycles[wrong[0]] + signal.times.zero_s
            raise signals.error(
                signal.key,
                signal.paths[0],
                f"{count[wrong[0]]} on-times in the control cycle of {length:.6g} s at {at:.13g} s; one each is wanted: mend [records], "
                'or unit = "open" if this is the state of a valve',
            )
        apart = np.abs(signal.times.s[first] - cycles[:-1]).max()
        signals.made.append(f"{said}, one in each control cycle, stamped up to {apart:.3g} s from its beginning")
        return signal.values[first]
    if not signal.paths:
        signals.made.append(f"{signal.key}: taken as {', '.join(f'{v:g}' for v in signal.values[0])} throughout, as the map states")
        return np.repeat(signal.values[:1], len(cycles) - 1, 0)
    times, scatter = _in_step(signal.times.s, cycles) if command.holds == "until_next" else (signal.times.s, 0.0)
    if scatter > 0:
        said += f", one in each control cycle, whose stamps scatter by up to {scatter:.3g} s and are taken as evenly spaced"
    found = resample.means(signal.values, times, command.holds, cycles)
    how = "held until the next" if command.holds == "until_next" else "each over the time since the last"
    signals.made.append(f"{said}, {how}; of each of {len(cycles) - 1} control cycles of {length:.6g} s the mean")
    return found * np.diff(cycles)[:, None] if command.kind == "share" else found


def _begun(times_s: Array, least_s: float, cycle_s: float) -> float:
    """When cycles begin that commands begin: with the first stamp, or where the median of stamps that scatter puts it."""
    first = float(times_s[0])
    off = (times_s - first + cycle_s / 2) % cycle_s - cycle_s / 2
    usual = median(off)
    if abs(usual) < _SAME * cycle_s or float(np.abs(off - usual).max()) > _STAMPED * cycle_s:
        return first
    return first + usual if first + usual >= least_s else first + usual + cycle_s


def _in_step(times_s: Array, cycles: Array) -> tuple[Array, float]:
    """When commands act of which there is one in each cycle, by their stamps: as far into each cycle as in the median; and the scatter.

    As they are stamped, and 0, where there isn't one in each, or they scatter by too much. So little into a cycle as may be chance is none.
    """
    count, first = resample.in_each(times_s, cycles, _EARLY)
    if (count != 1).any():
        return times_s, 0.0
    into = times_s[first] - cycles[:-1]
    usual, length = median(into), median(np.diff(cycles))
    scatter = float(np.abs(into - usual).max())
    if scatter > _STAMPED * length:
        return times_s, 0.0
    chance = max(4 * float(into.std()) / len(into) ** 0.5, _SAME * length)
    even = times_s.copy()
    even[first] = cycles[:-1] + (usual if abs(usual) > chance else 0.0)
    # those before and after follow on, where they are of the same kind
    for edge, beyond, step in ((first[0], first[0] - 1, -length), (first[-1], first[-1] + 1, length)):
        if 0 <= beyond < len(even) and abs(times_s[beyond] - times_s[edge] - step) < 2 * _STAMPED * length:
            even[beyond] = even[edge] + step
    return even, scatter if scatter > _SAME * length else 0.0
