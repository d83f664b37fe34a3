"""A stated low-pass with a wrong cutoff or latency is named and corrected, and a wrong delay is not taken for one.

So it is beside a delay that is stated, and beside one that the fit estimates with it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.diagnosis import diagnose, sensorkernel
from massprop_cli.diagnosis.fault import Diagnosis
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anyimu, flown

PERIOD_S, DELAY = 0.05, 2.0
CUTOFF = anyimu.Imu(rate_hz=200.0, order=2, cutoff_hz=20.0, latency_s=0.002)
LATENCY = anyimu.Imu(order=2, cutoff_hz=60.0, latency_s=0.008)


def examined(
    imu: anyimu.Imu, changes: dict[str, dict[str, Any]], delay: float | str = DELAY, sigma: float | None = None, **kind: bool
) -> tuple[Analysis, Array]:
    """A log of one body with its vehicle file, low-passes stated otherwise by sensor, and the ten quantities as they are."""
    rng = np.random.default_rng(3)
    own = anyimu.bodies(rng, 1, **kind)
    flown = anyimu.fly(rng, own, imu, PERIOD_S, 20.0, DELAY * PERIOD_S)
    used = anyimu.vehicle_of(own, 0, flown, imu, PERIOD_S, DELAY * PERIOD_S, stated=True)
    otherwise = {f"{sensor}_filter": getattr(used.imu, f"{sensor}_filter").model_copy(update=keys) for sensor, keys in changes.items()}
    uncertain = {} if sigma is None else {"command_delay_sigma_cycles": sigma}
    cycle = used.cycle.model_copy(update={"command_delay_cycles": delay, **uncertain})
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
        pytest.param(LATENCY, ("gyro",), "latency_s", 0.0, False, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(LATENCY, ("accel",), "latency_s", 0.0, True, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(CUTOFF, ("accel",), "cutoff_hz", 98.0, False, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(CUTOFF, ("gyro", "accel"), "cutoff_hz", 98.0, False, marks=[pytest.mark.thorough, pytest.mark.seeds]),
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


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(
    ("stated", "delay", "sigma", "bearing"),
    [(40.0, "auto", None, True), (98.0, "auto", None, False), (10.0, "auto", None, True), (40.0, DELAY, 0.1, False)],
)
def test_another_cutoff_is_named_beside_a_delay_that_takes_its_delay(
    stated: float, delay: float | str, sigma: float | None, bearing: bool
) -> None:
    """Of both sensors, each delay of 0.1 cycles more or less: values were up to 8 sigma off without a warning, or the cause unknown."""
    cutoff = {"cutoff_hz": stated}
    answer, truth = examined(CUTOFF, {"gyro": cutoff, "accel": cutoff}, delay, sigma, bearing=bearing)
    assert abs(answer.timing.delay - DELAY) > 0.1
    assert codes(answer) == ["gyro-filter", "accel-filter"]
    (mended,) = answer.mended
    said: dict[str, Any] = {name: configfile.literal(text) for name, _, text in (setting.partition("=") for setting in mended.settings)}
    for sensor in ("gyro", "accel"):
        name, sigma_key = f"imu.{sensor}_filter.cutoff_hz", f"imu.{sensor}_filter.cutoff_sigma_hz"
        assert abs(said[name] - CUTOFF.cutoff_hz) < 4 / 3 * said[sigma_key] < 8.0
    assert not any(name.startswith("cycle") for name in said)
    assert_within_four_sigmas(mended.conclusions[0], truth)


@pytest.mark.parametrize(
    "bearing", [pytest.param(False, marks=pytest.mark.thorough), pytest.param(True, marks=[pytest.mark.thorough, pytest.mark.seeds])]
)
def test_stated_low_passes_that_are_right_are_not_doubted_beside_a_delay_that_is_to_be_found(bearing: bool) -> None:
    answer, truth = examined(CUTOFF, {}, "auto", bearing=bearing)
    assert codes(answer) == []
    assert not answer.unknown
    assert_within_four_sigmas(answer.conclusions[0], truth)


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_cutoff_on_a_bearing_is_named_though_the_vertical_walks() -> None:
    """40 Hz for 80 Hz: the fit says so by seven sigma, and so does the reduction in which the gyro's noise carries the vertical off."""
    imu, wrong = replace(CUTOFF, cutoff_hz=40.0, gyro_noise=3e-4, accel_noise=0.01), {"cutoff_hz": 80.0}
    answer, truth = examined(imu, {"gyro": wrong, "accel": wrong}, "auto", bearing=True)
    assert codes(answer) == ["gyro-filter", "accel-filter"]
    (mended,) = answer.mended
    said: dict[str, Any] = {name: configfile.literal(text) for name, _, text in (setting.partition("=") for setting in mended.settings)}
    for sensor in ("gyro", "accel"):
        off = abs(said[f"imu.{sensor}_filter.cutoff_hz"] - imu.cutoff_hz)
        assert off < 2 * said[f"imu.{sensor}_filter.cutoff_sigma_hz"] < 20.0
    assert_within_four_sigmas(mended.conclusions[0], truth)


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_cutoff_that_is_refuted_and_not_named_is_in_the_sigmas(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same log, of which no hypothesis is found."""
    imu, wrong = replace(CUTOFF, cutoff_hz=40.0, gyro_noise=3e-4, accel_noise=0.01), {"cutoff_hz": 80.0}
    monkeypatch.setattr(diagnose, "diagnose", lambda *_: Diagnosis())
    answer, truth = examined(imu, {"gyro": wrong, "accel": wrong}, "auto", bearing=True)
    assert set(codes(answer)) == {"cause-unknown", "model-discrepancy"}
    assert "another cutoff" in answer.unknown
    assert_within_four_sigmas(answer.conclusions[0], truth)
    assert answer.discrepancies[0] is not None


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_wrong_delay_behind_stated_low_passes_is_named_as_such() -> None:
    answer, truth = examined(LATENCY, {}, delay=1.7)
    assert codes(answer) == ["delay-mismatch"]
    (mended,) = answer.mended
    assert mended.settings[0].startswith("cycle.command_delay_cycles=")
    assert_within_four_sigmas(mended.conclusions[0], truth)


@pytest.mark.thorough
@pytest.mark.seeds
def test_latencies_of_both_sensors_with_their_sigmas_are_estimated_with_the_delay() -> None:
    """All three are one shift in time, and what is stated of each parts them: it was a delay that differs from the stated one."""
    uncertain = {"latency_s": 0.0, "latency_sigma_s": 0.008}
    answer, truth = examined(LATENCY, {"gyro": uncertain, "accel": uncertain})
    assert codes(answer) == []
    for low_pass in (answer.vehicle.imu.gyro_filter, answer.vehicle.imu.accel_filter):
        assert low_pass is not None
        assert abs(low_pass.latency - 0.008) < 4 * low_pass.latency_sigma_s < 0.006
    assert_within_four_sigmas(answer.conclusions[0], truth)


def test_a_delay_that_is_to_be_found_between_samples_is_no_low_pass() -> None:
    """Commands come a third of a sample later than a step of the search for the delay; a low-pass would make up for that."""
    settings = ('vehicle.imu.measures="sample"', "sensors.records_per_cycle=5", "vehicle.cycle.command_delay_cycles=2.066")
    flight = flown.fly("free-flyer", *flown.RANDOM, *settings, seeds=(1,))
    cycle = flight.vehicle.cycle.model_copy(update={"command_delay_cycles": "auto"})
    source = VehicleSource(flight.vehicle.model_copy(update={"cycle": cycle}), "t", "")
    assert sensorkernel.found(flight.log(0), source, lambda *_: None).source is source
