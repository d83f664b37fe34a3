"""Flights of the testbed in software, each flown once for all tests that look at it. They are shared: nobody may write to them."""

from __future__ import annotations

from functools import cache

from massprop_cli import flow
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import Flight

RANDOM = (
    "duration_s=20.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=20.0}]',
)
"""Pulses about and along all axes for 20 s."""


@cache
def flown(name: str, settings: tuple[str, ...] = (), seeds: tuple[int, ...] = (1,)) -> Flight:
    """One member per seed; several take little longer than one."""
    return simulate.fly(scenario.load(name, settings), seeds)


@cache
def sound(seed: int) -> Analysis:
    """What is found in a flight of :data:`RANDOM` with the vehicle file that it was flown with."""
    flight = flown("free-flyer", RANDOM, (seed,))
    return flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))
