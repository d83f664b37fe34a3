"""Physical consistency of an inertia tensor."""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.base.levels import CONTRADICTION
from massprop_cli.base.rigidbody import elements
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.estimate.known import DENSEST, density

THINNEST = 0.05
"""Least density, kg/m³: a twentieth of air. A lower density means that most of the mass is far out, or a wrong unit."""
_PAIRS = 1 - np.eye(3)
"""(3, 3) principal moments from second moments: each is the sum of two."""


class Breach(NamedTuple):
    """Violation of a physical bound by mass and inertia."""

    message: str
    certain: bool
    """Whether the violation exceeds what the sigmas allow."""
    of_inertia: bool = True
    """Whether the inertia itself violates it, so that a nearest consistent inertia exists."""
    too_dense: bool = False
    """Whether the density is above that of any matter."""


def breach(conclusion: Conclusion) -> Breach | None:
    """Violation of positive mass, positive definite inertia, triangle inequality or density bounds; None without one.

    Also None if part of the inertia is not informed. A flat body lies on the bound of the triangle inequality, low + middle = high, so
    noise puts half of its estimates beyond the bound.
    """
    if conclusion.rotating_mass <= 0:
        return Breach(
            f"the mass is less than environment.bearing_mass_kg: the rotating mass is {conclusion.rotating_mass:.4g} kg", True, False
        )
    moments = conclusion.principal_moments
    low, middle, high = (float(moment) for moment in moments)
    if np.isnan(low):
        return None
    if low <= 0:
        return _not_positive(conclusion, low)
    violation = high - low - middle
    if violation <= ROUNDING * high:
        return _density_breach(conclusion)
    sigma = _sigma(conclusion, np.array([1.0, 1.0, -1.0]))
    message = f"the inertia breaks the triangle inequality: {low:.4g} + {middle:.4g} < {high:.4g} kg m^2"
    if violation > CONTRADICTION * sigma:
        return Breach(f"{message}; check jets, units and thrust", True)
    return Breach(f"{message}, within its sigmas ({violation:.2g} ± {sigma:.2g} kg m^2): a flat body is at the limit", False)


def _density_breach(conclusion: Conclusion) -> Breach | None:
    """Violation of the density bounds by the homogeneous ball of the same mass and trace of inertia."""
    mass, trace = conclusion.estimates["mass"], float(conclusion.principal_moments.sum())
    if not conclusion.rotating_mass > 0 or mass.sigma is None:
        return None
    margin = CONTRADICTION * np.array([mass.sigma, _sigma(conclusion, np.ones(3))])
    densest, thinnest = ((conclusion.rotating_mass + sign * margin[0], trace - sign * margin[1]) for sign in (1, -1))
    if densest[1] > 0 and density(*densest) < THINNEST:
        radius = float(np.sqrt(densest[1] / densest[0] / 1.2))
        message = f"mass and inertia are those of a ball of {radius:.3g} m and {density(*densest):.2g} kg/m^3, less dense than air"
        return Breach(f"{message}: check the units of torques and forces, unless most of the mass is far from the CG", True, False)
    if thinnest[0] > 0 and density(*thinnest) > DENSEST:
        message = f"mass and inertia are those of a ball of {density(*thinnest):.2g} kg/m^3, denser than any matter"
        return Breach(f"{message}: check the units of the gyro, of torques and of forces", True, False, True)
    return None


def _not_positive(conclusion: Conclusion, low: float) -> Breach:
    """Violation by the least principal moment ``low``; near zero for a rod, so noise puts half of its estimates below zero."""
    sigma = _sigma(conclusion, np.array([1.0, 0.0, 0.0]))
    message = f"the inertia is not positive definite (least principal moment {low:.4g} kg m^2"
    if -low > CONTRADICTION * sigma:
        return Breach(f"{message})", True)
    return Breach(f"{message}, within its sigma of {sigma:.2g})", False)


def _sigma(conclusion: Conclusion, weights: Array) -> float:
    """Sigma, kg m², of the principal moments' sum with ``weights`` (3,); the derivative of an eigenvalue is n nᵀ, n its eigenvector."""
    axes = np.linalg.eigh(conclusion.inertia)[1]
    slope: Array = (axes * weights) @ axes.T
    by_element = elements(slope * (2 - np.eye(3)))  # each product of inertia occurs twice in the tensor
    return float(np.sqrt(max(float(by_element @ conclusion.covariance[:6, :6] @ by_element), 0.0)))


def nearest_consistent(inertia: Array) -> Array:
    """Physically consistent inertia (3, 3) that is nearest in the sum of squares: positive, with the triangle inequality.

    The second moments of a body are non-negative, and each principal moment is the sum of two. So this is non-negative least squares in
    three unknowns, solved for each set of zero unknowns (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, chapter 23).
    """
    moments, axes = np.linalg.eigh(inertia)
    candidates = [_PAIRS @ np.maximum(solver @ moments, 0.0) for solver in _solvers()]
    nearest = min(candidates, key=lambda sums: float(((sums - moments) ** 2).sum()))
    return np.asarray((axes * nearest) @ axes.T)


@cache
def _solvers() -> tuple[Array, ...]:
    """Eight (3, 3) least-squares solutions for the second moments, each with a different set kept at zero."""
    return tuple(np.linalg.pinv(_PAIRS * keep) for keep in product((1.0, 0.0), repeat=3))
