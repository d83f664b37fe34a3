"""Logged supply pressure of jets, or supply voltage of rotors.

The thrust of a choked nozzle is F = C_F A_t p, A_t the throat area. In vacuum or far above ambient pressure, the thrust coefficient C_F
does not depend on p (Sutton and Biblarz, Rocket Propulsion Elements, 3.3). A motor's response to a command is proportional to voltage.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import PRESSURE, SUPPLY
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.vehicle import Vehicle

LEAST, MOST = 0.01, 10.0
"""Plausible range of pressure over nominal pressure; outside it the unit is wrong (bar for pascal gives 1e-5)."""


class SupplyLevel(NamedTuple):
    """Supply level of K control cycles: pressure over nominal pressure, or voltage, V."""

    time_s: Array
    """(K,) middle of each control cycle, s."""
    part: Array
    """(K,) mean level of each cycle."""

    def at(self, time_s: Array) -> Array:
        """Level by linear interpolation; constant beyond the ends of the log."""
        return np.interp(time_s, self.time_s, self.part)


def read(source: LogTable, vehicle: Vehicle, time_s: Array, interval_s: Array, records: int) -> SupplyLevel | None:
    """Supply level per cycle; None without a nominal one in the vehicle file. Raises :class:`InputError` if missing or implausible."""
    if any(rotor.nominal_v for rotor in vehicle.rotors):
        return _level(time_s, interval_s, source.required(SUPPLY)[: len(time_s)], records)
    nominal_pa = vehicle.thrust.nominal_pa
    if nominal_pa is None:
        return None
    if not source.has(PRESSURE):
        raise InputError(
            f"{source.table.path}: column {source.name(PRESSURE)!r} is missing, but thrust.nominal_pa makes thrust proportional to it; log "
            "it, or leave thrust.nominal_pa out: each jet then has constant thrust"
        )
    pressure = source.required(PRESSURE)[: len(time_s)]
    part = pressure / nominal_pa
    hint = f"of thrust.nominal_pa = {nominal_pa:g}; are both absolute pressures in pascals?"
    source.refuse(~((part >= LEAST) & (part <= MOST)), PRESSURE, lambda row: f"{pressure[row]:.6g} Pa is {part[row]:.2g} {hint}")
    return _level(time_s, interval_s, part, records)


def _level(time_s: Array, interval_s: Array, values: Array, records: int) -> SupplyLevel:
    """Supply level as means of ``values`` over each cycle."""
    middle_s, part = (each.reshape(-1, records).mean(1) for each in (time_s - interval_s / 2, values))
    return SupplyLevel(frozen(middle_s), frozen(part))
