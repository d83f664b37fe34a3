"""Recordings in memory of streams with clocks of their own, and the map that names them."""

from pathlib import Path

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.formats import mapfile, mapped
from massprop_cli.inputs.formats.recording import Numbers, Recording, stream
from massprop_cli.inputs.tablefile import Table

WRENCH_MAP = """
schema = 1
[gyro]
paths = "imu/w?"
values = "sample"
[accelerometer]
paths = "imu/a?"
values = "sample"
[torque]
paths = "cmd/t?"
[force]
paths = "cmd/f?"
"""
SIX = [(kind, axis, unit) for kind, unit in (("t", "N m"), ("f", "N")) for axis in "xyz"]
RECORDS = "[records]\ninterval_s = 0.01\nper_cycle = 5\n"


def recording(streams: dict[str, tuple[Numbers, str, str]]) -> Recording:
    """A recording in memory: values, clock and unit by path."""
    return Recording(Path("x.h5"), "0", "recording", {path: stream(path, *said) for path, said in streams.items()})


def made(streams: dict[str, tuple[Numbers, str, str]], text: str) -> Table:
    return mapped.of(recording(streams), mapfile.parse(text, "m.toml"))


def values(table: Table, names: tuple[str, ...]) -> Array:
    return np.stack([table.columns[name].numbers() for name in names], 1)


def motion(
    seconds: float = 20.0, imu_hz: float = 200.0, command_hz: float = 20.0, begin: float = 0.0
) -> dict[str, tuple[Numbers, str, str]]:
    """Rates and forces of sines, commands of steps, each with a clock of its own."""
    t = begin + np.arange(round(seconds * imu_hz)) / imu_hz
    late = begin + 0.0013 + np.arange(round(seconds * imu_hz / 2)) / imu_hz * 2
    issued = begin + 0.0207 + np.arange(round(seconds * command_hz)) / command_hz
    steps = np.random.default_rng(3).normal(size=(6, len(issued)))
    streams = {"imu/t": (t, "", "s"), "acc/t": (late, "", "s"), "cmd/t": (issued, "", "s")}
    streams |= {f"imu/w{axis}": (np.sin((n + 1) * t), "imu/t", "rad/s") for n, axis in enumerate("xyz")}
    streams |= {f"imu/a{axis}": (np.cos((n + 1) * late), "acc/t", "m/s^2") for n, axis in enumerate("xyz")}
    streams |= {f"cmd/{kind}{axis}": (steps[n], "cmd/t", unit) for n, (kind, axis, unit) in enumerate(SIX)}
    return streams
