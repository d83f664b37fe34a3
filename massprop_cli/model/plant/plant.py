"""Interface of an environment: equations of motion that are linear in coefficients φ of the mass properties.

The state's parameters are ixx … izz about the CG (on a pedestal about the pivot), cg_x … cg_z, mu = 1/m. The estimator works on ten others,
θ = (J, moment, mu). J is the inverse of the inertia about the point that the body rotates about, and ``moment`` gives the CG's position.
With the rate products s of :mod:`massprop_cli.model.gyroscopic`,

    angular acceleration = Φ z,      z = (inputs from commands and attitude, s)

Φ is (3, C); its last six columns are −J Γ(I). φ = (rows of Φ, mu, three coefficients of the specific force), N = 3 C + 4.
Arrays of motion are (K, B, ...): K cycles with B equal bins each. A new environment is one more file here and one line in ``plant_of``.
"""

from abc import ABC, abstractmethod
from dataclasses import field
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross_matrix, elements, tensor

J, MOMENT, MU = slice(0, 6), slice(6, 9), 9
"""Slices of θ."""
UNIT_TENSORS = tensor(np.eye(6))
"""(6, 3, 3) derivatives of a symmetric tensor with respect to its elements."""


@dataclass(frozen=True)
class Reference:
    """Mass properties, and nuisance values, about which the equations are linearised."""

    inertia: Array
    """(3, 3) about the CG, on a pedestal about the pivot, kg m²; body axes."""
    cg: Array
    """(3,) position from O, m."""
    mu: float
    """1/mass, 1/kg."""
    gyro_bias: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) rad/s, body axes; subtracted from the measured rate."""
    scale: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) estimated errors of the scales of :func:`massprop_cli.model.momentum.scale_sigmas`; empty: none."""
    damping: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) estimated damping of the rotation about each axis, torque over rate, N m s."""
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) estimated angular acceleration by a slowly varying torque, rad/s²."""
    response: Array | None = None
    """(3, C) Φ, where the log gives it more precisely than the inertia does; None: Φ of this inertia."""


@dataclass(frozen=True)
class Motion:
    """Motion and executed commands within the cycles, by bin."""

    wrench: Array
    """(K, B, 6) executed torque about O [N m] and force [N]."""
    rate: Array
    """(K, B, 3) body rate, rad/s."""
    rate_dot: Array
    """(K, B, 3) angular acceleration, rad/s²."""
    up: Array
    """(K, B, 3) world vertical in body axes; zeros in free flight."""
    rate_dot_moment: Array
    """(K, B, 3) first moment of the angular acceleration by torques about the bin's middle, over the bin's length, rad/s."""

    @property
    def rotation(self) -> Array:
        """(K, B, 3, 3) matrix of ``ω̇ × ρ + ω × (ω × ρ)`` acting on ρ."""
        rate = cross_matrix(self.rate)
        return cross_matrix(self.rate_dot) + rate @ rate


class MeanMotion(NamedTuple):
    """Means over each of K cycles."""

    whole: Array
    """(K, C) mean of z."""
    rate_dot: Array
    """(K, 3) mean angular acceleration, rad/s²."""
    centripetal: Array
    """(K, 3, 3) mean of [ω]×², rad²/s²."""
    rotation: Array
    """(K, 3, 3) mean of ``[ω̇]× + [ω]×²``, rad/s²."""


class SpecificForce(NamedTuple):
    """Mean specific force at the IMU, ``by_rate_dot @ ω̇ + by_phi @ φ[-4:] + offset``, to second order about a reference."""

    by_rate_dot: Array
    """(K, 3, 3) m"""
    by_phi: Array
    """(K, 3, 4)"""
    offset: Array
    """(K, 3) m/s²"""


class Plant(ABC):
    """One environment. The methods here hold in free flight; another environment overrides what differs."""

    channels: int
    """C, columns of Φ."""
    force: slice
    """Slice of z with the force that accelerates the CG (on an air bearing the bearing point) by mu."""
    pivoted: bool
    """Whether the body rotates about a support under its weight, so that the torque depends on its attitude; such a body is balanced."""
    translates: bool
    """Whether forces accelerate the body, so that the accelerometer informs mass and CG."""

    @property
    def observable(self) -> BoolArray:
        """(10,) whether any motion in this environment depends on each of θ; the others keep their initial value."""
        return np.ones(10, dtype=bool)

    @property
    def pivot(self) -> Array:
        """(3,) the point of the body about which torques are taken, from O, m."""
        return np.zeros(3)

    # --- inputs

    @abstractmethod
    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) matrix that maps a wrench about O to the moment about the point that the body rotates about."""

    def rotating_mass(self, reference: Reference) -> float:
        """Mass of the body that rotates, kg; without the bearing's translating mass."""
        return 1 / reference.mu

    @property
    def tilt_sigma(self) -> float:
        """Prior sigma of each tilt state in a phase's first cycle, in its unit."""
        return 0.0

    @property
    def tilt_count(self) -> int:
        """t, the number of tilt states: errors of the direction in which the weight acts."""
        return 0

    def tilt_step(self, rate: Array, duration: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """(K − 1, t, t) transition of the tilt states, and (K − 1, t, 3) derivative of the next tilt states with respect to the rate."""
        return np.zeros((len(rate) - 1, 0, 0)), np.zeros((len(rate) - 1, 0, 3))

    def tilt_in_cycle(self, rate: Array, duration: Array) -> tuple[Array, Array, Array]:  # noqa: ARG002
        """(K, t, t) from the tilt states to their means over a cycle: by rising half and falling half of the window, and unweighted."""
        none = np.zeros((len(rate), 0, 0))
        return none, none, none

    def force_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, t) derivative of the specific force with respect to the tilt states; ``up``, ``force`` (K, 3): means or integrals."""
        return np.zeros((*up.shape, 0))

    def moment_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, t) derivative of the moment with respect to the tilt states; ``up``, ``force`` (K, 3): means or integrals."""
        return np.zeros((*up.shape, self.tilt_count))

    # --- θ

    @abstractmethod
    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""

    def parameters(self, theta: Array) -> Array:
        """(..., 10) state parameters of θ (..., 10)."""
        values = theta.copy()
        values[..., J] = elements(np.linalg.inv(tensor(theta[..., J])))
        return values

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) derivative of the state parameters with respect to θ (..., 10)."""
        inertia = np.linalg.inv(tensor(theta[..., J]))[..., None, :, :]
        derivative = np.zeros((*theta.shape, 10))
        derivative[...] = np.eye(10)
        derivative[..., :6, J] = np.swapaxes(elements(-inertia @ UNIT_TENSORS @ inertia), -1, -2)
        return derivative

    def parallel_axis_trace(self, theta: Array) -> float:  # noqa: ARG002
        """Trace of J⁻¹ minus trace of the inertia about the CG (on a pedestal about the pivot), kg m²."""
        return 0.0

    def moment_per_metre(self, theta: Array) -> Array:
        """(...,) derivative of ``moment`` with respect to the CG's position, of θ (..., 10)."""
        return np.ones(theta.shape[:-1])

    # --- the response, linear in φ

    def response(self, theta: Array) -> Array:
        """(3, C) Φ of θ."""
        return self.coefficients(theta)[0][: 3 * self.channels].reshape(3, -1)

    @abstractmethod
    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(N,) φ of θ, and (N, 10) its derivative with respect to θ."""

    def command_input(self, wrench: Array) -> Array:
        """(..., c) the first c elements of z, which depend on the wrench (..., 6) alone and not on the attitude."""
        return wrench

    def inputs(self, wrench: Array, up: Array, level_of: Array) -> Array:  # noqa: ARG002
        """(K, B, C − 6) z without s, of wrench (K, B, 6) and vertical ``up`` (K, B, 3); ``level_of`` is normal to the level plane."""
        return wrench

    def attitude_inputs(self, motion: Motion, ups: tuple[Array, Array], skew: Array, late_s: Array) -> list[tuple[Array, Array]]:  # noqa: ARG002
        """Elements of z between the command input and s: each (K, B, ...) by bin, and (K, ...) sum of its bins' first moments.

        ``ups`` are the verticals (K, 3) at the cycle's start and end, ``skew`` (K, B, 6) the wrench's first moments. A quantity that grows
        evenly within a cycle has a first moment of its growth times ``late_s`` (K, 1).
        """
        return []

    def inverse_inertia(self, theta: Array) -> Array:
        """(3, 3) matrix that maps a moment to the angular acceleration, 1/(kg m²)."""
        return tensor(theta[J])

    def nonlinear_acceleration(self, theta: Array, motion: Motion) -> Array:  # noqa: ARG002
        """(K, B, 3) part of the angular acceleration that is not linear in φ, rad/s²."""
        return np.zeros_like(motion.rate)

    @abstractmethod
    def specific_force(self, reference: Reference, motion: Motion, mean: MeanMotion, position: Array) -> SpecificForce:
        """Mean specific force at ``position`` (3,) from O, m."""

    def wrench_response(self, reference: Reference, wrench: Array, up: Array, position: Array) -> tuple[Array, Array]:
        """(K, 3, g) moment and (K, 3, g) specific force at ``position`` by each of the wrenches (g, 6), at verticals ``up`` (K, 3)."""
        centre, shape = self.pivot if self.pivoted else reference.cg, (len(up), 3, len(wrench))
        moment = self.jet_moment(reference) @ wrench.T
        turned = cross_matrix(position - centre) @ self.inverse_inertia(self.theta(reference)) @ moment
        pull = reference.mu * wrench[:, 3:].T if self.translates else 0.0
        return np.broadcast_to(moment, shape), np.broadcast_to(pull - turned, shape)

    @abstractmethod
    def regressor(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:
        """(K, 6, 10) derivative of torque and specific force with respect to the state parameters, in K independent motions."""
