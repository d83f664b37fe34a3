"""Sums over control cycles: of records, of channel impulses over bins, and of the wrenches of all channels.

The sum of one cycle does not depend on which other cycles are summed in the same call.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass

BLOCK_CYCLES = 512
"""Number of cycles per block; limits the memory for products of channels and bins."""
ROUNDING = 1e-12
"""A net wrench below this fraction of the sum of the channels' absolute contributions is rounding and is set to zero."""


def of_records(each: Array, records: int) -> Array:
    """(K, 3) sums over cycles of (n, 3) per-record values, ``records`` per cycle."""
    # einsum, because numpy's sum is slow over rows of three
    return np.asarray(np.einsum("kri->ki", each.reshape(-1, records, 3)))


def windows(integral: Array, moment: Array, duration: Array) -> tuple[Array, Array]:
    """(K, C) impulses under the rising half of the triangular window (:mod:`massprop_cli.prepare.align`), and (K, C) total impulses.

    ``integral``: (K, B, C) per bin, s of full thrust. ``moment``: (K, B, C) first moment about the start of each bin, s².
    ``duration``: (K,) length of each cycle, s.
    """
    integral, moment = np.ascontiguousarray(integral), np.ascontiguousarray(moment)  # memory order changes the rounding of a sum
    within_bins, whole = (np.einsum("kbc->kc", one) for one in (moment, integral))
    at_bin_starts = np.einsum("kbc,b->kc", integral, np.arange(integral.shape[1]) / integral.shape[1])
    return within_bins / duration[:, None] + at_bin_starts, whole


def net(part: Array, wrench: Array) -> Array:
    """(..., 6) net wrench of channel levels (..., C), with ``wrench`` (C, 6) of each channel at full; exactly zero if they cancel."""
    by_channel = np.ascontiguousarray(np.moveaxis(part, -1, 0))  # contiguous numbers of one channel: several times as fast
    total, absolute = (np.einsum("c...,ci->i...", *each) for each in ((by_channel, wrench), (np.abs(by_channel), np.abs(wrench))))
    total[np.abs(total) < ROUNDING * absolute] = 0.0
    return np.ascontiguousarray(np.moveaxis(total, 0, -1))


@dataclass(frozen=True)
class Wrenches:
    """Net impulse of all channels: torque about O [N m s] and force [N s], body axes. K cycles of B equal bins."""

    impulse_bins: Array
    """(K, B, 6) impulse of each bin."""
    skew_bins: Array
    """(K, B, 6) first moment of the impulse about the middle of the bin, over the bin's length; positive if the impulse is late."""
    rising: Array
    """(K, 6) impulse under the rising half of the triangular window."""
    falling: Array
    """(K, 6) impulse under the falling half; ``rising + falling`` is the cycle's impulse as measured by the gyro."""
    whole: Array
    """(K, 6) impulse of the cycle as measured by the accelerometer."""


def wrenches(integral: Array, moment: Array, duration: Array, each: tuple[Array, Array, Array], wrench: Array) -> Wrenches:
    """Net wrenches of all channels; ``integral``, ``moment`` and ``duration`` as in :func:`windows`.

    ``each``: (K, C) impulses under the rising half, under the falling half, and whole.
    """
    parts = []
    # in blocks, because the products are several times as large as their sums
    for first in range(0, max(len(duration), 1), BLOCK_CYCLES):
        block = slice(first, first + BLOCK_CYCLES)
        skew = moment[block] / (duration[block] / integral.shape[1])[:, None, None] - integral[block] / 2
        parts.append((*net(np.stack([integral[block], skew]), wrench), *net(np.stack([one[block] for one in each]), wrench)))
    return Wrenches(*map(np.concatenate, zip(*parts, strict=True)))
