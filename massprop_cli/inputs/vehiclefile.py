"""Loading of vehicle files, with ``KEY=VALUE`` assignments that override them."""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.base import configfile, foldername
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.vehicle import Vehicle

FACTORS = {"gyro_factors": (3, 3), "accel_factors": (3, 3), "command_factors": (6,)}
"""Shapes of factors in ``uncertain``: of sensor readings, IMU axes, and of a commanded wrench."""


@dataclass(frozen=True)
class VehicleSource:
    """Vehicle with the name of its source, for messages, and the SHA-256 digest of the original file."""

    vehicle: Vehicle
    source: str
    sha256: str


def load(path: Path, assignments: Sequence[str] = ()) -> VehicleSource:
    """Read a vehicle file. Raises :class:`InputError` with file, line and key."""
    return parse(configfile.read_text(path, "vehicle file"), str(path), assignments)


def parse(text: str, source: str, assignments: Sequence[str] = ()) -> VehicleSource:
    """Parse and check the text of a vehicle file, with ``KEY=VALUE`` assignments."""
    data = configfile.parse_toml(text, source)
    data = configfile.override(data, assignments)
    vehicle = _checked(configfile.validate(Vehicle, data, source, text, assignments), source)
    return VehicleSource(vehicle, source, hashlib.sha256(text.encode()).hexdigest())


def changed(vehicle: Vehicle, assignments: Sequence[str]) -> Vehicle:
    """Vehicle with ``KEY=VALUE`` assignments; keys that are not stated keep their defaults."""
    data = vehicle.model_dump(by_alias=True, exclude_none=True, exclude_unset=True)
    data = {key: list(value) if isinstance(value, tuple) else value for key, value in data.items()}
    return _checked(configfile.validate(Vehicle, configfile.override(data, assignments), "vehicle", "", assignments), "vehicle")


def alternative(vehicle: Vehicle, values: Mapping[str, Any]) -> Vehicle:
    """Vehicle with other values of dotted keys and without ``uncertain``; ignores :data:`FACTORS`, which apply to the log."""
    assignments = [f"{key}={configfile.written(value)}" for key, value in values.items() if key not in FACTORS]
    return changed(vehicle.model_copy(update={"uncertain": ()}), assignments)


def _checked(vehicle: Vehicle, source: str) -> Vehicle:
    """Return ``vehicle``. Raises :class:`InputError` for invalid keys or values in ``uncertain``."""
    for number, values in enumerate(vehicle.uncertain):
        try:
            wrong = next((key for key, shape in FACTORS.items() if key in values and np.shape(values[key]) != shape), None)
            if wrong is not None:
                raise InputError(f"{wrong} = {values[wrong]}: must be numbers of shape {FACTORS[wrong]}")
            if any(key.startswith("columns") for key in values):
                raise InputError(f"[columns] are not read again; state {', '.join(FACTORS)} instead")
            if any(key.startswith("known") for key in values):
                raise InputError("values under [known] have sigmas of their own; state those instead")
            alternative(vehicle, values)
        except InputError as error:
            raise InputError(f"{source}: uncertain.{number}: {error}") from None
    return vehicle


def find(log: Path, explicit: Path | None, embedded: str | None, assignments: Sequence[str] = ()) -> VehicleSource:
    """Vehicle of a log. Priority: ``explicit``, embedded in the Parquet file, LOGSTEM.vehicle.toml, vehicle.toml in the log's folder."""
    if explicit is not None:
        return load(explicit, assignments)
    if embedded is not None:
        return parse(embedded, f"{log} (embedded vehicle)", assignments)
    beside = [log.with_name(f"{foldername.stem(log.name)}.vehicle.toml"), log.with_name("vehicle.toml")]
    for path in beside:
        if path.exists():
            return load(path, assignments)
    raise InputError(f"{log}: no vehicle file; looked for {beside[0].name} and {beside[1].name} beside it. Name one", option="vehicle")


FAR = 1e6
"""Values within this factor of 1 (SI units) are plausible; arithmetic must not fail for them."""


@contextmanager
def refused(place: object, source: VehicleSource) -> Iterator[None]:
    """Convert linear-algebra errors in the block to :class:`InputError` with the most extreme value of the file, if that is implausible."""
    try:
        yield
    except (np.linalg.LinAlgError, OverflowError) as error:
        key, value = most_extreme(source.vehicle.model_dump(mode="json", by_alias=True, exclude_unset=True))
        if 1 / FAR < abs(value) < FAR:
            raise
        raise InputError(
            f"{place}: cannot be computed with {key} = {value:g} of {source.source} ({error}); check its unit, all values are SI"
        ) from None


def most_extreme(data: Any, place: str = "") -> tuple[str, float]:
    """Dotted key and value of the number farthest from 1 on a logarithmic scale; ignores zeros."""
    if isinstance(data, (int, float)) and not isinstance(data, bool):
        return place, float(data) or 1.0
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    found = [most_extreme(child, f"{place}.{key}" if place else str(key)) for key, child in items]
    return max(found, key=lambda one: abs(math.log10(abs(one[1]))), default=(place, 1.0))
