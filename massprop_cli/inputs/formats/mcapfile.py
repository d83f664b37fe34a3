"""Reader of MCAP by mcap (MIT): ROS 1 and 2 messages by rosbags (Apache), and JSON. Reads in file order, without the index."""

import io
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mcap.reader import NonSeekingReader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from massprop_cli.base import limits
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import rosmessages
from massprop_cli.inputs.formats.recording import Read

Decode = Callable[[bytes], Any]


def read(path: Path, data: bytes) -> Read:
    """Read all numbers in the messages of each topic."""
    unpacked = 0
    for record in StreamReader(io.BytesIO(data), emit_chunks=True, record_size_limit=None).records:
        if isinstance(record, Chunk):
            unpacked += record.uncompressed_size
            limits.NUMBERS.check(str(path), unpacked // 8)
    decoders: dict[int, Decode | None] = {}
    unread: dict[str, tuple[int, str, str]] = {}
    streams = list(rosmessages.collected(path, _messages(data, decoders, unread)))
    if decoders and not any(decoders.values()) and not any(encoding == "cdr" for _, encoding, _ in unread.values()):
        raise InputError(f"{path}: none of its topics is of ROS or JSON messages; convert it, for instance with mcap convert")
    return Read(streams, unread={topic: _left_out(*details) for topic, details in unread.items()})


def _left_out(count: int, encoding: str, kind: str) -> str:
    """Reason for unread messages of a topic."""
    if encoding == "cdr":
        return rosmessages.undefined(count, kind)
    return f"has {count} messages of type {kind or 'unknown'} in {encoding or 'no encoding'}; write them as JSON or ROS messages"


def _messages(
    data: bytes, decoders: dict[int, Decode | None], unread: dict[str, tuple[int, str, str]]
) -> Iterator[tuple[str, str, int, Any]]:
    for schema, channel, message in NonSeekingReader(io.BytesIO(data)).iter_messages():
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(channel.message_encoding, schema)
        decode = decoders[channel.id]
        if decode is not None:
            yield channel.topic, "" if schema is None else schema.name, message.log_time, decode(message.data)
        else:
            count = unread.get(channel.topic, (0, "", ""))[0]
            unread[channel.topic] = count + 1, channel.message_encoding, "" if schema is None else schema.name


def _decoder(encoding: str, schema: Any) -> Decode | None:
    """Decoder of a channel's messages; None without one."""
    if encoding == "json":
        return json.loads
    if schema is None:
        return None
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    if not schema.data and encoding == "cdr":
        store = get_typestore(Stores.ROS2_HUMBLE)  # standard messages have not changed
        return partial(store.deserialize_cdr, typename=name) if name in store.fielddefs else None
    if (encoding, schema.encoding) not in (("cdr", "ros2msg"), ("ros1", "ros1msg")):
        return None
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.data.decode(), name))
    return partial(store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1, typename=name)
