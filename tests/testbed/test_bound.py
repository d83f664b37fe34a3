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
from tests import cramerrao, flight

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def test_the_bound_of_one_push_and_of_one_turn_is_that_of_the_closed_form() -> None:
    """Through a CG where the IMU is, and about an axis: m = F / a from K means of a, and I = τ t / ω beside an unknown rate at the start.

    An increment of angle over a cycle is the mean rate, of τ (t − T / 2) / I.
    """
    body = {"ixx": 0.5, "iyy": 2.0, "izz": 2.2, "mass": 22.0}
    used = flight.vehicle(delay=0.0, imu={"position_m": [0.0, 0.0, 0.0]}, jets=flight.jets(rise_s=0.0))
    cycles, names = 60, [jet.name for jet in used.jets]
    issued = np.zeros((2, cycles, len(names)))
    issued[0, :, names.index("divert_xp")] = flight.CYCLE
    issued[1][:, [names.index("couple_xp1"), names.index("couple_xp2")]] = flight.CYCLE
    source = ScenarioSource(Scenario.model_validate({"schema": 1, "duration_cycles": cycles, "vehicle": used, "truth": body}), "closed")
    told = bound.information(source, issued, np.tile([body.get(name, 0.0) for name in QUANTITIES], (2, 1))).sum(1)
    sizes = bound.natural_sizes(np.array([body.get(name, 0.0) for name in QUANTITIES]))
    force, torque = (used.jet_wrench * issued[i, 0][:, None] / flight.CYCLE for i in range(2))
    mass = force[:, 3].sum() / 22.0**2 / 0.02 * np.sqrt(cycles)
    assert np.sqrt(told[0, 9, 9]) / sizes[9] == pytest.approx(mass, rel=1e-6)
    middle = flight.CYCLE * (np.arange(cycles) + 0.5)
    slopes = np.array([-torque[:, 0].sum() * middle / 0.5**2, np.ones(cycles)]) / 1e-4
    found = told[1][np.ix_([0, 10], [0, 10])] / np.outer([sizes[0], 1], [sizes[0], 1])
    assert found == pytest.approx(slopes @ slopes.T, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["air-bearing", pytest.param("docking", marks=pytest.mark.seeds)])
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
    for covariance, expected in zip(cramerrao.cramer_rao(source, flown, 0), recorded["bound"], strict=True):
        ratio = np.sqrt(np.diag(covariance)) / [expected[quantity] for quantity in QUANTITIES]
        assert np.abs(ratio - 1).max() < 0.005
