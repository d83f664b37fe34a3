"""First moment of a table about its pivot, its change by ballast, and the resulting swing periods.

κ = Σ m (r − b) over all parts of the table is the first moment about the pivot b (SAWE, Introduction to Aircraft Weight Engineering). A
weight m that slides by d along the unit vector a adds ``m a d``; a weight m added at p adds ``m (p − b)``. Both are linear, so the changes
follow from linear least squares with bounds.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import parallel_axis
from massprop_cli.inputs.ballast import Ballast

LEVEL = 1e4
"""Weight of the horizontal components relative to an unstated vertical one: levelling has priority."""
ADDING = 10.0
"""Cost of adding the full weight at a place, relative to a slide over the full travel: sliding has priority."""
NOTHING = 1e-9
"""Least change, as a part of a ballast's range."""


@dataclass(frozen=True)
class Hanging:
    """A table on its pivot, and n ballasts."""

    moment: Array
    """(3,) κ, kg m, body axes."""
    inertia: Array
    """(3, 3) about the pivot, kg m²."""
    masses: Array
    """(n,) masses of sliding weights, kg; 0 for places where weight can be added."""
    covariance: Array
    """(3 + n, 3 + n) covariance of moment and masses."""
    pivot: Array
    """(3,) position of the pivot from O, m."""
    gravity: float
    """m/s²."""
    up: Array
    """(3,) body axis that is to be vertical, with its sign."""


def _compliance(inertia: Array, up: Array) -> Array:
    """(2,) eigenvalues of I⁻¹ between the two horizontal axes, ascending, 1/(kg m²)."""
    level = np.linalg.svd(up[None])[2][1:]
    return np.linalg.eigvalsh(level @ np.linalg.inv(inertia) @ level.T)


def periods(hanging: Hanging) -> tuple[float, float] | None:
    """Longer and shorter period of small oscillations about the vertical, s; None for a top-heavy table.

    With k = −κ·u the torque of a small turn φ is ``−g k φ`` across u and none about it, so ``ω² = g k λ`` with λ of the horizontal part of
    I⁻¹ (Goldstein, Classical Mechanics, 6.2; wheels that stand still).
    """
    below = -float(hanging.moment @ hanging.up)
    if below <= 0:
        return None
    slow, fast = 2 * np.pi / np.sqrt(hanging.gravity * below * _compliance(hanging.inertia, hanging.up))
    return float(slow), float(fast)


def below_for(hanging: Hanging, period_s: float) -> float:
    """First moment below the pivot, kg m, for which the longer period is ``period_s``."""
    return float((2 * np.pi / period_s) ** 2 / (hanging.gravity * _compliance(hanging.inertia, hanging.up)[0]))


def effects(hanging: Hanging, ballast: Sequence[Ballast]) -> Array:
    """(3, n) derivative of κ with respect to each change: per metre of a slide, or per kg added."""
    columns = [
        mass * one.direction if one.slides else np.array(one.position_m) - hanging.pivot
        for one, mass in zip(ballast, hanging.masses, strict=True)
    ]
    return np.array(columns).reshape(-1, 3).T


def changes(matrix: Array, room: Array, short: Array, weight: Array, cost: Array) -> Array:
    """(n,) changes within their bounds ``room`` (n, 2) that come nearest to ``short`` (3,), kg m, at the least cost.

    First ``min |W (A u − short)|²`` within the bounds (Stark and Parker, Bounded-variable least squares, 1995); then, with A u as it is,
    ``min Σ cost |u| / room``: a vertex of a linear programme, so that as few ballasts change as can.
    """
    from scipy.optimize import linprog, lsq_linear

    span = room[:, 1] - room[:, 0]
    able = (span > 0) & (np.abs(matrix).max(0) > 0)
    found: Array = np.zeros(len(span))
    if not able.any():
        return found
    scaled, low, high = matrix[:, able] * span[able], room[able, 0] / span[able], room[able, 1] / span[able]
    size = np.abs(scaled).max()
    scaled = scaled / size
    best = lsq_linear(weight[:, None] * scaled, weight * short / size, (low, high), method="bvls", tol=1e-15).x
    bounds = [*zip(np.zeros_like(high), high, strict=True), *zip(np.zeros_like(low), -low, strict=True)]
    fewest = linprog(np.tile(cost[able], 2), A_eq=np.hstack([scaled, -scaled]), b_eq=scaled @ best, bounds=bounds)
    part = fewest.x[: len(low)] - fewest.x[len(low) :] if fewest.status == 0 else best
    found[able] = np.where(np.abs(part) < NOTHING, 0.0, np.clip(part, low, high)) * span[able]
    return found


def moved(hanging: Hanging, ballast: Sequence[Ballast], change: Array) -> Hanging:
    """The table after changes (n,): κ + Σ m a d + Σ Δm (p − b), inertia by the parallel-axis theorem, covariance of masses and placing."""
    matrix, inertia = effects(hanging, ballast), hanging.inertia.copy()
    slope = np.eye(len(hanging.covariance))
    extra = np.zeros((3, 3))
    for n, (one, by) in enumerate(zip(ballast, change, strict=True)):
        arm, mass = np.array(one.position_m) - hanging.pivot, hanging.masses[n]
        extra += placing(one, arm, mass if one.slides else by, by)
        if one.slides:
            slope[:3, 3 + n] = one.direction * by
            inertia += parallel_axis(mass, arm + one.direction * (one.at_m + by)) - parallel_axis(mass, arm + one.direction * one.at_m)
        else:
            inertia += parallel_axis(by, arm)
    covariance = slope @ hanging.covariance @ slope.T
    covariance[:3, :3] += extra
    return Hanging(hanging.moment + matrix @ change, inertia, hanging.masses, covariance, hanging.pivot, hanging.gravity, hanging.up)


def placing(one: Ballast, arm: Array, mass: float, by: float) -> Array:
    """(3, 3) covariance of κ by where a ballast was put, and by the weight that was added at ``arm`` (3,) from the pivot."""
    across = np.outer(one.direction, one.direction) if one.slides else np.eye(3)
    weighed = np.zeros((3, 3)) if one.slides else one.mass_sigma_kg**2 * np.outer(arm, arm)
    return (by != 0) * ((mass * one.position_sigma_m) ** 2 * across + weighed)


class MovedMoments(NamedTuple):
    """What moved against what was predicted."""

    predicted: Array
    """(3,) change of κ, kg m."""
    measured: Array
    covariance: Array
    """(3, 3) of their difference."""
    chi_square: float
    masses: Array
    """(n,) refined: of weights that slide, and of those that were added."""
    sigmas: Array
    scale: tuple[float, float]
    """Thrust over stated thrust, and its sigma; (1, 0) where it is stated as exact."""
    hanging: Hanging
    """The table as it now is, with what both logs and the moves say of it."""


def compared(before: Hanging, after: Hanging, ballast: Sequence[Ballast], change: Array, scale_sigma: float) -> MovedMoments:
    """Hold the difference of two logs' κ against the changes (n,) between them, and refine masses, κ and the thrust's scale by it.

    A log gives κ/(1 + e), e the common error of all thrust. With x = (κ₂, m, e), D the derivative of the changes by the masses and κ̂ᵢ the
    two estimates, ``κ̂₁ = κ₂ − D m − e κ̂₁ + noise`` is a measurement of x beside its prior, which is κ̂₂, the stated masses and e = 0
    (Kalman update: Bar-Shalom, Li and Kirubarajan, Estimation with Applications, eq. 5.2.3). The innovation's chi-square has three degrees
    of freedom.
    """
    n = len(ballast)
    step, placed = np.zeros((3, n)), np.zeros((3, 3))
    prior = np.zeros((4 + n, 4 + n))
    masses = np.array([mass if one.slides else by for one, mass, by in zip(ballast, before.masses, change, strict=True)])
    for i, (one, by) in enumerate(zip(ballast, change, strict=True)):
        step[:, i] = one.direction * by if one.slides else np.array(one.position_m) - before.pivot
        placed += placing(one.model_copy(update={"mass_sigma_kg": 0.0}), step[:, i], masses[i], by)
        prior[3 + i, 3 + i] = (one.mass_sigma_kg * (one.slides or by != 0)) ** 2
    own, other = before.covariance[:3, :3], after.covariance[:3, :3]
    # no more of the covariance than is in it: a known inertia tells the scale, too
    most = [1 / max(float(k.moment @ np.linalg.solve(c, k.moment)), TINY) for k, c in ((before, own), (after, other))]
    common = min(scale_sigma**2, *most)
    prior[:3, :3], prior[-1, -1] = other, common
    prior[:3, -1] = prior[-1, :3] = common * after.moment
    noise = own - common * np.outer(before.moment, before.moment) + placed
    sees = np.hstack([np.eye(3), -step, -before.moment[:, None]])
    innovation = before.moment - (after.moment - step @ masses)
    spread = sees @ prior @ sees.T + noise
    gain = np.linalg.solve(spread, sees @ prior).T
    keep = np.eye(4 + n) - gain @ sees
    x = np.concatenate([after.moment, masses, [0.0]]) + gain @ innovation
    refined = keep @ prior @ keep.T + gain @ noise @ gain.T
    sigmas = np.sqrt(np.maximum(np.diag(refined), 0.0))
    chi_square = float(innovation @ np.linalg.solve(spread, innovation))
    slides = np.array([one.slides for one in ballast])
    kept = np.concatenate([[True] * 3, slides])
    covariance = np.where(kept[:, None] & kept, refined[:-1, :-1], 0.0)
    now = Hanging(x[:3], after.inertia * (1 + x[-1]), np.where(slides, x[3:-1], 0.0), covariance, after.pivot, after.gravity, after.up)
    return MovedMoments(
        step @ masses, after.moment - before.moment, spread, chi_square, x[3:-1], sigmas[3:-1], (1 + x[-1], float(sigmas[-1])), now
    )
