"""A log, a vehicle file and a timing, whose keys are read and changed by name."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple, Self, TypeVar, cast

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.timing import Timing

AnyVehicle = TypeVar("AnyVehicle", bound=Vehicle)
DELAY, LAG = "cycle.command_delay_cycles", "thrust.lag_s"
"""Keys that a vehicle file may leave to be found; their values are those of the timing."""


class Setup(NamedTuple):
    """What an estimate starts from."""

    log: Log
    vehicle: Vehicle
    timing: Timing
    fired: tuple[int, ...] = ()
    """Channels that an error per channel is about."""
    clock_s: tuple[float, float] = (0.0, 1.0)
    """From the log's beginning to the middle of the stretch in which a clock drifts, and the stretch's length."""

    @property
    def period_s(self) -> float:
        """Length of a control cycle."""
        return self.vehicle.cycle.period_s

    def value(self, key: str) -> Array:
        """(n,) or (n, m) of a key, ``section.name``; of ``jets.name`` one row per jet."""
        if key in (DELAY, LAG):
            own = own_lags(self.vehicle)
            return np.array([self.timing.delay if key == DELAY else np.mean(own) if own else self.timing.lag_s(self.vehicle)])
        return stated(self.vehicle, key)

    def having(self, key: str, value: Array) -> Self:
        """With another value, shaped as :meth:`value` has it."""
        if key == DELAY:
            return self._replace(timing=self.timing._replace(delay=float(value[0])))
        if key == LAG:
            if own_lags(self.vehicle):
                return self._replace(vehicle=_lagging(self.vehicle, float((value - self.value(key))[0])))
            return self._replace(timing=self.timing._replace(lag=float(value[0]) / self.period_s))
        section, _, name = key.partition(".")
        if section == "jets":
            pairs = zip(self.vehicle.jets, self.value(key), value, strict=True)
            changed: Any = tuple(jet if np.array_equal(a, b) else jet.model_copy(update={name: plain(b)}) for jet, a, b in pairs)
        else:
            scalar = not isinstance(value_of(self.vehicle, key), tuple)
            changed = _with(getattr(self.vehicle, section), name, plain(value[0] if scalar else value))
        return self._replace(vehicle=rebuilt(self.vehicle, **{section: changed}))


def with_factors(log: Log, gyro: Sequence[Sequence[float]], accelerometer: Sequence[Sequence[float]], command: Sequence[float]) -> Log:
    """The log with factors on its columns, (3, 3) of each sensor and one on each component of the command; without those that are empty."""
    changed = {}
    for name, factors in (("delta_theta_imu_rad", gyro), ("delta_v_imu_m_s", accelerometer)):
        if factors:
            changed[name] = getattr(log, name) @ np.array(factors).T
    if command:
        changed["command"] = log.command * np.array(command)
    return replace(log, **changed) if changed else log


def own_lags(vehicle: Vehicle) -> list[float]:
    """Lags that rotors have of their own, up and down, s."""
    return [lag for rotor in vehicle.rotors if rotor.lag_up_s is not None for lag in rotor.lags(0.0)]


def _lagging(vehicle: Vehicle, by_s: float) -> Vehicle:
    """With each rotor's own lags so much longer."""
    rotors = []
    for rotor in vehicle.rotors:
        keys = ("lag_up_s", "lag_down_s")
        own = {key: max(value + by_s, 0.0) for key in keys if (value := getattr(rotor, key)) is not None}
        rotors.append(rotor.model_copy(update=own))
    return rebuilt(vehicle, rotors=tuple(rotors))


def stating(vehicle: AnyVehicle, values: Mapping[str, Any]) -> AnyVehicle:
    """The vehicle with other values of dotted keys, or other tables."""
    for key, value in values.items():
        section, _, name = key.partition(".")
        vehicle = rebuilt(vehicle, **{section: _with(getattr(vehicle, section), name, value) if name else value})
    return vehicle


def stating_as(vehicle: AnyVehicle, other: Vehicle, keys: Iterable[str]) -> AnyVehicle:
    """The vehicle with the values that another one has of keys, ``section.name``."""
    return stating(vehicle, {key: attrgetter(key)(other) for key in keys})


def rebuilt(vehicle: AnyVehicle, **sections: Any) -> AnyVehicle:
    """The vehicle with other sections, constructed anew: a copy would keep what was computed of it before."""
    return cast("AnyVehicle", type(vehicle).model_construct(vehicle.model_fields_set, **{**dict(vehicle), **sections}))


def stated(vehicle: Vehicle, key: str) -> Array:
    """The value of a key as :meth:`Setup.value` has it, of a vehicle file alone."""
    section, _, name = key.partition(".")
    if section == "jets":
        return np.array([getattr(jet, name) for jet in vehicle.jets])
    return np.atleast_1d(np.array(value_of(vehicle, key) or 0.0, dtype=float))  # 0 in a table that is not stated


def has_table(vehicle: Vehicle, key: str) -> bool:
    """Whether the vehicle has the table in which a dotted key stands: a sensor without a low-pass has none of it."""
    section, *inner = key.split(".")[:-1]
    found: Any = getattr(vehicle, section)
    for name in inner:
        found = getattr(found, name)
    return found is not None


def value_of(vehicle: Vehicle, key: str) -> Any:
    """Value of a dotted key, in which a number is that of an entry in a list; None in a table that is not stated, or of known values."""
    found: Any = vehicle
    for name in key.split("."):
        found = found[int(name)] if isinstance(found, tuple) else getattr(found, name, None)
    return found


def _with(section: Any, key: str, value: Any) -> Any:
    """A section with another value of a key in it, which may be dotted; a number is that of an entry in a list."""
    name, _, inner = key.partition(".")
    if isinstance(section, tuple):
        return tuple(_with(one, inner, value) if i == int(name) else one for i, one in enumerate(section))
    return section.model_copy(update={name: _with(getattr(section, name), inner, value) if inner else value})


def plain(value: Any) -> Any:
    """A number or nested tuples of numbers, as the vehicle file's models hold them."""
    return tuple(plain(part) for part in value) if np.ndim(value) else float(value)
