"""Inputs that would hurt: by the name under which docs/limits.md has each, what makes it and the command line that is given it."""

import os
import re
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.commandline import STDIN

SAMPLE = Path(__file__).parent.parent / "sample_logs" / "free-flyer"
ESCAPES = "\x1b[31m\x9b1m\u202egnp.exe"
"""Colours, by seven and by eight bits, and letters that run from right to left."""
Hostile = Callable[[Path], list[str]]


def flight(rows: int = 60) -> Any:
    return pq.read_table(SAMPLE / "log.parquet").slice(0, rows).replace_schema_metadata()


def vehicle(folder: Path, text: str = "", old: str = "", new: str = "") -> Path:
    """The sample's vehicle file, with a change, and text before its first table."""
    whole = (SAMPLE / "vehicle.toml").read_text(encoding="utf-8")
    file = folder / "vehicle.toml"
    file.write_text(text + (whole.replace(old, new, 1) if old else whole), encoding="utf-8")
    return file


def estimate(folder: Path, log: str = "log.parquet") -> list[str]:
    return ["estimate", str(folder / log), "--out", str(folder / "out")]


def toml(text: str) -> Hostile:
    def make(folder: Path) -> list[str]:
        pq.write_table(flight(), folder / "log.parquet")
        vehicle(folder, text + "\n")
        return estimate(folder)

    return make


def replaced(old: str, new: str) -> Hostile:
    def make(folder: Path) -> list[str]:
        pq.write_table(flight(), folder / "log.parquet")
        vehicle(folder, old=old, new=new)
        return estimate(folder)

    return make


def table(made: Callable[[], Any], **options: Any) -> Hostile:
    def make(folder: Path) -> list[str]:
        vehicle(folder)
        pq.write_table(made(), folder / "log.parquet", **options)
        return estimate(folder)

    return make


def _with(values: Any) -> Any:
    return flight(len(values)).append_column("event", values)


def with_column(values: Callable[[], Any], **options: Any) -> Hostile:
    return table(lambda: _with(values()), **options)


def csv(text: Callable[[str], str]) -> Hostile:
    """A good log as CSV, changed."""

    def make(folder: Path) -> list[str]:
        vehicle(folder)
        good = flight()
        rows = zip(*(column.to_pylist() for column in good.columns), strict=True)
        lines = [",".join(good.column_names), *(",".join("" if cell is None else repr(cell) for cell in row) for row in rows)]
        (folder / "log.csv").write_bytes(text("\n".join(lines) + "\n").encode())
        return estimate(folder, "log.csv")

    return make


def zeros(rows: int) -> Any:
    return pa.table({name: pa.repeat(0.0, rows) for name in flight().column_names[:7]})


def of_file(name: str, make: Callable[[Path], object]) -> Hostile:
    def made(folder: Path) -> list[str]:
        vehicle(folder)
        make(folder / name)
        return estimate(folder, name)

    return made


def _socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(path.name)
    os.chdir(here)


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(3 * 2**30)


def _fifo_in_campaign(folder: Path) -> list[str]:
    (folder / "logs").mkdir()
    os.mkfifo(folder / "logs" / "log.csv")
    return ["batch", str(folder / "logs"), "--out", str(folder / "out"), "--jobs", "1"]


def _result(text: str) -> Hostile:
    def make(folder: Path) -> list[str]:
        (folder / "result").mkdir()
        (folder / "result" / "result.json").write_text(text, encoding="utf-8")
        return ["compare", str(folder / "result"), str(folder / "result")]

    return make


def _footer() -> bytes:
    """A footer of 2 MB that says 700,000 times that there is a column chunk, in three bytes each (Thrift's compact protocol)."""

    def many(number: int) -> bytes:
        return bytes([0xFC, number & 127 | 128, number >> 7 & 127 | 128, number >> 14])

    schema = b"\x2c\x48\x04root\x15\x02\x00\x15\x0a\x25\x00\x18\x01a\x00"
    group = b"\x19" + many(2**14) + 2**14 * b"\x26\x00\x00" + b"\x16\x00\x16\x00\x00"
    footer = b"\x15\x02\x19" + schema + b"\x16\x00\x19" + many(42) + 42 * group + b"\x00"
    return b"PAR1" + footer + len(footer).to_bytes(4, "little") + b"PAR1"


def _kept(name: str) -> Callable[[Path], object]:
    """What a fuzzer found (tests/corpus), of a MATLAB file."""

    def write(path: Path) -> None:
        import h5py  # noqa: F401  without it nothing is read that could crash

        path.write_bytes((Path(__file__).parent / "corpus" / "recording" / name).read_bytes()[1:])

    return write


def packed_chunk(unpacked: int, said: int) -> bytes:
    """An MCAP file with one chunk of zeros in zstd, of which its header says that they are fewer."""
    import zstandard

    def record(kind: int, content: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(content)) + content

    pack = zstandard.ZstdCompressor().compressobj(size=unpacked)
    data = b"".join(pack.compress(bytes(2**24)) for _ in range(unpacked // 2**24)) + pack.flush()
    chunk = struct.pack("<QQQII", 0, 1, said, 0, 4) + b"zstd" + struct.pack("<Q", len(data)) + data
    begin, end = b"\x89MCAP0\r\n", record(15, bytes(4)) + record(2, bytes(20))
    return begin + record(1, bytes(8)) + record(6, chunk) + end + begin


def _hdf5(path: Path, columns: int = 1, rows: int = 1) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for number in range(columns):
            file.create_dataset(
                f"{'a' * 150}{number}", (rows,), "f8", chunks=(1,) if rows > 1 else None, compression="gzip" if rows > 1 else None
            )


def mapped(text: str) -> Hostile:
    """A recording with one stream, and a map."""

    def make(folder: Path) -> list[str]:
        vehicle(folder)
        _hdf5(folder / "log.h5")
        (folder / "map.toml").write_text(text, encoding="utf-8")
        return estimate(folder, "log.h5")

    return make


def planned(guess: str) -> Hostile:
    def make(folder: Path) -> list[str]:
        vehicle(folder)
        (folder / "guess.toml").write_text(guess, encoding="utf-8")
        line = ["plan", "--vehicle", str(folder / "vehicle.toml"), "--want", "mass 2 %", "--guess", str(folder / "guess.toml")]
        return [*line, "--out", str(folder / "out")]

    return make


def inspected(name: str, make: Callable[[Path], object]) -> Hostile:
    def made(folder: Path) -> list[str]:
        make(folder / name)
        return ["columns", str(folder / name)]

    return made


def _shifted(seconds: float, rows: slice) -> Callable[[], Any]:
    """A good log in some of whose rows the clock is that much ahead."""

    def make() -> Any:
        good = flight()
        time_s = good.column("time_s").to_numpy().copy()
        time_s[rows] += seconds
        return good.set_column(good.column_names.index("time_s"), "time_s", pa.array(time_s))

    return make


def live(text: Callable[[str], str]) -> Hostile:
    """A good log on standard input, changed."""

    def make(folder: Path) -> list[str]:
        csv(text)(folder)
        (folder / "log.csv").rename(folder / STDIN)
        return ["live", "--vehicle", str(folder / "vehicle.toml"), "--out", str(folder / "out")]

    return make


def asked(*line: str, with_log: bool = False) -> Hostile:
    """A command about a vehicle file of 2 MB."""

    def make(folder: Path) -> list[str]:
        file = vehicle(folder, "#" * 2**21 + "\n")
        if with_log:
            pq.write_table(flight(), folder / "log.parquet")
        log = [str(folder / "log.parquet")] if with_log else []
        out = [] if line[0] == "check" else ["--out", str(folder / "out")]
        return [line[0], *log, "--vehicle", str(file), *line[1:], *out]

    return make


def _combined(folder: Path) -> list[str]:
    compared = _result("[" * 100_000)(folder)[1:]
    (folder / "other").mkdir()
    (folder / "other" / "result.json").write_text("{}", encoding="utf-8")
    return ["combine", compared[0], str(folder / "other"), "--out", str(folder / "out")]


PATTERN = (
    "schema = 1\n"
    + "".join(
        f'[{key}]\npaths = "{"**a" * 40}b"\nunit = "{unit}"\nvalues = "mean"\n' for key, unit in (("gyro", "rad/s"), ("accelerometer", "g"))
    )
    + '[jets.roll_p1]\npath = "a"\n'
)
_GOOD = (Path(__file__).parent / "corpus" / "result" / "good").read_text(encoding="utf-8")
KEYS = ".".join(["a"] * 100_000)
LONG = 10_000_000 * "x"
INPUTS: dict[str, Hostile] = {
    "a pipe": of_file("log.csv", os.mkfifo),
    "a device": of_file("log.csv", lambda path: path.symlink_to("/dev/zero")),
    "a socket": of_file("log.csv", _socket),
    "a pipe in a campaign folder": _fifo_in_campaign,
    "a file of 3 GB": of_file("log.csv", _sparse),
    "a vehicle file of 2 MB": toml("#" * 2**21),
    "Parquet: 100 million truth values": table(lambda: pa.table({"time_s": pa.repeat(False, 100_000_000)})),
    "Parquet: 5,000 columns": table(lambda: pa.table({f"c{n}": [0.0] for n in range(5_000)})),
    "Parquet: 4,000 row groups": table(lambda: zeros(4_000), row_group_size=1),
    "Parquet: 700,000 empty column chunks": of_file("log.parquet", lambda path: path.write_bytes(_footer())),
    "Parquet: 60 texts of 10 MB, one page": with_column(
        lambda: pa.repeat(LONG, 60), use_dictionary=False, compression="zstd", compression_level=1, write_statistics=False
    ),
    "Parquet: texts told by their beginnings": with_column(
        lambda: pa.array(["x"] * 100), use_dictionary=False, column_encoding={"event": "DELTA_BYTE_ARRAY"}
    ),
    "Parquet: lists of 700,000": with_column(
        lambda: pa.ListArray.from_arrays(700_000 * np.arange(101, dtype=np.int32), pa.nulls(70_000_000, pa.int8())), write_statistics=False
    ),
    "Parquet: values of 10 MB": with_column(lambda: pa.array([bytes(10_000_000)] * 60, pa.binary(10_000_000)), write_statistics=False),
    "Parquet: metadata of 3 MB": table(lambda: flight().replace_schema_metadata({"massprop.vehicle": "#" * 3_000_000})),
    "CSV: 100,000 columns": csv(lambda _: "\n".join([",".join(f"c{n}" for n in range(100_000)), ",".join(["0"] * 100_000)])),
    "CSV: 70 million cells": csv(lambda _: ",".join(f"c{n}" for n in range(1000)) + "\n" + "0\n" * 70_000),
    "CSV: a header that is no header": csv(lambda text: '"' + 200_000 * "x" + "," + text),
    "CSV: a cell of 1 MB": csv(lambda text: text.replace("0.05", 1_000_000 * "x", 1)),
    "HDF5: 100 million numbers, none stored": of_file("log.h5", lambda path: _hdf5(path, rows=100_000_000)),
    "MATLAB: a file at which its reader crashes": of_file("log.mat", _kept("matlab-that-crashes")),
    "MCAP: 33 kB that become 1 GB": of_file("log.mcap", lambda path: path.write_bytes(packed_chunk(2**30, 1000))),
    "a recording for columns that is a pipe": inspected("log.h5", os.mkfifo),
    "a map with a pattern of 40 stars": mapped(PATTERN),
    "a map of 2 MB": mapped("#" * 2**21),
    "a map nested 100 deep": mapped("a = " + "{a = " * 100 + "1" + "}" * 100),
    "a guess with a key of 1 MB": planned("k" * 1_000_000 + " = 1"),
    "TOML: a key of 100,000 parts": toml(f"{KEYS} = 1"),
    "TOML: a table of 100,000 parts": toml(f"[{KEYS}]"),
    "TOML: a quoted key of 100,000 parts": toml(KEYS.replace("a", '"a"') + " = 1"),
    "TOML: tables nested 100 deep": toml("a = " + "{a = " * 100 + "1" + "}" * 100),
    "TOML: lists nested 100,000 deep": toml("a = " + "[" * 100_000 + "]" * 100_000),
    "TOML: a key of 1 MB": toml("k" * 1_000_000 + " = 1"),
    "TOML: a text of 100 kB": replaced('name = "free-flyer"', 'name = "' + 100_000 * "x" + '"'),
    "TOML: 1,000 phases": toml("phases = [" + 1000 * '{name = "p", start_s = 0.0, end_s = 1.0},' + "]\n"),
    "JSON: lists nested 100,000 deep": _result("[" * 100_000),
    "JSON, in combine: the same": _combined,
    "JSON: a number of 1e308": _result(re.sub(r'"duration_s": ?[\d.]+', '"duration_s": 1e308', _GOOD)),
    "two phases that overlap": toml('phases = [{name = "a", start_s = 0.0, end_s = 2.0}, {name = "b", start_s = 1.0, end_s = 3.0}]'),
    "a clock of whole numbers of 19 digits": table(
        lambda: flight().set_column(0, "time_s", pa.array(4 * 10**18 + np.arange(60, dtype=np.int64)))
    ),
    "a trillion seeds": lambda folder: ["simulate", "free-flyer", "--seeds", "1000000000000", "--out", str(folder / "out")],
    "a clock set back": table(_shifted(3600.0, slice(30))),
    "a clock that counts from far away": table(_shifted(1e12, slice(None))),
    "CSV: decimal commas between commas": csv(lambda text: text.replace("0.0,", "0,0,", 1)),
    "live: lines cut by semicolons": live(lambda text: text.replace(",", ";")),
    "live: a column twice": live(lambda text: text.replace("delta_theta_y_rad", "delta_theta_x_rad", 1)),
    "live: a header of 2 MB": live(lambda text: 2_000_000 * "x" + text),
    "live: 5,000 columns": live(lambda text: "".join(f"c{n}," for n in range(5_000)) + text),
    "plan: a vehicle file of 2 MB": asked("plan", "--want", "mass 2 %"),
    "check: the same": asked("check", with_log=True),
    "export-flight: the same": asked("export-flight"),
    "a noise of 1e-320": replaced("gyro_noise_rad_s = 0.0001", "gyro_noise_rad_s = 1e-320"),
    "an IMU at 1e20 m": replaced("position_m = [0.1", "position_m = [1e20"),
}
"""By the name in docs/limits.md."""
