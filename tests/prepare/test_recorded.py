"""A sensor's low-pass, undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare import recorded
from massprop_cli.testbed.simulate import SimulatedFlight
from tests.flown import fly

LAG_S = 0.07
SHORT = ["duration_s=10.0", 'plan=[{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s=0.0, end_s=10.0}]']

LAGGING = ["vehicle.imu.gyro_lag_s=0.04", f"vehicle.imu.accel_lag_s={LAG_S}"]


def flown(*keys: str) -> SimulatedFlight:
    return fly("free-flyer", *SHORT, *keys)


def by_definition(increments: Array, kept: float) -> Array:
    """(n, 3) a first-order low-pass from the first record on, by its sum of past records."""
    powers = (1 - kept) * kept ** np.arange(len(increments))
    return np.array([powers[: k + 1] @ increments[k::-1] + kept ** (k + 1) * increments[0] for k in range(len(increments))])


def test_what_a_low_pass_does_is_undone_record_by_record() -> None:
    flight = fly("free-flyer", "duration_s=2.0", SHORT[1].replace("10.0", "2.0"), "sensors.records_per_cycle=2")
    log, used = flight.log(0), flight.vehicle
    kept = np.exp(-log.interval_s[0] / LAG_S)
    seen = replace(log, delta_theta_imu_rad=by_definition(log.delta_theta_imu_rad, kept))
    stated = used.model_copy(update={"imu": used.imu.model_copy(update={"gyro_lag_s": LAG_S})})
    back = recorded.corrected_log(seen, stated)
    assert np.abs(seen.delta_theta_imu_rad - log.delta_theta_imu_rad).max() > 1e-3 * np.abs(log.delta_theta_imu_rad).max()
    np.testing.assert_allclose(back.delta_theta_imu_rad, log.delta_theta_imu_rad, atol=1e-12)
    assert back.delta_v_imu_m_s is log.delta_v_imu_m_s


def test_the_simulated_low_pass_is_the_definition() -> None:
    without, lagging = flown().log(0), flown(*LAGGING).log(0)
    gyro, accelerometer = (np.exp(-without.interval_s[0] / lag_s) for lag_s in (0.04, LAG_S))
    np.testing.assert_allclose(lagging.delta_theta_imu_rad, by_definition(without.delta_theta_imu_rad, gyro), atol=1e-12)
    np.testing.assert_allclose(lagging.delta_v_imu_m_s, by_definition(without.delta_v_imu_m_s, accelerometer), atol=1e-12)


def test_a_stated_low_pass_costs_nothing() -> None:
    """Undone, the log is the one without: values and sigmas are the same."""
    clean, lagging = flown(), flown(*LAGGING)
    with_it, without = (flow.examine(one.log(0), VehicleSource(one.vehicle, "", "")).conclusions[0].estimates for one in (lagging, clean))
    for name, estimate in without.items():
        assert estimate.value is not None
        assert estimate.sigma is not None
        assert with_it[name].value == pytest.approx(estimate.value, abs=0.2 * estimate.sigma)
        assert with_it[name].sigma == pytest.approx(estimate.sigma, rel=0.02)


def test_an_uncertain_low_pass_widens_the_sigmas_by_what_it_does() -> None:
    flight = flown(*LAGGING)
    log, used, sigma = flight.log(0), flight.vehicle, 0.004

    def masses(**keys: float) -> tuple[float, float]:
        changed = used.model_copy(update={"imu": used.imu.model_copy(update=keys)})
        mass = flow.examine(log, VehicleSource(changed, "", "")).conclusions[0].estimates["mass"]
        assert mass.value is not None
        assert mass.sigma is not None
        return mass.value, mass.sigma

    (_, plain), (_, wide) = masses(), masses(accel_lag_sigma_s=sigma)
    (low, _), (high, _) = masses(accel_lag_s=LAG_S - sigma / 4), masses(accel_lag_s=LAG_S + sigma / 4)
    moved = 2 * (high - low)
    assert wide**2 - plain**2 == pytest.approx(moved**2, rel=0.1)


@pytest.mark.parametrize(("lag_s", "records"), [(0.03, 1), (0.08, 1), (0.05, 2), (0.1, 5)])
def test_what_a_low_pass_leaves_of_a_cycles_variance(lag_s: float, records: int) -> None:
    """Against the determinant of the covariance of many cycles' means, of the low-pass written as a matrix."""
    record_s, cycles = 0.05 / records, 300
    kept = np.exp(-record_s / lag_s)
    count = cycles * records
    apart = np.subtract.outer(np.arange(count), np.arange(count))
    through = np.where(apart >= 0, (1 - kept) * kept ** np.maximum(apart, 0), 0.0)
    means = np.kron(np.eye(cycles), np.full((1, records), 1 / np.sqrt(records))) @ through
    covariance = means @ means.T
    part = slice(cycles // 2)
    # later cycles alone: the first ones are narrower still, nothing was before them
    logs = np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(covariance[part, part])[1]
    assert recorded.narrowed(lag_s, record_s, records) == pytest.approx(logs / (cycles - cycles // 2), rel=1e-6)
