"""Wheels and gyros from end to end: every file of a result is written, with on-times of jets alone, and a report is drawn of it."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from massprop_cli import QUANTITIES
from tests.commandline import massprop, succeeded

PULSES = '{{motion="random", axes=[{}], every_cycles=5, max_cycles=4, start_s={}, end_s={}}}'
TURNS, PUSHES = '"roll", "pitch", "yaw"', '"x", "y", "z"'
SHORT = {"wheels": [(TURNS, 0, 12)], "wheels-and-jets": [(TURNS, 0, 6), (PUSHES, 6, 12)], "control-moment-gyros": [(TURNS, 0, 12)]}


@pytest.mark.parametrize(
    ("name", "jets", "whole"),
    [
        *(("wheels", 0, False), ("control-moment-gyros", 0, False)),
        pytest.param("wheels-and-jets", 18, True, marks=[pytest.mark.thorough, pytest.mark.seeds]),
    ],
)
def test_a_flight_with_wheels_is_estimated_and_reported(name: str, jets: int, whole: bool, tmp_path: Path) -> None:
    flight, found = tmp_path / "flight", tmp_path / "found"
    plan = f"plan=[{', '.join(PULSES.format(*pulses) for pulses in SHORT[name])}]"
    settings = () if whole else ("--set", "duration_s=12.0", "--set", plan)
    assert massprop(tmp_path, "simulate", name, *settings, "--out", flight).returncode == 0
    succeeded(tmp_path, "estimate", flight / "log.parquet", "--out", found)
    result = json.loads((found / "result.json").read_text())
    (truth,) = json.loads((flight / "truth.json").read_text())["phases"]
    told = {key: one for key, one in result["phases"][0]["estimates"].items() if one["verdict"] == "converged"}
    assert len(told) >= 6
    for key, one in told.items():
        assert abs(one["value"] - truth[key]) < 4 * one["sigma"], key
    history = pq.read_table(found / "history.parquet")
    assert sum(column.startswith("executed_") for column in history.column_names) == jets
    for key in set(QUANTITIES) & set(told):
        assert history[key][-1].as_py() == pytest.approx(told[key]["value"], abs=told[key]["sigma"])
    kind = "html" if whole else "md"
    assert massprop(tmp_path, "report", found, "--format", kind).returncode == 0
    said = "by the momentum stored in" if whole else "gyros" if name == "control-moment-gyros" else "wheel"
    assert said in (found / f"report.{kind}").read_text()
