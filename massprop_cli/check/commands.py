"""Commands as they stand: none at all, one that never ends, pairs that work against each other."""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.check.finding import Finding, finding, rows
from massprop_cli.inputs.tablefile import Place
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle

ALWAYS = 0.98
"""Part of the cycles, and of each, from which on a jet counts as never off."""
TOGETHER = 0.05
"""Part of the cycles in which a jet and its opposite may fire for the same moment."""
ALIKE = 1e-6


def commands(log: Log, vehicle: Vehicle, place: Place) -> list[Finding]:
    """Findings of jets or wrench; ``place`` names a row."""
    if not log.command.any() and not any(one.moved for one in log.spinning):
        remedy = "see that commands were recorded, under the vehicle file's names"
        return [finding("commands", "nothing-commanded", "fault", "no command other than 0 in the whole log", remedy)]
    if log.command_kind != "jets":
        return []
    share = log.command / vehicle.cycle.period_s
    found = []
    for number, jet in enumerate(vehicle.jets):
        if (share[:, number] > ALWAYS).mean() > ALWAYS:
            said = f"jet {jet.name} is on in every cycle, all of it"
            remedy = "see whether its column holds what was executed; is it a constant?"
            found.append(finding("commands", "jet-always-on", "fault", said, remedy))
    for first, second in _opposed(vehicle):
        # of two on-times in one cycle at least this much overlaps or wastes thrust
        both = np.minimum(share[:, first], share[:, second]) > TOGETHER
        if both.mean() > TOGETHER:
            names = f"{vehicle.jets[first].name} and {vehicle.jets[second].name}"
            said = f"jets {names} push against each other in {int(both.sum())} cycles: their errors stay and their thrust cancels"
            where = rows(_in_rows(log, both), place)
            found.append(finding("commands", "opposed-jets", "note", said, "allocate the commands so that only one of them fires", where))
    return found


def _in_rows(log: Log, commanded: BoolArray) -> BoolArray:
    """(n,) of records, what is true of commands."""
    if log.command_s is None:
        return np.repeat(commanded, log.records_per_cycle)
    found = np.zeros(len(log.time_s), dtype=bool)
    found[np.minimum(np.searchsorted(log.time_s, log.command_s[commanded]), len(found) - 1)] = True
    return found


def never_fired(log: Log, vehicle: Vehicle) -> list[str]:
    """Jets, or components of the wrench, that were not commanded once."""
    by_kind = {
        "jets": [jet.name for jet in vehicle.jets],
        "wrench": [f"{kind} {axis}" for kind in ("torque", "force") for axis in "xyz"],
        "rotors": [rotor.name for rotor in vehicle.rotors],
    }
    names = by_kind[log.command_kind]
    idle = [name for name, column in zip(names, log.command.T, strict=True) if not column.any()]
    return [*idle, *(one.name for one, said in zip(vehicle.spinning, log.spinning, strict=True) if not said.moved)]


def _opposed(vehicle: Vehicle) -> list[tuple[int, int]]:
    wrench: Array = vehicle.jet_wrench
    size = np.abs(wrench).max(initial=0.0)  # of momentum devices alone there are none
    return [
        (i, j)
        for i in range(len(wrench))
        for j in range(i + 1, len(wrench))
        if np.abs(wrench[i] + wrench[j]).max() <= ALIKE * size and wrench[i].any()
    ]
