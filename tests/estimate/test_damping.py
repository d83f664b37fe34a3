"""A torque against the rate that is looked for: errors and sigmas against the Cramér–Rao bound that counts it, and what of it is found."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate
from tests import cramerrao

SEEDS = 4
ALL = 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=10.0}]'
ON_TABLE = 'plan=[{motion="random", axes=["x", "y", "yaw"], start_s=0.0, end_s=10.0}]'
BY_BOTH = (
    'plan=[{motion="random", axes=["roll", "pitch", "yaw"], by_wheels=true, start_s=0.0, end_s=5.0}, '
    '{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=5.0, end_s=10.0}]'
)
CASES = {
    "free-flyer": (ALL, (0.05, 0.04, 0.06)),
    "testbed": (ALL, (0.02, 0.1, 0.08)),
    "planar": (ON_TABLE, (0.0, 0.0, 0.02)),
    "wheels-and-jets": (BY_BOTH, (0.05, 0.04, 0.06)),
}
"""A plan of 10 s, and the torque against the rate about each axis over it, N m s: a turn dies away within ten seconds to a minute."""
NAMES = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.thorough] * (name in ("testbed", "planar", "wheels-and-jets"))) for name in CASES]
)


class Found(NamedTuple):
    """(S, n) errors and sigmas of what is told, (n,) the first one's bound; (S, 3, 2) the damping that was found, with its sigma."""

    error: Array
    sigma: Array
    bound: Array
    damping: Array
    warnings: tuple[str, ...]


@cache
def flown(name: str) -> Found:
    plan, damping = CASES[name]
    keys = ["duration_s=10.0", plan, f"disturbance.rate_n_m_s={list(damping)}", "vehicle.environment.damping_sigma_n_m_s=0.2"]
    source = scenario.load(name, keys)
    flights = simulate.fly(source, range(1, SEEDS + 1))
    found = [flow.examine(flights.log(i), VehicleSource(flights.vehicle, name, "")) for i in range(SEEDS)]
    told = np.isfinite(found[0].conclusions[0].values)
    limit = np.sqrt(np.diag(cramerrao.cramer_rao(source, flights, 0)[0]))
    responses = [analysis.examination.responses[0] for analysis in found if analysis.examination is not None]
    return Found(
        np.array([analysis.conclusions[0].values for analysis in found])[:, told] - flights.truth[:, 0][:, told],
        np.sqrt([np.diag(analysis.conclusions[0].covariance) for analysis in found])[:, told],
        limit[told],
        np.array([response.damping for response in responses if response is not None]),
        tuple(notice.code for analysis in found for notice in analysis.notices),
    )


@NAMES
def test_errors_are_those_of_the_bound_and_the_sigmas_honest(name: str) -> None:
    found = flown(name)
    assert found.warnings == ()
    np.testing.assert_allclose(found.sigma[0], found.bound, rtol=0.1)
    over = np.sqrt(((found.error / found.sigma) ** 2).mean())
    assert abs(over - 1) < 4 / np.sqrt(2 * found.error.size)  # of unit normal deviates, four standard deviations


@NAMES
def test_what_is_found_of_the_damping_is_what_acted(name: str) -> None:
    axes = slice(2, 3) if name == "planar" else slice(None)
    found, true = flown(name).damping[:, axes], np.array(CASES[name][1])[axes]
    z = (found[..., 0] - true) / found[..., 1]
    assert (found[..., 1] < 0.1 * true).all()
    assert 0.4 < np.sqrt((z**2).mean()) < 1.7  # of eight or more, one in a thousand is outside
    assert np.abs(z).max() < 4.5


@pytest.mark.thorough
@pytest.mark.numerical
def test_a_table_tells_no_damping_but_of_yaw() -> None:
    np.testing.assert_allclose(flown("planar").damping[:, :2], [[[0.0, 0.2]] * 2] * SEEDS, atol=1e-12)


@pytest.mark.numerical
def test_what_damping_does_to_a_far_imu_is_no_misfit() -> None:
    """A sharp accelerometer 27 cm from O feels the damping as angular acceleration; what is found of it leaves nothing to contradict."""
    plan, damping = CASES["free-flyer"]
    far = ("vehicle.imu.position_m=[0.1, 0.2, -0.15]", "vehicle.imu.accel_noise_m_s2=1e-3", "vehicle.imu.gyro_noise_rad_s=5e-5")
    keys = [
        "duration_s=10.0",
        plan,
        f"disturbance.rate_n_m_s={[4 * d for d in damping]}",
        "vehicle.environment.damping_sigma_n_m_s=0.5",
        *far,
    ]
    flights = simulate.fly(scenario.load("free-flyer", keys), [1, 2])
    for i in range(2):
        analysis = flow.examine(flights.log(i), VehicleSource(flights.vehicle, "", ""))
        assert not [notice.message for notice in analysis.notices]
        assert all(e.verdict == "converged" for name, e in analysis.conclusions[0].estimates.items() if name != "mass")
