"""Delay, lag and low-passes of one run, and their uncertainty.

They are as stated; as estimated, if the vehicle file says "auto"; or combined, if it states them with a sigma.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError, UntoldError
from massprop_cli.base.levels import CONTRADICTION, FINALISTS, LONG
from massprop_cli.diagnosis import delay, segment
from massprop_cli.diagnosis.delay import FoundTiming, Rated
from massprop_cli.diagnosis.samplededges import near_samples, steps_at_samples
from massprop_cli.errorparameters.setup import Setup, rebuilt, stating
from massprop_cli.errorparameters.table import BY_NAME, TABLE
from massprop_cli.estimate import noiselevels
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.actuators.actuator import MomentumDevice
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider, variant
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

SOUGHT = {
    "delay": ("the command delay", "the delay in cycles (cycle.command_delay_cycles)"),
    "lag": ("the thrust lag", "the lag in seconds (thrust.lag_s)"),
    "gyro_cutoff": ("the gyro's cutoff", "the gyro's cutoff (imu.gyro_filter.cutoff_hz)"),
    "accel_cutoff": ("the accelerometer's cutoff", "the accelerometer's cutoff (imu.accel_filter.cutoff_hz)"),
    "gyro_latency": ("the gyro's latency", "the gyro's latency (imu.gyro_filter.latency_s)"),
    "accel_latency": ("the accelerometer's latency", "the accelerometer's latency (imu.accel_filter.latency_s)"),
}
"""Error parameters that a vehicle file may leave open: name, and what to state."""
PHASE = 0.1
"""Sigma, in records, of the sampling times of an IMU with its own clock by the commands' clock, unless stated."""
CUTOFFS, LATENCIES = ("gyro_cutoff", "accel_cutoff"), ("gyro_latency", "accel_latency")
PAIRS = (
    ("delay", "lag"),
    *((cutoff, other) for other in ("delay", "lag") for cutoff in CUTOFFS),
    CUTOFFS,
    *((latency, other) for other in ("delay", "lag", *CUTOFFS) for latency in LATENCIES),
    LATENCIES,
)
"""Pairs with a stated correlation: the first in thrust, the others in imu.filter_correlation."""
ROUGHLY = 0.5
"""Sigma of a coarse search without a fit: cycles of delay or lag, and relative for a cutoff."""
FIRST_HZ = 50.0
"""Initial cutoff of an estimate, Hz."""
NARROWER = 0.5
"""Sigma of the log's own estimate over the stated sigma, up to which it is used."""


def with_phase(log: Log, vehicle: Vehicle) -> Vehicle:
    """Vehicle with an uncertain delay, if IMU and commands have separate clocks and no uncertainty is stated."""
    apart = log.command_s is not None or any(log.sampled)
    if not apart or vehicle.cycle.command_delay_cycles == "auto" or "command_delay_sigma_cycles" in vehicle.cycle.model_fields_set:
        return vehicle
    sigma = PHASE * float(np.mean(log.interval_s)) / vehicle.cycle.period_s
    return stating(vehicle, {"cycle.command_delay_sigma_cycles": sigma})


def with_pace(log: Log, vehicle: Vehicle) -> Vehicle:
    """Vehicle with uncertain thrust, momentum and delay, if cycles do not last as long as stated.

    Inertia is proportional to time, or to its square.
    """
    sigma, thrust, cycle = 2 * abs(log.pace), vehicle.thrust, vehicle.cycle
    if sigma == 0:
        return vehicle
    if cycle.command_delay_cycles != "auto":
        delay_sigma = abs(log.pace) * max(cycle.command_delay_cycles, 1.0)
        cycle = cycle.model_copy(update={"command_delay_sigma_cycles": max(cycle.command_delay_sigma_cycles, delay_sigma)})
    thrust = thrust.model_copy(update={"scale_sigma": max(thrust.scale_sigma, sigma)})
    spinning = {table: tuple(_less_known(one, sigma) for one in getattr(vehicle, table)) for table in ("wheels", "control_moment_gyros")}
    return rebuilt(vehicle, cycle=cycle, thrust=thrust, **spinning)


def _less_known(device: MomentumDevice, sigma: float) -> MomentumDevice:
    """Device with at least this relative sigma of its momentum."""
    sigmas = {}
    for key, sigma_key in (("h_n_m_s", "h_sigma_n_m_s"), ("spin_inertia_kg_m2", "spin_inertia_sigma_kg_m2")):
        if getattr(device, key, None):
            sigmas[sigma_key] = max(getattr(device, sigma_key), sigma * getattr(device, key))
    return device.model_copy(update=sigmas)


def with_timing(stated: Vehicle, detected: FoundTiming | None) -> Vehicle:
    """Vehicle with values and sigmas of an estimated timing."""
    if detected is None:
        return stated
    sigmas_cycles = dict(zip(detected.unknown, np.sqrt(np.diag(detected.covariance)).tolist(), strict=True))
    values: dict[str, object] = {}
    if detected.sigma.delay > 0:
        values["cycle.command_delay_sigma_cycles"] = detected.sigma.delay
    if detected.sigma.lag > 0:
        values["thrust.lag_sigma_s"] = detected.sigma.lag_s(stated)
    first, *others = (detected.correlation(*pair) for pair in PAIRS)
    if detected.sigma.delay > 0 and detected.sigma.lag > 0:
        values["thrust.lag_delay_correlation"] = first
    if detected.imu is not None:
        values["imu.filter_correlation"] = tuple(others)
        estimated = stating(stated, {"imu": detected.imu})
        for sensor in delay.SENSORS:
            low_pass: LowPass | None = getattr(detected.imu, f"{sensor}_filter")
            if low_pass is not None:
                names = {f"{part}_sigma_{unit}": f"{sensor}_{part}" for part, unit in (("cutoff", "hz"), ("latency", "s"))}
                sigmas = {key: BY_NAME[name].scale(estimated) * sigmas_cycles[name] for key, name in names.items() if name in sigmas_cycles}
                values[f"imu.{sensor}_filter"] = low_pass.model_copy(update=sigmas)
    return stating(stated, values)


def uncertain_timing(setup: Setup, samples: Stream) -> Consider:
    """Uncertain delay, lag and low-passes as consider parameters."""
    uncertain = [one for one in TABLE if one.considered and one.sigma(setup.vehicle) > 0]
    variants = {one.name: changed for one in uncertain if (changed := variant(one, setup, samples)) is not None}
    return Consider(tuple(variants.values()), _stated_covariance(setup.vehicle, list(variants)))


def _stated_covariance(vehicle: Vehicle, names: Sequence[str]) -> Array:
    """(n, n) covariance of stated uncertain parameters, cycles²."""
    sigma, correlation = np.diag([BY_NAME[name].sigma(vehicle) for name in names]), np.eye(len(names))
    stated = zip(PAIRS, (vehicle.thrust.lag_delay_correlation, *(vehicle.imu.filter_correlation or ())), strict=False)
    for pair, value in stated:
        if set(pair) <= set(names):
            both = names.index(pair[0]), names.index(pair[1])
            correlation[both] = correlation[both[::-1]] = value
    return np.asarray(sigma @ correlation @ sigma)


def stated_timing(stated: Vehicle, found: Timing = Timing(0.0, 0.0)) -> Timing:  # noqa: B008  a constant
    """Delay and lag of the vehicle file, cycles; those of ``found`` if it says "auto"."""
    delay, lag = stated.cycle.command_delay_cycles, stated.thrust.lag_s
    return Timing(found.delay if delay == "auto" else delay, found.lag if lag == "auto" else lag / stated.cycle.period_s)


def found_timing(log: Log, source: VehicleSource, say: Progress) -> FoundTiming | None:
    """Estimate of what the vehicle file leaves open or states as uncertain; None if it applies as stated.

    Raise :class:`InputError` if a latency and the delay are both open, or if the log does not determine them.
    """
    found = _found(log, source.vehicle, say)
    sample_steps = None if found is None else steps_at_samples(log, source.vehicle, found.at)
    if found is None or sample_steps is None:
        return found
    return near_samples(*_bounded(found.setup(Setup(log, source.vehicle, found.at))), found, *sample_steps)


def _found(log: Log, vehicle: Vehicle, say: Progress) -> FoundTiming | None:
    automatic = {"delay": vehicle.cycle.command_delay_cycles == "auto", "lag": vehicle.thrust.lag_s == "auto"}
    open_cutoffs = [sensor for sensor in delay.SENSORS if (one := getattr(vehicle.imu, f"{sensor}_filter")) and one.cutoff_hz == "auto"]
    open_latencies = [sensor for sensor in delay.SENSORS if (one := getattr(vehicle.imu, f"{sensor}_filter")) and one.latency_s == "auto"]
    automatic |= {f"{sensor}_cutoff": True for sensor in open_cutoffs} | {f"{sensor}_latency": True for sensor in open_latencies}
    unknown = [name for name, auto in automatic.items() if auto]
    if not unknown:
        return _narrowed(log, vehicle, say)
    if automatic["delay"] and len(open_latencies) == 1 + any(log.axes[3:]):
        raise InputError(
            f'{log.path}: cycle.command_delay_cycles and the latency of each sensor are "auto", and the log gives only their sums; state '
            "one of them"
        )
    say("estimating delay, lag and low-passes", 0.0)
    vehicle = stating(vehicle, {f"imu.{sensor}_filter.cutoff_hz": FIRST_HZ for sensor in open_cutoffs})
    vehicle = stating(vehicle, {f"imu.{sensor}_filter.latency_s": 0.0 for sensor in open_latencies})
    given = stated_timing(vehicle)
    lags = delay.LAGS if automatic["lag"] else (given.lag,)
    latest = Timing(delay.LONGEST, max(lags))
    part, pieces = segment.bounded(log, vehicle, latest, [slice(0, log.cycles)], LONG)
    found, coarse = None, None if automatic["delay"] or automatic["lag"] else given
    rated = [] if coarse else delay.search(part, vehicle, lags, delay.DELAYS if automatic["delay"] else (given.delay,), pieces)
    coarse = rated[0].at if rated else coarse
    if coarse is not None:
        vehicle = delay.low_passes(part, vehicle, coarse, open_cutoffs, open_latencies)
        start = Setup(log, vehicle, coarse)
        found = _with_stated(start, automatic) or _detected(start, unknown)
        if unknown == ["delay"] and (found is None or found.chi_square > delay.MISFIT):
            found = delay.by_free_response(part, vehicle, coarse) or found
    if found is None:
        raise UntoldError(
            f"{log.path}: {' and '.join(SOUGHT[name][0] for name in unknown)} cannot be estimated from this log: its commands explain too "
            f"little of its motion{_compared(log, rated)}. State {' and '.join(SOUGHT[name][1] for name in unknown)}. If commands are "
            "stamped after they act, first correct their clock (clock.offset_s of a map)",
            () if coarse is None else _rough_settings(Setup(log, vehicle, coarse), unknown),
        )
    return found


def other_cutoffs(log: Log, vehicle: Resolved, pieces: Sequence[slice], found: FoundTiming | None) -> bool:
    """Whether the log refutes a cutoff that is stated as exact, with the timing ``found``.

    The timing absorbs the delay of a wrong cutoff. Its effect within a cycle may be too small for tests of all residuals.
    """
    low_passes = {f"{sensor}_cutoff": getattr(vehicle.imu, f"{sensor}_filter") for sensor in delay.SENSORS}
    names = [name for name, one in low_passes.items() if one is not None and one.order and not BY_NAME[name].sigma(vehicle)]
    if found is None or not names:
        return False
    part, within = segment.bounded(log, vehicle, found.at, pieces, LONG)
    return delay.cutoffs_refuted(part, vehicle, within, found, names)


def _compared(log: Log, rated: Sequence[Rated]) -> str:
    """Text that compares the residual variance of the next best delays."""
    ratios = {one.at.delay: np.exp((one.cost - rated[0].cost) / (2 * 6 * log.cycles)) for one in reversed(rated)}
    texts = [
        f"{cycles:g} leave {left:.3g} times as much" for cycles, left in sorted(ratios.items(), key=lambda one: one[1])[1 : FINALISTS + 1]
    ]
    return f" (the least residual is at {rated[0].at.delay:g} cycles; {', '.join(texts)})" if texts else ""


def _rough_settings(setup: Setup, unknown: Sequence[str]) -> tuple[str, ...]:
    """Keys that state the coarse estimate with its rough sigma."""
    settings = []
    for parameter in map(BY_NAME.__getitem__, unknown):
        value = float(setup.value(parameter.key or "")[0])
        sigma = ROUGHLY * (value if parameter.name.endswith("_cutoff") else parameter.scale(setup.vehicle))
        settings += [f"{parameter.key}={value:.9g}", f"{parameter.sigma_key}={sigma:.3g}"]
    return tuple(settings)


def _detected(setup: Setup, unknown: Sequence[str], prior: Sequence[float] | None = None) -> FoundTiming | None:
    part, within = _bounded(setup)
    if "accel_latency" not in unknown and steps_at_samples(setup.log, setup.vehicle, setup.timing) is not None:
        part = part._replace(log=replace(part.log, axes=(*part.log.axes[:3], False, False, False)))  # steps have no derivative
    return delay.detect(part, within, unknown, prior)


def _bounded(setup: Setup) -> tuple[Setup, Sequence[slice]]:
    """A part of the log short enough for an estimate, with noise levels, and the cycles of each phase in it."""
    log, vehicle, timing, *_ = setup
    samples = Stream.of(log, vehicle, timing)
    pieces = [cycles for _, cycles in phases_of(log, vehicle, samples)]
    used, _ = noiselevels.with_noise_levels(samples, pieces, vehicle)
    part, within = segment.bounded(log, vehicle, timing, pieces, LONG)
    return Setup(part, used, timing), within


def _with_stated(start: Setup, automatic: Mapping[str, bool]) -> FoundTiming | None:
    """Estimate of open parameters jointly with those stated with a sigma; None without such, or if they disagree.

    Stated parameters held fixed would move the open ones by their own errors.
    """
    sigmas = _stated_sigmas(start.vehicle)
    unknown = [name for name in SOUGHT if automatic.get(name) or sigmas[name] > 0]
    if len(unknown) == sum(automatic.values()):
        return None
    prior = [0.0 if automatic.get(name) else sigmas[name] for name in unknown]
    found = _detected(start, unknown, prior)
    if found is None:
        return None
    differences = np.abs(delay.differences(found.setup(start), start, unknown))
    return found if all(not sigma or off < CONTRADICTION * sigma for off, sigma in zip(differences, prior, strict=True)) else None


def _narrowed(log: Log, vehicle: Vehicle, say: Progress) -> FoundTiming | None:
    """Combination of a stated timing and the log's own estimate; None if the stated timing applies.

    It applies if nothing is uncertain, if the log adds little (a timing from this very log is not used twice), or if the log contradicts
    it, in which case the stated timing is tested.
    """
    stated, sigmas = Setup(log, vehicle, stated_timing(vehicle)), _stated_sigmas(vehicle)
    unknown = [name for name, sigma in sigmas.items() if sigma > 0]
    if not unknown:
        return None
    say("estimating delay, lag and low-passes", 0.0)
    shifts = {"delay", *LATENCIES} & set(unknown)
    # the log determines sums of delay and latencies; stated values separate them
    found = None if len(shifts) > 1 + any(log.axes[3:]) else _detected(stated, unknown)
    if found is None:
        return _with_stated(stated, {}) if len(shifts) > 1 else None
    if found.chi_square > delay.MISFIT:
        return None  # for example, single pulse errors that a fit without them takes for a delay
    return _combined(found, stated, delay.differences(found.setup(stated), stated, unknown), _stated_covariance(vehicle, unknown))


def _stated_sigmas(vehicle: Vehicle) -> dict[str, float]:
    """Stated sigmas of delay, lag, cutoffs and latencies, cycles."""
    return {name: BY_NAME[name].sigma(vehicle) for name in SOUGHT}


def _combined(found: FoundTiming, given: Setup, difference: Array, stated: Array) -> FoundTiming | None:
    """Combination of a stated timing t_P ± √P and the log's own t_S ± √S: t_P + P (P + S)⁻¹ (t_S − t_P)."""
    log_covariance = found.covariance
    informative = np.linalg.eigvals(np.linalg.solve(stated, log_covariance)).real.min() < NARROWER**2
    if not informative or difference @ np.linalg.solve(stated + log_covariance, difference) > CONTRADICTION**2:
        return None
    gain = stated @ np.linalg.inv(stated + log_covariance)
    between = gain @ log_covariance
    return found.between(gain @ difference, (between + between.T) / 2, given)
