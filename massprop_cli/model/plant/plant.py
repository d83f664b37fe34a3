"""What every environment says of a body in it; a further one is a further file beside this, and a line in ``plant_of``.

The state's parameters are ixx … izz about the CG (on a pedestal about the pivot), cg_x … cg_z, mu = 1/m. The engine works on
θ = (J, moment, mu) instead, ten as well, with J the inverse of the inertia about the point that the body turns about and ``moment`` what
says where its CG is: the response is linear in φ, products of θ. With s the products of rates of :mod:`massprop_cli.model.gyroscopic`,

    angular acceleration = Φ z,      z = (what the environment makes of the commands and of the attitude, s)

Φ is 3 × C, and its last six columns are −J Γ(I). φ = (Φ row by row, mu, then three more that the accelerometer feels); N = 3 C + 4.
Arrays of motion are per bin, (K, B, ...): B equal parts of each of K cycles.
"""

from abc import ABC, abstractmethod
from dataclasses import field
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import cross_matrix, elements, tensor

J, MOMENT, MU = slice(0, 6), slice(6, 9), 9
"""Where θ's parts stand."""
UNIT = tensor(np.eye(6))
"""Derivatives of a tensor by its elements."""


@dataclass(frozen=True)
class Reference:
    """The mass properties about which the equations are linearised."""

    inertia: Array
    """(3, 3) about the CG, on a pedestal about the pivot, kg m²."""
    cg: Array
    """(3,) from O, m."""
    mu: float
    """1/m, 1/kg."""
    gyro_bias: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) rad/s, body axes; taken off the measured rate."""
    scale: Array = field(default_factory=lambda: np.zeros(0))
    """Relative errors of scales (:mod:`massprop_cli.model.momentum`), as far as they have been found; empty: none."""
    damping: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) torque against the rate about each axis over it, as far as it has been found, N m s."""
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) angular acceleration by a slowly varying torque, as far as it has been found, rad/s²."""
    response: Array | None = None
    """(3, C) the matrix Φ where the log tells it better than the inertia; None: what these make it."""


@dataclass(frozen=True)
class Motion:
    """Motion and commands within the cycles, one row per bin."""

    wrench: Array
    """(K, B, 6) executed torque about O [N m] and force [N]."""
    rate: Array
    """(K, B, 3) body rate, rad/s."""
    rate_dot: Array
    """(K, B, 3) angular acceleration, rad/s²."""
    up: Array
    """(K, B, 3) world vertical in body axes; zeros in free flight."""
    late: Array
    """(K, B, 3) first moment of the angular acceleration about the bin's middle over its length, rad/s, as far as torque makes it."""

    @property
    def rotation(self) -> Array:
        """(K, B, 3, 3) matrix of ``ω̇ × ρ + ω × (ω × ρ)`` acting on ρ."""
        rate = cross_matrix(self.rate)
        return cross_matrix(self.rate_dot) + rate @ rate


class Turning(NamedTuple):
    """A cycle's mean motion, (K, ...)."""

    whole: Array
    """(K, C) mean of z."""
    rate_dot: Array
    """(K, 3) mean angular acceleration."""
    centripetal: Array
    """(K, 3, 3) mean of [ω]×²."""
    rotation: Array
    """(K, 3, 3) mean of ``[ω̇]× + [ω]×²``."""


class Felt(NamedTuple):
    """The mean specific force at the IMU: ``euler @ ω̇ + own @ φ[-4:] + offset``, to second order about a reference."""

    euler: Array
    """(K, 3, 3)"""
    own: Array
    """(K, 3, 4)"""
    offset: Array
    """(K, 3)"""


class Plant(ABC):
    """One environment; what is written here holds in free flight, and where another one says nothing else."""

    channels: int
    """C, columns of Φ."""
    force: slice
    """Where in z the force stands that gives the centre its specific force, times mu."""
    pivoted: bool
    """Whether the body turns about a support under its weight, so that what acts depends on its attitude, and it is balanced."""
    translates: bool
    """Whether forces move its centre, so that the accelerometer shows mass and CG."""

    @property
    def told(self) -> BoolArray:
        """(10,) which of θ any motion in this environment depends on; the others stay where they are put."""
        return np.ones(10, dtype=bool)

    @property
    def pivot(self) -> Array:
        """(3,) the point of the body, from O, about which its torque stands."""
        return np.zeros(3)

    # --- what acts

    @abstractmethod
    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) wrench to the moment that turns the body, the commands' direct part."""

    def rotating_mass(self, reference: Reference) -> float:
        """The mass that turns, kg."""
        return 1 / reference.mu

    @property
    def tilt_sigma(self) -> float:
        """One sigma of each of the states below in a phase's first cycle, in their unit."""
        return 0.0

    @property
    def tilts(self) -> int:
        """t, the states that say where the weight pulls otherwise than it is taken to."""
        return 0

    def tilt_step(self, rate: Array, duration: Array) -> tuple[Array, Array]:  # noqa: ARG002
        """(K − 1, t, t) these from each of K cycles, (K,) s long at mean rates (K, 3), to the next; by an error of the rates."""
        return np.zeros((len(rate) - 1, 0, 0)), np.zeros((len(rate) - 1, 0, 3))

    def tilt_within(self, rate: Array, duration: Array) -> tuple[Array, Array, Array]:  # noqa: ARG002
        """(K, t, t) each by which they act while a cycle goes on: under the rising and falling halves of the window, and in the mean."""
        none = np.zeros((len(rate), 0, 0))
        return none, none, none

    def force_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, t) derivative of the centre's specific force by them, from means or integrals of vertical and force (K, 3)."""
        return np.zeros((*up.shape, 0))

    def moment_by_tilt(self, reference: Reference, up: Array, force: Array) -> Array:  # noqa: ARG002
        """(K, 3, t) that of the moment, in the same way."""
        return np.zeros((*up.shape, self.tilts))

    # --- θ

    @abstractmethod
    def theta(self, reference: Reference) -> Array:
        """(10,) θ of a reference."""

    def parameters(self, theta: Array) -> Array:
        """(..., 10) the state's parameters of θ (..., 10)."""
        found = theta.copy()
        found[..., J] = elements(np.linalg.inv(tensor(theta[..., J])))
        return found

    def slopes(self, theta: Array) -> Array:
        """(..., 10, 10) their derivative with respect to θ (..., 10)."""
        inertia = np.linalg.inv(tensor(theta[..., J]))[..., None, :, :]
        found = np.zeros((*theta.shape, 10))
        found[...] = np.eye(10)
        found[..., :6, J] = np.swapaxes(elements(-inertia @ UNIT @ inertia), -1, -2)
        return found

    def trace_beyond(self, theta: Array) -> float:  # noqa: ARG002
        """By how much the trace of J⁻¹ exceeds that of the inertia about the CG, kg m²."""
        return 0.0

    def moment_over_cg(self, theta: Array) -> Array:
        """(...,) of θ (..., 10): what a metre of the CG's offset is in ``moment``."""
        return np.ones(theta.shape[:-1])

    # --- the response, linear in φ

    def response(self, theta: Array) -> Array:
        """(3, C) Φ of θ."""
        return self.coefficients(theta)[0][: 3 * self.channels].reshape(3, -1)

    @abstractmethod
    def coefficients(self, theta: Array) -> tuple[Array, Array]:
        """(N,) φ of θ, and (N, 10) its derivative."""

    def commanded(self, wrench: Array) -> Array:
        """(..., c) the first of z, which a wrench (..., 6) makes whatever the attitude."""
        return wrench

    def acting(self, wrench: Array, up: Array, level_of: Array) -> Array:  # noqa: ARG002
        """(K, B, C − 6) all of z but s, of a wrench (K, B, 6) and a vertical (K, B, 3); what is level ``level_of`` says."""
        return wrench

    def by_attitude(self, motion: Motion, ups: tuple[Array, Array], skew: Array, late_s: Array) -> list[tuple[Array, Array]]:  # noqa: ARG002
        """The parts of z between these, (K, B, ...), each with the sum of its bins' first moments (K, ...).

        ``ups`` are the verticals (K, 3) where a cycle begins and ends, ``skew`` (K, B, 6) the wrench's first moments;
        what grows through a cycle has a first moment of ``late_s`` (K, 1) by its growth.
        """
        return []

    def turning(self, theta: Array) -> Array:
        """(3, 3) a moment to the angular acceleration that it makes."""
        return tensor(theta[J])

    def swing(self, theta: Array, motion: Motion) -> Array:  # noqa: ARG002
        """(K, B, 3) the angular acceleration that is not linear in φ."""
        return np.zeros_like(motion.rate)

    @abstractmethod
    def felt(self, reference: Reference, motion: Motion, turning: Turning, position: Array) -> Felt:
        """The specific force at ``position`` (3,) [m, from O]."""

    def pushed(self, reference: Reference, wrench: Array, up: Array, position: Array) -> tuple[Array, Array]:
        """(K, 3, g) moment, and (K, 3, g) specific force at ``position``, by g wrenches (g, 6) at K verticals (K, 3)."""
        centre, shape = self.pivot if self.pivoted else reference.cg, (len(up), 3, len(wrench))
        moment = self.jet_moment(reference) @ wrench.T
        turned = cross_matrix(position - centre) @ self.turning(self.theta(reference)) @ moment
        pull = reference.mu * wrench[:, 3:].T if self.translates else 0.0
        return np.broadcast_to(moment, shape), np.broadcast_to(pull - turned, shape)

    @abstractmethod
    def shown(self, reference: Reference, rate: Array, rate_dot: Array, force: Array, up: Array) -> Array:
        """(K, 6, 10) what torque and specific force tell of the parameters in K unlike motions, the vertical along ``up`` (K, 3)."""
