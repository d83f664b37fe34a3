"""The pressure that jets are fed with, or the voltage of rotors, as a log has it.

The thrust of a choked nozzle is F = C_F A_t p, with the throat's area A_t and a thrust coefficient C_F that in vacuum, and far above
the ambient pressure, does not change with p (Sutton and Biblarz, Rocket Propulsion Elements, 3.3). A motor follows its command in
proportion to the voltage.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import PRESSURE, SUPPLY
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.vehicle import Vehicle

LEAST, MOST = 0.01, 10.0
"""Parts of the stated pressure outside which a reading has another unit: by a bar for a pascal it is 1e-5."""


class SupplyLevel(NamedTuple):
    """K pressures over the one that thrust is stated for; or voltages, V."""

    time_s: Array
    """(K,) middle of each control cycle."""
    part: Array
    """(K,) mean over it."""

    def at(self, time_s: Array) -> Array:
        """Between these in proportion; beyond the log as at its ends."""
        return np.interp(time_s, self.time_s, self.part)


def read(source: LogTable, vehicle: Vehicle, time_s: Array, interval_s: Array, records: int) -> SupplyLevel | None:
    """Means over cycles of ``records``; None where neither pressure nor voltage is stated. :class:`InputError` names row and remedy."""
    if any(rotor.nominal_v for rotor in vehicle.rotors):
        return _level(time_s, interval_s, source.required(SUPPLY)[: len(time_s)], records)
    nominal_pa = vehicle.thrust.nominal_pa
    if nominal_pa is None:
        return None
    if not source.has(PRESSURE):
        raise InputError(
            f"{source.table.path}: column {source.name(PRESSURE)!r} is missing, and thrust.nominal_pa says that thrust follows it; log it, "
            "or leave thrust.nominal_pa out: each jet then gives the same throughout"
        )
    pressure = source.required(PRESSURE)[: len(time_s)]
    part = pressure / nominal_pa
    said = f"of thrust.nominal_pa = {nominal_pa:g}; are both absolute pressures in pascals?"
    source.refuse(~((part >= LEAST) & (part <= MOST)), PRESSURE, lambda row: f"{pressure[row]:.6g} Pa is {part[row]:.2g} {said}")
    return _level(time_s, interval_s, part, records)


def _level(time_s: Array, interval_s: Array, values: Array, records: int) -> SupplyLevel:
    """Means over each cycle."""
    middle_s, part = (each.reshape(-1, records).mean(1) for each in (time_s - interval_s / 2, values))
    return SupplyLevel(frozen(middle_s), frozen(part))
