"""What coefficients multiply: the kernel and NumPy say the same, and the response is made of it."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.rigidbody import times
from massprop_cli.model import regressors as module
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import integrals_about, regressors
from tests import flight

pytestmark = pytest.mark.numerical


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_either_form_says_the_same_and_the_response_is_made_of_it(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    flown = flight.standard(kind)
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    about = Reference(np.array(truth)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3), np.array(truth[6:9]), 1 / truth[9])
    samples, used = flown.samples(), flown.resolved
    step, mean, known = integrals_about(samples, about, used)
    whole = regressors(samples, slice(0, len(samples)), about, used)
    response = plant_of(used).response(plant_of(used).theta(about))
    np.testing.assert_allclose(times(response, step) + known, whole.steps, atol=1e-12)
    monkeypatch.setattr(module, "in_kernel", lambda _: False)
    for one, other in zip((step, mean, known), integrals_about(samples, about, used), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
