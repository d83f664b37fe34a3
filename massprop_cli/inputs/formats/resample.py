"""Resampling to records and cycles: rates are integrated, increments summed, commands averaged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray
from massprop_cli.base.errors import InputError
from massprop_cli.base.quaternion import inverse, matrices, quaternion_product
from massprop_cli.base.rigidbody import times
from massprop_cli.inputs.equipment import OFF_UNIT

if TYPE_CHECKING:
    from massprop_cli.inputs.formats.mapfile import Attitude

Values = Literal["sample", "mean", "increment"]
Holds = Literal["until_next", "since_last"]
WANDER = 50
"""Number of samples over which the scatter of time stamps is averaged."""


def even(stamps_s: Array) -> tuple[Array, float]:
    """(n,) evenly spaced times fitted to the time stamps, and their wander: largest mean residual of ``WANDER`` samples, in intervals."""
    number = np.arange(len(stamps_s))
    slope, first = np.polyfit(number, stamps_s, 1)
    line: Array = first + slope * number
    width = min(WANDER, len(line))
    total = np.cumsum(np.concatenate([[0.0], stamps_s - line]))
    return line, float(np.abs(total[width:] - total[:-width]).max() / width / slope)


def knots(times_s: Array, kind: Values) -> Array:
    """Times at which the sum of increments is known: times of samples; for values over intervals, also the start of the first interval."""
    return times_s if kind == "sample" else np.insert(times_s, 0, times_s[0] - np.median(np.diff(times_s)))


def all_at(knots_s: Array, times_s: Array, slack_s: float) -> bool:
    """Whether each time is within ``slack_s`` of a knot."""
    after = np.clip(np.searchsorted(knots_s, times_s), 1, len(knots_s) - 1)
    away = np.minimum(np.abs(knots_s[after] - times_s), np.abs(knots_s[after - 1] - times_s))
    return bool((away < slack_s).all())


def increments(values: Array, times_s: Array, kind: Values, edges_s: Array) -> Array:
    """(m, 3) increments between m + 1 edges within the :func:`knots`, by linear interpolation of the sum; rates by the trapezoidal rule."""
    known = knots(times_s, kind)
    steps = np.diff(known)[:, None]
    each = values if kind == "increment" else values * steps if kind == "mean" else (values[1:] + values[:-1]) / 2 * steps
    return _summed(each, known, edges_s)


def _summed(each: Array, knots_s: Array, edges_s: Array) -> Array:
    """(m, n) sums between m + 1 edges of ``each``, which accrues linearly between knots."""
    total = np.vstack([np.zeros(each.shape[1]), np.cumsum(each, 0)])
    return np.stack([np.diff(np.interp(edges_s, knots_s, column)) for column in total.T], 1)


def means(values: Array, times_s: Array, holds: Holds, edges_s: Array) -> Array:
    """(m, n) means between m + 1 edges of values that hold until the next value, or since the last."""
    known = span(times_s, holds)
    known[0], known[-1] = (known[0], max(known[-1], edges_s[-1])) if holds == "until_next" else (min(known[0], edges_s[0]), known[-1])
    return _summed(values * np.diff(known)[:, None], known, edges_s) / np.diff(edges_s)[:, None]


def span(times_s: Array, holds: Holds) -> Array:
    """Edges of the intervals in which values hold; the open one has the median length."""
    last = float(np.median(np.diff(times_s)))
    return np.append(times_s, times_s[-1] + last) if holds == "until_next" else np.insert(times_s, 0, times_s[0] - last)


def in_each(times_s: Array, edges_s: Array, early: float) -> tuple[IntArray, IntArray]:
    """Number of samples in each interval between edges, and index of the first; ``early`` shifts edges by a fraction of an interval."""
    slack = early * float(np.median(np.diff(edges_s)))
    at = np.searchsorted(times_s, edges_s - slack)
    return np.diff(at), np.minimum(at[:-1], len(times_s) - 1)


def attitude_at(quaternions: Array, times_s: Array, wanted_s: Array) -> Array:
    """(m, 4) quaternions by normalised linear interpolation; the nearest sample outside."""
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, len(times_s) - 1)
    share = np.clip((wanted_s - times_s[after - 1]) / (times_s[after] - times_s[after - 1]), 0, 1)[:, None]
    first, second = quaternions[after - 1], quaternions[after]
    # q and −q are the same attitude
    near = second * np.where((first * second).sum(1) < 0, -1.0, 1.0)[:, None]
    between = (1 - share) * first + share * near
    return np.asarray(between / np.linalg.norm(between, axis=1)[:, None])


def nearest_to_samples(times_s: Array, wanted_s: Array, longest_s: float) -> BoolArray:
    """(m,) whether a wanted time is the nearest to a sample, between samples at most ``longest_s`` apart."""
    before = np.clip(np.searchsorted(wanted_s, times_s), 1, len(wanted_s) - 1) - 1
    found = np.zeros(len(wanted_s), bool)
    found[before + (times_s - wanted_s[before] > wanted_s[before + 1] - times_s)] = True
    after = np.clip(np.searchsorted(times_s, wanted_s), 1, len(times_s) - 1)
    return found & (times_s[after] - times_s[after - 1] <= longest_s)


def z_up(quaternions: Array, world: Literal["z_up", "z_down"]) -> Array:
    """(n, 4) the same attitudes in a world with z up; z down is rotated by half a turn about x."""
    w, x, y, z = quaternions.T
    return quaternions if world == "z_up" else np.stack([-x, w, -z, y], 1)


def quaternions(entry: Attitude, recorded: Array, refused: Callable[[int, float], InputError]) -> Array:
    """(n, 4) unit quaternions wxyz, world from body, from quaternions (n, 4) or headings (n, 1), rad; ``refused`` makes a norm's error."""
    if entry.order == "heading":
        half, none = recorded[:, 0] / 2, np.zeros(len(recorded))
        recorded = np.stack([np.cos(half), none, none, np.sin(half)], 1)
    found = recorded[:, [3, 0, 1, 2]] if entry.order == "xyzw" else recorded
    norm = np.linalg.norm(found, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1) > OFF_UNIT)
    if bad.size:
        raise refused(int(bad[0]), float(norm[bad[0]]))
    found = found / norm[:, None]
    if entry.turns == "body_from_world":
        found = inverse(found)
    return about_axes(found, entry.axes)


def about_axes(quaternions: Array, axes: Sequence[str]) -> Array:
    """(n, 4) attitudes of body axes that are the given axes of the recorded body: ``("x", "-y", "-z")``."""
    turn = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        turn["xyz".index(axis[-1]), row] = -1.0 if axis[0] == "-" else 1.0
    # products of the quaternion's components, times four; the row with the largest diagonal is most precise (Shepperd 1978)
    (a, b, c), (d, e, f), (g, h, i) = turn
    products = np.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    own = products[int(np.argmax(np.diag(products)))]
    return quaternion_product(quaternions, own / np.linalg.norm(own))


def into_body(vectors: Array, quaternions: Array) -> Array:
    """(n, 3) world vectors in body axes, by quaternions wxyz, world from body."""
    return times(matrices(inverse(quaternions)), vectors)
