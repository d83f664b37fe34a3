"""What is left of a log as stated."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.diagnosis.cures import Case
from massprop_cli.diagnosis.design import Designs
from massprop_cli.diagnosis.look import Look, about_its_body, busiest, looked
from massprop_cli.estimate.noiselevels import with_noise_levels
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario, simulate


def clean(name: str, seed: int) -> Look:
    flown = simulate.fly(scenario.load(name), [seed])
    log, timing = flown.log(0), Timing(float(flown.vehicle.cycle.command_delay_cycles), 0.0)
    piece = slice(5, log.cycles)
    used, _ = with_noise_levels(Stream.of(log, flown.vehicle, timing), [piece], flown.vehicle)
    look = looked(*busiest(Case(log, used, timing, Designs()), piece))
    assert look is not None
    return look


@pytest.mark.parametrize("name", ["free-flyer", "testbed"])
@pytest.mark.parametrize("seed", [1001, 1003])
def test_a_clean_log_leaves_no_more_than_chance_about_its_own_body(name: str, seed: int) -> None:
    """Columns that say the same twice, but for the noise in them, explain noise that no body does: 1.4 times pure error on a bearing."""
    look = about_its_body(clean(name, seed))
    assert look.misfit < 1 + 5 * np.sqrt(2 / look.freedom)
    # noise is what it is stated to be
    assert 0.8 < (look.free.pure / look.noise).min() < (look.free.pure / look.noise).max() < 1.25
    assert look.stated.value("theta")[9] == pytest.approx(1 / (25.0 if name == "testbed" else 22.0), rel=0.05)
