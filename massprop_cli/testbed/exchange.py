"""All devices of a vehicle that store momentum, kind by kind."""

from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.conditions import TrueActuators
from massprop_cli.testbed.exchanger import Exchanger, Setting, Spin
from massprop_cli.testbed.gyros import Gyros
from massprop_cli.testbed.motion import Bodies, CycleMotion
from massprop_cli.testbed.wheels import Wheels

KINDS: tuple[type[Exchanger], ...] = (Wheels, Gyros)


def channels(vehicle: Vehicle) -> int:
    """How many commands each cycle has."""
    return sum(kind.channels(vehicle) for kind in KINDS)


def full(vehicle: Vehicle, real: TrueActuators) -> Array:
    """(3,) largest torque on the body about each axis, N m, by the first kind that the vehicle has."""
    return next((kind.full(vehicle, real) for kind in KINDS if kind.channels(vehicle)), np.zeros(3))


def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:
    """Why it can't be flown; empty where it can."""
    return next((said for kind in KINDS if (said := kind.problem(vehicle, real, truth, turned_by))), "")


class Exchange:
    """Of one flight."""

    def __init__(self, setting: Setting, issued: Array | None) -> None:
        """``issued`` (K, C) or (S, K, C) are recorded commands, kind by kind."""
        self.kinds = [kind(setting) for kind in KINDS if kind.channels(setting.vehicle)]
        self.shape = (setting.members, setting.cycles, 0)
        first = 0
        for kind in self.kinds if issued is not None else ():
            last = first + kind.issued.shape[-1]
            kind.issued[:], first = np.asarray(issued)[..., first:last], last

    @property
    def issued(self) -> Array:
        """(S, K, C) commands of each cycle."""
        return np.concatenate([np.zeros(self.shape), *(kind.issued for kind in self.kinds)], -1)

    def bare(self, bodies: Bodies) -> Bodies:
        """The bodies as far as momentum that is followed does not count what the devices add to them."""
        for kind in self.kinds:
            bodies = kind.bare(bodies)
        return bodies

    def issue(self, cycle: int, torque: Array) -> None:
        """Ask the first kind for torque on the body (S, 3), N m."""
        if self.kinds:
            self.kinds[0].issue(cycle, torque)

    def spin(self, cycle: int, rate: Array, bins: int, others: Sequence[Spin]) -> Spin:
        """Through one cycle of ``bins`` that begins at the body's ``rate`` (3, S), with what ``others`` store."""
        found = [*(kind.spin(cycle, rate) for kind in self.kinds), *others]
        none = np.zeros((*rate.shape, bins))
        return Spin(sum((one.torque for one in found), none), sum((one.momentum for one in found), none))

    def log(self, cycle: int, motion: CycleMotion) -> None:
        """Read all devices at the end of each record."""
        for kind in self.kinds:
            kind.log(cycle, motion)

    @property
    def turning(self) -> Mapping[str, Array]:
        """(S, K N) what each device does after each record, by the log column of that."""
        return {name: values for kind in self.kinds for name, values in kind.turning.items()}

    @property
    def columns(self) -> Mapping[str, Array]:
        """(S, K N) what the vehicle file says that the log has of them."""
        return {name: values for kind in self.kinds for name, values in kind.columns.items()}
