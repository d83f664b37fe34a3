"""Reader of PX4's ULog by pyulog (BSD): ``topic/field[0]``, further instances as ``topic.1/field``, units of PX4's definitions."""

import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pyulog import ULog

from massprop_cli.base import limits
from massprop_cli.inputs.formats.recording import Read, RecordedStream, stream

CLOCK = "timestamp"
_UNITS = {
    "sensor_combined/gyro_rad": "rad/s",
    "sensor_combined/accelerometer_m_s2": "m/s^2",
    "sensor_gyro/": "rad/s",
    "sensor_accel/": "m/s^2",
    "vehicle_imu/delta_angle": "rad",
    "vehicle_imu/delta_velocity": "m/s",
    "vehicle_angular_velocity/xyz": "rad/s",
    "vehicle_acceleration/xyz": "m/s^2",
}
"""Units by start of a path without instance, from comments in PX4's msg/*.msg."""
_AXIS = re.compile(r"(xyz|[xyz]|gyro_rad|accelerometer_m_s2|delta_angle|delta_velocity)(\[\d\])?$")


_HEADER, _TAG = 16, 3
"""Length of the file header and of a message header (size and type), bytes."""
_LONGEST = 10_000
"""Maximum length of a message of unknown type, bytes."""
_KNOWN = frozenset(b"FDIMPQASOLC")
_FLAGS = ord("B")
_DAMAGED = ValueError("messages in it are damaged")


def read(path: Path, data: bytes) -> Read:
    """Read all fields, and the initial parameters."""
    _check(data)
    log = ULog(io.BytesIO(data))
    if log.file_corruption:
        raise _DAMAGED
    limits.NUMBERS.check(str(path), sum(len(values) for topic in log.data_list for values in topic.data.values()))
    parameters = {name: float(value) for name, value in log.initial_parameters.items()}
    return Read([one for topic in log.data_list for one in _streams(topic)], parameters)


def _check(data: bytes) -> None:
    """Raise ValueError for damage after which the library would search for messages without end."""
    at = _HEADER
    while at + _TAG <= len(data):
        size, kind = int.from_bytes(data[at : at + 2], "little"), data[at + 2]
        if kind == _FLAGS and at == _HEADER:
            if any(data[at + _TAG + 16 : at + _TAG + 40]):
                return  # a crash dump is appended to a truncated message
        elif kind not in _KNOWN and (kind == 0 or size == 0 or size > _LONGEST):
            raise _DAMAGED
        at += _TAG + size


def _streams(topic: Any) -> Iterator[RecordedStream]:
    place = topic.name if topic.multi_id == 0 else f"{topic.name}.{topic.multi_id}"
    clock = f"{place}/{CLOCK}"
    for field, values in topic.data.items():
        yield stream(f"{place}/{field}", values, "" if field == CLOCK else clock, _unit(topic.name, field))


def _unit(topic: str, field: str) -> str:
    if field.startswith(CLOCK):
        return "us"
    known = (unit for beginning, unit in _UNITS.items() if f"{topic}/{field}".startswith(beginning))
    return next(known, "") if _AXIS.fullmatch(field) else ""
