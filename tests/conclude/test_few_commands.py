"""Logs in which jets fire in two control cycles: what is laid to a fault, and what is not."""

from __future__ import annotations

import pytest

from massprop_cli import flow
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.testbed import scenario, simulate


def examined(axes: str, seed: int, later: float = 0.0) -> Analysis:
    """One pulse at 3 s and one at 9 s, and a vehicle file whose delay is ``later`` cycles more than it is."""
    pulses = ", ".join(f'{{motion="random", axes={axes}, start_s={at}, end_s={at + 0.05}}}' for at in (3.0, 9.0))
    flown = simulate.fly(scenario.load("free-flyer", ("duration_s=20.0", f"plan=[{pulses}]")), [seed])
    log = flown.log(0)
    assert log.command.any(1).sum() == 2
    delay = float(flown.vehicle.cycle.command_delay_cycles) + later
    return flow.examine(log, VehicleSource(changed(flown.vehicle, [f"cycle.command_delay_cycles={delay}"]), "", ""))


def test_two_pulses_that_tell_of_no_body_refute_nothing() -> None:
    """An accelerometer in another unit had explained them, and all ten values were contradicted."""
    found = examined('["yaw", "x"]', 1)
    assert not found.faults
    assert {one.verdict for one in found.conclusions[0].estimates.values()} == {"not_excited"}


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.thorough)])
def test_two_pulses_tell_when_they_acted(seed: int) -> None:
    found = examined('["roll", "pitch", "yaw", "x", "y", "z"]', seed, later=1.0)
    (fault,) = found.faults
    assert fault.notice.code == "delay-mismatch"
