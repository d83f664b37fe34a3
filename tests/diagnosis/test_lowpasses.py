"""A stated low-pass with a wrong cutoff or latency is named and corrected, and a wrong delay is not taken for one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anyimu

PERIOD_S, DELAY = 0.05, 2.0
CUTOFF = anyimu.Imu(rate_hz=200.0, order=2, cutoff_hz=20.0, latency_s=0.002)
LATENCY = anyimu.Imu(order=2, cutoff_hz=60.0, latency_s=0.008)


def examined(imu: anyimu.Imu, changes: dict[str, dict[str, Any]], delay: float | str = DELAY, **kind: bool) -> tuple[Analysis, Array]:
    """A log of one body with its vehicle file, low-passes stated otherwise by sensor, and the ten quantities as they are."""
    rng = np.random.default_rng(3)
    own = anyimu.bodies(rng, 1, **kind)
    flown = anyimu.fly(rng, own, imu, PERIOD_S, 20.0, DELAY * PERIOD_S)
    used = anyimu.vehicle_of(own, 0, flown, imu, PERIOD_S, DELAY * PERIOD_S, stated=True)
    otherwise = {f"{sensor}_filter": getattr(used.imu, f"{sensor}_filter").model_copy(update=keys) for sensor, keys in changes.items()}
    cycle = used.cycle.model_copy(update={"command_delay_cycles": delay})
    used = used.model_copy(update={"imu": used.imu.model_copy(update=otherwise), "cycle": cycle})
    return flow.examine(anyimu.log_of(flown, 0, imu, used), VehicleSource(used, "any-imu", "")), anyimu.truth_of(own, 0)


def codes(answer: Analysis) -> list[str]:
    """Of all warnings but those of the noise."""
    return [notice.code for notice in answer.notices if not notice.code.startswith("noise")]


def assert_within_four_sigmas(conclusion: Conclusion, truth: Array) -> None:
    found = [conclusion.estimates[name] for name in QUANTITIES]
    value, sigma = (np.array([getattr(one, part) for one in found], dtype=float) for part in ("value", "sigma"))
    assert np.abs((value - truth) / sigma).max() < 4


@pytest.mark.parametrize(
    ("imu", "sensors", "key", "stated", "bearing"),
    [
        (LATENCY, ("gyro",), "latency_s", 0.0, False),
        pytest.param(LATENCY, ("accel",), "latency_s", 0.0, True, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(CUTOFF, ("accel",), "cutoff_hz", 98.0, False, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(CUTOFF, ("gyro", "accel"), "cutoff_hz", 98.0, False, marks=pytest.mark.thorough),
        pytest.param(CUTOFF, ("gyro", "accel"), "cutoff_hz", 98.0, True, marks=[pytest.mark.thorough, pytest.mark.seeds]),
    ],
)
def test_another_cutoff_or_latency_is_named_with_its_value(
    imu: anyimu.Imu, sensors: tuple[str, ...], key: str, stated: float, bearing: bool
) -> None:
    """A late accelerometer or two slow sensors were a cause unknown; a late gyro a lag beside its low-pass, or a delay of the commands."""
    answer, truth = examined(imu, {sensor: {key: stated} for sensor in sensors}, bearing=bearing)
    assert codes(answer) == [f"{sensor}-filter" for sensor in sensors]
    (mended,) = answer.mended
    said: dict[str, Any] = {name: configfile.literal(text) for name, _, text in (setting.partition("=") for setting in mended.settings)}
    for sensor in sensors:
        name, sigma_key = f"imu.{sensor}_filter.{key}", f"imu.{sensor}_filter.{key.replace('_', '_sigma_')}"
        assert f"and not {name} = {stated:g}" in answer.notices[0].message
        assert abs(said[name] - getattr(imu, key)) < 4 * said[sigma_key] < 0.4 * abs(stated - getattr(imu, key))
    assert not any(name.startswith("cycle") for name in said)
    assert_within_four_sigmas(mended.conclusions[0], truth)


def test_a_wrong_delay_behind_stated_low_passes_is_named_as_such() -> None:
    answer, truth = examined(LATENCY, {}, delay=1.7)
    assert codes(answer) == ["delay-mismatch"]
    (mended,) = answer.mended
    assert mended.settings[0].startswith("cycle.command_delay_cycles=")
    assert_within_four_sigmas(mended.conclusions[0], truth)


def test_latencies_of_both_sensors_with_their_sigmas_are_estimated_with_the_delay() -> None:
    """All three are one shift in time, and what is stated of each parts them: it was a delay that differs from the stated one."""
    uncertain = {"latency_s": 0.0, "latency_sigma_s": 0.008}
    answer, truth = examined(LATENCY, {"gyro": uncertain, "accel": uncertain})
    assert codes(answer) == []
    for low_pass in (answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter):
        assert low_pass is not None
        assert abs(low_pass.latency - 0.008) < 4 * low_pass.latency_sigma_s < 0.006
    assert_within_four_sigmas(answer.conclusions[0], truth)
