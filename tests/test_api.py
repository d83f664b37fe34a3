"""massprop from Python."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import massprop_cli
from massprop_cli import QUANTITIES, InputError, estimate_log, run_campaign
from tests.campaigns import contents, simulate
from tests.commandline import massprop
from tests.refusal import SAMPLES


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("logs") / "logs", 3)


def test_an_estimate_is_the_result_that_the_command_writes(logs: Path, tmp_path: Path) -> None:
    log = logs / "seed-0001" / "log.parquet"
    found = estimate_log(log, settings={"convergence.count": 50, "estimator.method": "default"}, delay=2)
    massprop(tmp_path, "estimate", log, "--set", "convergence.count=50", "--method", "default", "--delay", "2", "--out", "out")
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    mine = found.result.model_dump(by_alias=True, mode="json")
    del stored["provenance"]["setting_sources"], mine["provenance"]["setting_sources"]
    assert mine == stored
    assert found.table.index.tolist() == [("all", name) for name in QUANTITIES]
    assert found.table.loc[("all", "mass"), "value"] == stored["phases"][0]["estimates"]["mass"]["value"]
    assert len(found.history) == found.result.log.cycles - 2
    assert found.history["mass"].iloc[-1] == found.table.loc[("all", "mass"), "value"]


def test_settings_are_values_of_python(logs: Path) -> None:
    """They had gone through JSON to where TOML is read: a mapping, a number of NumPy and a name beyond the first plane were refused."""
    log = logs / "seed-0001" / "log.parquet"
    written = estimate_log(log, settings={"known.mass.value": 22.0, "known.mass.sigma": 0.02, "imu.gyro_noise_rad_s": 1e-4})
    for settings in (
        {"known.mass": {"value": 22.0, "sigma": 0.02}, "imu.gyro_noise_rad_s": np.float64(1e-4)},
        {"known": {"mass": {"value": np.float64(22.0), "sigma": 0.02}}, "imu": {"gyro_noise_rad_s": 1e-4}},
    ):
        found = estimate_log(log, settings=settings)
        assert found.result.phases[0].known == {"mass": (22.0, 0.02)}
        assert found.result.phases == written.result.phases
    place = np.array([0.1, -0.06, 0.12])
    named = {"name": "a\u2028b\x7f\U0001f680", "imu.position_m": place, "phases": [{"name": "\U0001f600", "start_s": 0, "end_s": 20}]}
    found = estimate_log(log, settings=named)
    assert found.result.vehicle.name == named["name"]
    assert found.result.phases[0].name == "\U0001f600"
    assert found.result.provenance.settings["imu.position_m"] == place.tolist()
    with pytest.raises(InputError, match=r"setting imu\.gyro_noise_rad_s: None: expected a number, text, list or mapping"):
        estimate_log(log, settings={"imu.gyro_noise_rad_s": None})


def test_an_estimate_can_be_held_against_expectations(tmp_path: Path) -> None:
    sample = SAMPLES / "free-flyer"
    found = estimate_log(str(sample / "log.parquet"), str(sample / "vehicle.toml"), expected=sample / "truth.json")
    assert found.table["met"].tolist() == [True] * 10
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"nowhere\.parquet: no such file"):
        estimate_log(tmp_path / "nowhere.parquet")


@pytest.mark.thorough
def test_a_campaign_gives_tables_and_outcomes_and_goes_on_where_it_was(logs: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("")
    steps: list[bool] = []
    found = run_campaign([logs, tmp_path / "bad.csv"], tmp_path / "out", jobs=2, told=lambda step: steps.append(step.kept))
    assert (found.exit_code, steps) == (3, [False] * 4)
    assert found.table["name"].tolist() == ["seed-0001", "seed-0002", "seed-0003", "bad"]
    assert found.table["mass"].notna().tolist() == [True, True, True, False]
    bad = found.outcomes["bad"]
    assert bad is not None
    assert bad.message == "bad.csv: the file is empty; record the log again"
    mass = found.pooled.loc[("free flyer", "all", "mass")]
    assert mass["logs"] == 3
    assert abs(mass["value"] - 22.0) < 5 * mass["sigma"]
    before = contents(tmp_path / "out")
    again = run_campaign([str(logs), str(tmp_path / "bad.csv")], str(tmp_path / "out"), told=lambda step: steps.append(step.kept))
    assert steps[4:] == [True] * 4
    assert contents(tmp_path / "out") == before
    assert again.summary == found.summary
    held = run_campaign(logs, tmp_path / "more", baseline=tmp_path / "out", settings={"convergence.count": 20})
    assert held.exit_code == 0
    assert held.summary.baseline is not None
    assert held.summary.baseline.compared == 3


def test_a_campaign_that_can_not_be_run_says_why(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file or folder"):
        run_campaign(tmp_path / "nowhere", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_package_itself_stays_light() -> None:
    code = "import sys, massprop_cli; print([name for name in ('numpy', 'pandas', 'pydantic', 'typer') if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = massprop_cli.nothing


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_script_without_a_guard_may_run_a_campaign(logs: Path, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(f"from massprop_cli import run_campaign\nprint(run_campaign({str(logs)!r}, 'out', jobs=2).exit_code)\n")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("0\n", "")
