"""Sums over control cycles: of the records in them, of what channels did in their bins, and of all channels together.

A cycle's sum is the same whatever other cycles there are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array

CANCELLED = 1e-12
"""Part of what each channel makes alone below which their sum is rounding."""


def of_records(each: Array, records: int) -> Array:
    """(K, 3) sums of records (n, 3), so many to each cycle. By einsum: numpy's sum is slow over rows of three."""
    found: Array = np.einsum("kri->ki", each.reshape(-1, records, 3))
    return found


def windows(integral: Array, moment: Array, duration: Array) -> tuple[Array, Array]:
    """(K, C) impulses under the rising half of the triangular window (:mod:`massprop_cli.prepare.align`), and whole ones.

    Of integrals [s of full thrust] and first moments about each bin's beginning [s²], (K, B, C), of cycles that last ``duration`` (K,) s.
    """
    bins, (each, moments) = integral.shape[1], (np.moveaxis(part, -1, 0) for part in (integral, moment))
    whole, begun = np.moveaxis(each @ np.stack([np.ones(bins), np.arange(bins) / bins], 1), -1, 0)
    return ((moments @ np.ones(bins)) / duration + begun).T, whole.T


def net(part: Array, wrench: Array) -> Array:
    """(..., 6) what channels (..., C) make together by their ``wrench`` (C, 6) at full; nothing where they cancel but for rounding."""
    found: Array = part @ wrench
    found[np.abs(found) < CANCELLED * (np.abs(part) @ np.abs(wrench))] = 0.0
    return found


class Wrenches(NamedTuple):
    """What all channels make together. K cycles, B bins; torque about O and force."""

    impulse_bins: Array
    """(K, B, 6) N m s and N s."""
    skew_bins: Array
    """(K, B, 6) first moment of the same about the middle of its bin, over the bin's length."""
    rising: Array
    """(K, 6) impulse under the rising half of the triangular window."""
    falling: Array
    """(K, 6) under the falling half."""


def wrenches(integral: Array, moment: Array, duration: Array, halves: tuple[Array, Array], wrench: Array) -> Wrenches:
    """Of integrals, moments and ``duration`` as :func:`windows` takes them, and what it gives; :func:`net` of each."""
    (count, bins, channels), (rising, whole) = integral.shape, halves
    flat, lately = (each.reshape(count * bins, channels) for each in (integral, moment))
    impulse, alone = flat @ wrench, CANCELLED * (np.abs(flat) @ np.abs(wrench))
    skew = (lately @ wrench) / np.repeat(duration / bins, bins)[:, None] - impulse / 2
    for each in (impulse, skew):  # no moment lies farther from its bin's middle than half the bin
        each[np.abs(each) < alone] = 0.0
    by_bin = (count, bins, 6)
    return Wrenches(impulse.reshape(by_bin), skew.reshape(by_bin), net(rising, wrench), net(whole - rising, wrench))
