"""Delay and lag as one run uses them: as stated, or found in the log where the vehicle file says "auto"; and how uncertain they are."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis import delay
from massprop_cli.diagnosis.delay import Found
from massprop_cli.estimate import noiselevels
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.sensitivity import Consider, late, lowpassed
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

_NAMES = {"delay": "command delay", "lag": "thrust lag"}


def with_timing(stated: Vehicle, detected: Found | None) -> Vehicle:
    """The vehicle with the sigmas of a timing that was found in the log."""
    if detected is None:
        return stated
    cycle, thrust = {}, {}
    if stated.cycle.command_delay_cycles == "auto":
        cycle["command_delay_sigma_cycles"] = detected.sigma.delay
    if stated.thrust.lag_s == "auto":
        thrust["lag_sigma_s"] = detected.sigma.lag_s(stated)
    if cycle and thrust:
        thrust["lag_delay_correlation"] = detected.correlation
    return stated.model_copy(update={"cycle": stated.cycle.model_copy(update=cycle), "thrust": stated.thrust.model_copy(update=thrust)})


def uncertain_timing(log: Log, stated: Vehicle, used: Timing) -> Consider:
    """Delay, lag and the sensors' low-passes where they are uncertain."""
    period = stated.cycle.period_s
    sigmas = {"delay": stated.cycle.command_delay_sigma_cycles, "lag": stated.thrust.lag_sigma_s / period}
    sensors = {"gyro": stated.imu.gyro_lag_sigma_s / period, "accel": stated.imu.accel_lag_sigma_s / period}
    variants = {name: late(log, stated, used, name) for name, sigma in sigmas.items() if sigma > 0}
    variants |= {name: lowpassed(log, stated, used, name) for name, sigma in sensors.items() if sigma > 0}
    found = {name: variant for name, variant in variants.items() if variant is not None}
    sigma = np.diag([{**sigmas, **sensors}[name] for name in found])
    correlation = np.eye(len(found))
    if "delay" in found and "lag" in found:
        correlation[0, 1] = correlation[1, 0] = stated.thrust.lag_delay_correlation
    return Consider(tuple(found.values()), sigma @ correlation @ sigma)


def stated_timing(stated: Vehicle, found: Timing = Timing(0.0, 0.0)) -> Timing:  # noqa: B008  a constant
    """Delay and lag of the vehicle file in cycles, as ``found`` where it says "auto"."""
    delay, lag = stated.cycle.command_delay_cycles, stated.thrust.lag_s
    return Timing(found.delay if delay == "auto" else delay, found.lag if lag == "auto" else lag / stated.cycle.period_s)


def found_timing(log: Log, source: VehicleSource, say: Progress) -> Found | None:
    """What the vehicle file leaves to be found ("auto"); None where it states both delay and lag."""
    automatic = {"delay": source.vehicle.cycle.command_delay_cycles == "auto", "lag": source.vehicle.thrust.lag_s == "auto"}
    unknown = [name for name, auto in automatic.items() if auto]
    if not unknown:
        return None
    say("finding delay and lag", 0.0)
    given = stated_timing(source.vehicle)
    lags = delay.LAGS if automatic["lag"] else (given.lag,)
    coarse = delay.search(log, source.vehicle, lags, delay.DELAYS if automatic["delay"] else (given.delay,))
    found = None
    if coarse is not None:
        samples = Stream.of(log, source.vehicle, coarse)
        pieces = [cycles for _, cycles in phases_of(log, source.vehicle, samples)]
        used, _ = noiselevels.with_noise_levels(samples, pieces, source.vehicle)
        found = delay.detect(log, used, pieces, coarse, unknown)
    if found is None:
        remedy = {"delay": "the delay in cycles (cycle.command_delay_cycles)", "lag": "the lag in seconds (thrust.lag_s)"}
        raise InputError(
            f"{log.path}: {' and '.join(f'the {_NAMES[name]}' for name in unknown)} can't be told from this log; its commands explain too "
            f"little of its motion. State {' and '.join(remedy[name] for name in unknown)}"
        )
    return found
