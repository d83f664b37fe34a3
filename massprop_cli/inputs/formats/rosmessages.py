"""ROS 1 and ROS 2 messages as flat fields: ``topic/field/part[0]``."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.base import limits
from massprop_cli.inputs.formats.recording import RecordedStream, stream

LOG_TIME = "@log_time"
"""Clock of a topic: receive times of its messages; the time stamp of the header is better."""
_LONGEST = 64
"""Maximum length of an array whose numbers become streams; longer ones are images or point clouds."""
_UNITS = {
    "sensor_msgs/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "geometry_msgs/Wrench": {"force": "N", "torque": "N m"},
    "geometry_msgs/WrenchStamped": {"force": "N", "torque": "N m"},
}
"""Units of standard messages (REP 103: SI)."""


def undefined(count: int, kind: str) -> str:
    """Reason for unread messages of a type without a definition in the file."""
    package = kind.partition("/")[0]
    return (
        f"has {count} messages of type {kind}, and the file has no definition of that type; on a computer where the ROS package {package} "
        "is installed, convert the bag to MCAP, which stores definitions (ros2 bag convert, storage_id: mcap), or record it as MCAP"
    )


Row = tuple[int, dict[str, float | int]]
"""Receive time of a message, ns, and its numbers by path."""


def collected(path: Path, messages: Iterable[tuple[str, str, int, Any]]) -> Iterator[RecordedStream]:
    """Streams of messages, given as (topic, type, time in ns, message)."""
    topics: dict[str, tuple[str, list[Row]]] = {}
    cells = 0
    for name, kind, time_ns, message in messages:
        _, rows = topics.setdefault(name, (kind.replace("/msg/", "/"), []))
        rows.append((time_ns, dict(_fields(message, ""))))
        cells += len(rows[-1][1]) + 1
        limits.NUMBERS.check(str(path), cells)
    for name, (kind, rows) in topics.items():
        yield from _streams(name, kind, rows)


def _streams(topic: str, kind: str, rows: Sequence[Row]) -> Iterator[RecordedStream]:
    """Streams of fields that every message has, with the header's clock if there is one."""
    clock = f"{topic}/{LOG_TIME}"
    yield stream(clock, np.array([time_ns for time_ns, _ in rows], np.int64), unit="ns")
    shared = [path for path in rows[0][1] if all(path in row for _, row in rows)]
    if "header/stamp" in shared and len({row["header/stamp"] for _, row in rows}) == len(rows):
        clock = f"{topic}/header/stamp"
    for path in shared:
        place, parts = f"{topic}/{path}", path.removeprefix("wrench/").split("/")
        unit = _UNITS.get(kind, {}).get(parts[0], "") if len(parts) == 2 else ""
        unit = "ns" if path.endswith("stamp") else unit
        yield stream(place, np.array([row[path] for _, row in rows]), "" if place == clock else clock, unit)


def _fields(message: Any, path: str) -> Iterator[tuple[str, float | int]]:
    """Paths and numbers in a message; times become integer nanoseconds."""
    if isinstance(message, bool | np.bool_ | int | float | np.number):
        yield path, message.item() if isinstance(message, np.generic) else message
    elif isinstance(message, dict):
        for part in ("nanosec", "nsec"):
            if set(message) == {"sec", part}:
                yield path, int(message["sec"]) * 10**9 + int(message[part])
                return
        for name, part in message.items():
            yield from _fields(part, f"{path}/{name}" if path else str(name))
    elif isinstance(message, Sequence | np.ndarray) and not isinstance(message, str | bytes | bytearray):
        if len(message) <= _LONGEST:
            for number, part in enumerate(message):
                yield from _fields(part, f"{path}[{number}]")
    elif is_dataclass(message):
        yield from _fields({part.name: getattr(message, part.name) for part in fields(message) if part.name[:2] != "__"}, path)
