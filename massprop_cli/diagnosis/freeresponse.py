"""How much commands explain of the motion with nothing known of the body: a regression on impulses whose coefficients are free.

    w[k+1] − w[k] = A (impulse) + B (products of rates) + C (vertical) + d
    f = A' (impulse) + B' (products of rates) + C' (vertical) + d'

by least squares; −2 log likelihood of what is left, its variance about each axis the most likely one. It takes milliseconds, so it says
which delay, low-pass or limit of commands explains most; a fit of the body then tests that.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.align import Impulses, impulses
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.timing import Timing

LEAST = 30
"""Cycles that a search needs beyond those whose commands it doesn't know."""

NEAR, FLAT = 0.01, 1e3
"""Step behind the curvature of what is left by a value; the least curvature that tells a sigma: of 0.04."""


class MeasuredMotion(NamedTuple):
    """Of a log's K cycles."""

    rate: Array
    """(K, 3)"""
    up: Array
    """(K, 3) mean of the vertical."""
    force: Array
    """(K, 3) specific force. What turns the vehicle makes it at the IMU, too, so the differenced rate, which is later, is not asked."""


def unexplained_by(log: Log, vehicle: Vehicle, timing: Timing, first: int = 0, motion: MeasuredMotion | None = None) -> tuple[float, float]:
    """−2 log likelihood, but for a constant, of rates and of specific force over commands under one timing, with nothing known of the body.

    By cycles from ``first`` on whose commands are known; of a ``motion`` that is the same whatever the commands do, where it is at hand.
    :class:`massprop_cli.base.errors.InputError` where that leaves too little of the log.
    """
    made, cycles = commanded(log, vehicle, timing, first)
    return unexplained(motion or motion_of(timing.of(log, vehicle, made)), made, cycles)


def unexplained_with(
    setup: Setup, values: Mapping[str, object], later: float = 0.0, first: int = 0, motion: MeasuredMotion | None = None
) -> tuple[float, float]:
    """The same with other values of keys, and commands that act ``later`` by some cycles; infinite where too little of the log is left."""
    try:
        return unexplained_by(setup.log, stating(setup.vehicle, values), setup.timing.moved(("delay",), (later,)), first, motion)
    except (InputError, np.linalg.LinAlgError):
        return np.inf, np.inf


def commanded(log: Log, vehicle: Vehicle, timing: Timing, first: int = 0) -> tuple[Impulses, slice]:
    """What commands do, and the cycles from ``first`` on in which they are known; :class:`InputError` of too few."""
    made = impulses(log, vehicle, timing.delay, timing.lag_s(vehicle))
    cycles = slice(max(first, int(np.argmax(made.usable)) + 1), log.cycles)
    if cycles.stop - cycles.start < LEAST + 3 * made.whole.shape[1]:
        raise InputError(f"{log.path}: {cycles.stop - cycles.start} cycles are too few to show what the IMU records; record longer")
    return made, cycles


def motion_of(samples: Samples) -> MeasuredMotion:
    """What the IMU felt."""
    return MeasuredMotion(samples.rate_rad_s, (samples.up_b[:-1] + samples.up_b[1:]) / 2, samples.specific_force_m_s2)


def unexplained(motion: MeasuredMotion, made: Impulses, piece: slice) -> tuple[float, float]:
    """Log of what is left of rate growth, and of specific force, when regressed on impulses, with nothing known of the body."""
    rates, force = residuals(motion, made, piece)
    return cost(rates), cost(force)


def cost(left: Array) -> float:
    """−2 log likelihood, but for a constant, of residuals (n, axes) of the most likely variance about each axis."""
    return len(left) * float(np.log((left**2).mean(0) + TINY).sum())


def residuals(motion: MeasuredMotion, made: Impulses, piece: slice, summed: bool = False) -> tuple[Array, Array]:
    """(n − 1, 3) of rate growth, or ``summed`` of the rate itself, and (n, 3) of specific force."""
    rate, up = motion.rate[piece], motion.up[piece]
    turned = products(rate)
    if made.stored is not None:
        turned = np.hstack([turned, made.stored.precession(motion.rate)[piece]])
    rising, falling, whole = (part[piece] for part in (made.rising, made.falling, made.whole))
    impulse = rising[:-1] + falling[1:]
    load = (turned[1:] + turned[:-1]) / 2
    growth, causes = np.diff(rate, axis=0), np.hstack([impulse, load, (up[1:] + up[:-1]) / 2, np.ones((len(load), 1))])
    if summed:
        growth, causes = np.cumsum(growth, 0), np.hstack([np.cumsum(causes, 0), np.ones((len(load), 1))])
    return _left(growth, causes), _left(motion.force[piece], np.hstack([whole, turned, up, np.ones((len(rate), 1))]))


def summed(motion: MeasuredMotion, log: Log, vehicle: Vehicle, timing: Timing, first: int = 0) -> Array:
    """(n, 6) what is left of the rates themselves, and of specific force."""
    rates, force = residuals(motion, *commanded(log, vehicle, timing, first), summed=True)
    return np.hstack([rates, force[1:]])


def _left(moved: Array, causes: Array) -> Array:
    size = np.sqrt((causes**2).sum(0))
    told = causes[:, size > 0] / size[size > 0]
    # jets that always fire together are one: a factorisation would take a direction of rounding for the other
    return np.asarray(moved - told @ np.linalg.lstsq(told, moved, rcond=ROUNDING)[0])


def line_minimum(cost: Callable[[float], float], begun: Sequence[float], step: float, finest: float) -> float:
    """The value with the least cost, from the best of those ``begun`` on by halved steps; of values that cost the same the largest."""

    @cache
    def order(value: float) -> tuple[float, float]:
        return cost(value), -value

    at = min(begun, key=order)
    while step > finest:
        step /= 2
        at = min((at, at - step, at + step), key=order)
    return at


def sigma_at(cost: Callable[[float], float], at: float) -> float:
    """One sigma of a value by the curvature of −2 log likelihood."""
    bent = (cost(at - NEAR) - 2 * cost(at) + cost(at + NEAR)) / NEAR**2
    return float((2 / max(bent, FLAT)) ** 0.5) if np.isfinite(bent) else NEAR
