"""The docked object of results before and after docking."""

import json
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.conclude import docking
from massprop_cli.conclude.reason import Reason
from massprop_cli.testbed import output, scenario
from tests.combine.test_combine import PULSES, SAMPLES, estimated
from tests.commandline import massprop, succeeded


def test_a_docked_object_from_results_before_and_after_is_that_of_the_log(tmp_path: Path) -> None:
    estimated(SAMPLES / "docking" / "log.parquet", tmp_path / "r")
    own = json.loads((tmp_path / "r" / "result.json").read_text())["docked_object"]["estimates"]
    succeeded(tmp_path, "combine", "--before", "r", "--after", "r", "--out", "d", "-q")
    found = json.loads((tmp_path / "d" / "result.json").read_text())["docked_object"]["estimates"]
    for name in QUANTITIES:
        assert found[name]["value"] == pytest.approx(own[name]["value"], abs=1e-3 * own[name]["sigma"])
        assert found[name]["sigma"] == pytest.approx(own[name]["sigma"], rel=1e-4)


def test_sides_that_are_swapped_give_no_object(tmp_path: Path) -> None:
    estimated(SAMPLES / "docking" / "log.parquet", tmp_path / "r", "docking.before=combined", "docking.after=single")
    done = massprop(tmp_path, "combine", "--before", "r", "--after", "r", "--out", "d")
    assert done.returncode == 6, done.stderr
    assert "the vehicle of --before; check whether the two are swapped [docked-mass]" in done.stderr
    told = json.loads((tmp_path / "d" / "result.json").read_text())["docked_object"]
    assert {item["verdict"] for item in told["estimates"].values()} == {"contradicted"}
    assert "the vehicle of --after weighs less than the vehicle of --before" in told["contradiction"]


@pytest.mark.parametrize("seconds", [14, pytest.param(0, marks=pytest.mark.thorough)])
def test_the_two_body_experiment_gives_the_object_on_another_bearing(seconds: int, tmp_path: Path) -> None:
    """The thesis's proposal (5.3): the vehicle alone on one bearing, then joined with the object on one at their common CG."""
    short = (f"duration_s={seconds}", f"plan=[{PULSES.format(0, 20 * seconds)}]")
    for name in ("testbed", "testbed-joined"):
        output.simulate(scenario.load(name, short if seconds else ()), tmp_path / f"log-{name}", 5, None)
        estimated(tmp_path / f"log-{name}" / "log.parquet", tmp_path / name)
    succeeded(tmp_path, "combine", "--before", "testbed", "--after", "testbed-joined", "--out", "object", "-q")
    told = json.loads((tmp_path / "object" / "result.json").read_text())["docked_object"]["estimates"]
    truth = dict(zip(QUANTITIES, (0.5, 0.0, 0.0, 0.5, 0.0, 0.5, 0.8, 0.0, 0.0, 12.0), strict=True))
    for name, item in told.items():
        assert abs(item["value"] - truth[name]) < 4 * item["sigma"]
    assert told["mass"]["sigma"] < 0.8
    assert told["cg_x"]["sigma"] < 0.05


def test_on_a_table_the_object_has_what_its_motion_tells(tmp_path: Path) -> None:
    """m2 = m12 − m1, and its CG and yaw inertia as of two bodies in a plane."""
    alone, joined = (0.26, 0.012, -0.018, 14.0), (0.33, 0.03, -0.01, 16.0)
    for name, (izz, x, y, mass) in (("alone", alone), ("joined", joined)):
        body = (f"truth.izz={izz}", f"truth.cg_x={x}", f"truth.cg_y={y}", f"truth.mass={mass}")
        output.simulate(scenario.load("planar", body), tmp_path / f"log-{name}", 5, None)
        estimated(tmp_path / f"log-{name}" / "log.parquet", tmp_path / name)
    succeeded(tmp_path, "combine", "--before", "alone", "--after", "joined", "--out", "object", "-q")
    told = json.loads((tmp_path / "object" / "result.json").read_text())["docked_object"]["estimates"]
    cg = [(16.0 * b - 14.0 * a) / 2.0 for a, b in zip(alone[1:3], joined[1:3], strict=True)]
    apart = (
        [(a - c) ** 2 for a, c in zip(alone[1:3], joined[1:3], strict=True)],
        [(a - c) ** 2 for a, c in zip(cg, joined[1:3], strict=True)],
    )
    truth = {"izz": 0.33 - 0.26 - 14.0 * sum(apart[0]) - 2.0 * sum(apart[1]), "cg_x": cg[0], "cg_y": cg[1], "mass": 2.0}
    for name, item in told.items():
        if name in truth:
            assert abs(item["value"] - truth[name]) < 4 * item["sigma"]
        else:
            assert (item["value"], item["sigma"], item["verdict"]) == (None, None, "unobservable")


def test_an_object_of_which_a_part_is_untold_has_no_value_that_converged() -> None:
    """As on pedestals whose masses nobody weighed."""
    none = np.full(10, np.nan)
    told = docking.docked_estimates(none, np.full((10, 10), np.nan), "converged", Reason("sides-converged"), np.zeros(10, dtype=bool))
    assert {(one.value, one.verdict, one.reason.code) for one in told.values()} == {(None, "unobservable", "sides-untold")}
