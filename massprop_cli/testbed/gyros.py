"""Control moment gyros as they really are: rotors at a speed that a motor holds, in gimbals that turn at the rate they are told.

Each rotor holds ``h s`` relative to the body, s turned about the gimbal's axis g by its angle δ. The body with the rotors in it feels
``−d(h s)/dt`` and ``−ω × h s``. Steering: a torque τ on the body is asked for by gimbal rates ``δ̇ = −Aᵀ (A Aᵀ + λ 1)⁻¹ τ``, where the
columns of A are ``h g × s`` and λ keeps the rates finite near singular directions (Nakamura and Hanafusa, 1986).
"""

from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.conditions import TrueActuators
from massprop_cli.testbed.exchanger import Exchanger, Setting, Spin, held, largest
from massprop_cli.testbed.motion import Bodies, CycleMotion

DAMPED = 1e-3
"""λ over the mean square of A: so much of the torque is lost where nothing is singular."""


class Gyros(Exchanger):
    """The G gyros; they are commanded gimbal rates, rad/s."""

    TABLE = "control_moment_gyros"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self.gyros, self.limit = setting.vehicle.control_moment_gyros, setting.real.max_gimbal_rate_rad_s or 0.0
        self.along, self.across = _axes(setting.vehicle)
        self.start_h = setting.real.wheel_scale * _momenta(setting.vehicle)
        shape = (setting.members, setting.cycles * self.records, len(self.gyros))
        self.angle, self.faded = np.zeros(shape), np.zeros(shape[1])
        """(S, K N, G) after each record, rad; and (K N,) what is left of the rotors' speeds."""
        start = np.array([gyro.start_gimbal_rad or 0.0 for gyro in self.gyros])
        self._angle = np.repeat(start[None], setting.members, 0)

    @staticmethod
    def full(vehicle: Vehicle, real: TrueActuators) -> Array:
        """(3,) at the gimbals' first angles."""
        start = np.array([gyro.start_gimbal_rad or 0.0 for gyro in vehicle.control_moment_gyros])
        along, across = _axes(vehicle)
        gained = (_momenta(vehicle) * (across.T * np.cos(start) - along.T * np.sin(start))) * vehicle.environment.moving[:3, None]
        return largest(gained, real.max_gimbal_rate_rad_s or 0.0)

    @staticmethod
    def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:  # noqa: ARG004
        """Why they can't be flown."""
        gyros = vehicle.control_moment_gyros
        if turned_by and gyros and not vehicle.wheels and real.max_gimbal_rate_rad_s is None:
            return "the plan turns by control moment gyros: give actuators.max_gimbal_rate_rad_s"
        unsaid = next((gyro.name for gyro in gyros if gyro.h_n_m_s is None and not gyro.start_rad_s), None)
        return "" if unsaid is None else f"control moment gyro {unsaid!r}: give start_rad_s, how fast its rotor turns, or h_n_m_s"

    def bare(self, bodies: Bodies) -> Bodies:
        """The bodies with the rotors that are not counted in them."""
        left_out = np.array([0.0 if gyro.locked_in_inertia else gyro.spin_inertia_kg_m2 or 0.0 for gyro in self.gyros])
        added = np.einsum("g,gi,gj->ij", self.setting.real.wheel_scale * left_out, self.along, self.along)
        return Bodies(bodies.inertia + added[..., None], bodies.cg, bodies.mass)

    def issue(self, cycle: int, torque: Array) -> None:
        """Torque on the body (S, 3), N m, as far as the gimbals can."""
        gained = self.start_h * self._turned(self._angle + np.pi / 2)  # (3, S, G)
        gained = np.moveaxis(gained, 0, 1) * self.setting.vehicle.environment.moving[:3, None]
        squares = gained @ np.swapaxes(gained, 1, 2)
        damped = DAMPED * np.trace(squares, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        rates = -np.einsum("sig,si->sg", gained, np.linalg.solve(squares + damped, torque[..., None])[..., 0])
        self.issued[:, cycle] = np.clip(rates, -self.limit, self.limit)

    def spin(self, cycle: int, rate: Array) -> Spin:  # noqa: ARG002
        """Through one cycle."""
        width = np.diff(self.edges_s)
        turn = held(self.issued, cycle, self.setting.delay_cycles, self.period_s, self.edges_s) * width
        edges = np.concatenate([self._angle[..., None], self._angle[..., None] + np.cumsum(turn, -1)], -1)  # (S, G, B + 1)
        self._angle, self._edges = edges[..., -1], edges
        left = self.start_h[:, None] * self._left(cycle)  # (G, B + 1)
        grown = np.diff((left * self._turned(edges.swapaxes(1, 2)).swapaxes(2, 3)), axis=-1).sum(2) / width
        # the mean of a vector that turns evenly is the one in the middle, shorter by a sine over its arc
        middle = self._turned((edges[..., 1:] - turn / 2).swapaxes(1, 2)).swapaxes(2, 3) * np.sinc(turn / (2 * np.pi))
        return Spin(grown, ((left[:, 1:] + left[:, :-1]) / 2 * middle).sum(2))

    def log(self, cycle: int, motion: CycleMotion) -> None:  # noqa: ARG002
        """Read angles and speeds at the end of each record."""
        ends = np.arange(1, self.records + 1) * (len(self.edges_s) - 1) // self.records
        rows = slice(cycle * self.records, (cycle + 1) * self.records)
        self.angle[:, rows], self.faded[rows] = self._edges[..., ends].swapaxes(1, 2), self._left(cycle)[ends]

    @property
    def turning(self) -> Mapping[str, Array]:
        """Angles of the gimbals, and speeds of rotors that have one."""
        found = {}
        for i, gyro in enumerate(self.gyros):
            found[f"cmg_{gyro.name}_gimbal_rad"] = self.angle[..., i]
            if gyro.h_n_m_s is None:
                found[f"cmg_{gyro.name}_rad_s"] = np.repeat((gyro.start_rad_s or 0.0) * self.faded[None], len(self.angle), 0)
        return found

    def _turned(self, angle: Array) -> Array:
        """(3, S, …, G) the spin axes at gimbal angles (S, …, G)."""
        return np.cos(angle) * self._beside(self.along, angle) + np.sin(angle) * self._beside(self.across, angle)

    @staticmethod
    def _beside(axes: Array, angle: Array) -> Array:
        return axes.T.reshape(3, *(1,) * (angle.ndim - 1), -1)

    def _left(self, cycle: int) -> Array:
        """(B + 1,) part of the rotors' first speeds that is left at the bins' edges."""
        lasting = self.setting.real.gyro_run_down_s
        time_s = cycle * self.period_s + self.edges_s
        return np.ones_like(time_s) if lasting is None else np.exp(-time_s / lasting)


def _axes(vehicle: Vehicle) -> tuple[Array, Array]:
    """(G, 3) each, the spin axes at gimbal angles of 0 and 90 degrees."""
    gimbal, spin = (np.array([getattr(gyro, key) for gyro in vehicle.control_moment_gyros]) for key in ("gimbal_axis", "spin_axis"))
    gimbal, spin = (axes / np.linalg.norm(axes, axis=1, keepdims=True) for axes in (gimbal, spin))
    return spin, np.cross(gimbal, spin)


def _momenta(vehicle: Vehicle) -> Array:
    """(G,) N m s."""
    gyros = vehicle.control_moment_gyros
    return np.array([gyro.h_n_m_s or (gyro.spin_inertia_kg_m2 or 0.0) * (gyro.start_rad_s or 0.0) for gyro in gyros])
