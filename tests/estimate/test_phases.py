"""Off-line fits with the noise that is stated, before anything is sized."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.levels import ITERATIONS
from massprop_cli.base.rigidbody import tensor
from massprop_cli.estimate import offline, phases
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.plant import Reference
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.timing import Timing
from tests import flight

CYCLES = slice(2, 320)
PHASE = Phase(name="all", start_s=0.0, end_s=16.0)


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_fits_led_on_are_the_very_same_as_if_all_passes_were_done_in_a_row(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a body with three times the inertia and half of the mass, its CG 5 cm away; a free one stands after two passes."""
    monkeypatch.setattr(phases, "SIZING", 1)
    flown, truth = flight.standard(kind), flight.TRUTH if kind == "free" else flight.ON_BEARING
    samples, used = flown.samples(np.random.default_rng(5)), flown.resolved
    far = Reference(3 * tensor(truth[:6]), truth[6:9] + 0.05, 2 / truth[9])
    few, all_at_once = (offline.fit(samples, CYCLES, PHASE, far, used, passes=n) for n in (phases.SIZING, ITERATIONS))
    assert not few.converged
    assert np.abs(few.history.values[-1] - all_at_once.history.values[-1]).max() > 0
    (led,) = phases._Fitting(samples, [(PHASE, CYCLES)], used, Consider()).continued([few])
    assert led is not None
    assert led.converged == all_at_once.converged
    for name in ("values", "sigmas", "normalised", "covariance"):
        np.testing.assert_array_equal(getattr(led.history, name), getattr(all_at_once.history, name))


@pytest.mark.parametrize(("part", "quiet"), [(1, False), (1 / 6, False), (1 / 8, True)])
def test_rates_with_a_seventh_of_the_noise_that_is_stated_are_quiet(part: float, quiet: bool) -> None:
    flown = flight.standard("free")
    log = flown.log(np.random.default_rng(6), gyro=1e-4 * part)
    told = phases.as_stated(Timing(2.0, 0.0).of(log, flown.used), [(PHASE, CYCLES)], flown.used, Consider())
    assert told.quiet is quiet
    assert not told.dubious


def test_rates_that_were_turned_into_radians_twice_are_quiet_where_their_noise_hides_that_they_fit_no_body() -> None:
    """With ten times the gyro's noise: so small are they that hardly anything is left beyond it."""
    flown = flight.standard("free")
    log = flown.log(np.random.default_rng(7), gyro=1e-3)
    imu = flown.used.imu.model_copy(update={"gyro_noise_rad_s": 1e-3})
    used, twice = flown.used.model_copy(update={"imu": imu}), replace(log, delta_theta_imu_rad=np.radians(log.delta_theta_imu_rad))
    for one, quiet in ((log, False), (twice, True)):
        assert phases.as_stated(Timing(2.0, 0.0).of(one, used), [(PHASE, CYCLES)], used, Consider()).quiet is quiet
