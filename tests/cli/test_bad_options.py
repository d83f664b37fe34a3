"""Settings and options that can't be used: exit 3 or 2, one line, nothing written."""

import json
from pathlib import Path

import pytest

from tests.commandline import massprop
from tests.refusal import (
    contents,
    flight,
    refused,
    save,
    save_vehicle,
)

BAD_SETTINGS = [
    (["--vehicle", "vehicle.toml", "--set", "cycle.perod_s=1"], ["setting", "unknown key 'cycle.perod_s'", "nearest", "'period_s'"]),
    (["--set", "estimatr.method=thesis"], ["setting", "unknown key 'estimatr'", "nearest", "'estimator'"]),
    (["--set", "convergence.count"], ["setting convergence.count", "KEY=VALUE", "instance convergence.count=50"]),
    (["--set", "=5"], ["setting =5", "KEY=VALUE"]),
    (["--set", "convergence.count=many"], ["setting", "convergence.count", "'many'", "integer"]),
    (["--set", "convergence.count.x=1", "--set", "convergence.count=5"], ["setting", "convergence.count"]),
    (["--set", "name.x=1"], ["setting name.x=1", "'name'", "is a value, not a table"]),
    (["--set", "cycle.period_s=0.05\n[known]\nmass={value=1.0,sigma=1.0}"], ["setting", "cycle.period_s", "valid number"]),
    (["--set", "jets.99.rise_s=0.003"], ["setting jets.99.rise_s=0.003", "'99'", "a list of 18", "count from 0"]),
    (["--set", "cycle.period_s=nan"], ["setting", "cycle.period_s = nan", "finite"]),
    (["--delay", "soon"], ["--delay", "'soon'", "number"]),
    (["--delay", "-1"], ["--delay", "-1", "0"]),
]


@pytest.mark.parametrize(("settings", "names"), BAD_SETTINGS, ids=[" ".join(settings) for settings, _ in BAD_SETTINGS])
def test_a_setting_is_refused_that_can_not_be_used(settings: list[str], names: list[str], tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    refused(tmp_path, save(flight(), tmp_path / "log.parquet"), *settings, names=names)


@pytest.mark.parametrize("below", ["", "campaign/one"], ids=["in its place", "in the place of its parent"])
def test_a_result_folder_with_a_file_in_the_way_is_refused(below: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    (tmp_path / "taken").write_text("mine", encoding="utf-8")
    out = tmp_path / "taken" / below
    refused(tmp_path, log, "-q", out=out, names=[out, "cannot be written", "choose another folder (--out)"])


BAD_LINES = [
    (["estimate", "log.parquet", "--fast"], ["--fast"]),
    (["estimate", "log.parquet", "--method", "fancy"], ["--method", "fancy", "default", "thesis"]),
    (["estimate", "log.parquet", "--require"], ["--require"]),
    (["estimate", "log.parquet", "log.parquet"], ["log.parquet"]),
    (["estimate"], ["LOG"]),
    (["simulate", "free-flyer", "--seeds", "1000000000000"], ["--seeds", "less than or equal to 100000"]),
    (["batch", "log.parquet", "--max-sigma", "inf"], ["--max-sigma inf", "a number of sigmas"]),
    (["estimat", "log.parquet"], ["estimat"]),
    (["schema", "lgo"], ["lgo", "log"]),
]


@pytest.mark.parametrize(("arguments", "names"), BAD_LINES, ids=[" ".join(arguments) for arguments, _ in BAD_LINES])
def test_a_command_line_that_makes_no_sense_is_a_usage_error(arguments: list[str], names: list[str], tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    save(flight(), tmp_path / "log.parquet")
    before = contents(tmp_path)
    done = massprop(tmp_path, *arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    for name in names:
        assert name in done.stderr
    assert contents(tmp_path) == before, "something was written"


@pytest.mark.parametrize("required", ["ixx,inertia", "Masses", "mass;ixx", "ixx,"])
def test_requiring_an_unknown_quantity_is_a_usage_error(required: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log = save(flight(), tmp_path / "log.parquet")
    before = contents(tmp_path)
    done = massprop(tmp_path, "estimate", log, "--out", tmp_path / "out", "--require", required)
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("massprop: --require ")
    for name in (required.rpartition(",")[2], "ixx, ixy, ixz", "mass or all"):
        assert name in done.stderr
    assert contents(tmp_path) == before, "something was written"


@pytest.mark.parametrize("required", ["mass", "all"])
def test_a_required_quantity_that_is_not_converged_fails_with_its_outputs_written(required: str, tmp_path: Path) -> None:
    save_vehicle(tmp_path)
    log, out = save(flight(rows=60), tmp_path / "log.parquet"), tmp_path / "out"
    done = massprop(tmp_path, "estimate", log, "--out", out, "-q", "--require", required)
    assert done.returncode == 4
    assert done.stdout == ""
    assert sorted(path.name for path in out.iterdir()) == ["history.parquet", "result.json", "run.json"]
    lines = done.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("massprop: required but not converged: ")
    estimates = json.loads((out / "result.json").read_text(encoding="utf-8"))["phases"][0]["estimates"]
    missed = [name for name, found in estimates.items() if found["verdict"] != "converged" and required in (name, "all")]
    assert "mass" in missed
    for name in missed:
        assert f"{name} in phase all is {estimates[name]['verdict']} (" in lines[0]
