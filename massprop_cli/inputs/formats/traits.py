"""What a log tells of its vehicle without any vehicle file: cycles, noise, gravity, commands."""

import math
from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators.actuator import Actuator, LogColumn
from massprop_cli.inputs.formats.clocks import outlying
from massprop_cli.inputs.logtable import EMPTY
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.vehicle import ACTUATORS

SETTLE = 4
"""Cycles without a command before one counts as quiet: commands come late, and jets fall."""
ENOUGH = 20
"""Quiet cycles, at least, to tell a mean, ..."""
TOLD = 130
"""... and to tell a noise level to a twentieth of it: 0.57 / √N by second differences of three axes."""
_SAME = 1e-9
_TICK, _ROUNDED = 1e-3, 1e-3
"""The least tick as part of the longest on-time, and the rounding of on-times as part of that."""
_CLIPPED = 5
"""So many records at one extreme are no chance."""


@dataclass(frozen=True)
class Traits:
    """What was found; None where the log can't tell."""

    interval_s: Array
    """(n - 1,) from record to record."""
    issued_s: float | None
    """From command to command of those that have times of their own."""
    choices: tuple[int, ...]
    """How many records a control cycle may be, the fewest first: on-times that change together say no more than what it is a divisor of."""
    commands: Mapping[str, Array]
    """By column: the command of each cycle, or of each record where cycles aren't known."""
    actuators: Mapping[type[Actuator], Mapping[str, LogColumn]]
    """Of each kind and name the column that it is read by."""
    quiet: int
    """Cycles without command, and settled."""
    gyro_noise: Array | None
    """(3,) rad/s, one sigma of a cycle's mean."""
    accel_noise: Array | None
    """(3,) m/s²."""
    gyro_mean: Array | None
    """(3,) rad/s over the quiet cycles."""
    felt: float | None
    """m/s², the median size of the specific force over them."""
    felt_always: float
    """The same over the whole log."""
    gyro_clipped: float | None
    """rad/s, an extreme that many records share."""
    accel_clipped: float | None

    @property
    def records(self) -> int | None:
        """Of a control cycle, the fewest that it may be: commands change at its multiples only. None where no command changes."""
        return self.choices[0] if self.choices else None

    @property
    def period_s(self) -> float:
        """Of a control cycle; of a record where cycles aren't known."""
        return self.issued_s or median(self.interval_s) * (self.records or 1)


def traits(table: Table) -> Traits:
    """Look through a log; :class:`InputError` where it has no IMU or goes back in time."""
    time_s = _numbers(table, (columns.TIME,))[:, 0]
    far, why = outlying(time_s)
    if far.any():
        row = int(np.argmax(far))
        raise InputError(f"{table.path}, {table.place(row)}, column {columns.TIME}: {time_s[row]:.9g} s {why}")
    steps = np.diff(time_s)
    if len(steps) < 2 or not (steps > 0).all():
        raise InputError(f"{table.path}: {columns.TIME} does not increase throughout; sort or cut the log")
    interval = np.concatenate([[median(steps)], steps])[:, None]
    rate = _rates(table, columns.DELTA_THETA, columns.GYRO, interval)
    force = _rates(table, columns.DELTA_V, columns.ACCEL, interval)
    actuators = {kind: _named(table, kind) for kind in ACTUATORS.values()}
    told = {has.of(name) for kind, own in actuators.items() for name, has in own.items() if kind.THRUSTS and not has.instant}
    names = [name for name in table.columns if name in columns.WRENCH or name in told or columns.is_jet(name)]
    raw = {name: table.columns[name].numbers() for name in names}
    issued_s = _apart_s(table)
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
        felt=float(np.median(np.linalg.norm(mean_force[quiet], axis=1))) if quiet.sum() >= ENOUGH else None,
        felt_always=float(np.nanmedian(np.linalg.norm(mean_force, axis=1))),
        gyro_clipped=_clipped(rate),
        accel_clipped=_clipped(force),
    )


def _apart_s(table: Table) -> float | None:
    """From command to command of those that have times of their own; None where they stand in records."""
    if columns.COMMAND_TIME not in table.columns:
        return None
    stamps = table.columns[columns.COMMAND_TIME].numbers()
    steps = np.diff(stamps[np.isfinite(stamps)])
    return median(steps) if len(steps) else None


def _named(table: Table, kind: type[Actuator]) -> dict[str, LogColumn]:
    """Actuators of a kind, in the file's order, each by the first of its columns that is there."""
    names = [name for column in table.columns if (name := kind.named(column)) is not None]
    return {name: next(one for one in kind.COLUMNS if one.of(name) in table.columns) for name in names}


def tick_s(on_s: Array) -> float | None:
    """The step of which all on-times are multiples, by Euclid's algorithm; None where there is none above a thousandth of the longest."""
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
    """(N, n) columns, of which a part may be ``empty`` cells."""
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
    """How many records a control cycle may be, the fewest first; none where no command changes.

    Commands stand or change at its multiples alone, and no jet is on for longer than it. What is held goes on as well through several
    cycles; an on-time that stands in each of several records counts once if these are one cycle, and each time if they are several.
    """
    found, longest, repeated = 0, 0.0, False
    for name, values in raw.items():
        held = np.flatnonzero(~np.isnan(values))
        whole = len(held) == len(values)
        # of a column with empty cells the others are cycle starts; else those where it changes are some of them
        starts = np.flatnonzero(np.diff(values)) + 1 if whole else held
        found = math.gcd(found, *map(int, starts)) if len(starts) else found
        if name.startswith("jet_") and len(held):
            longest, repeated = max(longest, float(values[held].max())), repeated or whole
    if not found or not repeated:
        return (found,) * (found > 0)
    return tuple(n for n in range(1, found + 1) if found % n == 0 and (n == found or longest <= n * record_s * (1 + _ROUNDED)))


def _quiet(raw: Mapping[str, Array], records: int, cycles: int) -> BoolArray:
    """Cycles, of so many records each, without any command, nor in those before."""
    still = np.ones(cycles, bool)
    for values in raw.values():
        still &= (np.nan_to_num(values[: cycles * records]) == 0.0).reshape(-1, records).all(1)
    ahead = np.concatenate([np.zeros(SETTLE, bool), still])
    quiet: BoolArray = np.logical_and.reduce([ahead[n : n + cycles] for n in range(SETTLE + 1)])
    return quiet if raw else np.zeros(cycles, bool)


def _noise(means: Array, quiet: BoolArray) -> Array | None:
    """(3,) one sigma, by second differences of quiet cycles, which steady turning and drifting leave alone."""
    three = quiet[2:] & quiet[1:-1] & quiet[:-2]
    if three.sum() < ENOUGH:
        return None
    second = (means[2:] - 2 * means[1:-1] + means[:-2])[three]
    return np.asarray(np.sqrt((second**2).mean(0) / 6))


def _clipped(values: Array) -> float | None:
    largest = float(np.nanmax(np.abs(values)))
    return largest if largest > 0 and (np.abs(values) > largest * (1 - _SAME)).sum() >= _CLIPPED else None
