"""Executed wrench of commands in the simulator: delay, on-time ticks, minimum pulse, rise and fall, lag, failures, fuel.

The thrust of a jet is a sum of ramps: each pulse rises linearly from its start, and after its on-time falls from the thrust reached. The
integral and second integral of a ramp are polynomials, so the impulse of every bin is exact for any position of the pulses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import PRESSURE
from massprop_cli.testbed.exchanger import Spin
from massprop_cli.testbed.motion import Bodies
from massprop_cli.testbed.scenario import Scenario

TOUCHING = 1e-3
"""Largest gap, in cycles, at which two pulses count as one."""


@dataclass
class Actuators:
    """C channels (jets, or six components of a wrench) of S members, and their execution of commands."""

    scenario: Scenario
    wrench: Array
    """(C, 6) torque about O [N m] and force [N] of each channel at full command."""
    strength: Array
    """(S, K, C) true thrust of each cycle's pulse over the thrust in the vehicle file."""
    edges_s: Array
    """(B + 1,) bin edges from the start of a cycle, s."""

    def __post_init__(self) -> None:
        members, cycles, channels = self.strength.shape
        self.period_s = self.scenario.vehicle.cycle.period_s
        self.on_jets = bool(self.scenario.vehicle.jets)
        jets = self.scenario.vehicle.jets
        self.rise_s = np.array([jet.rise_s for jet in jets]) if jets else np.zeros(6)
        self.fall_s = np.array([jet.fall_s for jet in jets]) if jets else np.zeros(6)
        real_s = self.scenario.actuators.jet_delays_s
        self.own_delay_s = np.array([real_s.get(jet.name, jet.delay_s) for jet in jets]) if jets else np.zeros(6)
        lag = self.scenario.actuators.lag_s
        self.lag_s = self.scenario.vehicle.thrust.stated_lag_s if lag is None else lag
        thrust, real = self.scenario.vehicle.thrust, self.scenario.actuators
        self.late = {"begin": 0.0, "centre": 0.5, "end": 1.0}[real.pulse_at or self.scenario.vehicle.cycle.pulse_at]
        self.droop = thrust.droop if real.droop is None else real.droop
        self.cycle_droop = thrust.cycle_droop if real.cycle_droop is None else real.cycle_droop
        self.issued = np.zeros((members, cycles, channels))
        """(S, K, C) commanded on-times, s, or wrench components, N m and N."""
        self._lagged = np.zeros((members, channels))

    def issue(self, cycle: int | slice, share: Array) -> None:
        """Issue commands of one cycle (S, C) or M cycles (S, M, C), as fractions of full; round to ticks and drop too short pulses."""
        if not self.on_jets:
            limits = self.scenario.actuators
            self.issued[:, cycle] = share * np.concatenate([limits.max_torque_n_m or (0.0,) * 3, limits.max_force_n or (0.0,) * 3])
            return
        on = np.clip(share, 0.0, 1.0) * self.period_s
        tick = self.scenario.tick_s
        if tick is not None:
            on = np.minimum(np.round(on / tick) * tick, self.period_s)
        self.issued[:, cycle] = np.where(on < self.scenario.actuators.minimum_pulse_s - 1e-12, 0.0, on)

    def spun(self, first: int) -> tuple[Spin, ...]:  # noqa: ARG002
        """Momentum stored in the actuators through an executed cycle: none."""
        return ()

    def bare(self, bodies: Bodies) -> Bodies:
        """Bodies with the parts of the actuators that the reported inertia excludes: none."""
        return bodies

    def columns(self, time_s: Array) -> Mapping[str, Array]:
        """(S, K N) log columns in addition to the commands: the supply pressure of the jets, if stated."""
        supply_pa = self.scenario.supply_pa(time_s - time_s[0] / 2)
        return {} if supply_pa is None else {PRESSURE: np.tile(supply_pa, (len(self.issued), 1))}

    def execute(self, first: int, last: int) -> tuple[Array, Array, Array]:
        """Executed wrench during the M cycles from ``first`` to before ``last``.

        Returns (6, S, M, B) mean wrench of each bin; (6, S, M, B) mean over each bin of the impulse since the bin's start; (S, M, C)
        impulse of each channel over its full thrust, s.
        """
        members, _, channels = self.issued.shape
        shape = (members * (last - first), channels, len(self.edges_s))
        thrust = _Thrust(np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape[:2]))
        delay = self.scenario.delay_cycles
        longest_s = float(self.own_delay_s.max())
        for later in range(int(np.floor(-delay - longest_s / self.period_s - 2)), min(int(np.floor(-delay)) + 2, 1)):
            start_s = (later + delay) * self.period_s
            if -self.period_s - self.fall_s.max() - longest_s < start_s < self.period_s:
                self._add_pulses(first + later, last + later, start_s, thrust)
        if self.lag_s > 0:
            self._lag(thrust)
        width = np.diff(self.edges_s)
        partial_impulse = (np.diff(thrust.second, axis=-1) - width * thrust.first[..., :-1]) / width
        mean = np.diff(thrust.first, axis=-1) / width
        return self._wrench(mean), self._wrench(partial_impulse), thrust.first[..., -1].reshape(members, -1, channels)

    def _wrench(self, channels: Array) -> Array:
        total: Array = np.einsum("scb,cw->wsb", channels, self.wrench)
        return total.reshape(6, len(self.issued), -1, channels.shape[-1])

    def _add_pulses(self, first: int, last: int, start_s: float, thrust: _Thrust) -> None:
        """Add the pulses issued by M cycles, which start ``start_s`` after the start of the executing cycles, less their droop."""
        strengths = [_cycles(self.strength, first + k, last + k) for k in (-1, 0, 1)]
        open_s = [self._open(_cycles(self.issued, first + k, last + k)) for k in (-1, 0, 1)]
        # a failed jet does not open, so that its next pulse rises as any other
        around = [np.where(strength == 0, 0.0, on) for on, strength in zip(open_s, strengths, strict=True)]
        strength = strengths[1]
        at_s = np.tile(self.period_s * (np.arange(first, last) + self.scenario.delay_cycles), len(self.strength))[:, None]
        middle_s = at_s + self.own_delay_s + self.late * (self.period_s - around[1]) + around[1] / 2
        supply_pa, nominal_pa = self.scenario.supply_pa(middle_s), self.scenario.vehicle.thrust.nominal_pa
        if supply_pa is not None and nominal_pa is not None:
            strength = strength * supply_pa / nominal_pa
        self._add(around, strength, start_s, thrust)
        together = int((around[1] > 0).sum(1).max(initial=0))
        if self.on_jets and (self.droop + self.cycle_droop) * (together - 1) >= 1:
            raise InputError(f"scenario {self.scenario.name}: {together} jets fire together, and by their droop give nothing; state less")
        for droop, while_open in ((self.droop, True), (self.cycle_droop, False)):
            for other in range(strength.shape[1]) if droop and self.on_jets else ():
                others = [command[:, other, None] for command in around]
                overlap = [np.minimum(a, b) if while_open else np.where(b > 0, a, 0.0) for a, b in zip(around, others, strict=True)]
                for command in overlap:
                    command[:, other] = 0.0
                self._add(overlap, -droop * strength, start_s, thrust)

    def _add(self, around: Sequence[Array], strengths: Array, start_s: float, thrust: _Thrust) -> None:
        """Add pulses; ``around``: on-times (S M, C) of the previous, the pulse's own and the following cycle, s."""
        previous, command, following = around
        member, channel = np.nonzero(command)
        if not len(member):
            return
        strength = strengths[member, channel]
        if self.on_jets:
            on = command[member, channel]
            full = self.period_s * (1 - TOUCHING)
            before, after = previous[member, channel], following[member, channel]
            joined, joins = self._touch(before, on, full), self._touch(on, after, full)
        else:
            strength = strength * command[member, channel]
            on = np.full(len(member), self.period_s)
            joined = joins = np.ones(len(member), dtype=bool)
        rise = np.where(joined, 0.0, np.minimum(self.rise_s[channel], on))
        reached = np.where(joined | (self.rise_s[channel] == 0), 1.0, rise / np.where(self.rise_s[channel] > 0, self.rise_s[channel], 1.0))
        fall = np.where(joins, 0.0, reached * self.fall_s[channel])
        late = self.late * (self.period_s - on)
        start = start_s + self.own_delay_s[channel]
        begin, end = start + late, start + np.where(joins, self.period_s, late + on)
        height = strength * reached
        ramps = Ramp(np.concatenate([begin, end]), np.concatenate([begin + rise, end + fall]), np.concatenate([height, -height]))
        first, second = (_both(integral) for integral in ramps.integrals(self.edges_s))
        thrust.first[member, channel] += first
        thrust.second[member, channel] += second
        if self.lag_s > 0:
            thrust.initial[member, channel] += _both(ramps.value_at_zero())
            thrust.lagged[member, channel] += _both(ramps.lagged(self.edges_s, self.lag_s))

    def _open(self, on: Array) -> Array:
        """Valve open times for commanded on-times: none below the dead time, at least the shortest open time, s."""
        thrust = self.scenario.vehicle.thrust
        longer = np.clip(on, np.where(on > 0, thrust.least_on_s, 0.0), None)
        return np.asarray(np.where(on < thrust.dead_on_s, 0.0, longer)) if self.on_jets else on

    def _touch(self, first: Array, second: Array, full: float) -> Array:
        """Whether a pulse ends where the pulse of the next cycle begins."""
        ends, begins = self.late == 1 or first >= full, self.late == 0 or second >= full
        return np.asarray((first > 0) & (second > 0) & ends & begins)

    def _lag(self, thrust: _Thrust) -> None:
        """Replace the integrals of thrust u by those of y, ``lag y' + y = u``: ``∫y = ∫u − lag (y − y₀)``, and its integral."""
        decay = np.exp(-self.edges_s / self.lag_s)
        answers = thrust.initial[..., None] * (1 - decay) + thrust.lagged
        parts = (part.reshape(len(self.issued), -1, *part.shape[1:]) for part in (answers, thrust.first, thrust.second))
        for answer, first, second in zip(*(part.swapaxes(0, 1) for part in parts), strict=True):  # cycle by cycle
            y0 = self._lagged[..., None]
            y = y0 * decay + answer
            first -= self.lag_s * (y - y0)
            second -= self.lag_s * (first - y0 * self.edges_s)
            self._lagged = y[..., -1]


def _cycles(values: Array, first: int, last: int) -> Array:
    """(S M, C) values of the M cycles from ``first`` to before ``last`` of (S, K, C), 0 outside the log."""
    before, after = min(max(-first, 0), last - first), min(max(last - values.shape[1], 0), last - first)
    chosen = values[:, first + before : last - after]
    if before or after:
        chosen = np.pad(chosen, ((0, 0), (before, after), (0, 0)))
    return chosen.reshape(-1, values.shape[2])


def _both(ramps: Array) -> Array:
    """(n, …) sum of rise and fall of each of n pulses, from (2 n, …) with all rises first."""
    pulses = len(ramps) // 2
    return ramps[:pulses] + ramps[pulses:]


@dataclass
class _Thrust:
    """Thrust over full thrust of each channel in each of M cycles, at the bin edges."""

    first: Array
    """(S M, C, B + 1) integral from the start of the cycle, s."""
    second: Array
    """(S M, C, B + 1) second integral, s²."""
    lagged: Array
    """(S M, C, B + 1) response of the first-order lag to changes within the cycle."""
    initial: Array
    """(S M, C) value at the start of the cycle."""


@dataclass(frozen=True)
class Ramp:
    """n linear changes of thrust; a step if start and end are equal."""

    start: Array
    """(n,) s"""
    end: Array
    """(n,) s"""
    height: Array
    """(n,) change of thrust over full thrust."""

    def integrals(self, time: Array) -> tuple[Array, Array]:
        """First and second integral from 0 to ``time`` (≥ 0), both (n, len(time))."""
        width, times = (self.end - self.start)[:, None], np.concatenate([[0.0], time])
        x = np.minimum(np.maximum(times - self.start[:, None], 0.0), width)
        after = np.maximum(times - self.end[:, None], 0.0)
        part = x * (x / np.where(width > 0, width, 1.0)) / 2
        # integrals from before the ramp
        value, area = self.height[:, None] * (part + after), self.height[:, None] * (x * part / 3 + after * width / 2 + after * after / 2)
        at_zero, value = value[:, :1], value[:, 1:]
        return value - at_zero, area[:, 1:] - area[:, :1] - at_zero * time

    def value_at_zero(self) -> Array:
        """(n,) contribution of the ramp at time 0."""
        width = self.end - self.start
        inside = np.clip(-self.start / np.where(width > 0, width, 1.0), 0.0, 1.0)
        return self.height * np.where(width > 0, inside, self.start <= 0)

    def lagged(self, time: Array, lag_s: float) -> Array:
        """(n, len(time)) response y of ``lag y' + y = u`` to the part of the ramp after time 0."""
        start = np.maximum(self.start, 0.0)
        rest, width = self.height - self.value_at_zero(), np.maximum(self.end - start, 0.0)
        since, after = np.maximum(time - start[:, None], 0.0), np.maximum(time - self.end[:, None], 0.0)
        settled, settled_after = -np.expm1(-since / lag_s), -np.expm1(-after / lag_s)
        linear = (since - lag_s * settled - after + lag_s * settled_after) / np.where(width > 0, width, 1.0)[:, None]
        return rest[:, None] * np.where(width[:, None] > 0, linear, settled)
