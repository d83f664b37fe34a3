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


class Topic:
    """Messages of one topic."""

    def __init__(self, name: str, kind: str) -> None:
        self.name, self.kind = name, kind.replace("/msg/", "/")
        self.time_ns: list[int] = []
        self.rows: list[dict[str, float | int]] = []

    def streams(self) -> Iterator[RecordedStream]:
        """Streams of fields that every message has, with the header's clock if there is one."""
        clock = f"{self.name}/{LOG_TIME}"
        yield stream(clock, np.array(self.time_ns, np.int64), unit="ns")
        if not self.rows:
            return
        shared = [path for path in self.rows[0] if all(path in row for row in self.rows)]
        stamps = [path for path in shared if path == "header/stamp" and len({row[path] for row in self.rows}) == len(self.rows)]
        own = f"{self.name}/{stamps[0]}" if stamps else clock
        for path in shared:
            values = np.array([row[path] for row in self.rows])
            parts = path.removeprefix("wrench/").split("/")
            unit = _UNITS.get(self.kind, {}).get(parts[0], "") if len(parts) == 2 else ""
            unit = "ns" if path.endswith("stamp") else unit
            yield stream(f"{self.name}/{path}", values, "" if f"{self.name}/{path}" == own else own, unit)


def collected(path: Path, messages: Iterable[tuple[str, str, int, Any]]) -> Iterator[RecordedStream]:
    """Streams of messages, given as (topic, type, time in ns, message)."""
    topics: dict[str, Topic] = {}
    cells = 0
    for name, kind, time_ns, message in messages:
        topic = topics.setdefault(name, Topic(name, kind))
        topic.time_ns.append(time_ns)
        topic.rows.append(dict(_fields(message, "")))
        cells += len(topic.rows[-1]) + 1
        limits.NUMBERS.check(str(path), cells)
    for topic in topics.values():
        yield from topic.streams()


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
