"""Uncertain geometry of jets and IMU as nuisance parameters, each in units of its sigma.

The effect of one sigma on the measurements is a column (:mod:`massprop_cli.model.sensitivity`), linear about the vehicle as stated. The
regression estimates these parameters together with the mass properties, with a prior of one sigma each. Every sigma includes them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.equipment import Jet
from massprop_cli.inputs.vehicle import Vehicle


class Change(NamedTuple):
    """Change of one channel's wrench at full thrust by one sigma of a parameter."""

    channel: int
    kind: str
    wrench: Array
    """(6,) torque about O [N m] and force [N]."""


@dataclass(frozen=True)
class WrenchChanges:
    """Changes of the channels' wrenches at full thrust, each by one sigma of a parameter."""

    channels: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """(g,) channel of each change."""
    wrench: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """(g, 6) torque about O [N m] and force [N]."""
    kinds: tuple[str, ...] = ()
    """Kind of each parameter: jet-thrust, jet-position, jet-direction."""


def uncertain_jets(vehicle: Vehicle) -> WrenchChanges:
    """Changes by the jets' stated sigmas, without those that do not move the vehicle."""
    changes = []
    for number, jet in enumerate(vehicle.jets):
        sigmas = {"thrust": jet.thrust_sigma, "position": jet.position_sigma_m, "direction": jet.direction_sigma_rad}
        wrench = np.concatenate([np.cross(jet.position_m, jet.force_n), jet.force_n])
        changes += [change._replace(kind=f"jet-{change.kind}") for change in _changes(number, np.array(jet.position_m), wrench, sigmas)]
    return _moving([change._replace(wrench=change.wrench * vehicle.environment.moving) for change in changes])


def channel_changes(jets: Sequence[Jet], wrench: Array, sigmas: Mapping[str, float]) -> WrenchChanges:
    """Changes of each channel's wrench ``wrench`` (C, 6) at full command by ``sigmas``: thrust (relative), position (m), direction (rad).

    The first channels are ``jets``; position and direction of the others are taken at O.
    """
    places = [np.array(jet.position_m) for jet in jets] + [np.zeros(3)] * (len(wrench) - len(jets))
    return _moving([change for number, at in enumerate(places) for change in _changes(number, at, wrench[number], sigmas)])


def _moving(changes: Sequence[Change]) -> WrenchChanges:
    changes = [change for change in changes if change.wrench.any()]
    channels, wrench = np.array([change.channel for change in changes], dtype=np.intp), np.array([change.wrench for change in changes])
    return WrenchChanges(channels, wrench.reshape(-1, 6), tuple(change.kind for change in changes))


def _changes(number: int, place: Array, wrench: Array, sigmas: Mapping[str, float]) -> Iterator[Change]:
    """Changes of a channel at ``place`` (3,), m; shifts along its line of action and turns about it have no effect."""
    force, couple = wrench[3:], wrench[:3] - np.cross(place, wrench[3:])
    line = force if force.any() else couple
    if not line.any():
        return
    if sigmas["thrust"] > 0:
        yield Change(number, "thrust", sigmas["thrust"] * wrench)
    for across in np.linalg.svd(line[None])[2][1:]:  # two directions at right angles
        if sigmas["position"] > 0:
            yield Change(number, "position", np.concatenate([sigmas["position"] * np.cross(across, force), np.zeros(3)]))
        if sigmas["direction"] > 0:
            turned = sigmas["direction"] * np.cross(across, force)
            torque = np.cross(place, turned) + sigmas["direction"] * np.cross(across, couple)
            yield Change(number, "direction", np.concatenate([torque, turned]))
