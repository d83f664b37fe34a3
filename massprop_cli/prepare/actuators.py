"""Command channels of actuators: their level in time as a piecewise linear signal, and their wrench at full level.

A log has one of three kinds: jets, a commanded wrench, or rotors. To add a kind, give its signal (:mod:`massprop_cli.prepare.signal`) in
:func:`executed` and its wrench in :func:`channel_wrench`. Momentum devices are the last channels (:mod:`massprop_cli.prepare.stored`).
"""

from collections.abc import Iterator, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.actuators.rotor import thrust_integrals
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.equipment import Jet
from massprop_cli.inputs.supply import SupplyLevel
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import call, kernel
from massprop_cli.prepare.clock import by_commands_clock
from massprop_cli.prepare.signal import Signal, signal_of_bins, signal_sum, window_integrals

TOUCHING = 1e-3
"""Largest gap, in cycles, at which two pulses count as one: a jet held on does not fall and rise between cycles."""

NOWHERE = -1
"""Line number of a vector that counts as zero."""
SMALL, ALIKE = 0.05, 0.999
"""Fraction of the largest force or torque below which one counts as zero; cosine above which two vectors are on one line."""


def capability(log: Log, vehicle: Vehicle) -> Array:
    """(r, 6) wrenches that this vehicle can command."""
    wrench = channel_wrench(log, vehicle)
    if log.command_kind != "wrench":
        return wrench
    return np.asarray(wrench[np.append((log.command != 0).any(0), np.ones(len(vehicle.momentum_wrench), dtype=bool))])


def channel_wrench(log: Log, vehicle: Vehicle) -> Array:
    """(C, 6) torque about O [N m] and force [N] of each command channel, in the directions in which the environment permits motion.

    Per unit of the channel: jets at full thrust, unit components of a wrench, rotors at 1 N, momentum devices at 1 N m.
    """
    actuators = {"jets": vehicle.jet_wrench, "wrench": vehicle.unit_wrench, "rotors": vehicle.rotor_wrench}[log.command_kind]
    return np.vstack([actuators, vehicle.momentum_wrench]) * vehicle.environment.moving


def channel_names(log: Log, vehicle: Vehicle) -> list[str]:
    """Names of all command channels."""
    by_kind = {"jets": [jet.name for jet in vehicle.jets], "wrench": list(WRENCH), "rotors": [rotor.name for rotor in vehicle.rotors]}
    names = by_kind[log.command_kind]
    return [*names, *(name for device in vehicle.spinning for name in device.channels)]


def pulses(part: Array, start_s: Array, on_s: Array, jet: Jet, touching_s: float) -> Signal:
    """Thrust of one jet over its full thrust; each pulse has the level ``part``.

    A pulse rises linearly from its start, ends after its on-time, then falls linearly from the level reached. Pulses with a gap below
    ``touching_s`` merge into one that steps from level to level. Overlapping pulses both give their whole impulse.
    """
    fired = on_s > 0
    begin, end, part = start_s[fired], (start_s + on_s)[fired], part[fired]
    starts = np.concatenate([[True], np.abs(begin[1:] - end[:-1]) > touching_s])[: len(begin)]
    ends = np.append(starts[1:], True)[: len(end)]
    merged = np.flatnonzero(~ends)
    level_steps = end[merged], part[merged + 1] - part[merged]
    begin, end, first, part = begin[starts], end[ends], part[starts], part[ends]
    none = np.zeros(len(begin))
    events: list[tuple[Array, Array, Array]] = [(*level_steps, np.zeros(len(merged)))]
    if jet.rise_s > 0:
        top = np.minimum(begin + jet.rise_s, end)
        reached = (top - begin) / jet.rise_s
        events += [(begin, none, first / jet.rise_s), (top, none, -first / jet.rise_s)]
    else:
        reached = none + 1
        events += [(begin, first, none)]
    if jet.fall_s > 0:
        events += [(end, none, -part / jet.fall_s), (end + reached * jet.fall_s, none, part / jet.fall_s)]
    else:
        events += [(end, -reached * part, none)]
    return Signal(*(np.concatenate(parts) for parts in zip(*events, strict=True)))


def held(start_s: Array, value: Array) -> Signal:
    """Signal that holds each value from its start to the next (zero-order hold)."""
    return Signal(start_s, np.diff(value, prepend=0.0), np.zeros_like(start_s))


def executed(log: Log, vehicle: Vehicle, issued: slice, begin_s: Array, edges_s: Array, lag_s: float) -> tuple[Array, Array]:
    """Integral and first moment per bin, (bins, commands) each, of jet thrust fractions, wrench components, or rotor thrusts in N.

    Commands of the cycles ``issued`` act from ``begin_s`` on. ``lag_s`` is the lag of actuators that state none of their own.
    """
    command = _commands(log, vehicle, issued)
    if log.command_kind == "rotors":
        at_once = by_commands_clock(log, vehicle, log.command_start_s[issued])
        measured = {after_s: at_once + after_s for after_s in (0.0, *log.bends_s)}
        bends_s = log.bends_s or (0.0,) * len(vehicle.rotors)
        each = zip(vehicle.rotors, _by_voltage(command, begin_s, vehicle, log.supply), bends_s, strict=True)
        return thrust_integrals([rotor.held(x, begin_s, measured[after_s], lag_s) for rotor, x, after_s in each], edges_s)
    if log.command_kind == "jets":
        return jet_integrals(begin_s, command, vehicle, edges_s, lag_s, log.supply)
    return window_integrals([held(begin_s, value) for value in command], edges_s, lag_s)


def _by_voltage(command: Array, begin_s: Array, vehicle: Vehicle, supply: SupplyLevel | None) -> Array:
    """(R, K) rotor commands, scaled by supply voltage over nominal voltage at mid-cycle for rotors that state a nominal voltage."""
    if supply is None:
        return command
    volts = supply.at(begin_s + vehicle.cycle.period_s / 2)
    return np.stack([x * volts / rotor.nominal_v if rotor.nominal_v else x for rotor, x in zip(vehicle.rotors, command, strict=True)])


def _commands(log: Log, vehicle: Vehicle, issued: slice) -> Array:
    """(n, K) commands of the cycles ``issued``; a wrench's are clipped to ``thrust.wrench_limits`` if stated."""
    command, limits = log.command[issued].T, vehicle.thrust.wrench_limits
    if limits is None or log.command_kind != "wrench":
        return command
    return np.clip(command.T, -np.array(limits), limits).T


FINE = 4
"""Number of sub-bins per bin in which the lagged thrust of a rotor is approximated as linear."""


def signals(log: Log, vehicle: Vehicle, issued: slice, begin_s: Array, edges_s: Array, lag_s: float) -> tuple[list[Signal], float]:
    """The quantities of :func:`executed` as signals, and the lag that they do not yet include, s; rotor signals include theirs."""
    if log.command_kind == "rotors":
        part = np.arange(FINE) / FINE
        fine = np.append((edges_s[:-1, None] + np.diff(edges_s)[:, None] * part).ravel(), edges_s[-1])
        # extend to the first command, so that lags start from rest
        bin_s = edges_s[1] - edges_s[0]
        early = begin_s[0] + bin_s * np.arange(int((fine[0] - begin_s[0]) / bin_s))
        fine = np.concatenate([early, fine])
        both = executed(log, vehicle, issued, begin_s, fine, lag_s)
        return [signal_of_bins(fine, *one) for one in zip(*(each.T for each in both), strict=True)], 0.0
    command = _commands(log, vehicle, issued)
    if log.command_kind == "wrench":
        return [held(begin_s, value) for value in command], lag_s
    touching_s = TOUCHING * vehicle.cycle.period_s
    parts = pulse_parts(begin_s, command, vehicle, log.supply)
    by_jet = ([pulses(part[i], at_s[i], on_s[i], jet, touching_s) for part, at_s, on_s in parts] for i, jet in enumerate(vehicle.jets))
    return [signal_sum(signals) for signals in by_jet], lag_s


def jet_integrals(
    start_s: Array, on_s: Array, vehicle: Vehicle, edges_s: Array, lag_s: float, supply: SupplyLevel | None = None
) -> tuple[Array, Array]:
    """Integrals as in :func:`window_integrals` of the jets' thrust fractions, from on-times (jets, K) in cycles from ``start_s``."""
    return pulse_integrals(pulse_parts(start_s, on_s, vehicle, supply), vehicle.jets, TOUCHING * vehicle.cycle.period_s, edges_s, lag_s)


PulsePart = tuple[Array, Array, Array]
"""Level of a part of the thrust, its start time [s] and its duration [s], (jets, K) each."""
LATE = {"begin": 0.0, "centre": 0.5, "end": 1.0}
"""Fraction of the cycle's idle time before the pulse, by ``cycle.pulse_at``."""


def pulse_parts(start_s: Array, on_s: Array, vehicle: Vehicle, supply: SupplyLevel | None = None) -> list[PulsePart]:
    """Parts that sum to the thrust of the jets, from on-times (jets, K) in cycles from ``start_s``: pulses, and negative parts for droop.

    Each further open jet reduces a pulse by ``droop`` while both are open, and by ``cycle_droop`` over the whole pulse. A failure scales
    the pulses that start within it. The supply pressure at mid-pulse scales each part.
    """
    thrust, strength = vehicle.thrust, strengths(start_s, vehicle)
    # a jet that does not open causes no droop
    on_s = np.where(strength == 0, 0.0, on_s)
    on_s = np.where(on_s < thrust.dead_on_s, 0.0, np.where(on_s > 0, np.maximum(on_s, thrust.least_on_s), 0.0))
    levels = [(strength, on_s)]
    for droop, while_open in ((thrust.droop, True), (thrust.cycle_droop, False)):
        levels += [(-droop * strength, overlap_s) for overlap_s in overlaps(on_s, while_open)] if droop else []
    late, period_s = LATE[vehicle.cycle.pulse_at], vehicle.cycle.period_s
    start_s = start_s + np.array([jet.delay_s for jet in vehicle.jets])[:, None]
    parts = [(level, start_s + late * np.maximum(period_s - lasts_s, 0.0), lasts_s) for level, lasts_s in levels]
    return parts if supply is None else [(level * supply.at(begin_s + lasts_s / 2), begin_s, lasts_s) for level, begin_s, lasts_s in parts]


def strengths(start_s: Array, vehicle: Vehicle) -> Array:
    """(jets, K) fraction of its thrust that each jet gives in pulses that start at ``start_s``, by stated failures."""
    fraction = np.ones((len(vehicle.jets), len(start_s)))
    for failure in vehicle.thrust.failures:
        fraction[[jet.name == failure.jet for jet in vehicle.jets]] *= np.where(failure.of(start_s), failure.thrust, 1.0)
    return fraction


def check_supply(log: Log, vehicle: Vehicle, source: str) -> None:
    """Raise :class:`InputError` if droop would take all thrust or more in the cycle with the most jets."""
    most, thrust = together(log), vehicle.thrust
    if (thrust.droop + thrust.cycle_droop) * (most - 1) >= 1:
        raise InputError(
            f"{source}: thrust.droop = {thrust.droop:g} and thrust.cycle_droop = {thrust.cycle_droop:g}: in {log.path} {most} jets fire "
            "together, and would give no thrust; state the part of its thrust that a jet loses for each other jet"
        )


def together(log: Log) -> int:
    """Largest number of jets that fire in one cycle; 0 without jets."""
    return int((log.command > 0).sum(1).max(initial=0)) if log.command_kind == "jets" else 0


def overlaps(on_s: Array, while_open: bool) -> Iterator[Array]:
    """(jets, K) time that each jet is open together with a first other jet, then with a second, and so on, s.

    Other jets are in order of descending on-time, since all pulses of a cycle start together. Unless ``while_open``, the time is the jet's
    whole pulse if that other jet fires.
    """
    order = np.argsort(-on_s, axis=0, kind="stable")
    longest, rank = np.take_along_axis(on_s, order, 0), np.argsort(order, axis=0, kind="stable")
    for place in range(int((on_s > 0).sum(0).max(initial=1)) - 1):
        other_s = np.where(rank > place, longest[place], longest[place + 1])
        yield np.minimum(on_s, other_s) if while_open else np.where(other_s > 0, on_s, 0.0)


def pulse_integrals(
    parts: Sequence[PulsePart], jets: Sequence[Jet], touching_s: float, edges_s: Array, lag_s: float
) -> tuple[Array, Array]:
    """Integrals as in :func:`window_integrals` of the jets' thrust, the sum of :func:`pulses` of all ``parts``."""
    total = np.zeros((2, len(jets), len(edges_s) - 1))
    if (library := kernel().library) is None:
        for part in parts:
            signals = [pulses(*one, touching_s) for one in zip(*part, jets, strict=True)]
            total += np.swapaxes(window_integrals(signals, edges_s, lag_s), 1, 2)
        return total[0].T, total[1].T
    count, ramps = parts[0][1].shape[1], np.array([(jet.rise_s, jet.fall_s) for jet in jets])
    workspace = np.empty(12 * count + (2 * total.shape[2] if lag_s > 0 else 0))
    for part in parts:
        arrays, bins = (np.asarray(each, dtype=float) for each in part), (total.shape[2], edges_s, np.array([lag_s]), workspace, *total)
        call(library.mp_host_pulses, len(jets), count, *arrays, ramps, np.array([touching_s]), *bins)
    return total[0].T, total[1].T


def longest_delay_s(vehicle: Vehicle) -> float:
    """Longest delay of any jet in addition to the command delay, s."""
    return max((jet.delay_s for jet in vehicle.jets), default=0.0)


def longest_lag_s(vehicle: Vehicle, lag_s: float) -> float:
    """Longest lag of any actuator, s; ``lag_s`` is the common one."""
    return max([lag_s, *(lag for rotor in vehicle.rotors for lag in rotor.lags(lag_s))])


def along_one_line(log: Log, vehicle: Vehicle) -> list[tuple[int, ...]]:
    """Groups of two or more channels, but not all, whose forces share one line and whose torques share one line."""
    wrench = channel_wrench(log, vehicle)
    keys = list(zip(lines_of(wrench[:, 3:]), lines_of(wrench[:, :3]), strict=True))
    groups = (tuple(i for i, other in enumerate(keys) if other == key) for key in dict.fromkeys(keys))
    return [group for group in groups if 1 < len(group) < len(keys)]


def always_together(log: Log) -> list[list[int]]:
    """Groups of two or more channels with identical commands throughout the log."""
    groups: dict[bytes, list[int]] = {}
    for i, column in enumerate(log.command.T):
        if column.any():
            groups.setdefault(column.tobytes(), []).append(i)
    return [group for group in groups.values() if len(group) > 1]


def pushing(force: Array, together: Sequence[Sequence[int]] = ()) -> tuple[int, ...]:
    """Channels with a net force, from channel forces (C, 3); empty unless there are two or more and others without a net force.

    Each channel of a group in ``together`` has the net force of the group.
    """
    net_force = force.copy()
    for group in together:
        net_force[list(group)] = force[list(group)].sum(0)
    size = np.linalg.norm(net_force, axis=1)
    channels = np.flatnonzero(size > SMALL * size.max(initial=0.0)).tolist()
    return tuple(channels) if 1 < len(channels) < len(force) else ()


def lines_of(vectors: Array) -> list[int]:
    """Line number of each vector (C, 3); opposite vectors share a line. ``NOWHERE`` for vectors below :data:`SMALL` of the largest."""
    size = np.linalg.norm(vectors, axis=1)
    lines: list[int] = []
    units: list[Array] = []
    for vector, length in zip(vectors, size, strict=True):
        if length <= SMALL * size.max(initial=0.0):
            lines.append(NOWHERE)
            continue
        unit = vector / length
        same = [k for k, one in enumerate(units) if abs(one @ unit) > ALIKE]
        lines.append(same[0] if same else len(units))
        if not same:
            units.append(unit)
    return lines
