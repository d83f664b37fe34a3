"""A phase split at the moment at which the mass properties changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from massprop_cli.conclude.analysis import Analysis
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource


def at_change(found: Analysis) -> VehicleSource | None:
    """The vehicle with another phase from the first named change on; None without one, or ``estimator.split_on_change``."""
    change_s = next((fault.change_s for fault in found.faults if fault.change_s is not None), None)
    return at(found, change_s) if change_s is not None and found.source.vehicle.estimator.split_on_change else None


def at(found: Analysis, change_s: float) -> VehicleSource:
    """The vehicle with another phase from ``change_s`` on."""
    return replace(found.source, vehicle=split(found.source.vehicle, [history.phase for history in found.histories], change_s))


def split(vehicle: Vehicle, phases: Sequence[Phase], at_s: float) -> Vehicle:
    """The vehicle with the phase that holds ``at_s`` cut in two. What was known of that phase is of neither part.

    A docking that names it is between the parts that are next to it.
    """
    cut: list[Phase] = []
    docking = vehicle.docking
    for phase in phases:
        if phase.start_s < at_s < phase.end_s:
            before, after = f"{phase.name}-1", f"{phase.name}-2"
            cut.append(Phase(name=before, start_s=phase.start_s, end_s=at_s))
            cut.append(Phase(name=after, start_s=at_s, end_s=phase.end_s))
            if docking is not None and docking.before == phase.name:
                docking = docking.model_copy(update={"before": after})
            if docking is not None and docking.after == phase.name:
                docking = docking.model_copy(update={"after": before})
        else:
            cut.append(phase.model_copy(update={"known": {**vehicle.known, **phase.known}}))
    return vehicle.model_copy(update={"phases": tuple(cut), "docking": docking, "known": {}})
