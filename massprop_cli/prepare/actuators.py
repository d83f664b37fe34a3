"""What commanded actuators do: each command channel in time, as a piecewise linear signal, and its wrench at full.

Jets, commanded wrenches and rotors are three kinds, of which a log has one. Another one says in :func:`executed` which signal
(:mod:`massprop_cli.prepare.signal`) a command makes, and in :func:`channel_wrench` which torque and force that is at full. What stores
momentum, which may be beside either, is the last channels: :mod:`massprop_cli.prepare.stored` has what it does.
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
from massprop_cli.prepare.signal import Signal, joined, of_bins, window_integrals

TOUCHING = 1e-3
"""Pulses that end and begin within this part of a cycle are one: a jet held on does not fall and rise between cycles."""

NOWHERE = -1
SMALL, ALIKE = 0.05, 0.999
"""Part of the largest below which a force or torque is none, and cosine above which two are along one line."""


def capability(log: Log, vehicle: Vehicle) -> Array:
    """(r, 6) wrenches that this vehicle can command."""
    wrench = channel_wrench(log, vehicle)
    if log.command_kind != "wrench":
        return wrench
    return np.asarray(wrench[np.append((log.command != 0).any(0), np.ones(len(vehicle.momentum_wrench), dtype=bool))])


def channel_wrench(log: Log, vehicle: Vehicle) -> Array:
    """(C, 6) torque about O and force of each command channel, as far as they move the vehicle.

    Jets at full, a wrench's components, rotors' newtons; momentum devices' N m.
    """
    own = {"jets": vehicle.jet_wrench, "wrench": vehicle.unit_wrench, "rotors": vehicle.rotor_wrench}[log.command_kind]
    return np.vstack([own, vehicle.momentum_wrench]) * vehicle.environment.moving


def channel_names(log: Log, vehicle: Vehicle) -> list[str]:
    """Of each command channel."""
    by_kind = {"jets": [jet.name for jet in vehicle.jets], "wrench": list(WRENCH), "rotors": [rotor.name for rotor in vehicle.rotors]}
    names = by_kind[log.command_kind]
    return [*names, *(name for device in vehicle.spinning for name in device.channels)]


def pulses(part: Array, start_s: Array, on_s: Array, jet: Jet, touching_s: float) -> Signal:
    """Thrust over full thrust of one jet, of which each pulse gives its ``part``.

    A pulse rises linearly from its start, lasts its on-time, then falls from the thrust reached. Pulses that end and begin within
    ``touching_s`` are one, which steps from part to part. Pulses that overlap, as their times scatter, both give their whole impulse.
    """
    fired = on_s > 0
    begin, end, part = start_s[fired], (start_s + on_s)[fired], part[fired]
    alone = np.concatenate([[True], np.abs(begin[1:] - end[:-1]) > touching_s])[: len(begin)]
    last = np.append(alone[1:], True)[: len(end)]
    goes_on = np.flatnonzero(~last)
    onward = end[goes_on], part[goes_on + 1] - part[goes_on]
    begin, end, first, part = begin[alone], end[last], part[alone], part[last]
    none = np.zeros(len(begin))
    events: list[tuple[Array, Array, Array]] = [(*onward, np.zeros(len(goes_on)))]
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
    """A value held from each start to the next."""
    return Signal(start_s, np.diff(value, prepend=0.0), np.zeros_like(start_s))


def executed(log: Log, vehicle: Vehicle, issued: slice, begin_s: Array, edges_s: Array, lag_s: float) -> tuple[Array, Array]:
    """Integral and first moment per bin, (bins, commands), of each jet's thrust fraction, wrench component, or rotor's thrust in N.

    Commands of the cycles ``issued`` are executed from ``begin_s`` on, with the lag ``lag_s`` where an actuator has none of its own.
    """
    command = _limited(log.command[issued], vehicle).T
    if log.command_kind == "rotors":
        at_once = by_commands_clock(log, vehicle, log.command_start_s[issued])
        measured = {after_s: at_once + after_s for after_s in (0.0, *log.bends_s)}
        bends_s = log.bends_s or (0.0,) * len(vehicle.rotors)
        told = zip(vehicle.rotors, _by_voltage(command, begin_s, vehicle, log.supply), bends_s, strict=True)
        return thrust_integrals([rotor.held(x, begin_s, measured[after_s], lag_s) for rotor, x, after_s in told], edges_s)
    if log.command_kind == "jets":
        return jet_integrals(begin_s, command, vehicle, edges_s, lag_s, log.supply)
    return window_integrals([held(begin_s, value) for value in command], edges_s, lag_s)


def _by_voltage(command: Array, begin_s: Array, vehicle: Vehicle, supply: SupplyLevel | None) -> Array:
    """(R, K) commands of rotors, each in proportion to the voltage in the middle of its cycle from ``begin_s`` on, where that is stated."""
    if supply is None:
        return command
    volts = supply.at(begin_s + vehicle.cycle.period_s / 2)
    return np.stack([x * volts / rotor.nominal_v if rotor.nominal_v else x for rotor, x in zip(vehicle.rotors, command, strict=True)])


def _limited(command: Array, vehicle: Vehicle) -> Array:
    """(K, n) what acts of commands, of which those of a wrench may have limits."""
    limits = vehicle.thrust.wrench_limits
    return command if limits is None else np.clip(command, -np.array(limits), limits)


FINE = 4
"""Parts of a bin in which what a rotor's lag makes of its thrust is taken as linear."""


def signals(log: Log, vehicle: Vehicle, issued: slice, begin_s: Array, edges_s: Array, lag_s: float) -> tuple[list[Signal], float]:
    """The same quantities in time, and the lag that is still behind them: a rotor's is in them."""
    command = log.command[issued].T
    if log.command_kind == "rotors":
        part = np.arange(FINE) / FINE
        fine = np.append((edges_s[:-1, None] + np.diff(edges_s)[:, None] * part).ravel(), edges_s[-1])
        # from long enough before that no lag remembers
        early = begin_s[0] + (edges_s[1] - edges_s[0]) * np.arange(int((fine[0] - begin_s[0]) / (edges_s[1] - edges_s[0])))
        fine = np.concatenate([early, fine])
        both = executed(log, vehicle, issued, begin_s, fine, lag_s)
        return [of_bins(fine, *one) for one in zip(*(each.T for each in both), strict=True)], 0.0
    if log.command_kind == "wrench":
        return [held(begin_s, value) for value in _limited(command.T, vehicle).T], lag_s
    touching_s = TOUCHING * vehicle.cycle.period_s
    lasting = opened(begin_s, command, vehicle, log.supply)
    each = ([pulses(part[i], at_s[i], on_s[i], jet, touching_s) for part, at_s, on_s in lasting] for i, jet in enumerate(vehicle.jets))
    return [joined(parts) for parts in each], lag_s


def jet_integrals(
    start_s: Array, on_s: Array, vehicle: Vehicle, edges_s: Array, lag_s: float, supply: SupplyLevel | None = None
) -> tuple[Array, Array]:
    """Integrals as of :func:`window_integrals`, of the vehicle's jets with on-times (jets, K)."""
    return pulse_integrals(opened(start_s, on_s, vehicle, supply), vehicle.jets, TOUCHING * vehicle.cycle.period_s, edges_s, lag_s)


Opened = tuple[Array, Array, Array]
"""Parts of the thrust, with when each begins and how long it lasts, (jets, K), s."""
LATE = {"begin": 0.0, "centre": 0.5, "end": 1.0}
"""Part of what a pulse leaves of its cycle that is over when it begins."""


def opened(start_s: Array, on_s: Array, vehicle: Vehicle, supply: SupplyLevel | None = None) -> list[Opened]:
    """Parts of the thrust that sum to what jets give, of on-times (jets, K) in cycles from ``start_s`` on: pulses, less their droop.

    For each further jet a pulse loses its droop while both are open, or over its whole length. A failure scales the pulses that begin in
    it, and the supply's pressure in a pulse's middle scales the pulse.
    """
    thrust, strength = vehicle.thrust, strengths(start_s, vehicle)
    # what doesn't open takes nothing from others
    on_s = np.where(strength == 0, 0.0, on_s)
    on_s = np.where(on_s < thrust.dead_on_s, 0.0, np.where(on_s > 0, np.maximum(on_s, thrust.least_on_s), 0.0))
    lasting = [(strength, on_s)]
    for droop, while_open in ((thrust.droop, True), (thrust.cycle_droop, False)):
        lasting += [(-droop * strength, beside_s) for beside_s in beside_others(on_s, while_open)] if droop else []
    late, period_s = LATE[vehicle.cycle.pulse_at], vehicle.cycle.period_s
    start_s = start_s + np.array([jet.delay_s for jet in vehicle.jets])[:, None]
    found = [(part, start_s + late * np.maximum(period_s - lasts_s, 0.0), lasts_s) for part, lasts_s in lasting]
    return found if supply is None else [(part * supply.at(begin_s + lasts_s / 2), begin_s, lasts_s) for part, begin_s, lasts_s in found]


def strengths(start_s: Array, vehicle: Vehicle) -> Array:
    """(jets, K) what of its thrust each gives in pulses that begin then."""
    found = np.ones((len(vehicle.jets), len(start_s)))
    for failure in vehicle.thrust.failures:
        found[[jet.name == failure.jet for jet in vehicle.jets]] *= np.where(failure.of(start_s), failure.thrust, 1.0)
    return found


def check_supply(log: Log, vehicle: Vehicle, source: str) -> None:
    """:class:`InputError` where so many jets fire together that each would lose all its thrust, and more."""
    most, thrust = together(log), vehicle.thrust
    if (thrust.droop + thrust.cycle_droop) * (most - 1) >= 1:
        raise InputError(
            f"{source}: thrust.droop = {thrust.droop:g} and thrust.cycle_droop = {thrust.cycle_droop:g}: in {log.path} {most} jets fire "
            "together, and would give nothing; state what one loses for each further one, as a part of its thrust"
        )


def together(log: Log) -> int:
    """How many jets fire in one cycle at most; 0 of a log without jets."""
    return int((log.command > 0).sum(1).max(initial=0)) if log.command_kind == "jets" else 0


def beside_others(on_s: Array, while_open: bool) -> Iterator[Array]:
    """(jets, K) how long each jet is open beside a second one, then a third, and so on; its whole pulse unless ``while_open``.

    All pulses of a cycle begin at once, so the other jets are ordered by their on-times.
    """
    order = np.argsort(-on_s, axis=0, kind="stable")
    longest, rank = np.take_along_axis(on_s, order, 0), np.argsort(order, axis=0, kind="stable")
    for place in range(int((on_s > 0).sum(0).max(initial=1)) - 1):
        other_s = np.where(rank > place, longest[place], longest[place + 1])
        yield np.minimum(on_s, other_s) if while_open else np.where(other_s > 0, on_s, 0.0)


def pulse_integrals(lasting: Sequence[Opened], jets: Sequence[Jet], touching_s: float, edges_s: Array, lag_s: float) -> tuple[Array, Array]:
    """Integrals as of :func:`window_integrals`, of jets with :func:`pulses`: a sum of parts of the thrust."""
    found = np.zeros((2, len(jets), len(edges_s) - 1))
    if (library := kernel().library) is None:
        for parts in lasting:
            signals = [pulses(*one, touching_s) for one in zip(*parts, jets, strict=True)]
            found += np.swapaxes(window_integrals(signals, edges_s, lag_s), 1, 2)
        return found[0].T, found[1].T
    count, ramps = lasting[0][1].shape[1], np.array([(jet.rise_s, jet.fall_s) for jet in jets])
    room = np.empty(12 * count + (2 * found.shape[2] if lag_s > 0 else 0))
    for parts in lasting:
        pulsed, bins = (np.asarray(each, dtype=float) for each in parts), (found.shape[2], edges_s, np.array([lag_s]), room, *found)
        call(library.mp_host_pulses, len(jets), count, *pulsed, ramps, np.array([touching_s]), *bins)
    return found[0].T, found[1].T


def longest_delay_s(vehicle: Vehicle) -> float:
    """Of any jet, beyond that of all commands."""
    return max((jet.delay_s for jet in vehicle.jets), default=0.0)


def longest_lag_s(vehicle: Vehicle, lag_s: float) -> float:
    """Of any actuator."""
    return max([lag_s, *(lag for rotor in vehicle.rotors for lag in rotor.lags(lag_s))])


def along_one_line(log: Log, vehicle: Vehicle) -> list[tuple[int, ...]]:
    """Channels, two or more each, that push along one line and turn about one axis."""
    wrench = channel_wrench(log, vehicle)
    keys = list(zip(lines_of(wrench[:, 3:]), lines_of(wrench[:, :3]), strict=True))
    groups = (tuple(i for i, own in enumerate(keys) if own == key) for key in dict.fromkeys(keys))
    return [group for group in groups if 1 < len(group) < len(keys)]


def always_together(log: Log) -> list[list[int]]:
    """Command channels that are commanded the same throughout, two or more each."""
    groups: dict[bytes, list[int]] = {}
    for i, column in enumerate(log.command.T):
        if column.any():
            groups.setdefault(column.tobytes(), []).append(i)
    return [group for group in groups.values() if len(group) > 1]


def pushing(force: Array, together: Sequence[Sequence[int]] = ()) -> tuple[int, ...]:
    """The channels, of forces (C, 3), that push, two or more, where others only turn; none where there are no others.

    Those that act ``together`` push as far as their forces don't cancel.
    """
    own = force.copy()
    for group in together:
        own[list(group)] = force[list(group)].sum(0)
    size = np.linalg.norm(own, axis=1)
    found = np.flatnonzero(size > SMALL * size.max(initial=0.0)).tolist()
    return tuple(found) if 1 < len(found) < len(force) else ()


def lines_of(vectors: Array) -> list[int]:
    """A number for each line that vectors (C, 3) lie on, either way round; ``NOWHERE`` for those that are nothing beside the largest."""
    size = np.linalg.norm(vectors, axis=1)
    found: list[int] = []
    units: list[Array] = []
    for vector, length in zip(vectors, size, strict=True):
        if length <= SMALL * size.max(initial=0.0):
            found.append(NOWHERE)
            continue
        unit = vector / length
        same = [k for k, one in enumerate(units) if abs(one @ unit) > ALIKE]
        found.append(same[0] if same else len(units))
        if not same:
            units.append(unit)
    return found
