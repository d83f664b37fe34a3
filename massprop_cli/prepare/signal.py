"""Piecewise linear functions of time, what a first-order lag makes of them, and their exact integrals over bins."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.kernel import kernel, pointer


@dataclass(frozen=True)
class Signal:
    """A piecewise linear function of time, zero before its first event: steps and changes of slope, in any order."""

    time_s: Array
    step: Array
    slope: Array

    @cached_property
    def course(self) -> Course:
        """The signal and its integrals at its events; without any, at one that changes nothing."""
        time, step, slope = _in_order(self) if len(self.time_s) else np.zeros((3, 1))
        lasting, rising = np.diff(time), np.cumsum(slope)
        level = np.cumsum(step) + np.append(0.0, np.cumsum(rising[:-1] * lasting))
        grown = level[:-1] * lasting + rising[:-1] * lasting**2 / 2
        first = np.append(0.0, np.cumsum(grown))
        second = np.append(0.0, np.cumsum(first[:-1] * lasting + level[:-1] * lasting**2 / 2 + rising[:-1] * lasting**3 / 6))
        return Course(time, lasting, level, rising, first, second)


class Course(NamedTuple):
    """(E,) of a signal just after each of its events, in the order of time."""

    time_s: Array
    lasting_s: Array
    """(E − 1,) from each event to the next."""
    level: Array
    rising: Array
    first: Array
    """Its integral up to there."""
    second: Array
    """The integral of that."""


def joined(parts: Sequence[Signal]) -> Signal:
    """A sum of signals."""
    return Signal(*(np.concatenate(each) for each in zip(*((one.time_s, one.step, one.slope) for one in parts), strict=True)))


def of_bins(edges_s: Array, integral: Array, moment: Array) -> Signal:
    """A signal that is linear in each bin, of its integral and first moment about the bin's beginning there."""
    length = np.diff(edges_s)
    slope = 12 * (moment - integral * length / 2) / length**3
    begun = integral / length - slope * length / 2
    ended = begun + slope * length
    step = np.append(begun, 0.0) - np.append(0.0, ended)
    return Signal(edges_s, step, np.diff(np.append(slope, 0.0), prepend=0.0))


def window_integrals(signals: Sequence[Signal], edges_s: Array, lag_s: float = 0.0) -> tuple[Array, Array]:
    """∫ u dt and ∫ (t − bin start) u dt over each bin of ``edges_s``, exactly, for piecewise linear ``u``: (bins, signals) each.

    With ``lag_s`` the integrals are those of y, ``lag y' + y = u``, y = 0 before the first event.
    """
    if not signals:
        return np.zeros((len(edges_s) - 1, 0)), np.zeros((len(edges_s) - 1, 0))
    if (library := kernel().library) is not None:
        found = np.empty((2, len(signals), len(edges_s) - 1))
        edges, lag = np.ascontiguousarray(edges_s), np.array([lag_s])
        for signal, out in zip(signals, found.swapaxes(0, 1), strict=True):
            time, *changes = _in_order(signal)
            events, bins = (ctypes.c_long(len(values)) for values in (time, out[0]))
            library.mp_host_bins(events, *map(pointer, (time, *changes)), bins, *map(pointer, (edges, lag, out[0], out[1])))
        return found[0].T, found[1].T
    each = [_bin_integrals(signal, edges_s, lag_s) for signal in signals]
    integral, moment, forced = (np.stack(part, 1) for part in zip(*each, strict=True))
    if lag_s == 0:
        return integral, moment
    length = np.diff(edges_s)
    y = _lagged_at_edges(forced, np.exp(-length / lag_s))
    lagged = integral - lag_s * np.diff(y, axis=0)
    return lagged, moment - lag_s * (length[:, None] * y[1:] - lagged)


def _in_order(signal: Signal) -> tuple[Array, Array, Array]:
    """Times, steps and changes of slope, in the order of time."""
    order = np.argsort(signal.time_s, kind="stable")
    return signal.time_s[order], signal.step[order], signal.slope[order]


def _bin_integrals(signal: Signal, edges_s: Array, lag_s: float) -> tuple[Array, Array, Array]:
    """Of one signal: both integrals (bins,), and (1 + bins,) what a lag lets through of it before the first edge and by each bin's end."""
    time, step, slope = _in_order(signal)
    # a bin goes on as it begins; events within it add what they change from there on
    since, begun, rising = np.append(edges_s[0], time), np.append(0.0, np.cumsum(step)), np.append(0.0, np.cumsum(slope))
    begun[2:] += np.cumsum(rising[1:-1] * np.diff(time))
    length = np.diff(edges_s)
    bin_of = np.searchsorted(edges_s, time, "right") - 1
    last = np.cumsum(np.bincount(bin_of + 1, minlength=len(length)))[: len(length)]  # events before each edge
    first_slope = rising[last]
    first = begun[last] + first_slope * (edges_s[:-1] - since[last])
    inside, before = (bin_of >= 0) & (bin_of < len(length)), bin_of < 0

    def per_bin(added: Array) -> Array:
        return np.bincount(bin_of[inside], added, len(length)).astype(np.float64)

    jump, bend, own = step[inside], slope[inside], length[bin_of[inside]]
    offset = time[inside] - edges_s[bin_of[inside]]
    left = own - offset
    integral = length * (first + first_slope * length / 2) + per_bin(left * (jump + bend * left / 2))
    moment = length**2 * (first / 2 + first_slope * length / 3)
    moment += per_bin(left * (jump * (own + offset) / 2 + bend * left * (2 * own + offset) / 6))
    if lag_s == 0:
        return integral, moment, np.zeros(0)

    def let_through(step: Array, slope: Array, for_s: Array) -> Array:
        rest = lag_s * -np.expm1(-for_s / lag_s)
        return step * rest / lag_s + slope * (for_s - rest)

    at_first = let_through(step[before], slope[before], edges_s[0] - time[before]).sum()
    forced = let_through(first, first_slope, length) + per_bin(let_through(jump, bend, left))
    return integral, moment, np.concatenate([[at_first], forced])


def _lagged_at_edges(forced: Array, decay: Array) -> Array:
    """(1 + bins, signals) y at each edge from its recursion ``y[i+1] = decay[i] y[i] + forced[i+1]``, y[0] = forced[0]."""
    y = np.array(forced, dtype=np.float64)
    for i, kept in enumerate(decay):
        y[i + 1] += kept * y[i]
    return y
