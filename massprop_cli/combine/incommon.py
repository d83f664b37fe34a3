"""What the errors of several logs of a vehicle may have in common, beside the thrust's scale and what is known.

Where jets and IMU sit and how they act is the vehicle file's: an error of it moves all estimates alike. Noise, and what acts from outside
or moves within the body, is each log's own.
"""

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters.timing import DELAY_STEP
from massprop_cli.estimate.pivot import pivot_quantities
from massprop_cli.report.body import values
from massprop_cli.result.schema import PhaseItem, Result

STATED = ("mounting", "timing", "thrust", "sensor")
"""Families of error parameters that are the vehicle file's."""


def alike(found: Result, phase: PhaseItem, delay: float = 0.0) -> Array:
    """(10,) sigma of what all logs may share, inf where unknown; on a combined pedestal (9,). ``delay``: sigma of the delay, cycles."""
    if phase.alike:
        return np.array(phase.alike)
    steps = {one.code: 1.0 for one in found.assumptions if one.code.startswith(("uncertain-jet-", "uncertain-imu-"))}
    steps |= {"command-delay": delay / DELAY_STEP}
    told = phase.discrepancy.shares if phase.discrepancy else {}
    shares = np.array([told[family] for family in STATED if family in told], dtype=float).reshape(-1, 10)
    hidden = all(one.value is None for one in phase.estimates.values())
    if hidden and (len(shares) or any(steps.get(one.code) for one in found.assumptions)):
        return np.full(10, np.inf)  # of quantities that are not reported no effect is
    variance = (np.nan_to_num(shares) ** 2).sum(0)
    for one in found.assumptions:
        for effect in one.effects:
            if effect.phase == phase.name and one.code in steps:
                variance += (steps[one.code] * np.array([effect.change.get(name, 0.0) for name in QUANTITIES])) ** 2
    return np.asarray(np.sqrt(variance))


def by_ten_about_pivot(phase: PhaseItem, bearing_mass_kg: float, pivot: Array) -> Array | None:
    """(9, 10) derivative of the values about the pivot (3,) by the ten; None where these have no values."""
    ten = values(phase.estimates)
    if not np.isfinite(ten).all():
        return None
    turning = ten - np.append(np.zeros(9), bearing_mass_kg)
    return pivot_quantities(turning, pivot, turning[9])[1]


def alike_about_pivot(own: Array, onto: Array | None) -> Array:
    """(9,) of what the ten have in common (10,) about the pivot; inf where it isn't told."""
    if onto is None:
        return np.full(9, np.inf if own.any() else 0.0)
    return np.asarray(np.abs(onto) @ own)
