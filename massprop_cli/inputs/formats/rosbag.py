"""Reader of ROS bags by rosbags (Apache): ``.bag`` of ROS 1, ``.db3`` of ROS 2, with the message definitions of the file."""

import tempfile
from pathlib import Path

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
            known = [one for one in bag.connections if one.msgtype in bag.typestore.fielddefs]
            others = [one for one in bag.connections if one.msgtype not in bag.typestore.fielddefs]
            stored = bag.messages(connections=known) if known else ()
            messages = ((one.topic, one.msgtype, time_ns, bag.deserialize(raw, one.msgtype)) for one, time_ns, raw in stored)
            streams = list(rosmessages.collected(path, messages))
            return Read(streams, unread={one.topic: rosmessages.undefined(one.msgcount, one.msgtype) for one in others})
