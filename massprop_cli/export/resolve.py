"""Constants of a flight: the vehicle with all values resolved, phase by phase."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.verdict import tolerance_of
from massprop_cli.diagnosis.outliers import SIGMAS
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import compiled, kernelflight
from massprop_cli.inputs import logfile, telemetry
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model import kernelargs
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.sensor import KernelEffect, Recorder, kernel_effect
from massprop_cli.prepare.stored import free_inertia
from massprop_cli.prepare.timing import Timing

FILTERS = ("gyro_filter", "accel_filter")


class GyroAttitude(NamedTuple):
    """Measurement model in flight: the attitude is integrated from the gyro."""

    kernel_effect: KernelEffect | None
    pulsed: bool
    free_inertia: Array
    attitude_logged: bool = False


class FlownRecords(NamedTuple):
    """IMU records in flight."""

    sampled: tuple[bool, bool]
    """Whether gyro and accelerometer record samples, not means."""
    interval_s: Array


class Leg(NamedTuple):
    """Constants of one phase."""

    name: str
    vehicle: Array
    """Kernel arguments by :func:`massprop_cli.estimate.compiled.vehicle_numbers`."""
    rule: Array
    """Kernel arguments by :func:`massprop_cli.estimate.kernelflight.rule_of`."""
    cycles: slice
    """Cycles of the log; empty without one."""
    own: Resolved
    """Vehicle with the known values of this phase."""


class Constants(NamedTuple):
    """Constants of a flight."""

    vehicle: Vehicle
    commands: Array
    """Kernel arguments by :func:`massprop_cli.estimate.kernelflight.commands_of`."""
    legs: tuple[Leg, ...]
    log: Log | None


def stated(source: VehicleSource, jets: bool | None = None, records: int = 0) -> Constants:
    """Constants from a vehicle file; :class:`InputError` if it leaves values to a log.

    ``jets``: whether commands are on-times of jets; None: decided by the vehicle. ``records``: IMU records per control cycle, 0: unknown.
    """
    vehicle, sampled = source.vehicle, source.vehicle.imu.measures == "sample"
    if sampled and not records:
        raise InputError(
            f'{source.source}: imu.measures is "sample", and only a log shows the number of records in a control cycle; give '
            "export-flight a log (--log)"
        )
    filters = [(name, getattr(vehicle.imu, name)) for name in FILTERS]
    open_keys = {
        "cycle.command_delay_cycles": vehicle.cycle.command_delay_cycles == "auto",
        "thrust.lag_s": vehicle.thrust.lag_s == "auto",
        "imu.gyro_noise_rad_s": not vehicle.imu.gyro_noise_rad_s,
        "imu.accel_noise_m_s2": not vehicle.imu.accel_noise_m_s2,
        **{f"imu.{name} (cutoff_hz, latency_s)": one is not None and one.open for name, one in filters},
        **{
            f"wheels.{i}.speed_step_rad_s (0: none)": one.speed_step_rad_s is None and not one.speed_error_in_noise
            for i, one in enumerate(vehicle.wheels)
        },
    }
    missing = [key for key, is_open in open_keys.items() if is_open]
    if missing:
        raise InputError(
            f"{source.source}: {', '.join(missing)} must be stated for a flight, and noises must be above 0; massprop estimate shows "
            "delay, noise and filters of a log, and export-flight --log uses them"
        )
    timing = stated_timing(vehicle)
    recorded = FlownRecords((sampled, sampled), np.array([vehicle.cycle.period_s / max(records, 1)]))
    used = _checked(source, recorded, vehicle, timing, vehicle.cycle.period_s)
    legs = tuple(
        _leg(name, recorded, own, slice(0, 0))
        for name, own in [(phase.name, used.in_phase(phase)) for phase in used.phases] or [("all", used)]
    )
    alone = bool(vehicle.spinning) or vehicle.on_pedestal
    by_jets = bool(vehicle.jets) or alone if jets is None else jets
    return Constants(vehicle, kernelflight.commands_of(recorded, by_jets, vehicle, timing, max(records, 1)), legs, None)


def told(source: VehicleSource, log_path: Path) -> Constants:
    """Constants with the noise levels, disturbances and timing that a log shows, and the log."""
    table = logfile.read_table(log_path)
    wheels = tuple(wheel.model_copy(update={"between_counts": False}) for wheel in source.vehicle.wheels)
    source = replace(source, vehicle=source.vehicle.model_copy(update={"wheels": wheels}))
    with np.errstate(all="ignore"):
        found = flow.examine(telemetry.read(table, source.vehicle), source)
    if found.log.command_s is not None:
        raise InputError(f"{log_path}: its commands have their own times, but the kernel needs commands per control cycle; give such a log")
    log, vehicle = found.samples.log, _exactly(source.vehicle, found.vehicle)
    shortest = float(log.interval_s.reshape(-1, log.records_per_cycle).sum(1).min())
    used = _checked(source, log, vehicle, found.timing, shortest)
    commands = kernelflight.commands_of(log, log.command_kind == "jets", vehicle, found.timing, log.records_per_cycle)
    legs = tuple(_leg(history.phase.name, log, used.in_phase(history.phase), history.cycles) for history in found.histories)
    return Constants(vehicle, commands, legs, log)


def _leg(name: str, recorder: Recorder, vehicle: Resolved, cycles: slice) -> Leg:
    # on a pedestal the motion does not depend on the mass
    own = vehicle.model_copy(update={"known": {}}) if vehicle.on_pedestal else vehicle
    carried = GyroAttitude(kernel_effect(recorder, own), own.thrust.pulse_sigma > 0, free_inertia(1, own))
    return Leg(name, compiled.vehicle_numbers(carried, own), _rule(own), cycles, own)


def _exactly(stated: Vehicle, found: Vehicle) -> Vehicle:
    """Vehicle with the log's delay, lag and low-passes, exact unless stated with a sigma; the kernel estimates the gyro bias."""
    delay, lag, imu = stated.cycle, stated.thrust, stated.imu
    cycle = {"command_delay_sigma_cycles": 0.0 if delay.command_delay_cycles == "auto" else delay.command_delay_sigma_cycles}
    thrust = {"lag_sigma_s": 0.0 if lag.lag_s == "auto" else lag.lag_sigma_s}
    filters = {name: _exact(getattr(imu, name), getattr(found.imu, name)) for name in FILTERS}
    parts = {
        "cycle": found.cycle.model_copy(update=cycle),
        "thrust": found.thrust.model_copy(update=thrust),
        "imu": found.imu.model_copy(update={"gyro_bias_rad_s": imu.gyro_bias_rad_s, **filters}),
    }
    return found.model_copy(update=parts)


def _exact(stated: LowPass | None, found: LowPass | None) -> LowPass | None:
    if found is None:
        return None
    as_shown = stated is None or stated.open
    return found.model_copy(update={name: 0.0 if as_shown else getattr(stated, name) for name in ("cutoff_sigma_hz", "latency_sigma_s")})


def _checked(source: VehicleSource, recorder: Recorder, vehicle: Vehicle, timing: Timing, shortest_s: float) -> Resolved:
    used = Resolved.stated(vehicle)
    problem = kernelargs.unsupported(vehicle) or kernelflight.unsupported(recorder, vehicle, timing, shortest_s)
    if vehicle.cycle.command_delay_sigma_cycles > 0 or vehicle.thrust.lag_sigma_s > 0:
        problem = (
            problem or "delay or lag have a sigma, but the kernel assumes exact values; set command_delay_sigma_cycles and lag_sigma_s to 0"
        )
    if any(wheel.speed_sigma_rad_s or wheel.speed_step_rad_s for wheel in vehicle.wheels if not wheel.speed_error_in_noise):
        problem = problem or (
            "speed_sigma_rad_s or speed_step_rad_s of a wheel is stated, but their effect on the noise is not: give a log, or state "
            "imu.gyro_noise_rad_s and environment.disturbance_torque_n_m with them and speed_error_in_noise = true"
        )
    low_passes = [getattr(vehicle.imu, name) for name in FILTERS]
    if any(one is not None and (one.cutoff_sigma_hz > 0 or one.latency_sigma_s > 0) for one in low_passes):
        problem = problem or "cutoff_sigma_hz or latency_sigma_s of a filter is not 0, but the kernel assumes exact values; set them to 0"
    if vehicle.uncertain:
        problem = problem or "uncertain is stated, but the kernel assumes exact values; leave it out"
    if problem or used is None:
        raise InputError(f"{source.source}: {problem}")
    return used


def _rule(vehicle: Vehicle) -> Array:
    settings = vehicle.convergence
    relative = settings.relative is not False
    inertia, cg, mass = (tolerance_of(kind, getattr(settings, f"{kind}_tolerance"), relative) for kind in ("inertia", "cg", "mass"))
    return kernelflight.rule_of(vehicle, (inertia, cg, mass), relative, SIGMAS)
