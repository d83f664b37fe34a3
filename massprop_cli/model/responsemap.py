"""The map from parameters θ to the coefficients φ in which the response is linear, common to all environments.

What θ and φ are in each environment is said in :mod:`massprop_cli.model.plant`. Here: how large they are by nature, which steps of θ lead
to a body, and where in φ the gyroscopic coupling stands.
"""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import COLUMNS, MOMENTS, ROWS, tensor
from massprop_cli.model.plant.plant import MOMENT, MU, J, Plant, Reference

HALVINGS = 12
LEAST = 1e-3
"""Smallest principal value over the largest that a body in the making may have."""
FARTHEST = 1e3
"""Factor on the mass that no single step may exceed."""


@dataclass(frozen=True)
class ResponseMap:
    """θ for a plant: to φ with its slopes, from and to a reference."""

    plant: Plant

    @property
    def size(self) -> int:
        """N."""
        return 3 * self.plant.channels + 4

    def sizes(self, theta: Array) -> Array:
        """(10,) the size that each of θ has by nature: the largest J; sqrt(trace I · mu) of the CG, in what says where it is; mu."""
        principal = np.linalg.eigvalsh(tensor(theta[J]))
        trace = (1 / principal).sum() - self.plant.parallel_axis_trace(theta)
        sizes = np.full(10, principal[-1])
        sizes[MOMENT] = float(self.plant.moment_per_metre(theta)) * np.sqrt(trace * theta[MU])
        sizes[MU] = theta[MU]
        return sizes

    def scales(self, theta: Array) -> Array:
        """(..., 10) what a departure of each of θ (..., 10) is small or large beside: √(J_ii J_jj), and sizes as above."""
        own = np.sqrt(np.abs(theta[..., MOMENTS]))
        found = np.empty_like(theta)
        found[..., J] = own[..., ROWS] * own[..., COLUMNS]
        trace = np.trace(np.linalg.inv(tensor(theta[..., J])), axis1=-2, axis2=-1)
        found[..., MOMENT] = np.sqrt(np.abs(trace * theta[..., MU]))[..., None]
        found[..., MOMENT] *= self.plant.moment_per_metre(theta)[..., None]
        found[..., MU] = theta[..., MU]
        return found

    def stepped(self, theta: Array, step: Array) -> Array:
        """θ moved by a step, which is halved until it leads to a body."""
        for _ in range(HALVINGS):
            moved = theta + step
            if self._is_body(moved) and 1 / FARTHEST < moved[MU] / theta[MU] < FARTHEST:
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
        """The mass properties of θ (10,)."""
        found = self.plant.parameters(theta)
        return Reference(tensor(found[:6]), found[6:9], float(found[9]), np.zeros(3) if gyro_bias is None else gyro_bias)

    @property
    def onto(self) -> Array | None:
        """(N, c) the combinations of φ that are free; None: each by itself."""
        return None

    @property
    def coupling(self) -> Array:
        """Where in φ the coefficients of the gyroscopic coupling, J Γ(I), stand."""
        return np.concatenate([np.arange(row * self.plant.channels - 6, row * self.plant.channels) for row in (1, 2, 3)])

    def nearest(self, theta: Array, steps: Array) -> Array:
        """(K, 10) θ moved by each of ``steps`` (K, 10), as far as that leads to a body; not at all by one that is no number."""
        share, steps = np.ones(len(steps)), np.where(np.isfinite(steps).all(1, keepdims=True), steps, 0.0)
        steps[:, MU] = np.maximum(steps[:, MU], (1 / FARTHEST - 1) * theta[MU])
        for _ in range(HALVINGS):
            found: Array = theta + share[:, None] * steps
            principal = np.linalg.eigvalsh(tensor(found[:, J]))
            wrong = principal[:, 0] < LEAST * principal[:, 2]
            if not wrong.any():
                return found
            share[wrong] /= 2
        found[wrong] = theta
        return found

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(N,) φ of θ, and (N, 10) its derivative."""
        return self.plant.coefficients(theta)


@dataclass(frozen=True)
class Tangent(ResponseMap):
    """The same along the tangent at one θ: eleven coefficients, 1 and the departure from there, are enough where θ doesn't leave it."""

    about: Array
    """(10,)"""

    @property
    def size(self) -> int:
        """Eleven."""
        return 11

    @property
    def onto(self) -> Array:
        """(N, 11) φ there, and its derivative."""
        return np.column_stack(self.plant.coefficients(self.about))

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(11,) 1 and the departure of θ, and (11, 10) its derivative."""
        return np.concatenate([[1.0], theta - self.about]), np.eye(11, 10, -1)
