"""A recording whose streams have clocks of their own, put on records and control cycles as its map states."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample
from massprop_cli.inputs.formats.clocks import GAP
from massprop_cli.inputs.formats.mapfile import Records
from massprop_cli.inputs.formats.onrows import wrenches
from massprop_cli.inputs.formats.signals import QuantitySignal, Signals

LOST = 1.5
"""Times the usual interval: more is told of as a lost sample, even where it is no gap."""
_LIKE = 0.2
"""Commands that come as often as control cycles, to this part of a cycle, begin them."""
ENOUGH = 4.5
"""Readings in a control cycle of a speed whose torque changes once in it, so that speeds made up between them move no result: of ten clean
logs with 4.85 none, with 4 one in four, and with 3 all."""
STEADY = 0.2
"""Part of the changes from reading to reading by which these change themselves, below which no torque steps in between."""
SAME = 1e-3
"""Part of a gyro sample by which instants may differ that are the same: clocks are rounded."""
STAMPED = 0.15
"""Of a cycle, by which stamps of commands may scatter that come once in each: a controller's commands act in step with its cycles."""
AJAR = 0.1
"""A valve that is on is open farther than this, at least once in a recording."""
_CHANGES, _TOGETHER = 8, 0.7
"""Changes of commands that tell where cycles begin, at least, and the part of them that come so far into a cycle, to a record."""
_EARLY = 0.25
"""Of a cycle: an on-time stamped so much before a cycle begins is still that cycle's."""


@dataclass(frozen=True)
class StreamCommand:
    """One commanded quantity."""

    signal: QuantitySignal
    holds: resample.Holds
    names: tuple[str, ...]
    kind: str
    """mean, on_time or share (of a cycle)."""


@dataclass(frozen=True)
class Streams:
    """What a log is made of."""

    imu: Sequence[tuple[QuantitySignal, resample.Values]]
    """Gyro, and the accelerometer where the map has one; each with what its numbers are."""
    commands: Sequence[StreamCommand]
    attitude: QuantitySignal | None
    instants: Sequence[tuple[QuantitySignal, str]]
    signals: Signals

    @property
    def gyro(self) -> QuantitySignal:
        """The first of them."""
        return self.imu[0][0]

    @property
    def slow(self) -> list[QuantitySignal]:
        """Those that are read off at records' ends."""
        return [*([] if self.attitude is None else [self.attitude]), *(signal for signal, _ in self.instants)]

    @property
    def unbroken(self) -> list[QuantitySignal]:
        """Those of them that must be there all the time: a logged attitude only where commands are turned with it."""
        turns = any(wrench.frame == "world" for _, wrench, _, _ in wrenches(self.signals))
        return self.slow if turns else [signal for signal, _ in self.instants]

    def beside(self, time_s: Array, cycle_s: float) -> dict[str, Array]:
        """Columns of what is read off at records' ends (n,)."""
        made: dict[str, Array] = {}
        said = self.signals.map.attitude
        if self.attitude is not None and said is not None:
            times = self.attitude.times
            turned = resample.z_up(resample.attitude_at(self.attitude.values, times.s, time_s), said.world)
            own = resample.nearest_to_samples(times.s, time_s, GAP * times.step_s)
            made |= dict(zip(columns.QUATERNION, np.where(own, turned.T, np.nan), strict=True))
            where = "the records' ends" if own.all() else f"the ends of the {own.sum()} of {len(own)} records that are nearest to a sample"
            self.signals.made.append(f"attitude: every {times.step_s:.6g} s, interpolated to {where}")
        for signal, column in self.instants:
            made[column] = np.interp(time_s, signal.times.s, signal.values[:, 0])
            self.signals.made.append(f"{signal.key}: {_read_off(signal, time_s, cycle_s)}")
        return made


def streams_of(signals: Signals, records: Records) -> tuple[Streams, Array]:
    """What the map names, and its records' edges; :class:`massprop_cli.base.errors.InputError` where nothing was recorded."""
    said = signals.map
    imu = signals.imu()
    attitude = None if said.attitude is None else signals.attitude(said.attitude)
    found = Streams(imu, _commands(signals, attitude), attitude, _instants(signals), signals)
    spans = [_Span(sensor, resample.knots(sensor.times.s, kind)) for sensor, kind in imu]
    spans += [_Span(signal, signal.times.s) for signal in found.slow]
    spans += [_Span(each.signal, resample.span(each.signal.times.s, each.holds)) for each in found.commands if each.signal.paths]
    return found, _edges(signals, records, spans, found.commands)


def columns_of(streams: Streams, records: Records, edges: Array) -> dict[str, Array]:
    """The log's columns by the contract's names, summed over records between ``edges``."""
    signals, gyro = streams.signals, streams.gyro
    _check(signals, edges, [sensor for sensor, _ in streams.imu], streams.unbroken)
    zero = edges[0] if records.zero == "start" else 0.0
    made: dict[str, Array] = {columns.TIME: edges[1:] - zero}
    length = median(np.diff(edges))
    if zero:
        signals.made.append(f"time_s counts from {edges[0] + gyro.times.zero_s:.13g} s by {gyro.times.path!r}")
    for (signal, kind), names in zip(streams.imu, (columns.DELTA_THETA, columns.DELTA_V), strict=False):
        found = resample.increments(signal.values, signal.times.s, kind, edges)
        made |= dict(zip(names, found.T, strict=True))
        signals.made.append(
            f"{signal.key}: {len(signal.values)} values ({kind}) every {signal.times.step_s:.6g} s by {signal.times.path!r}, "
            f"{'summed' if kind == 'increment' else 'integrated'} over {len(edges) - 1} records of {length:.6g} s"
        )
    made |= streams.beside(edges[1:], length * records.per_cycle)
    cycles = edges[:: records.per_cycle]
    for command in streams.commands:
        values = _on_cycles(signals, command, cycles)
        made |= dict(zip(command.names, np.repeat(values, records.per_cycle, 0).T, strict=True))
    return made


def _read_off(signal: QuantitySignal, time_s: Array, cycle_s: float) -> str:
    """How what is read off at the ends of records was come by, and what of it is made up."""
    step = signal.times.step_s
    said = f"every {step:.6g} s, interpolated to the records' ends"
    if signal.key == "supply":
        return said
    if step > 1.01 * cycle_s:
        return (
            f"{said}: slower than control cycles of {cycle_s:.6g} s, so that in between its speed is made up, as if it changed evenly; "
            "what changes faster is lost and moves the results. Log it once a control cycle"
        )
    within = (signal.times.s >= time_s[0]) & (signal.times.s <= time_s[-1])
    if ENOUGH * step < cycle_s or resample.all_at(time_s, signal.times.s[within], SAME * step) or _evenly(signal.values[within, 0]):
        return said
    return (
        f"{said}, where it was not read: {cycle_s / step:.3g} times in a control cycle of {cycle_s:.6g} s. Where its torque steps between "
        f"two readings the speed is made up. Log it at the records' ends, or {math.ceil(ENOUGH)} times in a control cycle"
    )


def _evenly(speed: Array) -> bool:
    """Whether readings change as what turns without steps of its torque."""
    change = np.diff(speed)
    return bool((np.diff(change) ** 2).sum() < STEADY**2 * (change**2).sum())


def _commands(signals: Signals, attitude: QuantitySignal | None) -> list[StreamCommand]:
    found = []
    for key, wrench, known, names in wrenches(signals):
        signal = signals.wrench(key, wrench, known)
        if wrench.frame == "world" and attitude is not None:
            at = resample.attitude_at(attitude.values, attitude.times.s, signal.times.s)
            signal = replace(signal, values=resample.into_body(signal.values, at))
            signals.made.append(f"{key}: turned from world into body axes with the logged attitude at each command's time")
        found.append(StreamCommand(signal, wrench.holds, names, "mean"))
    jets = [(jet, *signals.jet(name, jet)) for name, jet in signals.map.jets.items()]
    _check_open(signals, [signal for _, signal, share in jets if share])
    for name, (jet, signal, share) in zip(signals.map.jets, jets, strict=True):
        kind = "share" if share else "on_time" if signal.paths else "mean"
        found.append(StreamCommand(signal, jet.holds, (columns.jet(name),), kind))
    found += [StreamCommand(signal, holds, (column,), "mean") for signal, column, kind, holds in signals.spinners() if kind == "mean"]
    return found


def _check_open(signals: Signals, valves: Sequence[QuantitySignal]) -> None:
    """Valves of which none ever opens: their numbers are another quantity, or percent of what isn't."""
    widest = max(valves, key=lambda one: float(one.values.max()), default=None)
    if widest is None:
        return
    most = float(widest.values.max())
    if 0 < most < AJAR:
        raise signals.error(
            widest.key,
            widest.paths[0],
            f"no valve is open by more than {most:.4g} ({100 * most:.3g} %) in all of this recording; a state is 0 or 1, or up to 100 %. "
            'If it is the on-time of a control cycle, state unit = "s", "ms" or "us"; if it is 0 to 1, unit = "open"; if it is the share '
            'of a cycle that a valve is open, unit = "s" with scale = the length of a cycle',
        )


def _instants(signals: Signals) -> list[tuple[QuantitySignal, str]]:
    """What is read off at the ends of records, with its column."""
    return [(signal, column) for signal, column, kind, _ in signals.spinners() if kind == "instant"]


@dataclass(frozen=True)
class _Span:
    """When a signal is there."""

    signal: QuantitySignal
    at_s: Array


def _edges(signals: Signals, records: Records, spans: Sequence[_Span], commands: Sequence[StreamCommand]) -> Array:
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
            "correct clock.unit, or state the clock.offset_s between them",
        )
    zero = gyro.times.zero_s
    start = start if records.start_s is None else max(start, records.start_s - zero)
    end = end if records.end_s is None else min(end, records.end_s - zero)
    length = records.interval_s or (records.samples or 1) * gyro.times.step_s
    cycle = length * records.per_cycle
    recorded = [one.signal.times for one in commands if one.signal.paths]
    driving = next((times for times in recorded if abs(times.step_s / cycle - 1) < _LIKE), None)
    slack = SAME * gyro.times.step_s
    begun = None if driving is not None else _where_they_change(commands, start - slack, cycle)
    if driving is not None and (driving.s >= start - slack).any():
        start = _begun(driving.s[driving.s >= start - slack], start - slack, cycle)
        signals.made.append(f"control cycles begin with the first command by {driving.path!r}, at {start + zero:.13g} s")
    elif begun is not None:
        start = begun
        signals.made.append(f"control cycles begin where commands change, the first at {start + zero:.13g} s")
    if records.samples is None:
        edges = start + length * np.arange(max(int((end - start + slack) / length), 0) + 1)
    else:
        # commands are stamped with less care than a cycle is long; without any, nothing before the start is taken
        told = driving is not None or begun is not None
        near = int(np.argmin(np.abs(knots - start))) if told else int(np.searchsorted(knots, start - slack))
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


def _check(signals: Signals, edges: Array, sensors: Sequence[QuantitySignal], slow: Sequence[QuantitySignal]) -> None:
    """Sensors must be at least as fast as records, and nothing may have a gap but an attitude that no command is turned with."""
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


def _on_cycles(signals: Signals, command: StreamCommand, cycles: Array) -> Array:
    """(K, n) the command of each control cycle."""
    signal, step, length = command.signal, command.signal.times.step_s, median(np.diff(cycles))
    said = f"{signal.key}: {len(signal.values)} values every {step:.6g} s by {signal.times.path!r}"
    if command.kind == "on_time":
        if step > (1 - _LIKE) * length:
            if command.holds == "since_last":
                problem = "an on-time once a cycle is that of the cycle in which it is stamped, whatever holds says; drop holds, and where"
                problem += f" stamps come at the cycle's end state clock.offset_s = {-length:.6g} for it"
                raise signals.error(signal.key, signal.paths[0], problem)
            count, first = resample.in_each(signal.times.s, cycles, _EARLY)
        else:  # in every record, which counts by its middle
            middle = step / 2 if command.holds == "until_next" else -step / 2
            count, first = resample.in_each(signal.times.s + middle, cycles, 0.0)
        wrong = np.flatnonzero((count < 1) | _differing(signal.values[:, 0], first, count))
        if wrong.size:
            at = cycles[wrong[0]] + signal.times.zero_s
            raise signals.error(
                signal.key,
                signal.paths[0],
                f"{_counted(signal, first, count, int(wrong[0]))} in the control cycle of {length:.6g} s at {at:.13g} s; each cycle wants "
                "one (0 where the jet is off), or the same in all of its records: correct the length of cycles or their beginning "
                "([records])" + _astray(int(count[wrong[0]])),
            )
        apart = np.abs(signal.times.s[first] - cycles[:-1]).max()
        most = int(count.max())
        each = "one in each control cycle" if most == 1 else f"up to {most} alike in each control cycle"
        signals.made.append(f"{said}, {each}, stamped up to {apart:.3g} s from its beginning")
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


def _astray(count: int) -> str:
    """What else makes a cycle hold no on-time, or two."""
    lost = (
        ""
        if count
        else "; an on-time that is logged as it changes wants a row in each cycle, and where commands were lost records.end_s is before"
    )
    return f'{lost}; stamps that are times of arrival want "even = true", and a clock that drifts its scale, under the clock of [jets]'


def _where_they_change(commands: Sequence[StreamCommand], least_s: float, cycle_s: float) -> float | None:
    """When cycles begin of commands that stand in several records of each: as far into a cycle as most of their changes come together.

    A valve's pulses begin there and end anywhere, so that of jets what rises counts alone. None where they come together nowhere.
    """
    found, step = [], 0.0
    for command in commands:
        times, values = command.signal.times, command.signal.values
        if not command.signal.paths or times.step_s > (1 - _LIKE) * cycle_s:
            continue
        change = np.diff(values, axis=0)
        changed = (change != 0).any(1) if command.kind == "mean" else (change > 0).any(1)
        found.append((times.s[1:] if command.holds == "until_next" else times.s[:-1])[changed])
        step = max(step, times.step_s)
    into = np.sort((np.concatenate([*found, []]) - least_s) % cycle_s)
    if len(into) < _CHANGES:
        return None
    around = np.concatenate([into, into + cycle_s])
    together = np.searchsorted(around, into + max(step, SAME * cycle_s), side="left") - np.arange(len(into))
    most = int(np.argmax(together))
    if together[most] < _TOGETHER * len(into):
        return None
    begun = median(around[most : most + together[most]]) % cycle_s
    return least_s + (begun if cycle_s - begun > SAME * cycle_s else 0.0)


def _differing(values: Array, first: IntArray, count: IntArray) -> BoolArray:
    """(K,) whether those of a cycle differ, of which ``count`` follow each other from the ``first`` on."""
    changes = np.concatenate([[0], np.cumsum(np.diff(values) != 0)])
    last = np.minimum(first + np.maximum(count, 1), len(values)) - 1
    found: BoolArray = changes[last] != changes[first]
    return found


def _counted(signal: QuantitySignal, first: IntArray, count: IntArray, cycle: int) -> str:
    """How many there are in a cycle and, of those that are not alike, two."""
    own = list(dict.fromkeys(signal.values[first[cycle] : first[cycle] + count[cycle], 0].tolist()))
    return f"{count[cycle]} on-times ({' and '.join(f'{value:.4g} s' for value in own[:2])})" if own else "no on-time"


def _begun(times_s: Array, least_s: float, cycle_s: float) -> float:
    """When cycles begin that commands begin: with the first stamp, or where the median of stamps that scatter puts it."""
    first = float(times_s[0])
    off = (times_s - first + cycle_s / 2) % cycle_s - cycle_s / 2
    usual = median(off)
    if abs(usual) < SAME * cycle_s or float(np.abs(off - usual).max()) > STAMPED * cycle_s:
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
    if scatter > STAMPED * length:
        return times_s, 0.0
    chance = max(4 * float(into.std()) / len(into) ** 0.5, SAME * length)
    even = times_s.copy()
    even[first] = cycles[:-1] + (usual if abs(usual) > chance else 0.0)
    # those before and after follow on, where they are of the same kind
    for edge, beyond, step in ((first[0], first[0] - 1, -length), (first[-1], first[-1] + 1, length)):
        if 0 <= beyond < len(even) and abs(times_s[beyond] - times_s[edge] - step) < 2 * STAMPED * length:
            even[beyond] = even[edge] + step
    return even, scatter if scatter > SAME * length else 0.0
