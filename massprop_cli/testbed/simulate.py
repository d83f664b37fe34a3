"""Fly a scenario: plan, commands, executed wrench, motion, IMU, cycle after cycle, all seeds at once."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import commands, supply
from massprop_cli.inputs.columns import ACCEL, GYRO, TIME
from massprop_cli.inputs.imurecords import ABSURD, saturation
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.tablefile import at_hand
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.testbed import exchange, imu
from massprop_cli.testbed.cycles import Cycles, MemberChange
from massprop_cli.testbed.imu import Sensor
from massprop_cli.testbed.onboard import RunningOf
from massprop_cli.testbed.scenario import Scenario, ScenarioSource

Progress = Callable[[float], None]


@dataclass(frozen=True)
class SimulatedFlight:
    """What was logged and what was true, S members, K cycles of N records."""

    vehicle: Vehicle
    """As the log's users get it, with the phases that events make."""
    seeds: tuple[int, ...]
    axes: tuple[bool, ...]
    """Which of gyro x y z and accelerometer x y z are logged; the increments of the others are there all the same."""
    time_s: Array
    """(K N,) end of each record."""
    delta_theta_rad: Array
    """(S, K N, 3) IMU axes."""
    delta_v_m_s: Array
    """(S, K N, 3) IMU axes."""
    issued: Array
    """(S, K, C) on-times in s, wrench in N m and N, or x of rotors, then what momentum devices are told, as issued in each cycle."""
    turning: Mapping[str, Array]
    """(S, K N) what each momentum device does after each record, by the log column of that."""
    columns: Mapping[str, Array]
    """(S, K N) what the log has of momentum devices, rotors and supplies; NaN in cells that are empty."""
    attitude_wxyz: Array
    """(S, K N + 1, 4) true attitude at the start and after each record."""
    logged_wxyz: Array | None
    """(S, K N, 4) attitude as it is logged after each record, NaN where it isn't; None where the log has none."""
    rate_rad_s: Array
    """(S, K + 1, 3) true body rate at cycle edges, after what happens there."""
    events: tuple[tuple[int, str], ...]
    phases: tuple[Phase, ...]
    truth: Array
    """(S, phases, 10) at the end of each phase."""
    docked: Array | None
    """(10,) true object that docked."""
    modelled: Array
    """(S, K, 10) what the control took the body to be in each cycle; (S, 0, 10) where its gains are stated."""

    def commanded(self, member: int) -> Array:
        """(K, C) of one member, without those of momentum devices and rotors."""
        issued: Array = self.issued[member, :, : self.issued.shape[2] - exchange.channels(self.vehicle)]
        if self.vehicle.rotors or (self.vehicle.spinning and not self.vehicle.jets and not issued.any()):
            return issued[:, :0]
        return issued

    @property
    def kind(self) -> dict[str, Any]:
        """What its records are, as :class:`massprop_cli.inputs.telemetry.Log` has it: increments, or samples where the vehicle says so."""
        if self.vehicle.imu.measures == "increment":
            return {}
        sampled = self.vehicle.imu.measures == "sample"
        return {"sampled": (sampled, sampled), "rate_columns": GYRO, "force_columns": ACCEL}

    def log(self, member: int) -> Log:
        """One member's log, as reading its file gives it."""
        records = len(self.time_s) // self.issued.shape[1]
        interval = np.diff(self.time_s, prepend=0.0)
        theta, velocity = (
            np.where(axes, increments[member], 0.0)
            for axes, increments in ((self.axes[:3], self.delta_theta_rad), (self.axes[3:], self.delta_v_m_s))
        )
        path = Path(f"seed-{self.seeds[member]}")
        beside = LogTable(at_hand(path, {TIME: self.time_s} | {name: values[member] for name, values in self.columns.items()}), {})
        kind: commands.CommandKind = "jets" if self.vehicle.jets or not self.commanded(member).shape[1] else "wrench"
        command = self.commanded(member)
        if self.vehicle.rotors:
            kind, command = commands.commands(beside, self.vehicle, records, len(self.time_s))
        return Log(
            path=path,
            sha256="",
            rows=len(self.time_s),
            records_per_cycle=records,
            time_s=self.time_s,
            interval_s=frozen(interval),
            delta_theta_imu_rad=frozen(theta),
            delta_v_imu_m_s=frozen(velocity),
            axes=self.axes,
            command_kind=kind,
            command=command,
            cycles_apart=tuple(rotor.cycles_apart(beside, records, len(self.time_s)) for rotor in self.vehicle.rotors),
            spinning=commands.momentum(beside, self.vehicle, records, len(self.time_s)),
            supply=supply.read(beside, self.vehicle, self.time_s, interval, records),
            attitude_wxyz=None if self.logged_wxyz is None else self.logged_wxyz[member],
            notices=tuple(saturation(self.vehicle, theta, velocity, interval)),
            **self.kind,
        )


def fly(
    source: ScenarioSource,
    seeds: Sequence[int],
    issued: Array | None = None,
    changes: Mapping[int, MemberChange] | None = None,
    progress: Progress | None = None,
    running: RunningOf | None = None,
    fine: bool = True,
) -> SimulatedFlight:
    """Fly one member per seed.

    ``issued`` (K, C) or (S, K, C) flies recorded commands open loop instead of the plan; ``changes`` happen at the start of their cycle.
    ``running`` makes the estimator that the control may take its body from. Without ``fine`` any IMU has as few bins as one that averages.
    :class:`InputError` where the plan can't be flown or the motion runs away.
    """
    scenario = source.scenario
    period, cycles, phases = scenario.vehicle.cycle.period_s, scenario.cycles, scenario.phases
    flying = Cycles(source, seeds, issued, changes or {}, running, fine)
    ends = [int(min(cycles, np.floor(phase.end_s / period + 1e-6))) for phase in phases]
    truth = np.zeros((len(seeds), len(phases), 10))
    k = 0
    while k < cycles:
        begun, k = k, flying.fly(k)
        truth[:, [i for i, end in enumerate(ends) if begun < end <= k]] = flying.truth()[:, None]
        if progress is not None and k % 16 == 0:
            progress(k / cycles)
    for name, sensor in (("gyro", flying.gyro), ("accelerometer", flying.accelerometer)):
        _check_sensor(source, name, sensor)
    time_s = _record_ends(scenario)
    return SimulatedFlight(
        vehicle=scenario.logged,
        seeds=tuple(seeds),
        axes=scenario.sensors.axes,
        time_s=frozen(time_s),
        delta_theta_rad=frozen(_flat(flying.gyro.increments)),
        delta_v_m_s=frozen(_flat(flying.accelerometer.increments)),
        issued=frozen(np.concatenate([flying.actuators.issued, flying.exchange.issued], -1)),
        turning={name: frozen(values) for name, values in flying.exchange.turning.items()},
        columns={name: frozen(values) for name, values in {**flying.exchange.columns, **flying.actuators.columns(time_s)}.items()},
        attitude_wxyz=frozen(flying.attitude),
        logged_wxyz=imu.logged_attitude(scenario, flying.rngs["attitude"], flying.attitude),
        rate_rad_s=frozen(flying.rate),
        events=tuple((k, event.kind) for k, event in sorted(flying.events.items())),
        phases=phases,
        truth=frozen(truth),
        docked=None if scenario.docked is None else scenario.docked.values,
        modelled=frozen(flying.modelled),
    )


def _check_sensor(source: ScenarioSource, name: str, sensor: Sensor) -> None:
    most = ABSURD[GYRO[0] if name == "gyro" else ACCEL[0]]
    if not np.abs(sensor.increments).max() / sensor.record_s < most:
        raise InputError(f"{source.source}: the {name} would log more than {most:g} per second; check noise, bias, IMU position, forces")


def _record_ends(scenario: Scenario) -> Array:
    records = scenario.sensors.records_per_cycle
    step = scenario.vehicle.cycle.period_s / records
    return np.round(np.arange(1, scenario.cycles * records + 1) * step, 12)


def _flat(increments: Array) -> Array:
    """(3, S, K, N) to (S, K N, 3)."""
    moved: Any = np.moveaxis(increments, 0, -1)
    return np.ascontiguousarray(moved.reshape(moved.shape[0], -1, 3))


__all__ = ["MemberChange", "Progress", "SimulatedFlight", "fly"]
