"""The object that docked, from what was found of the vehicle alone and with it."""

from __future__ import annotations

import numpy as np

from massprop_cli.conclude import docking
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.estimate.quantities import by_scale_beside
from massprop_cli.result.build import estimate_items, matrix
from massprop_cli.result.schema import DockedObject, PhaseItem, VehicleInfo, WarningItem


def docked_object(vehicles: tuple[VehicleInfo, VehicleInfo], single: PhaseItem, combined: PhaseItem) -> DockedObject:
    """Combined less alone, with one thrust scale for both; each rotating mass is without its bearing's."""
    bearings = [vehicle.bearing_mass_kg for vehicle in vehicles]
    scale = vehicles[0].thrust_scale_sigma
    values, joint_covariance = np.empty(20), np.zeros((20, 20))
    for half, phase in enumerate((single, combined)):
        part = slice(10 * half, 10 * half + 10)
        values[part] = [np.nan if item.value is None else item.value for item in phase.estimates.values()]
        joint_covariance[part, part] = np.array(phase.covariance, dtype=float)
    if not single.known and not combined.known:
        # known values calibrate each side's scale for itself; without, it is common
        alone, both = (
            by_scale_beside(half, vehicle.bearing_mass_kg, np.array(vehicle.bearing_position_m))
            for half, vehicle in zip(values.reshape(2, 10), vehicles, strict=True)
        )
        joint_covariance[:10, 10:] = scale**2 * np.outer(alone, both)
        joint_covariance[10:, :10] = joint_covariance[:10, 10:].T
    values[[9, 19]] -= bearings
    found = docking.difference(values[:10], values[10:])
    slope = docking.difference_slope(values[:10], values[10:])
    covariance = slope @ joint_covariance @ slope.T
    verdicts = [item.verdict for phase in (single, combined) for item in phase.estimates.values()]
    verdict: Verdict = "contradicted" if "contradicted" in verdicts else "converged" if set(verdicts) == {"converged"} else "not_converged"
    told: dict[Verdict, Reason] = {"converged": Reason("sides-converged"), "contradicted": Reason("sides-contradicted")}
    reason = told.get(verdict, Reason("sides-not-converged"))
    contradictions = [docking.of_phase(phase.name, phase.contradiction) for phase in (single, combined) if phase.contradiction]
    if docking.backwards(found, covariance):
        verdict, reason = "contradicted", _swapped(float(found[9]))
        contradictions.append(str(reason))
    estimates = estimate_items(docking.estimates_of(found, covariance, verdict, reason))
    return DockedObject(
        before=single.name, after=combined.name, estimates=estimates, covariance=matrix(covariance), contradiction="; ".join(contradictions)
    )


def backwards(docked: DockedObject | None) -> list[WarningItem]:
    """That the object has less than no mass."""
    mass = None if docked is None else docked.estimates["mass"].value
    return [] if mass is None or mass > 0 else [WarningItem(code="docked-mass", message=str(_swapped(mass)))]


def _swapped(mass: float) -> Reason:
    return docking.lighter(mass, "what --after names", "what --before names", "were the two swapped?")
