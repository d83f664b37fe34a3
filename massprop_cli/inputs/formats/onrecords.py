"""A recording whose IMU and commands have clocks of their own: records are the IMU's, and commands have times.

Nothing is put on another clock, so a step of thrust within a record stays where it was. Where records do fall on control cycles as a map
states them, :mod:`massprop_cli.inputs.formats.oncycles` sums them.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array, IntArray, median
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample
from massprop_cli.inputs.formats.mapfile import Records
from massprop_cli.inputs.formats.oncycles import Streams
from massprop_cli.inputs.formats.signals import QuantitySignal
from massprop_cli.inputs.formats.streamcommands import LIKE, SAME, STAMPED, StreamCommand


def columns_of(streams: Streams, records: Records, edges: Array) -> dict[str, Array] | None:
    """The log's columns; None where records fall on cycles of these ``edges``, or commands are not one row each.

    Samples without any command are records as they are: nothing has a time of its own.
    """
    signals, gyro, kinds = streams.signals, streams.gyro, [kind for _, kind in streams.imu]
    together = all(one.times is gyro.times or np.array_equal(gyro.times.s, one.times.s) for one, _ in streams.imu)
    if not together or ("sample" not in kinds and resample.all_at(resample.knots(gyro.times.s, kinds[0]), edges, SAME * gyro.times.step_s)):
        return None
    issued = _issued(streams.commands, records.interval_s or 0.0, records.per_cycle)
    one_each = "sample" in kinds and abs(gyro.times.step_s / median(np.diff(edges)) - 1) < SAME
    if issued is None and (not one_each or any(command.signal.paths for command in streams.commands)):
        return None
    issued_s, scatter_s = issued or (np.zeros(0), 0.0)
    time_s = gyro.times.s
    within = slice(*np.searchsorted(time_s, [edges[0] + SAME * gyro.times.step_s, edges[-1] + SAME * gyro.times.step_s]).tolist())
    time_s = time_s[within]
    own = (issued_s > time_s[0] - gyro.times.step_s) & (issued_s <= time_s[-1])
    rows = np.searchsorted(time_s, issued_s[own])
    if issued and (len(rows) < 2 or (np.diff(rows) < 1).any()):
        return None
    zero = streams.zero(records, edges)
    made: dict[str, Array] = {columns.TIME: time_s - zero}
    made |= signals.as_recorded(streams.imu, within)
    for signal, kind in streams.imu:
        signals.made.append(
            f"{signal.key}: {len(time_s)} values ({kind}) every {gyro.times.step_s:.6g} s by {gyro.times.path!r}, as recorded"
        )
    if issued is None:
        return made | streams.beside(time_s, records.per_cycle * gyro.times.step_s)
    made[columns.COMMAND_TIME] = _in_rows(issued_s[own] - zero, rows, len(time_s))
    for command in streams.commands:
        values = command.signal.values
        values = values[own] if command.signal.paths else np.repeat(values[:1], len(rows), 0)
        made |= dict(zip(command.names, (_in_rows(column, rows, len(time_s)) for column in values.T), strict=True))
    evened = f", whose stamps scatter by up to {scatter_s:.3g} s and are taken as evenly spaced" if scatter_s > 0 else ""
    signals.made.append(f"commands: {len(rows)} every {median(np.diff(issued_s)):.6g} s, at their own times{evened}")
    return made | streams.beside(time_s, median(np.diff(issued_s)))


def _issued(commands: Sequence[StreamCommand], interval_s: float, per_cycle: int) -> tuple[Array, float] | None:
    """When commands were issued, where all are one row each, and by how much their stamps scatter about even times, if these are taken."""
    recorded: list[QuantitySignal] = []
    for command in commands:
        if not command.signal.paths:
            continue
        if command.kind == "share" or command.holds != "until_next":
            return None
        recorded.append(command.signal)
    if not recorded or any(not np.array_equal(one.times.s, recorded[0].times.s) for one in recorded):
        return None
    stamps, step_s = recorded[0].times.s, recorded[0].times.step_s
    if interval_s and abs(step_s / (interval_s * per_cycle) - 1) > LIKE:
        return None
    line, _ = resample.even(stamps)
    scatter_s = float(np.abs(line - stamps).max())
    if scatter_s > STAMPED * step_s:
        return stamps, 0.0
    return line, scatter_s if scatter_s > SAME * step_s else 0.0


def _in_rows(values: Array, rows: IntArray, count: int) -> Array:
    """(count,) values in these rows, and nothing in the others."""
    found = np.full(count, np.nan)
    found[rows] = values
    return found
