"""What commanded actuators do: each command channel in time, as a piecewise linear signal, and its wrench at full.

Jets and commanded wrenches are the two kinds. Another one says in :func:`executed` which :class:`Signal` a command makes, and in
:func:`channel_wrench` which torque and force that is at full.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Jet, Vehicle

TOUCHING = 1e-3
"""Pulses closer than this part of a cycle are one: a jet held on does not fall and rise between cycles."""


def capability(log: Log, vehicle: Vehicle) -> Array:
    """(r, 6) wrenches that this vehicle can command."""
    wrench = channel_wrench(log, vehicle)
    return wrench if log.command_kind == "jets" else wrench[(log.command != 0).any(0)]


def channel_names(log: Log, vehicle: Vehicle) -> list[str]:
    """Of each command channel: jets, or the components of a wrench."""
    return [jet.name for jet in vehicle.jets] if log.command_kind == "jets" else list(WRENCH)


def channel_wrench(log: Log, vehicle: Vehicle) -> Array:
    """(C, 6) torque about O and force of each command channel at full: jets, or a wrench's components, as far as they move the vehicle."""
    return (vehicle.jet_wrench if log.command_kind == "jets" else np.eye(6)) * vehicle.environment.moving


@dataclass(frozen=True)
class Signal:
    """A piecewise linear function of time, zero before its first event: steps and changes of slope, in any order."""

    time_s: Array
    step: Array
    slope: Array


def pulses(start_s: Array, on_s: Array, jet: Jet, touching_s: float) -> Signal:
    """Thrust over full thrust of one jet.

    A pulse rises linearly from its start, lasts its on-time, then falls from the thrust reached. Pulses closer than ``touching_s`` are one.
    """
    fired = on_s > 0
    begin, end = start_s[fired], (start_s + on_s)[fired]
    alone = np.concatenate([[True], begin[1:] - end[:-1] > touching_s])[: len(begin)]
    begin, end = begin[alone], end[np.append(alone[1:], True)[: len(end)]]
    none = np.zeros_like(begin)
    if jet.rise_s > 0:
        top = np.minimum(begin + jet.rise_s, end)
        reached = (top - begin) / jet.rise_s
        events = [(begin, none, none + 1 / jet.rise_s), (top, none, none - 1 / jet.rise_s)]
    else:
        reached = none + 1
        events = [(begin, reached, none)]
    if jet.fall_s > 0:
        events += [(end, none, none - 1 / jet.fall_s), (end + reached * jet.fall_s, none, none + 1 / jet.fall_s)]
    else:
        events += [(end, -reached, none)]
    return Signal(*(np.concatenate(parts) for parts in zip(*events, strict=True)))


def held(start_s: Array, value: Array) -> Signal:
    """A value held from each start to the next."""
    return Signal(start_s, np.diff(value, prepend=0.0), np.zeros_like(start_s))


def executed(log: Log, vehicle: Vehicle, issued: slice, begin_s: Array, edges_s: Array) -> tuple[Array, Array]:
    """Integral and first moment per bin, (bins, commands), of each jet's thrust fraction or of each wrench component.

    By the commands of the cycles ``issued``, which are executed from ``begin_s`` on.
    """
    command = log.command[issued].T
    if log.command_kind == "jets":
        touching = TOUCHING * vehicle.cycle.period_s
        signals = [pulses(begin_s, on, jet, touching) for on, jet in zip(command, vehicle.jets, strict=True)]
    else:
        signals = [held(begin_s, value) for value in command]
    return window_integrals(signals, edges_s, vehicle.thrust.stated_lag_s)


def window_integrals(signals: Sequence[Signal], edges_s: Array, lag_s: float = 0.0) -> tuple[Array, Array]:
    """∫ u dt and ∫ (t − bin start) u dt over each bin of ``edges_s``, exactly, for piecewise linear ``u``: (bins, signals) each.

    With ``lag_s`` the integrals are those of y, ``lag y' + y = u``, y = 0 before the first event.
    """
    found = [_bin_integrals(signal, edges_s, lag_s) for signal in signals]
    integral, moment, forced = (np.stack(part, 1) for part in zip(*found, strict=True))
    if lag_s == 0:
        return integral, moment
    length = np.diff(edges_s)
    y = _lagged_at_edges(forced, np.exp(-length / lag_s))
    lagged = integral - lag_s * np.diff(y, axis=0)
    return lagged, moment - lag_s * (length[:, None] * y[1:] - lagged)


def _bin_integrals(signal: Signal, edges_s: Array, lag_s: float) -> tuple[Array, Array, Array]:
    """Of one signal: both integrals (bins,), and (1 + bins,) what a lag lets through of it before the first edge and by each bin's end."""
    order = np.argsort(signal.time_s, kind="stable")
    time, step, slope = signal.time_s[order], signal.step[order], signal.slope[order]
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
        summed: Array = np.bincount(bin_of[inside], added, len(length)).astype(np.float64)
        return summed

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
        found: Array = step * rest / lag_s + slope * (for_s - rest)
        return found

    at_first = let_through(step[before], slope[before], edges_s[0] - time[before]).sum()
    forced = let_through(first, first_slope, length) + per_bin(let_through(jump, bend, left))
    return integral, moment, np.concatenate([[at_first], forced])


def _lagged_at_edges(forced: Array, decay: Array) -> Array:
    """(1 + bins, signals) y at each edge from its recursion ``y[i+1] = decay[i] y[i] + forced[i+1]``, y[0] = forced[0]."""
    y = forced.copy()
    for i, kept in enumerate(decay):
        y[i + 1] += kept * y[i]
    return y
