"""Reader of ROS bags by rosbags (Apache): ``.bag`` of ROS 1, ``.db3`` of ROS 2, with the message definitions of the file."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from massprop_cli.inputs.formats import rosmessages
from massprop_cli.inputs.formats.recording import Read


def read(path: Path, data: bytes) -> Read:
    """Read all numbers in the messages of each topic."""
    with tempfile.TemporaryDirectory() as aside:
        file = Path(aside) / f"recording{path.suffix.lower()}"
        file.write_bytes(data)
        # bags before ROS 2 Iron have no definitions; standard messages have not changed
        with AnyReader([file], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            streams = list(rosmessages.collected(path, _messages(bag)))
            others = [one for one in bag.connections if one.msgtype not in bag.typestore.fielddefs]
            return Read(streams, unread={one.topic: rosmessages.undefined(one.msgcount, one.msgtype) for one in others})


def _messages(bag: AnyReader) -> Iterator[tuple[str, str, int, Any]]:
    known = [connection for connection in bag.connections if connection.msgtype in bag.typestore.fielddefs]
    for connection, time_ns, raw in bag.messages(connections=known) if known else ():
        yield connection.topic, connection.msgtype, time_ns, bag.deserialize(raw, connection.msgtype)
