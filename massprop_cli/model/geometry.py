"""What the vehicle file says to be uncertain of where jets and IMU sit and how jets push: unknowns beside the mass properties.

Each is an unknown number of its own sigmas. What one sigma does to the measurements is a column (:mod:`massprop_cli.model.sensitivity`),
linear about the vehicle as stated; the regression finds these unknowns with the mass properties, from a prior of one sigma each, so that
whatever the log tells of them is used, and what it doesn't tell is in every sigma.
"""

from __future__ import annotations

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
class Wrenches:
    """Changes of what the channels do, by one sigma each."""

    channels: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """(g,)"""
    wrench: Array = field(default_factory=lambda: np.zeros((0, 6)))
    """(g, 6) torque about O and force at full thrust."""
    kinds: tuple[str, ...] = ()
    """What each is of: jet-thrust, jet-position, jet-direction."""


def uncertain_jets(vehicle: Vehicle) -> Wrenches:
    """What is uncertain of the jets, as far as it moves the vehicle; a place along the jet's own line is nothing."""
    found = [change for number, jet in enumerate(vehicle.jets) for change in _changes(number, jet)]
    found = [change._replace(wrench=change.wrench * vehicle.environment.moving) for change in found]
    found = [change for change in found if change.wrench.any()]
    if not found:
        return Wrenches()
    channels = np.array([change.channel for change in found], dtype=np.intp)
    return Wrenches(channels, np.array([change.wrench for change in found]), tuple(change.kind for change in found))


def _changes(number: int, jet: Jet) -> Iterator[Change]:
    position, force = np.array(jet.position_m), np.array(jet.force_n)
    size = float(np.linalg.norm(force))
    if size == 0:
        return
    if jet.thrust_sigma > 0:
        yield Change(number, "jet-thrust", jet.thrust_sigma * np.concatenate([np.cross(position, force), force]))
    for across in np.linalg.svd(force[None] / size)[2][1:]:  # two directions at right angles to the jet
        if jet.position_sigma_m > 0:
            yield Change(number, "jet-position", np.concatenate([jet.position_sigma_m * np.cross(across, force), np.zeros(3)]))
        if jet.direction_sigma_rad > 0:
            turned = jet.direction_sigma_rad * size * across
            yield Change(number, "jet-direction", np.concatenate([np.cross(position, turned), turned]))


def changed_wrenches(jets: Sequence[Jet], wrench: Array, sigmas: Mapping[str, float]) -> Wrenches:
    """What each channel, torque about O and force ``wrench`` (C, 6) at full command, does otherwise by one of ``sigmas``.

    Thrust (a part), position (m) and direction (rad).
    """
    found = []
    for number, (torque, force) in enumerate(zip(wrench[:, :3], wrench[:, 3:], strict=True)):
        place = np.array(jets[number].position_m) if number < len(jets) else np.zeros(3)
        couple = torque - np.cross(place, force)
        found.append(Change(number, "thrust", sigmas["thrust"] * wrench[number]))
        for axis in np.eye(3):
            found.append(Change(number, "position", np.concatenate([sigmas["position"] * np.cross(axis, force), np.zeros(3)])))
            turned = np.cross(axis, force)
            about = np.cross(place, turned) + np.cross(axis, couple)
            found.append(Change(number, "direction", sigmas["direction"] * np.concatenate([about, turned])))
    found = [change for change in found if change.wrench.any()]
    return Wrenches(
        np.array([c.channel for c in found], dtype=np.intp),
        np.array([c.wrench for c in found]).reshape(-1, 6),
        tuple(c.kind for c in found),
    )
