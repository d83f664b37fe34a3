"""The most informative segment of a long log, so that a search takes no more time and memory than in a short one."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array, IntArray
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.align import LAGS_FORGOTTEN
from massprop_cli.prepare.timing import Timing

BLOCKS = 32
"""Parts of a stretch at whose edges something is taken to begin, or end, first."""
MEMORY = 64
"""Cycles before a stretch that commands may come from, under any delay that is tried."""


def busiest(log: Log, vehicle: Vehicle, timing: Timing, piece: slice, longest: int) -> tuple[Log, slice]:
    """The ``longest`` cycles of a piece in which most is commanded, in a log that holds no more than it takes to read them.

    Where the attitude is integrated from the log's beginning on, the first ones.
    """
    integrated = vehicle.pivoted and log.attitude_wxyz is None
    first, stop = piece.start, min(piece.start + longest, piece.stop)
    whole = any(one.integrated for one in log.spinning)
    if stop < piece.stop and not integrated:
        total = np.concatenate([[0.0], np.cumsum(_effort(log, piece, _most(log)))])
        first = piece.start + int(np.argmax(total[longest:] - total[:-longest]))
        stop = first + longest
    if whole:
        return log, slice(first, stop)
    begin = 0 if integrated else max(first - MEMORY - int(timing.delay + LAGS_FORGOTTEN * timing.lag), 0)
    end = min(stop + 1, log.cycles)
    return log.part(begin, end), slice(first - begin, stop - begin)


def edges_of(first: int, stop: int) -> IntArray:
    """(≤ BLOCKS + 1,) edges of equal parts of these cycles, both ends among them."""
    return np.asarray(np.unique(np.linspace(first, stop, BLOCKS + 1).astype(int)))


def bounded(log: Log, vehicle: Vehicle, timing: Timing, pieces: Sequence[slice], longest: int) -> tuple[Log, Sequence[slice]]:
    """The log with all its pieces, or the busiest stretch of the busiest one, if they hold more than ``longest`` cycles together.

    All of a log with a momentum device whose torque was logged: its momentum follows from the beginning on.
    """
    whole = any(one.integrated for one in log.spinning)
    if whole or sum(piece.stop - piece.start for piece in pieces) <= longest:
        return log, pieces
    parts, most = [busiest(log, vehicle, timing, piece, longest) for piece in pieces], _most(log)
    part, piece = max(parts, key=lambda found: float(_effort(found[0], found[1], most).sum()))
    return part, [piece]


def _most(log: Log) -> Array:
    """(C,) the most that each channel is commanded."""
    return np.asarray(np.maximum(np.abs(log.command).max(0), np.finfo(float).tiny))


def _effort(log: Log, piece: slice, most: Array) -> Array:
    """(K,) what is commanded in each cycle, each channel over its ``most``."""
    each: Array = (np.abs(log.command) / most).sum(1)
    if log.command_s is None:
        return each[piece]
    cycle = np.minimum(np.searchsorted(log.cycle_end_s, log.command_s), log.cycles - 1)
    return np.asarray(np.bincount(cycle, each, log.cycles), dtype=float)[piece]
