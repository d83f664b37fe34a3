"""A vehicle in which no noise level is left open."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.resolved import Resolved
from tests import flight
from tests.faulty import stated


@pytest.mark.parametrize("level", [None, 0.0])
@pytest.mark.parametrize("sensor", ["gyro_noise_rad_s", "accel_noise_m_s2"])
def test_what_is_open_or_zero_is_no_noise_level(sensor: str, level: float | None) -> None:
    used = flight.vehicle()
    open_ = used.model_copy(update={"imu": used.imu.model_copy(update={sensor: level})})
    assert Resolved.stated(used) is not None
    assert Resolved.stated(open_) is None


def test_all_else_is_as_it_was_stated() -> None:
    used = stated(flight.vehicle(), "estimator.accel_noise_scale=[1.0,2.0,0.5]")
    found = Resolved.of(used, 2e-4, 0.03)
    assert found.model_fields_set - {"imu"} == used.model_fields_set - {"imu"}
    assert found.imu.model_fields_set >= used.imu.model_fields_set
    levels = {"gyro_noise_rad_s": 2e-4, "accel_noise_m_s2": 0.03}
    assert found.model_dump() == used.model_dump() | {"imu": used.imu.model_dump() | levels}
    np.testing.assert_allclose(found.noise, [2e-4, 2e-4, 2e-4, 0.03, 0.06, 0.015], rtol=1e-15)


def test_it_is_resolved_in_every_phase() -> None:
    phase = Phase.model_validate({"name": "late", "start_s": 1.0, "end_s": 2.0, "known": {"mass": {"value": 22.0, "sigma": 0.1}}})
    found = flight.resolved(flight.vehicle()).in_phase(phase)
    assert isinstance(found, Resolved)
    assert isinstance(found, Vehicle)
    assert found.known["mass"].value == 22.0
