"""Map from parameters θ to the coefficients φ in which the response is linear, for all environments.

:mod:`massprop_cli.model.plant` defines θ and φ. This module has their natural sizes, the steps of θ that lead to a rigid body, and the
indices of the gyroscopic coupling in φ.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import COLUMNS, MOMENTS, ROWS, tensor
from massprop_cli.model.plant.plant import MOMENT, MU, J, Plant, Reference

HALVINGS = 12
"""Most halvings of a step."""
LEAST = 1e-3
"""Smallest ratio of the least to the largest principal value of J or of the inertia."""
MAX_FACTOR = 1e3
"""Bound on the factor by which a single step changes the mass."""


@dataclass(frozen=True)
class ResponseMap:
    """Map of one plant: θ to φ and its derivative, and θ to a reference."""

    plant: Plant

    @property
    def size(self) -> int:
        """N, the number of coefficients."""
        return 3 * self.plant.channels + 4

    def sizes(self, theta: Array) -> Array:
        """(10,) natural size of each of θ: largest principal value of J; √(trace I · mu) times moment per metre of CG; mu."""
        principal = np.linalg.eigvalsh(tensor(theta[J]))
        trace = (1 / principal).sum() - self.plant.parallel_axis_trace(theta)
        sizes = np.full(10, principal[-1])
        sizes[MOMENT] = float(self.plant.moment_per_metre(theta)) * np.sqrt(trace * theta[MU])
        sizes[MU] = theta[MU]
        return sizes

    def scales(self, theta: Array) -> Array:
        """(..., 10) scale of each of θ (..., 10): √(J_ii J_jj), the size of ``moment`` as in :meth:`sizes`, mu."""
        diagonal = np.sqrt(np.abs(theta[..., MOMENTS]))
        scales = np.empty_like(theta)
        scales[..., J] = diagonal[..., ROWS] * diagonal[..., COLUMNS]
        trace = np.trace(np.linalg.inv(tensor(theta[..., J])), axis1=-2, axis2=-1)
        scales[..., MOMENT] = np.sqrt(np.abs(trace * theta[..., MU]))[..., None]
        scales[..., MOMENT] *= self.plant.moment_per_metre(theta)[..., None]
        scales[..., MU] = theta[..., MU]
        return scales

    def stepped(self, theta: Array, step: Array) -> Array:
        """(10,) θ moved by a step, which is halved until it leads to a rigid body; θ itself if none does."""
        for _ in range(HALVINGS):
            moved = theta + step
            if self._is_body(moved) and 1 / MAX_FACTOR < moved[MU] / theta[MU] < MAX_FACTOR:
                return moved
            step = step / 2
        return theta

    def _is_body(self, theta: Array) -> bool:
        if not np.isfinite(theta).all() or theta[MU] <= 0:
            return False
        principal = np.linalg.eigvalsh(tensor(theta[J]))
        if principal[0] < LEAST * principal[2]:
            return False
        inertia = np.linalg.eigvalsh(self.reference(theta).inertia)
        return bool(inertia[0] > LEAST * inertia[2])

    def reference(self, theta: Array, gyro_bias: Array | None = None) -> Reference:
        """The reference with the mass properties of θ (10,)."""
        values = self.plant.parameters(theta)
        return Reference(tensor(values[:6]), values[6:9], float(values[9]), np.zeros(3) if gyro_bias is None else gyro_bias)

    @property
    def onto(self) -> Array | None:
        """(N, c) combinations of φ that are the regression's columns; None: each coefficient."""
        return None

    @property
    def coupling(self) -> Array:
        """Indices in φ of the gyroscopic coupling, J Γ(I)."""
        return np.concatenate([np.arange(row * self.plant.channels - 6, row * self.plant.channels) for row in (1, 2, 3)])

    def nearest(self, theta: Array, steps: Array) -> Array:
        """(K, 10) θ moved by each of ``steps`` (K, 10), shortened until it leads to a rigid body; a step that is not finite is zero."""
        share, steps = np.ones(len(steps)), np.where(np.isfinite(steps).all(1, keepdims=True), steps, 0.0)
        steps[:, MU] = np.maximum(steps[:, MU], (1 / MAX_FACTOR - 1) * theta[MU])
        for _ in range(HALVINGS):
            moved: Array = theta + share[:, None] * steps
            principal = np.linalg.eigvalsh(tensor(moved[:, J]))
            invalid = principal[:, 0] < LEAST * principal[:, 2]
            if not invalid.any():
                return moved
            share[invalid] /= 2
        moved[invalid] = theta
        return moved

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(N,) φ of θ, and (N, 10) its derivative with respect to θ."""
        return self.plant.coefficients(theta)


@dataclass(frozen=True)
class Tangent(ResponseMap):
    """Map along the tangent at one θ. It has eleven coefficients, 1 and the departure from θ, and is valid near θ."""

    about: Array
    """(10,) θ of the tangent point."""

    @property
    def size(self) -> int:
        """Eleven."""
        return 11

    @property
    def onto(self) -> Array:
        """(N, 11) φ at the tangent point, and its derivative."""
        return np.column_stack(self.plant.coefficients(self.about))

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(11,) 1 and the departure of θ, and (11, 10) their derivative."""
        return np.concatenate([[1.0], theta - self.about]), np.eye(11, 10, -1)
