"""Sums over control cycles: of the records in them, of what channels did in their bins, and of all channels together.

A cycle's sum is the same whatever other cycles there are.
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.kernel import kernel, pointer

CANCELLED = 1e-12
"""Part of what each channel makes alone below which their sum is rounding."""
TOGETHER = 32
"""Cycles that ``mp_host_wrenches`` sums at once."""


def of_records(each: Array, records: int) -> Array:
    """(K, 3) sums of records (n, 3), so many to each cycle. By einsum: numpy's sum is slow over rows of three."""
    found: Array = np.einsum("kri->ki", each.reshape(-1, records, 3))
    return found


def windows(integral: Array, moment: Array, duration: Array) -> tuple[Array, Array]:
    """(K, C) impulses under the rising half of the triangular window (:mod:`massprop_cli.prepare.align`), and whole ones.

    Of integrals [s of full thrust] and first moments about each bin's beginning [s²], (K, B, C), of cycles that last ``duration`` (K,) s.
    """
    count, bins, channels = integral.shape
    library = kernel().library
    if library is None:
        whole = _over_bins(integral, np.ones(bins))
        return _over_bins(moment, np.ones(bins)) / duration[:, None] + _over_bins(integral, np.arange(bins) / bins), whole
    flat = _alike(integral, moment)
    length, found = np.ascontiguousarray(duration), np.empty((2, count, channels))
    sizes = [ctypes.c_long(n) for n in (count, bins, channels, *_apart(flat[0]))]
    library.mp_host_windows(*sizes, *map(pointer, (*flat, length, found[0], found[1])))
    return found[0], found[1]


def _over_bins(each: Array, weights: Array) -> Array:
    """(K, C) weighted sums over bins of (K, B, C)."""
    found: Array = np.einsum("ckb,b->kc", np.moveaxis(each, -1, 0), weights)
    return found


def net(part: Array, wrench: Array) -> Array:
    """(..., 6) what channels (..., C) make together by their ``wrench`` (C, 6) at full; nothing where they cancel but for rounding."""
    library = kernel().library
    if library is None:
        found: Array = part @ wrench
        found[np.abs(found) < CANCELLED * (np.abs(part) @ np.abs(wrench))] = 0.0
        return found
    made = np.empty((*part.shape[:-1], 6))
    flat, given = part.reshape(made.size // 6, len(wrench)), np.ascontiguousarray(wrench, dtype=float)
    sizes = [ctypes.c_long(n) for n in (*flat.shape, *_apart(flat))]
    library.mp_host_net(*sizes, *map(pointer, (flat, given, np.array([CANCELLED]), made)))
    return made


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
    count, bins, channels = integral.shape
    library = kernel().library
    if library is None:
        late = moment / (duration / bins)[:, None, None] - integral / 2
        return Wrenches(*(net(part, wrench) for part in (integral, late, *each)))
    flat = _alike(integral, moment)
    given = tuple(np.ascontiguousarray(part, dtype=float) for part in (duration, np.stack(each), wrench))
    made, windowed = np.empty((2, count, bins, 6)), np.empty((3, count, 6))
    sizes = [ctypes.c_long(n) for n in (count, TOGETHER, bins, channels, *_apart(flat[0]))]
    room = np.empty((TOGETHER, 6, 2 * bins + 3))
    library.mp_host_wrenches(*sizes, *map(pointer, (*flat, *given, np.array([CANCELLED]), room, *made, windowed)))
    return Wrenches(*made, *windowed)


def _alike(*parts: Array) -> list[Array]:
    """(K B, C) each of (K, B, C), whose numbers stand equally far apart."""
    flat = [each.reshape(each.shape[0] * each.shape[1], each.shape[2]) for each in parts]
    return flat if flat[0].strides == flat[1].strides else [np.ascontiguousarray(each) for each in flat]


def _apart(flat: Array) -> tuple[int, ...]:
    """By how many numbers rows, and columns, of an array stand apart."""
    return tuple(step // flat.itemsize for step in flat.strides)
