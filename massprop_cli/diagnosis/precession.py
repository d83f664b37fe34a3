"""Regressor columns of stored momentum: the torque ω × h of momentum that turns with the body."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.model.plant import Motion
from massprop_cli.model.windows import windows
from massprop_cli.prepare.stored import Stored

PER_AXIS = 4
"""Columns per axis of stored momentum: three of rates × momentum, and the momentum."""


def precessing(stored: Stored, rate: Array, duration: Array, window_s: Array) -> tuple[Array, Array]:
    """(K − 1, 4 A) growth and (K, 4 A) means of rates × momentum, and of the momentum, whose torque by a gyro bias is linear in it.

    Rates (K, 3) are linear between cycle centres. ``duration`` (K, 1) of cycles and ``window_s`` (K − 1, 1) of windows, s.
    """
    momentum = windows(stored.mean, duration[:, 0] / stored.mean.shape[1], stored.skew.sum(1))
    mean, step = momentum.whole / duration, momentum.step
    curvature = np.diff(rate, axis=0)[:, None] * np.diff(mean, axis=0)[..., None] * window_s[..., None] / 6
    inner = np.gradient(rate, axis=0)[:, None] * np.gradient(mean, axis=0)[..., None] / 12
    by_rate = (rate[1:] + rate[:-1])[:, None] / 2 * step[..., None] + curvature, rate[:, None] * mean[..., None] + inner
    growth, means = (np.concatenate([a, b[..., None]], -1).reshape(len(b), -1) for a, b in zip(by_rate, (step, mean), strict=True))
    return growth, means


def precessing_within(stored: Stored, motion: Motion, duration: Array) -> tuple[Array, Array]:
    """(K − 1, A, 3) under the triangular window and (K, A, 3) means of rates × momentum, with the intra-cycle motion."""
    bin_s = duration / motion.rate.shape[1]
    momentum, skew = stored.mean[..., None], stored.skew[..., None]
    rate, growth = motion.rate[..., None, :], motion.rate_dot[..., None, :]
    skewed = (rate * skew + growth * momentum * bin_s[:, None, None, None] ** 2 / 12).sum(1)
    integrals = windows(rate * momentum + growth * skew, bin_s, skewed)
    return integrals.step, integrals.whole / duration[:, None, None]


def nutation(stored: Stored | None, cycles: slice, rate: Array) -> float:
    """Square of the nutation frequency by stored momentum h, (rad/s)².

    It is two thirds of mean h², times the squared ratio of rate changes to momentum changes.
    """
    if stored is None:
        return 0.0
    momentum = stored.mean[cycles].mean(1) @ stored.axis
    momentum_change, rate_change = ((np.diff(one, axis=0) ** 2).sum() for one in (momentum, rate))
    return float((momentum**2).sum(1).mean() * rate_change / momentum_change * 2 / 3) if momentum_change > 0 else 0.0
