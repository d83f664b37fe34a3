"""Signals of a map's quantities: numbers in SI units with their times."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray
from massprop_cli.base.configfile import nearest
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import clocks, listing, mapfile, resample, selection, units
from massprop_cli.inputs.formats.clocks import Times
from massprop_cli.inputs.formats.recording import Numbers, RecordedStream, Recording, fitting
from massprop_cli.inputs.held import moving_mean, periodic_repeats
from massprop_cli.inputs.logtable import EMPTY
from massprop_cli.inputs.marked import fill_values
from massprop_cli.inputs.vehicle import ACTUATORS

_SHOWN = 5
_SENSORS = ("gyro", "accelerometer")
_COLUMNS = (columns.GYRO, columns.DELTA_THETA), (columns.ACCEL, columns.DELTA_V)
"""Columns of rates and of increments, for each sensor of ``_SENSORS``."""


@dataclass(frozen=True)
class QuantitySignal:
    """Signal of one quantity, SI."""

    key: str
    """Key in the map file."""
    paths: tuple[str, ...]
    values: Array
    """(n, axes) values."""
    times: Times


class Signals:
    """Signals of a recording under a map. Errors name the file, the path in it and the remedy in the map."""

    def __init__(self, recording: Recording, source: mapfile.MapSource) -> None:
        self.recording, self.map, self.source = recording, source.map, source.source
        self.conversions: list[str] = []
        """Descriptions of all conversions, for the result."""
        self.repeats = dict[str, str]()
        """Text by sensor with repeated readings."""
        self.sampled = False, False
        """Whether the columns of gyro and accelerometer are samples at their times."""
        self._clocks: dict[tuple[mapfile.Clock, bytes], Times] = {}
        self._gyro: Times | None = None
        self._zero = Fraction(0)
        records = self.map.records
        if records is not None and records.zero == "start":
            clock = self._clock_of("gyro", self._paths("gyro", self.map.gyro.paths, 3), self.map.gyro.clock)
            counts = self._stream("gyro.clock", clock.path or "").values
            first = counts[np.isfinite(counts)][:1] if np.isfinite(counts).any() else self._counts("gyro", clock.path or "")
            self._zero = self._exact(clock, first[0], self._time_factor("gyro.clock", clock))

    def error(self, key: str, path: str, problem: str) -> InputError:
        """Error about a path under a key of the map."""
        return InputError(f"{self.recording.path}, {path!r}: {problem} ([{key}] of {self.source})")

    def refused(self, signal: QuantitySignal, problem: str) -> InputError:
        """Error about the samples of a quantity."""
        return self.error(signal.key, signal.paths[0] if signal.paths else "", problem)

    def sensor(self, key: str, entry: mapfile.MappedSensor, rates: Mapping[str, float], increments: Mapping[str, float]) -> QuantitySignal:
        """Gyro or accelerometer in the axes that the map states. Raises :class:`InputError` for repeated, averaged or missing readings."""
        found = self.vector(key, entry, increments if entry.values == "increment" else rates)
        self._gyro = found.times if key == "gyro" else self._gyro
        if not self._separate_clocks and (repeated := periodic_repeats(found.values)).any():
            usual = len(repeated) / (~repeated).sum()
            every = usual * found.times.step_s
            problem = (
                f"repeats each reading {usual:.3g} times: the sensor measures every {every:.6g} s, and the file holds its last reading "
                f"in between; state [records], interval_s = {every:.6g}, by which each counts once"
            )
            raise self.refused(found, problem)
        if mean := moving_mean(found.values):
            problem = f"each reading is a moving mean over {mean} of them; record it as it was measured, or keep every one in {mean}"
            raise self.refused(found, problem)
        lost = clocks.coverage_defect(self.recording.streams, found.paths, found.times.step_s) if entry.values == "increment" else ""
        if lost:
            raise self.refused(found, lost)
        return found

    def imu(self) -> list[tuple[QuantitySignal, resample.Values]]:
        """Gyro, and accelerometer if mapped, each with the meaning of its values."""
        found = [(self.sensor("gyro", self.map.gyro, units.SPIN, units.ANGLE), self.map.gyro.values)]
        entry = self.map.accelerometer
        if entry is not None:
            found.append((self.sensor("accelerometer", entry, units.ACCELERATION, units.SPEED), entry.values))
        return found

    def as_recorded(self, imu: Sequence[tuple[QuantitySignal, resample.Values]], rows: slice = slice(None)) -> dict[str, Array]:
        """Columns of gyro and accelerometer in some rows of the file, without resampling."""
        gyro, *others = (kind == "sample" for _, kind in imu)
        self.sampled = gyro, others[0] if others else gyro
        made: dict[str, Array] = {}
        for (signal, kind), (rates, increments) in zip(imu, _COLUMNS, strict=False):
            made |= dict(zip(increments if kind == "increment" else rates, signal.values[rows].T, strict=True))
        return made

    def wrenches(self) -> list[tuple[str, mapfile.MappedWrench, dict[str, float], tuple[str, ...]]]:
        """Commanded torque and force of the map: key, entry, units, columns."""
        torque, force = self.map.torque, self.map.force
        both = (("torque", torque, units.TORQUE, columns.WRENCH[:3]), ("force", force, units.FORCE, columns.WRENCH[3:]))
        return [(key, wrench, known, names) for key, wrench, known, names in both if wrench is not None]

    def jet(self, name: str, entry: mapfile.MappedJet) -> tuple[QuantitySignal, bool]:
        """On-times, s, or openings from 0 to 1; and whether they are openings."""
        key = f"jets.{name}"
        if entry.path == 0:
            return self._constant(key, np.zeros(1)), False
        stream = self._stream(key, entry.path)
        clock = self._clock_of(key, [entry.path], entry.clock)
        if entry.bit is not None:
            return self._signal(key, [stream.path], self._bit(key, stream, entry.bit)[:, None], clock, entry.where), True
        known = {unit: value for unit, value in units.TIME.items() if unit != "ns"} | units.SHARE
        factor, unit = self._factor(key, stream, entry, known)
        values = (self._numbers(key, stream, empty=True) + entry.offset) * (factor * entry.scale)
        signal = self._signal(key, [stream.path], values[:, None], clock, entry.where)
        return signal, unit in units.SHARE

    def _bit(self, key: str, stream: RecordedStream, bit: int) -> Array:
        """(n,) 0 or 1, the bit of integers; NaN in empty rows."""
        values = self._numbers(key, stream, empty=True)
        bad = np.flatnonzero((values < 0) | (~np.isnan(values) & (values % 1 != 0)))
        if bad.size:
            where = stream.place(int(bad[0]))
            raise self.error(key, stream.path, f"{values[bad[0]]:g} at {where} is not an integer of bits; drop bit, or name another path")
        return np.where(np.isnan(values), values, np.nan_to_num(values).astype(np.int64) >> bit & 1)

    def spinners(self) -> Iterator[tuple[QuantitySignal, str, Literal["mean", "instant"], resample.Holds]]:
        """Signals of actuators and supply: signal, column, cycle mean or instantaneous value, and interval in which a value holds."""
        for table, kind in ACTUATORS.items():
            known = {unit: factor for column in kind.COLUMNS for unit, factor in column.units.items()}
            for name, entry in getattr(self.map, table).items():
                signal, unit = self._number(f"{table}.{name}", entry, entry.path, known)
                column = next(column for column in kind.COLUMNS if units.factor(unit, column.units) is not None)
                yield signal, column.of(name), "instant" if column.instant else "mean", entry.holds
        if self.map.supply is not None:
            signal, unit = self._number("supply", self.map.supply, self.map.supply.path, units.VOLTAGE | units.PRESSURE)
            yield signal, columns.PRESSURE if unit in units.PRESSURE else columns.SUPPLY, "instant", "until_next"

    def _number(self, key: str, entry: mapfile.Mapped, path: str, known: Mapping[str, float]) -> tuple[QuantitySignal, str]:
        stream = self._stream(key, path)
        factor, unit = self._factor(key, stream, entry, known)
        values = self._numbers(key, stream, empty=self._separate_clocks or entry.where is not None) * (factor * entry.scale)
        return self._signal(key, [stream.path], values[:, None], self._clock_of(key, [path], entry.clock), entry.where), unit

    def attitude(self, entry: mapfile.Attitude) -> QuantitySignal:
        """Unit quaternions wxyz, world of the file from body."""
        paths = [str(path) for path in self._paths("attitude", entry.paths, 1 if entry.order == "heading" else 4)]
        empty = self._separate_clocks or entry.where is not None
        recorded = self._together("attitude", paths, [self._numbers("attitude", self._stream("attitude", path), empty) for path in paths])
        if entry.order == "heading":
            recorded = recorded * (self._factor("attitude", self._stream("attitude", paths[0]), entry, units.ANGLE)[0] * entry.scale)
        recorded = np.where(self._selected("attitude", paths, entry.where, len(recorded))[:, None], recorded, np.nan)

        def refused(row: int, norm: float) -> InputError:
            at = self._stream("attitude", paths[0]).place(row)
            return self.error(
                "attitude", paths[0], f"the quaternion's norm is {norm:.4g} at {at}, not 1; check that these are its four parts"
            )

        turned = resample.quaternions(entry, recorded, refused)
        return self._signal("attitude", paths, turned, self._clock_of("attitude", paths, entry.clock), entry.where)

    def vector(self, key: str, entry: mapfile.MappedVector, known: Mapping[str, float]) -> QuantitySignal:
        """Three axes in the order that the map states, in ``known`` units and in the frame of the map."""
        paths = self._paths(key, entry.paths, 3)
        streams = [self._stream(key, path) if isinstance(path, str) else None for path in paths]
        columns = []
        for path, stream in zip(paths, streams, strict=True):
            if stream is None:
                columns.append(np.array([float(path)]))
                continue
            factor, _ = self._factor(key, stream, entry, known)
            numbers = self._numbers(key, stream, empty=self._separate_clocks or key in ("torque", "force", *_SENSORS))
            if key in _SENSORS:  # before conversion changes the fill values
                numbers = np.where(fill_values(numbers, 1.0), np.nan, numbers)
            columns.append(numbers * (factor * entry.scale))
        named = [path for path in paths if isinstance(path, str)]
        rows = max(map(len, columns)) if named else 1
        columns = [np.full(rows, column[0]) if stream is None else column for column, stream in zip(columns, streams, strict=True)]
        values = self._together(key, [str(path) for path in paths], columns)
        turned = np.stack([values[:, "xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1) for axis in entry.axes], 1)
        if not named:
            return self._constant(key, turned[0])
        return self._signal(key, named, turned, self._clock_of(key, named, entry.clock), entry.where)

    def _constant(self, key: str, values: Array) -> QuantitySignal:
        """Constant of the map, at the gyro's times."""
        gyro = self._paths("gyro", self.map.gyro.paths, 3)
        times = self._gyro or self._times("gyro", self._clock_of("gyro", gyro, self.map.gyro.clock))
        return QuantitySignal(key, (), np.broadcast_to(values, (len(times.s), len(values))), times)

    def _signal(self, key: str, paths: Sequence[str], values: Array, clock: mapfile.Clock, where: mapfile.Where | None) -> QuantitySignal:
        rows = self._stream(f"{key}.clock", clock.path or "").rows
        if rows != len(values):
            raise self.error(key, paths[0], f"has {len(values)} samples and its clock {clock.path!r} {rows}; name the clock it has")
        held = self._selected(key, paths, where, rows)
        if where is not None:
            self.conversions.append(
                f"{key}: the {held.sum()} of {rows} rows whose {where.column!r} is {selection.stated(where.values, ' or ')}"
            )
        if self._separate_clocks:
            own = np.flatnonzero(held)
            held[own] = self._has_sample(key, paths, values[own], own)
        return QuantitySignal(key, tuple(paths), values[held], self._times(key, clock, held, where is None))

    def _selected(self, key: str, paths: Sequence[str], where: mapfile.Where | None, rows: int) -> BoolArray:
        """(rows,) rows that ``where`` selects."""
        found = np.ones(rows, dtype=bool) if where is None else selection.rows_of(self.recording, where, rows)
        if isinstance(found, str):
            raise self.error(key, paths[0], found)
        return found

    @property
    def _separate_clocks(self) -> bool:
        """Whether streams have clocks of their own; a table row may then hold samples of only some streams."""
        return self.map.records is not None

    def _has_sample(self, key: str, paths: Sequence[str], values: Array, rows: IntArray) -> BoolArray:
        """(n,) whether the file's ``rows`` have a new sample with a value on each axis."""
        empty = np.isnan(values)
        # an axis that the map states as a number has a value in each row
        recorded = empty.any(0) | (values != values[0]).any(0)
        none: BoolArray = empty[:, recorded].all(axis=1) & recorded.any()
        if key in _SENSORS and (repeated := periodic_repeats(values[~none])).any():
            usual = len(repeated) / (~repeated).sum()
            self.repeats[key] = f"repeats each reading {usual:.3g} times, so that it measures"
            self.conversions.append(f"{key}: each reading is repeated {usual:.3g} times, and counts once")
            none[~none] = repeated
        part = empty.any(1) & ~none
        if key in _SENSORS and part.sum() <= EMPTY * (~none).sum():
            none = none | part  # a reading with a missing axis counts as lost
        some = np.flatnonzero(empty.any(1) & ~none)
        if none.all() or some.size:
            row = int(some[0]) if some.size else 0
            where = self._stream(key, paths[0]).place(int(rows[row]))
            problem = "no sample has a number" if none.all() else f"a number is missing at {where}, beside other axes'; correct the row"
            raise self.error(key, paths[0], problem)
        if none.any():
            self.conversions.append(f"{key}: {int(none.sum())} of {len(none)} rows of the file hold none of its samples")
        return ~none

    def _together(self, key: str, paths: Sequence[str], columns: Sequence[Array]) -> Array:
        lengths = {len(column) for column in columns}
        if len(lengths) > 1:
            lengths_of = ", ".join(f"{path!r} {len(column)}" for path, column in zip(paths, columns, strict=True))
            raise self.error(key, paths[0], f"axes have different numbers of samples ({lengths_of}); name streams that belong together")
        return np.stack(columns, 1)

    def _paths(self, key: str, entry: str | Sequence[str | float], count: int) -> list[str | float]:
        """Paths of the entry, with a pattern expanded."""
        found: list[str | float] = list(entry) if not isinstance(entry, str) else list(fitting(entry, list(self.recording.streams)))
        if isinstance(entry, str) and len(found) != count:
            listed = ", ".join(map(repr, found[:_SHOWN])) + (", …" if len(found) > _SHOWN else "")
            if not found and (why := self.recording.why_unread(entry)):
                raise self.error(key, entry, why)
            hint = listed or f"nothing{nearest(entry, self.recording.streams, 'the nearest path is')}"
            raise self.error(key, entry, f"the pattern fits {len(found)} paths, not {count}: {hint}; massprop columns lists all")
        if len(found) != count:
            raise self.error(key, str(found[:1]), f"{len(found)} paths; give {count}")
        return found

    def _stream(self, key: str, path: str) -> RecordedStream:
        found = self.recording.streams.get(path)
        if found is None:
            if why := self.recording.why_unread(path):
                raise self.error(key, path, why)
            hint = nearest(path, self.recording.streams, "the nearest is")
            raise self.error(key, path, f"no such path in this {self.recording.kind}{hint}; massprop columns lists all")
        if found.rows == 0:
            raise self.error(key, path, "holds no sample; was it recorded? massprop columns lists what was")
        return found

    def _numbers(self, key: str, stream: RecordedStream, empty: bool = False) -> Array:
        values = np.asarray(stream.values, np.float64)
        bad = np.flatnonzero(np.isinf(values) if empty else ~np.isfinite(values))
        if bad.size:
            where = stream.place(int(bad[0]))
            raise self.error(
                key, stream.path, f"{values[bad[0]]} at {where} is not a finite number; interpolate it, or split the recording there"
            )
        return values

    def _factor(
        self, key: str, stream: RecordedStream, stated: mapfile.Mapped | mapfile.Clock | mapfile.Attitude, known: Mapping[str, float]
    ) -> tuple[float, str]:
        """Factor to SI, and unit, as stated or recorded. Raises :class:`InputError` if these contradict each other."""
        given, recorded = stated.unit, units.plain(stream.unit)
        text = given or recorded
        choices = ", ".join(known)
        if not text:
            raise self.error(key, stream.path, f"the file records no unit; state unit = one of {choices}")
        factor = units.factor(text, known)
        if factor is None:
            way = "" if given else f"; or state one of these as unit, and scale, what one {text} is in it"
            raise self.error(key, stream.path, f"unit {text!r} is none of this quantity; it is one of {choices}{way}")
        if given and recorded and recorded != units.plain(given):
            if units.factor(recorded, known) is not None:
                problem = f"the map says unit {given!r}, the file {stream.unit!r}; drop unit from the map, or correct it"
                raise self.error(key, stream.path, problem)
            known_or_not = units.is_any(recorded) or units.is_foreign(stream.unit)
            if known_or_not and "scale" not in stated.model_fields_set:
                remedy = f"state scale beside it, what one {stream.unit} is in {given}; 1.0 where the file is wrong"
                raise self.error(
                    key, stream.path, f"the map says unit {given!r}, and the file {stream.unit!r}, which is none here: {remedy}"
                )
        return factor, units.plain(text)

    def _clock_of(self, key: str, paths: Sequence[str | float], entry: mapfile.Clock | None) -> mapfile.Clock:
        """Clock with a path: of the quantity, of the stream in the file, or of the map."""
        named = [path for path in paths if isinstance(path, str)]
        own = next((self._stream(key, path).clock for path in named), "")
        common = self.map.clock
        if own and own != common.path:
            common = mapfile.Clock() if common.path else common.model_copy(update={"unit": None})
        stated = entry or common
        if stated.path is None and not own:
            like = self.clocks_like(named[0])[:_SHOWN] if named else []
            hint = f": {' or '.join(map(repr, like))} by its rows" if like else ""
            raise self.error(key, named[0] if named else "", f"the file doesn't say which stream has its times; state clock.path{hint}")
        return stated if stated.path is not None else stated.model_copy(update={"path": own})

    def clocks_like(self, path: str) -> list[str]:
        """Increasing streams with values in the same rows as this one."""
        return listing.Clocks(self.recording).of(self.recording.streams[path])

    def _counts(self, key: str, path: str, held: BoolArray | None = None) -> Numbers:
        """Values of a clock as recorded, in the rows ``held``; all finite, integers signed."""
        stream = self._stream(f"{key}.clock", path)
        if held is None or held.all():
            self._numbers(f"{key}.clock", stream)
            held = np.ones(stream.rows, dtype=bool)
        counts = stream.values[held]
        bad = np.flatnonzero(~np.isfinite(counts))
        if bad.size:
            where = stream.place(int(np.flatnonzero(held)[bad[0]]))
            raise self.error(
                f"{key}.clock", path, f"no time at {where}, where there is a sample; name the clock that it has, or correct the row"
            )
        return counts.astype(np.int64) if counts.dtype.kind == "u" else counts

    @staticmethod
    def _exact(clock: mapfile.Clock, value: Any, factor: float) -> Fraction:
        """Time in s without rounding."""
        return Fraction(value.item()) * Fraction(str(factor)) * Fraction(str(clock.scale)) + Fraction(clock.offset_s)

    def _time_factor(self, key: str, clock: mapfile.Clock) -> float:
        stream = self._stream(key, clock.path or "")
        if not (clock.unit or stream.unit):
            _ = stream.values  # texts that are not times have their own message, which no unit would avoid
        return self._factor(key, stream, clock, units.TIME)[0]

    def _times(self, key: str, clock: mapfile.Clock, rows: BoolArray | None = None, whole: bool = False) -> Times:
        path = clock.path or ""
        held = (clock, b"" if rows is None or rows.all() else rows.tobytes())
        if held not in self._clocks:
            factor = self._time_factor(f"{key}.clock", clock)
            values = self._counts(key, path, rows)
            if self._zero:
                # integer nanoseconds since 1970 exceed float64, their differences do not
                first = float(self._exact(clock, values[0], factor) - self._zero)
                seconds: Array = np.asarray(values - values[0], np.float64) * (factor * clock.scale) + first
            else:
                seconds = np.asarray(values, np.float64) * (factor * clock.scale) + clock.offset_s
            if clock.nanoseconds is not None:
                seconds += 1e-9 * np.asarray(self._counts(key, clock.nanoseconds, rows), np.float64)
            own = np.arange(len(seconds)) if rows is None else np.flatnonzero(rows)
            stream = self._stream(key, path)
            several = selection.sensors(self.recording.streams, stream.rows, own, seconds) if whole and key in _SENSORS else None
            if several is not None:
                raise self.error(key, path, several.message)
            if clock.even and np.diff(seconds).any():
                seconds = self._even(key, path, seconds)
            problem = clocks.problem(seconds, lambda at: stream.place(int(own[at])), float(self._zero), key in _SENSORS)
            if problem:
                raise self.error(f"{key}.clock", path, problem)
            self._clocks[held] = Times(path, seconds, float(self._zero))
        return self._clocks[held]

    def _even(self, key: str, path: str, stamps_s: Array) -> Array:
        """(n,) evenly spaced times of samples. Raises :class:`InputError` if time stamps wander too far from such times."""
        even, wander = resample.even(stamps_s)
        step = f"{even[1] - even[0]:.9g} s"
        if wander > clocks.MAX_WANDER:
            problem = f"its stamps wander by {wander:.2g} samples from even intervals of {step}: samples were lost, or the rate changed"
            raise self.error(f"{key}.clock", path, f"{problem}; drop even")
        scatter = float((stamps_s - even).std())
        self.conversions.append(f"{key}: stamps by {path!r} scatter by {scatter:.3g} s; its samples are taken as coming every {step}")
        return even
