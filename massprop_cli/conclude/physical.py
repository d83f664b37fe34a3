"""Physical consistency of an inertia tensor."""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.base.rigidbody import elements
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.estimate.known import DENSEST, density

BEYOND = 4.0
"""Sigmas by which a law is broken, as everywhere."""
THINNEST = 0.05
"""kg/m³, a twentieth of air: a body of less has most of its mass far out, or another unit."""
_PAIRS = 1 - np.eye(3)
"""Principal moments from second moments."""


class Breach(NamedTuple):
    """What no real body could have in an inertia."""

    said: str
    certain: bool
    """Whether its sigmas do not allow that a body has it after all."""
    of_inertia: bool = True
    """Whether it is the inertia's, so that there is a nearest one that a body could have."""
    no_matter: bool = False
    """Whether mass and inertia are of no matter."""


def breach(conclusion: Conclusion) -> Breach | None:
    """What no real body could have in this mass, or inertia; nothing is said of an inertia that is not wholly informed.

    A flat body's principal moments are exactly those that a body could have at most, low + middle = high: noise puts half of its estimates
    beyond.
    """
    if conclusion.rotating_mass <= 0:
        return Breach(f"the mass is less than its bearing's: {conclusion.rotating_mass:.4g} kg are left to turn on it", True, False)
    moments = conclusion.principal_moments
    low, middle, high = (float(moment) for moment in moments)
    if np.isnan(low):
        return None
    if low <= 0:
        return _not_positive(conclusion, low)
    lacking = high - low - middle
    if lacking <= ROUNDING * high:
        return _of_ball(conclusion)
    sigma = _sigma(conclusion, np.array([1.0, 1.0, -1.0]))
    said = f"the inertia breaks the triangle inequality: {low:.4g} + {middle:.4g} < {high:.4g} kg m^2"
    if lacking > BEYOND * sigma:
        return Breach(f"{said}; check jets, units and thrust", True)
    return Breach(f"{said}, as its sigmas allow ({lacking:.2g} ± {sigma:.2g} kg m^2): a flat body's does", False)


def _of_ball(conclusion: Conclusion) -> Breach | None:
    """Of the ball that has mass and moments."""
    mass, trace = conclusion.estimates["mass"], float(conclusion.principal_moments.sum())
    if not conclusion.rotating_mass > 0 or mass.sigma is None:
        return None
    away = BEYOND * np.array([mass.sigma, _sigma(conclusion, np.ones(3))])
    least, most = ((conclusion.rotating_mass + part * away[0], trace - part * away[1]) for part in (1, -1))
    if least[1] > 0 and density(*least) < THINNEST:
        radius = float(np.sqrt(least[1] / least[0] / 1.2))
        said = f"mass and inertia are those of a ball of {radius:.3g} m and {density(*least):.2g} kg/m^3, thinner than air"
        return Breach(f"{said}: unless most of it is far out, check the units of torques and forces", True, False)
    if most[0] > 0 and density(*most) > DENSEST:
        said = f"mass and inertia are those of a ball of {density(*most):.2g} kg/m^3, denser than any matter"
        return Breach(f"{said}: check the units of the gyro, of torques and of forces", True, False, True)
    return None


def _not_positive(conclusion: Conclusion, low: float) -> Breach:
    """A rod's least moment is nearly none: noise puts half of its estimates below."""
    sigma = _sigma(conclusion, np.array([1.0, 0.0, 0.0]))
    said = f"the inertia is not positive definite (least principal moment {low:.4g} kg m^2"
    if -low > BEYOND * sigma:
        return Breach(f"{said})", True)
    return Breach(f"{said}, as its sigmas allow, ± {sigma:.2g})", False)


def _sigma(conclusion: Conclusion, weights: Array) -> float:
    """Of a sum of the principal moments so weighted (3,): an eigenvalue's derivative is n nᵀ, n its eigenvector."""
    axes = np.linalg.eigh(conclusion.inertia)[1]
    slope: Array = (axes * weights) @ axes.T
    six = elements(slope * (2 - np.eye(3)))  # products stand twice in the tensor
    return float(np.sqrt(max(float(six @ conclusion.covariance[:6, :6] @ six), 0.0)))


def nearest_consistent(inertia: Array) -> Array:
    """The inertia (3, 3) nearest in the sum of squares that a body could have: positive, no principal moment above the others' sum.

    A body's second moments p are positive, and its principal moments are the sums of two of them: non-negative least squares in three
    unknowns, solved by trying which of them are zero (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, chapter 23).
    """
    moments, axes = np.linalg.eigh(inertia)
    candidates = [_PAIRS @ np.maximum(solver @ moments, 0.0) for solver in _solvers()]
    nearest = min(candidates, key=lambda sums: float(((sums - moments) ** 2).sum()))
    return np.asarray((axes * nearest) @ axes.T)


@cache
def _solvers() -> tuple[Array, ...]:
    """Second moments from principal ones, with some of them kept at zero."""
    return tuple(np.linalg.pinv(_PAIRS * keep) for keep in product((1.0, 0.0), repeat=3))
