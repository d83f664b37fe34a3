"""What a map names, found in a recording: numbers in SI units with the times at which they hold."""

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
from massprop_cli.inputs.held import moving_mean, on_a_beat
from massprop_cli.inputs.logtable import EMPTY
from massprop_cli.inputs.marked import fills
from massprop_cli.inputs.vehicle import ACTUATORS

_SHOWN = 5
_SENSORS = ("gyro", "accelerometer")
_COLUMNS = (columns.GYRO, columns.DELTA_THETA), (columns.ACCEL, columns.DELTA_V)
"""Of rates and increments of these."""


@dataclass(frozen=True)
class QuantitySignal:
    """Numbers of one quantity, SI."""

    key: str
    """In the map file."""
    paths: tuple[str, ...]
    values: Array
    """(n, axes)"""
    times: Times


class Signals:
    """A recording under a map. Every error names the file, the path in it, and what the map should say."""

    def __init__(self, recording: Recording, source: mapfile.MapSource) -> None:
        self.recording, self.map, self.source = recording, source.map, source.source
        self.made: list[str] = []
        """What was done, for whoever reads the result."""
        self.again = dict[str, str]()
        """Of sensors whose readings are repeated, that they are."""
        self.sampled = False, False
        """Whether what is handed on of gyro and accelerometer are samples at their times."""
        self._clocks: dict[tuple[mapfile.Clock, bytes], Times] = {}
        self._gyro: Times | None = None
        self._zero = Fraction(0)
        records = self.map.records
        if records is not None and records.zero == "start":
            said = self._clock_of("gyro", self._paths("gyro", self.map.gyro.paths, 3), self.map.gyro.clock)
            counts = self._stream("gyro.clock", said.path or "").values
            first = counts[np.isfinite(counts)][:1] if np.isfinite(counts).any() else self._counts("gyro", said.path or "")
            self._zero = self._exact(said, first[0], self._time_factor("gyro.clock", said))

    def error(self, key: str, path: str, problem: str) -> InputError:
        """What is wrong with a path under a key of the map."""
        return InputError(f"{self.recording.path}, {path!r}: {problem} ([{key}] of {self.source})")

    def refused(self, signal: QuantitySignal, problem: str) -> InputError:
        """What is wrong with the samples of a quantity."""
        return self.error(signal.key, signal.paths[0] if signal.paths else "", problem)

    def sensor(self, key: str, said: mapfile.MappedSensor, rates: Mapping[str, float], increments: Mapping[str, float]) -> QuantitySignal:
        """Gyro or accelerometer, the sensor's axes turned as the map says."""
        found = self.vector(key, said, increments if said.values == "increment" else rates)
        self._gyro = found.times if key == "gyro" else self._gyro
        if not self._apart and (again := on_a_beat(found.values)).any():
            usual = len(again) / (~again).sum()
            every = usual * found.times.step_s
            problem = (
                f"repeats each reading {usual:.3g} times: the sensor measures every {every:.6g} s, and the file holds its last reading "
                f"in between; state [records], interval_s = {every:.6g}, by which each counts once"
            )
            raise self.refused(found, problem)
        if mean := moving_mean(found.values):
            problem = f"each reading is a moving mean over {mean} of them; record it as it was measured, or keep every one in {mean}"
            raise self.refused(found, problem)
        lost = clocks.coverage_defect(self.recording.streams, found.paths, found.times.step_s) if said.values == "increment" else ""
        if lost:
            raise self.refused(found, lost)
        return found

    def imu(self) -> list[tuple[QuantitySignal, resample.Values]]:
        """Gyro, and the accelerometer where the map has one; each with what its numbers are."""
        found = [(self.sensor("gyro", self.map.gyro, units.SPIN, units.ANGLE), self.map.gyro.values)]
        said = self.map.accelerometer
        if said is not None:
            found.append((self.sensor("accelerometer", said, units.ACCELERATION, units.SPEED), said.values))
        return found

    def as_recorded(self, imu: Sequence[tuple[QuantitySignal, resample.Values]], rows: slice = slice(None)) -> dict[str, Array]:
        """Columns of gyro and accelerometer, as they are in some rows of the file; samples stay samples at their times."""
        gyro, *others = (kind == "sample" for _, kind in imu)
        self.sampled = gyro, others[0] if others else gyro
        made: dict[str, Array] = {}
        for (signal, kind), (rates, increments) in zip(imu, _COLUMNS, strict=False):
            made |= dict(zip(increments if kind == "increment" else rates, signal.values[rows].T, strict=True))
        return made

    def wrenches(self) -> list[tuple[str, mapfile.MappedWrench, dict[str, float], tuple[str, ...]]]:
        """Commanded torque and force where the map has them: key, entry, units, columns."""
        torque, force = self.map.torque, self.map.force
        both = (("torque", torque, units.TORQUE, columns.WRENCH[:3]), ("force", force, units.FORCE, columns.WRENCH[3:]))
        return [(key, wrench, known, names) for key, wrench, known, names in both if wrench is not None]

    def jet(self, name: str, said: mapfile.MappedJet) -> tuple[QuantitySignal, bool]:
        """On-times in s, or openings from 0 to 1; and whether it is these."""
        key = f"jets.{name}"
        if said.path == 0:
            return self._throughout(key, np.zeros(1)), False
        stream = self._stream(key, said.path)
        clock = self._clock_of(key, [said.path], said.clock)
        if said.bit is not None:
            return self._signal(key, [stream.path], self._bit(key, stream, said.bit)[:, None], clock, said.where), True
        known = {unit: value for unit, value in units.TIME.items() if unit != "ns"} | units.SHARE
        factor, unit = self._factor(key, stream, said, known)
        values = (self._numbers(key, stream, empty=True) + said.offset) * (factor * said.scale)
        signal = self._signal(key, [stream.path], values[:, None], clock, said.where)
        return signal, unit in units.SHARE

    def _bit(self, key: str, stream: RecordedStream, bit: int) -> Array:
        """(n,) whether a bit of a whole number is set: 0, 1, and NaN where there is no number."""
        values = self._numbers(key, stream, empty=True)
        bad = np.flatnonzero((values < 0) | (~np.isnan(values) & (values % 1 != 0)))
        if bad.size:
            where = stream.place(int(bad[0]))
            raise self.error(key, stream.path, f"{values[bad[0]]:g} at {where} is not an integer of bits; drop bit, or name another path")
        return np.where(np.isnan(values), values, np.nan_to_num(values).astype(np.int64) >> bit & 1)

    def spinners(self) -> Iterator[tuple[QuantitySignal, str, Literal["mean", "instant"], resample.Holds]]:
        """Of actuators: a signal, its column, whether it is held or read off at records' ends, and over what time it holds."""
        for table, kind in ACTUATORS.items():
            known = {unit: factor for column in kind.COLUMNS for unit, factor in column.units.items()}
            for name, said in getattr(self.map, table).items():
                signal, unit = self._number(f"{table}.{name}", said, said.path, known)
                column = next(column for column in kind.COLUMNS if units.factor(unit, column.units) is not None)
                yield signal, column.of(name), "instant" if column.instant else "mean", said.holds
        if self.map.supply is not None:
            signal, unit = self._number("supply", self.map.supply, self.map.supply.path, units.VOLTAGE | units.PRESSURE)
            yield signal, columns.PRESSURE if unit in units.PRESSURE else columns.SUPPLY, "instant", "until_next"

    def _number(self, key: str, said: mapfile.Mapped, path: str, known: Mapping[str, float]) -> tuple[QuantitySignal, str]:
        stream = self._stream(key, path)
        factor, unit = self._factor(key, stream, said, known)
        values = self._numbers(key, stream, empty=self._apart or said.where is not None) * (factor * said.scale)
        return self._signal(key, [stream.path], values[:, None], self._clock_of(key, [path], said.clock), said.where), unit

    def attitude(self, said: mapfile.Attitude) -> QuantitySignal:
        """Unit quaternions wxyz, the file's own world from body."""
        paths = [str(path) for path in self._paths("attitude", said.paths, 1 if said.order == "heading" else 4)]
        columns = [self._numbers("attitude", self._stream("attitude", path), self._apart or said.where is not None) for path in paths]
        recorded = self._together("attitude", paths, columns)
        if said.order == "heading":
            recorded = recorded * (self._factor("attitude", self._stream("attitude", paths[0]), said, units.ANGLE)[0] * said.scale)
        recorded = np.where(self._chosen("attitude", paths, said.where, len(recorded))[:, None], recorded, np.nan)

        def refused(row: int, norm: float) -> InputError:
            at = self._stream("attitude", paths[0]).place(row)
            return self.error(
                "attitude", paths[0], f"the quaternion's norm is {norm:.4g} at {at}, not 1; check that these are its four parts"
            )

        turned = resample.quaternions(said, recorded, refused)
        return self._signal("attitude", paths, turned, self._clock_of("attitude", paths, said.clock), said.where)

    def vector(self, key: str, said: mapfile.MappedVector, known: Mapping[str, float]) -> QuantitySignal:
        """Three axes, turned as the map says, of units that are ``known``; of a command in the frame that the map states."""
        paths = self._paths(key, said.paths, 3)
        streams = [self._stream(key, path) if isinstance(path, str) else None for path in paths]
        columns = []
        for path, stream in zip(paths, streams, strict=True):
            if stream is None:
                columns.append(np.array([float(path)]))
                continue
            factor, _ = self._factor(key, stream, said, known)
            numbers = self._numbers(key, stream, empty=self._apart or key in ("torque", "force", *_SENSORS))
            if key in _SENSORS:  # before a unit makes them other numbers
                numbers = np.where(fills(numbers, 1.0), np.nan, numbers)
            columns.append(numbers * (factor * said.scale))
        named = [path for path in paths if isinstance(path, str)]
        rows = max(map(len, columns)) if named else 1
        columns = [np.full(rows, column[0]) if stream is None else column for column, stream in zip(columns, streams, strict=True)]
        values = self._together(key, [str(path) for path in paths], columns)
        turned = np.stack([values[:, "xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1) for axis in said.axes], 1)
        if not named:
            return self._throughout(key, turned[0])
        return self._signal(key, named, turned, self._clock_of(key, named, said.clock), said.where)

    def _throughout(self, key: str, values: Array) -> QuantitySignal:
        """What the map states itself, at the gyro's times."""
        gyro = self._paths("gyro", self.map.gyro.paths, 3)
        times = self._gyro or self._times("gyro", self._clock_of("gyro", gyro, self.map.gyro.clock))
        return QuantitySignal(key, (), np.broadcast_to(values, (len(times.s), len(values))), times)

    def _signal(self, key: str, paths: Sequence[str], values: Array, clock: mapfile.Clock, where: mapfile.Where | None) -> QuantitySignal:
        rows = self._stream(f"{key}.clock", clock.path or "").rows
        if rows != len(values):
            raise self.error(key, paths[0], f"has {len(values)} samples and its clock {clock.path!r} {rows}; name the clock it has")
        held = self._chosen(key, paths, where, rows)
        if where is not None:
            self.made.append(f"{key}: the {held.sum()} of {rows} rows whose {where.column!r} is {selection.stated(where.values, ' or ')}")
        if self._apart:
            own = np.flatnonzero(held)
            held[own] = self._held(key, paths, values[own], own)
        return QuantitySignal(key, tuple(paths), values[held], self._times(key, clock, held, where is None))

    def _chosen(self, key: str, paths: Sequence[str], where: mapfile.Where | None, rows: int) -> BoolArray:
        """(rows,) which the map means."""
        found = np.ones(rows, dtype=bool) if where is None else selection.rows_of(self.recording, where, rows)
        if isinstance(found, str):
            raise self.error(key, paths[0], found)
        return found

    @property
    def _apart(self) -> bool:
        """Whether streams have clocks of their own; then a row of a table may hold samples of some of them alone."""
        return self.map.records is not None

    def _held(self, key: str, paths: Sequence[str], values: Array, rows: IntArray) -> BoolArray:
        """(n,) which of the file's ``rows`` hold a sample, which has a number for every axis."""
        empty = np.isnan(values)
        # an axis that the map states as a number has one in every row
        recorded = empty.any(0) | (values != values[0]).any(0)
        none: BoolArray = empty[:, recorded].all(axis=1) & recorded.any()
        if key in _SENSORS and (again := on_a_beat(values[~none])).any():
            usual = len(again) / (~again).sum()
            self.again[key] = f"repeats each reading {usual:.3g} times, so that it measures"
            self.made.append(f"{key}: each reading is repeated {usual:.3g} times, and counts once")
            none[~none] = again
        part = empty.any(1) & ~none
        if key in _SENSORS and part.sum() <= EMPTY * (~none).sum():
            none = none | part  # a reading without one of its axes is lost
        some = np.flatnonzero(empty.any(1) & ~none)
        if none.all() or some.size:
            row = int(some[0]) if some.size else 0
            where = self._stream(key, paths[0]).place(int(rows[row]))
            problem = "no sample has a number" if none.all() else f"a number is missing at {where}, beside other axes'; correct the row"
            raise self.error(key, paths[0], problem)
        if none.any():
            self.made.append(f"{key}: {int(none.sum())} of {len(none)} rows of the file hold none of its samples")
        return ~none

    def _together(self, key: str, paths: Sequence[str], columns: Sequence[Array]) -> Array:
        lengths = {len(column) for column in columns}
        if len(lengths) > 1:
            said = ", ".join(f"{path!r} {len(column)}" for path, column in zip(paths, columns, strict=True))
            raise self.error(key, paths[0], f"axes have different numbers of samples ({said}); name streams that belong together")
        return np.stack(columns, 1)

    def _paths(self, key: str, said: str | Sequence[str | float], count: int) -> list[str | float]:
        """The paths that are meant, a pattern resolved."""
        found: list[str | float] = list(said) if not isinstance(said, str) else list(fitting(said, list(self.recording.streams)))
        if isinstance(said, str) and len(found) != count:
            listed = ", ".join(map(repr, found[:_SHOWN])) + (", …" if len(found) > _SHOWN else "")
            if not found and (why := self.recording.why_unread(said)):
                raise self.error(key, said, why)
            hint = listed or f"nothing{nearest(said, self.recording.streams, 'the nearest path is')}"
            raise self.error(key, said, f"the pattern fits {len(found)} paths, not {count}: {hint}; massprop columns lists all")
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
        """To SI by the unit that is stated or recorded; it is refused where these contradict each other."""
        said, recorded = stated.unit, units.plain(stream.unit)
        text = said or recorded
        choices = ", ".join(known)
        if not text:
            raise self.error(key, stream.path, f"the file records no unit; state unit = one of {choices}")
        factor = units.factor(text, known)
        if factor is None:
            way = "" if said else f"; or state one of these as unit, and scale, what one {text} is in it"
            raise self.error(key, stream.path, f"unit {text!r} is none of this quantity; it is one of {choices}{way}")
        if said and recorded and recorded != units.plain(said):
            if units.factor(recorded, known) is not None:
                problem = f"the map says unit {said!r}, the file {stream.unit!r}; drop unit from the map, or correct it"
                raise self.error(key, stream.path, problem)
            known_or_not = units.is_any(recorded) or units.is_foreign(stream.unit)
            if known_or_not and "scale" not in stated.model_fields_set:
                cure = f"state scale beside it, what one {stream.unit} is in {said}; 1.0 where the file is wrong"
                raise self.error(key, stream.path, f"the map says unit {said!r}, and the file {stream.unit!r}, which is none here: {cure}")
        return factor, units.plain(text)

    def _clock_of(self, key: str, paths: Sequence[str | float], said: mapfile.Clock | None) -> mapfile.Clock:
        """The clock with a path: of the quantity, of the stream as the file says, of the map for those of which it says none."""
        named = [path for path in paths if isinstance(path, str)]
        own = next((self._stream(key, path).clock for path in named), "")
        common = self.map.clock
        if own and own != common.path:
            common = mapfile.Clock() if common.path else common.model_copy(update={"unit": None})
        stated = said or common
        if stated.path is None and not own:
            like = self.clocks_like(named[0])[:_SHOWN] if named else []
            hint = f": {' or '.join(map(repr, like))} by its rows" if like else ""
            raise self.error(key, named[0] if named else "", f"the file doesn't say which stream has its times; state clock.path{hint}")
        return stated if stated.path is not None else stated.model_copy(update={"path": own})

    def clocks_like(self, path: str) -> list[str]:
        """Streams that increase and have a number in just the rows of this one."""
        return listing.Clocks(self.recording).of(self.recording.streams[path])

    def _counts(self, key: str, path: str, held: BoolArray | None = None) -> Numbers:
        """A clock's numbers as recorded, in the rows that are held, all finite, whole ones with a sign."""
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
        """A time in seconds, without rounding."""
        return Fraction(value.item()) * Fraction(str(factor)) * Fraction(str(clock.scale)) + Fraction(clock.offset_s)

    def _time_factor(self, key: str, clock: mapfile.Clock) -> float:
        stream = self._stream(key, clock.path or "")
        if not (clock.unit or stream.unit):
            _ = stream.values  # texts that are no times are told as that: no unit would help
        return self._factor(key, stream, clock, units.TIME)[0]

    def _times(self, key: str, clock: mapfile.Clock, rows: BoolArray | None = None, whole: bool = False) -> Times:
        path = clock.path or ""
        held = (clock, b"" if rows is None or rows.all() else rows.tobytes())
        if held not in self._clocks:
            factor = self._time_factor(f"{key}.clock", clock)
            values = self._counts(key, path, rows)
            if self._zero:
                # whole nanoseconds since 1970 don't fit a float: their differences do
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
                raise self.error(key, path, several.said)
            if clock.even and np.diff(seconds).any():
                seconds = self._even(key, path, seconds)
            problem = clocks.problem(seconds, lambda at: stream.place(int(own[at])), float(self._zero), key in _SENSORS)
            if problem:
                raise self.error(f"{key}.clock", path, problem)
            self._clocks[held] = Times(path, seconds, float(self._zero))
        return self._clocks[held]

    def _even(self, key: str, path: str, stamps_s: Array) -> Array:
        """(n,) times of samples that come at even intervals; :class:`InputError` where their stamps tell that they don't."""
        even, wander = resample.even(stamps_s)
        step = f"{even[1] - even[0]:.9g} s"
        if wander > clocks.MAX_WANDER:
            problem = f"its stamps wander by {wander:.2g} samples from even intervals of {step}: samples were lost, or the rate changed"
            raise self.error(f"{key}.clock", path, f"{problem}; drop even")
        scatter = float((stamps_s - even).std())
        self.made.append(f"{key}: stamps by {path!r} scatter by {scatter:.3g} s; its samples are taken as coming every {step}")
        return even
