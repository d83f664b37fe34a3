"""Simulated rotors: each follows its commands with a lag, and its thrust is a polynomial of x.

Between commands a rotor's x is ``u + (x₀ − u) exp(−t / lag)``. Thrust T(x) acts along its axis, drag torque acts against its spin, and a
rotor of spin inertia J stores ``h = J x``. Impulses of the bins are integrated by Gauss–Legendre quadrature.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.actuators.rotor import COMMAND, NODES, SPEED, WEIGHTS
from massprop_cli.inputs.columns import SUPPLY
from massprop_cli.testbed.actuators import Actuators
from massprop_cli.testbed.conditions import curve, thrust
from massprop_cli.testbed.exchanger import Spin
from massprop_cli.testbed.motion import Bodies


class Rotors(Actuators):
    """R rotors of all members; a command is a value of x in ``thrust_n``."""

    def __post_init__(self) -> None:
        """Until the first command acts, each rotor is at the x of that command."""
        super().__post_init__()
        self.rotors, (members, cycles, count) = self.scenario.vehicle.rotors, self.issued.shape
        self.records = self.scenario.sensors.records_per_cycle
        lags = [rotor.lags(self.lag_s) if rotor.column == "command" else (self.lag_s, self.lag_s) for rotor in self.rotors]
        self.up_s, self.down_s = (np.array(each) for each in zip(*lags, strict=True))
        self.inertia = self.scenario.actuators.wheel_scale * np.array([rotor.spin_inertia_kg_m2 or 0.0 for rotor in self.rotors])
        self.turns = np.array([rotor.spin * np.array(rotor.axis) / np.linalg.norm(rotor.axis) for rotor in self.rotors])
        self.speed = np.zeros((members, cycles * self.records, count))
        """(S, K N, R) x at the end of each record."""
        self._x: Array | None = None
        self._spun: dict[int, Spin] = {}

    def issue(self, cycle: int | slice, share: Array) -> None:
        """Issue the commands of a cycle, from fractions (S, …, R) of full thrust, within the rotors' limits."""
        for i, rotor in enumerate(self.rotors):
            x, newtons = curve(rotor, self.scenario.actuators)
            self.issued[:, cycle, i] = np.interp(share[..., i] * newtons[-1], newtons, x)

    def execute(self, first: int, last: int) -> tuple[Array, Array, Array]:
        """Executed wrenches as in :meth:`Actuators.execute`; rotors burn no fuel."""
        cycles = zip(*(self._cycle(k) for k in range(first, last)), strict=True)
        mean, partial_impulse = (np.stack(each, 1).reshape(-1, *each[0].shape[1:]) for each in cycles)
        return self._wrench(mean), self._wrench(partial_impulse), np.zeros((len(self.issued), last - first, len(self.rotors)))

    def _cycle(self, k: int) -> tuple[Array, Array]:
        """(S, R, B) mean thrust of each bin, N, and (S, R, B) mean impulse since the bin's start, N s; stores speeds and momentum."""
        path, edges = self._path(k), self.edges_s
        points = np.unique(np.append(edges, np.clip(path.late_s, edges[0], edges[-1])))
        length, bins = np.diff(points)[:, None], len(NODES) * np.searchsorted(points, edges[:-1])
        at_s, weight = (points[:-1, None] + length * (0.5 + NODES)).ravel(), (length * WEIGHTS).ravel()
        x, width = path.at(at_s), np.diff(edges)
        push = np.stack([thrust(rotor, x[:, i]) for i, rotor in enumerate(self.rotors)], 1) * (self.strength[:, k, :, None] * weight)
        remaining_s = edges[np.searchsorted(edges, at_s)] - at_s
        at_edges = path.at(edges)
        self._x = at_edges[..., -1]
        ends = np.arange(1, self.records + 1) * len(width) // self.records
        self.speed[:, k * self.records : (k + 1) * self.records] = at_edges[..., ends].swapaxes(1, 2)
        if self.inertia.any():
            growth_and_mean = np.diff(at_edges) / width, np.add.reduceat(x * weight, bins, -1) / width
            self._spun[k] = Spin(*(np.einsum("srb,r,ri->isb", each, self.inertia, self.turns) for each in growth_and_mean))
        mean, partial_impulse = (np.add.reduceat(each, bins, -1) / width for each in (push, push * remaining_s))
        return mean, partial_impulse

    def _path(self, k: int) -> _Path:
        """Path of x through cycle k."""
        source = int(np.floor(k - self.scenario.delay_cycles))
        commands = [self._command(max(cycle, 0)) for cycle in (source, source + 1)]
        self._x = commands[0] if self._x is None else self._x
        return _Path(self._x, commands, (self.scenario.delay_cycles + source + 1 - k) * self.period_s, self.up_s, self.down_s)

    def _command(self, cycle: int) -> Array:
        """(S, R) x that the command of a cycle leads to, at the supply voltage at mid-execution."""
        cycle = min(cycle, self.issued.shape[1] - 1)
        volts = self.scenario.supply_v(np.array((cycle + 0.5 + self.scenario.delay_cycles) * self.period_s))
        return np.asarray(
            self.issued[:, cycle] * np.array([1.0 if one.nominal_v is None else volts / one.nominal_v for one in self.rotors])
        )

    def spun(self, first: int) -> tuple[Spin, ...]:
        """Momentum stored in the rotors through an executed cycle; empty without spin inertia."""
        return (self._spun.pop(first),) if self.inertia.any() else ()

    def bare(self, bodies: Bodies) -> Bodies:
        """Bodies with the rotors that the reported inertia excludes."""
        excluded = self.inertia * [not rotor.locked_in_inertia for rotor in self.rotors]
        return Bodies(bodies.inertia + np.einsum("r,ri,rj->ij", excluded, self.turns, self.turns)[..., None], bodies.cg, bodies.mass)

    def columns(self, time_s: Array) -> Mapping[str, Array]:
        """(S, K N) speed or command of each rotor, and the supply voltage if a rotor states a nominal voltage, by log column."""
        found = {}
        for i, rotor in enumerate(self.rotors):
            values = self.speed[..., i]
            if rotor.column == "command":
                values = np.full_like(values, np.nan)
                values[:, :: self.records] = np.round(self.issued[..., i], 12)
            found[(SPEED if rotor.column == "speed" else COMMAND).of(rotor.name)] = values
        if any(rotor.nominal_v for rotor in self.rotors):
            found[SUPPLY] = np.tile(self.scenario.supply_v(time_s - time_s[0] / 2), (len(self.issued), 1))
        return found


class _Path(NamedTuple):
    """Path of x within a cycle, under two successive commands."""

    start: Array
    """(S, R) x at the start of the cycle."""
    commands: list[Array]
    """Two (S, R) commanded values of x."""
    late_s: float
    """Time in the cycle from which the second command acts, s."""
    up_s: Array
    """(R,) lag for rising x, s."""
    down_s: Array
    """(R,) lag for falling x, s."""

    def at(self, time_s: Array) -> Array:
        """(S, R, n) x at times (n,) from the start of the cycle."""
        before = self._towards(self.start, self.commands[0], np.minimum(time_s, self.late_s))
        at_switch = self._towards(self.start, self.commands[0], np.array([self.late_s]))[..., 0]
        return np.where(time_s <= self.late_s, before, self._towards(at_switch, self.commands[1], np.maximum(time_s - self.late_s, 0.0)))

    def _towards(self, x: Array, command: Array, elapsed_s: Array) -> Array:
        """(S, R, n) x after ``elapsed_s`` (n,) of a command, from ``x`` (S, R)."""
        lag_s = np.where(command > x, self.up_s, self.down_s)[..., None]
        decay = np.where(lag_s > 0, np.exp(-elapsed_s / np.where(lag_s > 0, lag_s, 1.0)), elapsed_s <= 0)
        return np.asarray(command[..., None] + (x - command)[..., None] * decay)
