"""Flights of the testbed in software, each flown once in a process for all tests that look at it."""

from functools import cache

from massprop_cli import flow
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight

PLAN = (
    "duration_s=15.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=15.0}]',
)
"""Keys of a scenario that tells every quantity in 300 cycles."""
RANDOM = (
    "duration_s=20.0",
    'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=20.0}]',
)
"""Pulses about and along all axes for 20 s."""

BY_SPEED = tuple(f'vehicle.wheels.{number}.column="speed"' for number in range(3))
"""Of the wheels of wheels-and-jets their speeds are logged instead of their torque."""

EXACT = tuple(f"wheels.{number}.speed_step_rad_s=0.0" for number in range(3))
"""Settings of their vehicle files: speeds are whole multiples of nothing."""


@cache
def fly(name: str, *settings: str, seeds: tuple[int, ...] = (3,)) -> SimulatedFlight:
    """Fly a packaged scenario with ``--set`` settings, one member per seed. Several members take little longer than one.

    The arrays are read-only: tests share them.
    """
    return simulate.fly(scenario.load(name, settings), seeds)


@cache
def sound(seed: int) -> Analysis:
    """What is found in a flight of :data:`RANDOM` with the vehicle file that it was flown with."""
    flight = fly("free-flyer", *RANDOM, seeds=(seed,))
    return flow.examine(flight.log(0), VehicleSource(flight.vehicle, "t", ""))
