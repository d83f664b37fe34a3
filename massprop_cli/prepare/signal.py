"""Piecewise linear signals: exact response of first-order lags and exact integrals over bins."""

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
"""Products of decay factors below this are zero: far below double precision."""


@dataclass(frozen=True)
class Signal:
    """A piecewise linear function of time, zero before its first event; events in any order."""

    time_s: Array
    """(E,) event times, s."""
    step: Array
    """(E,) step at each event."""
    slope: Array
    """(E,) change of slope at each event, 1/s."""

    @cached_property
    def course(self) -> Course:
        """The signal and its integrals at its events; without events, at one event that changes nothing."""
        return Course.of(*(_in_order(self) if len(self.time_s) else np.zeros((3, 1))))

    def with_events_at(self, times: Array, early_s: float = 0.0) -> tuple[Course, IntArray]:
        """The course with null events inserted at ``times`` (Q,), and their (Q,) indices.

        A null event precedes all events at its time and all events less than ``early_s`` before it.
        """
        order = np.argsort(np.concatenate([times - early_s, self.time_s]), kind="stable")
        merged = (
            np.concatenate([at, changes])
            for at, changes in zip((times, 0 * times, 0 * times), (self.time_s, self.step, self.slope), strict=True)
        )
        return Course.of(*(each[order] for each in merged)), np.argsort(order)[: len(times)]


class Course(NamedTuple):
    """A signal and its integrals just after each of its E events, in time order."""

    time_s: Array
    """(E,) event times, s."""
    duration_s: Array
    """(E − 1,) time from each event to the next, s."""
    level: Array
    """(E,) value."""
    slope: Array
    """(E,) slope, 1/s."""
    first: Array
    """(E,) integral up to the event, s."""
    second: Array
    """(E,) second integral, s²."""

    @staticmethod
    def of(time: Array, step: Array, slope_change: Array) -> Course:
        """Course of steps and changes of slope in time order."""
        duration, slope = np.diff(time), np.cumsum(slope_change)
        level = np.cumsum(step) + np.append(0.0, np.cumsum(slope[:-1] * duration))
        area = level[:-1] * duration + slope[:-1] * duration**2 / 2
        first = np.append(0.0, np.cumsum(area))
        second = np.append(0.0, np.cumsum(first[:-1] * duration + level[:-1] * duration**2 / 2 + slope[:-1] * duration**3 / 6))
        return Course(time, duration, level, slope, first, second)

    def lagged(self, lags: Lags) -> Lags:
        """(P, E) states of first-order lags (P, 1) at the events: y[e + 1] = d[e] y[e] + f[e], d the decay, f the forced response."""
        decay = np.exp(-self.duration_s / lags)
        rest = 1.0 - decay
        forced = self.level[:-1] * rest + self.slope[:-1] * (self.duration_s - lags * rest)
        decays, inputs = (np.concatenate([np.zeros_like(lags), each], 1) for each in (decay, forced))
        return recursion(inputs, decays, FORGOTTEN)


def signal_sum(parts: Sequence[Signal]) -> Signal:
    """Sum of signals."""
    return Signal(*(np.concatenate(each) for each in zip(*((one.time_s, one.step, one.slope) for one in parts), strict=True)))


def signal_of_bins(edges_s: Array, integral: Array, moment: Array) -> Signal:
    """Signal that is linear in each bin, with the given integral and first moment about the bin's start."""
    length = np.diff(edges_s)
    slope = 12 * (moment - integral * length / 2) / length**3
    start = integral / length - slope * length / 2
    end = start + slope * length
    step = np.append(start, 0.0) - np.append(0.0, end)
    return Signal(edges_s, step, np.diff(np.append(slope, 0.0), prepend=0.0))


def window_integrals(signals: Sequence[Signal], edges_s: Array, lag_s: float = 0.0) -> tuple[Array, Array]:
    """Exact ∫ u dt and ∫ (t − bin start) u dt over each bin of ``edges_s``, for piecewise linear u: (bins, signals) each.

    With ``lag_s``, the integrals are of y instead: ``lag_s y' + y = u``, y = 0 before the first event.
    """
    if not signals:
        return np.zeros((len(edges_s) - 1, 0)), np.zeros((len(edges_s) - 1, 0))
    if (library := kernel().library) is not None:
        integrals = np.empty((2, len(signals), len(edges_s) - 1))
        for signal, out in zip(signals, integrals.swapaxes(0, 1), strict=True):
            call(library.mp_host_bins, len(signal.time_s), *_in_order(signal), len(out[0]), edges_s, np.array([lag_s]), *out)
        return integrals[0].T, integrals[1].T
    integral, moment = (np.stack(part, 1) for part in zip(*(_integrals(signal, edges_s, lag_s) for signal in signals), strict=True))
    return integral, moment


def _in_order(signal: Signal) -> tuple[Array, Array, Array]:
    """Times, steps and changes of slope, in time order."""
    order = np.argsort(signal.time_s, kind="stable")
    return signal.time_s[order], signal.step[order], signal.slope[order]


def _integrals(signal: Signal, edges_s: Array, lag_s: float) -> tuple[Array, Array]:
    """(bins,) integral and (bins,) first moment of one signal, summed over the pieces between edges and events."""
    course, edge = signal.with_events_at(edges_s)
    covered = slice(edge[0], edge[-1])
    since, duration, level, slope = (
        course.time_s[covered] - np.repeat(edges_s[:-1], np.diff(edge)),
        *(part[covered] for part in course[1:4]),
    )
    area = duration * (level + slope * duration / 2)
    parts = area, since * area + duration**2 * (level / 2 + slope * duration / 3)
    integral, moment = (np.add.reduceat(part, edge[:-1] - edge[0]) for part in parts)
    if lag_s > 0:
        state = course.lagged(np.array([[lag_s]]))[0, edge]
        integral = integral - lag_s * np.diff(state)
        moment = moment - lag_s * (np.diff(edges_s) * state[1:] - integral)
    return integral, moment
