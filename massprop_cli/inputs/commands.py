"""The columns of a log that say what its actuators were told to do: jets, a wrench or rotors, and wheels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, frozen, median
from massprop_cli.base.configfile import nearest
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import SUPPLY, WRENCH, jet, rotor_command, rotor_of, rotor_speed, wheel_of, wheel_speed, wheel_torque
from massprop_cli.inputs.equipment import Cycle
from massprop_cli.inputs.logtable import LONG, LogTable
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.wheel import Wheel, WheelLog

CommandKind = Literal["jets", "wrench", "rotors"]
LATE = 1e-3
"""Part of a control cycle by which an on-time may be longer, and counts as all of it: clocks are rounded and cycles not quite alike."""
ROUNDED = 1e-6
BRIEF, SHORTEST_S = 0.015, 2e-3
"""Part of a control cycle, and time, below which no valve is of use at its longest: on-times a thousandth or a hundredth as long."""
FULL, FEW = 5, 4
"""On-times of just one record, and none longer, are no chance if so many are, and of so few records a cycle: each record was one. Of more
a pulse as short may be all that was wanted."""
IDLE = 0.5
"""Part of all on-times that may stand at their least, where that isn't 0."""
STRAYED = {
    30 / np.pi: "it is in rpm",
    np.pi / 30: "start_rad_s is in rpm",
    180 / np.pi: "it is in deg/s",
    1 / (2 * np.pi): "it is in revolutions per second",
    -1.0: "it has the other sign",
    -30 / np.pi: "it is in rpm, and has the other sign",
}
"""How many times what is stated of it a wheel's first speed is, and why."""
NEAR = 0.02
"""Part of itself within which such a speed is another one."""


def commands(source: LogTable, vehicle: Vehicle, records: int, n: int) -> tuple[CommandKind, Array]:
    """What was commanded: on-times of jets, torque about O and force, or what rotors are told; nothing, (K, 0), of wheels alone."""
    path, logged = source.table.path, source.logged
    if vehicle.rotors:
        return "rotors", _rotors(source, vehicle, records, n)
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
        return "wrench", _each(source, WRENCH, records, n)
    if not known and vehicle.wheels:
        return "jets", np.zeros((n // records, 0))
    if not known:
        raise InputError(f"{path}: no commands: neither jet_*_s nor cmd_torque_*/cmd_force_* columns, and the vehicle file has no [[jets]]")
    command = _each(source, [jet(name) for name in known], records, n)
    _check_on_times(source, known, command, records, vehicle.cycle.period_s)
    for part in spill.parts(len(command)):
        np.minimum(command[part], vehicle.cycle.period_s, out=command[part])
    _check_unit(source, known, command, records, vehicle.cycle)
    _check_once(source, known, command, records, vehicle.cycle.period_s)
    return "jets", command


def _each(source: LogTable, columns: Sequence[str], records: int, n: int) -> Array:
    """(K, columns) of :func:`_per_cycle`."""
    found = spill.empty(n // records, len(columns))
    for place, column in enumerate(columns):
        found[:, place] = _per_cycle(source, column, records, n)
        spill.give_back()
    return found


def _per_cycle(source: LogTable, column: str, records: int, n: int) -> Array:
    """(K,) the command in the first row of each cycle; other rows must be null or the same."""
    values = source.optional(column)[:n]
    bad = np.flatnonzero(np.isinf(values))
    if bad.size:
        raise source.error(int(bad[0]), column, f"{values[bad[0]]} is not a finite number; mend or cut the record")
    grid = values.reshape(-1, records)
    first = grid[:, :1]
    missing = np.flatnonzero(np.isnan(first[:, 0]))
    if missing.size:
        raise source.error(
            int(missing[0]) * records,
            column,
            "no command in the first row of its control cycle; write one (0 for none)" + _lost(source, int(missing[0]) * records),
        )
    differs = np.argwhere(~np.isnan(grid) & (grid != first))
    if differs.size:
        cycle, row = (int(i) for i in differs[0])
        raise source.error(
            cycle * records + row,
            column,
            f"{grid[cycle, row]:g} differs from {first[cycle, 0]:g} in the first row of its control cycle; "
            "commands change at cycle starts only: check cycle.period_s and the first row" + _lost(source, cycle * records + row),
        )
    return np.ascontiguousarray(first[:, 0])


def _lost(source: LogTable, row: int) -> str:
    """Where a record is missing before a row, from which on all cycles are others; empty where none is."""
    steps = np.diff(source.required("time_s")[: row + 1])
    long = np.flatnonzero(steps > LONG * median(steps)) if len(steps) else steps
    if not len(long):
        return ""
    at = int(long[0]) + 1
    return (
        f"; or a record was lost before {source.place(at)}, which comes {steps[at - 1]:.6g} s after the one above it: split the log there"
    )


def _check_on_times(source: LogTable, names: Sequence[str], on_s: Array, records: int, period_s: float) -> None:
    checks: list[tuple[Callable[[Array], Any], str]] = [
        (lambda t: t < 0, "negative on-time; an on-time is 0 or more"),
        (lambda t: t > period_s * (1 + LATE), f"longer than the control cycle of {period_s:g} s; is it in seconds?"),
    ]
    for check, problem in checks:
        bad = np.argwhere(np.concatenate([check(on_s[part]) for part in spill.parts(len(on_s))]))
        if bad.size:
            cycle, number = (int(i) for i in bad[0])
            raise source.error(cycle * records, jet(names[number]), f"{on_s[cycle, number]:g} s: {problem}")


def _check_unit(source: LogTable, names: Sequence[str], on_s: Array, records: int, stated: Cycle) -> None:
    """On-times whose numbers can be none: the motion can't tell, since mass and inertia are proportional to them."""
    if not on_s.size:
        return
    cycle, number = (int(i) for i in np.unravel_index(np.argmax(on_s), on_s.shape))
    longest, at = float(on_s[cycle, number]), (cycle * records, jet(names[number]))
    if 0 < longest < (stated.pwm_tick_s or 0.0) * (1 - ROUNDED):
        tick = f"cycle.pwm_tick_s = {stated.pwm_tick_s:g} s"
        raise source.error(*at, f"{longest:g} s is the longest on-time of the log, below {tick}; is it in seconds?")
    if stated.pwm_tick_s is None and 0 < longest < min(BRIEF * stated.period_s, SHORTEST_S):
        raise source.error(
            *at,
            f"{longest:g} s is the longest on-time of the log, {100 * longest / stated.period_s:.2g} % of the control cycle of "
            f"{stated.period_s:g} s; is it in seconds? If valves open so briefly, state cycle.pwm_tick_s, of which all are multiples",
        )
    idle = float(on_s.min())
    if len(names) > 1 and idle > 0 and float(np.mean(on_s == idle)) > IDLE:
        raise source.error(
            0,
            jet(names[int(np.argmin(on_s[0]))]),
            f"{idle:g} s is the on-time of most jets in most cycles, and none is ever shorter; an idle jet's is 0: take that off "
            "(offset under its table in a map file)",
        )


def _check_once(source: LogTable, names: Sequence[str], on_s: Array, records: int, period_s: float) -> None:
    """On-times that stand in every record of a cycle, and are at their longest just one record: each was executed, not one of them."""
    record_s = period_s / records
    if not 1 < records <= FEW or not on_s.size or abs(float(on_s.max()) / record_s - 1) > ROUNDED:
        return
    full = np.argwhere(on_s >= record_s * (1 - ROUNDED))
    cycle, number = (int(i) for i in full[0])
    first = cycle * records
    if len(full) < FULL or np.isnan(source.optional(jet(names[number]))[first : first + records]).any():
        return
    raise source.error(
        first,
        jet(names[number]),
        f"{on_s[cycle, number]:g} s is the longest on-time of the log and just one record, and it stands in each of the {records} "
        f"records of a control cycle of {period_s:g} s, in which it counts once: mass and inertia would be up to {records} times too "
        f"small. If each was executed, state cycle.period_s = {record_s:g}; if one a cycle was, leave the cells of the others empty",
    )


def _rotors(source: LogTable, vehicle: Vehicle, records: int, n: int) -> Array:
    """(K, R) what each is told, as its thrust_n takes it."""
    others = [name for name in source.logged if name in WRENCH or name.startswith("jet_")]
    if others or vehicle.jets:
        what = f"column {others[0]!r}" if others else "[[jets]]"
        raise InputError(f"{source.table.path}: the vehicle file has [[rotors]], and there is {what} too; keep the one kind that pushed")
    known = [rotor.name for rotor in vehicle.rotors]
    _refuse_strangers(source, "rotor", rotor_of, known)
    found = []
    for rotor in vehicle.rotors:
        column, other = rotor_command(rotor.name), rotor_speed(rotor.name)
        if rotor.column == "speed":
            column, other = other, column
        if not source.has(column) and source.has(other):
            kind = "command" if rotor.column == "speed" else "speed"
            raise InputError(
                f"{source.table.path}: rotor {rotor.name!r} has column {source.name(other)!r} and no {column!r}; "
                f'state column = "{kind}" under its [[rotors]], and thrust_n by that'
            )
        x = _mean(source, column, records, n) if rotor.column == "speed" else _per_cycle(source, column, records, n)
        if rotor.nominal_v is not None:
            x = x * _mean(source, SUPPLY, records, n) / rotor.nominal_v
        found.append(x)
    return np.stack(found, 1)


def _mean(source: LogTable, column: str, records: int, n: int) -> Array:
    """(K,) over each cycle, of a number in every record."""
    found: Array = source.required(column)[:n].reshape(-1, records).mean(1)
    return found


def _refuse_strangers(source: LogTable, kind: str, of: Callable[[str], str | None], known: Sequence[str]) -> None:
    """:class:`InputError` where a column is called after a wheel or rotor that the vehicle file doesn't have."""
    for column in source.logged:
        name = of(column)
        if name is not None and name not in known:
            hint = nearest(name, known, f"the nearest {kind} is") or f"; it has no [[{kind}s]] at all"
            raise InputError(
                f"{source.table.path}: column {column!r} names a {kind} that the vehicle file lacks{hint}. Add it to the vehicle file"
            )


def wheels(source: LogTable, vehicle: Vehicle, records: int, n: int) -> tuple[WheelLog, ...]:
    """What the log's n rows say of each wheel, and of each rotor that states its spin inertia."""
    _refuse_strangers(source, "wheel", wheel_of, [wheel.name for wheel in vehicle.wheels])
    if not vehicle.rotors:
        _refuse_strangers(source, "rotor", rotor_of, [])
    own = [_of_speed(source, wheel, n) if wheel.column == "speed" else _of_torque(source, wheel, records, n) for wheel in vehicle.wheels]
    _check_starts(source, vehicle, own)
    turning = [rotor_speed(rotor.name) for rotor in vehicle.rotors if rotor.wheel is not None]
    return (*own, *(WheelLog(frozen(source.required(column)[:n]), None, None) for column in turning))


def _check_starts(source: LogTable, vehicle: Vehicle, own: Sequence[WheelLog]) -> None:
    """:class:`InputError` where all speeds begin at what the vehicle file states of them in another unit, or the other way round.

    Nothing in the motion tells the unit: inertia grows with the speeds.
    """
    pairs = zip(vehicle.wheels, own, strict=True)
    stated = [
        (wheel.start_rad_s, float(said.speed_rad_s[0])) for wheel, said in pairs if wheel.start_rad_s and said.speed_rad_s is not None
    ]
    for factor, what in STRAYED.items():
        if stated and all(abs(first - factor * start) < NEAR * abs(factor * start) for start, first in stated):
            raise InputError(
                f"{source.table.path}: the first speed of each wheel is {factor:.4g} times the start_rad_s of the vehicle file: {what}; "
                "mend the speeds, or start_rad_s"
            )


def _of_speed(source: LogTable, wheel: Wheel, n: int) -> WheelLog:
    column, other = wheel_speed(wheel.name), wheel_torque(wheel.name)
    if not source.has(column) and source.has(other):
        raise InputError(
            f"{source.table.path}: wheel {wheel.name!r} has column {source.name(other)!r} and no {column!r}; "
            'state column = "torque" under its [[wheels]]'
        )
    return WheelLog(frozen(source.required(column)[:n]), None, None)


def _of_torque(source: LogTable, wheel: Wheel, records: int, n: int) -> WheelLog:
    column, speed = wheel_torque(wheel.name), wheel_speed(wheel.name)
    if not source.has(column) and source.has(speed):
        raise InputError(
            f"{source.table.path}: wheel {wheel.name!r} has column {source.name(speed)!r} and no {column!r}; "
            'state column = "speed" under its [[wheels]]'
        )
    start = wheel.start_rad_s
    if start is None and source.has(speed):
        first = float(source.optional(speed)[0])
        start = first if np.isfinite(first) else None
    if start is None:
        raise InputError(
            f"{source.table.path}: nothing says how fast wheel {wheel.name!r} turns when its first torque acts; state start_rad_s under "
            f"its [[wheels]], or write its speed into the first cell of column {speed!r}"
        )
    return WheelLog(None, frozen(_per_cycle(source, column, records, n)), start)
