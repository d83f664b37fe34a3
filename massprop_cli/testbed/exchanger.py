"""The seam of what stores momentum in the simulator: devices of one kind, whose momentum is followed cycle by cycle."""

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
"""By which a unit of torque about an axis may miss it."""


class Setting(NamedTuple):
    """What the devices of S members go through: K cycles of N records, each cycle of B bins."""

    vehicle: Vehicle
    real: TrueActuators
    members: int
    cycles: int
    records: int
    delay_cycles: float
    """From the start of the cycle that issues a command to the start of its execution."""
    rate_rad_s: Vector
    """Of the body at the start."""
    edges_s: Array
    """(B + 1,) of the bins, from the start of a cycle."""


@dataclass(frozen=True)
class Spin:
    """What devices do within a cycle, body axes, bin by bin."""

    torque: Array
    """(3, S, B) growth of their momentum in axes that turn with the body, N m."""
    momentum: Array
    """(3, S, B) mean over each bin, N m s."""


class Exchanger(ABC):
    """All devices of one kind, of S members through K cycles of N records."""

    TABLE: ClassVar[str]
    """Of the vehicle file."""

    def __init__(self, setting: Setting) -> None:
        self.setting, self.edges_s = setting, setting.edges_s
        self.period_s, self.records = setting.vehicle.cycle.period_s, setting.records
        self.issued: Array = np.zeros((setting.members, setting.cycles, self.channels(setting.vehicle)))
        """(S, K, C) commands of each cycle."""

    @classmethod
    def channels(cls, vehicle: Vehicle) -> int:
        """C, how many commands each cycle has."""
        return len(getattr(vehicle, cls.TABLE))

    @staticmethod
    @abstractmethod
    def full(vehicle: Vehicle, real: TrueActuators) -> Array:
        """(3,) largest torque on the body about each axis, N m; 0 about one that they don't serve without disturbing the others."""

    @staticmethod
    @abstractmethod
    def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:
        """Why a vehicle of the true inertia ``truth`` (3, 3) can't be flown; ``turned_by``: the plan turns by them. Empty where it can."""

    @abstractmethod
    def bare(self, bodies: Bodies) -> Bodies:
        """The bodies as far as the momentum of :meth:`spin` does not count what the devices add to them."""

    @abstractmethod
    def issue(self, cycle: int, torque: Array) -> None:
        """Take torque on the body (S, 3), N m, as far as the devices can give it."""

    @abstractmethod
    def spin(self, cycle: int, rate: Array) -> Spin:
        """Through one cycle that begins at the body's ``rate`` (3, S)."""

    @abstractmethod
    def log(self, cycle: int, motion: CycleMotion) -> None:
        """Read the devices at the end of each record."""

    @property
    @abstractmethod
    def turning(self) -> Mapping[str, Array]:
        """(S, K N) what each device does after each record, by the log column of that."""

    @property
    def columns(self) -> Mapping[str, Array]:
        """(S, K N) what the vehicle file says that the log has of them; NaN in cells that are empty."""
        return self.turning


def held(issued: Array, cycle: int, delay_cycles: float, period_s: float, edges_s: Array) -> Array:
    """(S, C, B) mean command of each bin: each cycle's (S, K, C) is held for a cycle, from its delay on."""
    source = int(np.floor(cycle - delay_cycles))
    late = (delay_cycles + source - cycle + 1) * period_s  # from when on the next one acts
    later = np.clip((edges_s[1:] - late) / np.diff(edges_s), 0.0, 1.0)
    cycles = range(issued.shape[1])
    first, second = (issued[:, k] if k in cycles else np.zeros_like(issued[:, 0]) for k in (source, source + 1))
    return np.asarray(first[..., None] * (1 - later) + second[..., None] * later)


def largest(gained: Array, limit: float) -> Array:
    """(3,) torque about each axis of which commands up to ``limit`` give none about another; ``gained`` (3, C) is what they give."""
    share = np.linalg.pinv(gained)
    served, most = np.abs(gained @ share - np.eye(3)).max(0) < SERVED, np.abs(share).max(0)
    return np.where(served, limit / np.where(most > 0, most, 1.0), 0.0)
