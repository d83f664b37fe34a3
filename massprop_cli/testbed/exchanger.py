"""Interface of simulated momentum devices: all devices of one kind, whose momentum is integrated cycle by cycle."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.section import Vector
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.conditions import TrueActuators
from massprop_cli.testbed.motion import Bodies, CycleMotion

SERVED = 3e-5
"""Largest error of a unit torque about an axis that the devices count as able to give, N m."""


class Setting(NamedTuple):
    """Vehicle and dimensions of a simulation: S members, K cycles of N records, B bins in each cycle."""

    vehicle: Vehicle
    real: TrueActuators
    members: int
    """S"""
    cycles: int
    """K"""
    records: int
    """N"""
    delay_cycles: float
    """Delay from the start of the cycle that issues a command to the start of its execution, cycles."""
    rate_rad_s: Vector
    """Initial body rate, rad/s."""
    edges_s: Array
    """(B + 1,) bin edges from the start of a cycle, s."""


@dataclass(frozen=True)
class Spin:
    """Momentum stored in devices within a cycle, body axes."""

    torque: Array
    """(3, S, B) rate of change of the momentum in body axes, N m."""
    momentum: Array
    """(3, S, B) mean momentum of each bin, N m s."""


class Exchanger(ABC):
    """All momentum devices of one kind: S members, K cycles of N records."""

    TABLE: ClassVar[str]
    """Table of the vehicle file."""

    def __init__(self, setting: Setting) -> None:
        self.setting, self.edges_s = setting, setting.edges_s
        self.period_s, self.records = setting.vehicle.cycle.period_s, setting.records
        self.issued: Array = np.zeros((setting.members, setting.cycles, self.channels(setting.vehicle)))
        """(S, K, C) commands of each cycle."""

    @classmethod
    def channels(cls, vehicle: Vehicle) -> int:
        """C, number of commands in each cycle."""
        return len(getattr(vehicle, cls.TABLE))

    @staticmethod
    @abstractmethod
    def full(vehicle: Vehicle, real: TrueActuators) -> Array:
        """(3,) largest torque on the body about each axis, N m; 0 about an axis that cannot be driven without the others."""

    @staticmethod
    @abstractmethod
    def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:
        """Reason why a vehicle with true inertia ``truth`` (3, 3) cannot be simulated; empty if it can.

        ``turned_by``: whether the plan turns the vehicle by these devices.
        """

    @abstractmethod
    def bare(self, bodies: Bodies) -> Bodies:
        """Bodies without the inertia that the momentum of :meth:`spin` accounts for."""

    @abstractmethod
    def issue(self, cycle: int, torque: Array) -> None:
        """Command a torque (S, 3) on the body within the devices' limits, N m."""

    @abstractmethod
    def spin(self, cycle: int, rate: Array) -> Spin:
        """Stored momentum through one cycle that starts at body rate ``rate`` (3, S)."""

    @abstractmethod
    def log(self, cycle: int, motion: CycleMotion) -> None:
        """Store the state of the devices at the end of each record of a cycle."""

    @property
    @abstractmethod
    def turning(self) -> Mapping[str, Array]:
        """(S, K N) state of each device at the end of each record, by log column."""

    @property
    def columns(self) -> Mapping[str, Array]:
        """(S, K N) columns of the devices in the log; NaN in empty cells."""
        return self.turning


def held(issued: Array, cycle: int, delay_cycles: float, period_s: float, edges_s: Array) -> Array:
    """(S, C, B) mean command of each bin; each of the commands ``issued`` (S, K, C) is held for one cycle from its delay on."""
    source = int(np.floor(cycle - delay_cycles))
    switch_s = (delay_cycles + source - cycle + 1) * period_s  # start of the next command
    fraction = np.clip((edges_s[1:] - switch_s) / np.diff(edges_s), 0.0, 1.0)
    cycles = range(issued.shape[1])
    first, second = (issued[:, k] if k in cycles else np.zeros_like(issued[:, 0]) for k in (source, source + 1))
    return np.asarray(first[..., None] * (1 - fraction) + second[..., None] * fraction)


def largest(torque_per_command: Array, limit: float) -> Array:
    """(3,) largest pure torque about each axis from commands up to ``limit``; 0 about axes that cannot be driven without the others.

    ``torque_per_command``: (3, C) torque on the body of a unit of each command.
    """
    allocation = np.linalg.pinv(torque_per_command)
    served, peak = np.abs(torque_per_command @ allocation - np.eye(3)).max(0) < SERVED, np.abs(allocation).max(0)
    return np.where(served, limit / np.where(peak > 0, peak, 1.0), 0.0)
