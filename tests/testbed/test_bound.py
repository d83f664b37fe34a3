"""The Cramér–Rao bound against the bounds that came with the logs of another engine."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import read
from massprop_cli.testbed import bound, simulate
from massprop_cli.testbed.scenario import Scenario, ScenarioSource

SAMPLES = Path(__file__).parents[2] / "sample_logs"


@pytest.mark.parametrize(
    "name",
    ["air-bearing", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("high-rate", "free-flyer", "docking"))],
)
def test_the_bound_of_a_sample_log_is_the_one_recorded_with_it(name: str) -> None:
    """Those were made from the sensitivities of another forward model (sample_logs/README.md)."""
    recorded = json.loads((SAMPLES / name / "truth.json").read_text())
    used = vehiclefile.load(SAMPLES / name / "vehicle.toml").vehicle
    log = read(read_table(SAMPLES / name / "log.parquet"), used)
    data = {"schema": 1, "duration_cycles": len(log.command), "vehicle": used, "truth": recorded["phases"][0]}
    data["sensors"] = {"records_per_cycle": log.records_per_cycle}
    if "docked" in recorded:
        data |= {"docked": recorded["docked"], "events": [{"kind": "dock", "at_s": 25.0, "motion": "rates_kept"}]}
    source = ScenarioSource(Scenario.model_validate(data), name)
    flown = simulate.fly(source, [1], issued=log.command)
    for covariance, expected in zip(bound.cramer_rao(source, flown, 0), recorded["bound"], strict=True):
        ratio = np.sqrt(np.diag(covariance)) / [expected[quantity] for quantity in QUANTITIES]
        assert np.abs(ratio - 1).max() < 0.005
