"""Sample logs with something wrong: the log, or what its vehicle file says."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.flow import Analysis
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource

SAMPLES = Path(__file__).parent.parent / "sample_logs"


@cache
def sample(name: str, seconds: float = 1e9, file: str = "log.parquet") -> tuple[Log, Vehicle]:
    """The beginning of a sample log, and its vehicle."""
    path = SAMPLES / name / file
    table = read_table(path)
    found = vehiclefile.find(path, None, table.embedded_vehicle, ())
    log = read(table, found.vehicle)
    cycles = int(min(log.cycles, round(seconds / found.vehicle.cycle.period_s)))
    records = cycles * log.records_per_cycle
    cut = replace(
        log,
        rows=records,
        time_s=log.time_s[:records],
        interval_s=log.interval_s[:records],
        delta_theta_imu_rad=log.delta_theta_imu_rad[:records],
        delta_v_imu_m_s=log.delta_v_imu_m_s[:records],
        command=log.command[:cycles],
        attitude_wxyz=None if log.attitude_wxyz is None else log.attitude_wxyz[:records],
    )
    return cut, found.vehicle


def truth(name: str, phase: int = 0) -> Array:
    """(10,)"""
    stated = json.loads((SAMPLES / name / "truth.json").read_text())["phases"][phase]
    return np.array([stated[quantity] for quantity in QUANTITIES])


def stated(used: Vehicle, *assignments: str) -> Vehicle:
    """With ``--set`` assignments."""
    return vehiclefile.changed(used, assignments)


def pushing(used: Vehicle, factors: Mapping[str, float]) -> Vehicle:
    """With jets that the vehicle file gives another force than they have: ``factors`` on what it says now."""
    index = {jet.name: i for i, jet in enumerate(used.jets)}
    return stated(used, *(f"jets.{index[name]}.force_n={[f * x for x in used.jets[index[name]].force_n]}" for name, f in factors.items()))


def low_passed(log: Log, hertz: float, sensor: Literal["gyro", "accel"] = "accel") -> Log:
    """A sensor behind a first-order low-pass."""
    increments = log.delta_v_imu_m_s if sensor == "accel" else log.delta_theta_imu_rad
    part = 1 - np.exp(-2 * np.pi * hertz * log.interval_s)
    passed, now = np.empty_like(increments), increments[0]
    for k, (share, increment) in enumerate(zip(part, increments, strict=True)):
        now = now + share * (increment - now)
        passed[k] = now
    return replace(log, delta_v_imu_m_s=passed) if sensor == "accel" else replace(log, delta_theta_imu_rad=passed)


def examined(log: Log, used: Vehicle, assignments: Sequence[str] = ()) -> Analysis:
    """As the command does it."""
    with np.errstate(all="ignore"):
        return flow.examine(log, VehicleSource(used, "vehicle.toml", ""), assignments)


def verdicts(found: Analysis, phase: int = 0) -> dict[str, str]:
    return {name: str(estimate.verdict) for name, estimate in found.conclusions[phase].estimates.items()}


def z_scores(found: Analysis, true: Array, phase: int = 0) -> dict[str, float]:
    """How many of its sigmas each value is off."""
    estimates = found.conclusions[phase].estimates
    return {
        name: (e.value - t) / e.sigma
        for (name, e), t in zip(estimates.items(), true, strict=True)
        if e.value is not None and e.sigma is not None
    }


def looks_good_and_is_wrong(found: Analysis, true: Array, phase: int = 0) -> list[str]:
    """Quantities that are called converged, and are more than 4 sigma and 0.5 % of their size off."""
    sizes = found.histories[phase].natural_sizes.copy()
    own = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz", "mass")]
    sizes[own] = np.minimum(sizes[own], true[own])
    z = z_scores(found, true, phase)
    wrong = []
    for name, t, size in zip(QUANTITIES, true, sizes, strict=True):
        estimate = found.conclusions[phase].estimates[name]
        if estimate.verdict == "converged" and abs(z[name]) > 4 and abs((estimate.value or 0.0) - t) > 0.005 * size:
            wrong.append(name)
    return wrong


def with_increments(log: Log, turned: Array, felt: Array) -> Log:
    """With other readings of the IMU."""
    return replace(log, delta_theta_imu_rad=turned, delta_v_imu_m_s=felt)


def losing(log: Log, count: int, seed: int) -> Log:
    """With commands of so many other cycles in cycles that had none, which no jet ever got."""
    rng = np.random.default_rng(seed)
    idle, busy = np.flatnonzero(~log.command.any(1)), np.flatnonzero(log.command.any(1))
    command = log.command.copy()
    command[rng.choice(idle, count, replace=False)] = log.command[rng.choice(busy, count)]
    return replace(log, command=command)
