"""A kind of recordings: what changes a flown log, and what must be said of it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from fault_named import Due

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.columns import TIME
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight

Random = np.random.Generator
Columns = dict[str, Any]
"""A log's columns by the contract's names, as arrays of any type; they are written to a file as they are."""


def step_s(columns: Columns) -> float:
    """The mean interval of the records, s."""
    return float(np.diff(np.array(columns[TIME], float)).mean())


def per_cycle(columns: Columns, vehicle: Vehicle) -> int:
    """The number of records in a control cycle."""
    return max(1, round(vehicle.cycle.period_s / step_s(columns)))


def stacked(columns: Columns, names: tuple[str, ...]) -> Array | None:
    """(n, names) these columns of a log; None where it has none of them."""
    return np.stack([columns[name] for name in names], 1) if names[0] in columns else None


def kept(columns: Columns, rows: Any) -> Columns:
    """The log's columns at these rows."""
    return {name: values[rows] for name, values in columns.items()}


class Flown(NamedTuple):
    """One vehicle's flight without a fault."""

    columns: Columns
    vehicle: Vehicle
    truth: tuple[Array, ...]
    """(10,) of each phase."""
    flight: SimulatedFlight
    source: ScenarioSource


class Made(NamedTuple):
    """A changed recording."""

    columns: Columns
    vehicle: Vehicle
    what: str
    """For a reader: what was drawn."""
    dues: tuple[Due, ...] = ()
    """Warnings that name what was drawn; none: those of its kind."""
    truth: tuple[Array, ...] = ()
    """(10,) of each body, if other than flown."""


class Kind(NamedTuple):
    """A kind of recording."""

    what: str
    make: Callable[..., Made | None]
    """Changes a flown log's columns and vehicle file by an rng; None where a vehicle can't have this."""
    codes: tuple[str, ...] = ()
    """Codes of warnings, any of which names it; none: nothing is wrong, and nothing must be said."""
    refusals: tuple[str, ...] = ()
    """Words, any of which is in a refusal that is right too."""
    knowing: bool = False
    """Whether it is handed the :class:`Flown`, too, as ``flown``."""
