"""Simulated control moment gyros: rotors at constant or decaying speed in gimbals that turn at commanded rates.

Each rotor has the momentum ``h s`` relative to the body, s the spin axis turned about the gimbal axis g by the angle δ. The torque on the
body with its rotors is ``−d(h s)/dt − ω × h s``. For a demanded torque τ on the body the gimbal rates are ``δ̇ = −Aᵀ (A Aᵀ + λ 1)⁻¹ τ``.
The columns of A are ``h g × s``; λ keeps the rates finite near singular directions (Nakamura and Hanafusa, 1986).
"""

from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.conditions import TrueActuators
from massprop_cli.testbed.exchanger import Exchanger, Setting, Spin, held, largest
from massprop_cli.testbed.motion import Bodies, CycleMotion

DAMPED = 1e-3
"""λ over the mean square of A; about the fraction of torque lost away from singular directions."""


class Gyros(Exchanger):
    """G control moment gyros; commands are gimbal rates, rad/s."""

    TABLE = "control_moment_gyros"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.gyros, self.limit = setting.vehicle.control_moment_gyros, setting.real.max_gimbal_rate_rad_s or 0.0
        self.along, self.across = _axes(setting.vehicle)
        self.start_h = setting.real.wheel_scale * _momenta(setting.vehicle)
        shape = (setting.members, setting.cycles * self.records, len(self.gyros))
        self.angle, self.speed_fraction = np.zeros(shape), np.zeros(shape[1])
        """(S, K N, G) gimbal angle at the end of each record, rad; (K N,) rotor speed over its initial value."""
        start = np.array([gyro.start_gimbal_rad or 0.0 for gyro in self.gyros])
        self._angle = np.repeat(start[None], setting.members, 0)

    @staticmethod
    def full(vehicle: Vehicle, real: TrueActuators) -> Array:
        """(3,) largest torque on the body about each axis at the initial gimbal angles, N m."""
        start = np.array([gyro.start_gimbal_rad or 0.0 for gyro in vehicle.control_moment_gyros])
        along, across = _axes(vehicle)
        per_rate = (_momenta(vehicle) * (across.T * np.cos(start) - along.T * np.sin(start))) * vehicle.environment.moving[:3, None]
        return largest(per_rate, real.max_gimbal_rate_rad_s or 0.0)

    @staticmethod
    def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:  # noqa: ARG004
        """Reason why the gyros cannot be simulated; empty if they can."""
        gyros = vehicle.control_moment_gyros
        if turned_by and gyros and not vehicle.wheels and real.max_gimbal_rate_rad_s is None:
            return "the plan turns by control moment gyros: give actuators.max_gimbal_rate_rad_s"
        unknown = next((gyro.name for gyro in gyros if gyro.h_n_m_s is None and not gyro.start_rad_s), None)
        return "" if unknown is None else f"control moment gyro {unknown!r}: give start_rad_s, how fast its rotor turns, or h_n_m_s"

    def bare(self, bodies: Bodies) -> Bodies:
        """Bodies with the rotors that their reported inertia excludes."""
        excluded = np.array([0.0 if gyro.locked_in_inertia else gyro.spin_inertia_kg_m2 or 0.0 for gyro in self.gyros])
        added = np.einsum("g,gi,gj->ij", self.setting.real.wheel_scale * excluded, self.along, self.along)
        return Bodies(bodies.inertia + added[..., None], bodies.cg, bodies.mass)

    def issue(self, cycle: int, torque: Array) -> None:
        """Command gimbal rates for a torque (S, 3) on the body, N m, up to the rate limit."""
        A = self.start_h * self._spin_axes(self._angle + np.pi / 2)  # (3, S, G)
        A = np.moveaxis(A, 0, 1) * self.setting.vehicle.environment.moving[:3, None]
        squares = A @ np.swapaxes(A, 1, 2)
        damping = DAMPED * np.trace(squares, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        rates = -np.einsum("sig,si->sg", A, np.linalg.solve(squares + damping, torque[..., None])[..., 0])
        self.issued[:, cycle] = np.clip(rates, -self.limit, self.limit)

    def spin(self, cycle: int, rate: Array) -> Spin:  # noqa: ARG002
        """Stored momentum through one cycle."""
        width = np.diff(self.edges_s)
        turn = held(self.issued, cycle, self.setting.delay_cycles, self.period_s, self.edges_s) * width
        edges = np.concatenate([self._angle[..., None], self._angle[..., None] + np.cumsum(turn, -1)], -1)  # (S, G, B + 1)
        self._angle, self._edges = edges[..., -1], edges
        h = self.start_h[:, None] * self._speed_fraction(cycle)  # (G, B + 1)
        torque = np.diff((h * self._spin_axes(edges.swapaxes(1, 2)).swapaxes(2, 3)), axis=-1).sum(2) / width
        # the mean of a vector that rotates uniformly is its middle value times sin(θ/2) / (θ/2)
        middle = self._spin_axes((edges[..., 1:] - turn / 2).swapaxes(1, 2)).swapaxes(2, 3) * np.sinc(turn / (2 * np.pi))
        return Spin(torque, ((h[:, 1:] + h[:, :-1]) / 2 * middle).sum(2))

    def log(self, cycle: int, motion: CycleMotion) -> None:  # noqa: ARG002
        """Store angles and speeds at the end of each record."""
        ends = np.arange(1, self.records + 1) * (len(self.edges_s) - 1) // self.records
        rows = slice(cycle * self.records, (cycle + 1) * self.records)
        self.angle[:, rows] = self._edges[..., ends].swapaxes(1, 2)
        self.speed_fraction[rows] = self._speed_fraction(cycle)[ends]

    @property
    def turning(self) -> Mapping[str, Array]:
        """Gimbal angles, and rotor speeds of gyros without a stated momentum, by log column."""
        columns = {}
        for i, gyro in enumerate(self.gyros):
            columns[f"cmg_{gyro.name}_gimbal_rad"] = self.angle[..., i]
            if gyro.h_n_m_s is None:
                columns[f"cmg_{gyro.name}_rad_s"] = np.repeat((gyro.start_rad_s or 0.0) * self.speed_fraction[None], len(self.angle), 0)
        return columns

    def _spin_axes(self, angle: Array) -> Array:
        """(3, S, …, G) spin axes at gimbal angles (S, …, G), body axes."""
        along, across = (axes.T.reshape(3, *(1,) * (angle.ndim - 1), -1) for axes in (self.along, self.across))
        return np.cos(angle) * along + np.sin(angle) * across

    def _speed_fraction(self, cycle: int) -> Array:
        """(B + 1,) rotor speed over its initial value at the bin edges."""
        decay_s = self.setting.real.gyro_run_down_s
        time_s = cycle * self.period_s + self.edges_s
        return np.ones_like(time_s) if decay_s is None else np.exp(-time_s / decay_s)


def _axes(vehicle: Vehicle) -> tuple[Array, Array]:
    """(G, 3) spin axes at gimbal angles of 0 and 90 degrees, each."""
    gimbal, spin = (np.array([getattr(gyro, key) for gyro in vehicle.control_moment_gyros]) for key in ("gimbal_axis", "spin_axis"))
    gimbal, spin = (axes / np.linalg.norm(axes, axis=1, keepdims=True) for axes in (gimbal, spin))
    return spin, np.cross(gimbal, spin)


def _momenta(vehicle: Vehicle) -> Array:
    """(G,) initial rotor momentum, N m s."""
    gyros = vehicle.control_moment_gyros
    return np.array([gyro.h_n_m_s or (gyro.spin_inertia_kg_m2 or 0.0) * (gyro.start_rad_s or 0.0) for gyro in gyros])
