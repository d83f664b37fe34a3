"""A period that is not what the log's times show is in the sigmas, or in the verdict."""

import numpy as np
import pytest

from massprop_cli import QUANTITIES, job
from tests.analysed import SAMPLES, analysed

OFF = 1e-3


@pytest.mark.parametrize("name", ["free-flyer", "high-rate"])
def test_a_thousandth_is_in_the_sigmas_of_all_that_goes_with_time(name: str) -> None:
    before = analysed(name)
    period_s = (1 + OFF) * before.vehicle.cycle.period_s
    found = job.of_file(SAMPLES / name / "log.parquet", assignments=(f"cycle.period_s={period_s!r}",)).analysis
    (notice,) = found.notices
    assert notice.code == "cycle-pace"
    assert "0.1 % shorter" in notice.message
    assert f"scale them by {1 + OFF:g}" in notice.message
    assert found.vehicle.thrust.scale_sigma == pytest.approx(2 * OFF, rel=2e-3)
    (was,), (now,) = before.conclusions, found.conclusions
    expected = np.hypot(was.sigmas, 2 * OFF * np.abs(was.values) * (np.arange(10) // 3 != 2))
    np.testing.assert_allclose(now.sigmas, expected, rtol=0.05)
    assert [one.verdict for one in now.estimates.values()] == ["converged"] * len(QUANTITIES)


@pytest.mark.parametrize(("off", "said"), [(5e-5, []), (4e-3, ["cycle-period"])])
def test_what_crystals_are_apart_by_is_nothing_and_what_no_clock_is_contradicts(off: float, said: list[str]) -> None:
    period_s = (1 + off) * analysed("free-flyer").vehicle.cycle.period_s
    found = job.of_file(SAMPLES / "free-flyer" / "log.parquet", assignments=(f"cycle.period_s={period_s!r}",)).analysis
    assert {notice.code for notice in found.notices} - {"delay-mismatch"} == set(said)
    verdicts = {one.verdict for one in found.conclusions[0].estimates.values()}
    assert verdicts == ({"contradicted"} if said else {"converged"})
    assert found.vehicle.thrust.scale_sigma == pytest.approx(2 * off, rel=5e-3)
