"""What the length of a log costs the process that estimates it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from massprop_cli.testbed import output, scenario, simulate

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


def flown(cycles: int, folder: Path) -> Path:
    """A free flyer that does the packaged plan once and then drifts."""
    source = scenario.load("free-flyer")
    longer = source.scenario.model_copy(update={"duration_s": None, "duration_cycles": cycles})
    output.write(simulate.fly(scenario.ScenarioSource(longer, source.source), [1]), 0, longer, folder)
    return folder / "log.parquet"


def peak(log: Path) -> int:
    """Largest resident set of ``massprop estimate``, bytes."""
    command = [sys.executable, "-m", "massprop_cli", "estimate", str(log), "--out", str(log.parent / "out"), "-q"]
    done = subprocess.run([sys.executable, "-I", "-c", MEASURED, *command], capture_output=True, text=True, check=True)
    return 1024 * int(done.stdout)


@pytest.mark.slow
def test_a_log_three_times_as_long_takes_little_more_memory(tmp_path: Path) -> None:
    short, long = (peak(flown(cycles, tmp_path / str(cycles))) for cycles in (8_000, 24_000))
    assert long - short < PER_CYCLE * 16_000
    assert long < 300e6
