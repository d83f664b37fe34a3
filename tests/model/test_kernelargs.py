"""The compiled kernel's response of many cycles is NumPy's."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from massprop_cli.kernel import kernel
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import Regressors, regressors
from massprop_cli.model.responsemap import ResponseMap
from tests.analysed import analysed

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the response runs on {kernel().name}")


@pytest.mark.parametrize("onto", [False, True], ids=["every coefficient", "combined"])
@pytest.mark.parametrize("nuisances", [False, True], ids=["rate alone", "every nuisance"])
@pytest.mark.parametrize("name", ["free-flyer", "air-bearing", "high-rate"])
def test_the_response_agrees(name: str, nuisances: bool, onto: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    found = analysed(name)
    vehicle, about = found.vehicle, found.histories[0].reference
    assert about is not None
    if nuisances:
        imu = vehicle.imu.model_copy(update={"gyro_bias_sigma_rad_s": 0.01, "accel_bias_sigma_m_s2": 0.1})
        walk = vehicle.environment.model_copy(update={"disturbance_walk_n_m": 1e-3})
        vehicle = vehicle.model_copy(update={"imu": imu, "environment": walk})
        about = Reference(1.3 * about.inertia, about.cg + 0.01, 0.9 * about.mu, np.array([1e-3, -2e-3, 3e-3]))
    phi_map = ResponseMap(plant_of(vehicle))
    combined = np.random.default_rng(3).standard_normal((phi_map.size, 4)) if onto else None
    cycles = slice(20, 150)
    own = regressors(found.samples, cycles, about, vehicle, combined)
    monkeypatch.setattr("massprop_cli.model.regressors.in_kernel", lambda _: False)
    other = regressors(found.samples, cycles, about, vehicle, combined)
    for field in fields(Regressors):
        a, b = getattr(own, field.name), getattr(other, field.name)
        assert a.shape == b.shape
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11 * np.abs(b).max(), err_msg=field.name)
