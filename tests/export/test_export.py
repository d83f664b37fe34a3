"""The exported folder builds under every warning, flies its vector bit for bit, and asks nothing of its machine but a square root."""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.errors import InputError
from massprop_cli.conclude import verdict
from massprop_cli.export import folder, resolve, vector
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import kernel
from tests.analysed import SAMPLES, analysed
from tests.commandline import massprop

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
ARM, QEMU = "arm-linux-gnueabihf-gcc", "qemu-arm"


def exported(name: str, out: Path) -> Path:
    source = vehiclefile.load(SAMPLES / name / "vehicle.toml")
    folder.write(resolve.told(source, SAMPLES / name / "log.parquet"), out)
    return out


def make(where: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["make", "-s", *arguments], cwd=where, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("name", "options"),
    [("free-flyer", ()), ("air-bearing", ("SANITIZED=",)), ("docking", ("SANITIZED=",)), ("high-rate", ("SANITIZED=",))],
)
def test_its_own_test_passes(name: str, options: tuple[str, ...], tmp_path: Path) -> None:
    where = exported(name, tmp_path / "out")
    run = make(where, "test", *options)
    assert run.returncode == 0, run.stdout + run.stderr
    assert (where / "replayed.txt").read_text() == (where / "expected.txt").read_text()
    assert len((where / "expected.txt").read_text().splitlines()) > 300


def test_without_a_log_it_builds_and_says_that_nothing_flew(tmp_path: Path) -> None:
    """Also where an earlier export to that folder had a log: its vector goes."""
    where = exported("free-flyer", tmp_path / "out")
    assert (where / "vector.txt").exists()
    vehicle = SAMPLES / "free-flyer" / "vehicle.toml"
    done = massprop(tmp_path, "export-flight", "--vehicle", vehicle, "--out", "out")
    assert done.returncode == 0, done.stderr
    run = make(where, "test", "SANITIZED=")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "nothing flown" in run.stdout
    assert not (where / "vector.txt").exists()
    assert "vector.txt" not in (where / "README.md").read_text()


def test_a_delay_that_a_log_tells_is_flown_as_exact(tmp_path: Path) -> None:
    log, vehicle = (SAMPLES / "free-flyer" / name for name in ("log.parquet", "vehicle.toml"))
    command = ("export-flight", "--vehicle", vehicle, "--log", log, "--out", "out")
    done = massprop(tmp_path, *command, "--set", "cycle.command_delay_cycles=auto")
    assert done.returncode == 0, done.stderr
    assert make(tmp_path / "out", "test", "SANITIZED=").returncode == 0
    # an uncertainty that is stated is refused: the kernel has no room for it
    done = massprop(tmp_path, *command, "--set", "cycle.command_delay_sigma_cycles=0.01")
    assert done.returncode == 3
    assert "command_delay_sigma_cycles" in done.stderr


def test_one_wrong_bit_is_told(tmp_path: Path) -> None:
    where = exported("high-rate", tmp_path / "out")
    text = (where / "expected.txt").read_text()
    last = text[-40]
    (where / "expected.txt").write_text(f"{text[:-40]}{'1' if last == '0' else '0'}{text[-39:]}")
    assert make(where, "test", "SANITIZED=").returncode != 0


def test_the_vector_ends_with_what_result_json_says(tmp_path: Path) -> None:
    log = SAMPLES / "docking" / "log.parquet"
    assert massprop(tmp_path, "estimate", str(log), "--out", "result", "-q").returncode == 0
    where = exported("docking", tmp_path / "out")
    rows = [line.split() for line in (where / "expected.txt").read_text().splitlines()]
    counts = [leg.cycles.stop - leg.cycles.start for leg in resolve.told(vehiclefile.load(log.with_name("vehicle.toml")), log).legs]
    for phase, last in zip(json.loads((tmp_path / "result" / "result.json").read_text())["phases"], (counts[0], sum(counts)), strict=True):
        row = rows[last - 1]
        for i, name in enumerate(QUANTITIES):
            estimate = phase["estimates"][name]
            assert (row[i], row[10 + i]) == (vector.bits(estimate["value"]), vector.bits(estimate["sigma"]))


@pytest.mark.skipif(not (shutil.which(ARM) and shutil.which(QEMU)), reason=f"no {ARM} or no {QEMU}")
@pytest.mark.parametrize("name", ["free-flyer", "air-bearing"])
def test_arm_gives_the_same_bytes(name: str, tmp_path: Path) -> None:
    where = exported(name, tmp_path / "out")
    run = make(where, "test", f"CC={ARM}", f"RUN={QEMU} -L /usr/arm-linux-gnueabihf", "SANITIZED=")
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_kernel_asks_for_nothing_but_a_square_root_and_keeps_nothing(tmp_path: Path) -> None:
    where = exported("high-rate", tmp_path / "out")
    sources = re.findall(r"^KERNEL = (.*)$", (where / "Makefile").read_text(), re.MULTILINE)[0].split()
    subprocess.run(["cc", "-std=c99", "-O2", "-ffp-contract=off", "-fno-stack-protector", "-c", *sources], cwd=where, check=True)
    named = subprocess.run(
        ["nm", *(source.replace(".c", ".o") for source in sources)], cwd=where, capture_output=True, text=True, check=True
    )
    symbols = [line.split()[-2:] for line in named.stdout.splitlines() if line and not line.endswith(":")]
    wanted = {name for kind, name in symbols if kind == "U" and not name.startswith("mp_")}
    assert wanted <= {"sqrt", "memcpy", "memset", "memmove", "_GLOBAL_OFFSET_TABLE_"}
    assert not [name for kind, name in symbols if kind in "BbDdCc"]


def test_tables_say_the_vehicle_to_the_last_bit() -> None:
    found = resolve.stated(vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml"))
    text = folder.contents(found)["table.c"]
    jets = found.vehicle.jet_wrench
    for number in (0.05, 0.1, 1e-4, 0.02, *jets[3]):
        assert f"R({float(number).hex()})" in text
    assert struct.unpack(">d", bytes.fromhex(vector.bits(0.1)))[0] == 0.1


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ('cycle.command_delay_cycles="auto"', "cycle.command_delay_cycles must be stated"),
        ("imu.gyro_noise_rad_s=0", "imu.gyro_noise_rad_s must be stated"),
        ("cycle.command_delay_cycles=40", "a delay of 40 cycles, and the kernel holds 19"),
        ("estimator.bins_per_cycle=80", "estimator.bins_per_cycle is 80, and the kernel holds 64"),
        ("drift.mass=0.1", "[drift] is stated"),
        ("thrust.lag_s=0.01", "thrust.lag_s is not 0"),
        ("thrust.droop=0.01", "thrust.droop or thrust.cycle_droop is not 0"),
        ('thrust.failures=[{jet="roll_p1"}]', "thrust.failures is not empty"),
        ("imu.gyro_lag_s=0.01", "the kernel knows no low-pass"),
        ("imu.clock_drift_ppm=50", "imu.clock_drift_ppm is not 0"),
        ("cycle.command_delay_sigma_cycles=0.1", "set command_delay_sigma_cycles"),
        ('estimator.method="thesis"', "estimator.method is 'thesis'"),
    ],
)
def test_what_the_kernel_cannot_hold_is_refused(setting: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        resolve.stated(vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml", [setting]))
    assert "vehicle.toml" in str(refused.value)


@pytest.mark.parametrize("stated", ["", "inertia_tolerance=0.2", "mass_tolerance=0.3"])
@pytest.mark.parametrize("relative", ["", "true", "false"])
def test_a_value_has_converged_in_flight_by_the_rule_of_the_ground(relative: str, stated: str) -> None:
    settings = [f"convergence.{one}" for one in (stated, relative and f"relative={relative}") if one]
    source = vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml", settings)
    rule = resolve.stated(source).legs[0].rule
    found = analysed("free-flyer").histories[0]
    on_ground = verdict.tolerances(found, source.vehicle) / (found.natural_sizes if rule[2] else 1.0)
    assert bool(rule[2]) == (relative != "false")
    np.testing.assert_allclose(np.repeat(rule[3:6], [6, 3, 1]), on_ground, rtol=1e-12)


def test_a_refusal_is_exit_3_and_leaves_nothing(tmp_path: Path) -> None:
    vehicle = str(SAMPLES / "crazyflie" / "vehicle.toml")
    run = massprop(tmp_path, "export-flight", "--vehicle", vehicle, "--set", "drift.mass=1", "--out", "out")
    assert run.returncode == 3
    assert len(run.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()
