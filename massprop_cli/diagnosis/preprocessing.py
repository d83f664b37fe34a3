"""Preprocessing of a log for estimation: timing, samples by phase, outliers removed."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis import outliers
from massprop_cli.diagnosis.bins import with_bins
from massprop_cli.diagnosis.delay import FoundTiming
from massprop_cli.diagnosis.resolve import NARROWER, found_timing, stated_timing, uncertain_timing, with_pace, with_phase, with_timing
from massprop_cli.diagnosis.torquesteps import with_steps
from massprop_cli.errorparameters.setup import Setup, stating, with_factors
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.noiselevels import white_level
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource, alternative
from massprop_cli.model.layout import Layout
from massprop_cli.model.sensitivity import Consider, Reading, Restated, with_geometry
from massprop_cli.prepare import attitudecheck, recorded
from massprop_cli.prepare.actuators import check_supply
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.sums import of_records
from massprop_cli.prepare.timing import Timing

FINER = ((1.2, 64), (0.6, 32), (0.3, 16), (0.15, 8))
"""Angles, rad, by which a body turns in a cycle, from which on so many bins are to follow the motion within it
(tests/estimate/test_fast_turns.py)."""
SELDOM = 0.98
"""Part of the cycles that turn by less."""


class Ready(NamedTuple):
    """What an estimator starts from."""

    log: Log
    """Without outliers."""
    stated: Vehicle
    """With its timing resolved."""
    samples: Stream
    phases: list[tuple[Phase, slice]]
    timing: Timing
    """Delay and lag as used, cycles."""
    detected: FoundTiming | None
    """What the log says of them, where the vehicle file leaves them to it."""
    consider: Consider
    """Delay, lag, geometry and single keys where they are uncertain."""
    notices: list[Notice]

    @property
    def pieces(self) -> list[slice]:
        """Cycles of each phase."""
        return [cycles for _, cycles in self.phases]


def ready(log: Log, source: VehicleSource, say: Progress) -> Ready:
    """:class:`massprop_cli.base.errors.InputError` where a phase holds too little, or timing can't be told."""
    check_supply(log, source.vehicle, source.source)
    estimator = source.vehicle.estimator
    open_bins = estimator.method == "default" and "bins_per_cycle" not in estimator.model_fields_set
    vehicle, told = _with_attitude(log, with_pace(log, with_phase(log, _undelayed(log, finer(log, source.vehicle)))))
    source = replace(source, vehicle=vehicle)
    detected = found_timing(log, source, say)
    timing = stated_timing(source.vehicle) if detected is None else detected.at
    stated, bent = with_timing(source.vehicle, detected), list[Notice]()
    if estimator.method == "default":
        stated, bent = with_steps(log, stated, timing)
    samples = Stream.of(log, stated, timing)
    phases = phases_of(log, stated, samples)
    resolved = with_bins(Setup(log, stated, timing), [cycles for _, cycles in phases]) if open_bins else stated
    if resolved is not stated:
        stated, samples = resolved, Stream.of(log, resolved, timing)
    read = log
    if stated.estimator.method == "default":
        stated, others = outliers.screened(log, stated, samples, [cycles for _, cycles in phases])
        log, told = outliers.without(log, stated), [*told, *bent, *others]
    if log is not read:
        samples = Stream.of(log, stated, timing)
    setup = Setup(log, stated, timing)
    consider = with_geometry(uncertain(uncertain_timing(setup, samples), setup, samples), setup, samples)
    return Ready(log, stated, samples, phases, timing, detected, consider, told)


def _with_attitude(log: Log, vehicle: Vehicle) -> tuple[Vehicle, list[Notice]]:
    """With noise and latency of logged attitudes that measure something, and what to tell where the log alone shows them."""
    # a low-pass that is still to be found makes the gyro later by milliseconds, which is no turn of an attitude
    sought: dict[str, object] = {name: None for name in ("gyro_filter", "accel_filter") if (one := getattr(vehicle.imu, name)) and one.open}
    if log.attitude_wxyz is not None and not vehicle.imu.gyro_noise_rad_s:  # by attitudes it is a difference of two large numbers
        rate = of_records(log.delta_theta_imu_rad, log.records_per_cycle) / cycle_edges(log, slice(0, log.cycles))[1][:, None]
        sought["gyro_noise_rad_s"] = white_level(rate, [slice(0, log.cycles)], np.ones(log.cycles, dtype=bool)) or None
    known = vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=sought)})
    shown = attitudecheck.checked(recorded.undone(log, known), known)
    if shown is None:
        return vehicle, []
    found, told = {}, []
    if vehicle.imu.attitude_latency_s == "auto" or shown.latency_sigma_s < NARROWER * vehicle.imu.attitude_latency_sigma_s:
        found = {"attitude_latency_s": shown.latency_s, "attitude_latency_sigma_s": shown.latency_sigma_s}
    if vehicle.imu.attitude_sigma_rad is None:
        found["attitude_sigma_rad"] = sigma = shown.noise.attitude_rad
        told = [Notice("noise-estimated", f"imu.attitude_sigma_rad is not stated; {sigma:.3g} was estimated from the log")]
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=found)}), told


def _undelayed(log: Log, vehicle: Vehicle) -> Vehicle:
    """Without a delay or lag that is still to be found where all that acts is measured, as speeds are: neither moves anything then."""
    if vehicle.rotors:
        commanded = any(rotor.column == "command" for rotor in vehicle.rotors)
    else:
        commanded = log.command.shape[1] > 0 or any(one.integrated for one in log.spinning)
    open_ = {"cycle.command_delay_cycles": vehicle.cycle.command_delay_cycles, "thrust.lag_s": vehicle.thrust.lag_s}
    return vehicle if commanded else stating(vehicle, {key: 0.0 for key, value in open_.items() if value == "auto"})


def finer(log: Log, vehicle: Vehicle) -> Vehicle:
    """With as many bins a cycle as its turns ask for, where the vehicle file states none."""
    if "bins_per_cycle" in vehicle.estimator.model_fields_set or vehicle.estimator.method != "default":
        return vehicle
    turns = np.sort(np.linalg.norm(of_records(log.delta_theta_imu_rad, log.records_per_cycle), axis=1))
    turn = float(turns[int(SELDOM * (len(turns) - 1))])
    bins = next((bins for least, bins in FINER if turn > least), vehicle.estimator.bins_per_cycle)
    return stating(vehicle, {"estimator.bins_per_cycle": bins})


def uncertain(consider: Consider, setup: Setup, samples: Stream) -> Consider:
    """With what is stated to be ``uncertain``, each independent of all others.

    :class:`InputError` where an alternative has other states than the vehicle as stated: a sigma of a bias, say.
    """
    return replace(consider, restated=tuple(_restated(values, setup, samples) for values in setup.vehicle.uncertain))


def _restated(values: Mapping[str, Any], setup: Setup, samples: Stream) -> Restated:
    log, stated, timing = setup.log, setup.vehicle, setup.timing
    vehicle = alternative(stated, values)
    before, after = stated_timing(stated, timing), stated_timing(vehicle, timing)
    moved = Timing(*(max(used + there - here, 0.0) for used, there, here in zip(timing, after, before, strict=True)))
    gyro, accelerometer, command = (values.get(f"{name}_factors", ()) for name in ("gyro", "accel", "command"))
    read = with_factors(log, gyro, accelerometer, command if log.command_kind == "wrench" else ())
    there = Stream.of(read, vehicle, moved)
    if Layout.of(there, vehicle) != Layout.of(samples, stated):
        raise InputError(f"uncertain: {', '.join(values)}: changes what is estimated, not what is stated; state it for itself")
    mounting = np.array(stated.imu.body_from_imu)
    rate, force = (mounting @ (np.array(factors or np.eye(3)) - np.eye(3)) @ mounting.T for factors in (gyro, accelerometer))
    return Restated(there, vehicle, Reading(rate, force) if gyro or accelerometer else None)
