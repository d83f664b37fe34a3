"""Delay and lag as one run uses them, and how uncertain they are.

As stated; as found in the log, where the vehicle file says "auto"; or between the two, where it states them with a sigma.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import UntoldError
from massprop_cli.diagnosis import delay, segment
from massprop_cli.diagnosis.delay import Found
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import TABLE
from massprop_cli.estimate import noiselevels
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.sensitivity import Consider, variant
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

_NAMES = {"delay": "command delay", "lag": "thrust lag"}
LONGEST = 4800
"""Cycles that delay and lag are looked for in: beyond, they are known to a ten-thousandth of a cycle, and fits hold all cycles at once."""
OPEN = 1e4
"""Cycles; one sigma of what is to be found."""
NARROWER, FARTHEST = 0.5, 4.0
"""Part of a stated sigma that the log's own must be below to be heard beside it; sigmas beyond which the two are not of the same thing."""


def with_timing(stated: Vehicle, detected: Found | None) -> Vehicle:
    """The vehicle with the sigmas of a timing that was found in the log."""
    if detected is None:
        return stated
    cycle, thrust = {}, {}
    if detected.sigma.delay > 0:
        cycle["command_delay_sigma_cycles"] = detected.sigma.delay
    if detected.sigma.lag > 0:
        thrust["lag_sigma_s"] = detected.sigma.lag_s(stated)
    if cycle and thrust:
        thrust["lag_delay_correlation"] = detected.correlation
    return stated.model_copy(update={"cycle": stated.cycle.model_copy(update=cycle), "thrust": stated.thrust.model_copy(update=thrust)})


def uncertain_timing(setup: Setup, samples: Stream) -> Consider:
    """Delay, lag and the sensors' low-passes where they are uncertain."""
    uncertain = [one for one in TABLE if one.considered and one.sigma(setup.vehicle) > 0]
    found = {one.name: changed for one in uncertain if (changed := variant(one, setup, samples)) is not None}
    sigma = np.diag([one.sigma(setup.vehicle) for one in uncertain if one.name in found])
    names, correlation = list(found), np.eye(len(found))
    if {"delay", "lag"} <= found.keys():
        both = names.index("delay"), names.index("lag")
        correlation[both] = correlation[both[::-1]] = setup.vehicle.thrust.lag_delay_correlation
    return Consider(tuple(found.values()), sigma @ correlation @ sigma)


def stated_timing(stated: Vehicle, found: Timing = Timing(0.0, 0.0)) -> Timing:  # noqa: B008  a constant
    """Delay and lag of the vehicle file in cycles, as ``found`` where it says "auto"."""
    delay, lag = stated.cycle.command_delay_cycles, stated.thrust.lag_s
    return Timing(found.delay if delay == "auto" else delay, found.lag if lag == "auto" else lag / stated.cycle.period_s)


def found_timing(log: Log, source: VehicleSource, say: Progress) -> Found | None:
    """What the vehicle file leaves to be found ("auto"), or states to be uncertain; None where it is to be as stated."""
    automatic = {"delay": source.vehicle.cycle.command_delay_cycles == "auto", "lag": source.vehicle.thrust.lag_s == "auto"}
    unknown = [name for name, auto in automatic.items() if auto]
    if not unknown:
        return _narrowed(log, source.vehicle, say)
    say("finding delay and lag", 0.0)
    given = stated_timing(source.vehicle)
    lags = delay.LAGS if automatic["lag"] else (given.lag,)
    latest = Timing(delay.LONGEST, max(lags))
    part, pieces = segment.bounded(log, source.vehicle, latest, [slice(0, log.cycles)], LONGEST)
    coarse = delay.search(part, source.vehicle, lags, delay.DELAYS if automatic["delay"] else (given.delay,), pieces)
    found = None
    if coarse is not None:
        found = _beside_stated(log, source.vehicle, coarse, automatic) or _detected(log, source.vehicle, coarse, unknown)
    if found is None:
        remedy = {"delay": "the delay in cycles (cycle.command_delay_cycles)", "lag": "the lag in seconds (thrust.lag_s)"}
        raise UntoldError(
            f"{log.path}: {' and '.join(f'the {_NAMES[name]}' for name in unknown)} can't be told from this log; its commands explain too "
            f"little of its motion. State {' and '.join(remedy[name] for name in unknown)}; of commands that are stamped after they act "
            "bring the clocks together first (clock.offset_s of a map)"
        )
    return found


def _detected(log: Log, vehicle: Vehicle, start: Timing, unknown: Sequence[str]) -> Found | None:
    samples = Stream.of(log, vehicle, start)
    pieces = [cycles for _, cycles in phases_of(log, vehicle, samples)]
    used, _ = noiselevels.with_noise_levels(samples, pieces, vehicle)
    part, within = segment.bounded(log, vehicle, start, pieces, LONGEST)
    return delay.detect(part, used, within, start, unknown)


def _beside_stated(log: Log, vehicle: Vehicle, start: Timing, automatic: Mapping[str, bool]) -> Found | None:
    """What is to be found, together with what is stated with a sigma beside it; None where nothing is, or it isn't found so.

    Held at what is stated it would move the other as far as it is off itself.
    """
    sigmas = _sigmas(vehicle)._asdict()
    unknown = [name for name, auto in automatic.items() if auto or sigmas[name] > 0]
    if len(unknown) == sum(automatic.values()):
        return None
    found = _detected(log, vehicle, start, unknown)
    given = start if found is None else start._replace(**{name: getattr(found.at, name) for name, auto in automatic.items() if auto})
    stated = Timing(*(OPEN if automatic[name] else sigma for name, sigma in sigmas.items()))
    return None if found is None else _between(found, given, stated, unknown, 0.0)


def _narrowed(log: Log, vehicle: Vehicle, say: Progress) -> Found | None:
    """What a stated timing and what the log alone shows come to.

    None where nothing is uncertain, where the log can't tell or tells little beside it (so a timing that was found in this very log is not
    found again), and where it tells another: then the stated one is what is judged.
    """
    given, sigmas = stated_timing(vehicle), _sigmas(vehicle)
    unknown = [name for name, sigma in sigmas._asdict().items() if sigma > 0]
    if not unknown:
        return None
    say("finding delay and lag", 0.0)
    found = _detected(log, vehicle, given, unknown)
    return None if found is None else _between(found, given, sigmas, unknown, vehicle.thrust.lag_delay_correlation)


def _sigmas(vehicle: Vehicle) -> Timing:
    """By which delay and lag are stated to be uncertain, cycles."""
    return Timing(vehicle.cycle.command_delay_sigma_cycles, vehicle.thrust.lag_sigma_s / vehicle.cycle.period_s)


def _between(found: Found, given: Timing, sigmas: Timing, unknown: Sequence[str], correlation: float) -> Found | None:
    """What a stated timing t_P ± √P and what the log alone shows, t_S ± √S, come to: t_P + P (P + S)⁻¹ (t_S − t_P)."""
    own = [Timing._fields.index(name) for name in unknown]
    moved = np.subtract(found.at, given)[own]
    stated, shown = _covariance(sigmas, own, correlation), _covariance(found.sigma, own, found.correlation)
    sharper = np.linalg.eigvals(np.linalg.solve(stated, shown)).real.min() < NARROWER**2
    if not sharper or moved @ np.linalg.solve(stated + shown, moved) > FARTHEST**2:
        return None
    gain = stated @ np.linalg.inv(stated + shown)
    between = gain @ shown
    left = np.sqrt(np.diag(between))
    return replace(
        found,
        at=given.moved(unknown, gain @ moved),
        sigma=Timing(0.0, 0.0).moved(unknown, left),
        correlation=float(between[0, 1] / left.prod()) if len(own) == 2 else 0.0,
    )


def _covariance(sigmas: Timing, own: list[int], correlation: float) -> Array:
    """(n, n) of those that are uncertain, cycles²."""
    sigma = np.array(sigmas)[own]
    found: Array = np.outer(sigma, sigma) * np.where(np.eye(len(own)) > 0, 1.0, correlation)
    return found
