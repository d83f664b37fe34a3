"""Commands of a log: on-times of jets, a wrench or rotor commands, and logs of momentum devices."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.actuators.actuator import MomentumLog, refuse_strangers
from massprop_cli.inputs.columns import PULSE_START, WRENCH, is_jet, jet
from massprop_cli.inputs.equipment import Cycle
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.pulses import Pulses
from massprop_cli.inputs.vehicle import Vehicle

CommandKind = Literal["jets", "wrench", "rotors"]
EXCESS = 1e-3
"""Largest excess of an on-time over the control cycle, as a fraction of it, from rounding and uneven cycles; it is cut off."""
ROUNDED = 1e-6
SHORTEST_PART, SHORTEST_S = 0.015, 2e-3
"""Longest on-time of a log below which its unit is probably wrong: as a fraction of the control cycle, and s."""
MIN_FULL, MAX_RECORDS = 5, 4
"""Minimum number of on-times of exactly one record, and maximum number of records per cycle, at which commands are probably per record."""
MOSTLY_IDLE = 0.5
"""Fraction of all on-times equal to the smallest, above which a smallest on-time other than 0 is an offset."""


def commands(source: LogTable, vehicle: Vehicle, records: int, n: int, pulsed: Pulses | None = None) -> tuple[CommandKind, Array]:
    """Kind and values (K, C) of commands: on-times, s (``pulsed`` for a log of pulses), wrench about O, or rotor commands; C may be 0."""
    if pulsed is not None:
        return "jets", pulsed.on_s
    path, logged = source.table.path, source.logged
    if vehicle.rotors:
        return "rotors", _rotors(source, vehicle, records, n)
    jets = [name.removeprefix("jet_").removesuffix("_s") for name in logged if is_jet(name)]
    known = [each.name for each in vehicle.jets]
    refuse_strangers(source, {jet(name): name for name in jets}, known, "jet", "jets")
    wrench = any(source.has(name) for name in WRENCH)
    if jets and wrench:
        raise InputError(f"{path}: has both jet_* and cmd_* columns; keep the kind that was executed")
    if wrench:
        return "wrench", _per_cycle(source, WRENCH, records, n)
    if not known and (vehicle.spinning or vehicle.on_pedestal):
        return "jets", np.zeros((n // records if source.issued is None else len(source.issued), 0))
    if not known:
        raise InputError(
            f"{path}: no commands: neither jet_*_s nor cmd_torque_*/cmd_force_* columns, and the vehicle file has no "
            "[[jets]], [[wheels]], [[control_moment_gyros]] or [[rotors]]; state what moves the vehicle, or map its columns under [columns]"
        )
    command = _per_cycle(source, [jet(name) for name in known], records, n)
    _check_on_times(source, known, command, records, vehicle.cycle.period_s)
    for part in spill.parts(len(command)):
        np.minimum(command[part], vehicle.cycle.period_s, out=command[part])
    _check_unit(source, known, command, records, vehicle.cycle)
    _check_once(source, known, command, records, vehicle.cycle.period_s)
    return "jets", command


def _per_cycle(source: LogTable, columns: Sequence[str], records: int, n: int) -> Array:
    """(K, columns) commands by :meth:`LogTable.per_cycle`."""
    found = spill.empty(n // records if source.issued is None else len(source.issued), len(columns))
    for place, column in enumerate(columns):
        found[:, place] = source.per_cycle(column, records, n)
        spill.give_back()
    return found


def _check_on_times(source: LogTable, names: Sequence[str], on_s: Array, records: int, period_s: float) -> None:
    long = f"longer than the control cycle of {period_s:g} s; is it in seconds?"
    for sign, most, problem in ((-1, 0.0, "negative on-time; an on-time is 0 or more"), (1, period_s * (1 + EXCESS), long)):
        bad = np.argwhere(np.concatenate([sign * on_s[part] > most for part in spill.parts(len(on_s))]))
        if bad.size:
            cycle, number = (int(i) for i in bad[0])
            raise source.error(cycle * records, jet(names[number]), f"{on_s[cycle, number]:g} s: {problem}")


def _check_unit(source: LogTable, names: Sequence[str], on_s: Array, records: int, stated: Cycle) -> None:
    """Raise :class:`InputError` for on-times in a wrong unit, which the motion cannot show: mass and inertia are proportional to them."""
    if not on_s.size:
        return
    cycle, number = (int(i) for i in np.unravel_index(np.argmax(on_s), on_s.shape))
    longest, at = float(on_s[cycle, number]), (cycle * records, jet(names[number]))
    if 0 < longest < (stated.pwm_tick_s or 0.0) * (1 - ROUNDED):
        tick = f"cycle.pwm_tick_s = {stated.pwm_tick_s:g} s"
        raise source.error(*at, f"{longest:g} s is the longest on-time of the log, below {tick}; is it in seconds?")
    if stated.pwm_tick_s is None and 0 < longest < min(SHORTEST_PART * stated.period_s, SHORTEST_S):
        raise source.error(
            *at,
            f"{longest:g} s is the longest on-time of the log, {100 * longest / stated.period_s:.2g} % of the control cycle of "
            f"{stated.period_s:g} s; is it in seconds? If valves open so briefly, state cycle.pwm_tick_s: on-times are its multiples",
        )
    idle = float(on_s.min())
    if len(names) > 1 and idle > 0 and float(np.mean(on_s == idle)) > MOSTLY_IDLE:
        raise source.error(
            0,
            jet(names[int(np.argmin(on_s[0]))]),
            f"{idle:g} s is the on-time of most jets in most cycles, and no on-time is shorter, but an idle jet must have 0: subtract "
            "this value (offset under its table in a map file)",
        )


def _check_once(source: LogTable, names: Sequence[str], on_s: Array, records: int, period_s: float) -> None:
    """Raise :class:`InputError` for on-times of at most one record that repeat in each record of a cycle: each was probably executed."""
    record_s = period_s / records
    if source.issued is not None or not 1 < records <= MAX_RECORDS or not on_s.size or abs(float(on_s.max()) / record_s - 1) > ROUNDED:
        return
    full = np.argwhere(on_s >= record_s * (1 - ROUNDED))
    cycle, number = (int(i) for i in full[0])
    first = cycle * records
    if len(full) < MIN_FULL or np.isnan(source.optional(jet(names[number]))[first : first + records]).any():
        return
    raise source.error(
        first,
        jet(names[number]),
        f"{on_s[cycle, number]:g} s is the longest on-time of the log and exactly one record, and each of the {records} records of a "
        f"control cycle of {period_s:g} s has it. It counts once per cycle, so mass and inertia would be up to {records} times too small. "
        f"If each was executed, state cycle.period_s = {record_s:g}; if one per cycle was, leave the other cells empty",
    )


def _rotors(source: LogTable, vehicle: Vehicle, records: int, n: int) -> Array:
    """(K, R) command or speed of each rotor, the argument of its thrust_n."""
    others = [name for name in source.logged if name in WRENCH or name.startswith("jet_")]
    if others or vehicle.jets:
        what = f"column {others[0]!r}" if others else "[[jets]]"
        raise InputError(f"{source.table.path}: the vehicle file has [[rotors]], and the log also has {what}; keep the one kind that acted")
    return np.stack([rotor.asked(source, records, n) for rotor in vehicle.rotors], 1)


def momentum(source: LogTable, vehicle: Vehicle, records: int, n: int) -> tuple[MomentumLog, ...]:
    """Log of each device of :attr:`massprop_cli.inputs.vehicle.Vehicle.spinning` from the first n rows."""
    found: list[MomentumLog] = []
    for kind, own in vehicle.actuators:
        named = {column: name for column in source.logged if (name := kind.named(column)) is not None}
        refuse_strangers(source, named, [one.name for one in own], kind.NOUN, kind.TABLE)
        stored = [one for one in own if one.device is not None]
        logs = [one.read(source, records, n) for one in stored]
        summed = next((one.name for one, it in zip(stored, logs, strict=True) if it.integrated), None)
        if summed is not None and source.has(PULSE_START):
            raise InputError(
                f"{source.table.path}: the speed of wheel {summed!r} follows from its torque at all times, and the log lists pulses "
                f"of jets ({source.name(PULSE_START)}); log its speed instead"
            )
        kind.check_together(source, stored, logs)
        found += logs
    return tuple(found)
