"""The docked object: what the combined body has beyond the vehicle alone, with its covariance."""

import numpy as np

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import elements, parallel_axis, tensor
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import PLANAR, Conclusion, Estimate, Verdict
from massprop_cli.estimate.known import MISMATCH, off_by
from massprop_cli.estimate.quantities import by_first_moment, by_scale, condition, mass_first, open_scale
from massprop_cli.inputs.vehicle import Known, Vehicle

SIGNIFICANT = 3.0
"""Two phases are before and after docking, unless told otherwise, if their masses differ by more than this many sigmas."""


@dataclass(frozen=True)
class Docked:
    """Ten quantities of the docked object; CG from O, inertia about its own CG, body axes."""

    before: str
    after: str
    estimates: dict[str, Estimate]
    covariance: Array
    contradiction: str = ""
    """Which of its phases is contradicted, and why."""
    belied: tuple[str, ...] = ()
    """What the log says of each known quantity that it does not bear out."""


def docked_object(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> Docked | None:
    """The docked object of the phases that ``[docking]`` names; else of the only two if their masses differ, docked or released.

    None where there is none.

    The phases' errors are independent but for a common thrust scale, which enters both alike; what is known of a phase calibrates it.
    """
    pair = _pair(conclusions, vehicle)
    if pair is None:
        return None
    values, joint = _joint(pair, vehicle)
    found = difference(values[:10], values[10:])
    slope = difference_slope(values[:10], values[10:])
    belied = list[str]()
    for name, known in mass_first(vehicle.docking.known if vehicle.docking else {}):
        i = QUANTITIES.index(name)
        z = (known.value - found[i]) / np.sqrt(slope[i] @ joint @ slope[i] + known.sigma**2)
        if abs(z) > MISMATCH:
            belied.append(f"docking.known.{name} = {known.value:g} {off_by(z)}")
        values, joint = _conditioned(values, joint, slope[i], (name, known), float(found[i]), 0.0 if vehicle.on_air_bearing else None)
        found, slope = difference(values[:10], values[10:]), difference_slope(values[:10], values[10:])
    apart = without_part(vehicle.environment.kind)
    covariance = slope @ joint @ slope.T
    settled = all(conclusion.estimates[QUANTITIES[i]].verdict == "converged" for conclusion in pair for i in np.flatnonzero(~apart))
    contradictions = [of_phase(c.phase.name, c.contradiction) for c in pair if c.causes]
    less = backwards(float(found[9]), covariance)
    verdict: Verdict = "contradicted" if contradictions or less or belied else "converged" if settled else "not_converged"
    reason = Reason("phases-converged" if settled else "phases-not-converged")
    if contradictions:
        reason = Reason.of("phases-contradicted", phases=" and ".join(c.phase.name for c in pair if c.causes))
    elif less:
        reason = lighter(float(found[9]), f"phase {pair[1].phase.name}", f"phase {pair[0].phase.name}", "correct [docking]")
        contradictions = [str(reason)]
    elif belied:
        reason, contradictions = Reason.of("contradiction", cause="; ".join(belied)), belied
    estimates = estimates_of(found, covariance, verdict, reason, apart)
    covariance[apart], covariance[:, apart] = np.nan, np.nan
    return Docked(pair[0].phase.name, pair[1].phase.name, estimates, covariance, "; ".join(contradictions), tuple(belied))


def backwards(mass: float, covariance: Array) -> bool:
    """Whether an object of ``mass`` with its covariance (10, 10) has less than none, beyond chance: its sides were swapped."""
    return bool(mass < -SIGNIFICANT * np.sqrt(covariance[9, 9]))


def lighter(mass: float, after: str, before: str, remedy: str) -> Reason:
    """That an object of ``mass``, kg, below 0 is none."""
    return Reason.of("docked-lighter", mass=mass, after=after, before=before, remedy=remedy)


def of_phase(name: str, cause: str) -> str:
    """What contradicts in a phase, with its name."""
    return f"phase {name}: {cause}"


def estimates_of(found: Array, covariance: Array, verdict: Verdict, reason: Reason, apart: BoolArray) -> dict[str, Estimate]:
    """The ten quantities (10,) with their sigmas; without a value unless all can be told, but those ``apart`` (10,), which have no part."""
    told = bool(np.isfinite(found).all() and np.isfinite(covariance).all())
    if not told and verdict != "contradicted":
        verdict, reason = "unobservable", Reason("sides-untold")
    sigmas = np.sqrt(np.diag(covariance)) if told else found
    if verdict == "converged" and found[9] < SIGNIFICANT * sigmas[9]:
        verdict, reason = "not_converged", Reason.of("docked-faint", mass=float(found[9]), sigma=float(sigmas[9]))
    estimates = {}
    for i, name in enumerate(QUANTITIES):
        value, sigma = (float(found[i]), float(sigmas[i])) if told and not apart[i] else (None, None)
        why: tuple[Verdict, Reason] = ("unobservable", Reason("no-part")) if apart[i] else (verdict, reason)
        estimates[name] = Estimate(value, sigma, UNITS[name], why[0], None, why[1])
    return estimates


def _joint(pair: tuple[Conclusion, Conclusion], vehicle: Vehicle) -> tuple[Array, Array]:
    """(20,) quantities of both phases with their covariance: a thrust scale common to both that no log tells, and what is known of each."""
    thesis = vehicle.estimator.method == "thesis"
    values = np.concatenate([conclusion.bare[0] for conclusion in pair])
    joint: Array = np.zeros((20, 20))
    joint[:10, :10], joint[10:, 10:] = (conclusion.bare[1] for conclusion in pair)
    apart = np.tile(without_part(vehicle.environment.kind), 2)  # nothing else depends on these
    values[apart], joint[apart], joint[:, apart] = 0.0, 0.0, 0.0
    known = [
        (10 * half + QUANTITIES.index(name), one)
        for half, conclusion in enumerate(() if thesis else pair)
        for name, one in mass_first(vehicle.in_phase(conclusion.phase).known)
    ]
    untold = [(i, one) for i, one in known if not np.isfinite(values[i])]  # as the mass where nothing pushes
    for i, one in untold:
        values[i], joint[i], joint[:, i] = one.value, 0.0, 0.0
    scaled = by_scale(values.reshape(2, 10), vehicle).ravel()
    if not thesis:
        beyond = max(conclusion.thrust_scale_sigma for conclusion in pair)  # the thrust is the same in both
        joint = joint + (open_scale(vehicle) ** 2 + beyond**2) * np.outer(scaled, scaled)
        for i, one in known:
            if (i, one) in untold:
                joint[i], joint[:, i] = 0.0, 0.0
                joint[i, i] = one.sigma**2
            else:
                beside = vehicle.bearing_mass_kg if vehicle.on_air_bearing else None
                values, joint = _conditioned(values, joint, np.eye(20)[i], (QUANTITIES[i % 10], one), float(values[i]), beside)
    values[[9, 19]] -= vehicle.bearing_mass_kg
    return values, joint


def _conditioned(
    values: Array, joint: Array, slope: Array, known: tuple[str, Known], expected: float, bearing_mass_kg: float | None
) -> tuple[Array, Array]:
    """Both phases' quantities (20,) conditioned on what is ``known``, by name; on a bearing as :func:`by_first_moment` does it."""
    name, one = known
    found, covariance = condition(values, joint, slope, one.value, expected, one.sigma)
    if bearing_mass_kg is not None:
        halves, by = by_first_moment(name, values.reshape(2, 10), found.reshape(2, 10), bearing_mass_kg)
        found, whole = halves.ravel(), np.zeros((20, 20))
        whole[:10, :10], whole[10:, 10:] = by
        covariance = whole @ covariance @ whole.T
    return found, covariance


def without_part(environment: str) -> BoolArray:
    """(10,) what has no part in any motion in this environment."""
    return np.array([environment == "planar" and name not in PLANAR for name in QUANTITIES])


def _pair(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> tuple[Conclusion, Conclusion] | None:
    by_name = {conclusion.phase.name: conclusion for conclusion in conclusions}
    if vehicle.docking is not None:
        return by_name[vehicle.docking.before], by_name[vehicle.docking.after]
    apart = masses_apart(conclusions, vehicle)
    if apart is None or abs(apart[0]) <= SIGNIFICANT * apart[1]:
        return None
    first, second = sorted(conclusions, key=lambda conclusion: conclusion.phase.start_s)
    return (first, second) if apart[0] > 0 else (second, first)


def masses_apart(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> tuple[float, float] | None:
    """How much heavier the second of two phases is, with sigma, kg; None unless there are just two with a mass."""
    if len(conclusions) != 2:
        return None
    first, second = sorted(conclusions, key=lambda conclusion: conclusion.phase.start_s)
    values, joint = _joint((first, second), vehicle)
    apart = values[19] - values[9]
    variance = joint[9, 9] + joint[19, 19] - 2 * joint[9, 19]
    return (float(apart), float(np.sqrt(max(variance, 0.0)))) if np.isfinite(apart + variance) else None


def difference(alone: Array, combined: Array) -> Array:
    """(10,) docked object from (10,) alone and combined (thesis chapter 5).

    ``m2 = m12 − m1``, ``c2 = (m12 c12 − m1 c1) / m2``, ``I2 = I12 − I1 − m1 [d1] − m2 [d2]`` with d = c − c12 and
    ``[d] = (d·d) 1 − d dᵀ``.
    """
    mass = combined[9] - alone[9]
    cg = (combined[9] * combined[6:9] - alone[9] * alone[6:9]) / mass
    inertia = tensor(combined[:6]) - tensor(alone[:6])
    for body_mass, offset in ((alone[9], alone[6:9] - combined[6:9]), (mass, cg - combined[6:9])):
        inertia = inertia - parallel_axis(body_mass, offset)
    return np.concatenate([elements(inertia), cg, [mass]])


def difference_slope(alone: Array, combined: Array) -> Array:
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
