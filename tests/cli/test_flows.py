import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

from massprop_cli import QUANTITIES, job, schemas
from massprop_cli.base import escape
from massprop_cli.result import build
from massprop_cli.result.schema import Result
from tests.commandline import massprop, succeeded

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_logs"


def short(tmp_path: Path, rows: int = 400, suffix: str = ".parquet", name: str = "free-flyer") -> Path:
    """The first rows of a sample log beside a copy of its vehicle file."""
    table = pq.read_table(SAMPLES / name / "log.parquet").slice(0, rows)
    path = tmp_path / f"log{suffix}"
    if suffix == ".parquet":
        pq.write_table(table, path)
    else:
        csv.write_csv(table, path)
    (tmp_path / "vehicle.toml").write_text((SAMPLES / name / "vehicle.toml").read_text())
    return path


def load(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "result.json").read_text())
    return found


def test_estimate_writes_what_it_prints(tmp_path: Path) -> None:
    log, out = short(tmp_path), tmp_path / "out"
    run = succeeded(tmp_path, "estimate", log, "--out", out)
    assert run.stderr == ""
    assert sorted(p.name for p in out.iterdir()) == ["history.parquet", "result.json", "run.json"]
    found = load(out)
    jsonschema.validate(found, schemas.schema("result"))
    for name in QUANTITIES:
        assert name in run.stdout
        assert found["phases"][0]["estimates"][name]["verdict"] in run.stdout
    history = pq.read_table(out / "history.parquet")
    assert history.num_rows == 398  # 400 cycles less the two-cycle delay
    assert history.column_names[:3] == ["phase", "time_s", "ixx"]
    assert history.column("ixx")[-1].as_py() == found["phases"][0]["estimates"]["ixx"]["value"]
    assert {"innovation_torque_x", "innovation_force_z_sigma", "mass_sigma"} <= set(history.column_names)
    assert "tensor" in run.stdout
    assert "body axes" in run.stdout


def test_same_input_gives_the_same_bytes_and_json_prints_them_and_nothing_else(tmp_path: Path) -> None:
    """In a process that was forked, and in an interpreter with another seed of its hashes."""
    log = short(tmp_path)
    shown = massprop(tmp_path, "estimate", log, "--json", "--out", "a")
    command = [sys.executable, "-m", "massprop_cli", "estimate", str(log), "-q", "--out", str(tmp_path / "b")]
    quiet = subprocess.run(command, env=os.environ | {"PYTHONHASHSEED": "7"}, capture_output=True, text=True, check=True)
    assert (quiet.stdout, quiet.stderr) == ("", "")
    for name in ("result.json", "history.parquet"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (shown.stdout, shown.stderr) == ((tmp_path / "a" / "result.json").read_text(), "")


@pytest.mark.parametrize("name", ["free-flyer", "high-rate"])
def test_csv_and_parquet_of_one_log_differ_in_hash_and_path_alone(tmp_path: Path, name: str) -> None:
    found = []
    for suffix in (".parquet", ".csv"):
        log = short(tmp_path, rows=4000 if name == "high-rate" else 400, suffix=suffix, name=name)
        found.append(json.loads(escape.document(build.result(job.of_file(log).analysis))))
    assert found[0]["log"].pop("path") == "log.parquet"
    assert found[1]["log"].pop("path") == "log.csv"
    assert found[0]["provenance"].pop("input_sha256") != found[1]["provenance"].pop("input_sha256")
    assert found[0] == found[1]


def test_a_log_cut_short_has_the_same_history_before_the_cut(tmp_path: Path) -> None:
    whole = job.of_file(short(tmp_path, rows=400)).analysis.histories[0]
    for rows in (150, 263):
        part = job.of_file(short(tmp_path, rows=rows)).analysis.histories[0]
        np.testing.assert_array_equal(part.values, whole.values[: rows - 2])
        np.testing.assert_array_equal(part.sigmas, whole.sigmas[: rows - 2])


def test_rates_columns_and_scales_stand_in_for_the_contract_names(tmp_path: Path) -> None:
    """The same log with mean rates for increments, time in ms and other names gives the same estimates."""
    import pyarrow as pa

    log = short(tmp_path)
    reference = job.of_file(log).analysis
    table = pq.read_table(log)
    columns: dict[str, Any] = {"t_ms": 1e3 * np.asarray(table["time_s"])}
    for axis in "xyz":
        columns[f"gyro_{axis}_rad_s"] = np.asarray(table[f"delta_theta_{axis}_rad"]) / np.diff(np.asarray(table["time_s"]), prepend=0.0)
        columns[f"acc_{axis}_g"] = np.asarray(table[f"delta_v_{axis}_m_s"]) / np.diff(np.asarray(table["time_s"]), prepend=0.0) / 9.80665
    columns |= {name: table[name] for name in table.column_names if name.startswith("jet_")}
    other = tmp_path / "other.parquet"
    pq.write_table(pa.table(columns), other)
    names = '\n[columns]\ntime_s = { from = "t_ms", scale = 1e-3 }\n'
    names += "".join(f'accel_{axis}_m_s2 = {{ from = "acc_{axis}_g", scale = 9.80665 }}\n' for axis in "xyz")
    (tmp_path / "other.vehicle.toml").write_text((tmp_path / "vehicle.toml").read_text() + names)
    found = job.of_file(other).analysis
    np.testing.assert_allclose(found.histories[0].values[-1], reference.histories[0].values[-1], rtol=1e-6)


def test_set_overrides_the_vehicle_file_and_flags_override_the_environment(tmp_path: Path) -> None:
    log = short(tmp_path)

    def estimated(*options: str) -> dict[str, Any]:
        run = massprop(tmp_path, "estimate", log, "--json", *options, "--out", "o", MASSPROP_METHOD="thesis")
        found: dict[str, Any] = json.loads(run.stdout)
        return found

    settings = estimated("--set", "convergence.count=30")["provenance"]["settings"]
    assert settings["convergence.count"] == 30
    assert settings["estimator.method"] == "thesis"
    assert estimated("--set", "estimator.method=default")["provenance"]["settings"]["estimator.method"] == "default"
    found = estimated("--method", "default", "--delay", "2")
    assert found["provenance"]["settings"]["estimator.method"] == "default"
    assert (found["delay"]["cycles"], found["delay"]["source"]) == (2.0, "option")
    assert abs(found["delay"]["detected_cycles"] - 2.0) < 5 * found["delay"]["sigma_cycles"] < 0.01


def test_a_vehicle_is_found_embedded_and_beside_the_log(tmp_path: Path) -> None:
    log = short(tmp_path, rows=60)
    text = (tmp_path / "vehicle.toml").read_text()
    (tmp_path / "log.vehicle.toml").write_text(text.replace('name = "free-flyer"', 'name = "beside"'))
    assert job.of_file(log).analysis.vehicle.name == "beside"
    table = pq.read_table(log)
    embedded = text.replace('name = "free-flyer"', 'name = "embedded"')
    pq.write_table(table.replace_schema_metadata({b"massprop.vehicle": embedded.encode()}), log)
    assert job.of_file(log).analysis.vehicle.name == "embedded"
    assert job.of_file(log, tmp_path / "vehicle.toml").analysis.vehicle.name == "free-flyer"


@pytest.mark.slow
def test_a_weighed_mass_calibrates_the_thrust_scale_and_narrows_the_inertia() -> None:
    """Of thrust that is known to 5 % a mass weighed to 0.1 % shifts and narrows mass and inertia alike."""
    path, stated = SAMPLES / "free-flyer" / "log.parquet", "thrust.scale_sigma=0.05"
    before = job.of_file(path, assignments=(stated,)).analysis.conclusions[0].estimates
    after = job.of_file(path, assignments=(stated, "known.mass={value=22.4, sigma=0.022}")).analysis.conclusions[0].estimates
    assert after["mass"].value == pytest.approx(22.4, abs=0.022)
    for name in ("ixx", "iyy"):
        assert (after[name].sigma or 0) < 0.6 * (before[name].sigma or 0)
        assert (after[name].value or 0) / (before[name].value or 1) == pytest.approx(22.4 / (before["mass"].value or 1), rel=0.01)


def test_help_stays_light(tmp_path: Path) -> None:
    heavy = "('numpy', 'pandas', 'pyarrow', 'pydantic', 'matplotlib')"
    code = f"import sys\nfrom massprop_cli import cli\nprint([m for m in {heavy} if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    assert "estimate" in massprop(tmp_path, "--help").stdout


@pytest.mark.parametrize("arguments", [("estimate", "--out", "o"), ("check",)])
def test_one_log_needs_no_pandas(arguments: tuple[str, ...], tmp_path: Path) -> None:
    log = short(tmp_path, rows=60)
    code = (
        "import sys\nfrom massprop_cli.cli import main\nsys.argv[0] = 'massprop'\n"
        "try:\n main()\nexcept SystemExit as e:\n assert e.code == 0\n"
        "print([m for m in ('pandas', 'scipy', 'matplotlib', 'numpy.ma', 'numpy.random', 'pyarrow.compute') if m in sys.modules])"
    )
    command = [sys.executable, "-c", code, arguments[0], str(log), "-q", *arguments[1:]]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_progress_goes_to_a_terminal_only(tmp_path: Path) -> None:
    """On a pseudo-terminal the bar names the stage, whatever a phase is called; on a pipe stderr stays empty."""
    import pty

    log = short(tmp_path, 800)
    leader, follower = pty.openpty()
    named = 'phases=[{name="a[/b]", start_s=0, end_s=60}]'
    command = [sys.executable, "-m", "massprop_cli", "estimate", str(log), "--out", str(tmp_path / "o"), "--set", named]
    # the compiled kernel is through before the bar is drawn again, and so is a short log
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=follower, env=os.environ | {"MASSPROP_KERNEL": "numpy"})
    os.close(follower)
    shown = b""
    while True:
        try:
            piece = os.read(leader, 4096)
        except OSError:
            break
        if not piece:
            break
        shown += piece
    os.close(leader)
    assert run.wait() == 0
    assert b"estimating, phase a[/b]" in shown
    assert massprop(tmp_path, "estimate", log, "--out", "o").stderr == ""


@pytest.mark.slow
def test_nominal_values_stand_beside_the_estimates_and_do_not_pull_them(tmp_path: Path) -> None:
    log = short(tmp_path)
    plain = job.of_file(log).analysis
    cad = 'nominal={poi_convention="positive_integral", ixx=5.0, ixy=-3.0}'
    shown = job.of_file(log, assignments=(cad,)).analysis
    np.testing.assert_array_equal(shown.histories[0].values, plain.histories[0].values)
    estimates = build.result(shown).phases[0].estimates
    assert (estimates["ixx"].nominal, estimates["ixy"].nominal, estimates["izz"].nominal) == (5.0, 3.0, None)
    run = massprop(tmp_path, "estimate", log, "--set", cad, "--out", "o")
    assert "nominal" in run.stdout


def test_a_known_value_that_the_log_contradicts_is_pointed_out(tmp_path: Path) -> None:
    log = short(tmp_path)
    codes = [n.code for n in job.of_file(log, assignments=("known.ixx={value=0.7, sigma=1e-4}",)).analysis.notices]
    assert codes == ["known-mismatch"]
    assert job.of_file(log, assignments=("known.ixx={value=0.62, sigma=1e-3}",)).analysis.notices == ()


@pytest.mark.thorough
def test_a_logged_attitude_that_turns_against_the_gyro_is_left_out(tmp_path: Path) -> None:
    """The air-bearing log with its integrated attitude as columns: accepted as it is, left out and said when conjugated."""
    import pyarrow as pa

    from massprop_cli.prepare.attitude import integrate_attitude

    log = short(tmp_path, rows=400, name="air-bearing")
    table = pq.read_table(log)
    turns = np.stack([np.asarray(table[f"delta_theta_{axis}_rad"]) for axis in "xyz"], 1)
    attitude = integrate_attitude(np.array([1.0, 0, 0, 0]), turns)[1:]
    plain = job.of_file(log).analysis
    for sign in (1, -1):
        names = ("quat_w", "quat_x", "quat_y", "quat_z")
        columns = {name: pa.array(attitude[:, i] * (sign if i else 1)) for i, name in enumerate(names)}
        extended = table
        for name, column in columns.items():
            extended = extended.append_column(name, column)
        pq.write_table(extended, log)
        if sign == 1:
            z = (job.of_file(log).analysis.histories[0].values[-1] - plain.histories[0].values[-1]) / plain.histories[0].sigmas[-1]
            assert np.abs(z).max() < 3
        else:
            found = job.of_file(log).analysis
            (said,) = found.notices
            assert (said.code, "wxyz" in said.message) == ("attitude-misfit", True)
            np.testing.assert_array_equal(found.histories[0].values, plain.histories[0].values)


def result(log: Path, *assignments: str, vehicle: Path | None = None) -> Result:
    return build.result(job.of_file(log, vehicle, assignments).analysis)


def given_back(found: Result) -> list[str]:
    """A result's settings, to be set."""
    return [f"{key}={json.dumps(value)}" for key, value in found.provenance.settings.items()]


@pytest.mark.thorough
def test_an_automatic_delay_is_written_into_the_settings_and_reproduces_the_result(tmp_path: Path) -> None:
    log = short(tmp_path)
    found = Result.model_validate_json(massprop(tmp_path, "estimate", log, "--json", "--delay", "auto", "--out", "a").stdout)
    assert found.delay.source == "detected"
    assert abs(found.delay.cycles - 2.0) < 0.01
    assert found.provenance.settings["cycle.command_delay_cycles"] == found.delay.cycles
    assigned = [part for setting in given_back(found) for part in ("--set", setting)]
    again = Result.model_validate_json(massprop(tmp_path, "estimate", log, "--json", *assigned, "--out", "b").stdout)
    assert again.phases == found.phases


@pytest.mark.parametrize(("stated", "sigma", "heard"), [(1.9, 0.1, True), pytest.param(2.3, 0.05, False, marks=pytest.mark.thorough)])
def test_a_delay_that_is_stated_with_a_sigma_is_narrowed_by_the_log(tmp_path: Path, stated: float, sigma: float, heard: bool) -> None:
    """2.0 cycles: a sigma off it is found within 0.003 and nothing is warned of, six sigmas off it is a fault; settings give it back."""
    log = short(tmp_path)
    found = result(log, f"cycle.command_delay_cycles={stated}", f"cycle.command_delay_sigma_cycles={sigma}")
    codes = {notice.code for notice in found.warnings}
    assert codes.isdisjoint({"cause-unknown", "contradicted"})
    assert ("delay-mismatch" in codes) is not heard
    narrowed = found.provenance.settings["cycle.command_delay_sigma_cycles"]
    if not heard:
        assert (found.delay.cycles, narrowed) == (stated, sigma)
        return
    assert isinstance(narrowed, float)
    assert abs(found.delay.cycles - 2.0) < 0.003
    assert abs(found.delay.cycles - 2.0) < 4 * narrowed < 0.01
    assert result(log, *given_back(found)).phases == found.phases


def test_the_refined_fit_agrees_with_the_causal_one_and_says_so_in_its_settings(tmp_path: Path) -> None:
    log = short(tmp_path)
    causal, refined = (json.loads(massprop(tmp_path, "estimate", log, "--json", *more, "--out", "o").stdout) for more in ([], ["--refine"]))
    assert (causal["provenance"]["settings"]["estimator.refine"], refined["provenance"]["settings"]["estimator.refine"]) == (False, True)
    for name, estimate in causal["phases"][0]["estimates"].items():
        other = refined["phases"][0]["estimates"][name]
        if estimate["value"] is None:
            assert other["value"] is None
            continue
        assert abs(estimate["value"] - other["value"]) < 0.2 * other["sigma"]
        assert abs(estimate["sigma"] / other["sigma"] - 1) < 0.02
    innovations = causal["phases"][0]["innovations"]
    assert abs(innovations["nis"] - 6) < 4.5 * (12 / innovations["cycles"]) ** 0.5
    assert max(abs(c) for c in innovations["lag_one_correlation"]) < 4.5 / innovations["cycles"] ** 0.5


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_delay_that_nobody_stated_is_called_a_default(tmp_path: Path) -> None:
    log = short(tmp_path)
    vehicle = tmp_path / "unstated.toml"
    stated = (SAMPLES / "free-flyer" / "vehicle.toml").read_text()
    assert "command_delay_cycles" in stated
    vehicle.write_text("".join(line for line in stated.splitlines(True) if "command_delay_cycles" not in line))
    for file, source in ((SAMPLES / "free-flyer" / "vehicle.toml", "vehicle"), (vehicle, "default")):
        found = result(log, vehicle=file)
        assert found.delay.source == source
        assert found.lag.source == "default"
        (delay,) = [one for one in found.assumptions if one.code == "command-delay"]
        assert delay.stated == (source == "vehicle")
