"""The docked object of results before and after docking."""

import json
from pathlib import Path

import pytest

from massprop_cli import QUANTITIES
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
    assert "what --before names; were the two swapped? [docked-mass]" in done.stderr
    told = json.loads((tmp_path / "d" / "result.json").read_text())["docked_object"]
    assert {item["verdict"] for item in told["estimates"].values()} == {"contradicted"}
    assert "what --after names weighs less than what --before names" in told["contradiction"]


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
