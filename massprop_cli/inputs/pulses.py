"""Commands as a list of pulses (jet, start, duration) in any order; a pulse longer than a control cycle is split into adjacent ones."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, IntArray, frozen
from massprop_cli.base.configfile import nearest
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import COMMAND_TIME, PULSE, PULSE_DURATION, PULSE_JET, PULSE_START, WRENCH, is_jet
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.vehicle import Vehicle

CLOSE_S = 1e-6
"""Largest overlap of pulses of one jet, from rounded times, s."""


class _Events(NamedTuple):
    """E pulses in order of start."""

    row: IntArray
    jet: IntArray
    start_s: Array
    duration_s: Array


class Pulses(NamedTuple):
    """Commands of M start times."""

    issued_s: Array
    """(M,) start times on the commands' clock, s."""
    on_s: Array
    """(M, jets) on-times, s."""


def commands(source: LogTable, vehicle: Vehicle, begin_s: float, end_s: float) -> Pulses | None:
    """Commands from ``begin_s`` to ``end_s``; None without pulse columns. Raises :class:`InputError` with row, value and remedy."""
    present = [name for name in PULSE if source.has(name)]
    if not present:
        return None
    _check_columns(source, vehicle, present)
    found = _events(source, [jet.name for jet in vehicle.jets])
    _check_times(source, found, begin_s, end_s)
    period_s = vehicle.cycle.period_s
    parts = np.maximum(np.ceil(found.duration_s / period_s - 1e-9), 1).astype(int)
    event = np.repeat(np.arange(len(parts)), parts)
    part = np.arange(len(event)) - np.repeat(np.cumsum(parts) - parts, parts)
    start_s = found.start_s[event] + part * period_s
    issued_s, place = np.unique(np.append(start_s, min(begin_s, start_s.min())), return_inverse=True)
    on_s = np.zeros((len(issued_s), len(vehicle.jets)))
    on_s[place[:-1], found.jet[event]] = np.minimum(found.duration_s[event] - part * period_s, period_s)
    return Pulses(frozen(issued_s), on_s)


def _check_columns(source: LogTable, vehicle: Vehicle, present: list[str]) -> None:
    path = source.table.path
    missing = [name for name in PULSE if name not in present]
    if missing:
        raise InputError(
            f"{path}: column {missing[0]!r} is missing, but {source.name(present[0])!r} is present; pulses need {', '.join(PULSE)}"
        )
    others = [name for name in source.logged if name in (*WRENCH, COMMAND_TIME) or is_jet(name)]
    if others:
        raise InputError(f"{path}: has {source.name(present[0])!r} and {others[0]!r}; keep the one kind of commands that was executed")
    if not vehicle.jets:
        raise InputError(f"{path}: column {source.name(PULSE_JET)!r} names jets, and the vehicle file has no [[jets]]; add them")
    if vehicle.cycle.pulse_at != "begin":
        raise InputError(
            f'{path}: column {source.name(PULSE_START)!r} gives the start of each pulse, but cycle.pulse_at is "{vehicle.cycle.pulse_at}"; '
            "leave cycle.pulse_at out"
        )


def _events(source: LogTable, jets: list[str]) -> _Events:
    names = source.table.columns[source.name(PULSE_JET)].texts()
    start_s, duration_s = source.optional(PULSE_START), source.optional(PULSE_DURATION)
    given = np.array([[name is not None and name != "" for name in names], ~np.isnan(start_s), ~np.isnan(duration_s)])
    half = np.flatnonzero(given.any(0) & ~given.all(0))
    if len(half):
        row = int(half[0])
        empty = PULSE[int(np.argmin(given[:, row]))]
        raise source.error(row, empty, f"the cell is empty, but other cells of the pulse are not; fill in all three of {', '.join(PULSE)}")
    rows = np.flatnonzero(given.all(0))
    if not len(rows):
        raise InputError(f"{source.table.path}, column {source.name(PULSE_JET)}: no pulse; record the commands")
    for row in rows.tolist():
        if names[row] not in jets:
            hint = nearest(str(names[row]), jets, "the nearest jet is")
            raise source.error(row, PULSE_JET, f"{names[row]!r} is not a jet of the vehicle file{hint}; add it to [[jets]], or rename it")
    for column, values, least in ((PULSE_START, start_s, -np.inf), (PULSE_DURATION, duration_s, 0.0)):
        bad = rows[~np.isfinite(values[rows]) | (values[rows] < least)]
        if len(bad):
            expected = "a duration must be 0 or more, in s" if column == PULSE_DURATION else "it must be a finite number of s"
            raise source.error(int(bad[0]), column, f"{values[bad[0]]:g}: {expected}; correct or remove the row")
    rows = rows[np.argsort(start_s[rows], kind="stable")]
    return _Events(rows, np.array([jets.index(str(names[row])) for row in rows]), start_s[rows], duration_s[rows])


def _check_times(source: LogTable, found: _Events, begin_s: float, end_s: float) -> None:
    if found.start_s[0] >= end_s or (found.start_s + found.duration_s).max() <= begin_s:
        raise InputError(
            f"{source.table.path}, column {source.name(PULSE_START)}: pulses from {found.start_s[0]:.9g} to {found.start_s[-1]:.9g} s, and "
            f"the IMU from {begin_s:.9g} to {end_s:.9g} s: no pulse is within the IMU's time; bring both clocks to one epoch"
        )
    long = np.flatnonzero(found.duration_s > end_s - begin_s)
    if len(long):
        row, lasting = int(found.row[long[0]]), found.duration_s[long[0]]
        raise source.error(row, PULSE_DURATION, f"{lasting:g} s is longer than the log of {end_s - begin_s:.6g} s; is it in seconds?")
    for jet in np.unique(found.jet):
        own = np.flatnonzero(found.jet == jet)
        until = np.maximum.accumulate(found.start_s[own] + found.duration_s[own])
        over = np.flatnonzero(found.start_s[own][1:] < until[:-1] - CLOSE_S)
        if len(over):
            later = own[over[0] + 1]
            raise source.error(
                int(found.row[later]),
                PULSE_START,
                f"{found.start_s[later]:.9g} s is within a pulse of the same jet, which lasts until {until[over[0]]:.9g} s; correct start "
                "or duration (is it in seconds?)",
            )
