"""Topics of ROS 2 whose messages no definition says how to read: they are listed, and a map that names one hears why it has no streams."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import listing, propose, reading
from massprop_cli.inputs.logfile import read_table

TYPE = "lab_msgs/msg/Rcs"
SAID = rf"has 4 messages of type {TYPE}, and the file has no definition of that type; .* where the ROS package lab_msgs is installed"
MAP = """
schema = 1
[gyro]
paths = "/rate/vector/?"
unit = "rad/s"
values = "sample"
[jets.a]
path = "/rcs/on[0]"
unit = "s"
"""


def bag(folder: Path) -> Path:
    """A rosbag2 folder as ROS 2 Humble writes it: without definitions."""
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import StoragePlugin
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64[2] on\n", TYPE))
    vector, stamped = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Vector3Stamped"]
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        rate = writer.add_connection("/rate", stamped.__msgtype__, typestore=store)
        rcs = writer.add_connection("/rcs", TYPE, typestore=store)
        for n in range(4):
            at = header(stamp=time(sec=n, nanosec=0), frame_id="")
            writer.write(rate, n * 10**9, store.serialize_cdr(stamped(at, vector(0.1, 0.2, 0.3 * n)), stamped.__msgtype__))
            writer.write(rcs, n * 10**9, store.serialize_cdr(store.types[TYPE](on=np.zeros(2)), TYPE))
    database = sqlite3.connect(folder / f"{folder.name}.db3")
    database.execute("delete from message_definitions")
    database.commit()
    database.close()
    return folder


def test_a_topic_without_a_definition_is_listed(tmp_path: Path) -> None:
    read = reading.load(bag(tmp_path / "run"))
    assert "/rate/vector/z" in read.streams
    assert list(read.unread) == ["/rcs"]
    last = listing.listed(read)[-1]
    assert (last.path, last.samples) == ("/rcs", 0)
    assert f"not read: it has 4 messages of type {TYPE}" in last.note
    assert f"# not read: '/rcs' has 4 messages of type {TYPE}" in propose.draft(read)


@pytest.mark.parametrize("path", ["/rcs/on[0]", "/rcs/@log_time"])
def test_a_map_that_names_it_hears_why(path: str, tmp_path: Path) -> None:
    (tmp_path / "run.map.toml").write_text(MAP.replace("/rcs/on[0]", path), encoding="utf-8")
    with pytest.raises(InputError, match=rf"'/rcs' {SAID}.*\(\[jets.a\] of [^\n]*$"):
        read_table(bag(tmp_path / "run"))


@pytest.mark.parametrize(
    ("encoding", "said"), [("cdr", SAID), ("protobuf", rf"has 4 messages of type {TYPE} in protobuf; write them as JSON or ROS messages")]
)
def test_a_topic_of_an_mcap_file_that_cannot_be_decoded(encoding: str, said: str, tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        other = writer.register_channel("/rate", "json", writer.register_schema("Rate", "jsonschema", b"{}"))
        own = writer.register_channel("/rcs", encoding, writer.register_schema(TYPE, "ros2msg" if encoding == "cdr" else "protobuf", b""))
        for n in range(4):
            writer.add_message(other, n, b'{"x": 1.5}', n)
            writer.add_message(own, n, b"\x00" * 16, n)
        writer.finish()
    read = reading.load(tmp_path / "run.mcap")
    assert list(read.streams) == ["/rate/@log_time", "/rate/x"]
    with pytest.raises(InputError, match=said):
        raise InputError(read.why_unread("/rcs/on[0]"))


def test_the_standards_messages_need_no_definition_in_an_mcap_file(tmp_path: Path) -> None:
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    vector = store.types["geometry_msgs/msg/Vector3"]
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        rate = writer.register_channel("/rate", "cdr", writer.register_schema(vector.__msgtype__, "", b""))
        for n in range(4):
            writer.add_message(rate, n, bytes(store.serialize_cdr(vector(0.1, 0.2, 0.3 * n), vector.__msgtype__)), n)
        writer.finish()
    read = reading.load(tmp_path / "run.mcap")
    assert not read.unread
    np.testing.assert_allclose(read.streams["/rate/z"].values, 0.3 * np.arange(4))
