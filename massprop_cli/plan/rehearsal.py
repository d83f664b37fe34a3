"""Simulation of motions before the test: their information about each body within the guess's spread, and their use of the limits."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.actuators.actuator import called
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.geometry import uncertain_jets
from massprop_cli.plan.guess import Guess, input_error, unstated
from massprop_cli.plan.limits import used
from massprop_cli.testbed import bound, exchange, mission
from massprop_cli.testbed.conditions import Control
from massprop_cli.testbed.motion import vertical
from massprop_cli.testbed.scenario import Scenario, ScenarioSource, turned_by_wheels_alone
from massprop_cli.testbed.simulate import MemberChange, fly
from massprop_cli.testbed.timeline import AXES, TURNS, Axis, Segment

BANDWIDTH, PHASE = 1.0, 0.15
"""Largest bandwidth of the attitude hold, rad/s, and largest phase loss at it from delay, 1.5 cycles and lag, rad, for good damping."""


@dataclass(frozen=True)
class Rehearsal:
    """Model for the simulations of a plan: vehicle, guess and attitude hold."""

    vehicle: Vehicle
    guess: Guess
    control: Control
    source: str
    """Path of the file that states the guess."""

    def scenario(self, segments: Sequence[Segment], cycles: int, name: str = "plan") -> ScenarioSource:
        """The scenario of these segments; raise :class:`InputError` if vehicle and guess do not give a valid one."""
        content: dict[str, Any] = {
            "schema": 1,
            "name": name,
            "duration_cycles": cycles,
            "truth": self.guess.file.body,
            "sensors": self.guess.file.sensors,
            "actuators": self.guess.file.actuators,
            "control": self.control,
            "plan": tuple(segments),
            "vehicle": self.vehicle,
        }
        try:
            return ScenarioSource(Scenario.model_validate(content), self.source)
        except ValidationError as error:
            raise InputError(f"{self.source}: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from None

    def flown(self, segments: Sequence[Segment], cycles: int, bodies: Array, seeds: Sequence[int] = (1,)) -> tuple[Array, dict[str, float]]:
        """Issued commands (S, K, C), and the largest use of each limit, without sensor noise.

        The S members are all ``bodies`` (G, 10) with the first seed, then all with the second, and so on.
        """
        source = bound.noise_free(self.scenario(segments, cycles))
        members = np.tile(bodies, (len(seeds), 1))
        change = MemberChange(bound.as_bodies(members), np.zeros((3, len(members))))
        flight = fly(source, np.repeat(seeds, len(bodies)).tolist(), changes={0: change}, fine=False)
        return flight.issued, used(flight)

    def information(self, cycles: int, issued: Array, bodies: Array) -> Array:
        """(S, K, 13 or 14, 13 or 14) information matrix of each cycle (:func:`massprop_cli.testbed.bound.information`).

        With momentum devices, the 14th parameter is the thrust scale, which the log informs. Without, the thrust scale adds to the sigmas
        (:meth:`massprop_cli.plan.choose.PlanGoal.covariance`).
        """
        scale = np.array([[0.0, 0.0, 0.0, self.vehicle.thrust.scale_sigma]])
        return bound.information(self.scenario((), cycles), issued, bodies, scale if self.vehicle.spinning else bound.NOTHING, fine=False)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes that the actuators can drive in both directions without disturbing the others."""
        allocation = mission.allocation(self.scenario((), 10 + int(self.delay_cycles)))
        driven = [0.0 not in allocation.largest(i, self.by_wheels and axis in TURNS) for i, axis in enumerate(AXES)]
        return tuple(axis for axis, both in zip(AXES, driven, strict=True) if both)  # type: ignore[misc]

    @property
    def by_wheels(self) -> bool:
        """Whether only momentum devices give the vehicle torque."""
        return turned_by_wheels_alone(self.vehicle, self.guess.file.actuators)

    @property
    def wrench_point_unknown(self) -> bool:
        """Whether the vehicle file does not state if commanded torques are about O or about the CG."""
        commanded = not (self.vehicle.jets or self.vehicle.rotors or self.by_wheels)
        return commanded and "wrench_point_m" not in self.vehicle.thrust.model_fields_set

    @property
    def delay_cycles(self) -> float:
        """Delay from command to execution, control cycles: of the guess, else of the vehicle file."""
        guessed = self.guess.file.actuators.delay_cycles
        return guessed if guessed is not None else float(self.vehicle.cycle.command_delay_cycles)


def rehearsal(vehicle: VehicleSource, guess: Guess, off: Sequence[str] = ()) -> Rehearsal:
    """The model without the jets ``off``; raise :class:`InputError` without usable actuators or without noise levels."""
    stated = vehicle.vehicle
    unknown = [name for name in off if name not in [jet.name for jet in stated.jets]]
    if unknown:
        raise InputError(
            f"--without {unknown[0]}: {vehicle.source} has no such jet; it has {', '.join(j.name for j in stated.jets) or 'none'}"
        )
    jets = tuple(jet for jet in stated.jets if jet.name not in off)
    limits = guess.file.actuators
    if stated.rotors:
        raise InputError(
            f"{vehicle.source}: has [[rotors]], and massprop cannot plan for a hovering vehicle; state its motions in a scenario, and run "
            "it with massprop simulate"
        )
    full = limits.max_torque_n_m or limits.max_force_n or exchange.full(stated, limits).any()
    if stated.spinning and not (jets or full):
        raise InputError(
            f"{vehicle.source}: turns by its {called(stated.spinning)}, whose limits are not stated; state in a guess file [actuators] "
            "max_wheel_torque_n_m, or max_gimbal_rate_rad_s of control moment gyros"
        )
    if not jets and (stated.jets or not full):
        raise InputError(
            f"{vehicle.source}: --without leaves no jet to plan with; leave one on"
            if stated.jets
            else f"{vehicle.source}: no actuators to plan with: it has no jets; add [[jets]], or for a vehicle that takes wrench commands "
            "state its full torque and force in a guess file ([actuators] max_torque_n_m, max_force_n)"
        )
    lacking = unstated(stated, guess.file.sensors, limits)
    if lacking:
        raise input_error(vehicle, lacking)
    planned = stated.model_copy(update={"jets": jets, "phases": (), "docking": None, "columns": {}})
    if stated.thrust.failures:  # they are of another log
        planned = planned.model_copy(update={"thrust": stated.thrust.model_copy(update={"failures": ()})})
    return Rehearsal(planned, guess, _control(planned, guess), guess.source)


def _control(vehicle: Vehicle, guess: Guess) -> Control:
    """Critically damped attitude hold with gains D = 2 ω I on the rate and K = 2 (ω² I + m g s) on the quaternion's vector part.

    K has the factor 2 because the vector part is half the angle. m g s is the largest gravity torque of a CG off the pivot. ω is low enough
    for the delay and the lag.
    """
    period = vehicle.cycle.period_s
    true_actuators = guess.file.actuators
    delay = float(vehicle.cycle.command_delay_cycles) if true_actuators.delay_cycles is None else true_actuators.delay_cycles
    lag = vehicle.thrust.stated_lag_s if true_actuators.lag_s is None else true_actuators.lag_s
    bandwidth = min(BANDWIDTH, PHASE / ((delay + 1.5) * period + lag))
    inertia = np.diag(guess.file.body.inertia)
    gravity_n_m = np.linalg.norm(_weight_moment(vehicle, guess.file.body.values))
    rate, attitude = 2 * bandwidth * inertia, 2 * (bandwidth**2 * inertia + gravity_n_m)
    return Control(rate_gain_n_m_s=_rounded(rate), attitude_gain_n_m=_rounded(attitude))


def _rounded(values: Array) -> tuple[float, float, float]:
    """Three values to three significant digits, for a readable scenario file."""
    x, y, z = (float(f"{value:.3g}") for value in values)
    return x, y, z


def _weight_moment(vehicle: Vehicle, body: Array) -> Array:
    """(…, 3) weight times the CG's position from the pivot for bodies (…, 10), N m; 0 without a pivot."""
    environment = vehicle.environment
    weight = (body[..., 9:] - environment.bearing_mass_kg) * environment.gravity_m_s2 * vehicle.pivoted
    return np.asarray(weight * (body[..., 6:9] - environment.bearing_position_m))


def excess_gravity_torque(rehearsal: Rehearsal) -> tuple[float, float] | None:
    """Initial gravity torque of a table and the smaller full torque of its wheels, N m; None if the wheels can hold the table."""
    vehicle = rehearsal.vehicle
    down = -vertical(np.array(vehicle.environment.initial_attitude_wxyz))
    torque = np.abs(np.cross(_weight_moment(vehicle, rehearsal.guess.bodies), down)).max(0)
    full = exchange.full(vehicle, rehearsal.guess.file.actuators)
    axis = int(np.argmax(torque - full))
    return (float(torque[axis]), float(full[axis])) if rehearsal.by_wheels and torque[axis] > full[axis] else None


SEEDS = (1, 2)
"""Seeds of the estimated logs of a plan."""


def outside_bound(vehicle: Vehicle) -> list[str]:
    """Vehicle-file keys of uncertainties that increase an estimate's sigmas, but are not in the Cramér–Rao bound of the IMU noise."""
    stated = {
        "environment.disturbance_torque_n_m": vehicle.environment.disturbance_torque_n_m,
        "environment.disturbance_walk_n_m": vehicle.environment.disturbance_walk_n_m,
        "environment.damping_sigma_n_m_s": vehicle.environment.damping_sigma_n_m_s,
        "thrust.pulse_sigma": vehicle.thrust.pulse_sigma,
        "thrust.lag_sigma_s": vehicle.thrust.lag_sigma_s,
        "cycle.command_delay_sigma_cycles": vehicle.cycle.command_delay_sigma_cycles,
        "imu.gyro_lag_sigma_s": vehicle.imu.gyro_lag_sigma_s,
        "imu.accel_lag_sigma_s": vehicle.imu.accel_lag_sigma_s,
        "imu.gyro_bias_sigma_rad_s": vehicle.imu.gyro_bias_sigma_rad_s,
        "imu.accel_bias_sigma_m_s2": vehicle.imu.accel_bias_sigma_m_s2,
        "imu.position_sigma_m": vehicle.imu.position_sigma_m,
        "imu.mounting_sigma_rad": vehicle.imu.mounting_sigma_rad,
        "sigmas of [[jets]]": float(len(uncertain_jets(vehicle).kinds)),
        "uncertain": float(len(vehicle.uncertain)),
        **{f"sigmas of [[{device.TABLE}]]": float(len(device.unknowns)) for device in vehicle.spinning},
    }
    return [key for key, value in stated.items() if value > 0]


def beyond_bound(rehearsal: Rehearsal, segments: Sequence[Segment], cycles: int, bounds: Array) -> tuple[Array, Array]:
    """(10,) ratio of an estimate's sigma to its Cramér–Rao bound, and (10,) sigma that remains after any duration.

    ``bounds`` (2, 10) holds the bounds of half the log and of the whole. The variances of both estimates (rms over :data:`SEEDS`) are
    ratio² × bound² + floor². So what only a prior tells is the floor, and a noise beside the IMU's is the ratio.
    """
    flight = fly(rehearsal.scenario(segments, cycles), SEEDS)

    def variances(log: Log) -> Array:
        try:
            analysis = flow.examine(log, VehicleSource(flight.vehicle, rehearsal.source, ""))
        except InputError:  # too short
            return np.full(10, np.inf)
        return np.diag(analysis.conclusions[0].bare[1])

    half, whole = np.array([[variances(log.part(0, cycles // 2)), variances(log)] for log in map(flight.log, range(len(SEEDS)))]).mean(0)
    excess = np.maximum(np.nan_to_num(whole - bounds[1] ** 2), 0.0)
    by_time = np.nan_to_num((half - whole) / (bounds[0] ** 2 - bounds[1] ** 2), nan=np.inf) - 1
    falling = np.clip(by_time, 0.0, excess / bounds[1] ** 2)
    return np.sqrt(1 + falling), np.sqrt(np.maximum(excess - falling * bounds[1] ** 2, 0.0))
