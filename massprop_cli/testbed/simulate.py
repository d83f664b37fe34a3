"""Fly a scenario: plan, commands, executed wrench, motion, IMU, cycle after cycle, all seeds at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprop_cli.arrays import Array, frozen
from massprop_cli.errors import InputError
from massprop_cli.telemetry import Log, saturation
from massprop_cli.testbed import imu, mission, truth
from massprop_cli.testbed.actuators import Actuators
from massprop_cli.testbed.motion import (
    Bearing,
    Bodies,
    CycleMotion,
    Dynamics,
    Wrench,
    compose,
    compose_all,
    cross,
    quaternions,
    rotation_vectors,
    vertical,
)
from massprop_cli.testbed.scenario import Control, Scenario, ScenarioSource
from massprop_cli.testbed.timeline import Event
from massprop_cli.vehicle import Phase, Vehicle

BINS = 20
"""At least this many bins in a cycle."""
ABSURD = 1e6
"""No IMU logs more than this, per second."""
STREAMS = ("plan", "pulses", "gyro", "accelerometer", "disturbance")
"""Each has random numbers of its own, so that switching one off leaves the others as they were."""
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Flight:
    """What was logged and what was true, S members, K cycles of N records."""

    vehicle: Vehicle
    """As the log's users get it, with the phases that events make."""
    seeds: tuple[int, ...]
    logs_attitude: bool
    time_s: Array
    """(K N,) end of each record."""
    delta_theta_rad: Array
    """(S, K N, 3) IMU axes."""
    delta_v_m_s: Array
    """(S, K N, 3) IMU axes."""
    issued: Array
    """(S, K, C) on-times in s, or wrench in N m and N, as issued in each cycle."""
    attitude_wxyz: Array
    """(S, K N + 1, 4) true attitude at the start and after each record."""
    rate_rad_s: Array
    """(S, K + 1, 3) true body rate at cycle edges, after what happens there."""
    events: tuple[tuple[int, str], ...]
    phases: tuple[Phase, ...]
    truth: Array
    """(S, phases, 10) at the end of each phase."""
    docked: Array | None
    """(10,) true object that docked."""

    def log(self, member: int) -> Log:
        """One member's log, as reading its file gives it."""
        records = len(self.time_s) // self.issued.shape[1]
        interval = np.diff(self.time_s, prepend=0.0)
        theta, velocity = self.delta_theta_rad[member], self.delta_v_m_s[member]
        return Log(
            path=Path(f"seed-{self.seeds[member]}"),
            sha256="",
            rows=len(self.time_s),
            records_per_cycle=records,
            time_s=self.time_s,
            interval_s=frozen(interval),
            delta_theta_imu_rad=theta,
            delta_v_imu_m_s=velocity,
            command_kind="jets" if self.vehicle.jets else "wrench",
            command=self.issued[member],
            attitude_wxyz=self.attitude_wxyz[member, 1:] if self.logs_attitude else None,
            notices=tuple(saturation(self.vehicle, theta / interval[:, None], velocity / interval[:, None])),
        )


@dataclass(frozen=True)
class Change:
    """Members made different from the scenario, to see what difference it makes."""

    bodies: Bodies
    """One per member, in place of what the scenario has."""
    rate: Array
    """(3, S) added to the body rate, rad/s."""


def fly(
    source: ScenarioSource,
    seeds: Sequence[int],
    issued: Array | None = None,
    changes: Mapping[int, Change] | None = None,
    progress: Progress | None = None,
) -> Flight:
    """Fly one member per seed.

    ``issued`` (K, C) or (S, K, C) flies recorded commands open loop instead of the plan; ``changes`` happen at the start of their cycle.
    :class:`InputError` where the plan can't be flown or the motion runs away.
    """
    scenario = source.scenario
    rngs = {name: [np.random.default_rng([seed, i]) for seed in seeds] for i, name in enumerate(STREAMS)}
    members, cycles, period = len(seeds), scenario.cycles, scenario.vehicle.cycle.period_s
    bins = _bins(scenario)
    width = period / bins
    allocated = mission.allocation(source)
    plan = mission.plan(scenario, allocated, rngs["plan"]) if issued is None else None
    actuators = _actuators(scenario, rngs["pulses"], width * np.arange(bins + 1), issued)
    gyro, accelerometer = imu.gyro(scenario, rngs["gyro"]), imu.accelerometer(scenario, rngs["accelerometer"])
    torque, drag = _disturbance(scenario, rngs["disturbance"]), np.array(scenario.disturbance.rate_n_m_s)
    bearing = _bearing(scenario.vehicle)
    body = truth.bodies(scenario.truth, members)
    events = {event.at(period): event for event in scenario.events}
    phases = scenario.phases
    ends = [_end_cycle(phase, period, cycles) for phase in phases]
    found = np.zeros((members, len(phases), 10))

    records = scenario.sensors.records_per_cycle
    attitude, rate = np.empty((members, cycles * records + 1, 4)), np.empty((members, cycles + 1, 3))
    initial = np.array(scenario.vehicle.environment.initial_attitude_wxyz)
    attitude[:, 0], rate[:, 0] = initial, scenario.initial.rate_rad_s
    onboard = _Onboard(scenario.control, np.repeat(initial[:, None], members, 1))
    position = np.array(scenario.vehicle.imu.position_m)
    for k in range(cycles):
        jump: Array | float = 0.0
        if k in events:
            body, after, jump = _happen(events[k], scenario, body, rate[:, k].T, position)
            rate[:, k] = after.T
        if changes is not None and k in changes:
            body = changes[k].bodies
            rate[:, k] += changes[k].rate.T
        if plan is not None:
            demand = plan.demand[:, k]
            if plan.held[k].any():
                demand = demand + np.pad(onboard.torque() * plan.held[k], ((0, 0), (0, 3)))
            actuators.issue(k, allocated.commands(demand))
        mean, gathered, burn_s = actuators.execute(k)
        disturbing = (torque[:, :, k] - (drag * rate[:, k]).T)[..., None]
        mean[:3] += disturbing
        gathered[:3] += disturbing * (width / 2)
        dynamics = Dynamics(body, bearing)
        up = vertical(attitude[:, k * records].T) if bearing else np.zeros((3, members))
        motion = dynamics.advance(rate[:, k].T, up, Wrench(mean, gathered), width)
        rate[:, k + 1] = motion.rate_end.T
        attitude[:, k * records + 1 : (k + 1) * records + 1] = _attitudes(attitude[:, k * records].T, motion, width, records)
        per_record = (3, members, records, -1)
        angle = gyro.sense(k, motion.rate.reshape(per_record).mean(-1))
        felt = dynamics.specific_force(motion, mean[3:], position, width)
        accelerometer.sense(k, felt.reshape(per_record).mean(-1), jump)
        onboard.sense(angle, np.array(scenario.vehicle.imu.body_from_imu), period)
        if scenario.fuel is not None:
            impulse = np.abs(burn_s) @ np.linalg.norm(actuators.wrench[:, 3:], axis=1)
            body = truth.burnt(body, scenario.fuel, impulse, bearing.mass if bearing else 0.0)
            _check_body(source, body, bearing, seeds, period * (k + 1))
        for i, end in enumerate(ends):
            if end == k + 1:
                found[:, i] = truth.values(body)
        _check_motion(source, rate[:, k + 1], seeds, period, period * (k + 1))
        if progress is not None and k % 16 == 0:
            progress((k + 1) / cycles)
    for name, sensor in (("gyro", gyro), ("accelerometer", accelerometer)):
        if not np.abs(sensor.increments).max() / sensor.record_s < ABSURD:
            raise InputError(
                f"{source.source}: the {name} would log more than {ABSURD:g} per second; check noise, bias, IMU position, forces"
            )
    return Flight(
        vehicle=scenario.vehicle.model_copy(update={"phases": phases}) if events else scenario.vehicle,
        seeds=tuple(seeds),
        logs_attitude=scenario.sensors.log_attitude,
        time_s=frozen(_record_ends(scenario)),
        delta_theta_rad=frozen(_flat(gyro.increments)),
        delta_v_m_s=frozen(_flat(accelerometer.increments)),
        issued=frozen(actuators.issued),
        attitude_wxyz=frozen(attitude),
        rate_rad_s=frozen(rate),
        events=tuple((k, event.kind) for k, event in sorted(events.items())),
        phases=phases,
        truth=frozen(found),
        docked=None if scenario.docked is None else scenario.docked.values,
    )


@dataclass
class _Onboard:
    """The vehicle's own attitude control: attitude integrated from the gyro, PD law with the rates of the cycle before."""

    control: Control | None
    attitude: Array

    def __post_init__(self) -> None:
        self.target = self.attitude.copy()
        self.rate = np.zeros((3, self.attitude.shape[1]))

    def sense(self, angle_imu: Array, body_from_imu: Array, period_s: float) -> None:
        """Take a cycle's angle increment, (3, S) IMU axes."""
        if self.control is None:
            return
        angle = np.einsum("ij,js->is", body_from_imu, angle_imu)
        self.rate = angle / period_s
        self.attitude = compose(self.attitude, quaternions(angle))

    def torque(self) -> Array:
        """(S, 3) ``ω × Î ω − D ω − K q_vec``, N m."""
        assert self.control is not None
        inertia, rate_gain, attitude_gain = (
            np.array(gains)[:, None] for gains in (self.control.inertia_kg_m2, self.control.rate_gain_n_m_s, self.control.attitude_gain_n_m)
        )
        error = compose(self.target * np.array([1.0, -1.0, -1.0, -1.0])[:, None], self.attitude)
        error = error * np.where(error[0] < 0, -1.0, 1.0)
        torque: Array = cross(self.rate, inertia * self.rate) - rate_gain * self.rate - attitude_gain * error[1:]
        return torque.T


def _check_motion(source: ScenarioSource, rate: Array, seeds: Sequence[int], period_s: float, time_s: float) -> None:
    wild = ~(np.abs(rate).max(1) <= 1 / period_s)
    if wild.any():
        raise InputError(
            f"{source.source}, seed {seeds[int(np.argmax(wild))]}: the vehicle turns faster than one radian per cycle at {time_s:g} s; "
            "check gains, delay, torques, disturbance and inertia"
        )


def _check_body(source: ScenarioSource, body: Bodies, bearing: Bearing | None, seeds: Sequence[int], time_s: float) -> None:
    left = body.mass - (bearing.mass if bearing else 0.0)
    least = np.linalg.eigvalsh(np.moveaxis(body.inertia, -1, 0))[:, 0]
    gone = ~((left > 0) & (least > 0))
    if gone.any():
        member = int(np.argmax(gone))
        raise InputError(
            f"{source.source}, seed {seeds[member]}: at {time_s:g} s the fuel burnt leaves no body (mass {left[member]:.4g} kg, least "
            f"moment of inertia {least[member]:.4g} kg m^2); raise fuel.specific_impulse_s, or mend fuel.tank_position_m"
        )


def _end_cycle(phase: Phase, period_s: float, cycles: int) -> int:
    return int(min(cycles, np.floor(phase.end_s / period_s + 1e-6)))


def _bins(scenario: Scenario) -> int:
    """Bins in a cycle: a multiple of the records, and of the ticks where there are a moderate number of them."""
    records, tick = scenario.sensors.records_per_cycle, scenario.tick_s
    ticks = round(scenario.vehicle.cycle.period_s / tick) if tick else 1
    base = int(np.lcm(records, ticks)) if ticks <= 4 * BINS and np.lcm(records, ticks) <= 10 * BINS else records
    return base * -(-BINS // base)


def _actuators(scenario: Scenario, rngs: list[np.random.Generator], edges_s: Array, issued: Array | None) -> Actuators:
    vehicle, real = scenario.vehicle, scenario.actuators
    wrench = vehicle.jet_wrench if vehicle.jets else np.eye(6)
    shape = (scenario.cycles, len(wrench))
    sigma = vehicle.thrust.pulse_sigma if real.pulse_sigma is None else real.pulse_sigma
    strength = real.scale * np.stack([1 + sigma * rng.standard_normal(shape) if sigma else np.ones(shape) for rng in rngs])
    start = vehicle.cycle.period_s * (np.arange(scenario.cycles) + scenario.delay_cycles)  # of execution
    for failure in real.failures:
        failed = (start >= failure.start_s - 1e-9) & (start < (np.inf if failure.end_s is None else failure.end_s) - 1e-9)
        strength[:, failed, [jet.name for jet in vehicle.jets].index(failure.jet)] *= failure.thrust
    actuators = Actuators(scenario, wrench, strength, edges_s)
    if issued is not None:
        actuators.issued[:] = issued
    return actuators


def _disturbance(scenario: Scenario, rngs: list[np.random.Generator]) -> Array:
    """(3, S, K) torque that does not depend on the motion, N m."""
    stated, real = scenario.vehicle.environment, scenario.disturbance
    white = stated.disturbance_torque_n_m if real.torque_n_m is None else real.torque_n_m
    walk = stated.disturbance_walk_n_m if real.walk_n_m is None else real.walk_n_m
    shape = (scenario.cycles, 3)
    drawn = np.stack([white * rng.standard_normal(shape) + np.cumsum(walk * rng.standard_normal(shape), 0) for rng in rngs])
    middle = scenario.vehicle.cycle.period_s * (np.arange(scenario.cycles) + 0.5)
    periodic = np.sin(2 * np.pi / real.periodic_s * middle)[:, None] * np.array(real.periodic_n_m)
    return np.moveaxis(drawn + periodic + np.array(real.constant_n_m), -1, 0)


def _bearing(vehicle: Vehicle) -> Bearing | None:
    if not vehicle.on_air_bearing:
        return None
    environment = vehicle.environment
    return Bearing(np.array(environment.bearing_position_m), environment.bearing_mass_kg, environment.gravity_m_s2)


def _happen(event: Event, scenario: Scenario, body: Bodies, rate: Array, position: Array) -> tuple[Bodies, Array, Array | float]:
    """Body, rate and jump of the IMU's velocity after an event."""
    if event.kind == "reset" or scenario.docked is None:
        return body, rate, 0.0
    other = truth.bodies(scenario.docked, rate.shape[1])
    fixed = scenario.vehicle.environment.bearing_mass_kg if scenario.vehicle.on_air_bearing else 0.0
    combined = truth.joined(body, other, fixed)
    return combined, *truth.docked_motion(body, other, combined, rate, position, event)


def _attitudes(attitude: Array, motion: CycleMotion, width_s: float, records: int) -> Array:
    """(S, N, 4) after each record of a cycle that begins at ``attitude`` (4, S)."""
    turns = quaternions(rotation_vectors(motion, width_s))
    turns = compose_all(turns.reshape(4, attitude.shape[1], records, -1))
    found = np.empty((attitude.shape[1], records, 4))
    for record in range(records):
        attitude = compose(attitude, turns[..., record])
        attitude = attitude / np.sqrt((attitude * attitude).sum(0))
        found[:, record] = attitude.T
    return found


def _record_ends(scenario: Scenario) -> Array:
    records = scenario.sensors.records_per_cycle
    step = scenario.vehicle.cycle.period_s / records
    return np.round(np.arange(1, scenario.cycles * records + 1) * step, 12)


def _flat(increments: Array) -> Array:
    """(3, S, K, N) to (S, K N, 3)."""
    moved: Any = np.moveaxis(increments, 0, -1)
    return np.ascontiguousarray(moved.reshape(moved.shape[0], -1, 3))
