"""Reaction wheels as they really are: torque by command, friction, speed; each wheel's momentum is followed in full.

A wheel of spin inertia J turns about its axis a at W relative to the body, which turns at ω. Its whole momentum along the axis,
``h = J (W + a · ω)``, changes by the torque on it alone. The body without the wheels' spin inertia feels the opposite, and ``−ω × a h``.
"""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.testbed.motion import Bodies, CycleMotion
from massprop_cli.testbed.scenario import Scenario


@dataclass(frozen=True)
class Spin:
    """What the wheels do within a cycle, body axes, bin by bin."""

    torque: Array
    """(3, S, B) on all wheels, N m."""
    momentum: Array
    """(3, S, B) mean over each bin, N m s."""


class Wheels:
    """The W wheels of S members through K cycles of N records."""

    def __init__(self, scenario: Scenario, members: int, edges_s: Array, issued: Array | None) -> None:
        """``issued`` (K, W) or (S, K, W) are recorded torques, N m."""
        vehicle, count = scenario.vehicle, len(scenario.vehicle.wheels)
        self.wheels, self.delay, self.edges_s = vehicle.wheels, scenario.delay_cycles, edges_s
        self.period_s, self.records = vehicle.cycle.period_s, scenario.sensors.records_per_cycle
        self.axis = np.array([wheel.direction for wheel in self.wheels]).reshape(-1, 3)
        self.inertia = scenario.actuators.wheel_scale * np.array([wheel.spin_inertia_kg_m2 for wheel in self.wheels])
        self.limit = scenario.actuators.max_wheel_torque_n_m or 0.0
        self.issued = np.zeros((members, scenario.cycles, count))
        if issued is not None:
            self.issued[:] = issued
        self.speed = np.zeros((members, scenario.cycles * self.records, count))
        """(S, K N, W) relative to the body, after each record, rad/s."""
        start = np.array([wheel.start_rad_s or 0.0 for wheel in self.wheels])
        self._held = np.repeat((self.inertia * (start + self.axis @ np.array(scenario.initial.rate_rad_s)))[None], members, 0)
        self._in_body = [wheel.locked_in_inertia for wheel in self.wheels]

    def bare(self, bodies: Bodies) -> Bodies:
        """The bodies without the wheels' spin inertia, wherever it was counted."""
        spinning = np.einsum("w,wi,wj->ij", self.inertia * self._in_body, self.axis, self.axis)
        return Bodies(bodies.inertia - spinning[..., None], bodies.cg, bodies.mass)

    def issue(self, cycle: int, torque: Array) -> None:
        """Take (S, W) commands, N m, as far as the motors can."""
        self.issued[:, cycle] = np.clip(torque, -self.limit, self.limit)

    def spin(self, cycle: int, rate: Array) -> Spin:
        """Through one cycle that begins at the body's ``rate`` (3, S)."""
        torque, width = self._commanded(cycle), np.diff(self.edges_s)
        about = rate.T @ self.axis.T
        edges = np.empty((*torque.shape[:2], len(self.edges_s)))
        edges[..., 0] = self._held
        # a wheel's start speed is the one at which its first command finds it
        started = self.edges_s[:-1] > (self.delay - cycle - 1e-6) * self.period_s
        for b in range(len(width) if self.wheels else 0):
            torque[..., b] -= self._friction(edges[..., b] / self.inertia - about) * started[b]
            edges[..., b + 1] = edges[..., b] + torque[..., b] * width[b]
        self._held, self._edges = edges[..., -1], edges
        along = np.stack([torque, (edges[..., :-1] + edges[..., 1:]) / 2])
        both = np.einsum("kswb,wi->kisb", along, self.axis)
        return Spin(both[0], both[1])

    def log(self, cycle: int, motion: CycleMotion) -> None:
        """Read the speeds at the end of each record."""
        bins = len(self.edges_s) - 1
        ends = np.arange(1, self.records + 1) * bins // self.records
        rate = motion.rate + motion.rate_dot * np.diff(self.edges_s) / 2
        rate[..., -1] = motion.rate_end
        speed = self._edges[..., ends] / self.inertia[:, None] - np.einsum("isn,wi->swn", rate[..., ends - 1], self.axis)
        self.speed[:, cycle * self.records : (cycle + 1) * self.records] = np.moveaxis(speed, -1, 1)

    def _commanded(self, cycle: int) -> Array:
        """(S, W, B) mean torque of each bin: each cycle's command is held for a cycle, from its delay on."""
        source = int(np.floor(cycle - self.delay))
        late = (self.delay + source - cycle + 1) * self.period_s  # from when on the next one acts
        later = np.clip((self.edges_s[1:] - late) / np.diff(self.edges_s), 0.0, 1.0)
        held = range(self.issued.shape[1])
        first, second = (self.issued[:, k] if k in held else np.zeros_like(self.issued[:, 0]) for k in (source, source + 1))
        return np.asarray(first[..., None] * (1 - later) + second[..., None] * later)

    def _friction(self, speed: Array) -> Array:
        """(S, W) torque against speeds."""
        coulomb = np.array([wheel.coulomb_friction_n_m for wheel in self.wheels])
        viscous = np.array([wheel.viscous_friction_n_m_s for wheel in self.wheels])
        return np.asarray(coulomb * np.sign(speed) + viscous * speed)
