"""Conversion of streams with separate clocks to records and control cycles, or to records with commands at their own times."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample, streamcommands
from massprop_cli.inputs.formats.clocks import GAP
from massprop_cli.inputs.formats.mapfile import Records
from massprop_cli.inputs.formats.signals import QuantitySignal, Signals
from massprop_cli.inputs.formats.streamcommands import MAX_SCATTER, SAME_INTERVAL, SAME_TIME, StreamCommand
from massprop_cli.inputs.logtable import EMPTY, MISSING

LOST_INTERVAL = 1.5
"""Interval over the usual interval above which a sample counts as lost; a gap needs more."""
READINGS_PER_CYCLE = 4.5
"""Minimum number of speed readings per control cycle for which interpolation does not change results: with 4.85 readings none of ten
noiseless logs changed, with 4 one in four, with 3 all."""
STEADY = 0.2
"""Second differences over first differences (rms) of readings, below which no torque steps occur between them."""


@dataclass(frozen=True)
class Streams:
    """Streams of a log."""

    imu: Sequence[tuple[QuantitySignal, resample.Values]]
    """Gyro, and accelerometer if mapped, each with the meaning of its values."""
    commands: Sequence[StreamCommand]
    attitude: QuantitySignal | None
    instants: Sequence[tuple[QuantitySignal, str]]
    signals: Signals

    @property
    def gyro(self) -> QuantitySignal:
        """Signal of the gyro."""
        return self.imu[0][0]

    @property
    def slow(self) -> list[QuantitySignal]:
        """Signals that are interpolated at the ends of records."""
        return [*([] if self.attitude is None else [self.attitude]), *(signal for signal, _ in self.instants)]

    def zero(self, records: Records, edges: Array) -> float:
        """Zero of time_s, on the gyro's clock after the recording's zero, s."""
        if records.zero == "file" or not edges[0]:
            return 0.0
        self.signals.conversions.append(f"time_s counts from {edges[0] + self.gyro.times.zero_s:.13g} s by {self.gyro.times.path!r}")
        return float(edges[0])

    def interpolated(self, time_s: Array, cycle_s: float) -> dict[str, Array]:
        """Columns of signals that are interpolated at the ends of records, ``time_s`` (n,)."""
        made: dict[str, Array] = {}
        entry = self.signals.map.attitude
        if self.attitude is not None and entry is not None:
            times = self.attitude.times
            turned = resample.z_up(resample.attitude_at(self.attitude.values, times.s, time_s), entry.world)
            near = resample.nearest_to_samples(times.s, time_s, GAP * times.step_s)
            made |= dict(zip(columns.QUATERNION, np.where(near, turned.T, np.nan), strict=True))
            where = f"the ends of the {near.sum()} of {len(near)} records that are nearest to a sample"
            where = "the records' ends" if near.all() else where
            self.signals.conversions.append(f"attitude: every {times.step_s:.6g} s, interpolated to {where}")
        for signal, column in self.instants:
            made[column] = np.interp(time_s, signal.times.s, signal.values[:, 0])
            self.signals.conversions.append(f"{signal.key}: {_read_off(signal, time_s, cycle_s)}")
        return made


def streams_of(signals: Signals, records: Records) -> tuple[Streams, Array]:
    """Streams of the map, and edges of the records, s. Raises :class:`massprop_cli.base.errors.InputError` for a missing stream."""
    entries = signals.map
    imu = signals.imu()
    attitude = None if entries.attitude is None else signals.attitude(entries.attitude)
    instants = [(signal, column) for signal, column, kind, _ in signals.spinners() if kind == "instant"]
    found = Streams(imu, streamcommands.commands_of(signals, attitude), attitude, instants, signals)
    spans = [_Span(sensor, resample.knots(sensor.times.s, kind)) for sensor, kind in imu]
    spans += [_Span(signal, signal.times.s) for signal in found.slow]
    spans += [_Span(each.signal, resample.span(each.signal.times.s, each.holds)) for each in found.commands if each.signal.paths]
    return found, _edges(signals, records, spans, found.commands)


def on_cycles_of(streams: Streams, records: Records, edges: Array) -> dict[str, Array]:
    """Columns of the log with increments summed over records between ``edges``."""
    signals = streams.signals
    turned = any(wrench.frame == "world" for _, wrench, _, _ in signals.wrenches())
    # gaps of the attitude matter only if it rotates commands
    _check(signals, edges, [sensor for sensor, _ in streams.imu], streams.slow if turned else [signal for signal, _ in streams.instants])
    made: dict[str, Array] = {columns.TIME: edges[1:] - streams.zero(records, edges)}
    length = median(np.diff(edges))
    for (signal, kind), names in zip(streams.imu, (columns.DELTA_THETA, columns.DELTA_V), strict=False):
        found = resample.increments(signal.values, signal.times.s, kind, edges)
        made |= dict(zip(names, found.T, strict=True))
        signals.conversions.append(
            f"{signal.key}: {len(signal.values)} values ({kind}) every {signal.times.step_s:.6g} s by {signal.times.path!r}, "
            f"{'summed' if kind == 'increment' else 'integrated'} over {len(edges) - 1} records of {length:.6g} s"
        )
    made |= streams.interpolated(edges[1:], length * records.per_cycle)
    cycles = edges[:: records.per_cycle]
    for command in streams.commands:
        values = streamcommands.on_cycles(signals, command, cycles)
        made |= dict(zip(command.names, np.repeat(values, records.per_cycle, 0).T, strict=True))
    return made


def at_own_times(streams: Streams, records: Records, edges: Array) -> dict[str, Array] | None:
    """Columns of the log with the IMU's samples as records and commands at their own times.

    Thrust steps within a record then stay exact. None if records already fit the cycles of ``edges``, or if commands do not have one row
    each. Without commands, records stay as recorded.
    """
    signals, gyro, kinds = streams.signals, streams.gyro, [kind for _, kind in streams.imu]
    together = all(one.times is gyro.times or np.array_equal(gyro.times.s, one.times.s) for one, _ in streams.imu)
    if not together or (
        "sample" not in kinds and resample.all_at(resample.knots(gyro.times.s, kinds[0]), edges, SAME_TIME * gyro.times.step_s)
    ):
        return None
    issued = _issued(streams.commands, edges[:: records.per_cycle])
    one_each = "sample" in kinds and (records.samples == 1 or abs(gyro.times.step_s / median(np.diff(edges)) - 1) < SAME_TIME)
    if issued is None and (not one_each or any(command.signal.paths for command in streams.commands)):
        return None
    issued_s, scatter_s, of_them = issued or (np.zeros(0), 0.0, np.zeros(0, int))
    slack_s = SAME_TIME * gyro.times.step_s
    within = slice(*np.searchsorted(gyro.times.s, edges[[0, -1]] + slack_s).tolist())
    placed = _placed(gyro.times.s[within], issued_s, gyro.times.step_s)
    if placed is None:
        return None
    time_s, kept, inside, rows = placed
    zero = streams.zero(records, edges)
    made: dict[str, Array] = {columns.TIME: time_s - zero}
    made |= {name: _in_rows(values, kept, len(time_s)) for name, values in signals.as_recorded(streams.imu, within).items()}
    for signal, kind in streams.imu:
        signals.conversions.append(
            f"{signal.key}: {len(kept)} values ({kind}) every {gyro.times.step_s:.6g} s by {gyro.times.path!r}, as recorded"
        )
    if issued is None:
        return made | streams.interpolated(time_s, records.per_cycle * gyro.times.step_s)
    made[columns.COMMAND_TIME] = _in_rows(issued_s[inside] - zero, rows, len(time_s))
    for command in streams.commands:
        values = command.signal.values
        values = values[of_them[inside]] if command.signal.paths else np.repeat(values[:1], len(rows), 0)
        made |= dict(zip(command.names, (_in_rows(column, rows, len(time_s)) for column in values.T), strict=True))
    evened = f", whose stamps scatter by up to {scatter_s:.3g} s and are taken as evenly spaced" if scatter_s > 0 else ""
    usual_s, lost = median(np.diff(issued_s)), np.flatnonzero(np.diff(issued_s) > LOST_INTERVAL * median(np.diff(issued_s)))
    gaps = ""
    if lost.size:
        gaps = f"; {lost.size} gap(s), the first after {issued_s[lost[0]] - zero:.9g} s: a command that was lost there moves every value"
    signals.conversions.append(f"commands: {len(rows)} every {usual_s:.6g} s, at their own times{evened}{gaps}")
    return made | streams.interpolated(time_s, median(np.diff(issued_s)))


def _placed(time_s: Array, issued_s: Array, step_s: float) -> tuple[Array, IntArray, BoolArray, IntArray] | None:
    """Times of records, which of them are recorded, commands within them, and rows of these; None if a row would have two commands.

    A command at a sample's time is in the next record. Lost records that contain commands are restored as empty rows.
    """
    slack_s = SAME_TIME * step_s
    inside: BoolArray = (issued_s > time_s[0] - step_s - slack_s) & (issued_s < time_s[-1] - slack_s)
    number = np.concatenate([[0], np.cumsum(_intervals(np.diff(time_s), step_s))])
    whole = np.interp(np.arange(number[-1] + 1), number, time_s)
    for times, kept in ((time_s, np.arange(len(time_s))), (whole, number)):
        rows = np.searchsorted(times, issued_s[inside] + slack_s)
        if not len(issued_s) or (len(rows) > 1 and (np.diff(rows) > 0).all()):
            return times, kept, inside, rows
    return None


def _intervals(steps_s: Array, step_s: float) -> IntArray:
    """(n,) number of usual intervals in each step: more than one for lost records, up to the limits of a log."""
    several = np.round(steps_s / step_s).astype(int)
    found = np.where((steps_s > LOST_INTERVAL * step_s) & (several <= MISSING), several, 1)
    return found if (found - 1).sum() <= EMPTY * len(found) else np.ones_like(found)


def _issued(commands: Sequence[StreamCommand], cycles_s: Array) -> tuple[Array, float, IntArray] | None:
    """Issue times of commands, largest scatter about even times (0: time stamps as recorded), and rows; None without one row per cycle.

    A cycle may also have several rows of equal values.
    """
    driving = [command for command in commands if command.signal.paths]
    recorded = [command.signal for command in driving]
    if not driving or any(command.kind == "share" or command.holds != "until_next" for command in driving):
        return None
    if any(not np.array_equal(one.times.s, recorded[0].times.s) for one in recorded):
        return None
    stamps, step_s, cycle_s = recorded[0].times.s, recorded[0].times.step_s, median(np.diff(cycles_s))
    if step_s < (1 - SAME_INTERVAL) * cycle_s:
        first: IntArray = np.searchsorted(stamps, cycles_s - SAME_TIME * step_s)
        follow = np.arange(first[0], first[-1])
        leading = np.repeat(first[:-1], np.diff(first))
        if (np.diff(first) < 1).any() or any((one.values[follow] != one.values[leading]).any() for one in recorded):
            return None
        return stamps[first[:-1]], 0.0, first[:-1]
    if abs(step_s / cycle_s - 1) > SAME_INTERVAL:
        return None
    line, _ = resample.even(stamps)
    scatter_s = float(np.abs(line - stamps).max())
    rows = np.arange(len(stamps))
    if scatter_s > MAX_SCATTER * step_s:
        return stamps, 0.0, rows
    return line, scatter_s if scatter_s > SAME_TIME * step_s else 0.0, rows


def _in_rows(values: Array, rows: IntArray, count: int) -> Array:
    """(count,) values in the given rows, NaN in others."""
    found = np.full(count, np.nan)
    found[rows] = values
    return found


def _read_off(signal: QuantitySignal, time_s: Array, cycle_s: float) -> str:
    """Description of an interpolation at the ends of records, with a warning if it can change results."""
    step = signal.times.step_s
    text = f"every {step:.6g} s, interpolated to the records' ends"
    if signal.key == "supply":
        return text
    if step > 1.01 * cycle_s:
        return (
            f"{text}: slower than control cycles of {cycle_s:.6g} s, so that in between its speed is made up, as if it changed evenly; "
            "what changes faster is lost and moves the results. Log it once a control cycle"
        )
    within = (signal.times.s >= time_s[0]) & (signal.times.s <= time_s[-1])
    change = np.diff(signal.values[within, 0])
    evenly = (np.diff(change) ** 2).sum() < STEADY**2 * (change**2).sum()  # as what turns without steps of its torque
    if READINGS_PER_CYCLE * step < cycle_s or evenly or resample.all_at(time_s, signal.times.s[within], SAME_TIME * step):
        return text
    return (
        f"{text}, where it was not read: {cycle_s / step:.3g} times in a control cycle of {cycle_s:.6g} s. Where its torque steps between "
        f"two readings the speed is made up. Log it at the records' ends, or {math.ceil(READINGS_PER_CYCLE)} times in a control cycle"
    )


class _Span(NamedTuple):
    """Signal with the times at which it has data."""

    signal: QuantitySignal
    at_s: Array


def _edges(signals: Signals, records: Records, spans: Sequence[_Span], commands: Sequence[StreamCommand]) -> Array:
    """Edges of records in whole control cycles with data of all streams, s; the first span is that of the gyro."""
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
    driving = next((times for times in recorded if abs(times.step_s / cycle - 1) < SAME_INTERVAL), None)
    slack = SAME_TIME * gyro.times.step_s
    begun = None if driving is not None else streamcommands.where_they_change(commands, start - slack, cycle)
    if driving is not None and (driving.s >= start - slack).any():
        start = streamcommands.begun_with(driving.s[driving.s >= start - slack], start - slack, cycle)
        signals.conversions.append(f"control cycles begin with the first command by {driving.path!r}, at {start + zero:.13g} s")
    elif begun is not None:
        start = begun
        signals.conversions.append(f"control cycles begin where commands change, the first at {start + zero:.13g} s")
    if records.samples is None:
        edges = start + length * np.arange(max(int((end - start + slack) / length), 0) + 1)
    else:
        # commands are stamped less precisely than a cycle; without commands, nothing before the start is used
        aligned = driving is not None or begun is not None
        near = int(np.argmin(np.abs(knots - start))) if aligned else int(np.searchsorted(knots, start - slack))
        edges = knots[near :: records.samples]
        edges = edges[edges <= end + slack]
    whole = (len(edges) - 1) // records.per_cycle * records.per_cycle
    if whole < 2 * records.per_cycle:
        raise signals.error(
            "records",
            gyro.times.path,
            f"from {start + zero:.13g} to {end + zero:.13g} s, where all streams have data, are fewer than two control cycles of "
            f"{cycle:.6g} s; gyro is {gyro.times.span()}, {early.key} {early.times.span()}, {late.key} {late.times.span()}",
        )
    return edges[: whole + 1]


def _check(signals: Signals, edges: Array, sensors: Sequence[QuantitySignal], slow: Sequence[QuantitySignal]) -> None:
    """Raise :class:`InputError` for sensors slower than records, and for gaps (not in an attitude that rotates no commands)."""
    length = median(np.diff(edges))
    for signal in sensors:
        if signal.paths and signal.times.step_s > 1.01 * length:
            raise signals.refused(
                signal,
                f"{signals.repeats.get(signal.key, 'comes')} every {signal.times.step_s:.6g} s, so records of {length:.6g} s would be "
                "invented. Make records at least as long",
            )
    for signal in (*sensors, *slow):
        times = signal.times
        inside = times.s[(times.s >= edges[0]) & (times.s <= edges[-1])]
        if not signal.paths:
            continue
        steps = np.diff(inside)
        lost = np.flatnonzero(steps > LOST_INTERVAL * times.step_s)
        wide = lost[(steps[lost] > length) & (steps[lost] > GAP * times.step_s)]
        if wide.size:
            at = inside[wide[0]]
            raise signals.refused(
                signal,
                f"a gap of {steps[wide[0]]:.6g} s after {at + times.zero_s:.13g} s (usual interval {times.step_s:.6g} s); use one side of "
                "it with records.start_s or end_s",
            )
        if lost.size:
            signals.conversions.append(
                f"{signal.key}: {lost.size} gap(s) of up to {steps[lost].max():.6g} s, shorter than a record, are interpolated; the first "
                f"after {inside[lost[0]] + times.zero_s:.13g} s"
            )
