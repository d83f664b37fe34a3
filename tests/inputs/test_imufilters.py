"""Low-passes of common IMUs by name."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from massprop_cli.inputs import imufilters
from massprop_cli.inputs.equipment import Imu, LowPass
from massprop_cli.prepare.sensor import SensorKernel


def of(**stated: object) -> LowPass:
    found = Imu.model_validate({"gyro_filter": stated}).gyro_filter
    assert found is not None
    return found


def test_a_preset_has_the_bandwidth_and_the_delay_of_its_data_sheet() -> None:
    """MPU-6050, DLPF_CFG = 2: 98 Hz and 2.8 ms; a Butterworth of the second order has 2.30 ms of these."""
    low_pass = of(preset="mpu6050-dlpf-2")
    assert (low_pass.order, low_pass.cutoff_hz, low_pass.preset) == (2, 98.0, "mpu6050-dlpf-2")
    assert math.isclose(low_pass.latency + math.sqrt(2) / (2 * math.pi * 98.0), 2.8e-3)
    assert low_pass.cutoff_sigma_hz == pytest.approx(9.8)
    assert low_pass.latency_sigma_s == 5e-4


@pytest.mark.parametrize(
    ("sensor", "preset", "cutoff_hz"),
    [
        ("gyro", "bmi160-100hz-norm", 39.9),
        ("accel", "bmi160-100hz-norm", 40.5),
        ("accel", "bmi160-50hz-osr4", 5.06),  # which the data sheet states itself
        ("gyro", "bmi270-gyro-188hz", 188.0),
        ("accel", "bmi088-accel-40hz", 40.0),
    ],
)
def test_bosch_imus_have_the_bandwidths_of_their_output_rates(sensor: str, preset: str, cutoff_hz: float) -> None:
    low_pass = LowPass.model_validate(imufilters.resolved(sensor, {"preset": preset}))
    assert low_pass.cutoff == pytest.approx(cutoff_hz, rel=2e-3)
    assert (low_pass.order, low_pass.latency) == (2, 0.0)
    assert low_pass.latency_sigma_s > 0.25 * math.sqrt(2) / (2 * math.pi * cutoff_hz)


def test_what_is_stated_replaces_a_key_of_the_preset() -> None:
    low_pass = of(preset="bmi088-gyro-47hz", latency_s=0.002, latency_sigma_s=0.0)
    assert (low_pass.cutoff_hz, low_pass.latency, low_pass.latency_sigma_s) == (47.0, 0.002, 0.0)
    again = Imu.model_validate(Imu(gyro_filter=low_pass).model_dump()).gyro_filter
    assert again == low_pass


def test_every_preset_is_a_low_pass_without_negative_latency_and_with_a_source() -> None:
    for name, own in imufilters.table().items():
        assert own["source"].split()[0] in ("InvenSense", "Bosch", "Analog", "VectorNav")
        for sensor in {"gyro", "accel"} & own.keys():
            stated = own[sensor].get("delay_ms")
            low_pass = LowPass.model_validate(imufilters.resolved(sensor, {"preset": name}))
            delay_ms = 1e3 * (low_pass.latency + (2**0.5 if low_pass.order == 2 else 1.0) / (2 * math.pi * low_pass.cutoff))
            assert low_pass.latency >= 0
            assert stated is None or abs(delay_ms - stated) < 1.01e3 * low_pass.latency_sigma_s


@pytest.mark.parametrize(("preset", "stages"), [("adis16475-filt-4", 2), ("adis16475-filt-1", 2), ("vn100-window-8", 1)])
def test_means_one_after_the_other_have_the_delay_and_the_variance_of_their_weights(preset: str, stages: int) -> None:
    taps, rate_hz = (imufilters.table()[preset]["gyro"][key] for key in ("taps", "rate_hz"))
    assert len(taps) == stages
    weights = np.ones(1)
    for count in taps:
        weights = np.convolve(weights, np.full(count, 1 / count))
    when_s = np.arange(len(weights)) / rate_hz
    mean = weights @ when_s
    sensor = SensorKernel.of(True, of(preset=preset))
    assert sensor.delay_s == pytest.approx(mean)
    assert sensor.variance_s2 == pytest.approx(weights @ (when_s - mean) ** 2)


def test_an_order_without_a_low_pass_has_a_latency_alone() -> None:
    assert SensorKernel.of(False, of(order=0, latency_s=0.03)).delay_s == 0.03
    for stated, words in (
        ({"order": 0, "cutoff_hz": 40.0}, "order = 0 has no cutoff_hz"),
        ({"order": 0, "cutoff_sigma_hz": 4.0}, "no cutoff_sigma_hz"),
        ({"latency_s": 0.03}, "order = 2 needs cutoff_hz"),
    ):
        with pytest.raises(ValidationError, match=words):
            of(**stated)


def test_a_preset_that_is_none_is_refused_with_the_nearest() -> None:
    with pytest.raises(ValidationError, match=r"preset 'mpu6050-dlp-2' is none of this sensor; the nearest is 'mpu6050-dlpf-2'"):
        of(preset="mpu6050-dlp-2")
    with pytest.raises(ValidationError, match=r"preset 'bmi088-gyro-47hz' is none of this sensor"):
        Imu.model_validate({"accel_filter": {"preset": "bmi088-gyro-47hz"}})
