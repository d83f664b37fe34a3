"""What acts on the rotating body, free or on an air bearing.

Both environments say which moment the commands make for a reference (I, c, mu = 1/m), about which centre (the CG, or the bearing), and what
an attitude error does to the moment and to the specific force there. How motion and specific force depend on the mass properties is
:mod:`massprop_cli.model.lift`'s. Arrays are per bin, (K, B, ...): B equal parts of each of K cycles.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross_matrix
from massprop_cli.inputs.vehicle import Vehicle


@dataclass(frozen=True)
class Reference:
    """The mass properties about which the equations are linearised."""

    inertia: Array
    """(3, 3) about the CG, kg m²."""
    cg: Array
    """(3,) from O, m."""
    mu: float
    """1/m, 1/kg."""
    gyro_bias: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) rad/s, body axes; taken off the measured rate."""
    scale: Array = field(default_factory=lambda: np.zeros(0))
    """Relative errors of scales (:mod:`massprop_cli.model.momentum`), as far as they have been found; empty: none."""
    response: Array | None = None
    """(3, C) the matrix Φ of :mod:`massprop_cli.model.lift` where the log tells it better than the inertia; None: what these make it."""


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

    @property
    def rotation(self) -> Array:
        """(K, B, 3, 3) matrix of ``ω̇ × ρ + ω × (ω × ρ)`` acting on ρ."""
        rate = cross_matrix(self.rate)
        return cross_matrix(self.rate_dot) + rate @ rate


@dataclass(frozen=True)
class FreeBody:
    """``moment = τ − c × F``; the specific force of the CG is ``F/m`` (thesis eq. 2.3, 4.13)."""

    def centre(self, reference: Reference) -> Array:
        """The point whose specific force the commands alone decide: the CG."""
        return reference.cg

    def jet_moment(self, reference: Reference) -> Array:
        """(3, 6) wrench to moment about the CG, the commands' direct part."""
        return np.hstack([np.eye(3), -cross_matrix(reference.cg)])

    def moment_by_tilt(self, _: Reference, motion: Motion) -> Array:
        """(K, B, 3, 3) derivative of the moment with respect to an attitude error: none without gravity."""
        return np.zeros((*motion.rate.shape, 3))

    def force_by_tilt(self, motion: Motion) -> Array:
        """(K, B, 3, 3) derivative of the specific force with respect to an attitude error: none without gravity."""
        return np.zeros((*motion.rate.shape, 3))


@dataclass(frozen=True)
class BearingBody:
    """A body turning about a bearing b whose base slides on a horizontal plane.

    The bearing's reaction is whatever keeps b level: all forces but gravity on the rotating mass m_r sum to m_r f, f the specific
    force of the CG, so the moment about the CG is ``τ − b × F − m_r (c − b) × f``. The bearing point accelerates horizontally only,
    ``a = P (F − m_r (ω̇ × s + ω × (ω × s))) / m``, s = c − b, P the projector on the plane; m = m_r + bearing mass.
    """

    bearing: Array
    bearing_mass: float
    gravity: float

    def centre(self, _: Reference) -> Array:
        """The point whose specific force the commands alone decide: the bearing."""
        return self.bearing

    def jet_moment(self, _: Reference) -> Array:
        """(3, 6) wrench to moment about the bearing."""
        return np.hstack([np.eye(3), -cross_matrix(self.bearing)])

    def rotating_mass(self, reference: Reference) -> float:
        """m_r, kg; not below a hundredth of the whole, so that a poor reference stays a body."""
        return max(1 / reference.mu - self.bearing_mass, 0.01 / reference.mu)

    def moment_by_tilt(self, reference: Reference, motion: Motion) -> Array:
        """(K, B, 3, 3) derivative of the moment with respect to an attitude error φ, which turns the vertical u into ``u + u × φ``."""
        offset = cross_matrix(reference.cg - self.bearing)
        return -self.rotating_mass(reference) * offset @ self.force_by_tilt(motion)

    def force_by_tilt(self, motion: Motion) -> Array:
        """(K, B, 3, 3) derivative of the specific force at the bearing with respect to an attitude error."""
        return self.gravity * cross_matrix(motion.up)


Plant = FreeBody | BearingBody


def plant_of(vehicle: Vehicle) -> Plant:
    """The environment that the vehicle file states."""
    environment = vehicle.environment
    if environment.kind == "free":
        return FreeBody()
    return BearingBody(np.array(environment.bearing_position_m), environment.bearing_mass_kg, environment.gravity_m_s2)
