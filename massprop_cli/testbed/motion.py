"""Rigid-body motion of all members through one or several control cycles.

Every environment has the form ``A ω̇ = M w − ω × (A₀ ω + h) − d ω + constraint``, with the commanded wrench w(t), the stored momentum h and
the damping d known exactly. In free flight (6 degrees of freedom) ``A = A₀ = I`` about the CG, ``M w = τ − c × F``, without a constraint.
:mod:`massprop_cli.testbed.environment` has the other environments.

A cycle is divided into bins. Within a bin, ω is the exact response to the commands plus a smooth remainder, whose bin mean and slope are
computed to second order. All bins are solved together by fixed-point iteration; each iteration reduces the error by |ω| T or less.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass

TOLERANCE = 1e-11
"""Convergence limit of a member: change of its rates over (1 rad/s + their largest magnitude)."""
ITERATIONS = 300
"""Maximum number of iterations."""
WINDOW = 1.0
"""rad; bins more than this rotation after the first unconverged bin are not updated yet."""
TINY = np.finfo(float).tiny
NEXT = np.array([1, 2, 0])
"""Cyclic successor of each of three components."""
PARTNERS = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
SIGNS = np.array([[1.0, 1, 1, 1], [-1, 1, -1, 1], [-1, 1, 1, -1], [-1, -1, 1, 1]])
"""Component of the second quaternion, and sign, for each component of the first in each component of the Hamilton product."""


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors (3, …)."""
    return (a * b.take(NEXT, 0) - a.take(NEXT, 0) * b).take(NEXT, 0)


def dot(a: Array, b: Array) -> Array:
    """Scalar product of vectors (3, …)."""
    return np.asarray((a * b).sum(0))


def apply(matrix: Array, v: Array) -> Array:
    """Matrix (3, 3, …) times vector (3, …)."""
    return np.asarray((matrix * v).sum(1))


def paired(a: Array, b: Array) -> Array:
    """Stack two (3, …) into (3, 2, …)."""
    return np.concatenate((a[:, None], b[:, None]), 1)


def outer_square(s: Array) -> Array:
    """``−[s]×² = s·s 1 − s sᵀ``, (3, 3, …) from (3, …)."""
    return dot(s, s) * np.eye(3).reshape(3, 3, *(1,) * (s.ndim - 1)) - s[:, None] * s[None]


@dataclass(frozen=True)
class Bodies:
    """Mass properties of S members."""

    inertia: Array
    """(3, 3, S) inertia about the CG, kg m²."""
    cg: Array
    """(3, S) CG from O, m."""
    mass: Array
    """(S,) mass including a bearing's, kg."""


@dataclass(frozen=True)
class Wrench:
    """Applied wrench and stored momentum within a cycle of B bins, body axes."""

    mean: Array
    """(6, S, B) mean torque about O [N m] and force [N] of each bin."""
    partial_impulse: Array
    """(6, S, B) mean over each bin of the impulse since the bin's start, N m s and N s."""
    momentum: Array | float = 0.0
    """(3, S, B) mean stored momentum of each bin, N m s."""
    momentum_slope: Array | float = 0.0
    """(3, S, B) rate of change of the stored momentum, N m; ``mean`` contains its opposite."""
    damping: Array | float = 0.0
    """(3, 1, 1) damping torque about each axis over the rate, N m s."""


@dataclass(frozen=True)
class CycleMotion:
    """Motion within one or several cycles, (3, S, B) bin means, body axes."""

    rate: Array
    """Body rate, rad/s."""
    rate_dot: Array
    """Angular acceleration, rad/s²; also the slope of the rate within a bin."""
    fixed: Array
    """World-fixed vector of :meth:`Dynamics.fixed`."""
    ends: Array
    """Rate at the ends of the bins, rad/s."""

    @property
    def rate_end(self) -> Array:
        """(3, S) rate at the end of the last bin, rad/s."""
        return self.ends[..., -1]


class FixedTerms(NamedTuple):
    """Terms that are constant over the iterations, (3, S, B)."""

    mean: Array
    """Commanded part of ω̇, rad/s²."""
    partial_impulse: Array
    """Mean over each bin of the rate change since the bin's start due to this part, rad/s."""
    momentum: Array
    """(3, 2, S, B) stored momentum, N m s, and its rate of change, N m."""
    damping: Array
    """(3, 1, S or 1, 1) damping, N m s."""


class FreeTerms(NamedTuple):
    """Terms of an iteration without constraint, (3, 2, S, B): bin mean and slope."""

    rate: Array
    """Rate, rad/s, and its slope, rad/s²."""
    rest: Array
    """Part of ω̇ that is not commanded, rad/s², and its slope, rad/s³."""


class Constrained(NamedTuple):
    """Terms of an iteration with the constraint, (3, S, B)."""

    fixed: Array
    """World-fixed vector, body axes."""
    rest: Array
    """Part of ω̇ beyond the unconstrained response to commands, rad/s²."""
    rest_slope: Array
    """Slope of ``rest``, rad/s³."""


@dataclass(frozen=True)
class Dynamics:
    """Equation of motion in free flight, for mass properties constant within a cycle; subclasses add constraints."""

    bodies: Bodies

    @cached_property
    def inertia(self) -> Array:
        """(3, 3, S) A₀, kg m²."""
        return self.bodies.inertia

    @cached_property
    def inverse(self) -> Array:
        """(3, 3, S) inverse of A₀ in the directions in which the body can turn."""
        return np.moveaxis(np.linalg.inv(np.moveaxis(self.inertia, -1, 0)), 0, -1)

    @cached_property
    def centre(self) -> Array:
        """(3, S) reference point of :meth:`centre_force`, from O, m."""
        return self.bodies.cg

    def fixed(self, attitude: Array) -> Array:
        """(3, S) world-fixed vector that acts on body or IMU, body axes, at an ``attitude`` (4, S); zero in free flight."""
        return np.zeros_like(attitude[1:])

    def moment(self, wrench: Array) -> Array:
        """(3, S, B) M w, N m."""
        torque, force = wrench[:3], wrench[3:]
        return torque - cross(self.bodies.cg[..., None], force)

    def constrain(self, free: FreeTerms, driven: FixedTerms, state: MotionIterate, fixed: Array, wrench: Wrench, h: float) -> Constrained:  # noqa: ARG002
        """Terms of an iteration with the constraint; none in free flight.

        ``fixed``: (3, S) of :meth:`fixed` at the start of the cycle. ``state``: previous iterate. ``h``: bin length, s.
        """
        return Constrained(state.fixed, free.rest[:, 0], free.rest[:, 1])

    def advance(self, rate: Array, fixed: Array, wrench: Wrench, width_s: float) -> CycleMotion:
        """Motion through all bins of ``wrench``, from rate ``rate`` (3, S) and world-fixed vector ``fixed`` (3, S)."""
        h = width_s
        inverse = self.inverse[..., None]
        driven, partial_impulse = apply(inverse, self.moment(wrench.mean)), apply(inverse, self.moment(wrench.partial_impulse))
        rest = np.zeros_like(driven)
        state = MotionIterate(rest, driven, rest + fixed[..., None], rate[..., None] + h * np.cumsum(driven, -1), rest, rest)
        momentum = paired(rest + wrench.momentum, rest + wrench.momentum_slope)
        constant = FixedTerms(driven, partial_impulse, momentum, (np.zeros((3, 1, 1)) + wrench.damping)[:, None])
        open_members, bins = np.ones(rate.shape[1], dtype=bool), np.arange(driven.shape[-1])
        for _ in range(ITERATIONS):
            iterate = self._iterate(state, rate, fixed, constant, wrench, h)
            fastest = np.abs(iterate.ends).max((0, 2))[:, None]
            moved = np.abs(iterate.ends - state.ends).max(0) > TOLERANCE * (1 + fastest)
            near = ((bins - moved.argmax(1)[:, None]) * (h * fastest) < WINDOW) | ~moved.any(1)[:, None]
            # each member stops by its own convergence, so that its result does not depend on the other members
            chosen = open_members[:, None] & near
            state = iterate if chosen.all() else state.where(chosen, iterate)
            open_members = open_members & moved.any(1)
            if not open_members.any():
                break
        return state

    def _iterate(self, state: MotionIterate, rate: Array, fixed: Array, driven: FixedTerms, wrench: Wrench, h: float) -> MotionIterate:
        """Next iterate from ``state``."""
        start = np.concatenate([rate[..., None], state.ends[..., :-1]], -1)
        mean = start + driven.partial_impulse + h / 2 * state.rest - h * h / 12 * state.rest_slope
        turning = paired(mean, state.rate_dot)
        momentum = apply(self.inertia[:, :, None, :, None], turning) + driven.momentum
        # bin mean of a product of linear functions: product of the means + product of the slopes × h²/12
        gyric = cross(turning[:, :, None], momentum[:, None])
        torque = paired(gyric[:, 0, 0] + h * h / 12 * gyric[:, 1, 1], gyric[:, 1, 0] + gyric[:, 0, 1])
        rest = -apply(self.inverse[:, :, None, :, None], torque + driven.damping * turning)
        constrained = self.constrain(FreeTerms(turning, rest), driven, state, fixed, wrench, h)
        dot = driven.mean + constrained.rest
        return MotionIterate(
            mean, dot, constrained.fixed, rate[..., None] + h * np.cumsum(dot, -1), constrained.rest, constrained.rest_slope
        )

    def specific_force(self, motion: CycleMotion, force: Array, position: Array, width_s: float) -> Array:
        """(3, S, B) mean specific force at ``position`` (3,) [m from O], body axes, m/s²; ``force`` (3, S, B) N."""
        return self.centre_force(motion, force, width_s) + lever(motion, position[:, None, None] - self.centre[..., None], width_s)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:  # noqa: ARG002
        """(3, S, B) specific force of the reference point, m/s²; in free flight F/m of the CG."""
        return force / self.bodies.mass[:, None]


def lever(motion: CycleMotion, arm: Array, width_s: float) -> Array:
    """(3, S, B) bin mean of the lever-arm acceleration ``ω̇ × ρ + ω × (ω × ρ)``, m/s²."""
    twice = cross(motion.rate, cross(motion.rate, arm)) + width_s**2 / 12 * cross(motion.rate_dot, cross(motion.rate_dot, arm))
    return cross(motion.rate_dot, arm) + twice


@dataclass(frozen=True)
class MotionIterate(CycleMotion):
    """One iterate of the motion."""

    rest: Array
    """Part of ω̇ that is not commanded, rad/s²."""
    rest_slope: Array
    """Slope of ``rest``, rad/s³."""

    def where(self, chosen: Array, other: MotionIterate) -> MotionIterate:
        """Values of ``other`` where ``chosen`` (S, B), else of this iterate."""
        return MotionIterate(**{name: np.where(chosen, each, getattr(self, name)) for name, each in vars(other).items()})


def rotation_vectors(motion: CycleMotion, width_s: float) -> Array:
    """(3, S, B) rotation over each bin, rad: ``∫ω dt + ω_start × ω_end h²/12``, exact to third order for a linear ω."""
    half = width_s / 2 * motion.rate_dot
    return width_s * motion.rate + width_s**2 / 12 * cross(motion.rate - half, motion.rate + half)


def quaternions(rotation: Array) -> Array:
    """(4, …) unit quaternions of rotation vectors (3, …), rad."""
    half = np.sqrt(dot(rotation, rotation)) / 2
    share = np.sin(half) / np.maximum(half, TINY) / 2
    return np.concatenate([np.cos(half)[None], np.where(half > 0, share, 0.5) * rotation])


def compose(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (4, …): rotation ``a``, then ``b`` in the rotated axes."""
    return np.asarray((a[:, None] * (b.take(PARTNERS, 0) * SIGNS.reshape(4, 4, *(1,) * (b.ndim - 1)))).sum(0))


def compose_all(turns: Array) -> Array:
    """(4, …) product of quaternions (4, …, B) in order, computed pairwise."""
    while turns.shape[-1] > 1:
        odd = turns[..., -1:] if turns.shape[-1] % 2 else turns[..., :0]
        turns = np.concatenate([compose(turns[..., 0:-1:2], turns[..., 1::2]), odd], -1)
    return turns[..., 0]


def vertical(attitude: Array) -> Array:
    """(3, …) world Z in body axes, from quaternions (4, …)."""
    w, x, y, z = attitude
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def to_world(attitude: Array, v: Array) -> Array:
    """Rotate vectors (3, …) from body to world axes."""
    twice = 2 * cross(attitude[1:], v)
    return np.asarray(v + attitude[0] * twice + cross(attitude[1:], twice))
