"""Torque against the body's rate, −d ω with d of each axis: drag of the air, the film of a bearing, a cable.

It acts as the body turns, so beside what stored momentum does (:mod:`massprop_cli.model.momentum`) it is the torque that the motion
itself makes. In proportion to the rate alone: what goes with its square is not in it.
"""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.model.momentum import precession
from massprop_cli.model.plant import Motion
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.stored import Stored


def made_by_motion(stored: Stored | None, damping: Array, motion: Motion, bin_s: Array) -> tuple[Array, Array] | None:
    """(K, B, 3) torque −ω × h − d ω, mean of each bin, N m; its first moment about the bin's middle over its length, N m s.

    ``damping`` is d (3,), N m s; ``bin_s`` (K, 1, 1). None where there is neither.
    """
    precessing = None if stored is None else precession(stored, motion, bin_s)
    if not damping.any():
        return precessing
    torque, late = -damping * motion.rate, -damping * motion.rate_dot * bin_s**2 / 12
    return (torque, late) if precessing is None else (precessing[0] + torque, precessing[1] + late)


def impulse_by_damping(motion: Motion, rates: tuple[Array, Array], bin_s: Array) -> Windows:
    """(K, 3, 3) impulse of the torque under a cycle's windows by each axis' d, rad; ``rates`` (K, 3) begin and end the cycles."""
    turned = windows(motion.rate, bin_s, (rates[1] - rates[0]) * bin_s[:, None] / 12)
    return Windows(*(-part[..., None] * np.eye(3) for part in turned))
