"""Constants of a flight: the vehicle with numbers for all values, for each phase."""

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
    """Inputs of the measurement model in flight, where the gyro gives the attitude."""

    kernel_effect: KernelEffect | None
    pulsed: bool
    free_inertia: Array
    attitude_logged: bool = False


class FlownRecords(NamedTuple):
    """Properties of the IMU records in flight."""

    sampled: tuple[bool, bool]
    """Whether gyro and accelerometer record samples, not means."""
    interval_s: Array
    """(1,) record interval, s."""


class PhaseConstants(NamedTuple):
    """Constants of one phase."""

    name: str
    vehicle: Array
    """Kernel arguments by :func:`massprop_cli.estimate.compiled.vehicle_numbers`."""
    rule: Array
    """Kernel arguments by :func:`massprop_cli.estimate.kernelflight.rule_of`."""
    cycles: slice
    """Cycles of the log; empty without one."""
    resolved: Resolved
    """Vehicle with the known values of this phase."""


class FlightConstants(NamedTuple):
    """Constants of a flight."""

    vehicle: Vehicle
    commands: Array
    """Kernel arguments by :func:`massprop_cli.estimate.kernelflight.commands_of`."""
    phases: tuple[PhaseConstants, ...]
    log: Log | None
    """Log of the test vector."""


def stated(source: VehicleSource, jets: bool | None = None, records: int = 0) -> FlightConstants:
    """Constants from a vehicle file alone; raise :class:`InputError` if it does not state all values.

    ``jets``: whether commands are on-times of jets; None: as the vehicle's actuators imply. ``records``: IMU records per control cycle,
    0: unknown.
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
    phases = tuple(
        _phase(name, recorded, in_phase, slice(0, 0))
        for name, in_phase in [(phase.name, used.in_phase(phase)) for phase in used.phases] or [("all", used)]
    )
    without_wrench = bool(vehicle.spinning) or vehicle.on_pedestal
    by_jets = bool(vehicle.jets) or without_wrench if jets is None else jets
    return FlightConstants(vehicle, kernelflight.commands_of(recorded, by_jets, vehicle, timing, max(records, 1)), phases, None)


def from_log(source: VehicleSource, log_path: Path) -> FlightConstants:
    """Constants with the noise levels, disturbances and timing estimated from a log; raise :class:`InputError` if it is not suitable."""
    table = logfile.read_table(log_path)
    wheels = tuple(wheel.model_copy(update={"between_counts": False}) for wheel in source.vehicle.wheels)
    source = replace(source, vehicle=source.vehicle.model_copy(update={"wheels": wheels}))
    with np.errstate(all="ignore"):
        analysis = flow.examine(telemetry.read(table, source.vehicle), source)
    if analysis.log.command_s is not None:
        raise InputError(f"{log_path}: its commands have their own times, but the kernel needs commands per control cycle; give such a log")
    log, vehicle = analysis.samples.log, _exact_timing(source.vehicle, analysis.vehicle)
    shortest = float(log.interval_s.reshape(-1, log.records_per_cycle).sum(1).min())
    used = _checked(source, log, vehicle, analysis.timing, shortest)
    commands = kernelflight.commands_of(log, log.command_kind == "jets", vehicle, analysis.timing, log.records_per_cycle)
    phases = tuple(_phase(history.phase.name, log, used.in_phase(history.phase), history.cycles) for history in analysis.histories)
    return FlightConstants(vehicle, commands, phases, log)


def _phase(name: str, recorder: Recorder, vehicle: Resolved, cycles: slice) -> PhaseConstants:
    """Constants of a phase in which the vehicle has these known values."""
    # on a pedestal the motion does not depend on the mass
    resolved = vehicle.model_copy(update={"known": {}}) if vehicle.on_pedestal else vehicle
    attitude = GyroAttitude(kernel_effect(recorder, resolved), resolved.thrust.pulse_sigma > 0, free_inertia(1, resolved))
    return PhaseConstants(name, compiled.vehicle_numbers(attitude, resolved), _rule(resolved), cycles, resolved)


def _exact_timing(stated: Vehicle, estimated: Vehicle) -> Vehicle:
    """The vehicle with the log's delay, lag and low-passes as exact values; a stated value keeps its stated sigma.

    The gyro bias stays as stated, since the kernel estimates it.
    """
    delay, lag, imu = stated.cycle, stated.thrust, stated.imu
    cycle = {"command_delay_sigma_cycles": 0.0 if delay.command_delay_cycles == "auto" else delay.command_delay_sigma_cycles}
    thrust = {"lag_sigma_s": 0.0 if lag.lag_s == "auto" else lag.lag_sigma_s}
    filters = {name: _exact(getattr(imu, name), getattr(estimated.imu, name)) for name in FILTERS}
    parts = {
        "cycle": estimated.cycle.model_copy(update=cycle),
        "thrust": estimated.thrust.model_copy(update=thrust),
        "imu": estimated.imu.model_copy(update={"gyro_bias_rad_s": imu.gyro_bias_rad_s, **filters}),
    }
    return estimated.model_copy(update=parts)


def _exact(stated: LowPass | None, estimated: LowPass | None) -> LowPass | None:
    """The estimated low-pass with the stated sigmas; 0 if the vehicle file does not state it completely."""
    if estimated is None:
        return None
    unstated = stated is None or stated.open
    sigmas = ("cutoff_sigma_hz", "latency_sigma_s")
    return estimated.model_copy(update={name: 0.0 if unstated else getattr(stated, name) for name in sigmas})


def _checked(source: VehicleSource, recorder: Recorder, vehicle: Vehicle, timing: Timing, shortest_s: float) -> Resolved:
    """The resolved vehicle; raise :class:`InputError` if the kernel does not support it. ``shortest_s``: shortest control cycle, s."""
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
    """Kernel arguments of the convergence rule."""
    settings = vehicle.convergence
    relative = settings.relative is not False
    inertia, cg, mass = (tolerance_of(kind, getattr(settings, f"{kind}_tolerance"), relative) for kind in ("inertia", "cg", "mass"))
    return kernelflight.rule_of(vehicle, (inertia, cg, mass), relative, SIGMAS)
