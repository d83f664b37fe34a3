"""A reference as ten state parameters, the sizes that these have by nature, and the reference moved to others."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, tensor
from massprop_cli.model.layout import CG, INERTIA, MU
from massprop_cli.model.plant import Reference


def parameters(reference: Reference) -> Array:
    """(10,) the reference as state entries: inertia, c, mu."""
    return np.concatenate([elements(reference.inertia), reference.cg, [reference.mu]])


def natural_sizes(reference: Reference) -> Array:
    """(10,) the size that each state parameter has by nature: trace, sqrt(trace/mass), 1/mass."""
    trace = float(np.trace(reference.inertia))
    sizes = np.empty(10)
    sizes[INERTIA], sizes[CG], sizes[MU] = trace, np.sqrt(trace * reference.mu), reference.mu
    return sizes


def sizes_of_quantities(reference: Reference) -> Array:
    """(10,) the same of the ten quantities, with the mass in place of its reciprocal."""
    return np.append(natural_sizes(reference)[:MU], 1 / reference.mu)


FARTHEST = 1e3
"""Factor on mass or a moment of inertia, and natural sizes of the CG's shift, that no single step may exceed."""


def stepped(reference: Reference, target: Array) -> Reference | None:
    """The reference moved to parameters ``target`` (10,) that a fit linear about it has found; None where that is no body.

    The response is linear in J = I⁻¹, so the step is taken there, ``J ← J − J δI J``: it lands right from a reference however far off.
    """
    if not np.isfinite(target).all() or not 1 / FARTHEST < target[MU] / reference.mu < FARTHEST:
        return None
    if np.linalg.norm(target[CG] - reference.cg) > FARTHEST * natural_sizes(reference)[CG][0]:
        return None
    inverse = np.linalg.inv(reference.inertia)
    response = inverse - inverse @ (tensor(target[INERTIA]) - reference.inertia) @ inverse
    principal = np.linalg.eigvalsh(response)
    root = np.linalg.cholesky(reference.inertia)
    change = np.linalg.eigvalsh(root.T @ response @ root)
    if principal[0] < 1e-3 * principal[2] or change[0] < 1 / FARTHEST or change[2] > FARTHEST:
        return None
    return Reference(np.linalg.inv(response), target[CG].copy(), float(target[MU]), reference.gyro_bias)
