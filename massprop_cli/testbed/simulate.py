"""Simulation of a scenario, cycle by cycle for all seeds: plan, commands, executed wrench, motion, IMU."""

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
    """Logged and true data of S members, K cycles of N records."""

    vehicle: Vehicle
    """Vehicle file of the log, with the phases that events define."""
    seeds: tuple[int, ...]
    axes: tuple[bool, ...]
    """(6,) logged axes: gyro x y z, accelerometer x y z; increments exist for all axes."""
    time_s: Array
    """(K N,) end of each record, s."""
    delta_theta_rad: Array
    """(S, K N, 3) angle increments, IMU axes, rad."""
    delta_v_m_s: Array
    """(S, K N, 3) velocity increments, IMU axes, m/s."""
    issued: Array
    """(S, K, C) issued commands: on-times [s], wrench [N m, N] or x of rotors, then commands of momentum devices."""
    turning: Mapping[str, Array]
    """(S, K N) state of each momentum device at the end of each record, by log column."""
    columns: Mapping[str, Array]
    """(S, K N) log columns of momentum devices, rotors and supplies; NaN in empty cells."""
    attitude_wxyz: Array
    """(S, K N + 1, 4) true attitude at the start and at the end of each record."""
    logged_wxyz: Array | None
    """(S, K N, 4) logged attitude at the end of each record, NaN if not logged; None without an attitude log."""
    rate_rad_s: Array
    """(S, K + 1, 3) true body rate at cycle edges, after events there, rad/s."""
    events: tuple[tuple[int, str], ...]
    """Cycle and kind of each event."""
    phases: tuple[Phase, ...]
    truth: Array
    """(S, phases, 10) true quantities at the end of each phase."""
    docked: Array | None
    """(10,) true quantities of the docked object; None without one."""
    modelled: Array
    """(S, K, 10) body that the control assumed in each cycle; (S, 0, 10) with stated gains."""

    def commanded(self, member: int) -> Array:
        """(K, C) commands of one member, without those of momentum devices and rotors."""
        issued: Array = self.issued[member, :, : self.issued.shape[2] - exchange.channels(self.vehicle)]
        if self.vehicle.rotors or (self.vehicle.spinning and not self.vehicle.jets and not issued.any()):
            return issued[:, :0]
        return issued

    @property
    def kind(self) -> dict[str, Any]:
        """Fields of :class:`massprop_cli.inputs.telemetry.Log` that tell what the records are; none for increments."""
        if self.vehicle.imu.measures == "increment":
            return {}
        sampled = self.vehicle.imu.measures == "sample"
        return {"sampled": (sampled, sampled), "rate_columns": GYRO, "force_columns": ACCEL}

    def log(self, member: int) -> Log:
        """Log of one member, equal to the log read from its file."""
        records = len(self.time_s) // self.issued.shape[1]
        interval = np.diff(self.time_s, prepend=0.0)
        theta, velocity = (
            np.where(axes, increments[member], 0.0)
            for axes, increments in ((self.axes[:3], self.delta_theta_rad), (self.axes[3:], self.delta_v_m_s))
        )
        path = Path(f"seed-{self.seeds[member]}")
        table = LogTable(at_hand(path, {TIME: self.time_s} | {name: values[member] for name, values in self.columns.items()}), {})
        kind: commands.CommandKind = "jets" if self.vehicle.jets or not self.commanded(member).shape[1] else "wrench"
        command = self.commanded(member)
        if self.vehicle.rotors:
            kind, command = commands.commands(table, self.vehicle, records, len(self.time_s))
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
            cycles_apart=tuple(rotor.cycles_apart(table, records, len(self.time_s)) for rotor in self.vehicle.rotors),
            spinning=commands.momentum(table, self.vehicle, records, len(self.time_s)),
            supply=supply.read(table, self.vehicle, self.time_s, interval, records),
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
    """Simulate a scenario, one member per seed.

    ``issued``: recorded commands (K, C) or (S, K, C), flown open loop instead of the plan. ``changes``: applied at the start of their
    cycle. ``running``: constructor of the on-board estimator for the control. ``fine``: False gives sampled or filtered IMUs as few bins as
    averaging ones. Raises :class:`InputError` if the plan cannot be flown or the motion diverges.
    """
    scenario = source.scenario
    period, cycles, phases = scenario.vehicle.cycle.period_s, scenario.cycles, scenario.phases
    flying = Cycles(source, seeds, issued, changes or {}, running, fine)
    ends = [int(min(cycles, np.floor(phase.end_s / period + 1e-6))) for phase in phases]
    truth = np.zeros((len(seeds), len(phases), 10))
    k = 0
    while k < cycles:
        start, k = k, flying.fly(k)
        truth[:, [i for i, end in enumerate(ends) if start < end <= k]] = flying.truth()[:, None]
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
    """Raise :class:`InputError` if readings exceed the limit for plausible logs."""
    limit = ABSURD[GYRO[0] if name == "gyro" else ACCEL[0]]
    if not np.abs(sensor.increments).max() / sensor.record_s < limit:
        raise InputError(f"{source.source}: the {name} would log more than {limit:g} per second; check noise, bias, IMU position, forces")


def _record_ends(scenario: Scenario) -> Array:
    """(K N,) end of each record, s."""
    records = scenario.sensors.records_per_cycle
    step = scenario.vehicle.cycle.period_s / records
    return np.round(np.arange(1, scenario.cycles * records + 1) * step, 12)


def _flat(increments: Array) -> Array:
    """Reshape (3, S, K, N) to (S, K N, 3)."""
    moved: Any = np.moveaxis(increments, 0, -1)
    return np.ascontiguousarray(moved.reshape(moved.shape[0], -1, 3))


__all__ = ["MemberChange", "Progress", "SimulatedFlight", "fly"]
