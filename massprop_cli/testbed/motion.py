"""Rigid-body motion of all members through one control cycle, free or on an air bearing.

Both environments have the form ``A ω̇ = M w − ω × (A₀ ω + h) + p (…)``, the commands' wrench w(t) and the wheels' momentum h known exactly:

* free (6 degrees of freedom): ``A = A₀ = I`` about the CG, ``M w = τ − c × F``, p = 0;
* spherical bearing at b on a base that slides on a horizontal plane (5 degrees of freedom), s = c − b, u the vertical, ``p = s × u``,
  m_r the rotating and m the whole mass: ``A₀ = I − (m_r − m_r²/m) [s]×²``, ``A = A₀ + (m_r²/m) p pᵀ``,
  ``M w = τ − b × F − (m_r/m) s × F`` and ``p ( (m_r/m) u·F − m_r g − (m_r²/m) u·(ω × (ω × s)) )``.
  It is the moment about the CG of jets and reaction, the base's horizontal acceleration and its reaction eliminated.

A cycle is cut into bins. Within a bin ω is the exact answer to the commands plus a smooth rest, whose bin mean and slope are taken to
second order; the bins of a cycle are solved together by fixed-point iteration, which converges by a factor |ω| T or better each time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli.base.arrays import Array

TOLERANCE = 1e-11
"""Iteration ends for a member when its rates change by less than this times (1 rad/s + their size)."""
ITERATIONS = 60


def cross(a: Array, b: Array) -> Array:
    """Cross product of vectors whose components come first."""
    (a0, a1, a2), (b0, b1, b2) = a, b
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def dot(a: Array, b: Array) -> Array:
    """Scalar product of vectors whose components come first."""
    product: Array = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def apply(matrix: Array, v: Array) -> Array:
    """(3, 3, …) times (3, …)."""
    product: Array = matrix[:, 0] * v[0] + matrix[:, 1] * v[1] + matrix[:, 2] * v[2]
    return product


def outer_square(s: Array) -> Array:
    """``−[s]×² = s·s 1 − s sᵀ``, (3, 3, …) from (3, …)."""
    square: Array = dot(s, s) * np.eye(3).reshape(3, 3, *(1,) * (s.ndim - 1)) - s[:, None] * s[None]
    return square


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
class Bearing:
    """Where an air bearing sits and what it carries."""

    position: Array
    """(3,) from O, m."""
    mass: float
    gravity: float


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


@dataclass(frozen=True)
class CycleMotion:
    """Motion within one cycle; (3, S, B) bin means unless said otherwise."""

    rate: Array
    """rad/s."""
    rate_dot: Array
    """rad/s²; also the slope of the rate within a bin."""
    up: Array
    """World vertical in body axes; zeros in free flight."""
    rate_end: Array
    """(3, S) rate at the cycle's end, rad/s."""


@dataclass(frozen=True)
class Dynamics:
    """The coefficients above for members whose mass properties stand still within a cycle."""

    bodies: Bodies
    bearing: Bearing | None

    @property
    def arm(self) -> Array:
        """(3, S) s, bearing to CG; zeros in free flight, m."""
        return np.zeros_like(self.bodies.cg) if self.bearing is None else self.bodies.cg - self.bearing.position[:, None]

    @property
    def rotating_mass(self) -> Array:
        """(S,) m_r, kg."""
        return self.bodies.mass - (0.0 if self.bearing is None else self.bearing.mass)

    @property
    def share(self) -> Array:
        """(S,) m_r / m."""
        return self.rotating_mass / self.bodies.mass

    @property
    def inertia(self) -> Array:
        """(3, 3, S) A₀, kg m²."""
        return self.bodies.inertia + self.rotating_mass * (1 - self.share) * outer_square(self.arm)

    def moment(self, wrench: Array) -> Array:
        """(3, S, B) M w, N m."""
        torque, force = wrench[:3], wrench[3:]
        if self.bearing is None:
            return torque - cross(self.bodies.cg[..., None], force)
        return torque - cross(self.bearing.position[:, None, None] + (self.share * self.arm)[..., None], force)

    def advance(self, rate: Array, up: Array, wrench: Wrench, width_s: float) -> CycleMotion:
        """Through one cycle from ``rate`` (3, S) and ``up`` (3, S)."""
        inertia = self.inertia
        inverse = np.moveaxis(np.linalg.inv(np.moveaxis(inertia, -1, 0)), 0, -1)[..., None]
        inertia = inertia[..., None]
        h = width_s
        driven, gathered = apply(inverse, self.moment(wrench.mean)), apply(inverse, self.moment(wrench.gathered))
        rest = np.zeros_like(driven)
        ups = np.zeros_like(driven) + up[..., None]
        state = _State(rate[..., None] + h * np.cumsum(driven, -1), np.zeros_like(driven), driven, rest, ups)
        open_members = np.ones(rate.shape[1], dtype=bool)
        for _ in range(ITERATIONS):
            found = self._iterate(state, rate, up, inertia, inverse, driven, gathered, wrench, h)
            moved = np.abs(found.end - state.end).max((0, 2)) > TOLERANCE * (1 + np.abs(found.end).max((0, 2)))
            # a member's own convergence alone decides when it stops, so that its bytes don't depend on who flies beside it
            state = found if open_members.all() else state.where(open_members, found)
            open_members = open_members & moved
            if not open_members.any():
                break
        return CycleMotion(state.mean, state.dot, state.up, state.end[..., -1])

    def _iterate(
        self,
        state: _State,
        rate: Array,
        up: Array,
        inertia: Array,
        inverse: Array,
        driven: Array,
        gathered: Array,
        wrench: Wrench,
        h: float,
    ) -> _State:
        start = np.concatenate([rate[..., None], state.end[..., :-1]], -1)
        mean = start + gathered + h / 2 * state.rest - h * h / 12 * state.rest_slope
        momentum, torque = apply(inertia, mean) + wrench.momentum, apply(inertia, state.dot) + wrench.momentum_slope
        # bin means of products of what changes linearly: product of the means + product of the slopes h²/12
        rest = -apply(inverse, cross(mean, momentum) + h * h / 12 * cross(state.dot, torque))
        rest_slope = -apply(inverse, cross(state.dot, momentum) + cross(mean, torque))
        ups = state.up
        if self.bearing is not None:
            ups, push = self._on_bearing(up, mean, state, wrench, h)
            rest = self._with_bearing(rest + driven, ups, push, inverse) - driven
            swing = cross(self.arm[..., None], cross(ups, mean))
            rest_slope = rest_slope - apply(inverse, (self.rotating_mass * self.bearing.gravity)[:, None] * swing)
        dot = driven + rest
        return _State(rate[..., None] + h * np.cumsum(dot, -1), mean, dot, rest, ups, rest_slope)

    def _on_bearing(self, up: Array, mean: Array, state: _State, wrench: Wrench, h: float) -> tuple[Array, Array]:
        """Vertical (3, S, B) and the bracket behind p, (S, B) N."""
        assert self.bearing is not None
        slope = cross(state.up, mean)
        turning = slope + h * h / 12 * cross(slope, state.dot)
        start = up[..., None] + h * (np.cumsum(turning, -1) - turning)
        ups = start + h / 2 * turning - h * h / 12 * (cross(slope, mean) + cross(state.up, state.dot))
        arm, share = self.arm[..., None], self.share[:, None]
        centripetal = cross(mean, cross(mean, arm))
        push = share * dot(ups, wrench.mean[3:]) - self.rotating_mass[:, None] * (self.bearing.gravity + share * dot(ups, centripetal))
        return ups, push

    def _with_bearing(self, driven: Array, ups: Array, push: Array, inverse: Array) -> Array:
        """(A₀ + k p pᵀ)⁻¹ (A₀ driven + p push), by Sherman and Morrison."""
        p = cross(self.arm[..., None], ups)
        k = (self.rotating_mass * self.share)[:, None]
        turned = apply(inverse, p)
        size = dot(p, turned)
        solved: Array = driven + turned * (push - k * (dot(p, driven) + size * push) / (1 + k * size))
        return solved

    def specific_force(self, motion: CycleMotion, force: Array, position: Array, width_s: float) -> Array:
        """(3, S, B) mean specific force at ``position`` (3,) [m from O], body axes, m/s²; ``force`` (3, S, B) N."""
        centre = self.bodies.cg if self.bearing is None else np.broadcast_to(self.bearing.position[:, None], self.bodies.cg.shape)
        return self.centre_force(motion, force, width_s) + lever(motion, position[:, None, None] - centre[..., None], width_s)

    def centre_force(self, motion: CycleMotion, force: Array, width_s: float) -> Array:
        """(3, S, B) specific force of the CG (free: F/m) or of the bearing (level pull of jets and body, and gravity), m/s²."""
        if self.bearing is None:
            felt: Array = force / self.bodies.mass[:, None]
            return felt
        pull = force / self.bodies.mass[:, None] - self.share[:, None] * lever(motion, self.arm[..., None], width_s)
        return pull - motion.up * dot(motion.up, pull) + self.bearing.gravity * motion.up


def lever(motion: CycleMotion, arm: Array, width_s: float) -> Array:
    """(3, S, B) bin mean of ``ω̇ × ρ + ω × (ω × ρ)``, m/s²."""
    twice = cross(motion.rate, cross(motion.rate, arm)) + width_s**2 / 12 * cross(motion.rate_dot, cross(motion.rate_dot, arm))
    acceleration: Array = cross(motion.rate_dot, arm) + twice
    return acceleration


@dataclass(frozen=True)
class _State:
    """One iterate: rates at the bins' ends, bin means, ω̇, its part that is not the commands', the vertical, slope of that part."""

    end: Array
    mean: Array
    dot: Array
    rest: Array
    up: Array
    rest_slope: Array | float = 0.0

    def where(self, members: Array, other: _State) -> _State:
        chosen = members[:, None]
        fields = ("end", "mean", "dot", "rest", "up", "rest_slope")
        return _State(*(np.where(chosen, getattr(other, name), getattr(self, name)) for name in fields))


def rotation_vectors(motion: CycleMotion, width_s: float) -> Array:
    """(3, S, B) rotation over each bin, rad: ``∫ω dt + ω_start × ω_end h²/12``, exact to third order for a linear ω."""
    half = width_s / 2 * motion.rate_dot
    turned: Array = width_s * motion.rate + width_s**2 / 12 * cross(motion.rate - half, motion.rate + half)
    return turned


def quaternions(rotation: Array) -> Array:
    """(4, …) unit quaternions of rotation vectors (3, …) in rad."""
    angle = np.sqrt(dot(rotation, rotation))
    return np.concatenate([np.cos(angle / 2)[None], 0.5 * np.sinc(angle / (2 * np.pi)) * rotation])


def compose(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (4, …): first ``a``, then ``b`` in the turned axes."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + bw * ax + ay * bz - az * by,
            aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx,
        ]
    )


def compose_all(turns: Array) -> Array:
    """(4, …) product of (4, …, B) quaternions in order, pair by pair."""
    while turns.shape[-1] > 1:
        odd = turns[..., -1:] if turns.shape[-1] % 2 else turns[..., :0]
        turns = np.concatenate([compose(turns[..., 0:-1:2], turns[..., 1::2]), odd], -1)
    product: Array = turns[..., 0]
    return product


def vertical(attitude: Array) -> Array:
    """World Z in body axes, (3, …) from quaternions (4, …)."""
    w, x, y, z = attitude
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def to_world(attitude: Array, v: Array) -> Array:
    """Vectors (3, …) from body to world axes."""
    twice = 2 * cross(attitude[1:], v)
    turned: Array = v + attitude[0] * twice + cross(attitude[1:], twice)
    return turned
