"""What the length of a log costs the process that estimates it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from massprop_cli.testbed import output, scenario, simulate

PER_CYCLE = 1500
"""Bytes of resident memory that another control cycle may take: the log's own row and that of its history are some 600.

What is worked on at once is the same for both lengths.
"""


def flown(cycles: int, folder: Path) -> Path:
    """A free flyer that does the packaged plan once and then drifts."""
    source = scenario.load("free-flyer")
    longer = source.scenario.model_copy(update={"duration_s": None, "duration_cycles": cycles})
    output.write(simulate.fly(scenario.ScenarioSource(longer, source.source), [1]), 0, longer, folder)
    return folder / "log.parquet"


def peak(log: Path) -> int:
    """Largest resident set of ``massprop estimate``, bytes."""
    process = subprocess.Popen([sys.executable, "-m", "massprop_cli", "estimate", str(log), "--out", str(log.parent / "out"), "-q"])
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return used.ru_maxrss * 1024


@pytest.mark.thorough
def test_a_log_three_times_as_long_takes_little_more_memory(tmp_path: Path) -> None:
    short, long = (peak(flown(cycles, tmp_path / str(cycles))) for cycles in (8_000, 24_000))
    assert long - short < PER_CYCLE * 16_000
    assert long < 300e6
