"""The batch fit against the filter's own last row: the same data, another way."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import estimate
from massprop_cli.dynamics import tensor
from massprop_cli.fit import Extra, fit, response
from massprop_cli.linearise import linearise, parameters
from massprop_cli.plant import Reference
from massprop_cli.vehicle import Phase
from tests import flight

CYCLES = slice(2, 320)
PHASE = Phase(name="all", start_s=0.0, end_s=16.0)


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_the_batch_fit_ends_where_the_filter_ends(kind: str) -> None:
    flown = flight.standard(kind)
    samples = flown.samples(np.random.default_rng(3))
    causal = estimate.replay(samples, CYCLES, PHASE, flown.used)
    assert causal.reference is not None
    history = estimate.settle(samples, CYCLES, PHASE, causal.reference, flown.used)
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    rough = Reference(1.3 * tensor(truth[:6]), truth[6:9] + 0.0005, 0.8 / truth[9])
    found = fit(samples, CYCLES, rough, flown.used)
    values = parameters(found.reference)
    values[9] = 1 / values[9]
    assert np.abs((values - history.values[-1]) / history.sigmas[-1]).max() < 0.1
    assert abs(found.chi_square - 1) < 4 * np.sqrt(2 / (6 * 318))


def test_a_factor_on_the_thrust_comes_out_of_the_fit() -> None:
    """The forces are 10 % stronger than stated along x; what one unit of that does is the response less the response without them."""
    flown = flight.standard("free")
    samples = flown.samples(np.random.default_rng(3))
    reference = Reference(tensor(flight.TRUTH[:6]), flight.TRUTH[6:9], 1 / flight.TRUTH[9])
    weaker = [dict(jet) for jet in flight.jets()]
    for jet in weaker:
        if str(jet["name"]).startswith("divert_x"):
            jet["force_n"] = (0.9 * np.array(jet["force_n"])).tolist()
    stated = flight.Flight(flight.vehicle(jets=weaker), flown.on, flown.delta_theta, flown.delta_v).samples(np.random.default_rng(3))
    (with_all, push_all), (without, push_without) = (response(s, CYCLES, reference, flown.used) for s in (samples, stated))
    extra = Extra((with_all - without)[..., None] / 0.1, (push_all - push_without)[..., None] / 0.1, 1.0)
    found = fit(stated, CYCLES, reference, flown.used, extra)
    assert found.extra[0] == pytest.approx(0.1, abs=4.5 * float(np.sqrt(found.extra_covariance[0, 0])))
    assert found.extra_covariance[0, 0] < 0.03**2


def test_the_response_is_what_the_linear_system_expects_of_its_reference() -> None:
    flown = flight.standard("free")
    samples = flown.samples()
    reference = Reference(tensor(flight.TRUTH[:6]), flight.TRUTH[6:9], 1 / flight.TRUTH[9])
    steps, force = response(samples, CYCLES, reference, flown.used)
    np.testing.assert_array_equal(steps, linearise(samples, CYCLES, reference, flown.used).steps)
    np.testing.assert_allclose(steps, np.diff(samples.rate_rad_s[CYCLES], axis=0), rtol=0, atol=3e-7)
    np.testing.assert_allclose(force, samples.specific_force_m_s2[CYCLES], rtol=0, atol=1e-4)
