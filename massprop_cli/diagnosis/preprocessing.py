"""Preprocessing of a log for estimation: timing, samples by phase, outliers removed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis import outliers
from massprop_cli.diagnosis.bins import with_bins
from massprop_cli.diagnosis.delay import FoundTiming
from massprop_cli.diagnosis.resolve import NARROWER, found_timing, stated_timing, uncertain_timing, with_pace, with_phase, with_timing
from massprop_cli.diagnosis.torquesteps import with_steps
from massprop_cli.errorparameters.setup import Setup, plain, stating, value_of, with_factors
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.noiselevels import white_level
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import FACTORS, VehicleSource, alternative
from massprop_cli.model.layout import Layout
from massprop_cli.model.sensitivity import Consider, OtherReading, Reading, Restated, with_geometry
from massprop_cli.prepare import attitudecheck, recorded
from massprop_cli.prepare.actuators import check_supply
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.sums import of_records
from massprop_cli.prepare.timing import Timing

FINER = ((1.2, 64), (0.6, 32), (0.3, 16), (0.15, 8))
"""(turn in a cycle [rad], bins in a cycle): bins that follow the motion from that turn on (tests/estimate/test_fast_turns.py)."""
STEP = 0.1
"""Part of its sigma by which an uncertain value is changed to both sides for its derivative. With a whole sigma, terms of higher order seem
to inform a value that no log can tell."""
SWING = 8.0
"""Factor on the turns of a free swing, which magnifies what the bins leave (tests/estimate/test_pedestal.py)."""
SELDOM = 0.98
"""Quantile of the turns over all cycles that decides."""


class Ready(NamedTuple):
    """Preprocessed log, from which an estimator starts."""

    log: Log
    """Log without outliers."""
    stated: Vehicle
    """Vehicle with its timing resolved."""
    samples: Stream
    phases: list[tuple[Phase, slice]]
    timing: Timing
    """Delay and lag that are used, cycles."""
    detected: FoundTiming | None
    """Timing estimated from the log; None if the vehicle file states it."""
    consider: Consider
    """Uncertain delay, lag, geometry and keys."""
    notices: list[Notice]

    @property
    def pieces(self) -> list[slice]:
        """Cycles of each phase."""
        return [cycles for _, cycles in self.phases]


def ready(log: Log, source: VehicleSource, say: Progress) -> Ready:
    """Preprocess a log.

    Raise :class:`massprop_cli.base.errors.InputError` if a phase is too short or the timing cannot be estimated.
    """
    check_supply(log, source.vehicle, source.source)
    estimator = source.vehicle.estimator
    open_bins = estimator.method == "default" and "bins_per_cycle" not in estimator.model_fields_set
    vehicle, notices = _with_attitude(log, with_pace(log, with_phase(log, _undelayed(log, finer(log, source.vehicle)))))
    source = replace(source, vehicle=vehicle)
    detected = found_timing(log, source, say)
    timing = stated_timing(source.vehicle) if detected is None else detected.at
    stated, step_notices = with_timing(source.vehicle, detected), list[Notice]()
    if estimator.method == "default":
        stated, step_notices = with_steps(log, stated, timing)
    samples = Stream.of(log, stated, timing)
    phases = phases_of(log, stated, samples)
    resolved = with_bins(Setup(log, stated, timing), [cycles for _, cycles in phases]) if open_bins else stated
    if resolved is not stated:
        stated, samples = resolved, Stream.of(log, resolved, timing)
    as_read = log
    if stated.estimator.method == "default":
        stated, outlier_notices = outliers.with_outliers(log, stated, samples, [cycles for _, cycles in phases])
        log, notices = outliers.without_outliers(log, stated), [*notices, *step_notices, *outlier_notices]
    if log is not as_read:
        samples = Stream.of(log, stated, timing)
    setup = Setup(log, stated, timing)
    restated = tuple(_restated(number, [0.0] * len(stated.uncertain), setup, samples) for number in range(len(stated.uncertain)))
    return Ready(log, stated, samples, phases, timing, detected, _considered(setup, samples, restated), notices)


def _with_attitude(log: Log, vehicle: Vehicle) -> tuple[Vehicle, list[Notice]]:
    """Vehicle with noise and latency of measured attitudes, and notices of what the log alone gives."""
    # an unknown low-pass delays the gyro by milliseconds, which hardly changes an attitude
    unknown: dict[str, object] = {
        name: None for name in ("gyro_filter", "accel_filter") if (one := getattr(vehicle.imu, name)) and one.open
    }
    if (
        log.attitude_wxyz is not None and not vehicle.imu.gyro_noise_rad_s
    ):  # white noise of the rates; from attitudes it would be a difference of large numbers
        rate = of_records(log.delta_theta_imu_rad, log.records_per_cycle) / cycle_edges(log, slice(0, log.cycles))[1][:, None]
        unknown["gyro_noise_rad_s"] = white_level(rate, [slice(0, log.cycles)], np.ones(log.cycles, dtype=bool)) or None
    known = vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=unknown)})
    attitude = attitudecheck.check_attitude(recorded.corrected_log(log, known), known)
    if attitude is None:
        return vehicle, []
    values, notices = {}, []
    if vehicle.imu.attitude_latency_s == "auto" or attitude.latency_sigma_s < NARROWER * vehicle.imu.attitude_latency_sigma_s:
        values = {"attitude_latency_s": attitude.latency_s, "attitude_latency_sigma_s": attitude.latency_sigma_s}
    if vehicle.imu.attitude_sigma_rad is None:
        values["attitude_sigma_rad"] = sigma = attitude.noise.attitude_rad
        notices = [Notice("noise-estimated", f"imu.attitude_sigma_rad is not stated; massprop estimated {sigma:.3g} from the log")]
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=values)}), notices


def _undelayed(log: Log, vehicle: Vehicle) -> Vehicle:
    """Vehicle without an unknown delay or lag if all actuators are measured, so that neither has an effect."""
    if vehicle.rotors:
        commanded = any(rotor.column == "command" for rotor in vehicle.rotors)
    else:
        commanded = log.command.shape[1] > 0 or any(one.integrated for one in log.spinning)
    timing_keys = {"cycle.command_delay_cycles": vehicle.cycle.command_delay_cycles, "thrust.lag_s": vehicle.thrust.lag_s}
    return vehicle if commanded else stating(vehicle, {key: 0.0 for key, value in timing_keys.items() if value == "auto"})


def finer(log: Log, vehicle: Vehicle) -> Vehicle:
    """Vehicle with as many bins in a cycle as its turns need, unless the vehicle file states them."""
    if "bins_per_cycle" in vehicle.estimator.model_fields_set or vehicle.estimator.method != "default":
        return vehicle
    turns = np.sort(np.linalg.norm(of_records(log.delta_theta_imu_rad, log.records_per_cycle), axis=1))
    turn = float(turns[int(SELDOM * (len(turns) - 1))]) * (SWING if vehicle.swings and not log.command.any() else 1.0)
    bins = next((bins for turn_rad, bins in FINER if turn > turn_rad), vehicle.estimator.bins_per_cycle)
    return stating(vehicle, {"estimator.bins_per_cycle": bins})


def _considered(setup: Setup, samples: Stream, restated: tuple[Restated, ...]) -> Consider:
    return with_geometry(replace(uncertain_timing(setup, samples), restated=restated), setup, samples)


def about_values(begun: Ready, at: Sequence[float]) -> Ready:
    """A log that is read as stated, read with its ``uncertain`` values ``at`` so many sigmas from the stated ones.

    Raise :class:`InputError` if a value would be beyond a bound of its key.
    """
    setup = Setup(begun.log, begun.stated, begun.timing)
    values = _values(begun.stated, at)
    restated = tuple(_restated(number, at, setup, begun.samples) for number in range(len(at)))
    samples, _ = _read_with(values, setup)
    keys = {key: plain(value) for key, value in values.items() if key not in FACTORS}
    read = Setup(samples.log, stating(begun.stated, keys), samples.alignment.timing)
    return begun._replace(
        log=read.log, stated=read.vehicle, samples=samples, timing=read.timing, consider=_considered(read, samples, restated)
    )


def _restated(number: int, at: Sequence[float], setup: Setup, samples: Stream) -> Restated:
    """Entry ``number`` of ``uncertain``, with all entries ``at`` values in sigmas, each independent of all others.

    Raise :class:`InputError` if it changes the filter's states, for example the sigma of a bias.
    """
    stated = setup.vehicle
    values = stated.uncertain[number]
    try:
        ends = (_values(stated, [one + by * (i == number) for i, one in enumerate(at)]) for by in (-STEP, STEP))
        low, high = (OtherReading(*_read_with(end, setup)) for end in ends)
        distance = 2 * STEP
    except InputError:  # no numbers, or beyond a bound of the key, as a negative time
        base = _values(stated, at)
        low = OtherReading(*_read_with(base, setup)) if any(at) else OtherReading(samples)
        high, distance = OtherReading(*_read_with({**base, **values}, setup)), 1.0
    if high.vehicle is not None and Layout.of(high.samples, high.vehicle) != Layout.of(samples, stated):
        raise InputError(
            f"uncertain: {', '.join(values)}: this changes which quantities are estimated; take it out of uncertain and state it as a value"
        )
    mounting = np.array(stated.imu.body_from_imu)
    factors = [values.get(f"{name}_factors") for name in ("gyro", "accel")]
    rate, force = (mounting @ (np.array(one or np.eye(3)) - np.eye(3)) @ mounting.T for one in factors)
    return Restated(low, high, distance, Reading(rate, force) if any(factors) else None, at[number])


def _read_with(values: Mapping[str, Any], setup: Setup) -> tuple[Stream, Vehicle]:
    """The log read with other values of the vehicle file, and that vehicle."""
    log, stated, timing = setup.log, setup.vehicle, setup.timing
    vehicle = alternative(stated, values)
    before, after = stated_timing(stated, timing), stated_timing(vehicle, timing)
    moved = Timing(*(max(used + other - own, 0.0) for used, other, own in zip(timing, after, before, strict=True)))
    gyro, accelerometer, command = (values.get(f"{name}_factors", ()) for name in ("gyro", "accel", "command"))
    changed = with_factors(log, gyro, accelerometer, command if log.command_kind == "wrench" else ())
    return Stream.of(changed, vehicle, moved).light(), vehicle


def _values(stated: Vehicle, parts: Sequence[float]) -> dict[str, Any]:
    """Values with each entry of ``uncertain`` at its part of the way from the stated values, or from factors of 1.

    Raise :class:`InputError` if they are not numbers.
    """
    found = dict[str, Any]()
    for values, part in zip(stated.uncertain, parts, strict=True):
        for key, value in values.items() if part else ():
            begin = (np.eye(3) if FACTORS[key] == (3, 3) else np.ones(6)) if key in FACTORS else value_of(stated, key)
            try:
                if begin is None:
                    raise TypeError
                change = part * (np.array(value, dtype=float) - np.array(begin, dtype=float))
                found[key] = (np.array(found.get(key, begin), dtype=float) + change).tolist()
            except (TypeError, ValueError):
                raise InputError(f"{key} = {value}: not a number like {begin}") from None
    return found
