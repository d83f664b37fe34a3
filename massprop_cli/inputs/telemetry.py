"""A table of telemetry to a checked :class:`Log`.

A log is one row per IMU record; a record covers ``(previous time_s, time_s]``. Everything is checked here, once;
later stages trust the arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, frozen, median
from massprop_cli.base.configfile import nearest
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, FIXED, GYRO, QUATERNION, WRENCH, jet
from massprop_cli.inputs.formats import agreement
from massprop_cli.inputs.section import LEAST
from massprop_cli.inputs.tablefile import Made, Table
from massprop_cli.inputs.vehicle import Column, Vehicle

GAP, LONG = 2.5, 1.5
ABSURD = 1e6
"""No vehicle turns at 1e6 rad/s or accelerates at 1e6 m/s²."""
SATURATED = ("gyro-saturated", "accelerometer-saturated")
"""Codes of notices that a sensor was at the end of its range."""


@dataclass(frozen=True)
class Notice:
    """Something a reader must know; ``code`` is stable, ``message`` names numbers and a remedy."""

    code: str
    message: str


@dataclass(frozen=True)
class Log:
    """A checked recording. ``n`` IMU records, ``K`` control cycles of ``records_per_cycle`` records each."""

    path: Path
    sha256: str
    rows: int
    records_per_cycle: int
    time_s: Array
    """(n,) end of each record."""
    interval_s: Array
    """(n,) length of each record."""
    delta_theta_imu_rad: Array
    """(n, 3) angle increments, IMU axes."""
    delta_v_imu_m_s: Array
    """(n, 3) velocity increments (specific force), IMU axes."""
    command_kind: Literal["jets", "wrench"]
    command: Array
    """(K, jets) on-times in s, or (K, 6) mean torque about O [N m] and force [N], body axes."""
    attitude_wxyz: Array | None
    """(n, 4) logged attitude at ``time_s``, world ← body."""
    notices: tuple[Notice, ...]
    rate_columns: tuple[str, ...] = DELTA_THETA
    """The contract's names of the columns that the gyro's increments came from."""
    force_columns: tuple[str, ...] = DELTA_V
    """The same of the accelerometer's."""
    made: Made | None = None
    """How a map made it of another recording."""
    ignored: BoolArray | None = None
    """(K, 2) cycles whose gyro, whose accelerometer is not used; none of them by default."""
    began_s: float | None = None
    """When the log began that this is a part of; None: it is the whole."""

    @property
    def cycles(self) -> int:
        """How many control cycles."""
        return len(self.command)

    def part(self, first: int, stop: int) -> Log:
        """Of control cycles from ``first`` to before ``stop`` alone."""
        rows = slice(first * self.records_per_cycle, stop * self.records_per_cycle)
        return replace(
            self,
            time_s=self.time_s[rows],
            interval_s=self.interval_s[rows],
            delta_theta_imu_rad=self.delta_theta_imu_rad[rows],
            delta_v_imu_m_s=self.delta_v_imu_m_s[rows],
            command=self.command[first:stop],
            attitude_wxyz=None if self.attitude_wxyz is None else self.attitude_wxyz[rows],
            ignored=None if self.ignored is None else self.ignored[first:stop],
            began_s=self.origin_s,
        )

    @property
    def origin_s(self) -> float:
        """When the whole log began."""
        return float(self.time_s[0] - self.interval_s[0]) if self.began_s is None else self.began_s

    @property
    def cycle_end_s(self) -> Array:
        """(K,) end of each control cycle."""
        return self.time_s[self.records_per_cycle - 1 :: self.records_per_cycle]


def read(table: Table, vehicle: Vehicle) -> Log:
    """Check a table against the vehicle and the contract.

    Raises :class:`InputError` with file, row (Parquet, from 0) or line (CSV), column, value and remedy.
    """
    source = _Source(table, vehicle.columns)
    time_s = source.required("time_s")
    interval_s, notices = _intervals(source, time_s)
    records = _records_per_cycle(source, interval_s, vehicle.cycle.period_s)
    cycles = table.rows // records
    if cycles < 2:
        raise InputError(
            f"{table.path}: {table.rows} rows of {median(interval_s):g} s are not two control cycles of "
            f"{vehicle.cycle.period_s:g} s; record longer, or mend cycle.period_s"
        )
    n = cycles * records
    theta = source.increments(DELTA_THETA, GYRO, interval_s)
    velocity = source.increments(DELTA_V, ACCEL, interval_s)
    for names, rates, increments in ((DELTA_THETA, GYRO, theta), (DELTA_V, ACCEL, velocity)):
        _check_magnitude(source, names if source.has(names[0]) else rates, increments / interval_s[:, None])
    kind, command = _commands(source, vehicle, records, n)
    attitude = _attitude(source)
    notices += saturation(vehicle, theta / interval_s[:, None], velocity / interval_s[:, None])
    if table.made is not None:
        agreement.check(table.path, table.made, vehicle, theta[:n], velocity[:n] / interval_s[:n, None], attitude)
    return Log(
        path=table.path,
        sha256=table.sha256,
        rows=table.rows,
        records_per_cycle=records,
        time_s=frozen(time_s[:n]),
        interval_s=frozen(interval_s[:n]),
        delta_theta_imu_rad=frozen(theta[:n]),
        delta_v_imu_m_s=frozen(velocity[:n]),
        command_kind=kind,
        command=frozen(command),
        attitude_wxyz=None if attitude is None else frozen(attitude[:n]),
        notices=tuple(notices),
        rate_columns=DELTA_THETA if source.has(DELTA_THETA[0]) else GYRO,
        force_columns=DELTA_V if source.has(DELTA_V[0]) else ACCEL,
        made=table.made,
    )


class _Source:
    """Contract columns of a table, under this log's own names and scales."""

    def __init__(self, table: Table, columns: Mapping[str, Column]) -> None:
        self.table, self.columns = table, columns
        for known, column in columns.items():
            if column.from_ not in table.columns:
                hint = nearest(column.from_, table.columns, "the nearest present is")
                raise InputError(f"{table.path}: column {column.from_!r} is missing, which [columns] maps to {known}{hint}")

    def name(self, column: str) -> str:
        mapped = self.columns.get(column)
        return mapped.from_ if mapped else column

    def has(self, column: str) -> bool:
        return self.name(column) in self.table.columns

    def place(self, row: int) -> str:
        return self.table.places.of(row)

    def error(self, row: int, column: str, problem: str) -> InputError:
        return InputError(f"{self.table.path}, {self.place(row)}, column {self.name(column)}: {problem}")

    def optional(self, column: str) -> Array:
        """The column, scaled, with NaN for null."""
        name = self.name(column)
        if name not in self.table.columns:
            used = {self.name(known) for known in FIXED if self.has(known)} | {n for n in self.table.columns if n.startswith("jet_")}
            spare = [present for present in self.table.columns if present not in used - {name}] or list(self.table.columns)
            hint = nearest(name, spare, "the nearest present is")
            raise InputError(
                f"{self.table.path}: column {name!r} is missing{hint}; rename it, or map it under [columns] of the vehicle file"
            )
        numbers: Array = self.table.columns[name].numbers()
        scaled = numbers * (self.columns[column].scale if column in self.columns else 1.0)
        # what underflows when it is squared is a zero that was calculated
        return np.where(np.abs(scaled) < LEAST, 0.0, scaled)

    def required(self, column: str) -> Array:
        """The column, scaled; every cell must be a finite number."""
        values = self.optional(column)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            cell = "nan or an empty cell" if np.isnan(values[bad[0]]) else f"{values[bad[0]]}"
            raise self.error(int(bad[0]), column, f"{cell} is not a finite number; mend or cut the record")
        return values

    def increments(self, names: Sequence[str], rates: Sequence[str], interval_s: Array) -> Array:
        """(n, 3) increments, or rates times the interval where the increments are absent."""
        if not any(self.has(name) for name in names) and any(self.has(name) for name in rates):
            return np.stack([self.required(name) for name in rates], 1) * interval_s[:, None]
        return np.stack([self.required(name) for name in names], 1)


def _intervals(source: _Source, time_s: Array) -> tuple[Array, list[Notice]]:
    if len(time_s) < 2:
        raise InputError(f"{source.table.path}: one row only; a log needs at least two control cycles")
    steps = np.diff(time_s)
    back = np.flatnonzero(steps <= 0)
    if back.size:
        row = int(back[0]) + 1
        verb = "stands still" if steps[back[0]] == 0 else "goes back"
        raise source.error(row, "time_s", f"time {verb}: {time_s[row]:.9g} s after {time_s[row - 1]:.9g} s; sort or cut the log")
    usual = median(steps)
    gap = np.flatnonzero(steps > GAP * usual)
    if gap.size:
        row = int(gap[0]) + 1
        raise source.error(
            row,
            "time_s",
            f"a gap of {steps[gap[0]]:.6g} s after {time_s[row - 1]:.9g} s (median interval {usual:.6g} s); split the log there",
        )
    long = np.flatnonzero(steps > LONG * usual)
    notices = []
    if long.size:
        row = int(long[0]) + 1
        notices.append(
            Notice(
                "long-interval",
                f"{long.size} record(s) longer than {LONG:g} times the median interval of {usual:.6g} s, the first at "
                f"{source.place(row)} ({steps[long[0]]:.6g} s); each counts with its own length",
            )
        )
    return np.concatenate([[usual], steps]), notices


def _check_magnitude(source: _Source, names: Sequence[str], rates: Array) -> None:
    bad = np.argwhere(np.abs(rates) > ABSURD)
    if bad.size:
        row, axis = (int(i) for i in bad[0])
        value = f"{rates[row, axis]:.3g} per second"
        raise source.error(row, names[axis], f"{value} is no motion of a vehicle; is the unit right, is it a spike?")


def _records_per_cycle(source: _Source, interval_s: Array, period_s: float) -> int:
    usual = median(interval_s)
    records = round(period_s / usual)
    if records < 1 or abs(records * usual / period_s - 1) > 0.2:
        raise InputError(
            f"{source.table.path}, column {source.name('time_s')}: a median interval of {usual:.6g} s does not divide the control "
            f"cycle of {period_s:g} s; is time in seconds ([columns] can scale it), is cycle.period_s right?"
        )
    return records


def _commands(source: _Source, vehicle: Vehicle, records: int, n: int) -> tuple[Literal["jets", "wrench"], Array]:
    path = source.table.path
    mapped = {column.from_: name for name, column in vehicle.columns.items()}
    logged = [mapped.get(name, name) for name in source.table.columns]
    jets = [name.removeprefix("jet_").removesuffix("_s") for name in logged if name.startswith("jet_") and name.endswith("_s")]
    known = [each.name for each in vehicle.jets]
    for name in jets:
        if name not in known:
            hint = nearest(name, known, "the nearest jet is") or "; it has no [[jets]] at all"
            raise InputError(f"{path}: column {jet(name)!r} names a jet that the vehicle file lacks{hint}. Add it to the vehicle file")
    wrench = any(source.has(name) for name in WRENCH)
    if jets and wrench:
        raise InputError(f"{path}: has both jet_* and cmd_* columns; keep the one kind that was executed")
    if wrench:
        return "wrench", np.stack([_per_cycle(source, name, records, n) for name in WRENCH], 1)
    if not known:
        raise InputError(f"{path}: no commands: neither jet_*_s nor cmd_torque_*/cmd_force_* columns, and the vehicle file has no [[jets]]")
    command = np.stack([_per_cycle(source, jet(name), records, n) for name in known], 1)
    _check_on_times(source, known, command, records, vehicle.cycle.period_s)
    return "jets", command


def _per_cycle(source: _Source, column: str, records: int, n: int) -> Array:
    """(K,) the command in the first row of each cycle; other rows must be null or the same."""
    values = source.optional(column)[:n]
    bad = np.flatnonzero(np.isinf(values))
    if bad.size:
        raise source.error(int(bad[0]), column, f"{values[bad[0]]} is not a finite number; mend or cut the record")
    grid = values.reshape(-1, records)
    first = grid[:, :1]
    missing = np.flatnonzero(np.isnan(first[:, 0]))
    if missing.size:
        raise source.error(int(missing[0]) * records, column, "no command in the first row of its control cycle; write one (0 for none)")
    differs = np.argwhere(~np.isnan(grid) & (grid != first))
    if differs.size:
        cycle, row = (int(i) for i in differs[0])
        raise source.error(
            cycle * records + row,
            column,
            f"{grid[cycle, row]:g} differs from {first[cycle, 0]:g} in the first row of its control cycle; "
            "commands change at cycle starts only: check cycle.period_s and the first row",
        )
    return np.ascontiguousarray(first[:, 0])


def _check_on_times(source: _Source, names: Sequence[str], on_s: Array, records: int, period_s: float) -> None:
    checks: list[tuple[Callable[[Array], Any], str]] = [
        (lambda t: t < 0, "negative on-time; an on-time is 0 or more"),
        (lambda t: t > period_s * (1 + 1e-6), f"longer than the control cycle of {period_s:g} s; is it in seconds?"),
    ]
    for check, problem in checks:
        bad = np.argwhere(check(on_s))
        if bad.size:
            cycle, number = (int(i) for i in bad[0])
            raise source.error(cycle * records, jet(names[number]), f"{on_s[cycle, number]:g} s: {problem}")


def _attitude(source: _Source) -> Array | None:
    if not any(source.has(name) for name in QUATERNION):
        return None
    quaternion = np.stack([source.required(name) for name in QUATERNION], 1)
    norm = np.linalg.norm(quaternion, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1) > 1e-2)
    if bad.size:
        raise source.error(
            int(bad[0]), "quat_w", f"the quaternion's norm is {norm[bad[0]]:.4g}, not 1; quaternions are wxyz, world from body"
        )
    unit: Array = quaternion / norm[:, None]
    return unit


def saturation(vehicle: Vehicle, rate: Array, force: Array) -> list[Notice]:
    """Warnings of a range that was reached; mean rate [rad/s] and specific force [m/s²] of each record, (N, 3)."""
    found = []
    for name, values, limit, unit in (
        ("gyro", rate, vehicle.imu.gyro_range_rad_s, "rad/s"),
        ("accelerometer", force, vehicle.imu.accel_range_m_s2, "m/s^2"),
    ):
        count = 0 if limit is None else int((np.abs(values) >= 0.999 * limit).any(1).sum())
        if count:
            found.append(
                Notice(
                    f"{name}-saturated",
                    f"{count} record(s) at the {name}'s range of {limit:g} {unit}; what they hid is not in the estimate",
                )
            )
    return found
