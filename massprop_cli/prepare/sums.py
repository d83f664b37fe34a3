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
    within, whole = _over_bins(moment), _over_bins(integral)
    part = np.arange(integral.shape[1]) / integral.shape[1]
    return within / duration[:, None] + _over_bins(integral * part[:, None]), whole


def _over_bins(each: Array) -> Array:
    """(K, C) sums over bins of (K, B, C), which are few."""
    found = each[:, 0].copy()
    for place in range(1, each.shape[1]):
        found += each[:, place]
    return found


def net(part: Array, wrench: Array) -> Array:
    """(..., 6) what channels (..., C) make together by their ``wrench`` (C, 6) at full; nothing where they cancel but for rounding."""
    found: Array = np.einsum("...c,ci->...i", part, wrench)
    found[np.abs(found) < CANCELLED * np.einsum("...c,ci->...i", np.abs(part), np.abs(wrench))] = 0.0
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
    whole: Array
    """(K, 6) in all, as the accelerometer shows it."""


def wrenches(integral: Array, moment: Array, duration: Array, each: tuple[Array, Array, Array], wrench: Array) -> Wrenches:
    """Of integrals, moments and ``duration`` as :func:`windows` takes them, and of ``each`` of three windows; :func:`net` of all."""
    late = moment / (duration / integral.shape[1])[:, None, None] - integral / 2
    return Wrenches(*(net(part, wrench) for part in (integral, late, *each)))
