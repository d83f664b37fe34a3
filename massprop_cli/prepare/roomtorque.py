"""A steady torque that stands still in the room, beside what is commanded: in body axes it turns as the body does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.quaternion import inverse, matrices, rotation_vector, turns_between
from massprop_cli.base.rigidbody import cross, times
from massprop_cli.prepare.align import Aligned


def with_torque(aligned: Aligned, attitude_wxyz: Array, torque_n_m: Array) -> tuple[Aligned, Array]:
    """What acts with the torque (3,), world axes, of a body with the attitudes (K + 1, 4) at the cycles' edges; and (K, 3) its mean.

    Within a cycle it is the parabola through both edges with the curvature ``θ × (θ × τ)`` of an even turn θ from one to the other.
    """
    edges, turn = times(matrices(inverse(attitude_wxyz)), torque_n_m), rotation_vector(turns_between(attitude_wxyz))
    bent = cross(turn, cross(turn, (edges[:-1] + edges[1:]) / 2))
    bins = aligned.impulse_bins.shape[1]
    at = ((np.arange(bins) + 0.5) / bins)[:, None]
    first, step, curve = (part[:, None] for part in (edges[:-1], np.diff(edges, axis=0), bent))
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
