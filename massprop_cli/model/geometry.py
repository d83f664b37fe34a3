"""Uncertain geometry of jets and IMU: nuisance parameters beside the mass properties.

Each is an unknown number of its own sigmas. What one sigma does to the measurements is a column (:mod:`massprop_cli.model.sensitivity`),
linear about the vehicle as stated; the regression finds these unknowns with the mass properties, from a prior of one sigma each, so that
whatever the log tells of them is used, and what it doesn't tell is in every sigma.
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
    """Of one channel's wrench at full thrust, by one sigma."""

    channel: int
    kind: str
    wrench: Array
    """(6,) torque about O and force."""


@dataclass(frozen=True)
class WrenchChanges:
    """Changes of what the channels do, by one sigma each."""

    channels: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """(g,)"""
    wrench: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """(g, 6) torque about O and force at full thrust."""
    kinds: tuple[str, ...] = ()
    """What each is of: jet-thrust, jet-position, jet-direction."""


def uncertain_jets(vehicle: Vehicle) -> WrenchChanges:
    """What is uncertain of the jets, as far as it moves the vehicle, each by the sigma that its jet states."""
    found = []
    for number, jet in enumerate(vehicle.jets):
        sigmas = {"thrust": jet.thrust_sigma, "position": jet.position_sigma_m, "direction": jet.direction_sigma_rad}
        wrench = np.concatenate([np.cross(jet.position_m, jet.force_n), jet.force_n])
        found += [change._replace(kind=f"jet-{change.kind}") for change in _changes(number, np.array(jet.position_m), wrench, sigmas)]
    return _moving([change._replace(wrench=change.wrench * vehicle.environment.moving) for change in found])


def channels_otherwise(jets: Sequence[Jet], wrench: Array, sigmas: Mapping[str, float]) -> WrenchChanges:
    """What each channel, torque about O and force ``wrench`` (C, 6) at full command, does otherwise by one of ``sigmas``.

    Thrust (a part), position (m) and direction (rad); of channels that are no ``jets`` about O.
    """
    places = [np.array(jet.position_m) for jet in jets] + [np.zeros(3)] * (len(wrench) - len(jets))
    return _moving([change for number, at in enumerate(places) for change in _changes(number, at, wrench[number], sigmas)])


def _moving(found: Sequence[Change]) -> WrenchChanges:
    found = [change for change in found if change.wrench.any()]
    channels, wrench = np.array([change.channel for change in found], dtype=np.intp), np.array([change.wrench for change in found])
    return WrenchChanges(channels, wrench.reshape(-1, 6), tuple(change.kind for change in found))


def _changes(number: int, place: Array, wrench: Array, sigmas: Mapping[str, float]) -> Iterator[Change]:
    """Of a channel that pushes at a place (3,); one along its own line, or turned about it, is nothing."""
    force, couple = wrench[3:], wrench[:3] - np.cross(place, wrench[3:])
    along = force if force.any() else couple
    if not along.any():
        return
    if sigmas["thrust"] > 0:
        yield Change(number, "thrust", sigmas["thrust"] * wrench)
    for across in np.linalg.svd(along[None])[2][1:]:  # two directions at right angles
        if sigmas["position"] > 0:
            yield Change(number, "position", np.concatenate([sigmas["position"] * np.cross(across, force), np.zeros(3)]))
        if sigmas["direction"] > 0:
            turned = sigmas["direction"] * np.cross(across, force)
            about = np.cross(place, turned) + sigmas["direction"] * np.cross(across, couple)
            yield Change(number, "direction", np.concatenate([about, turned]))
