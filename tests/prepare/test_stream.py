from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from massprop_cli.base.arrays import grown, triangle_of
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.prepare import stream
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from tests import flight

PARTS = [slice(2, 20), slice(18, 150), slice(149, 150), slice(60, 140), slice(300, 320), slice(0, 320)]


@pytest.fixture(autouse=True)
def many_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "GRID", 16)
    monkeypatch.setattr(stream, "MIN_PART", 48)


def recorded(kind: str) -> tuple[Log, Vehicle]:
    flown = flight.standard(kind)
    return flown.log(np.random.default_rng(3)), flown.used


def arrays(samples: Samples) -> dict[str, Any]:
    own = {field.name: getattr(samples, field.name) for field in fields(Samples) if field.name != "executed"}
    aligned = {field.name: getattr(samples.executed, field.name) for field in fields(Aligned) if field.name != "channels"}
    channels = samples.executed.channels
    return own | aligned | {"channels rising": channels.rising, "channels whole": channels.whole}


def same(parts: Stream, whole: Samples, rounding: float = 1e-12) -> None:
    for cycles in PARTS:
        expected = arrays(whole.part(cycles))
        for name, found in arrays(parts.part(cycles)).items():
            if found is None:
                assert expected[name] is None
            else:
                scale = np.abs(expected[name]).max(initial=1e-3)
                np.testing.assert_allclose(found, expected[name], rtol=0, atol=rounding * scale, err_msg=f"{name} of {cycles}")


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
@pytest.mark.parametrize("timing", [Timing(0.0, 0.0), Timing(2.3, 0.0), Timing(1.0, 0.4)])
def test_a_part_of_a_log_is_what_it_is_of_the_whole(kind: str, timing: Timing) -> None:
    log, used = recorded(kind)
    same(Stream.of(log, used, timing), timing.of(log, used))


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_what_a_sensor_shows_goes_back_across_parts(kind: str) -> None:
    """A slow low-pass of records that are samples, on a clock of their own."""
    log, used = recorded(kind)
    used = changed(used, ["imu.gyro_filter={order=2, cutoff_hz=2}", "imu.accel_filter={order=1, cutoff_hz=1, latency_s=0.2}"])
    log = replace(log, command_s=log.command_start_s + 0.011, sampled=(True, True))
    # second integrals from further back on are rounded more
    same(Stream.of(log, used, Timing(1.3, 0.0)), Timing(1.3, 0.0).of(log, used), 1e-9)


def test_jets_held_on_and_slow_to_rise_and_fall_act_across_parts() -> None:
    log, used = recorded("free")
    command = log.command.copy()
    command[40:140, 0] = used.cycle.period_s
    slow = used.model_copy(update={"jets": tuple(jet.model_copy(update={"rise_s": 0.3, "fall_s": 0.2}) for jet in used.jets)})
    held = replace(log, command=command)
    same(Stream.of(held, slow, Timing(1.7, 0.0)), Timing(1.7, 0.0).of(held, slow))


def test_a_wrench_is_held_across_parts_and_records_may_be_several_to_a_cycle() -> None:
    log, used = recorded("free")
    wrench = np.repeat(np.random.default_rng(1).standard_normal((16, 6)), 20, axis=0)
    held = replace(log, command_kind="wrench", command=wrench)
    same(Stream.of(held, used, Timing(0.5, 0.2)), Timing(0.5, 0.2).of(held, used))
    fine: dict[str, Any] = {
        name: np.repeat(getattr(log, name) / 2, 2, axis=0) for name in ("interval_s", "delta_theta_imu_rad", "delta_v_imu_m_s")
    }
    halves = replace(log, records_per_cycle=2, time_s=np.cumsum(fine["interval_s"]), **fine)
    same(Stream.of(halves, used, Timing(2.0, 0.0)), Timing(2.0, 0.0).of(halves, used))


def test_another_imu_shares_the_commands() -> None:
    log, used = recorded("air_bearing")
    about_x = [[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]]
    turned = used.model_copy(update={"imu": used.imu.model_copy(update={"body_from_imu": about_x})})
    plain = Stream.of(log, used, Timing(2.0, 0.0))
    same(plain.changed(turned), Timing(2.0, 0.0).of(log, turned))
    scaled = replace(log, delta_theta_imu_rad=1.01 * log.delta_theta_imu_rad)
    same(plain.changed(gyro=1.01), Timing(2.0, 0.0).of(scaled, used))


@pytest.mark.numerical
@pytest.mark.parametrize("size", [1e-2, 1.0, 1e5])
def test_a_triangle_grown_by_products_is_that_of_all_rows(size: float) -> None:
    """A block that tells little, as much, and far more than what is known."""
    rng = np.random.default_rng(4)
    triangle, rows = triangle_of(rng.standard_normal((9, 6)))[:4], size * rng.standard_normal((5, 3, 6))
    found = grown(triangle, rows)
    for k in range(6):
        every = np.vstack([triangle, *rows[:k]])
        expected = np.linalg.lstsq(every[:, :4], every[:, 4:], rcond=None)[0]
        np.testing.assert_allclose(np.linalg.solve(found[k, :, :4], found[k, :, 4:]), expected, rtol=1e-9)
        np.testing.assert_allclose(found[k, :, :4].T @ found[k, :, :4], every[:, :4].T @ every[:, :4], rtol=1e-9, atol=1e-9 * size**2)
