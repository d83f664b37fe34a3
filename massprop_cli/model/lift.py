"""The response over control cycles, linear in products of the mass properties: what the data say, free of any reference.

With J = I⁻¹ and the products ω × I ω = Γ(I) s, s = (ωx ωx, ωx ωy, ωx ωz, ωy ωy, ωy ωz, ωz ωz), the mean rate grows by

    free:        w[k+1] − w[k] = J l − J [c]× p − J Γ(I) q
    on bearing:  w[k+1] − w[k] = J l − g J [κ]× ∬u − mu J [κ]× ∬P F − J Γ(I) q + J (mu κ × ∬P (ω̇ × κ + …))

(l, p, q: torque, force and products under the triangular window of :mod:`massprop_cli.prepare.align`; on the bearing I is about its centre
b, κ = m_r (c − b) is the first moment, u the vertical, P the projector on the level plane.) So it is linear in the matrix Φ = [J | …],
3 × 12 or 3 × 15, whatever J, c and mu are. The accelerometer feels the same ω̇ = Φ z at its lever arm, and mu, and the CG:

    f = mu F + ω̇ × ρ + ω × (ω × ρ),   ρ = r − c              on a bearing: f = g u + P (mu F − mu (ω̇ × κ + …)) + ω̇ × ρ + …,   ρ = r − b

where products of ω̇ with c or mu κ are split about the present estimate, to second order.
The N *lifted* coefficients are φ = (Φ row by row, mu, then c or mu κ), and θ = (J, c or κ, mu) the ten that they are made of.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross_matrix, elements, parallel_axis, tensor
from massprop_cli.model.plant import BearingBody, Plant, Reference

J, MOMENT, MU = slice(0, 6), slice(6, 9), 9
"""Where θ's parts stand."""
HALVINGS = 12
LEAST = 1e-3
"""Smallest principal value over the largest that a body in the making may have."""
FARTHEST = 1e3
"""Factor on the mass that no single step may exceed."""
_FIRST, _SECOND = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])


def _gyroscopic() -> Array:
    """(9, 18) the linear map from I to Γ(I)."""
    found = np.zeros((3, 6, 3, 3))
    turn = cross_matrix(np.eye(3))  # turn[i] = [e_i]×
    for k, (i, j) in enumerate(zip(_FIRST, _SECOND, strict=True)):
        found[:, k, :, j] += turn[i]
        if i != j:
            found[:, k, :, i] += turn[j]
    return found.reshape(18, 9).T


_GAMMA = _gyroscopic()
_UNIT, _TURN = tensor(np.eye(6)), cross_matrix(np.eye(3))


def gamma(inertia: Array) -> Array:
    """Γ(I), (..., 3, 6): ``Γ(I) s = ω × I ω``."""
    found: Array = (inertia.reshape(*inertia.shape[:-2], 9) @ _GAMMA).reshape(*inertia.shape[:-2], 3, 6)
    return found


def products(rate: Array) -> Array:
    """(..., 6) s of rates (..., 3)."""
    own = rate.transpose(-1, *range(rate.ndim - 1))
    found = np.empty((6, *own.shape[1:]))
    np.multiply(own, own[0], out=found[:3])
    np.multiply(own[1:], own[1], out=found[3:5])
    np.multiply(own[2], own[2], out=found[5])
    return found.transpose(*range(1, rate.ndim), 0)


def products_by_rate(rate: Array) -> Array:
    """(..., 6, 3) derivative of the products of rates (..., 3)."""
    found = np.zeros((*rate.shape[:-1], 6, 3))
    for k, (i, j) in enumerate(zip(_FIRST, _SECOND, strict=True)):
        found[..., k, i] += rate[..., j]
        found[..., k, j] += rate[..., i]
    return found


@dataclass(frozen=True)
class Lift:
    """θ for a plant: to φ with its slopes, from and to a reference."""

    plant: Plant

    @property
    def channels(self) -> int:
        """Columns of Φ."""
        return 15 if isinstance(self.plant, BearingBody) else 12

    @property
    def size(self) -> int:
        """N."""
        return 3 * self.channels + 4

    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""
        plant, inertia, moment = self.plant, reference.inertia, reference.cg
        if isinstance(plant, BearingBody):
            rotating = plant.rotating_mass(reference)
            offset = reference.cg - plant.bearing
            inertia = inertia + parallel_axis(rotating, offset)
            moment = rotating * offset
        return np.concatenate([elements(np.linalg.inv(inertia)), moment, [reference.mu]])

    def sizes(self, theta: Array) -> Array:
        """(10,) the size that each of θ has by nature: the largest J, sqrt(trace I · mu), times m_r on a bearing, and mu."""
        principal = np.linalg.eigvalsh(tensor(theta[J]))
        trace, factor = (1 / principal).sum(), 1.0
        if isinstance(self.plant, BearingBody):
            factor = float(self._rotating(theta))
            trace -= 2 * theta[MOMENT] @ theta[MOMENT] / factor
        sizes = np.full(10, principal[-1])
        sizes[MOMENT] = factor * np.sqrt(trace * theta[MU])
        sizes[MU] = theta[MU]
        return sizes

    def scales(self, theta: Array) -> Array:
        """(..., 10) what a departure of each of θ (..., 10) is small or large beside: √(J_ii J_jj), and sizes as above."""
        own = np.sqrt(np.abs(theta[..., [0, 3, 5]]))
        found = np.empty_like(theta)
        found[..., J] = own[..., _FIRST] * own[..., _SECOND]
        trace = np.trace(np.linalg.inv(tensor(theta[..., J])), axis1=-2, axis2=-1)
        found[..., MOMENT] = np.sqrt(np.abs(trace * theta[..., MU]))[..., None]
        if isinstance(self.plant, BearingBody):
            found[..., MOMENT] *= self._rotating(theta)[..., None]
        found[..., MU] = theta[..., MU]
        return found

    def stepped(self, theta: Array, step: Array) -> Array:
        """θ moved by a step, which is halved until it leads to a body."""
        for _ in range(HALVINGS):
            moved = theta + step
            if self._is_body(moved) and 1 / FARTHEST < moved[MU] / theta[MU] < FARTHEST:
                found: Array = moved
                return found
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
        found = self.parameters(theta)
        return Reference(tensor(found[:6]), found[6:9], float(found[9]), np.zeros(3) if gyro_bias is None else gyro_bias)

    @property
    def coupling(self) -> Array:
        """Where in φ the coefficients of the gyroscopic coupling, J Γ(I), stand."""
        return np.concatenate([np.arange(row * self.channels - 6, row * self.channels) for row in (1, 2, 3)])

    def nearest(self, theta: Array, steps: Array) -> Array:
        """(K, 10) θ moved by each of ``steps`` (K, 10), as far as that leads to a body; not at all by one that is no number."""
        share, steps = np.ones(len(steps)), np.where(np.isfinite(steps).all(1, keepdims=True), steps, 0.0)
        for _ in range(HALVINGS):
            found: Array = theta + share[:, None] * steps
            principal = np.linalg.eigvalsh(tensor(found[:, J]))
            wrong = (principal[:, 0] < LEAST * principal[:, 2]) | (found[:, MU] < theta[MU] / FARTHEST)
            if not wrong.any():
                return found
            share[wrong] /= 2
        found[wrong] = theta
        return found

    def _rotating(self, theta: Array) -> Array:
        """(...,) m_r of θ (..., 10) on a bearing."""
        mass = 1 / theta[..., MU]
        bearing = self.plant.bearing_mass if isinstance(self.plant, BearingBody) else 0.0
        found: Array = np.maximum(mass - bearing, 0.01 * mass)
        return found

    def parameters(self, theta: Array) -> Array:
        """(..., 10) the state parameters (I about the CG, c, mu) of θ (..., 10)."""
        inertia = np.linalg.inv(tensor(theta[..., J]))
        found = theta.copy()
        if isinstance(self.plant, BearingBody):
            rotating = self._rotating(theta)[..., None]
            offset = theta[..., MOMENT] / rotating
            spread = (offset**2).sum(-1)[..., None, None] * np.eye(3) - offset[..., :, None] * offset[..., None, :]
            inertia = inertia - rotating[..., None] * spread
            found[..., MOMENT] = self.plant.bearing + offset
        found[..., J] = elements(inertia)
        return found

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) derivative of the state parameters with respect to θ (..., 10)."""
        inertia = np.linalg.inv(tensor(theta[..., J]))[..., None, :, :]
        found = np.zeros((*theta.shape, 10))
        found[...] = np.eye(10)
        found[..., :6, J] = np.swapaxes(elements(-inertia @ _UNIT @ inertia), -1, -2)
        if isinstance(self.plant, BearingBody):
            kappa, rotating = theta[..., MOMENT], self._rotating(theta)[..., None]
            # I = I_b − (κ² 1 − κ κᵀ) / m_r,  c = b + κ / m_r,  dm_r = −dmu / mu²
            unit = np.eye(3)
            outer = unit[:, :, None] * kappa[..., None, None, :]
            change = 2 * kappa[..., :, None, None] * unit - outer - np.swapaxes(outer, -1, -2)
            found[..., :6, MOMENT] = -np.swapaxes(elements(change), -1, -2) / rotating[..., None]
            by_mass = -1 / theta[..., MU, None] ** 2 / rotating**2
            spread = (kappa**2).sum(-1)[..., None, None] * unit - kappa[..., :, None] * kappa[..., None, :]
            found[..., :6, MU] = elements(spread) * by_mass
            found[..., 6:9, MOMENT] = unit / rotating[..., None]
            found[..., 6:9, MU] = -kappa * by_mass
        return found

    def response(self, theta: Array) -> Array:
        """(3, C) Φ of θ."""
        inverse, moment, mu = tensor(theta[J]), theta[MOMENT], theta[MU]
        lever, gyro = inverse @ cross_matrix(moment), inverse @ gamma(np.linalg.inv(inverse))
        if isinstance(self.plant, BearingBody):
            return np.hstack([inverse, -self.plant.gravity * lever, -mu * lever, -gyro])
        return np.hstack([inverse, -lever, -gyro])

    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(N,) φ of θ, and (N, 10) its derivative."""
        inverse, moment, mu = tensor(theta[J]), theta[MOMENT], theta[MU]
        inertia, turn = np.linalg.inv(inverse), cross_matrix(moment)
        coupling = gamma(inertia)
        lever, gyro = inverse @ turn, inverse @ coupling
        by_inverse = _UNIT @ turn, _UNIT @ coupling + inverse @ gamma(-inertia @ _UNIT @ inertia)
        by_moment = inverse @ _TURN
        # rows of Φ, then mu, and c or mu κ; by J, by c or κ, by mu
        slopes = np.zeros((10, 3 * self.channels + 4))
        rows = slopes[:, : 3 * self.channels].reshape(10, 3, self.channels)
        rows[J, :, :3], rows[J, :, -6:] = _UNIT, -by_inverse[1]
        slopes[MU, -4], scale = 1.0, 1.0
        if isinstance(self.plant, BearingBody):
            gravity, scale = self.plant.gravity, float(mu)
            phi = np.hstack([inverse, -gravity * lever, -mu * lever, -gyro])
            rows[J, :, 3:6], rows[J, :, 6:9] = -gravity * by_inverse[0], -mu * by_inverse[0]
            rows[MOMENT, :, 3:6], rows[MOMENT, :, 6:9] = -gravity * by_moment, -mu * by_moment
            rows[MU, :, 6:9], slopes[MU, -3:] = -lever, moment
        else:
            phi = np.hstack([inverse, -lever, -gyro])
            rows[J, :, 3:6], rows[MOMENT, :, 3:6] = -by_inverse[0], -by_moment
        slopes[MOMENT, -3:] = scale * np.eye(3)
        return np.concatenate([phi.ravel(), [mu], scale * moment]), slopes.T
