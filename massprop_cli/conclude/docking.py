"""Mass properties of a docked object: the difference between the combined body and the vehicle alone, with its covariance."""

import numpy as np

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CHANCE, CONTRADICTION
from massprop_cli.base.rigidbody import elements, parallel_axis, tensor
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import PLANAR, Conclusion, Estimate, Verdict
from massprop_cli.estimate.known import off_by
from massprop_cli.estimate.quantities import by_first_moment, by_scale, condition, mass_first, open_scale
from massprop_cli.inputs.vehicle import Known, Vehicle


@dataclass(frozen=True)
class Docked:
    """Ten quantities of the docked object; CG from O, inertia about its own CG, body axes."""

    before: str
    after: str
    estimates: dict[str, Estimate]
    covariance: Array
    contradiction: str = ""
    """Contradiction of a phase or of a known quantity, in words."""
    known_mismatches: tuple[str, ...] = ()
    """Messages of known quantities that the log contradicts."""


def docked_object(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> Docked | None:
    """Docked object of the phases that ``[docking]`` names, else of two phases whose masses differ significantly; None without one.

    The phases' errors are independent except for the common thrust scale. Known values of a phase calibrate it.
    """
    pair = _pair(conclusions, vehicle)
    if pair is None:
        return None
    values, joint = _joint(pair, vehicle)
    found = difference(values[:10], values[10:])
    slope = difference_slope(values[:10], values[10:])
    mismatches = list[str]()
    for name, known in mass_first(vehicle.docking.known if vehicle.docking else {}):
        i = QUANTITIES.index(name)
        z = (known.value - found[i]) / np.sqrt(slope[i] @ joint @ slope[i] + known.sigma**2)
        if abs(z) > CONTRADICTION:
            mismatches.append(f"docking.known.{name} = {known.value:g} {off_by(z)}")
        values, joint = _conditioned(values, joint, slope[i], (name, known), float(found[i]), 0.0 if vehicle.on_air_bearing else None)
        found, slope = difference(values[:10], values[10:]), difference_slope(values[:10], values[10:])
    unused = without_effect(vehicle.environment.kind)
    covariance = slope @ joint @ slope.T
    converged = all(conclusion.estimates[QUANTITIES[i]].verdict == "converged" for conclusion in pair for i in np.flatnonzero(~unused))
    contradictions = [in_phase(c.phase.name, c.contradiction) for c in pair if c.causes]
    negative = has_negative_mass(float(found[9]), covariance)
    verdict: Verdict = "contradicted" if contradictions or negative or mismatches else "converged" if converged else "not_converged"
    reason = Reason("phases-converged" if converged else "phases-not-converged")
    if contradictions:
        reason = Reason.of("phases-contradicted", phases=" and ".join(c.phase.name for c in pair if c.causes))
    elif negative:
        reason = negative_mass(float(found[9]), f"phase {pair[1].phase.name}", f"phase {pair[0].phase.name}", "correct [docking]")
        contradictions = [str(reason)]
    elif mismatches:
        reason, contradictions = Reason.of("contradiction", cause="; ".join(mismatches)), mismatches
    estimates = docked_estimates(found, covariance, verdict, reason, unused)
    covariance[unused], covariance[:, unused] = np.nan, np.nan
    return Docked(pair[0].phase.name, pair[1].phase.name, estimates, covariance, "; ".join(contradictions), tuple(mismatches))


def has_negative_mass(mass: float, covariance: Array) -> bool:
    """Whether ``mass`` (kg) of an object with this covariance (10, 10) is significantly negative, as with swapped sides."""
    return bool(mass < -CHANCE * np.sqrt(covariance[9, 9]))


def negative_mass(mass: float, after: str, before: str, remedy: str) -> Reason:
    """Reason for the contradiction of a negative ``mass``, kg."""
    return Reason.of("docked-lighter", mass=mass, after=after, before=before, remedy=remedy)


def in_phase(name: str, cause: str) -> str:
    """Cause of a contradiction with the name of its phase."""
    return f"phase {name}: {cause}"


def docked_estimates(found: Array, covariance: Array, verdict: Verdict, reason: Reason, unused: BoolArray) -> dict[str, Estimate]:
    """Estimates of the ten quantities ``found`` (10,); without values if any is not finite. ``unused`` (10,) ones are unobservable."""
    finite = bool(np.isfinite(found).all() and np.isfinite(covariance).all())
    if not finite and verdict != "contradicted":
        verdict, reason = "unobservable", Reason("sides-untold")
    sigmas = np.sqrt(np.diag(covariance)) if finite else found
    if verdict == "converged" and found[9] < CHANCE * sigmas[9]:
        verdict, reason = "not_converged", Reason.of("docked-faint", mass=float(found[9]), sigma=float(sigmas[9]))
    estimates = {}
    for i, name in enumerate(QUANTITIES):
        value, sigma = (float(found[i]), float(sigmas[i])) if finite and not unused[i] else (None, None)
        why: tuple[Verdict, Reason] = ("unobservable", Reason("no-part")) if unused[i] else (verdict, reason)
        estimates[name] = Estimate(value, sigma, UNITS[name], why[0], None, why[1])
    return estimates


def _joint(pair: tuple[Conclusion, Conclusion], vehicle: Vehicle) -> tuple[Array, Array]:
    """(20,) quantities of both phases and their (20, 20) covariance, with the common thrust scale and the known values of each phase."""
    thesis = vehicle.estimator.method == "thesis"
    values = np.concatenate([conclusion.bare[0] for conclusion in pair])
    joint: Array = np.zeros((20, 20))
    joint[:10, :10], joint[10:, 10:] = (conclusion.bare[1] for conclusion in pair)
    unused = np.tile(without_effect(vehicle.environment.kind), 2)  # the others do not depend on these
    values[unused], joint[unused], joint[:, unused] = 0.0, 0.0, 0.0
    known = [
        (10 * half + QUANTITIES.index(name), one)
        for half, conclusion in enumerate(() if thesis else pair)
        for name, one in mass_first(vehicle.in_phase(conclusion.phase).known)
    ]
    replaced = [(i, one) for i, one in known if not np.isfinite(values[i])]  # such as the mass without forces
    for i, one in replaced:
        values[i], joint[i], joint[:, i] = one.value, 0.0, 0.0
    by_thrust = by_scale(values.reshape(2, 10), vehicle).ravel()
    if not thesis:
        discrepancy_sigma = max(conclusion.thrust_scale_sigma for conclusion in pair)  # both have the same thrust
        joint = joint + (open_scale(vehicle) ** 2 + discrepancy_sigma**2) * np.outer(by_thrust, by_thrust)
        for i, one in known:
            if (i, one) in replaced:
                joint[i], joint[:, i] = 0.0, 0.0
                joint[i, i] = one.sigma**2
            else:
                bearing_mass_kg = vehicle.bearing_mass_kg if vehicle.on_air_bearing else None
                values, joint = _conditioned(values, joint, np.eye(20)[i], (QUANTITIES[i % 10], one), float(values[i]), bearing_mass_kg)
    values[[9, 19]] -= vehicle.bearing_mass_kg
    return values, joint


def _conditioned(
    values: Array, joint: Array, slope: Array, known: tuple[str, Known], expected: float, bearing_mass_kg: float | None
) -> tuple[Array, Array]:
    """Both phases' quantities (20,) conditioned on a known one; on a bearing linear in the first moment (:func:`by_first_moment`)."""
    name, one = known
    after, covariance = condition(values, joint, slope, one.value, expected, one.sigma)
    if bearing_mass_kg is not None:
        halves, slopes = by_first_moment(name, values.reshape(2, 10), after.reshape(2, 10), bearing_mass_kg)
        after, transform = halves.ravel(), np.zeros((20, 20))
        transform[:10, :10], transform[10:, 10:] = slopes
        covariance = transform @ covariance @ transform.T
    return after, covariance


def without_effect(environment: str) -> BoolArray:
    """(10,) quantities that do not affect the motion in this environment."""
    return np.array([environment == "planar" and name not in PLANAR for name in QUANTITIES])


def _pair(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> tuple[Conclusion, Conclusion] | None:
    """Conclusions of the vehicle alone and combined; None without a docking."""
    by_name = {conclusion.phase.name: conclusion for conclusion in conclusions}
    if vehicle.docking is not None:
        return by_name[vehicle.docking.before], by_name[vehicle.docking.after]
    difference_kg = mass_difference(conclusions, vehicle)
    if difference_kg is None or abs(difference_kg[0]) <= CHANCE * difference_kg[1]:
        return None
    first, second = sorted(conclusions, key=lambda conclusion: conclusion.phase.start_s)
    return (first, second) if difference_kg[0] > 0 else (second, first)


def mass_difference(conclusions: tuple[Conclusion, ...], vehicle: Vehicle) -> tuple[float, float] | None:
    """Mass of the second of two phases minus that of the first, and its sigma, kg; None unless there are exactly two with a mass."""
    if len(conclusions) != 2:
        return None
    first, second = sorted(conclusions, key=lambda conclusion: conclusion.phase.start_s)
    values, joint = _joint((first, second), vehicle)
    mass_kg = values[19] - values[9]
    variance = joint[9, 9] + joint[19, 19] - 2 * joint[9, 19]
    return (float(mass_kg), float(np.sqrt(max(variance, 0.0)))) if np.isfinite(mass_kg + variance) else None


def difference(alone: Array, combined: Array) -> Array:
    """(10,) quantities of the docked object from those of the vehicle alone and combined (10,) (thesis chapter 5).

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
    """(10, 20) derivative of :func:`difference` with respect to both arguments, by central differences."""
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
