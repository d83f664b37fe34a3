"""Sums over control cycles: of the records in them, of what channels did in their bins, and of all channels together.

A cycle's sum is the same whatever other cycles there are.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass

AT_ONCE = 512
"""Cycles whose products are held at once."""
CANCELLED = 1e-12
"""Part of what each channel makes alone below which their sum is rounding."""


def of_records(each: Array, records: int) -> Array:
    """(K, 3) sums of records (n, 3), so many to each cycle. By einsum: numpy's sum is slow over rows of three."""
    return np.asarray(np.einsum("kri->ki", each.reshape(-1, records, 3)))


def windows(integral: Array, moment: Array, duration: Array) -> tuple[Array, Array]:
    """(K, C) impulses under the rising half of the triangular window (:mod:`massprop_cli.prepare.align`), and whole ones.

    Of integrals [s of full thrust] and first moments about each bin's beginning [s²], (K, B, C), of cycles that last ``duration`` (K,) s.
    """
    integral, moment = np.ascontiguousarray(integral), np.ascontiguousarray(moment)  # in the other order a sum's rounding is another
    within, whole = (np.einsum("kbc->kc", one) for one in (moment, integral))
    later = np.einsum("kbc,b->kc", integral, np.arange(integral.shape[1]) / integral.shape[1])
    return within / duration[:, None] + later, whole


def net(part: Array, wrench: Array) -> Array:
    """(..., 6) what channels (..., C) make together by their ``wrench`` (C, 6) at full; nothing where they cancel but for rounding."""
    alike = np.ascontiguousarray(np.moveaxis(part, -1, 0))  # numbers of one channel beside each other: several times as fast
    found, alone = (np.einsum("c...,ci->i...", *each) for each in ((alike, wrench), (np.abs(alike), np.abs(wrench))))
    found[np.abs(found) < CANCELLED * alone] = 0.0
    return np.ascontiguousarray(np.moveaxis(found, 0, -1))


@dataclass(frozen=True)
class Wrenches:
    """What all channels make together. K cycles, B bins, which are equal parts of each; torque about O and force, body axes."""

    impulse_bins: Array
    """(K, B, 6) N m s and N s."""
    skew_bins: Array
    """(K, B, 6) first moment of the same about the middle of its bin, over the bin's length: positive where it comes late."""
    rising: Array
    """(K, 6) impulse under the rising half of the triangular window."""
    falling: Array
    """(K, 6) under the falling half; ``rising + falling`` is the cycle's impulse as the gyro shows it."""
    whole: Array
    """(K, 6) the cycle's impulse as the accelerometer shows it."""


def wrenches(integral: Array, moment: Array, duration: Array, each: tuple[Array, Array, Array], wrench: Array) -> Wrenches:
    """Of integrals, moments and ``duration`` as :func:`windows` takes them, and of ``each`` of three windows; :func:`net` of all."""
    parts = []
    # of many channels and bins the products are several times as large as their sums
    for first in range(0, max(len(duration), 1), AT_ONCE):
        own = slice(first, first + AT_ONCE)
        late = moment[own] / (duration[own] / integral.shape[1])[:, None, None] - integral[own] / 2
        parts.append((*net(np.stack([integral[own], late]), wrench), *net(np.stack([one[own] for one in each]), wrench)))
    return Wrenches(*map(np.concatenate, zip(*parts, strict=True)))
