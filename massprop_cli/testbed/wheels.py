"""Simulated reaction wheels with commanded torque and friction.

A wheel of spin inertia J turns about its axis a at speed W relative to the body, which turns at ω. Only the torque on the wheel changes its
total momentum along the axis, ``h = J (W + a · ω)``. The opposite torque and ``−ω × a h`` act on the body without the wheels' spin inertia.
"""

from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.conditions import TrueActuators
from massprop_cli.testbed.exchanger import Exchanger, Setting, Spin, held, largest
from massprop_cli.testbed.motion import Bodies, CycleMotion


class Wheels(Exchanger):
    """W reaction wheels; commands are torques, N m."""

    TABLE = "wheels"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        vehicle = setting.vehicle
        self.wheels, self.axis = vehicle.wheels, _axes(vehicle)
        self.share = -np.linalg.pinv(self.axis.T * vehicle.environment.moving[:3, None])
        self.inertia = setting.real.wheel_scale * np.array([wheel.spin_inertia_kg_m2 for wheel in self.wheels])
        self.scaled = [wheel.scaled(setting.real.wheel_scale) for wheel in self.wheels]
        self.limit = setting.real.max_wheel_torque_n_m or 0.0
        self.speed = np.zeros((setting.members, setting.cycles * self.records, len(self.wheels)))
        """(S, K N, W) speed relative to the body at the end of each record, rad/s."""
        start = np.array([wheel.start_rad_s or 0.0 for wheel in self.wheels])
        self._momentum = np.repeat((self.inertia * (start + self.axis @ np.array(setting.rate_rad_s)))[None], setting.members, 0)

    @staticmethod
    def full(vehicle: Vehicle, real: TrueActuators) -> Array:
        """(3,) largest torque on the body about each axis by least-norm wheel torques, N m; 0 about an axis that they do not span."""
        return largest(-(_axes(vehicle) * vehicle.environment.moving[:3]).T, real.max_wheel_torque_n_m or 0.0)

    @staticmethod
    def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:
        """Reason why the wheels cannot be simulated; empty if they can."""
        if turned_by and vehicle.wheels and real.max_wheel_torque_n_m is None:
            return "the plan turns by wheels: give actuators.max_wheel_torque_n_m"
        if np.linalg.eigvalsh(truth - _counted(vehicle, real))[0] <= 0:
            return "[truth] has less inertia than the wheels that locked_in_inertia counts into it"
        return ""

    def bare(self, bodies: Bodies) -> Bodies:
        """Bodies without the spin inertia of wheels that their inertia includes."""
        return Bodies(bodies.inertia - _counted(self.setting.vehicle, self.setting.real)[..., None], bodies.cg, bodies.mass)

    def issue(self, cycle: int, torque: Array) -> None:
        """Command wheel torques for a torque (S, 3) on the body, N m, up to the motors' limit."""
        self.issued[:, cycle] = np.clip(torque @ self.share.T, -self.limit, self.limit)

    def spin(self, cycle: int, rate: Array) -> Spin:
        """Stored momentum through one cycle that starts at body rate ``rate`` (3, S)."""
        delay, width = self.setting.delay_cycles, np.diff(self.edges_s)
        torque = held(self.issued, cycle, delay, self.period_s, self.edges_s)
        about = rate.T @ self.axis.T
        edges = np.empty((*torque.shape[:2], len(self.edges_s)))
        edges[..., 0] = self._momentum
        # friction starts with the first command, so that this one acts at the stated start speed
        started = self.edges_s[:-1] > (delay - cycle - 1e-6) * self.period_s
        for b in range(len(width)):
            if started[b]:
                torque[..., b] = self._with_friction(torque[..., b], edges[..., b] / self.inertia - about, float(width[b]))
            edges[..., b + 1] = edges[..., b] + torque[..., b] * width[b]
        self._momentum, self._edges = edges[..., -1], edges
        along = np.stack([torque, (edges[..., :-1] + edges[..., 1:]) / 2])
        both = np.einsum("kswb,wi->kisb", along, self.axis)
        return Spin(both[0], both[1])

    def log(self, cycle: int, motion: CycleMotion) -> None:
        """Store the speeds at the end of each record."""
        bins = len(self.edges_s) - 1
        ends = np.arange(1, self.records + 1) * bins // self.records
        rate = motion.rate + motion.rate_dot * np.diff(self.edges_s) / 2
        rate[..., -1] = motion.rate_end
        speed = self._edges[..., ends] / self.inertia[:, None] - np.einsum("isn,wi->swn", rate[..., ends - 1], self.axis)
        self.speed[:, cycle * self.records : (cycle + 1) * self.records] = np.moveaxis(speed, -1, 1)

    @property
    def turning(self) -> Mapping[str, Array]:
        """Tachometer readings of the speeds, by log column."""
        record_s = self.period_s / self.records
        late = [(wheel.speed_latency_s / record_s, wheel.speed_window_s / record_s) for wheel in self.wheels]
        return {f"wheel_{w.name}_rad_s": _read(self.speed[..., i], *late[i]) for i, w in enumerate(self.wheels)}

    @property
    def columns(self) -> Mapping[str, Array]:
        """Speed or commanded torque of each wheel, by log column; a torque has the initial speed in addition."""
        found = {}
        for i, (wheel, (name, speed)) in enumerate(zip(self.wheels, self.turning.items(), strict=True)):
            if wheel.column == "torque":
                found[f"wheel_{wheel.name}_n_m"], first = np.full((2, *speed.shape), np.nan)
                found[f"wheel_{wheel.name}_n_m"][:, :: self.records] = np.round(self.issued[..., i], 12)
                first[:, 0] = wheel.start_rad_s or 0.0
            found[name] = speed if wheel.column == "speed" else first
        return found

    def _with_friction(self, torque: Array, speed: Array, length_s: float) -> Array:
        """(S, W) torque less mean friction over ``length_s``, from initial speeds (S, W) relative to the body, N m."""
        net = torque.copy()
        for w, wheel in enumerate(self.scaled):
            if wheel.coulomb_friction_n_m > 0 or wheel.viscous_friction_n_m_s > 0:
                members = zip(speed[:, w].tolist(), (torque[:, w] / wheel.spin_inertia_kg_m2).tolist(), strict=True)
                after = np.array([wheel.rubbed(now, by, length_s) for now, by in members])
                net[:, w] = wheel.spin_inertia_kg_m2 * (after - speed[:, w]) / length_s
        return net


def _read(speed: Array, latency: float, window: float) -> Array:
    """(S, n) tachometer readings: means of speeds (S, n) over a window that ended a latency ago, both in records.

    Speeds are linear between records, and constant before the first.
    """
    if latency + window == 0:
        return speed
    before = int(np.ceil(latency + window)) + 1
    extended = np.concatenate([np.repeat(speed[:, :1], before, 1), speed], 1)
    angle = np.cumsum(np.concatenate([np.zeros_like(extended[:, :1]), (extended[:, 1:] + extended[:, :-1]) / 2], 1), 1)
    end = before + np.arange(speed.shape[1]) - latency

    def at(when: Array) -> tuple[Array, Array]:
        k = np.minimum(when.astype(int), extended.shape[1] - 2)
        since, step = when - k, extended[:, k + 1] - extended[:, k]
        return extended[:, k] + since * step, angle[:, k] + since * (extended[:, k] + since * step / 2)

    return at(end)[0] if window == 0 else (at(end)[1] - at(end - window)[1]) / window


def _axes(vehicle: Vehicle) -> Array:
    """(W, 3) unit vectors of the wheel axes, body axes."""
    axes = np.array([wheel.axis for wheel in vehicle.wheels]).reshape(-1, 3)
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def _counted(vehicle: Vehicle, real: TrueActuators) -> Array:
    """(3, 3) spin inertia of the wheels that the body's inertia includes, kg m²."""
    inertia = np.array([real.wheel_scale * wheel.spin_inertia_kg_m2 * wheel.locked_in_inertia for wheel in vehicle.wheels])
    return np.asarray(np.einsum("w,wi,wj->ij", inertia, _axes(vehicle), _axes(vehicle)))
