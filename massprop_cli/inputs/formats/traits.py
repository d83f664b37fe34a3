"""Properties of a vehicle that a log shows without a vehicle file: cycle, noise, gravity, commands."""

import math
from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators.actuator import Actuator, LogColumn
from massprop_cli.inputs.formats.clocks import outlying
from massprop_cli.inputs.logtable import EMPTY, LogTable
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.vehicle import ACTUATORS

SETTLE = 4
"""Number of cycles without command before a quiet cycle, for delay and decay of thrust."""
ENOUGH = 20
"""Minimum number of quiet cycles for a mean, ..."""
PRECISE = 130
"""... and for a noise level to 5 %: its relative sigma is 0.57 / √N from second differences of three axes."""
_SAME = 1e-9
_TICK, _ROUNDED = 1e-3, 1e-3
"""Smallest tick as a fraction of the longest on-time, and rounding of on-times as a fraction of that tick."""
_CLIPPED = 5
"""Minimum number of records at one extreme for saturation."""


@dataclass(frozen=True)
class Traits:
    """Properties of a log's vehicle; None if the log does not show it."""

    interval_s: Array
    """(n - 1,) intervals of the records, s."""
    issued_s: float | None
    """Median interval of commands with time stamps of their own, s."""
    choices: tuple[int, ...]
    """Possible numbers of records per control cycle, ascending: on-times that change together give only a multiple."""
    commands: Mapping[str, Array]
    """Commands by column: (K,) of each cycle, or of each record if cycles are unknown."""
    actuators: Mapping[type[Actuator], Mapping[str, LogColumn]]
    """Log column of each actuator, by kind and name."""
    quiet: int
    """Number of quiet cycles: without command, after decay."""
    gyro_noise: Array | None
    """(3,) one sigma of a cycle's mean, rad/s."""
    accel_noise: Array | None
    """(3,) one sigma of a cycle's mean, m/s²."""
    gyro_mean: Array | None
    """(3,) mean rate in quiet cycles, rad/s."""
    force_m_s2: float | None
    """Median specific force in quiet cycles, m/s²."""
    force_always_m_s2: float
    """Median specific force over the whole log, m/s²."""
    gyro_clipped: float | None
    """Extreme that many records share, rad/s."""
    accel_clipped: float | None

    @property
    def records(self) -> int | None:
        """Smallest possible number of records per control cycle; None without changes of a command."""
        return self.choices[0] if self.choices else None

    @property
    def period_s(self) -> float:
        """Length of a control cycle, or of a record if cycles are unknown, s."""
        return self.issued_s or median(self.interval_s) * (self.records or 1)


def traits(table: Table) -> Traits:
    """Properties of a log. Raises :class:`InputError` without IMU, or for times that go back."""
    time_s = _numbers(table, (columns.TIME,))[:, 0]
    far, why = outlying(time_s)
    LogTable(table, {}).refuse(far, columns.TIME, lambda row: f"{time_s[row]:.9g} s {why}")
    steps = np.diff(time_s)
    if len(steps) < 2 or not (steps > 0).all():
        raise InputError(f"{table.path}: {columns.TIME} does not increase throughout; sort or cut the log")
    interval = np.concatenate([[median(steps)], steps])[:, None]
    rate = _rates(table, columns.DELTA_THETA, columns.GYRO, interval)
    force = _rates(table, columns.DELTA_V, columns.ACCEL, interval)
    actuators = {kind: _named(table, kind) for kind in ACTUATORS.values()}
    mean_commands = {has.of(name) for kind, own in actuators.items() for name, has in own.items() if kind.THRUSTS and not has.instant}
    names = [name for name in table.columns if name in columns.WRENCH or name in mean_commands or columns.is_jet(name)]
    raw = {name: table.columns[name].numbers() for name in names}
    stamps = table.columns[columns.COMMAND_TIME].numbers() if columns.COMMAND_TIME in table.columns else np.zeros(0)
    apart_s = np.diff(stamps[np.isfinite(stamps)])
    issued_s = median(apart_s) if len(apart_s) else None
    choices = _records(raw, median(steps)) if issued_s is None else (max(round(issued_s / median(steps)), 1),)
    count = choices[0] if choices else 1
    whole = len(time_s) // count * count
    weight = interval[:whole].reshape(-1, count, 1)
    mean_rate, mean_force = ((v[:whole].reshape(-1, count, 3) * weight).sum(1) / weight.sum(1) for v in (rate, force))
    commands = {name: values[:whole:count] if issued_s is None else values[~np.isnan(values)] for name, values in raw.items()}
    quiet = _quiet(raw, count, len(mean_rate)) & np.isfinite(mean_rate).all(1) & np.isfinite(mean_force).all(1)
    return Traits(
        interval_s=steps,
        issued_s=issued_s,
        choices=choices,
        commands=commands,
        actuators=actuators,
        quiet=int(quiet.sum()),
        gyro_noise=_noise(mean_rate, quiet),
        accel_noise=_noise(mean_force, quiet),
        gyro_mean=mean_rate[quiet].mean(0) if quiet.sum() >= ENOUGH else None,
        force_m_s2=float(np.median(np.linalg.norm(mean_force[quiet], axis=1))) if quiet.sum() >= ENOUGH else None,
        force_always_m_s2=float(np.nanmedian(np.linalg.norm(mean_force, axis=1))),
        gyro_clipped=_clipped(rate),
        accel_clipped=_clipped(force),
    )


def _named(table: Table, kind: type[Actuator]) -> dict[str, LogColumn]:
    """Log column of each actuator of a kind, in file order."""
    names = [name for column in table.columns if (name := kind.named(column)) is not None]
    return {name: next(one for one in kind.COLUMNS if one.of(name) in table.columns) for name in names}


def tick_s(on_s: Array) -> float | None:
    """Greatest common divisor of all on-times (n,), s, by Euclid's algorithm; None below a thousandth of the longest."""
    values = np.unique(on_s[np.isfinite(on_s) & (on_s > 0)])
    if len(values) < 2:
        return None
    tick, floor = float(values[0]), _TICK * float(values[-1])
    for value in values[1:]:
        larger, smaller = float(value), tick
        while smaller > _ROUNDED * floor:
            rest = larger % smaller
            larger, smaller = smaller, min(rest, smaller - rest)
        tick = larger
        if tick < floor:
            return None
    return tick


def _numbers(table: Table, names: tuple[str, ...], empty: float = 0.0) -> Array:
    """(N, n) columns; up to the fraction ``empty`` of cells may be empty."""
    for name in names:
        if name not in table.columns:
            raise InputError(f"{table.path}: column {name!r} is missing; massprop columns {table.path} drafts a map that says where it is")
    values = np.stack([table.columns[name].numbers() for name in names], 1)
    bad = np.argwhere(np.isinf(values) if np.isnan(values).any(1).mean() <= empty else ~np.isfinite(values))
    if bad.size:
        row, column = (int(i) for i in bad[0])
        raise InputError(f"{table.path}, {table.place(row)}, column {names[column]}: not a finite number; correct or cut the record")
    return values


def _rates(table: Table, increments: tuple[str, ...], rates: tuple[str, ...], interval: Array) -> Array:
    if increments[0] in table.columns or rates[0] not in table.columns:
        return _numbers(table, increments, EMPTY) / interval
    return _numbers(table, rates, EMPTY)


def _records(raw: Mapping[str, Array], record_s: float) -> tuple[int, ...]:
    """Possible numbers of records per control cycle, ascending; empty without changes of a command.

    Commands change only at multiples of a cycle, and no on-time exceeds it. A wrench that holds for several cycles has the same effect. An
    on-time in each of several records counts once if they are one cycle, and each time if they are several.
    """
    found, longest, repeated = 0, 0.0, False
    for name, values in raw.items():
        held = np.flatnonzero(~np.isnan(values))
        whole = len(held) == len(values)
        # a column with empty cells has values at cycle starts; a full column changes at some of them
        starts = np.flatnonzero(np.diff(values)) + 1 if whole else held
        found = math.gcd(found, *map(int, starts)) if len(starts) else found
        if name.startswith("jet_") and len(held):
            longest, repeated = max(longest, float(values[held].max())), repeated or whole
    if not found or not repeated:
        return (found,) * (found > 0)
    return tuple(n for n in range(1, found + 1) if found % n == 0 and (n == found or longest <= n * record_s * (1 + _ROUNDED)))


def _quiet(raw: Mapping[str, Array], records: int, cycles: int) -> BoolArray:
    """(cycles,) cycles of ``records`` records without command, and none in the cycles before."""
    still = np.ones(cycles, bool)
    for values in raw.values():
        still &= (np.nan_to_num(values[: cycles * records]) == 0.0).reshape(-1, records).all(1)
    ahead = np.concatenate([np.zeros(SETTLE, bool), still])
    quiet: BoolArray = np.logical_and.reduce([ahead[n : n + cycles] for n in range(SETTLE + 1)])
    return quiet if raw else np.zeros(cycles, bool)


def _noise(means: Array, quiet: BoolArray) -> Array | None:
    """(3,) one sigma from second differences of quiet cycles, which remove steady and drifting rates; None for few cycles."""
    three = quiet[2:] & quiet[1:-1] & quiet[:-2]
    if three.sum() < ENOUGH:
        return None
    second = (means[2:] - 2 * means[1:-1] + means[:-2])[three]
    return np.asarray(np.sqrt((second**2).mean(0) / 6))


def _clipped(values: Array) -> float | None:
    largest = float(np.nanmax(np.abs(values)))
    return largest if largest > 0 and (np.abs(values) > largest * (1 - _SAME)).sum() >= _CLIPPED else None
