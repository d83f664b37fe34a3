"""What the coefficients of the response multiply: integrals over cycles of what acts, of the products of rates, and of gravity.

With the motion within a cycle rebuilt in bins, under the triangular window for the rate and over the cycle for the specific force
(:mod:`massprop_cli.prepare.align`); commands are integrated exactly, all else by its bins.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.intracycle import Within
from massprop_cli.model.momentum import made_by_motion
from massprop_cli.model.plant import Motion
from massprop_cli.model.plant.bearing import level
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.windows import Windows, windows
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.compensate import Samples


def integrals(samples: Samples, phi_map: ResponseMap, theta: Array, within: Within) -> tuple[Array, Array, Array]:
    """What Φ multiplies: (K − 1, C) under the triangular window, (K, C) mean over each cycle; (K − 1, 3) known growth of the rate."""
    plant, executed, motion = phi_map.plant, samples.executed, within.motion
    duration = executed.duration_s
    bin_s = duration / motion.rate.shape[1]
    # the mean of a product over a bin in which ω̇ is constant exceeds its middle value by that of the accelerations times h² / 12
    second = products(motion.rate) + products(motion.rate_dot) * (bin_s**2 / 12)[:, None, None]
    # the commands' own exactly, the rest by its bins
    jets = plant.commanded(np.stack([executed.rising, executed.falling, executed.whole]))
    late_s, later_s = (bin_s / 12)[:, None], 0.0
    if samples.kernel_effect is not None:
        late_s, later_s = late_s - samples.kernel_effect.curvature_s2 / bin_s[:, None], samples.kernel_effect.later_s
    turning = products(within.rates[1]) - products(within.rates[0])
    parts = [(second, turning * late_s)]
    made = made_by_motion(executed.stored, within.damping, motion, bin_s[:, None, None])
    if made is not None:
        own = windows(made[0], bin_s, made[1].sum(1))
        jets = np.concatenate([jets[..., :3] + np.stack(own), jets[..., 3:]], -1)
    parts = [*plant.by_attitude(motion, within.ups, executed.skew_bins, late_s), *parts]
    each = [windows(channels, bin_s, lateness) for channels, lateness in parts]
    if plant.pivoted and plant.translates:
        each[1] = _sensed(executed, motion, bin_s, each[1])
    each[-1] = each[-1]._replace(whole=each[-1].whole + later_s * turning)
    acting = Windows(*(np.concatenate(columns, -1) for columns in zip(jets, *each, strict=True)))
    known = windows(plant.swing(theta, motion), bin_s).step if plant.pivoted else np.zeros((len(duration) - 1, 3))
    return acting.step, acting.whole / duration[:, None], known


def _sensed(executed: Aligned, motion: Motion, bin_s: Array, flat: Windows) -> Windows:
    """(K, 3) the level part of the force ``flat``, which is by bins, with what the sensors' windows hold of the force beyond its bins."""
    force, up = slice(3, 6), windows(motion.up, bin_s).whole / executed.duration_s[:, None]
    by_bins = windows(executed.impulse_bins[..., force] / bin_s[:, None, None], bin_s, executed.skew_bins[..., force].sum(1))
    exact = executed.rising, executed.falling, executed.whole
    return Windows(*(part + level(up, one[:, force] - binned) for part, one, binned in zip(flat, exact, by_bins, strict=True)))
