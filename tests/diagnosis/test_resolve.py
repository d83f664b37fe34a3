"""Delay and lag as one run uses them."""

from __future__ import annotations

import pytest

from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.prepare.timing import Timing
from tests import flight
from tests.faulty import stated

FOUND = Timing(1.5, 0.4)


@pytest.mark.parametrize(
    ("assignments", "timing"),
    [
        ((), Timing(2.0, 0.6)),
        (('cycle.command_delay_cycles="auto"',), Timing(1.5, 0.6)),
        (('thrust.lag_s="auto"',), Timing(2.0, 0.4)),
        (('cycle.command_delay_cycles="auto"', 'thrust.lag_s="auto"'), FOUND),
    ],
)
def test_what_the_file_leaves_open_is_taken_as_it_was_found(assignments: tuple[str, ...], timing: Timing) -> None:
    used = stated(flight.vehicle(delay=2.0, thrust={"lag_s": 0.6 * flight.CYCLE}), *assignments)
    assert stated_timing(used, FOUND) == pytest.approx(timing, rel=1e-12)
