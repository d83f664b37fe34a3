"""Errors that all logs of a vehicle may share, apart from thrust scale and known values.

Errors of the vehicle file (geometry and response of jets and IMU) are the same in all logs. Noise, external torques and moving parts are
independent in each log.
"""

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters.timing import DELAY_STEP
from massprop_cli.estimate.pivot import pivot_quantities
from massprop_cli.model.sensitivity import RESTATED
from massprop_cli.report.body import values
from massprop_cli.result.schema import PhaseItem, Result

STATED = ("mounting", "timing", "thrust", "sensor")
"""Families of error parameters of the vehicle file."""
SHARED = ("uncertain-jet-", "uncertain-imu-", f"uncertain-{RESTATED}")
"""How codes of assumptions about the vehicle file begin whose errors are estimated."""


def alike(found: Result, phase: PhaseItem, delay: float = 0.0) -> Array:
    """(10,) sigmas of the errors that all logs may share, inf if unknown; (9,) for a combined result on a pedestal.

    ``delay``: sigma of the stated delay, cycles.
    """
    if phase.alike:
        return np.array(phase.alike)
    steps = {one.code: 1.0 for one in found.assumptions if one.code.startswith(SHARED)}
    steps |= {"command-delay": delay / DELAY_STEP}
    by_family = phase.discrepancy.shares if phase.discrepancy else {}
    shares = np.array([by_family[family] for family in STATED if family in by_family], dtype=float).reshape(-1, 10)
    unreported = all(one.value is None for one in phase.estimates.values())
    if unreported and (len(shares) or any(steps.get(one.code) for one in found.assumptions)):
        return np.full(10, np.inf)  # a result does not have the effects on unreported quantities
    variance = (np.nan_to_num(shares) ** 2).sum(0)
    for one in found.assumptions:
        for effect in one.effects:
            if effect.phase == phase.name and one.code in steps:
                variance += (steps[one.code] * np.array([effect.change.get(name, 0.0) for name in QUANTITIES])) ** 2
    return np.asarray(np.sqrt(variance))


def by_ten_about_pivot(phase: PhaseItem, bearing_mass_kg: float, pivot: Array) -> Array | None:
    """(9, 10) derivative of the nine quantities about the pivot (3,) with respect to the ten; None without values."""
    ten = values(phase.estimates)
    if not np.isfinite(ten).all():
        return None
    rotating = ten - np.append(np.zeros(9), bearing_mass_kg)
    return pivot_quantities(rotating, pivot, rotating[9])[1]


def alike_about_pivot(shared: Array, derivative: Array | None) -> Array:
    """(9,) shared sigmas about the pivot from those of the ten (10,); inf without the derivative (9, 10)."""
    if derivative is None:
        return np.full(9, np.inf if shared.any() else 0.0)
    return np.asarray(np.abs(derivative) @ shared)
