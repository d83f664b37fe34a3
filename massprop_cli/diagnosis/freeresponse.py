"""Regression of the motion on the commands with free coefficients, which need no body.

    w[k+1] − w[k] = A (impulse) + B (products of rates) + C (vertical) + d
    f = A' (impulse) + B' (products of rates) + C' (vertical) + d'

The cost is −2 log likelihood of the residuals, with the variance about each axis at its maximum likelihood. It takes milliseconds. So it
selects the delay, low-pass or command limit to test by a fit of the body.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import ENOUGH, ITERATIONS, STILL
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.align import Impulses, impulses
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.timing import Timing

NEAR, FLAT = 0.01, 1e3
"""Step of the second difference of a cost, in the unit of the value, and the least curvature that gives a sigma (0.04)."""


STEP = 1e-3
"""Relative step of the difference quotients of a fit. A finer one falls between the commands that a limit cuts off."""


class MeasuredMotion(NamedTuple):
    """Motion measured over K cycles."""

    rate: Array
    """(K, 3) mean rate, rad/s."""
    up: Array
    """(K, 3) mean vertical, body axes."""
    force: Array
    """(K, 3) specific force, m/s². The lever arm of the IMU makes it show angular acceleration, too."""


def log_costs(log: Log, vehicle: Vehicle, timing: Timing, first: int = 0, motion: MeasuredMotion | None = None) -> tuple[float, float]:
    """Costs of rates and of specific force over the commands under one timing, up to a constant.

    Cycles count from ``first`` on if their commands are known. ``motion``: the measured motion, if it does not depend on what is varied.
    Raise :class:`massprop_cli.base.errors.InputError` if too few cycles are left.
    """
    impulse, cycles = known_impulses(log, vehicle, timing, first)
    return motion_costs(motion or motion_of(timing.of(log, vehicle, impulse)), impulse, cycles)


def costs_with(
    setup: Setup, values: Mapping[str, object], later: float = 0.0, first: int = 0, motion: MeasuredMotion | None = None
) -> tuple[float, float]:
    """The same with other values of keys, and a delay changed by ``later`` cycles; infinite if too few cycles are left."""
    try:
        return log_costs(setup.log, stating(setup.vehicle, values), setup.timing.moved(("delay",), (later,)), first, motion)
    except (InputError, np.linalg.LinAlgError):
        return np.inf, np.inf


def known_impulses(log: Log, vehicle: Vehicle, timing: Timing, first: int = 0) -> tuple[Impulses, slice]:
    """Impulses of the commands, and the cycles from ``first`` on in which they are known.

    Raise :class:`massprop_cli.base.errors.InputError` if these are too few.
    """
    impulse = impulses(log, vehicle, timing.delay, timing.lag_s(vehicle))
    cycles = slice(max(first, int(np.argmax(impulse.usable)) + 1), log.cycles)
    if cycles.stop - cycles.start < ENOUGH + 3 * impulse.whole.shape[1]:
        raise InputError(f"{log.path}: {cycles.stop - cycles.start} cycles are too few to show what the IMU records; record longer")
    return impulse, cycles


def motion_of(samples: Samples) -> MeasuredMotion:
    """Measured motion of samples."""
    return MeasuredMotion(samples.rate_rad_s, (samples.up_b[:-1] + samples.up_b[1:]) / 2, samples.specific_force_m_s2)


def motion_costs(motion: MeasuredMotion, impulse: Impulses, piece: slice) -> tuple[float, float]:
    """Costs of rate growth and of specific force, regressed on impulses."""
    rates, force = residuals(motion, impulse, piece)
    return cost(rates), cost(force)


def cost(left: Array) -> float:
    """−2 log likelihood of residuals (n, axes) up to a constant, with the variance about each axis at its maximum likelihood."""
    return len(left) * float(np.log((left**2).mean(0) + TINY).sum())


def residuals(motion: MeasuredMotion, impulse: Impulses, piece: slice, summed: bool = False) -> tuple[Array, Array]:
    """Residuals (n − 1, 3) of rate growth, or if ``summed`` of the rate, and (n, 3) of specific force."""
    rate, up = motion.rate[piece], motion.up[piece]
    turning = products(rate)
    if impulse.stored is not None:
        turning = np.hstack([turning, impulse.stored.precession(motion.rate)[piece]])
    rising, falling, whole = (part[piece] for part in (impulse.rising, impulse.falling, impulse.whole))
    window = rising[:-1] + falling[1:]
    precession = (turning[1:] + turning[:-1]) / 2
    change, regressors = np.diff(rate, axis=0), np.hstack([window, precession, (up[1:] + up[:-1]) / 2, np.ones((len(precession), 1))])
    if summed:
        change, regressors = np.cumsum(change, 0), np.hstack([np.cumsum(regressors, 0), np.ones((len(precession), 1))])
    return _regression_residual(change, regressors), _regression_residual(
        motion.force[piece], np.hstack([whole, turning, up, np.ones((len(rate), 1))])
    )


def summed_residuals(motion: MeasuredMotion, log: Log, vehicle: Vehicle, timing: Timing, first: int = 0) -> Array:
    """(n, 6) residuals of the rate and of specific force."""
    rates, force = residuals(motion, *known_impulses(log, vehicle, timing, first), summed=True)
    return np.hstack([rates, force[1:]])


def _regression_residual(motion: Array, regressors: Array) -> Array:
    """Residuals of a regression of ``motion`` on ``regressors``."""
    size = np.sqrt((regressors**2).sum(0))
    scaled = regressors[:, size > 0] / size[size > 0]
    # jets that always fire together give dependent columns
    return np.asarray(motion - scaled @ np.linalg.lstsq(scaled, motion, rcond=ROUNDING)[0])


class BoundedFit(NamedTuple):
    """Values of least cost within bounds."""

    values: Array
    """(d,) values."""
    covariance: Array
    """(d, d) their covariance, with a prior sigma of 1 for each."""
    cost: float


def bounded_fit(residuals: Callable[[Array], Array], start: Array, lower: Array, upper: Array, most: int = ITERATIONS) -> BoundedFit:
    """Least cost of ``residuals`` (n, axes) of values (d,) between ``lower`` and ``upper``, by bounded least squares from ``start``.

    The residuals are weighted anew by their own variances until the cost stays; with ``most`` 1, the values stay at ``start``.
    """
    from scipy.optimize import least_squares

    values, least = start, cost(residuals(start))
    for _ in range(most):
        weights = 1 / np.sqrt((residuals(values) ** 2).mean(0) + TINY)

        def weighted(at: Array, weights: Array = weights) -> Array:
            return (residuals(at) * weights).ravel()

        fit = least_squares(weighted, values, bounds=(lower, upper), method="dogbox", diff_step=STEP, max_nfev=min(most, 3))
        if (now := cost(residuals(fit.x))) > least - STILL:
            break
        values, least = fit.x, now
    return BoundedFit(values, np.linalg.inv(fit.jac.T @ fit.jac + np.eye(len(values))), least)


def one_sigma_further(values: Array, covariance: Array, lower: Array, upper: Array) -> Iterator[Array]:
    """Values (d,) one sigma further along each principal axis of their covariance, in the direction that the bounds leave more room."""
    variance, directions = np.linalg.eigh(covariance)
    for step in np.sqrt(variance)[:, None] * directions.T:
        room = [np.where(way > 0, upper - values, values - lower) / np.maximum(np.abs(way), TINY) for way in (step, -step)]
        forth, back = (min(1.0, float(each.min())) for each in room)
        yield values + (step * forth if forth >= back else -step * back)


def line_minimum(cost: Callable[[float], float], starts: Sequence[float], step: float, finest: float) -> float:
    """Minimise a cost by halved steps, from the best of ``starts``; of equal costs, the largest value."""

    @cache
    def key(value: float) -> tuple[float, float]:
        return cost(value), -value

    best = min(starts, key=key)
    while step > finest:
        step /= 2
        best = min((best, best - step, best + step), key=key)
    return best


def sigma_at(cost: Callable[[float], float], at: float) -> float:
    """Sigma of a value from the curvature of its −2 log likelihood."""
    curvature = (cost(at - NEAR) - 2 * cost(at) + cost(at + NEAR)) / NEAR**2
    return float((2 / max(curvature, FLAT)) ** 0.5) if np.isfinite(curvature) else NEAR
