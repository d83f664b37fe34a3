"""The exported folder builds under every warning, flies its vector bit for bit, and asks nothing of its machine but a square root."""

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
from massprop_cli.export import folder, resolve
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import kernel
from massprop_cli.result import build
from massprop_cli.testbed import output
from tests import flown
from tests.analysed import SAMPLES, analysed
from tests.commandline import massprop, succeeded

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
ARM, QEMU = "arm-linux-gnueabihf-gcc", "qemu-arm"


OWN = """#include <stdio.h>

#include "table.h"

static mp_flight flight;

int main(void) {
    mp_flown flown = {0};
    mp_values values;
    int made, begun = mp_flight_begin(&flight, &mp_commands_table, &mp_vehicle_table[0], &mp_rule_table[0]);
    flown.end_s = flown.duration_s = mp_commands_table.period_s;
    printf("%d %d %lu\\n", begun, mp_flight_step(&flight, &flown, &values, &made), (unsigned long)sizeof flight);
    return 0;
}
"""


def exported(name: str, out: Path, *assignments: str) -> Path:
    source = vehiclefile.load(SAMPLES / name / "vehicle.toml", assignments)
    folder.write(resolve.from_log(source, SAMPLES / name / "log.parquet"), out)
    return out


def make(where: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["make", "-s", *arguments], cwd=where, capture_output=True, text=True, check=False)


def defined(where: Path, name: str) -> list[str]:
    """A variable of the exported Makefile, word by word."""
    (text,) = re.findall(rf"^{name} = (.*)$", (where / "Makefile").read_text(), re.MULTILINE)
    return str(text).split()


def flies_its_vector(where: Path, program: str) -> bool:
    given, expected = ((where / name).read_text() for name in ("vector.txt", "expected.txt"))
    assert len(expected.splitlines()) > 300
    flown = subprocess.run([where / program], input=given, capture_output=True, text=True, check=False)
    assert flown.returncode == 0, flown.stderr
    return flown.stdout == expected


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The free flyer's folder, of which ``make test`` built all and left its objects there."""
    where = exported("free-flyer", tmp_path_factory.mktemp("built") / "out")
    run = make(where, "test", "SANITIZED=", "CC=cc -fno-stack-protector -save-temps")
    assert run.returncode == 0, run.stdout + run.stderr
    return where


def linked(where: Path, built: Path) -> Path:
    """Another vehicle's tables beside the kernel of the same limits, which is built already."""
    assert defined(where, "LIMITS") == defined(built, "LIMITS")
    for source in defined(where, "KERNEL"):
        assert (where / source).read_text() == (built / source).read_text()
    flags = [word for word in defined(where, "FLAGS") if word != "$(LIMITS)"]
    objects = [str(built / f"replay-{source[:-2]}.o") for source in defined(where, "KERNEL")]
    command = ["cc", *flags, *defined(where, "LIMITS"), "table.c", "replay.c", *objects, "-o", "replay", "-lm"]
    subprocess.run(command, cwd=where, check=True)
    return where


def test_its_own_test_passes(built: Path) -> None:
    assert (built / "replayed.txt").read_text() == (built / "expected.txt").read_text()
    assert flies_its_vector(built, "replay")


def test_all_sources_but_the_replay_link_with_a_main_of_ones_own(built: Path, tmp_path: Path) -> None:
    """What a flight computer's build takes up, by a pattern."""
    assert {path.name for path in built.glob("*.c")} - {*defined(built, "KERNEL"), "table.c"} == {"replay.c"}
    (tmp_path / "own.c").write_text(OWN)
    objects = [str(path) for path in built.glob("replay-*.o") if path.name != "replay-replay.o"]
    command = ["cc", *defined(built, "LIMITS"), f"-I{built}", str(tmp_path / "own.c"), *objects, "-o", str(tmp_path / "own"), "-lm"]
    subprocess.run(command, check=True)
    said = subprocess.run([tmp_path / "own"], capture_output=True, text=True, check=True).stdout
    sizes = subprocess.run([built / "replay", "size"], capture_output=True, text=True, check=True).stdout
    whole, held, checkpoints, others = (int(number) for number in re.findall(r"\d+", sizes))
    assert said == f"0 0 {whole}\n"
    assert held + checkpoints + others == whole


@pytest.mark.seeds
@pytest.mark.thorough
def test_its_own_test_passes_under_the_sanitizers_and_with_other_limits(tmp_path: Path) -> None:
    where = exported("free-flyer", tmp_path / "out")
    run = make(where, "test")
    assert run.returncode == 0, run.stdout + run.stderr
    assert (where / "replayed.txt").read_text() == (where / "expected.txt").read_text()


@pytest.mark.parametrize("name", ["docking", "high-rate"])
def test_other_vehicles_fly_their_vectors(name: str, built: Path, tmp_path: Path) -> None:
    assert flies_its_vector(linked(exported(name, tmp_path / "out"), built), "replay")


@pytest.mark.seeds
@pytest.mark.thorough
def test_on_a_bearing_it_flies_its_vector_under_the_sanitizers(tmp_path: Path) -> None:
    """Not optimised, which is built sooner."""
    where = exported("air-bearing", tmp_path / "out")
    flags = [word for word in defined(where, "FLAGS") if word != "$(LIMITS)"] + defined(where, "LIMITS")
    sanitized = ["-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    command = ["cc", *flags, *sanitized, *defined(where, "KERNEL"), "table.c", "replay.c", "-o", "sanitized", "-lm"]
    subprocess.run(command, cwd=where, check=True)
    assert flies_its_vector(where, "sanitized")


SENSED = (
    "vehicle.thrust.lag_s=0.01",
    'vehicle.imu.measures="sample"',
    "vehicle.imu.gyro_filter={order=2, cutoff_hz=30.0}",
    "vehicle.imu.accel_filter={order=1, cutoff_hz=20.0}",
    "sensors.records_per_cycle=4",
)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(
    ("scenario", "chosen"), [("pedestal", flown.BY_SPEED), ("wheels-and-jets", flown.BY_SPEED), ("free-flyer", SENSED)]
)
def test_what_no_sample_log_has_flies_its_vector_under_the_sanitizers(scenario: str, chosen: tuple[str, ...], tmp_path: Path) -> None:
    """Wheels; samples behind low-passes of different orders, of thrust that lags."""
    settings = [word for setting in chosen for word in ("--set", setting)]
    assert massprop(tmp_path, "simulate", scenario, "--out", "flight", "-q", *settings).returncode == 0
    source = vehiclefile.load(tmp_path / "flight" / "vehicle.toml", [])
    folder.write(resolve.from_log(source, tmp_path / "flight" / "log.parquet"), tmp_path / "out")
    assert make(tmp_path / "out", "sanitized").returncode == 0
    assert flies_its_vector(tmp_path / "out", "sanitized")


def test_without_a_log_it_builds_and_says_that_nothing_flew(built: Path, tmp_path: Path) -> None:
    """Also where an earlier export to that folder had a log: its vector goes. The sources are those that are built with a log."""
    where = exported("free-flyer", tmp_path / "out")
    assert (where / "vector.txt").exists()
    vehicle = SAMPLES / "free-flyer" / "vehicle.toml"
    succeeded(tmp_path, "export-flight", "--vehicle", vehicle, "--out", "out")
    run = make(where, "test", "SANITIZED=", "CC=true")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "nothing flown" in run.stdout
    assert not (where / "vector.txt").exists()
    assert "vector.txt" not in (where / "README.md").read_text()
    linked(where, built)


def test_a_delay_that_a_log_tells_is_flown_as_exact(built: Path, tmp_path: Path) -> None:
    auto = "cycle.command_delay_cycles=auto"
    assert flies_its_vector(linked(exported("free-flyer", tmp_path / "out", auto), built), "replay")
    # an uncertainty that is stated is refused: the kernel has no room for it
    with pytest.raises(InputError, match="command_delay_sigma_cycles"):
        exported("free-flyer", tmp_path / "refused", "cycle.command_delay_sigma_cycles=0.01")
    assert not (tmp_path / "refused").exists()


def test_one_wrong_bit_is_told(built: Path, tmp_path: Path) -> None:
    where = Path(shutil.copytree(built, tmp_path / "out"))  # with the times at which all was built
    text = (where / "expected.txt").read_text()
    last = text[-40]
    (where / "expected.txt").write_text(f"{text[:-40]}{'1' if last == '0' else '0'}{text[-39:]}")
    run = make(where, "test", "SANITIZED=")
    assert run.returncode != 0
    assert "differ" in run.stdout


def test_the_vector_ends_with_what_result_json_says(tmp_path: Path) -> None:
    log = SAMPLES / "docking" / "log.parquet"
    where = exported("docking", tmp_path / "out")
    rows = [line.split() for line in (where / "expected.txt").read_text().splitlines()]
    counts = [leg.cycles.stop - leg.cycles.start for leg in resolve.from_log(vehiclefile.load(log.with_name("vehicle.toml")), log).phases]
    result = json.loads(build.result(analysed("docking")).model_dump_json())
    for phase, last in zip(result["phases"], (counts[0], sum(counts)), strict=True):
        row = rows[last - 1]
        for i, name in enumerate(QUANTITIES):
            estimate = phase["estimates"][name]
            assert (row[i], row[10 + i]) == (folder.bits(estimate["value"]), folder.bits(estimate["sigma"]))


@pytest.mark.skipif(not (shutil.which(ARM) and shutil.which(QEMU)), reason=f"no {ARM} or no {QEMU}")
@pytest.mark.thorough
@pytest.mark.seeds
def test_arm_gives_the_same_bytes(tmp_path: Path) -> None:
    where = exported("air-bearing", tmp_path / "out")
    run = make(where, "test", f"CC={ARM}", f"RUN={QEMU} -L /usr/arm-linux-gnueabihf", "SANITIZED=")
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.seeds
@pytest.mark.thorough
def test_the_kernel_asks_for_nothing_but_a_square_root_and_keeps_nothing(built: Path) -> None:
    objects = [f"replay-{source[:-2]}.o" for source in defined(built, "KERNEL")]
    named = subprocess.run(["nm", *objects], cwd=built, capture_output=True, text=True, check=True)
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
    assert struct.unpack(">d", bytes.fromhex(folder.bits(0.1)))[0] == 0.1


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ('cycle.command_delay_cycles="auto"', "cycle.command_delay_cycles must be stated"),
        ("imu.gyro_noise_rad_s=0", "imu.gyro_noise_rad_s must be stated"),
        ("cycle.command_delay_cycles=40", "a delay of 40 cycles, but the limit of the kernel is 19, including"),
        ("estimator.bins_per_cycle=80", "estimator.bins_per_cycle is 80, but the limit of the kernel is 64"),
        ("drift.mass=0.1", "[drift] is stated"),
        ('imu.measures="sample"', "only a log shows the number of records in a control cycle"),
        ('imu.gyro_filter={order=1, cutoff_hz="auto"}', "imu.gyro_filter (cutoff_hz, latency_s) must be stated"),
        ("imu.gyro_filter={order=0, latency_s=-0.2}", "a latency of the IMU is below 0"),
        ("imu.accel_filter={order=1, cutoff_hz=20.0, cutoff_sigma_hz=1.0}", "cutoff_sigma_hz or latency_sigma_s of a filter is not 0"),
        ("thrust.droop=0.01", "thrust.droop or thrust.cycle_droop is not 0"),
        ('thrust.failures=[{jet="roll_p1"}]', "thrust.failures is not empty"),
        ("imu.gyro_lag_s=0.01", "the kernel does not undo a low-pass"),
        ("imu.clock_drift_ppm=50", "imu.clock_drift_ppm is not 0"),
        ("cycle.command_delay_sigma_cycles=0.1", "set command_delay_sigma_cycles"),
        ('estimator.method="thesis"', "estimator.method is 'thesis'"),
    ],
)
def test_what_the_kernel_cannot_hold_is_refused(setting: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        resolve.stated(vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml", [setting]))
    assert "vehicle.toml" in str(refused.value)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("wheels.1.name=y", ".speed_step_rad_s (0: none) must be stated"),
        ("wheels.0.speed_latency_s=0.01", "speed_latency_s, speed_window_s or "),
        ("wheels.0.speed_sigma_rad_s=0.1", "speed_error_in_noise = true"),
        ('wheels.0.column="torque"', "[[wheels]] store momentum, but the kernel supports only"),
        (
            "known={ixx={value=0.3,sigma=0.01},iyy={value=0.3,sigma=0.01},izz={value=0.3,sigma=0.01}}",
            "does not support a free swing on a pedestal",
        ),
    ],
)
def test_what_the_kernel_cannot_hold_of_wheels_and_pedestals_is_refused(setting: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_text(output.vehicle_toml(flown.fly("pedestal").vehicle))
    with pytest.raises(InputError, match=re.escape(said)):
        resolve.stated(vehiclefile.load(path, [*(flown.EXACT if "step" not in said else ()), setting]))


def test_a_vehicle_with_rotors_is_refused() -> None:
    with pytest.raises(InputError, match=re.escape("[[rotors]] are stated, but the kernel supports only commands of jets or a wrench")):
        resolve.stated(vehiclefile.load(SAMPLES / "crazyflie" / "original" / "vehicle.toml"))


@pytest.mark.parametrize("stated", ["", "inertia_tolerance=0.2", "mass_tolerance=0.3"])
@pytest.mark.parametrize("relative", ["", "true", "false"])
def test_a_value_has_converged_in_flight_by_the_rule_of_the_ground(relative: str, stated: str) -> None:
    settings = [f"convergence.{one}" for one in (stated, relative and f"relative={relative}") if one]
    source = vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml", settings)
    rule = resolve.stated(source).phases[0].rule
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
