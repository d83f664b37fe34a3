"""Motions flown in software before they are flown: what they tell of every body that the vehicle may be, and what they take."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.actuators.actuator import called
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.plan.guess import Guess, refused, unstated
from massprop_cli.plan.limits import used
from massprop_cli.testbed import bound, exchange, mission
from massprop_cli.testbed.conditions import Control
from massprop_cli.testbed.motion import vertical
from massprop_cli.testbed.scenario import Scenario, ScenarioSource, turned_by_wheels_alone
from massprop_cli.testbed.simulate import MemberChange, fly
from massprop_cli.testbed.timeline import AXES, TURNS, Axis, Segment

BANDWIDTH, PHASE = 1.0, 0.15
"""rad/s of the attitude hold, and the most that delay, half a cycle and lag may turn its phase (rad): it stays well damped."""


@dataclass(frozen=True)
class Rehearsal:
    """A vehicle, what it is guessed to be, and the attitude hold that it is flown with."""

    vehicle: Vehicle
    guess: Guess
    control: Control
    source: str

    def scenario(self, segments: Sequence[Segment], cycles: int, name: str = "plan") -> ScenarioSource:
        """The scenario of these segments; :class:`InputError` where vehicle and guess can't be flown."""
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
        """Commands issued (S, K, C) and what is taken, by each of (G, 10) bodies for each seed in turn, with perfect sensors."""
        source = bound.noise_free(self.scenario(segments, cycles))
        every = np.tile(bodies, (len(seeds), 1))
        change = MemberChange(bound.as_bodies(every), np.zeros((3, len(every))))
        flight = fly(source, np.repeat(seeds, len(bodies)).tolist(), changes={0: change}, fine=False)
        return flight.issued, used(flight)

    def information(self, cycles: int, issued: Array, bodies: Array) -> Array:
        """(S, K, 13 or 14, the same) of :func:`massprop_cli.testbed.bound.information`; the last is the scale of the thrust.

        With momentum devices the log tells that scale, as in an estimate; else it adds to the sigmas
        (:meth:`massprop_cli.plan.choose.PlanGoal.covariance`).
        """
        scale = np.array([[0.0, 0.0, 0.0, self.vehicle.thrust.scale_sigma]])
        return bound.information(self.scenario((), cycles), issued, bodies, scale if self.vehicle.spinning else bound.NOTHING, fine=False)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes that the actuators can drive both ways without disturbing the others."""
        found = mission.allocation(self.scenario((), 10 + int(self.delay_cycles)))
        driven = [0.0 not in found.largest(i, self.by_wheels and axis in TURNS) for i, axis in enumerate(AXES)]
        return tuple(axis for axis, both in zip(AXES, driven, strict=True) if both)  # type: ignore[misc]

    @property
    def by_wheels(self) -> bool:
        """Whether the vehicle turns by what stores momentum alone."""
        return turned_by_wheels_alone(self.vehicle, self.guess.file.actuators)

    @property
    def point_untold(self) -> bool:
        """Whether commanded torques may be about O or about the CG: nothing states it."""
        commanded = not (self.vehicle.jets or self.vehicle.rotors or self.by_wheels)
        return commanded and "wrench_point_m" not in self.vehicle.thrust.model_fields_set

    @property
    def delay_cycles(self) -> float:
        """From command to execution."""
        own = self.guess.file.actuators.delay_cycles
        return own if own is not None else float(self.vehicle.cycle.command_delay_cycles)


def rehearsal(vehicle: VehicleSource, guess: Guess, off: Sequence[str] = ()) -> Rehearsal:
    """With the jets that are off left out; :class:`InputError` where there is nothing to drive the vehicle, or no noise to plan against."""
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
        raise refused(vehicle, lacking)
    kept = stated.model_copy(update={"jets": jets, "phases": (), "docking": None, "columns": {}})
    if stated.thrust.failures:  # of another log
        kept = kept.model_copy(update={"thrust": stated.thrust.model_copy(update={"failures": ()})})
    return Rehearsal(kept, guess, _control(kept, guess), guess.source)


def _control(vehicle: Vehicle, guess: Guess) -> Control:
    """Critically damped attitude hold: ``D = 2 ω I``, ``K = 2 (ω² I + m g s)``, slow beside delay and lag.

    q_vec is half an angle; m g s is what gravity turns the body away with where its CG lies off an air bearing.
    """
    period = vehicle.cycle.period_s
    real = guess.file.actuators
    delay = float(vehicle.cycle.command_delay_cycles) if real.delay_cycles is None else real.delay_cycles
    lag = vehicle.thrust.stated_lag_s if real.lag_s is None else real.lag_s
    bandwidth = min(BANDWIDTH, PHASE / ((delay + 1.5) * period + lag))
    inertia = np.diag(guess.file.body.inertia)
    topple_n_m = np.linalg.norm(_pull(vehicle, guess.file.body.values))
    rate, attitude = 2 * bandwidth * inertia, 2 * (bandwidth**2 * inertia + topple_n_m)
    return Control(rate_gain_n_m_s=_rounded(rate), attitude_gain_n_m=_rounded(attitude))


def _rounded(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(f"{value:.3g}") for value in values)
    return x, y, z


def _pull(vehicle: Vehicle, body: Array) -> Array:
    """(…, 3) weight of bodies (…, 10) times the place of their CG from the pivot, N m; 0 where there is none."""
    environment = vehicle.environment
    weight = (body[..., 9:] - environment.bearing_mass_kg) * environment.gravity_m_s2 * vehicle.pivoted
    return np.asarray(weight * (body[..., 6:9] - environment.bearing_position_m))


def unheld(rehearsal: Rehearsal) -> tuple[float, float] | None:
    """The torque [N m] of a table's weight as a log begins that its wheels can't hold, and what they hold; None where they can."""
    vehicle = rehearsal.vehicle
    down = -vertical(np.array(vehicle.environment.initial_attitude_wxyz))
    torque = np.abs(np.cross(_pull(vehicle, rehearsal.guess.bodies), down)).max(0)
    full = exchange.full(vehicle, rehearsal.guess.file.actuators)
    axis = int(np.argmax(torque - full))
    return (float(torque[axis]), float(full[axis])) if rehearsal.by_wheels and torque[axis] > full[axis] else None


SEEDS = (1, 2)


def uncounted(vehicle: Vehicle) -> list[str]:
    """Keys of the vehicle file that widen sigmas and are no noise of the IMU: the bound doesn't count them."""
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
        **{f"sigmas of [[{device.TABLE}]]": float(len(device.unknowns)) for device in vehicle.spinning},
    }
    return [key for key, value in stated.items() if value > 0]


def beyond_bound(rehearsal: Rehearsal, segments: Sequence[Segment], cycles: int, bound: Array) -> Array:
    """(10,) sigmas of estimates, rms over :data:`SEEDS`, over the ``bound`` (10,), at least 1; 1 where it says nothing."""
    source = rehearsal.scenario(segments, cycles)
    flight = fly(source, SEEDS)
    found = []
    for member in range(len(SEEDS)):
        estimated = flow.examine(flight.log(member), VehicleSource(flight.vehicle, rehearsal.source, ""))
        found.append(np.sqrt(np.diag(estimated.conclusions[0].bare[1])) / bound)
    ratio = np.sqrt((np.array(found) ** 2).mean(0))
    return np.asarray(np.where(np.isfinite(ratio), np.maximum(ratio, 1.0), 1.0))
