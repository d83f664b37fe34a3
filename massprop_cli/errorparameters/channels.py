"""What log and vehicle file state of each command channel, changed channel by channel: jets, wrenches, rotors, and what stores momentum."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.errorparameters.setup import Setup, plain, rebuilt
from massprop_cli.inputs.actuators.control_moment_gyro import ControlMomentGyro

DOES = ("position_m", "force_n")
"""What a jet does, by keys of the vehicle file."""


def scaled(setup: Setup, error: Array) -> Setup | None:
    """Of the channels that fired, forces, commands or momenta times 1 + ``error``; None where that can't be stated."""
    own, stored = np.split(_of_all(setup, np.ones(()), 1 + error), [_commanded(setup)])
    if setup.log.command_kind == "wrench" and (own != 1).any():
        setup = setup._replace(log=replace(setup.log, command=setup.log.command * own))
    elif setup.log.command_kind == "jets":
        setup = setup.having("jets.force_n", setup.value("jets.force_n") * own[:, None])
    elif setup.log.command_kind == "rotors":
        pushed = (tuple(float(factor * part) for part in one.thrust_n) for one, factor in zip(setup.vehicle.rotors, own, strict=True))
        setup = _having(setup, "rotors", [{"thrust_n": one} for one in pushed])
    if (stored == 1).all():
        return setup
    vehicle = setup.vehicle.with_acting(stored)
    return None if vehicle is None else setup._replace(vehicle=rebuilt(setup.vehicle, **dict(vehicle)))


def moved(setup: Setup, error: Array) -> Setup | None:
    """Jets or rotors at other places by ``error`` (C, 3)."""
    table = setup.log.command_kind
    if table == "wrench":
        return None if error.any() else setup
    every = _of_all(setup, np.zeros(3), error)
    now = [np.array(one.position_m) for one in getattr(setup.vehicle, table)]
    return _having(setup, table, [{"position_m": plain(a + b)} for a, b in zip(now, every, strict=False)])


def turned(setup: Setup, error: Array) -> Setup | None:
    """Jets' forces, or axes of rotors, wheels and control moment gyros, of the same size along other directions by ``error`` (C, 3), N.

    Of an axis by a unit; a device's torque on the body is against its axis. None where anything else is to be turned.
    """
    every, table = _of_all(setup, np.zeros(3), error), setup.log.command_kind
    stored = [every[_storing(setup, name)] for name in ("wheels", "control_moment_gyros")]
    changed = [("wheels", [_turned(np.array(one.axis), "axis", -by) for one, by in zip(setup.vehicle.wheels, stored[0], strict=True)])]
    gyros = zip(setup.vehicle.control_moment_gyros, stored[1].reshape(-1, 2, 3), strict=True)
    changed += [("control_moment_gyros", [_turned_gyro(one, -by) for one, by in gyros])]
    if table != "wrench":
        stored += [every[: _commanded(setup)]]
        key = "force_n" if table == "jets" else "axis"
        own = zip(getattr(setup.vehicle, table), stored[-1], strict=True)
        changed += [(table, [_turned(np.array(getattr(one, key)), key, by) for one, by in own])]
    if np.count_nonzero(error) > sum(map(np.count_nonzero, stored)):
        return None
    for name, entries in changed:
        setup = _having(setup, name, entries)
    return setup


def _turned(stated: Array, key: str, by: Array) -> dict[str, Any]:
    size = np.linalg.norm(stated)
    along = stated + by * (1.0 if key == "force_n" else size)
    length = np.linalg.norm(along)
    return {key: plain(along * (size / length if size > 0 else 1.0))} if by.any() else {}


def _turned_gyro(stated: ControlMomentGyro, by: Array) -> dict[str, Any]:
    """Of a gyro whose spin axes at 0 and at 90 degrees are off ``by`` (2, 3): what stays at right angles."""
    spin, further = stated.axes + by
    gimbal = np.cross(spin, further)
    return {key: plain(axis / np.linalg.norm(axis)) for key, axis in (("spin_axis", spin), ("gimbal_axis", gimbal))} if by.any() else {}


def of_jets(setup: Setup) -> BoolArray:
    """(F,) which of the channels that fired are jets."""
    return np.array([setup.log.command_kind == "jets" and i < _commanded(setup) for i in setup.fired], dtype=bool)


def jet_sigmas(setup: Setup, key: str, error: Array, most: float) -> dict[str, float]:
    """Sigmas under a ``key`` of jets as large as an error that is in place, at ``most`` so much, by which they are estimated anew.

    Of none that is stated to be as uncertain. ``error`` (F,) relative, or (F, 3) m or N.
    """
    found = {}
    for i, by, jet in zip(setup.fired, error, of_jets(setup), strict=True):
        if jet and by.any():
            one = setup.vehicle.jets[i]
            size = float(np.linalg.norm(by) / (np.linalg.norm(one.force_n) if key == "direction_sigma_rad" else 1.0))
            if min(size, most) > getattr(one, key):
                found[f"jets.{i}.{key}"] = min(size, most)
    return found


def wired(setup: Setup, does: Sequence[int]) -> Setup:
    """Of the channels that fired, each does what is stated of the one that ``does`` says, by its place among them."""
    order = list(range(_count(setup)))
    for at, other in zip(setup.fired, does, strict=True):
        order[at] = setup.fired[other]
    if setup.log.command_kind != "wrench":
        setup = _swapped(setup, setup.log.command_kind, order[: _commanded(setup)], DOES if setup.log.command_kind == "jets" else None)
    first = _commanded(setup)
    for kind, own in setup.vehicle.actuators:
        if own and not kind.THRUSTS:
            starts = [first + sum(len(one.axes) for one in own[:i]) for i in range(len(own))]
            first += sum(len(one.axes) for one in own)
            setup = _swapped(setup, kind.TABLE, [starts.index(order[start]) for start in starts])
    return setup


def spun(setup: Setup, which: Sequence[int]) -> Setup:
    """Rotors, by their places among the channels that fired, turn the other way round."""
    turned = {setup.fired[i] for i in which}
    rotors = setup.vehicle.rotors
    return _having(setup, "rotors", [{"spin": -one.spin} if i in turned else {} for i, one in enumerate(rotors)])


def _swapped(setup: Setup, table: str, order: Sequence[int], keys: Sequence[str] | None = None) -> Setup:
    own = getattr(setup.vehicle, table)
    used = own[0].DOES if keys is None else keys
    return _having(setup, table, [{key: getattr(own[other], key) for key in used} if other != i else {} for i, other in enumerate(order)])


def _commanded(setup: Setup) -> int:
    """How many channels are commanded; those that store momentum come after them."""
    return int(setup.log.command.shape[1])


def _count(setup: Setup) -> int:
    """How many channels there are."""
    return _commanded(setup) + len(setup.vehicle.momentum_wrench)


def _storing(setup: Setup, table: str) -> slice:
    """The channels along which the entries of a table store momentum."""
    at, found = _commanded(setup), slice(0, 0)
    for kind, own in setup.vehicle.actuators:
        first, at = at, at + sum(len(one.device.axes) for one in own if one.device is not None)
        found = slice(first, at) if table == kind.TABLE else found
    return found


def _of_all(setup: Setup, usual: Array, fired: Array) -> Array:
    """(C, ...) what each channel has: as ``usual``, or of those that fired their own (F, ...)."""
    found = np.tile(usual, (_count(setup), *[1] * usual.ndim))
    found[list(setup.fired)] = fired
    return found


def _having(setup: Setup, table: str, changes: Sequence[dict[str, Any]]) -> Setup:
    """With other values of the keys of each of a table's entries."""
    own = tuple(one.model_copy(update=by) if by else one for one, by in zip(getattr(setup.vehicle, table), changes, strict=True))
    return setup._replace(vehicle=rebuilt(setup.vehicle, **{table: own}))
