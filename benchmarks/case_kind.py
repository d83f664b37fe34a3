"""A kind of recordings: what changes a flown log, and what must be said of it."""

from collections.abc import Callable
from typing import Any, NamedTuple

from fault_named import Due

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight

Columns = dict[str, Any]
"""A log's columns by the contract's names, as arrays of any type; they are written to a file as they are."""


class Flown(NamedTuple):
    """One vehicle's flight without a fault."""

    columns: Columns
    vehicle: Vehicle
    truth: tuple[Array, ...]
    """(10,) of each phase."""
    flight: SimulatedFlight
    source: ScenarioSource


class Made(NamedTuple):
    """One variant."""

    columns: Columns
    vehicle: Vehicle
    what: str
    """For a reader: what was drawn."""
    dues: tuple[Due, ...] = ()
    """Warnings that name what was drawn; none: those of its kind."""
    truth: tuple[Array, ...] = ()
    """(10,) of each body, if other than flown."""


class Kind(NamedTuple):
    """Of recordings."""

    what: str
    make: Callable[..., Made | None]
    """Changes a flown log's columns and vehicle file by an rng; None where a vehicle can't have this."""
    codes: tuple[str, ...] = ()
    """Codes of warnings, any of which names it; none: nothing is wrong, and nothing must be said."""
    refusals: tuple[str, ...] = ()
    """Words, any of which is in a refusal that is right too."""
    knowing: bool = False
    """Whether it is handed the :class:`Flown`, too, as ``flown``."""
