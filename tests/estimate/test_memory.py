"""What the length of a log costs the process that estimates it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from massprop_cli.inputs import vehiclefile
from tests.analysed import SAMPLES

PER_CYCLE = 2500
"""Bytes of resident memory that another control cycle may take: the log's own row and that of its history are some 1,500.

What is worked on at once is the same for both lengths.
"""


MEASURED = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:])
_, status, used = os.wait4(process.pid, 0)
print(used.ru_maxrss, flush=True)
os._exit(os.waitstatus_to_exitcode(status))
"""
"""A small process between: what a process is begun from counts as its own largest, and this one's tests hold much."""


def drifting(cycles: int, folder: Path) -> Path:
    """The free flyer's sample log, which begins at rest, after a drift that makes it this long."""
    flown = pyarrow.parquet.read_table(SAMPLES / "free-flyer" / "log.parquet")
    imu = vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml").vehicle.imu
    rng, before = np.random.default_rng(1), cycles - flown.num_rows
    noise = {"delta_theta": imu.gyro_noise_rad_s, "delta_v": imu.accel_noise_m_s2}
    columns = {}
    for name in flown.column_names:
        sigma = next((0.05 * (level or 0.0) for kind, level in noise.items() if name.startswith(kind)), 0.0)
        columns[name] = np.concatenate([sigma * rng.standard_normal(before), flown[name].to_numpy()])
    columns["time_s"] = np.round(0.05 * np.arange(1, cycles + 1), 9)
    folder.mkdir()
    pyarrow.parquet.write_table(pyarrow.table(columns), folder / "log.parquet")
    shutil.copy(SAMPLES / "free-flyer" / "vehicle.toml", folder)
    return folder / "log.parquet"


def peak(log: Path) -> int:
    """Largest resident set of ``massprop estimate``, bytes."""
    command = [sys.executable, "-m", "massprop_cli", "estimate", str(log), "--out", str(log.parent / "out"), "-q"]
    done = subprocess.run([sys.executable, "-I", "-c", MEASURED, *command], capture_output=True, text=True, check=True)
    return 1024 * int(done.stdout)


@pytest.mark.seeds
@pytest.mark.slow
def test_a_log_two_and_a_half_times_as_long_takes_little_more_memory(tmp_path: Path) -> None:
    short, long = (peak(drifting(cycles, tmp_path / str(cycles))) for cycles in (8_000, 20_000))
    assert long - short < PER_CYCLE * 12_000
    assert long < 300e6
