"""``massprop predict``: pairs of flights of one vehicle, results that are off, what it refuses, and how it ends."""

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from massprop_cli import schemas
from massprop_cli.cli import app
from massprop_cli.testbed import output, scenario, simulate
from tests.commandline import massprop

KINDS = ("free-flyer", "testbed", "wheels", "pedestal", "planar")


def record(folder: Path, kind: str, seed: int, *settings: str, count: int = 1) -> list[Path]:
    """Logs of a packaged scenario, in ``KIND-SEED`` and with other settings in others."""
    source, more = scenario.load(kind, settings), "-".join(["", *settings]).replace("=", "_")
    flight, found = simulate.fly(source, range(seed, seed + count)), []
    for member in range(count):
        found.append(folder / f"{kind}-{seed + member}{more}" / "log.parquet")
        output.write(flight, member, source.scenario, found[-1].parent)
    return found


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("lab")


def stocked(folder: Path, kind: str) -> None:
    """Logs of a kind, four of the free flyer, and the result of the first."""
    if not (folder / kind).exists():
        log, *_ = record(folder, kind, 1, count=4 if kind == "free-flyer" else 2)
        assert massprop(folder, "estimate", log, "-q", "--out", kind).returncode == 0


def ran(folder: Path, *arguments: str) -> Result:
    """``massprop predict`` in this process."""
    for kind in KINDS:
        if any(one.startswith(kind) for one in arguments):
            stocked(folder, kind)
    with contextlib.chdir(folder):
        return CliRunner().invoke(app, ["predict", *arguments])


def told(done: Result, code: int = 0) -> dict[str, Any]:
    assert done.exit_code == code, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    jsonschema.validate(found, schemas.schema("predict"))
    return found


def refused(done: Result) -> str:
    assert done.exit_code == 3, done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    return done.stderr


def edited(lab: Path, kind: str, change: Callable[[dict[str, Any]], None]) -> str:
    """A folder with the result of a kind, changed."""
    stocked(lab, kind)
    data = json.loads((lab / kind / "result.json").read_text(encoding="utf-8"))
    change(data)
    folder = lab / f"{kind}-edited"
    folder.mkdir(exist_ok=True)
    (folder / "result.json").write_text(json.dumps(data), encoding="utf-8")
    return folder.name


def off(name: str, sigmas: float, about: str = "estimates") -> Callable[[dict[str, Any]], None]:
    """One value moved by so many of its sigmas."""

    def change(data: dict[str, Any]) -> None:
        item = data["phases"][0][about][name]
        item["value"] += sigmas * item["sigma"]

    return change


@pytest.mark.parametrize(
    "kind", ["free-flyer", *(pytest.param(kind, marks=pytest.mark.thorough) for kind in ("pedestal", "testbed", "wheels", "planar"))]
)
def test_a_result_predicts_another_log_of_its_vehicle(lab: Path, kind: str) -> None:
    found = told(ran(lab, kind, f"{kind}-2/log.parquet", "--json"))
    assert found["test"]["passes"]
    assert found["test"]["freedom"] == {"planar": 4, "pedestal": 9, "wheels": 9}.get(kind, 10)
    whole = {one["channel"]: one for one in found["motion"] if one["manoeuvre"] == "all"}
    assert len(whole) == 6
    assert whole["rate_z"]["result"]["percent"] > 99.99
    for one in whole.values():
        assert one["result"]["mean_square"] == pytest.approx(1.0, abs=0.2)
        assert one["log"]["residual_rms"] == pytest.approx(one["log"]["expected_rms"], rel=0.1)
        parts = [each for each in found["motion"] if each["channel"] == one["channel"] and each["manoeuvre"] != "all"]
        assert sum(each["cycles"] for each in parts) == one["cycles"]
        power = sum(each["cycles"] * each["result"]["residual_rms"] ** 2 for each in parts)
        assert power == pytest.approx(one["cycles"] * one["result"]["residual_rms"] ** 2)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("free-flyer", "iyy"),
        ("free-flyer", "cg_z"),
        *(pytest.param(*one, marks=pytest.mark.thorough) for one in (("testbed", "ixx"), ("planar", "izz"))),
    ],
)
def test_a_result_that_is_off_does_not(lab: Path, kind: str, name: str) -> None:
    done = ran(lab, edited(lab, kind, off(name, 12)), f"{kind}-2/log.parquet", "--json")
    found = told(done, 5)
    assert not found["test"]["passes"]
    assert f"{kind}-edited/result.json does not predict {kind}-2/log.parquet: chi-square " in done.stderr


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_first_moment_that_is_off_does_not(lab: Path) -> None:
    found = told(ran(lab, edited(lab, "pedestal", off("moment_x", 8, "about_pivot")), "pedestal-2/log.parquet", "--json"), 5)
    one = found["quantities"]["moment_x"]
    assert one["difference"] > 3 * one["difference_sigma"]


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_body_that_has_changed_is_not_predicted(lab: Path) -> None:
    """Half a per cent of the inertia, thirty of its sigmas: the rate is off by as much of the motion, and by many times the noise."""
    stocked(lab, "free-flyer")
    truth = json.loads((lab / "free-flyer-1" / "truth.json").read_text(encoding="utf-8"))
    izz = truth["phases"][0]["izz"] if "phases" in truth else truth["izz"]
    izz = izz["value"] if isinstance(izz, dict) else izz
    (log,) = record(lab, "free-flyer", 2, f"truth.izz={1.005 * izz}")
    found = told(ran(lab, "free-flyer", str(log), "--json"), 5)
    (yaw,) = [one for one in found["motion"] if (one["channel"], one["manoeuvre"]) == ("rate_z", "torque_z")]
    assert yaw["result"]["mean_square"] > 4
    assert yaw["log"]["mean_square"] == pytest.approx(1.0, abs=0.4)
    assert yaw["result"]["residual_rms"] > 2 * yaw["log"]["residual_rms"]


@pytest.mark.thorough
def test_a_scale_that_both_logs_share_predicts_nothing(lab: Path) -> None:
    """The thrust is known to 2 %, and alike in both: inertia that is 1 % off is not within what one log's noise allows."""
    stocked(lab, "free-flyer")
    scaled = (lab / "free-flyer-1" / "vehicle.toml").read_text(encoding="utf-8") + "\n[thrust]\nscale_sigma = 0.02\n"
    (lab / "scaled.toml").write_text(scaled, encoding="utf-8")
    assert massprop(lab, "estimate", "free-flyer-1/log.parquet", "--vehicle", "scaled.toml", "-q", "--out", "scaled").returncode == 0
    other = ("free-flyer-2/log.parquet", "--vehicle", "scaled.toml")
    found = told(ran(lab, "scaled", *other, "--json"))
    one = found["quantities"]["iyy"]
    assert one["difference_sigma"] < 0.02 * one["result_sigma"]
    (lab / "off").mkdir()
    data = json.loads((lab / "scaled" / "result.json").read_text(encoding="utf-8"))
    data["phases"][0]["estimates"]["iyy"]["value"] *= 1.01
    (lab / "off" / "result.json").write_text(json.dumps(data), encoding="utf-8")
    told(ran(lab, "off", *other, "--json"), 5)


@pytest.mark.thorough
def test_a_level_may_be_stated(lab: Path) -> None:
    p = told(ran(lab, "free-flyer", "free-flyer-2/log.parquet", "--json"))["test"]["p"]
    assert ran(lab, "free-flyer", "free-flyer-2/log.parquet", "-q", "--limit", str(1 - 0.9 * p)).exit_code == 0
    assert ran(lab, "free-flyer", "free-flyer-2/log.parquet", "-q", "--limit", str(1 - 1.1 * p)).exit_code == 5
    assert ran(lab, "free-flyer", "free-flyer-2/log.parquet", "--limit", "1").exit_code == 2


def test_what_it_shows(lab: Path) -> None:
    shown = ran(lab, "free-flyer", "free-flyer-2/log.parquet").stdout
    for said in ("free flyer: free-flyer/result.json, phase all, against", "kg m^2", "m/s^2", "nis by manoeuvre", "Predicted: chi-square "):
        assert said in shown
    assert ran(lab, "free-flyer", "free-flyer-2/log.parquet", "-q").stdout == ""


def nothing(data: dict[str, Any]) -> None:
    for item in data["phases"][0]["estimates"].values():
        item |= {"value": None, "sigma": None}


def without_pivot(data: dict[str, Any]) -> None:
    del data["phases"][0]["about_pivot"], data["phases"][0]["about_pivot_covariance"]


def thesis(data: dict[str, Any]) -> None:
    data["provenance"]["settings"]["estimator.method"] = "thesis"


def twice(data: dict[str, Any]) -> None:
    data["phases"].append(data["phases"][0] | {"name": "other"})


def heavier(data: dict[str, Any]) -> None:
    data["vehicle"]["bearing_mass_kg"] = 3.0


def copied(data: dict[str, Any]) -> None:
    data["provenance"]["input_sha256"] = "0" * 64


@pytest.mark.parametrize(
    ("kind", "change", "log", "said"),
    [
        ("free-flyer", lambda _: None, "free-flyer-1", "was made from free-flyer-1/log.parquet, so the test proves nothing; name"),
        ("free-flyer", copied, "free-flyer-1", "the same recording in another file, so the test proves nothing; name"),
        ("free-flyer", nothing, "free-flyer-2", "gives no value in phase all"),
        pytest.param(
            "free-flyer",
            lambda _: None,
            "pedestal-2",
            "vehicle is 'table on a pedestal', and 'free flyer' in",
            marks=[pytest.mark.thorough, pytest.mark.seeds],
        ),
        ("free-flyer", heavier, "free-flyer-2", "bearing mass [kg] is 0.0, and 3.0 in"),
        ("free-flyer", thesis, "free-flyer-2", "estimator.method is thesis, whose sigmas are not errors; use the default method"),
        ("free-flyer", twice, "free-flyer-2", "has phases all, other. Name one with --phase"),
        pytest.param(
            "pedestal",
            without_pivot,
            "pedestal-2",
            "has no about_pivot with its covariance; name the result of one log",
            marks=[pytest.mark.thorough, pytest.mark.seeds],
        ),
    ],
)
def test_what_it_refuses(lab: Path, kind: str, change: Callable[[dict[str, Any]], None], log: str, said: str) -> None:
    assert said in refused(ran(lab, edited(lab, kind, change), f"{log}/log.parquet"))


def test_a_phase_that_there_is_none_of(lab: Path) -> None:
    folder = edited(lab, "free-flyer", twice)
    assert "has no phase 'third'; it has all, other" in refused(ran(lab, folder, "free-flyer-2/log.parquet", "--phase", "third"))
    assert told(ran(lab, folder, "free-flyer-2/log.parquet", "--phase", "other", "--json"))["result"]["phase"] == "other"


def test_a_contradicted_value_ends_with_six(lab: Path) -> None:
    def change(data: dict[str, Any]) -> None:
        data["phases"][0]["estimates"]["mass"]["verdict"] = "contradicted"
        data["phases"][0]["contradiction"] = "for a test"

    folder = edited(lab, "free-flyer", change)
    done = ran(lab, folder, "free-flyer-2/log.parquet", "-q")
    assert done.exit_code == 6
    assert "mass contradicted in phase all: for a test" in done.stderr
    assert ran(lab, folder, "free-flyer-2/log.parquet", "-q", "--allow-contradicted").exit_code == 0


@pytest.mark.thorough
def test_a_joint_result_predicts_a_third_log(lab: Path) -> None:
    stocked(lab, "free-flyer")
    assert massprop(lab, "estimate", "free-flyer-2/log.parquet", "-q", "--out", "second").returncode == 0
    assert massprop(lab, "combine", "free-flyer", "second", "-q", "--out", "joint").returncode == 0
    found = told(ran(lab, "joint", "free-flyer-4/log.parquet", "--json"))
    assert len(found["result"]["input_sha256"]) == 2
    assert "proves nothing" in refused(ran(lab, "joint", "free-flyer-2/log.parquet"))
    sigmas = np.array([one["result_sigma"] for one in found["quantities"].values()])
    alone = json.loads((lab / "free-flyer" / "result.json").read_text(encoding="utf-8"))["phases"][0]["estimates"]
    assert (sigmas <= [one["sigma"] for one in alone.values()]).all()
