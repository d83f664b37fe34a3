"""What an estimate takes for granted, and how each of it is varied: by a percent, a millimetre, a degree, a tenth of a cycle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from massprop_cli.conclude import supply
from massprop_cli.conclude.taken import Taken, having
from massprop_cli.inputs.actuators.actuator import called
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.sensitivity import TURN, Reading, Side, Variant, imu_moved, imu_turned, late, reads_alone, turned_reading
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

DEGREE = float(np.pi / 180)
DELAY_STEP = 0.1
"""Cycles by which the delay is varied."""
AXES = "XYZ"
GYRO, ACCELEROMETER = "gyro-scale", "accelerometer-scale"
LIKELY = 0.2
"""Part by which stored momentum may be off: where nothing but momentum turns the vehicle, inertia is proportional to it, and what a log
tells of it, 50 % at best, isn't linear."""


def granted(log: Log, vehicle: Vehicle, timing: Timing, samples: Stream, more: bool = False) -> Iterator[Taken]:
    """What is varied, each about the log as it was read; ``more`` of it where something else than noise is left."""
    here = Side(samples)
    imu, stated = vehicle.imu, vehicle.imu.model_fields_set
    words = f"imu.position_m is {'stated as' if 'position_m' in stated else 'not stated and taken as'} {_vector(imu.position_m)} m"
    for i, axis in enumerate(AXES):
        variant = Variant(here, Side(here.samples, imu_moved(vehicle, i, 1e-3)), 1e-3)
        yield Taken("imu-position", f"{words}; further along {axis}", f"1 mm along {axis}", "position_m" in stated, variant, 1e-3)
    words = "as stated" if "body_from_imu" in stated else "not stated: the IMU's axes are taken as the body's"
    for i, axis in enumerate(AXES):
        message, turned = f"imu.body_from_imu is {words}; turned about {axis}", _turned(vehicle, samples, i)
        yield Taken("imu-mounting", message, f"1 degree about {axis}", "body_from_imu" in stated, turned, DEGREE)
    later = late(log, vehicle, timing, "delay")
    if later is not None:
        sigma = vehicle.cycle.command_delay_sigma_cycles
        words = "its uncertainty is in every sigma" if sigma > 0 else "taken as exact (cycle.command_delay_sigma_cycles is not stated)"
        said = "command_delay_cycles" in vehicle.cycle.model_fields_set
        message = f"the command delay is {timing.delay:.6g} cycles{'' if said else ', which nobody stated'}; {words}"
        yield Taken("command-delay", message, f"{DELAY_STEP:g} cycles", said, later, DELAY_STEP, sigma)
    if log.command_kind == "jets":
        yield from supply.droop(log, vehicle, timing, here)
        yield from supply.memory(log, vehicle, timing, here) if more else ()
    for i, axis in enumerate(AXES):
        message, scaled = f"the gyro's scale along {axis} is taken as exact", _scaled(vehicle, samples, i)
        yield Taken(f"{GYRO} {axis}", message, "1 %", False, scaled, 0.01, part_of=GYRO)
    yield Taken(GYRO, "the gyro's scale is taken as exact", "1 %", False, None, 0.01)
    yield Taken(ACCELEROMETER, "the accelerometer's scale is taken as exact", "1 %", False, None, 0.01)
    if vehicle.spinning:
        yield _wheel_inertia(log, vehicle, timing, here)
    if vehicle.on_air_bearing:
        yield from _on_bearing(vehicle, here, samples)


def _turned(vehicle: Vehicle, samples: Stream, axis: int) -> Variant | Reading:
    """The IMU turned about a body axis, per rad."""
    if reads_alone(vehicle):
        return turned_reading(axis)
    used = imu_turned(vehicle, axis, TURN)
    return Variant(Side(samples), Side(samples.changed(used), used), TURN)


def _scaled(vehicle: Vehicle, samples: Stream, axis: int) -> Variant | Reading:
    """The gyro's scale along one of its axes, relative."""
    if reads_alone(vehicle):
        own = np.array(vehicle.imu.body_from_imu)[:, axis]
        return Reading(np.outer(own, own), np.zeros((3, 3)))
    return Variant(Side(samples), Side(samples.changed(gyro=1 + 0.01 * np.eye(3)[axis])), 0.01)


def _wheel_inertia(log: Log, vehicle: Vehicle, timing: Timing, here: Side) -> Taken:
    used = vehicle.with_momentum(1.01)
    uncertain = any(unknown.scales for device in vehicle.spinning for unknown in device.unknowns)
    words = "its uncertainty is in every sigma" if uncertain else "no uncertainty of it is stated"
    message = f"inertia rests on the spin inertia or momentum that the vehicle file states of its {called(vehicle.spinning)}; {words}"
    varied = Variant(here, Side(Stream.of(log, used, timing), used), 0.01)
    return Taken("wheel-inertia", message, "1 %", True, varied, 0.01, most=LIKELY)


def _on_bearing(vehicle: Vehicle, here: Side, samples: Stream) -> Iterator[Taken]:
    environment, stated = vehicle.environment, vehicle.environment.model_fields_set
    for code, key, unit in (("bearing-mass", "bearing_mass_kg", "kg"), ("gravity", "gravity_m_s2", "m/s^2")):
        value = getattr(environment, key)
        if value > 0:
            changed = having(vehicle, "environment", key, 1.01 * value)
            message = f"environment.{key} is {'stated' if key in stated else 'not stated and taken'} as {value:g} {unit}"
            yield Taken(code, message, "1 %", key in stated, Variant(here, Side(here.samples, changed), 0.01), 0.01)
    place = environment.bearing_position_m
    for i, axis in enumerate(AXES):
        changed = having(vehicle, "environment", "bearing_position_m", _moved(place, i, 1e-4))
        message = f"environment.bearing_position_m is {_vector(place)} m; further along {axis}"
        variant = Variant(here, Side(here.samples, changed), 1e-4)
        yield Taken("bearing-position", message, f"1 mm along {axis}", "bearing_position_m" in stated, variant, 1e-3)
    for i, axis in enumerate("" if samples.attitude_logged else "XY"):
        variant = Variant(here, _tilted(samples, vehicle, i, 0.1 * DEGREE), 0.1 * DEGREE)
        message = f"environment.initial_attitude_wxyz is {_vector(environment.initial_attitude_wxyz)}; tilted about the world's {axis}"
        yield Taken("initial-attitude", message, f"1 degree about the world's {axis}", "initial_attitude_wxyz" in stated, variant, DEGREE)


def _vector(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _moved(place: Sequence[float], axis: int, by: float) -> tuple[float, ...]:
    return tuple(float(x) + by * (i == axis) for i, x in enumerate(place))


def _tilted(samples: Stream, vehicle: Vehicle, axis: int, angle: float) -> Side:
    w, x, y, z = vehicle.environment.initial_attitude_wxyz
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    about_x = (c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y)
    about_y = (c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x)
    used = having(vehicle, "environment", "initial_attitude_wxyz", tuple(float(v) for v in (about_x, about_y)[axis]))
    return Side(samples.changed(used), used)
