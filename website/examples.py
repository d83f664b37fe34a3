"""Logs with something wrong, one for each page of docs/warnings and docs/verdicts.

They are faults of benchmarks/faults.py, and samples with other settings.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from massprop_cli import flow, job
from massprop_cli.base import escape
from massprop_cli.cli import app
from massprop_cli.combine import flow as combining
from massprop_cli.flow import Analysis
from massprop_cli.inputs import telemetry, vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import build, read, store
from massprop_cli.result.read import Recorded
from massprop_cli.testbed import output, scenario
from website.stage import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))

RATE, FORCE = ("rate-fit", (1, 3, 5)), ("force-fit", (1, 3, 5))
"""What the model leaves of rate and specific force."""
SEEN = ("rate-fit", (0, 2, 4))
INERTIA, MASS, WHITE = ("inertia", (0, 3, 5)), ("mass", (0,)), ("whiteness", (0, 1, 2))


@dataclass(frozen=True)
class Told:
    """What a report says, and the result that its figures are of; None where a command says it and there is no result."""

    said: dict[str, str]
    """Message by code of a warning, or reason by verdict."""
    recorded: Recorded | None = None


@dataclass(frozen=True)
class Example:
    """How it is made, and which panels of which figure show it."""

    made: Callable[[], Told]
    figure: str = ""
    panels: tuple[int, ...] = ()


def _told(found: Analysis) -> Told:
    with tempfile.TemporaryDirectory() as folder:
        store.write(Path(folder), found, escape.document(build.result(found)))
        recorded = read.read(Path(folder))
    items = {name: item for phase in recorded.result.phases for name, item in phase.estimates.items()}
    reasons = {item.verdict: f"{name}: {item.reason}" for name, item in reversed(items.items())}
    return Told(reasons | {one.code: one.message for one in recorded.result.warnings}, recorded)


def _faulty(fault: str, vehicle: str, seed: int = 1001) -> Told:
    """A fault of benchmarks/faults.py or unforeseen.py, drawn as there."""
    from unforeseen import made

    case = made(fault, vehicle, seed)
    if case is None:
        raise ValueError(f"{vehicle} can't have {fault}")
    with np.errstate(all="ignore"):
        return _told(flow.examine(case.log, VehicleSource(case.vehicle, vehicle, "")))


def _sample(log: str, *settings: str) -> Told:
    with np.errstate(all="ignore"):
        return _told(job.of_file(ROOT / "sample_logs" / log, None, list(settings)).analysis)


def _uneven() -> Told:
    """A sample in which one record lasts 1.6 times the usual interval, by a clock that is stated to be right."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sample = ROOT / "sample_logs" / "free-flyer"
    table = pq.read_table(sample / "log.parquet")
    times = table.column("time_s").to_numpy().copy()
    times[600:] += 0.6 * (times[1] - times[0])
    with tempfile.TemporaryDirectory() as folder, np.errstate(all="ignore"):
        path = Path(folder) / "log.parquet"
        pq.write_table(table.set_column(table.column_names.index("time_s"), "time_s", pa.array(times)), path)
        return _told(job.of_file(path, sample / "vehicle.toml", ["imu.clock_even=false"]).analysis)


def _unstated(log: str) -> Told:
    """A sample whose vehicle file doesn't state the gyro's noise."""
    path = ROOT / "sample_logs" / log
    table = read_table(path)
    found = vehiclefile.find(path, None, table.embedded_vehicle, ())
    imu = found.vehicle.imu.model_copy(update={"gyro_noise_rad_s": None})
    used = replace(found, vehicle=found.vehicle.model_copy(update={"imu": imu}))
    return _told(flow.examine(telemetry.read(table, used.vehicle), used))


def _recorded(kind: str, number: int) -> Told:
    """A recording of benchmarks/cases.py."""
    from case_fault import log_of
    from cases import KINDS, flown

    one = flown(number)
    knows = {"flown": one} if KINDS[kind].knowing else {}
    made = None if one is None else KINDS[kind].make(dict(one.columns), one.vehicle, np.random.default_rng(number), **knows)
    if made is None:
        raise ValueError(f"vehicle {number} can't have {kind}")
    with np.errstate(all="ignore"):
        return _told(flow.examine(log_of(made.columns, made.vehicle), VehicleSource(made.vehicle, "", "")))


def _actuator(platform: str, fault: str) -> Told:
    """A fault of benchmarks/actuator_faults.py."""
    sys.path.insert(0, str(ROOT))
    from tests.faultyactuators import examined

    return _told(examined(platform, fault))


def _sampled() -> Told:
    """A log of an IMU that is sampled, which nobody states."""
    sys.path.insert(0, str(ROOT))
    from tests import anyimu

    imu, rng = anyimu.Imu(measures="sample", offset_s=0.003), np.random.default_rng(3)
    own = anyimu.bodies(rng, 1)
    flown = anyimu.fly(rng, own, imu, 0.05, 20.0, 0.1)
    vehicle = anyimu.unstated(anyimu.vehicle_of(own, 0, flown, imu, 0.05, 0.1))
    return _told(flow.examine(anyimu.log_of(flown, 0, imu, vehicle), VehicleSource(vehicle, "sampled", "")))


def _flown(name: str, *settings: str) -> Told:
    """A scenario with other settings, estimated."""
    with tempfile.TemporaryDirectory() as folder, np.errstate(all="ignore"):
        _massprop("simulate", name, "-q", "--out", folder, *(word for one in settings for word in ("--set", one)))
        return _told(job.of_file(Path(folder) / "log.parquet").analysis)


def _wheels(scenario: str, name: str, value: float) -> Told:
    """Wheels of which a key has a value, beside a vehicle file in which it is 0."""
    keys = [f"wheels.{number}.{name}" for number in range(3)]
    with tempfile.TemporaryDirectory() as folder, np.errstate(all="ignore"):
        _massprop("simulate", scenario, "-q", "--out", folder, *(word for key in keys for word in ("--set", f"vehicle.{key}={value}")))
        return _told(job.of_file(Path(folder) / "log.parquet", None, [f"{key}=0.0" for key in keys]).analysis)


def _stated_as_none(scenario: str, plan: str, key: str, value: float) -> Told:
    """A key that is so, beside a vehicle file in which it is 0."""
    with tempfile.TemporaryDirectory() as folder, np.errstate(all="ignore"):
        settings = ("duration_s=30", f"plan=[{plan}]", f"vehicle.{key}={value}")
        _massprop("simulate", scenario, "-q", "--out", folder, *(word for one in settings for word in ("--set", one)))
        return _told(job.of_file(Path(folder) / "log.parquet", None, [f"{key}=0.0"]).analysis)


def _massprop(*arguments: str) -> None:
    done = CliRunner().invoke(app, arguments)
    if done.exit_code:
        raise ValueError(done.output)


def _simulated(name: str, *settings: str) -> Told:
    """What ``massprop simulate`` says."""
    return Told({notice.code: notice.message for notice in output.warnings(scenario.load(name, list(settings)))})


def _combined(*parts: tuple[str, str]) -> Told:
    """What ``massprop combine`` says of results: each a scenario's settings and the vehicle's."""
    with tempfile.TemporaryDirectory() as place:
        folders = []
        for n, (flown, stated) in enumerate(parts):
            folder = Path(place) / f"run-{n + 1}"
            _massprop("simulate", "free-flyer", "-q", "--seed", str(n), "--out", str(folder / "log"), *flown.split())
            _massprop("estimate", str(folder / "log" / "log.parquet"), "-q", "--out", str(folder), *stated.split())
            (folder / "log" / "log.parquet").unlink()
            folders.append(folder)
        return Told(
            {
                one.code: one.message.replace(f"{place}/", "")
                for one in combining.together([read.read(folder) for folder in folders]).warnings
            }
        )


LOOSE = (f"estimator.thesis.q1={[1e-3] * 9}", "estimator.thesis.r1=1e-3")
VIBRATING = ("disturbance.periodic_n_m=[0.05, 0.05, 0.05]", "disturbance.periodic_s=0.11")
PULSES = ", ".join(
    f'{{motion="random", axes=["{axis}"], level={level}, start_s={4 * n}, end_s={4 * n + 4}}}'
    for n, (axis, level) in enumerate((("roll", 0.3), ("pitch", 0.4), ("yaw", 0.5), ("x", 0.6), ("y", 0.3), ("z", 0.5)))
)
SHORT = ", ".join(
    f'{{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], level={level}, start_s={5 * n}, end_s={5 * n + 5}}}'
    for n, level in enumerate((0.08, 0.3, 0.12, 0.5, 0.16, 0.4))
)
CENTRED = "duration_s=24.0", f"plan=[{PULSES}]", 'actuators.pulse_at="centre"'
LATE = "sensors.log_attitude=true", "sensors.attitude_noise_rad=1e-3", "sensors.attitude_latency_s=0.05"
STRONG = 'plan=[{motion="steady",axes=["x"],force_n=9.0,start_cycle=0,end_cycle=5}]'
TURNED = "jets.0.force_n=[0.0, 0.0, -1.112]"
DOCKS = (
    "docked={ixx=8.0,iyy=7.0,izz=7.5,mass=15.0}",
    'events=[{kind="dock",cycle=500}]',
    'vehicle.phases=[{name="all",start_s=0.0,end_s=60.0}]',
)
ROLLS = '--set plan=[{motion="alternating",axes=["roll"],start_cycle=40,end_cycle=400}] --set duration_s=20'
WARNINGS: dict[str, Example] = {
    code: Example(partial(_faulty, fault, vehicle), *shown)
    for code, fault, vehicle, shown in (
        ("jet-dead", "jet-dead", "jets", RATE),
        ("jet-position", "jet-50mm", "jets", RATE),
        ("jet-direction", "jet-20deg", "jets", RATE),
        ("jets-swapped", "jets-swapped", "jets", RATE),
        ("thrust-scale", "jet-weak", "jets", RATE),
        ("command-sign", "command-sign", "wrench", RATE),
        ("thrust-rise", "rise-long", "jets", RATE),
        ("thrust-droop", "droop", "jets", RATE),
        ("thrust-lag", "lag", "jets", RATE),
        ("delay-mismatch", "delay-one", "jets", RATE),
        ("clock-drift", "clock-drift", "jets", RATE),
        ("gyro-units", "gyro-degrees", "jets", SEEN),
        ("accel-units", "accel-g", "jets", FORCE),
        ("gyro-scale", "gyro-scale-one", "jets", RATE),
        ("accel-scale", "accel-scale-one", "canted", FORCE),
        ("gyro-bias", "gyro-bias", "jets", RATE),
        ("accel-bias", "accel-bias", "jets", FORCE),
        ("gyro-filter", "gyro-filter", "jets", RATE),
        ("accel-filter", "accel-filter", "jets", FORCE),
        ("gyro-saturated", "gyro-range", "jets", SEEN),
        ("accelerometer-saturated", "accel-clipped", "jets", ("force-fit", (0, 2, 4))),
        ("outliers", "gyro-spikes", "jets", WHITE),
        ("imu-mounting", "imu-right-angle", "jets", RATE),
        ("imu-position", "imu-100mm", "jets", FORCE),
        ("mass-change", "docked", "jets", INERTIA),
        ("phase-border", "dock-off", "docking", RATE),
        ("steady-torque", "steady-torque", "jets", RATE),
        ("rate-torque", "friction", "jets", RATE),
        ("room-torque", "room-torque", "bearing", RATE),
        ("attitude-start", "attitude-start", "bearing", RATE),
        ("bearing-position", "bearing-1mm", "bearing", RATE),
        ("disturbance-torque", "walk-large", "jets", RATE),
        ("unphysical-inertia", "jet-dead", "bearing", INERTIA),
        ("contradicted", "imu-slips", "bearing", WHITE),
    )
} | {
    code: Example(partial(_sample, log, *settings), *shown)
    for code, log, settings, shown in (
        ("jet-sign", "free-flyer/log.parquet", (TURNED,), RATE),
        ("cause-unknown", "crazyflie/thrust.parquet", (), WHITE),
        ("model-discrepancy", "crazyflie/yaw.parquet", (), WHITE),
        ("timing-untold", "crazyflie/yaw.parquet", ('cycle.command_delay_cycles="auto"', 'thrust.lag_s="auto"'), WHITE),
        ("accelerometer-misfit", "crazyflie/thrust.parquet", (), FORCE),
        ("gyro-misfit", "free-flyer/log.parquet", ("imu.gyro_noise_rad_s=5e-5",), WHITE),
        ("noise-floor", "free-flyer/log.parquet", ("imu.gyro_noise_rad_s=0",), RATE),
        ("known-mismatch", "free-flyer/log.parquet", ("known.mass.value=25", "known.mass.sigma=0.01", "thrust.scale_sigma=0.01"), MASS),
        (
            "no-docked-object",
            "free-flyer/log.parquet",
            ('phases=[{name="first",start_s=0,end_s=45},{name="second",start_s=45,end_s=60}]',),
            ("mass", (0, 1)),
        ),
        ("docked-mass", "docking/log.parquet", ("docking.before=combined", "docking.after=single"), ("mass", (0, 1))),
        ("thesis-gain-divergent", "scenarios/refined/log.parquet", ("estimator.method=thesis", *LOOSE), INERTIA),
    )
} | {
    "actuator-dead": Example(partial(_actuator, "wheels", "dead"), *RATE),
    "actuators-swapped": Example(partial(_actuator, "wheels", "swapped"), *RATE),
    "command-units": Example(partial(_actuator, "rotors", "percent"), *RATE),
    "rotor-spin": Example(partial(_actuator, "rotors", "spin"), *RATE),
    "wheel-axis": Example(partial(_actuator, "wheels", "axis"), *RATE),
    "speed-units": Example(partial(_actuator, "wheels", "rpm"), *RATE),
    "gimbal-units": Example(partial(_actuator, "gyros", "one in degrees"), *RATE),
    "clock-rebuilt": Example(partial(_recorded, "clock-bursts", 9000), *RATE),
    "records-lost": Example(partial(_recorded, "records-dropped", 9000), *RATE),
    "long-interval": Example(_uneven, *RATE),
    "records-doubled": Example(partial(_recorded, "records-late", 9000), *RATE),
    "readings-held": Example(partial(_recorded, "held", 9001), *SEEN),
    "sensor-frozen": Example(partial(_recorded, "frozen", 9008), *SEEN),
    "column-kind": Example(partial(_recorded, "rates-in-increments", 9000), *SEEN),
    "accel-axes": Example(partial(_recorded, "delta-v-start", 9006), *FORCE),
    "wrench-point": Example(partial(_recorded, "wrench-about-cg", 9004), *FORCE),
    "commands-limited": Example(partial(_recorded, "saturated", 9004), *RATE),
    "commands-normalised": Example(partial(_recorded, "normalised", 9004), *RATE),
    "gravity-felt": Example(partial(_recorded, "grounded", 9003), *FORCE),
    "cycle-period": Example(partial(_sample, "free-flyer/log.parquet", "cycle.period_s=0.0505"), *RATE),
    "cycle-pace": Example(partial(_sample, "free-flyer/log.parquet", "cycle.period_s=0.05005"), *RATE),
    "noise-estimated": Example(partial(_unstated, "free-flyer/log.parquet"), *RATE),
    "jet-late": Example(partial(_flown, "free-flyer", *CENTRED[:2], "actuators.jet_delays_s={roll_n2=0.02}"), *RATE),
    "pulse-position": Example(partial(_flown, "free-flyer", *CENTRED), *RATE),
    "short-pulses": Example(partial(_stated_as_none, "free-flyer", SHORT, "thrust.least_on_s", 0.008), *RATE),
    "speed-late": Example(partial(_wheels, "wheels", "speed_latency_s", 0.02), *RATE),
    "wheel-friction": Example(partial(_wheels, "wheels-and-jets", "coulomb_friction_n_m", 5e-4), *RATE),
    "attitude-misfit": Example(partial(_flown, "testbed", *LATE), *RATE),
    "imu-kernel": Example(_sampled, *FORCE),
    "model-misfit": Example(partial(_flown, "free-flyer", *VIBRATING), *WHITE),
    "empty-columns": Example(partial(_flown, "planar", "sensors.gyro_noise_rad_s=0"), "rate-fit", (0,)),
    "fuel-use": Example(partial(_flown, "free-flyer", "fuel.specific_impulse_s=4", "vehicle.imu.accel_noise_m_s2=0.002"), *FORCE),
    "phase-over-docking": Example(partial(_simulated, "free-flyer", *DOCKS)),
    "plan-saturates": Example(partial(_simulated, "free-flyer", STRONG)),
    "results-disagree": Example(partial(_combined, ("", ""), ("", ""), ("--set truth.ixx=0.7", ""))),
    "delay-shared": Example(partial(_combined, ("", "--delay auto"), ("", "--delay auto"))),
    "delays-differ": Example(partial(_combined, ("", ""), ("--set vehicle.cycle.command_delay_cycles=3", ""))),
    "result-partial": Example(partial(_combined, (ROLLS, ""), ("", ""))),
}  # fmt: skip
VERDICTS = {
    "converged": Example(partial(_sample, "free-flyer/log.parquet"), *INERTIA),
    "not_converged": Example(partial(_sample, "free-flyer/log.parquet", 'phases=[{name="short",start_s=0,end_s=33}]'), *MASS),
    "not_excited": Example(partial(_sample, "crazyflie/yaw.parquet"), *INERTIA),
    "contradicted": Example(partial(_sample, "free-flyer/log.parquet", TURNED), *INERTIA),
    "unobservable": Example(partial(_flown, "planar"), *INERTIA),
}
