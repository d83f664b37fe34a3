"""Regressor columns of momentum that wheels and gyros store: the torque ω × h, in which it turns with the body."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.model.plant import Motion
from massprop_cli.model.windows import windows
from massprop_cli.prepare.stored import Stored

PER_AXIS = 4
"""Columns of an axis along which momentum is stored: the rates times the momentum, and the momentum."""


def precessing(stored: Stored, rate: Array, duration: Array, lasting: Array) -> tuple[Array, Array]:
    """(K − 1, 4 A) growth and (K, 4 A) means: for each axis the rates times momentum; and momentum, of which a gyro's bias makes a torque.

    Of rates (K, 3) that are linear from each cycle's middle to the next; ``duration`` (K, 1) of cycles and ``lasting`` (K − 1, 1) of
    windows, s.
    """
    held = windows(stored.mean, duration[:, 0] / stored.mean.shape[1], stored.skew.sum(1))
    mean, step = held.whole / duration, held.step
    bent = np.diff(rate, axis=0)[:, None] * np.diff(mean, axis=0)[..., None] * lasting[..., None] / 6
    inner = np.gradient(rate, axis=0)[:, None] * np.gradient(mean, axis=0)[..., None] / 12
    by_rate = (rate[1:] + rate[:-1])[:, None] / 2 * step[..., None] + bent, rate[:, None] * mean[..., None] + inner
    growth, means = (np.concatenate([a, b[..., None]], -1).reshape(len(b), -1) for a, b in zip(by_rate, (step, mean), strict=True))
    return growth, means


def precessing_within(stored: Stored, motion: Motion, duration: Array) -> tuple[Array, Array]:
    """(K − 1, A, 3) under the triangular window and (K, A, 3) mean of the rates times momentum, with the motion within the cycles."""
    bin_s = duration / motion.rate.shape[1]
    held, skew = stored.mean[..., None], stored.skew[..., None]
    rate, growth = motion.rate[..., None, :], motion.rate_dot[..., None, :]
    late = (rate * skew + growth * held * bin_s[:, None, None, None] ** 2 / 12).sum(1)
    found = windows(rate * held + growth * skew, bin_s, late)
    return found.step, found.whole / duration[:, None, None]


def nutation(stored: Stored | None, cycles: slice, rate: Array) -> float:
    """(J h)² of the momentum h, (rad/s)², two thirds of it across an axis; J by how much the rates grew while the momentum did."""
    if stored is None:
        return 0.0
    held = stored.mean[cycles].mean(1) @ stored.axis
    grown, turned = ((np.diff(one, axis=0) ** 2).sum() for one in (held, rate))
    return float((held**2).sum(1).mean() * turned / grown * 2 / 3) if grown > 0 else 0.0
