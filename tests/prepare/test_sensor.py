"""What sensors show of commands, against a differential equation solved in small steps and windows summed on a fine grid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.actuators.rotor import Held, thrust_integrals
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.kernel import Kernel, kernel
from massprop_cli.prepare import align
from massprop_cli.prepare import sensor as sensor_module
from massprop_cli.prepare.sensor import SensedSignal, SensorKernel, sensed
from massprop_cli.prepare.signal import Signal, signal_of_bins, window_integrals
from tests import flight
from tests.flown import fly

pytestmark = pytest.mark.numerical
BENDS = Signal(np.array([0.01, 0.02, 0.055, 0.055, 0.09]), np.array([1.0, 0.0, -0.5, 0.2, 0.0]), np.array([0.0, 8.0, -8.0, 3.0, -3.0]))


def value(time_s: float) -> float:
    began = BENDS.time_s < time_s
    return float((BENDS.step + BENDS.slope * (time_s - BENDS.time_s))[began].sum())


def by_equation(order: int, cutoff_hz: float, lag_s: float, time_s: Array) -> Array:
    """(Q, 3) the signal behind a Butterworth low-pass and a lag, and its integrals, by an integrator that knows nothing of exponentials."""
    w = 2 * np.pi * cutoff_hz

    def slope(t: float, x: Array) -> Array:
        u = value(t)
        lagged = x[0] if lag_s else u
        first = (u - x[0]) / lag_s if lag_s else 0.0
        if order == 1:
            inner = [w * (lagged - x[1]), 0.0]
        elif order == 2:
            inner = [x[2], w**2 * (lagged - x[1]) - np.sqrt(2) * w * x[2]]
        else:
            inner = [0.0, 0.0]
        y = x[1] if order else lagged
        return np.array([first, *inner, y, x[3]])

    found, now, at = [], np.zeros(5), 0.0
    for t in time_s:
        for end in [*BENDS.time_s[(BENDS.time_s > at) & (BENDS.time_s < t)], t]:
            now = solve_ivp(slope, (at, end), now, rtol=1e-10, atol=1e-13, max_step=1e-3).y[:, -1]
            at = end
        y = now[1] if order else now[0] if lag_s else value(t)
        found.append([y, now[3], now[4]])
    return np.array(found)


def parts(at: SensedSignal) -> list[Array]:
    """The signal and both integrals."""
    return [at.value, at.first, at.second]


@pytest.mark.parametrize(("order", "lag_s"), [(0, 0.0), (0, 0.01), (1, 0.0), (2, 0.0), (2, 0.01), (1, 1 / (2 * np.pi * 30.0))])
@pytest.mark.parametrize("by", [kernel(), Kernel(None, "NumPy")])
def test_a_signal_behind_a_low_pass_and_its_integrals_solve_its_equation(
    order: int, lag_s: float, by: Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensor_module, "kernel", lambda: by)
    time_s = np.array([0.005, 0.0101, 0.033, 0.055, 0.07, 0.13])
    sensor = SensorKernel.of(instant=True, low_pass=LowPass(order=order, cutoff_hz=30.0) if order else None, lag_s=lag_s)
    found = np.stack(parts(sensed(BENDS, sensor, time_s)), 1)
    # the same lag twice is taken as two that differ by a little
    tolerance = 1e-5 if order == 1 and lag_s else 1e-8
    np.testing.assert_allclose(found, by_equation(order, 30.0, lag_s, time_s), atol=tolerance)


def test_a_latency_shows_the_signal_of_before() -> None:
    time_s = np.linspace(0.02, 0.2, 40)
    late = SensorKernel.of(instant=True, low_pass=LowPass(order=2, cutoff_hz=25.0, latency_s=0.004))
    prompt = SensorKernel.of(instant=True, low_pass=LowPass(order=2, cutoff_hz=25.0))
    np.testing.assert_allclose(parts(sensed(BENDS, late, time_s)), parts(sensed(BENDS, prompt, time_s - 0.004)), atol=1e-12)
    assert late.delay_s == pytest.approx(0.004 + np.sqrt(2) / (2 * np.pi * 25.0))


def test_a_sample_shows_what_went_before_a_pulse_that_begins_at_its_time() -> None:
    step = Signal(np.array([0.3]), np.array([1.0]), np.array([0.0]))
    found = sensed(step, SensorKernel.of(instant=True, low_pass=None), np.array([0.1 * 3, 0.3 + 1e-6])).value
    np.testing.assert_array_equal(found, [0.0, 1.0])


def test_a_signal_by_bins_has_their_integrals_and_moments() -> None:
    edges = np.cumsum([0.0, 0.02, 0.03, 0.01, 0.04])
    integral, moment = window_integrals([BENDS], edges)
    again = window_integrals([signal_of_bins(edges, integral[:, 0], moment[:, 0])], edges)
    np.testing.assert_allclose(again[0], integral, atol=1e-14)
    np.testing.assert_allclose(again[1], moment, atol=1e-14)


def impulses(used: Vehicle, on: Array, records: int, sampled: bool, offset_s: float = 0.0) -> align.Impulses:
    """Of the jets' on-times (K, C) in a log of so many records a cycle; commands come ``offset_s`` after records begin."""
    count = len(on) * records
    step = flight.CYCLE / records
    time_s, still = step * np.arange(1, count + 1), np.zeros((count, 3))
    command_s = flight.CYCLE * np.arange(len(on)) + offset_s
    log = Log(Path("x"), "", count, records, time_s, np.full(count, step), still, still, "jets", on, None, ())
    log = replace(log, command_s=command_s, sampled=(sampled, sampled))
    return align.impulses(log, used, float(used.cycle.command_delay_cycles), used.thrust.stated_lag_s)


def test_a_low_pass_far_above_all_else_leaves_increments_as_they_are() -> None:
    """The windows of any kernel, those of a box among them."""
    on = flight.pulses(60)
    imu = {key: {"order": 1, "cutoff_hz": 1e8} for key in ("gyro_filter", "accel_filter")}
    plain, filtered = (impulses(flight.vehicle(imu=own, delay=1.3), on, 1, sampled=False) for own in ({}, imu))
    for one, other in zip(plain[2:7], filtered[2:7], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)


@pytest.mark.parametrize("records", [1, 5])
def test_samples_are_read_off_at_records_ends(records: int) -> None:
    """Against the thrust on a grid of 10 microseconds, summed: of the gyro steps of its mean, of the accelerometer its mean itself."""
    on, delay, offset_s = flight.pulses(40, seed=4), 1.25, 0.0031
    used = flight.vehicle(delay=delay)
    found = impulses(used, on, records, sampled=True, offset_s=offset_s)
    grid_s = 1e-5
    time = grid_s * (np.arange(round(40 * flight.CYCLE / grid_s)) + 0.5)
    thrust = np.stack([flight.thrust_fraction(on[:, [jet]], delay, 0.0, time - offset_s)[:, 0] for jet in range(18)], 1)
    turned = np.cumsum(thrust, 0) * grid_s
    at = np.round(flight.CYCLE / records * np.arange(1, 40 * records + 1) / grid_s).astype(int) - 1
    mean = turned[at].reshape(40, records, 18).mean(1)
    np.testing.assert_allclose(found.rising[:-1] + found.falling[1:], np.diff(mean, axis=0), atol=2 * grid_s)
    np.testing.assert_allclose(found.whole, flight.CYCLE * thrust[at].reshape(40, records, 18).mean(1), atol=1e-12)


def test_what_is_shown_in_all_is_what_was_commanded() -> None:
    on = flight.pulses(80, last=60)
    imu = {"gyro_filter": {"order": 2, "cutoff_hz": 15.0}, "accel_filter": {"order": 1, "cutoff_hz": 12.0, "latency_s": 0.006}}
    found = impulses(flight.vehicle(imu=imu, delay=2.0), on, 4, sampled=False)
    for each in (found.whole, found.rising + found.falling, found.integral.sum(1)):
        np.testing.assert_allclose(each.sum(0), on[:60].sum(0), atol=1e-9)


@pytest.mark.parametrize("name", ["wheels", "wheels-and-jets", "control-moment-gyros"])
def test_what_any_actuator_does_goes_through_the_same_kernel(name: str) -> None:
    """A low-pass far above all else leaves torques of wheels and gyros and the momentum that they hold as they are."""
    plan = 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=6}]'
    flown = fly(name, "duration_s=6", plan)
    log = flown.log(0)
    filtered = changed(flown.vehicle, [f"imu.{sensor}_filter={{order=1, cutoff_hz=1e8}}" for sensor in ("gyro", "accel")])
    plain, shown_by = (align.align(log, used, 2.0, 0.0) for used in (flown.vehicle, filtered))
    for part in ("rising", "falling", "whole", "impulse_bins"):
        np.testing.assert_allclose(getattr(shown_by, part), getattr(plain, part), atol=1e-7, err_msg=part)
    if plain.stored is not None:
        assert shown_by.stored is not None
        np.testing.assert_allclose(shown_by.stored.mean, plain.stored.mean, atol=1e-7)


def test_rotors_go_through_it_bin_by_bin() -> None:
    """Their thrust follows exponentials, taken as linear in each quarter of a bin: to a thousandth of it."""
    begun = 0.05 * np.arange(60)
    rotor = Held(begun, np.random.default_rng(1).uniform(0.2, 1.0, 60), 0.03, 0.05, (0.0, 0.5, 1.0))
    edges = 0.05 / 16 * np.arange(16 * 50 + 1)
    integral, moment = thrust_integrals([rotor], edges)
    signal = signal_of_bins(edges, integral[:, 0], moment[:, 0])
    sensor = SensorKernel.of(instant=True, low_pass=LowPass(order=1, cutoff_hz=20.0))
    found = sensed(signal, sensor, edges[160::16])
    fine = 0.05 / 640 * np.arange(640 * 50 + 1)
    exact, later = thrust_integrals([rotor], fine)
    other = sensed(signal_of_bins(fine, exact[:, 0], later[:, 0]), sensor, edges[160::16])
    np.testing.assert_allclose(found.value, other.value, rtol=1e-3)
    np.testing.assert_allclose(found.first, other.first, rtol=1e-5)
