"""All simulated momentum devices of a vehicle, by kind."""

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
    """Number of commands to momentum devices in each cycle."""
    return sum(kind.channels(vehicle) for kind in KINDS)


def full(vehicle: Vehicle, real: TrueActuators) -> Array:
    """(3,) largest torque on the body about each axis by the first kind that the vehicle has, N m."""
    return next((kind.full(vehicle, real) for kind in KINDS if kind.channels(vehicle)), np.zeros(3))


def problem(vehicle: Vehicle, real: TrueActuators, truth: Array, turned_by: bool) -> str:
    """Reason why the momentum devices cannot be simulated; empty if they can."""
    return next((reason for kind in KINDS if (reason := kind.problem(vehicle, real, truth, turned_by))), "")


class Exchange:
    """Momentum devices of one flight, S members."""

    def __init__(self, setting: Setting, issued: Array | None) -> None:
        """``issued``: recorded commands (K, C) or (S, K, C), in the order of the kinds; None: commands follow."""
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
        """Bodies without the inertia that the devices' own momentum accounts for."""
        for kind in self.kinds:
            bodies = kind.bare(bodies)
        return bodies

    def issue(self, cycle: int, torque: Array) -> None:
        """Command the first kind to give a torque (S, 3) on the body, N m."""
        if self.kinds:
            self.kinds[0].issue(cycle, torque)

    def spin(self, cycle: int, rate: Array, bins: int, others: Sequence[Spin]) -> Spin:
        """Stored momentum through one cycle of ``bins`` bins that starts at body rate ``rate`` (3, S), plus that of ``others``."""
        spins = [*(kind.spin(cycle, rate) for kind in self.kinds), *others]
        none = np.zeros((*rate.shape, bins))
        return Spin(sum((one.torque for one in spins), none), sum((one.momentum for one in spins), none))

    def log(self, cycle: int, motion: CycleMotion) -> None:
        """Read all devices at the end of each record."""
        for kind in self.kinds:
            kind.log(cycle, motion)

    @property
    def turning(self) -> Mapping[str, Array]:
        """(S, K N) state of each device at the end of each record, by log column."""
        return {name: values for kind in self.kinds for name, values in kind.turning.items()}

    @property
    def columns(self) -> Mapping[str, Array]:
        """(S, K N) columns of the devices in the log."""
        return {name: values for kind in self.kinds for name, values in kind.columns.items()}
