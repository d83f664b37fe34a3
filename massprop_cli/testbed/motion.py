"""Rigid-body motion of all members through one or several control cycles.

Every environment has the form ``A ω̇ = M w − ω × (A₀ ω + h) − d ω + what holds it``, with the commands' wrench w(t), the wheels' momentum h
and the damping d known exactly. In free flight (6 degrees of freedom) ``A = A₀ = I`` about the CG, ``M w = τ − c × F``, and nothing holds
the body; what another environment changes in that stands in its file of :mod:`massprop_cli.testbed.environment`.

A cycle is cut into bins. Within a bin ω is the exact answer to the commands plus a smooth rest, whose bin mean and slope are taken to
second order; the bins of all cycles are solved together by fixed-point iteration, which converges by a factor |ω| T or better each time.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass

TOLERANCE = 1e-11
"""Iteration ends for a member when its rates change by less than this times (1 rad/s + their size)."""
ITERATIONS = 300
WINDOW = 1.0
"""rad: bins that lie further behind the first that has not converged wait."""
TINY = np.finfo(float).tiny
NEXT = np.array([1, 2, 0])
"""The component after each, of three."""
PARTNERS = np.array([[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]])
SIGNS = np.array([[1.0, 1, 1, 1], [-1, 1, -1, 1], [-1, 1, 1, -1], [-1, -1, 1, 1]])
"""Components of the second quaternion, and signs, by which each component of the first enters each component of their Hamilton product."""


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors whose components come first."""
    return (a * b.take(NEXT, 0) - a.take(NEXT, 0) * b).take(NEXT, 0)


def dot(a: Array, b: Array) -> Array:
    """Scalar product of vectors whose components come first."""
    return np.asarray((a * b).sum(0))


def apply(matrix: Array, v: Array) -> Array:
    """(3, 3, …) times (3, …)."""
    return np.asarray((matrix * v).sum(1))


def paired(a: Array, b: Array) -> Array:
    """(3, 2, …) of two (3, …)."""
    return np.concatenate((a[:, None], b[:, None]), 1)


def outer_square(s: Array) -> Array:
    """``−[s]×² = s·s 1 − s sᵀ``, (3, 3, …) from (3, …)."""
    return dot(s, s) * np.eye(3).reshape(3, 3, *(1,) * (s.ndim - 1)) - s[:, None] * s[None]


@dataclass(frozen=True)
class Bodies:
    """Mass properties of the members."""

    inertia: Array
    """(3, 3, S) about the CG, kg m²."""
    cg: Array
    """(3, S) from O, m."""
    mass: Array
    """(S,) kg, with the bearing's."""


@dataclass(frozen=True)
class Wrench:
    """What the commands (and disturbances) apply within a cycle, body axes."""

    mean: Array
    """(6, S, B) torque about O [N m] and force [N], mean of each bin."""
    gathered: Array
    """(6, S, B) mean over each bin of the impulse since the bin's start, N m s and N s."""
    momentum: Array | float = 0.0
    """(3, S, B) that wheels hold, mean of each bin, N m s."""
    momentum_slope: Array | float = 0.0
    """(3, S, B) its growth, N m; the opposite of it is in ``mean``."""
    damping: Array | float = 0.0
    """(3, 1, 1) torque against the rate about each axis, over it, N m s."""


@dataclass(frozen=True)
class CycleMotion:
    """Motion within one cycle, or several; (3, S, B) bin means unless said otherwise."""

    rate: Array
    """rad/s."""
    rate_dot: Array
    """rad/s²; also the slope of the rate within a bin."""
    fixed: Array
    """What stands still in the world (:meth:`Dynamics.fixed`), body axes."""
    ends: Array
    """Rate at the bins' ends, rad/s."""

    @property
    def rate_end(self) -> Array:
        """(3, S) rate at the last bin's end, rad/s."""
        return self.ends[..., -1]


class FixedTerms(NamedTuple):
    """(3, S, B) what an iteration does not change."""

    mean: Array
    """The commands' part of ω̇, rad/s²."""
    gathered: Array
    """What that part has added to the rate since the bin's start, mean over the bin, rad/s."""
    momentum: Array
    """(3, 2, S, B) of wheels, and its growth, N m s and N m."""
    damping: Array
    """(3, 1, S or 1, 1) N m s."""


class Loose(NamedTuple):
    """(3, 2, S, B) of an iteration, each with its slope, as if nothing held the body."""

    rate: Array
    """Bin means and slopes of the rate, rad/s and rad/s²."""
    rest: Array
    """The part of ω̇ that is not the commands', rad/s², and its slope, rad/s³."""


class HeldTerms(NamedTuple):
    """(3, S, B) what stands still in the world, body axes; ω̇ but for the commands' part as if loose, and its slope."""

    fixed: Array
    rest: Array
    rest_slope: Array


@dataclass(frozen=True)
class Dynamics:
    """The coefficients above for members whose mass properties stand still within a cycle: in free flight, and as others change them."""

    bodies: Bodies

    @cached_property
    def inertia(self) -> Array:
        """(3, 3, S) A₀, kg m²."""
        return self.bodies.inertia

    @cached_property
    def inverse(self) -> Array:
        """(3, 3, S) of A₀, in the directions in which the body can turn."""
        return np.moveaxis(np.linalg.inv(np.moveaxis(self.inertia, -1, 0)), 0, -1)

    @cached_property
    def centre(self) -> Array:
        """(3, S) the point of which :meth:`centre_force` is, from O, m."""
        return self.bodies.cg

    def fixed(self, attitude: Array) -> Array:
        """(3, S) what stands still in the world and acts on the body or its IMU, body axes, at an ``attitude`` (4, S): nothing."""
        return np.zeros_like(attitude[1:])

    def moment(self, wrench: Array) -> Array:
        """(3, S, B) M w, N m."""
        torque, force = wrench[:3], wrench[3:]
        return torque - cross(self.bodies.cg[..., None], force)

    def held(self, loose: Loose, driven: FixedTerms, state: MotionIterate, fixed: Array, wrench: Wrench, h: float) -> HeldTerms:  # noqa: ARG002
        """What holds the body, with :meth:`fixed` (3, S) at the cycle's start, the last iterate and bins of ``h`` s: nothing."""
        return HeldTerms(state.fixed, loose.rest[:, 0], loose.rest[:, 1])

    def advance(self, rate: Array, fixed: Array, wrench: Wrench, width_s: float) -> CycleMotion:
        """Through all bins of ``wrench`` from ``rate`` (3, S), with :meth:`fixed` (3, S) there."""
        h = width_s
        inverse = self.inverse[..., None]
        driven, gathered = apply(inverse, self.moment(wrench.mean)), apply(inverse, self.moment(wrench.gathered))
        rest = np.zeros_like(driven)
        state = MotionIterate(rest, driven, rest + fixed[..., None], rate[..., None] + h * np.cumsum(driven, -1), rest, rest)
        momentum = paired(rest + wrench.momentum, rest + wrench.momentum_slope)
        constant = FixedTerms(driven, gathered, momentum, (np.zeros((3, 1, 1)) + wrench.damping)[:, None])
        open_members, bins = np.ones(rate.shape[1], dtype=bool), np.arange(driven.shape[-1])
        for _ in range(ITERATIONS):
            found = self._iterate(state, rate, fixed, constant, wrench, h)
            fastest = np.abs(found.ends).max((0, 2))[:, None]
            moved = np.abs(found.ends - state.ends).max(0) > TOLERANCE * (1 + fastest)
            near = ((bins - moved.argmax(1)[:, None]) * (h * fastest) < WINDOW) | ~moved.any(1)[:, None]
            # a member's own convergence alone decides when it stops, so that its bytes don't depend on who flies beside it
            chosen = open_members[:, None] & near
            state = found if chosen.all() else state.where(chosen, found)
            open_members = open_members & moved.any(1)
            if not open_members.any():
                break
        return state

    def _iterate(self, state: MotionIterate, rate: Array, fixed: Array, driven: FixedTerms, wrench: Wrench, h: float) -> MotionIterate:
        start = np.concatenate([rate[..., None], state.ends[..., :-1]], -1)
        mean = start + driven.gathered + h / 2 * state.rest - h * h / 12 * state.rest_slope
        turning = paired(mean, state.rate_dot)
        momentum = apply(self.inertia[:, :, None, :, None], turning) + driven.momentum
        # bin means of products of what changes linearly: product of the means + product of the slopes h²/12
        gyric = cross(turning[:, :, None], momentum[:, None])
        torque = paired(gyric[:, 0, 0] + h * h / 12 * gyric[:, 1, 1], gyric[:, 1, 0] + gyric[:, 0, 1])
        rest = -apply(self.inverse[:, :, None, :, None], torque + driven.damping * turning)
        held = self.held(Loose(turning, rest), driven, state, fixed, wrench, h)
        dot = driven.mean + held.rest
        return MotionIterate(mean, dot, held.fixed, rate[..., None] + h * np.cumsum(dot, -1), held.rest, held.rest_slope)

    def specific_force(self, motion: CycleMotion, force: Array, position: Array, width_s: float) -> Array:
        """(3, S, B) mean specific force at ``position`` (3,) [m from O], body axes, m/s²; ``force`` (3, S, B) N."""
        return self.centre_force(motion, force, width_s) + lever(motion, position[:, None, None] - self.centre[..., None], width_s)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:  # noqa: ARG002
        """(3, S, B) specific force of the centre, m/s²: of the CG, F/m."""
        return force / self.bodies.mass[:, None]


def lever(motion: CycleMotion, arm: Array, width_s: float) -> Array:
    """(3, S, B) bin mean of ``ω̇ × ρ + ω × (ω × ρ)``, m/s²."""
    twice = cross(motion.rate, cross(motion.rate, arm)) + width_s**2 / 12 * cross(motion.rate_dot, cross(motion.rate_dot, arm))
    return cross(motion.rate_dot, arm) + twice


@dataclass(frozen=True)
class MotionIterate(CycleMotion):
    """One iterate of it, with the part of ω̇ that is not the commands', and the slope of that part."""

    rest: Array
    rest_slope: Array

    def where(self, chosen: Array, other: MotionIterate) -> MotionIterate:
        """The other one's where ``chosen`` (S, B)."""
        return MotionIterate(**{name: np.where(chosen, each, getattr(self, name)) for name, each in vars(other).items()})


def rotation_vectors(motion: CycleMotion, width_s: float) -> Array:
    """(3, S, B) rotation over each bin, rad: ``∫ω dt + ω_start × ω_end h²/12``, exact to third order for a linear ω."""
    half = width_s / 2 * motion.rate_dot
    return width_s * motion.rate + width_s**2 / 12 * cross(motion.rate - half, motion.rate + half)


def quaternions(rotation: Array) -> Array:
    """(4, …) unit quaternions of rotation vectors (3, …) in rad."""
    half = np.sqrt(dot(rotation, rotation)) / 2
    share = np.sin(half) / np.maximum(half, TINY) / 2
    return np.concatenate([np.cos(half)[None], np.where(half > 0, share, 0.5) * rotation])


def compose(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (4, …): first ``a``, then ``b`` in the turned axes."""
    return np.asarray((a[:, None] * (b.take(PARTNERS, 0) * SIGNS.reshape(4, 4, *(1,) * (b.ndim - 1)))).sum(0))


def compose_all(turns: Array) -> Array:
    """(4, …) product of (4, …, B) quaternions in order, pair by pair."""
    while turns.shape[-1] > 1:
        odd = turns[..., -1:] if turns.shape[-1] % 2 else turns[..., :0]
        turns = np.concatenate([compose(turns[..., 0:-1:2], turns[..., 1::2]), odd], -1)
    return turns[..., 0]


def vertical(attitude: Array) -> Array:
    """World Z in body axes, (3, …) from quaternions (4, …)."""
    w, x, y, z = attitude
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def to_world(attitude: Array, v: Array) -> Array:
    """Vectors (3, …) from body to world axes."""
    twice = 2 * cross(attitude[1:], v)
    return np.asarray(v + attitude[0] * twice + cross(attitude[1:], twice))
