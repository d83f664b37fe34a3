"""The sample log in every format, each file written by its own library."""

import gzip
import struct
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from massprop_cli import job
from massprop_cli.inputs import columns

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "free-flyer"
ROWS = 160
DELTAS = (*columns.DELTA_THETA, *columns.DELTA_V)


@cache
def sample() -> dict[str, Any]:
    """The columns of a short log."""
    table = pq.read_table(SAMPLE / "log.parquet").slice(0, ROWS)
    return {name: table.column(name).to_numpy() for name in table.column_names}


@cache
def by_parquet() -> dict[str, Any]:
    """What is found in it."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.parquet"
        pq.write_table(pq.read_table(SAMPLE / "log.parquet").slice(0, ROWS).replace_schema_metadata(), path)
        return found(path)


def found(path: Path, map_file: Path | None = None) -> dict[str, Any]:
    """A log's result without its path, its digests, and what its map says."""
    told: dict[str, Any] = job.of_file(path, SAMPLE / "vehicle.toml", map_file=map_file).result.model_dump(mode="json")
    del told["provenance"]["input_sha256"], told["provenance"]["map_sha256"], told["log"]["path"], told["log"]["mapped"]
    return told


def mapped(clock: str, gyro: str, accelerometer: str, jet: str, units: bool = False, clock_unit: str = "s") -> str:
    """A map whose paths are named by patterns of str.format; with ``units`` it must state them."""
    text = f'schema = 1\nclock = {{ path = "{clock}", unit = "{clock_unit}" }}\n'
    for key, path, unit in (("gyro", gyro, "rad"), ("accelerometer", accelerometer, "m/s")):
        paths = [path.format(n=n, m=n + 1, axis="xyz"[n]) for n in range(3)]
        text += f'[{key}]\npaths = {paths!r}\nvalues = "increment"\n{f"unit = {unit!r}{chr(10)}" if units else ""}'.replace("'", '"')
    for name in sample():
        if name.startswith("jet_"):
            plain = name.removeprefix("jet_").removesuffix("_s")
            text += f'[jets.{plain}]\npath = "{jet.format(name=plain)}"\nunit = "s"\n'
    return text


def vectors() -> tuple[Any, Any]:
    """Increments of gyro and accelerometer, (rows, 3)."""
    held = sample()
    return tuple(np.stack([held[name] for name in names], 1) for names in (columns.DELTA_THETA, columns.DELTA_V))  # type: ignore[return-value]


def jets() -> dict[str, Any]:
    return {name.removeprefix("jet_").removesuffix("_s"): values for name, values in sample().items() if name.startswith("jet_")}


def semicolons(path: Path) -> None:
    held = sample()
    lines = [";".join(held)] + [";".join(repr(float(held[name][row])) for name in held).replace(".", ",") for row in range(ROWS)]
    path.write_bytes("\ufeff".encode() + "\r\n".join(lines).encode())


def bars(path: Path) -> None:
    held = sample()
    lines = ["|".join(held)] + ["|".join(repr(float(held[name][row])) for name in held) for row in range(ROWS)]
    path.write_text("\n".join([*lines, "|" * (len(held) - 1), ""]), encoding="utf-8")


def tabs(path: Path) -> None:
    held = sample()
    text = "\n".join(["\t".join(held)] + ["\t".join(repr(float(held[name][row])) for name in held) for row in range(ROWS)])
    path.write_bytes(text.encode("utf-16"))


def zipped(path: Path) -> None:
    held = sample()
    text = "\n".join([",".join(held)] + [",".join(repr(float(held[name][row])) for name in held) for row in range(ROWS)])
    # two members, as a logger writes that is stopped and started again
    path.write_bytes(gzip.compress(text[:5000].encode()) + gzip.compress(text[5000:].encode()))


def hdf5(path: Path) -> None:
    import h5py

    gyro, accelerometer = vectors()
    with h5py.File(path, "w") as file:
        file["clock"] = sample()["time_s"]
        file["imu/gyro"], file["imu/accelerometer"] = gyro, accelerometer.T
        file["imu/gyro"].attrs["unit"], file["imu/accelerometer"].attrs["units"] = "rad", "m/s"
        named = np.dtype([(name, "f8") for name in jets()])
        file.create_dataset("jets", data=np.array(list(zip(*jets().values(), strict=True)), named), compression="gzip")


def matlab5(path: Path) -> None:
    import scipy.io

    gyro, accelerometer = vectors()
    scipy.io.savemat(path, _matlab(gyro, accelerometer), do_compression=True)


def matlab73(path: Path) -> None:
    gyro, accelerometer = vectors()
    save_mat(path, _matlab(gyro, accelerometer))


def save_mat(path: Path, variables: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of mat-io on pandas
        import matio

        matio.save_to_mat(str(path), variables, version="v7.3")


def _matlab(gyro: Any, accelerometer: Any) -> dict[str, Any]:
    return {"t": sample()["time_s"], "imu": {"gyro": gyro, "acc": accelerometer}, "jets": jets()}


def mdf4(path: Path) -> None:
    from asammdf import MDF, Signal

    with MDF() as file:
        time_s = sample()["time_s"]
        gyro, accelerometer = vectors()
        signals = [Signal(gyro[:, n], time_s, name=f"gyro_{n}", unit="rad") for n in range(3)]
        signals += [Signal(accelerometer[:, n], time_s, name=f"acc_{n}", unit="m/s") for n in range(3)]
        file.append(signals + [Signal(values, time_s, name=name, unit="s") for name, values in jets().items()])
        file.save(path, overwrite=True)


def _stamps() -> list[int]:
    return [round(float(value) * 1e9) for value in sample()["time_s"]]


def bag2(path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    folder = path.with_suffix("")
    with Writer(folder, version=9) as bag:
        _write_bag(bag, store, store.serialize_cdr)
    next(folder.glob("*.db3")).rename(path)


def bag1(path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as bag:
        _write_bag(bag, store, store.serialize_ros1)


def _write_bag(bag: Any, store: Any, serialize: Callable[[Any, str], bytes]) -> None:
    types = store.types
    vector, multi, dimension = (
        types[f"{name}"] for name in ("geometry_msgs/msg/Vector3Stamped", "std_msgs/msg/Float64MultiArray", "std_msgs/msg/MultiArrayLayout")
    )
    header, time, three = (types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "geometry_msgs/msg/Vector3"))
    topics = {
        topic: bag.add_connection(topic, kind, typestore=store)
        for topic, kind in (("/gyro", vector.__msgtype__), ("/acc", vector.__msgtype__), ("/jets", multi.__msgtype__))
    }
    gyro, accelerometer = vectors()
    on = np.stack(list(jets().values()), 1)
    for row, stamp in enumerate(_stamps()):
        sec, nanosec = divmod(stamp, 10**9)
        for topic, values in (("/gyro", gyro), ("/acc", accelerometer)):
            extra = {"seq": row} if "seq" in header.__dataclass_fields__ else {}
            message = vector(
                header=header(stamp=time(sec=sec, nanosec=nanosec), frame_id="imu", **extra), vector=three(*map(float, values[row]))
            )
            bag.write(topics[topic], stamp + 1000, serialize(message, vector.__msgtype__))
        message = multi(layout=dimension(dim=[], data_offset=0), data=on[row])
        bag.write(topics["/jets"], stamp, serialize(message, multi.__msgtype__))


def mcap(path: Path) -> None:
    from mcap_ros2.writer import Writer

    gyro, accelerometer = vectors()
    on = np.stack(list(jets().values()), 1)
    with path.open("wb") as file:
        writer = Writer(file)
        vector = writer.register_msgdef("test_msgs/Vector", "float64 x\nfloat64 y\nfloat64 z")
        several = writer.register_msgdef("test_msgs/Several", "float64[] data")
        for row, stamp in enumerate(_stamps()):
            for topic, values in (("/gyro", gyro), ("/acc", accelerometer)):
                writer.write_message(
                    topic, vector, dict(zip("xyz", map(float, values[row]), strict=True)), log_time=stamp, publish_time=stamp
                )
            writer.write_message("/jets", several, {"data": [float(value) for value in on[row]]}, log_time=stamp, publish_time=stamp)
        writer.finish()


def json_mcap(path: Path) -> None:
    import json

    from mcap.writer import Writer

    gyro, accelerometer = vectors()
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        topics = {topic: writer.register_channel(topic, "json", 0) for topic in ("/gyro", "/acc", "/jets")}
        for row, stamp in enumerate(_stamps()):
            said = {
                "/gyro": dict(zip("xyz", gyro[row].tolist(), strict=True)),
                "/acc": dict(zip("xyz", accelerometer[row].tolist(), strict=True)),
            }
            said["/jets"] = {name: float(values[row]) for name, values in jets().items()}
            for topic, message in said.items():
                writer.add_message(topics[topic], log_time=stamp, publish_time=stamp, data=json.dumps(message).encode())
        writer.finish()


def ulog(path: Path) -> None:
    """By hand, as docs.px4.io's "ULog File Format" has it, and once through its library."""
    from pyulog import ULog

    def said(kind: str, content: bytes) -> bytes:
        return struct.pack("<Hc", len(content), kind.encode()) + content

    formats = ["imu:uint64_t timestamp;double[3] gyro_rad;double[3] acc;", f"jets:uint64_t timestamp;double[{len(jets())}] on_s;"]
    text = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + said("B", bytes(40)) + b"".join(said("F", f.encode()) for f in formats)
    for name, kind, packed in (("CA_ROTOR_COUNT", "int32_t", struct.pack("<i", 1)), ("CA_ROTOR0_CT", "float", struct.pack("<f", 1.5))):
        key = f"{kind} {name}".encode()
        text += said("P", bytes([len(key)]) + key + packed)
    for number, name in enumerate(("imu", "jets")):
        text += said("A", struct.pack("<BH", 0, number) + name.encode())
    gyro, accelerometer = vectors()
    on = np.stack(list(jets().values()), 1)
    for row, stamp in enumerate(_stamps()):
        text += said("D", struct.pack("<HQ6d", 0, stamp // 1000, *gyro[row], *accelerometer[row]))
        text += said("D", struct.pack(f"<HQ{on.shape[1]}d", 1, stamp // 1000, *on[row]))
    path.write_bytes(text)
    ULog(str(path)).write_ulog(str(path.with_suffix(".again")))
    path.with_suffix(".again").replace(path)


FORMATS: dict[str, tuple[str, Callable[[Path], None], str, str | None]] = {
    # name of the file, its writer, the extra, the map
    "semicolons, decimal commas, a mark": ("log.csv", semicolons, "", None),
    "tabs in UTF-16": ("log.tsv", tabs, "", None),
    "bars, and an empty row": ("log.csv", bars, "", None),
    "gzip": ("log.csv.gz", zipped, "", None),
    "hdf5": ("log.h5", hdf5, "hdf5", mapped("clock", "imu/gyro[:,{n}]", "imu/accelerometer[{n},:]", "jets/{name}")),
    "matlab 5": ("log.mat", matlab5, "matlab", mapped("t", "imu.gyro(:,{m})", "imu.acc(:,{m})", "jets.{name}", units=True)),
    "matlab 7.3": ("log.mat", matlab73, "matlab", mapped("t", "imu.gyro(:,{m})", "imu.acc(:,{m})", "jets.{name}", units=True)),
    "mdf4": ("log.mf4", mdf4, "mdf", mapped("time", "gyro_{n}", "acc_{n}", "{name}")),
    "mcap of ROS 2": ("log.mcap", mcap, "mcap", None),
    "mcap of JSON": ("log.mcap", json_mcap, "mcap", mapped("/gyro/@log_time", "/gyro/{axis}", "/acc/{axis}", "/jets/{name}", True, "ns")),
    "ulog": ("log.ulg", ulog, "ulog", "ulog"),
    "ROS 2 bag": ("log.db3", bag2, "ros", None),
    "ROS 1 bag": ("log.bag", bag1, "ros", None),
}
EXACT = {"gzip", "tabs in UTF-16", "bars, and an empty row", "semicolons, decimal commas, a mark", "hdf5", "matlab 5", "matlab 7.3", "mdf4"}
"""Formats whose times are numbers; of the others they are whole nanoseconds."""


def text_of(name: str) -> str | None:
    """The map of a format; of ROS messages the jets are an array's elements."""
    if name == "ulog":
        text = mapped("imu/timestamp", "imu/gyro_rad[{n}]", "imu/acc[{n}]", "jets/{name}", True, "us")
        for number, jet in enumerate(jets()):
            text = text.replace(f'"jets/{jet}"', f'"jets/on_s[{number}]"')
        return text
    if "ROS" not in name:
        return FORMATS[name][3]
    place = "" if "mcap" in name else "/vector"
    clock = "/gyro/@log_time" if "mcap" in name else "/gyro/header/stamp"
    text = mapped(clock, f"/gyro{place}/{{axis}}", f"/acc{place}/{{axis}}", "/jets/{name}", True, "ns")
    for number, jet in enumerate(jets()):
        text = text.replace(f'"/jets/{jet}"', f'"/jets/data[{number}]"')
    return text


def written(name: str, folder: Path) -> tuple[Path, Path | None]:
    """A file of a format, and its map."""
    file, write, _, _ = FORMATS[name]
    path, text = folder / file, text_of(name)
    write(path)
    if text is None:
        return path, None
    (folder / "own.toml").write_text(text)
    return path, folder / "own.toml"
