"""State parameters of a reference, their natural sizes, and the Gauss–Newton step of a reference."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, tensor
from massprop_cli.model.layout import CG, INERTIA, MU
from massprop_cli.model.plant import Reference


def parameters(reference: Reference) -> Array:
    """(10,) state parameters of the reference: inertia [kg m²], CG [m], mu [1/kg]."""
    return np.concatenate([elements(reference.inertia), reference.cg, [reference.mu]])


def natural_sizes(reference: Reference) -> Array:
    """(10,) natural size of each state parameter: trace of inertia, sqrt(trace · mu), mu."""
    trace = float(np.trace(reference.inertia))
    sizes = np.empty(10)
    sizes[INERTIA], sizes[CG], sizes[MU] = trace, np.sqrt(trace * reference.mu), reference.mu
    return sizes


def sizes_of_quantities(reference: Reference) -> Array:
    """(10,) natural size of each of the ten quantities: :func:`natural_sizes` with the mass instead of mu."""
    return np.append(natural_sizes(reference)[:MU], 1 / reference.mu)


MAX_STEP = 1e3
"""Bound on a single step: factor on the mass or on a moment of inertia, and shift of the CG in natural sizes."""


def stepped(reference: Reference, target: Array) -> Reference | None:
    """The reference moved to the estimated parameters ``target`` (10,); None where these are no rigid body.

    ``target`` comes from a fit that is linear about ``reference``. The response is linear in J = I⁻¹, so the step is taken in J:
    ``J ← J − J δI J``. This converges also from a distant reference.
    """
    if not np.isfinite(target).all() or not 1 / MAX_STEP < target[MU] / reference.mu < MAX_STEP:
        return None
    if np.linalg.norm(target[CG] - reference.cg) > MAX_STEP * natural_sizes(reference)[CG][0]:
        return None
    inverse = np.linalg.inv(reference.inertia)
    moved = inverse - inverse @ (tensor(target[INERTIA]) - reference.inertia) @ inverse
    principal = np.linalg.eigvalsh(moved)
    root = np.linalg.cholesky(reference.inertia)
    change = np.linalg.eigvalsh(root.T @ moved @ root)
    if principal[0] < 1e-3 * principal[2] or change[0] < 1 / MAX_STEP or change[2] > MAX_STEP:
        return None
    return Reference(np.linalg.inv(moved), target[CG].copy(), float(target[MU]), reference.gyro_bias)
