"""A steady torque that stands still in the room, beside what is commanded: in body axes it turns as the body does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.quaternion import inverse, matrices
from massprop_cli.base.rigidbody import times
from massprop_cli.prepare.align import Aligned


def with_torque(aligned: Aligned, attitude_wxyz: Array, torque_n_m: Array) -> tuple[Aligned, Array]:
    """What acts with the torque (3,), world axes, of a body with the attitudes (K + 1, 4) at the cycles' edges; and (K, 3) its mean.

    Within a cycle it is a parabola through both edges, bent as it is from edge to edge: off by a part of ``(ωT)³/100``.
    """
    edges = times(matrices(inverse(attitude_wxyz)), torque_n_m)
    bent = np.zeros_like(edges)
    if len(edges) > 2:
        bent[1:-1] = edges[2:] - 2 * edges[1:-1] + edges[:-2]
        bent[[0, -1]] = bent[[1, -2]]
    bins = aligned.impulse_bins.shape[1]
    at = ((np.arange(bins) + 0.5) / bins)[:, None]
    first, step, curve = (part[:, None] for part in (edges[:-1], np.diff(edges, axis=0), (bent[:-1] + bent[1:]) / 2))
    duration = aligned.duration_s[:, None, None]
    mean = first + at * step - curve / 2 * (at * (1 - at) - 1 / (12 * bins**2))
    late = (step - curve * (0.5 - at)) / (12 * bins**2)
    impulse, skew = mean * duration / bins, late * duration
    whole = impulse.sum(1)
    rising = (at * impulse + skew / bins).sum(1)

    def added(acting: Array, by: Array) -> Array:
        return frozen(np.concatenate([acting[..., :3] + by, acting[..., 3:]], -1))

    acting = replace(
        aligned,
        impulse_bins=added(aligned.impulse_bins, impulse),
        skew_bins=added(aligned.skew_bins, skew),
        rising=added(aligned.rising, rising),
        falling=added(aligned.falling, whole - rising),
        whole=added(aligned.whole, whole),
    )
    return acting, frozen(whole / aligned.duration_s[:, None])
