"""Piecewise linear functions of time, what first-order lags make of them, and their exact integrals over bins."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, ComplexArray, IntArray, recursion
from massprop_cli.base.dataclass import dataclass
from massprop_cli.kernel import call, kernel

Lags = Array | ComplexArray
FORGOTTEN = 1e-18
"""What a lag keeps that is below the last digit of anything."""


@dataclass(frozen=True)
class Signal:
    """A piecewise linear function of time, zero before its first event: steps and changes of slope, in any order."""

    time_s: Array
    step: Array
    slope: Array

    @cached_property
    def course(self) -> Course:
        """The signal and its integrals at its events; without any, at one that changes nothing."""
        return Course.of(*(_in_order(self) if len(self.time_s) else np.zeros((3, 1))))

    def through(self, times: Array, early_s: float = 0.0) -> tuple[Course, IntArray]:
        """The course with further events at ``times`` (Q,) that change nothing, and where these stand.

        Of events at one time they are the first, and of those that come less than ``early_s`` before them.
        """
        order = np.argsort(np.concatenate([times - early_s, self.time_s]), kind="stable")
        own = (
            np.concatenate([at, changes])
            for at, changes in zip((times, 0 * times, 0 * times), (self.time_s, self.step, self.slope), strict=True)
        )
        return Course.of(*(each[order] for each in own)), np.argsort(order)[: len(times)]


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

    @staticmethod
    def of(time: Array, step: Array, slope: Array) -> Course:
        """Of steps and changes of slope in the order of time."""
        lasting, rising = np.diff(time), np.cumsum(slope)
        level = np.cumsum(step) + np.append(0.0, np.cumsum(rising[:-1] * lasting))
        grown = level[:-1] * lasting + rising[:-1] * lasting**2 / 2
        first = np.append(0.0, np.cumsum(grown))
        second = np.append(0.0, np.cumsum(first[:-1] * lasting + level[:-1] * lasting**2 / 2 + rising[:-1] * lasting**3 / 6))
        return Course(time, lasting, level, rising, first, second)

    def lagged(self, lags: Lags) -> Lags:
        """(P, E) what lags (P, 1) are at as each event comes: y[e + 1] = d[e] y[e] + f[e]."""
        during = np.exp(-self.lasting_s / lags)
        rest = 1.0 - during
        forced = self.level[:-1] * rest + self.rising[:-1] * (self.lasting_s - lags * rest)
        kept, added = (np.concatenate([np.zeros_like(lags), each], 1) for each in (during, forced))
        return recursion(added, kept, FORGOTTEN)


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
        for signal, out in zip(signals, found.swapaxes(0, 1), strict=True):
            call(library.mp_host_bins, len(signal.time_s), *_in_order(signal), len(out[0]), edges_s, np.array([lag_s]), *out)
        return found[0].T, found[1].T
    integral, moment = (np.stack(part, 1) for part in zip(*(_integrals(signal, edges_s, lag_s) for signal in signals), strict=True))
    return integral, moment


def _in_order(signal: Signal) -> tuple[Array, Array, Array]:
    """Times, steps and changes of slope, in the order of time."""
    order = np.argsort(signal.time_s, kind="stable")
    return signal.time_s[order], signal.step[order], signal.slope[order]


def _integrals(signal: Signal, edges_s: Array, lag_s: float) -> tuple[Array, Array]:
    """(bins,) both integrals of one signal: sums over what lies between edges and events."""
    course, edge = signal.through(edges_s)
    own = slice(edge[0], edge[-1])
    since, lasting, level, rising = course.time_s[own] - np.repeat(edges_s[:-1], np.diff(edge)), *(part[own] for part in course[1:4])
    grown = lasting * (level + rising * lasting / 2)
    parts = grown, since * grown + lasting**2 * (level / 2 + rising * lasting / 3)
    integral, moment = (np.add.reduceat(part, edge[:-1] - edge[0]) for part in parts)
    if lag_s > 0:
        ended = course.lagged(np.array([[lag_s]]))[0, edge]
        integral = integral - lag_s * np.diff(ended)
        moment = moment - lag_s * (np.diff(edges_s) * ended[1:] - integral)
    return integral, moment
