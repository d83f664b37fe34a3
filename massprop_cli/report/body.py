"""Properties derived from the ten quantities: principal moments and axes, inertia about O, equivalent ellipsoid."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import parallel_axis, tensor
from massprop_cli.result.schema import DockedObject, EstimateItem, Matrix, PhaseItem

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Indices of ixx, ixy, ixz, iyy, iyz, izz in the matrix."""


@dataclass(frozen=True)
class Principal:
    """Principal moments of inertia, ascending, with sigmas and axes."""

    moments: Array
    """(3,) moments, kg m²."""
    sigmas: Array
    """(3,) sigmas, kg m²; NaN without a covariance."""
    axes: Array
    """(3, 3) axes in body axes: column i is the unit vector of moment i, with its largest component positive."""


@dataclass(frozen=True)
class Ellipsoid:
    """The homogeneous ellipsoid with this mass, CG and inertia."""

    semi_axes: Array
    """(3,) semi-axes in the order of ascending moments, m; relative to the largest without a mass."""
    axes: Array
    """(3, 3) principal axes in body axes, as columns."""
    center_m: Array
    """(3,) CG from O, body axes, m; NaN without an estimate."""
    to_scale: bool
    """Whether semi_axes are in metres."""
    corrected: bool
    """Whether it is that of the nearest consistent inertia, since no body can have the estimated one."""

    @property
    def located(self) -> bool:
        """Whether the position of O is known."""
        return self.to_scale and bool(np.isfinite(self.center_m).all())

    @property
    def shape(self) -> Array:
        """(3, 3) matrix A of the surface xᵀ A⁻¹ x = 1; its block for two axes gives the outline seen along the third, m²."""
        return np.asarray((self.axes * self.semi_axes**2) @ self.axes.T)


def values(estimates: dict[str, EstimateItem]) -> Array:
    """(10,) values, SI; NaN without an estimate."""
    return np.array([item.value for item in estimates.values()], dtype=float)


def inertia(phase: PhaseItem | DockedObject) -> Array:
    """(3, 3) inertia about the CG, kg m²."""
    return tensor(values(phase.estimates)[:6])


def inertia_sigmas(phase: PhaseItem | DockedObject) -> Array:
    """(3, 3) sigmas of the inertia about the CG, kg m²; NaN without an estimate."""
    return tensor(np.array([item.sigma for item in phase.estimates.values()][:6], dtype=float))


def _axes(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues (3,), ascending, and eigenvectors (3, 3) as columns, each with its largest component positive."""
    moments, axes = np.linalg.eigh(matrix)
    return moments, axes * np.sign(axes[np.argmax(np.abs(axes), axis=0), range(3)])


def principal(phase: PhaseItem | DockedObject) -> Principal | None:
    """Principal moments and axes; None without an inertia.

    To first order, the variance of λ = vᵀ I v is gᵀ P g with g = ∂λ/∂(ixx … izz).
    """
    matrix = inertia(phase)
    if not np.isfinite(matrix).all():
        return None
    moments, axes = _axes(matrix)
    covariance = np.array(phase.covariance, dtype=float)[:6, :6]
    gradients = np.array([[(1 if i == j else 2) * v[i] * v[j] for i, j in UPPER] for v in axes.T])
    variance = np.einsum("ai,ij,aj->a", gradients, covariance, gradients)
    return Principal(moments, np.sqrt(np.maximum(variance, 0.0)), axes)


def about_origin_sigmas(phase: PhaseItem | DockedObject, bearing_mass_kg: float) -> Array:
    """(3, 3) sigmas of the inertia about O, I + m (c·c 1 − c cᵀ), to first order from the covariance, kg m²; NaN without an estimate."""
    found = values(phase.estimates)
    c, mass = found[6:9], found[9] - bearing_mass_kg
    covariance = np.array(phase.covariance, dtype=float)
    sigmas = np.full((3, 3), np.nan)
    for row, (i, j) in enumerate(UPPER):
        gradient = np.zeros(10)
        gradient[row] = 1.0
        for k in range(3):
            gradient[6 + k] = mass * (2 * c[k] * (i == j) - c[j] * (i == k) - c[i] * (j == k))
        gradient[9] = (c @ c) * (i == j) - c[i] * c[j]
        sigmas[i, j] = sigmas[j, i] = np.sqrt(max(gradient @ covariance @ gradient, 0.0))
    return sigmas


def about_origin(docked: DockedObject) -> Array:
    """(3, 3) inertia of the docked object about O, kg m²; its mass includes no bearing. NaN without an estimate."""
    found = values(docked.estimates)
    return inertia(docked) + parallel_axis(float(found[9]), found[6:9])


def array(matrix: Matrix | None) -> Array:
    """A matrix of a result as an array, NaN for null; None gives (3, 3) NaN."""
    return np.full((3, 3), np.nan) if matrix is None else np.array(matrix, dtype=float)


def ellipsoid(phase: PhaseItem, bearing_mass_kg: float) -> Ellipsoid | None:
    """The ellipsoid with semi-axes a, a² = 5 p / m; p = ∫ x² dm is half the sum of the principal moments minus the axis's moment."""
    corrected = phase.physical.nearest_consistent is not None
    matrix = array(phase.physical.nearest_consistent) if corrected else inertia(phase)
    if not np.isfinite(matrix).all():
        return None
    moments, axes = _axes(matrix)
    second = np.maximum(moments.sum() / 2 - moments, 0.0)
    if not second.max() > 0:
        return None
    found = values(phase.estimates)
    mass = found[9] - bearing_mass_kg
    to_scale = bool(mass > 0)
    semi_axes = np.sqrt(5 * second / mass) if to_scale else np.sqrt(second / second.max())
    return Ellipsoid(semi_axes, axes, found[6:9], to_scale, corrected)
