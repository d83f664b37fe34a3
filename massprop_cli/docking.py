"""The docked object: what the combined body has beyond the vehicle alone, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.arrays import Array
from massprop_cli.conclude import Conclusion, Estimate
from massprop_cli.dynamics import elements, tensor
from massprop_cli.vehicle import Docking, Vehicle

SIGNIFICANT = 3.0
"""Two phases are before and after docking, unless told otherwise, if their masses differ by more than this many sigmas."""


@dataclass(frozen=True)
class Docked:
    """Ten quantities of the docked object; CG from O, inertia about its own CG, body axes."""

    before: str
    after: str
    estimates: dict[str, Estimate]
    covariance: Array


def docked_object(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> Docked | None:
    """The docked object of the phases that ``[docking]`` names, or of the only two if their masses differ; None where there is none.

    The phases' errors are independent but for a common thrust scale, which enters both alike.
    """
    pair = _pair(conclusions, vehicle.docking)
    if pair is None:
        return None
    values = [_rotating(conclusion) for conclusion in pair]
    joint = np.zeros((20, 20))
    joint[:10, :10], joint[10:, 10:] = (conclusion.covariance for conclusion in pair)
    if vehicle.thrust.scale_sigma > 0 and not vehicle.known:
        scaled = [np.concatenate([c.values[:6], np.zeros(3), c.values[9:]]) for c in pair]
        joint[:10, 10:] = vehicle.thrust.scale_sigma**2 * np.outer(*scaled)
        joint[10:, :10] = joint[:10, 10:].T
    found = difference(*values)
    slope = _slope(*values)
    covariance = slope @ joint @ slope.T
    settled = all(e.verdict == "converged" for conclusion in pair for e in conclusion.estimates.values())
    known = bool(np.isfinite(found).all() and np.isfinite(covariance).all())
    estimates = {
        name: Estimate(
            value=float(found[i]) if known else None,
            sigma=float(np.sqrt(covariance[i, i])) if known else None,
            unit=UNITS[name],
            verdict="converged" if settled else "not_converged",
            final_at_s=None,
            reason="both phases converged" if settled else "not every quantity of both phases converged",
        )
        for i, name in enumerate(QUANTITIES)
    }
    return Docked(pair[0].phase.name, pair[1].phase.name, estimates, covariance)


def _pair(conclusions: tuple[Conclusion, ...], named: Docking | None) -> tuple[Conclusion, Conclusion] | None:
    by_name = {conclusion.phase.name: conclusion for conclusion in conclusions}
    if named is not None:
        return by_name[named.before], by_name[named.after]
    if len(conclusions) != 2:
        return None
    first, second = sorted(conclusions, key=lambda conclusion: conclusion.phase.start_s)
    masses = [conclusion.estimates["mass"] for conclusion in (first, second)]
    if any(mass.value is None or mass.sigma is None for mass in masses):
        return None
    spread = np.hypot(masses[0].sigma or 0.0, masses[1].sigma or 0.0)
    return (first, second) if abs((masses[1].value or 0.0) - (masses[0].value or 0.0)) > SIGNIFICANT * spread else None


def _rotating(conclusion: Conclusion) -> Array:
    """(10,) quantities with the mass of the rotating body alone."""
    return np.append(conclusion.values[:9], conclusion.rotating_mass)


def difference(alone: Array, combined: Array) -> Array:
    """(10,) docked object from (10,) alone and combined (thesis chapter 5).

    ``m2 = m12 − m1``, ``c2 = (m12 c12 − m1 c1) / m2``, ``I2 = I12 − I1 − m1 [d1] − m2 [d2]`` with d = c − c12 and
    ``[d] = (d·d) 1 − d dᵀ``.
    """
    mass = combined[9] - alone[9]
    cg = (combined[9] * combined[6:9] - alone[9] * alone[6:9]) / mass
    inertia = tensor(combined[:6]) - tensor(alone[:6])
    for body_mass, offset in ((alone[9], alone[6:9] - combined[6:9]), (mass, cg - combined[6:9])):
        inertia = inertia - body_mass * ((offset @ offset) * np.eye(3) - np.outer(offset, offset))
    return np.concatenate([elements(inertia), cg, [mass]])


def _slope(alone: Array, combined: Array) -> Array:
    """(10, 20) derivative of :func:`difference`, by central differences (the formulas are at most cubic over a mass)."""
    both = np.concatenate([alone, combined])
    trace = combined[0] + combined[3] + combined[5]
    sizes = np.concatenate([np.full(6, trace), np.full(3, np.sqrt(abs(trace / combined[9]))), [combined[9]]])
    slope = np.empty((10, 20))
    for i, size in enumerate(np.tile(1e-6 * sizes, 2)):
        step = np.zeros(20)
        step[i] = size
        up, down = both + step, both - step
        slope[:, i] = (difference(up[:10], up[10:]) - difference(down[:10], down[10:])) / (2 * size)
    return slope
