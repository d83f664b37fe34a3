"""The most commanded segment of a long log, which bounds time and memory of a search."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array, IntArray
from massprop_cli.base.levels import PARTS
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.align import LAGS_FORGOTTEN
from massprop_cli.prepare.timing import Timing

MEMORY = 64
"""Cycles before a segment whose commands may act in it, under any delay that is searched."""


def busiest(log: Log, vehicle: Vehicle, timing: Timing, piece: slice, longest: int) -> tuple[Log, slice]:
    """The ``longest`` most commanded cycles of a piece, in a log that holds only what is needed to read them.

    If the attitude is integrated from the start of the log, the first ones.
    """
    integrated = vehicle.pivoted and log.attitude_wxyz is None
    first, stop = piece.start, min(piece.start + longest, piece.stop)
    stored = any(one.integrated for one in log.spinning)
    if stop < piece.stop and not integrated:
        total = np.concatenate([[0.0], np.cumsum(_effort(log, piece, _most(log)))])
        first = piece.start + int(np.argmax(total[longest:] - total[:-longest]))
        stop = first + longest
    if stored:
        return log, slice(first, stop)
    begin = 0 if integrated else max(first - MEMORY - int(timing.delay + LAGS_FORGOTTEN * timing.lag), 0)
    end = min(stop + 1, log.cycles)
    return log.part(begin, end), slice(first - begin, stop - begin)


def edges_of(first: int, stop: int) -> IntArray:
    """(≤ PARTS + 1,) edges of equal parts of these cycles, with both ends."""
    return np.asarray(np.unique(np.linspace(first, stop, PARTS + 1).astype(int)))


def bounded(log: Log, vehicle: Vehicle, timing: Timing, pieces: Sequence[slice], longest: int) -> tuple[Log, Sequence[slice]]:
    """The log with its pieces; if they exceed ``longest`` cycles together, the most commanded segment instead.

    A log with the torque of momentum devices stays whole, since momentum is integrated from its start.
    """
    stored = any(one.integrated for one in log.spinning)
    if stored or sum(piece.stop - piece.start for piece in pieces) <= longest:
        return log, pieces
    parts, most = [busiest(log, vehicle, timing, piece, longest) for piece in pieces], _most(log)
    part, piece = max(parts, key=lambda part: float(_effort(part[0], part[1], most).sum()))
    return part, [piece]


def _most(log: Log) -> Array:
    """(C,) largest command of each channel."""
    return np.asarray(np.maximum(np.abs(log.command).max(0), np.finfo(float).tiny))


def _effort(log: Log, piece: slice, most: Array) -> Array:
    """(K,) sum of the commands in each cycle, each over its ``most``."""
    total: Array = (np.abs(log.command) / most).sum(1)
    if log.command_s is None:
        return total[piece]
    cycle = np.minimum(np.searchsorted(log.cycle_end_s, log.command_s), log.cycles - 1)
    return np.asarray(np.bincount(cycle, total, log.cycles), dtype=float)[piece]
