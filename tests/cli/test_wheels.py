"""Wheels and gyros from end to end: every file of a result is written, with on-times of jets alone, and a report is drawn of it."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from massprop_cli import QUANTITIES
from tests.commandline import massprop


@pytest.mark.parametrize(("name", "jets"), [("wheels", 0), ("wheels-and-jets", 18), ("control-moment-gyros", 0)])
def test_a_flight_with_wheels_is_estimated_and_reported(name: str, jets: int, tmp_path: Path) -> None:
    flight, found = tmp_path / "flight", tmp_path / "found"
    assert massprop(tmp_path, "simulate", name, "--out", str(flight)).returncode == 0
    run = massprop(tmp_path, "estimate", str(flight / "log.parquet"), "--out", str(found))
    assert run.returncode == 0, run.stderr
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
    assert massprop(tmp_path, "report", str(found)).returncode == 0
    assert "by the momentum stored in" in (found / "report.html").read_text()
