from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.equipment import Failure, Jet
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare.actuators import check_supply, held, jet_integrals, pulse_integrals, pulses
from massprop_cli.prepare.align import align, first_usable_s
from massprop_cli.prepare.signal import Signal, window_integrals
from tests import faulty, flight
from tests.flown import RANDOM, fly

EDGES = np.linspace(0.0, 1.0, 21)


def jet(rise: float, fall: float) -> Jet:
    return Jet(name="j", position_m=(0, 0, 0), force_n=(1, 0, 0), rise_s=rise, fall_s=fall)


def integrals(signal: Signal, edges: Array, lag: float = 0.0) -> tuple[Array, Array]:
    integral, moment = window_integrals([signal], edges, lag)
    return integral[:, 0], moment[:, 0]


def sampled(start: Array, on: Array, rise: float, fall: float, t: Array) -> Array:
    """Thrust of separate pulses at moments ``t``, written from the description rather than from events."""
    value = np.zeros_like(t)
    for s, length in zip(start, on, strict=True):
        if length <= 0:
            continue
        reached = min(1.0, length / rise) if rise else 1.0
        up = np.clip((t - s) / rise, 0, reached) if rise else np.where(t >= s, 1.0, 0.0)
        down = np.clip(reached - (t - s - length) / fall, 0, reached) if fall else np.where(t < s + length, reached, 0.0)
        value += np.where(t < s + length, up, down) * (t >= s)
    return value


@pytest.mark.parametrize(("rise", "fall"), [(0.0, 0.0), (0.003, 0.003), (0.02, 0.005), (0.0, 0.01)])
@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_window_integrals_equal_fine_quadrature(rise: float, fall: float, lag: float) -> None:
    start = np.array([0.1, 0.25, 0.4, 0.7])
    on = np.array([0.03, 0.004, 0.0, 0.05])
    integral, moment = integrals(pulses(np.ones_like(start), start, on, jet(rise, fall), 1e-5), EDGES, lag)
    n = 400_000
    t = (np.arange(n) + 0.5) / n
    u = sampled(start, on, rise, fall, t)
    if lag:
        # y' = (u - y)/lag, where u is constant over each step: at its end y + (1 - decay) (u - y), in its middle as far by half a step
        decay = np.exp(-1 / n / lag)
        ended = lfilter([1 - decay], [1, -decay], u)
        u = u + (np.concatenate([[0.0], ended[:-1]]) - u) * np.sqrt(decay)
    expected = u.reshape(20, -1).mean(1) * 0.05
    expected_moment = (u * (t % 0.05)).reshape(20, -1).mean(1) * 0.05
    np.testing.assert_allclose(integral, expected, atol=3e-6)
    np.testing.assert_allclose(moment, expected_moment, atol=3e-7)


@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_pulses_of_all_jets_at_once_are_those_of_each(lag: float) -> None:
    rng = np.random.default_rng(3)
    start = np.arange(40) * 0.05 - 0.4
    jets = [jet(0.0, 0.0), jet(0.003, 0.012), jet(0.02, 0.0), jet(0.0, 0.1)]  # the last goes on falling while the next pulse rises
    on = rng.uniform(-0.02, 0.05, (4, 40)).clip(0.0, None)
    on[0, 10:14] = 0.05  # held on from cycle to cycle
    on[3] = 0.0
    on[3, ::7] = 0.03
    part = rng.uniform(0.5, 1.0, on.shape)
    found = pulse_integrals([(part, np.broadcast_to(start, on.shape), on)], jets, 5e-5, EDGES, lag)
    each_alone = [pulses(gives, start, own, one, 5e-5) for gives, own, one in zip(part, on, jets, strict=True)]
    expected = window_integrals(each_alone, EDGES, lag)
    assert (expected[0] > 0).any(0).all()
    for ours, each in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, each, rtol=1e-12, atol=1e-16)
    none = pulse_integrals([(np.ones((1, 40)), np.broadcast_to(start, (1, 40)), np.zeros((1, 40)))], jets[:1], 5e-5, EDGES, lag)
    assert not none[0].any()
    assert not none[1].any()


def test_touching_pulses_are_one_and_do_not_dip() -> None:
    start = np.array([0.1, 0.15, 0.2])
    on = np.full(3, 0.05)
    joined, _ = integrals(pulses(np.ones_like(start), start, on, jet(0.003, 0.003), 5e-5), EDGES)
    alone, _ = integrals(pulses(np.ones(1), start[:1], np.array([0.15]), jet(0.003, 0.003), 5e-5), EDGES)
    np.testing.assert_allclose(joined, alone, atol=1e-15)


@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_a_jet_that_is_held_on_gives_in_each_cycle_its_part(lag: float) -> None:
    """Oracle: thrust at each moment, that of the pulse without ramps times the pressure's steps."""
    start, part = 0.05 * np.arange(6), np.array([1.0, 0.9, 0.85, 0.7, 0.0, 0.6])
    on = np.array([0.05, 0.05, 0.05, 0.02, 0.0, 0.05])
    integral, moment = integrals(pulses(part, start, on, jet(0.0, 0.0), 5e-5), EDGES, lag)
    each = [integrals(pulses(np.ones(1), start[k : k + 1], on[k : k + 1], jet(0.0, 0.0), 5e-5), EDGES, lag) for k in range(6)]
    np.testing.assert_allclose(integral, sum(gives * one for gives, (one, _) in zip(part, each, strict=True)), atol=1e-15)
    np.testing.assert_allclose(moment, sum(gives * one for gives, (_, one) in zip(part, each, strict=True)), atol=1e-15)


@pytest.mark.parametrize("jitter", [0.0, 2e-5, 5e-4, 2e-3])
def test_scattered_times_take_no_impulse_from_pulses_that_fill_their_cycles(jitter: float) -> None:
    rng = np.random.default_rng(1)
    start = np.arange(400) * 0.05 + jitter * rng.standard_normal(400)
    on = np.repeat(rng.choice([0.0, 0.05], 40), 10)
    edges = np.linspace(-0.1, 20.2, 407)
    alone, _ = integrals(pulses(np.ones_like(start), start, on, jet(0.003, 0.003), 5e-5), edges)
    together, _ = pulse_integrals([(np.ones((1, 400)), start[None], on[None])], [jet(0.003, 0.003)], 5e-5, edges, 0.0)
    # what is summed over all events keeps a rounding after each pulse, where nothing is left of one by itself
    np.testing.assert_allclose(together[:, 0], alone, rtol=1e-12, atol=1e-14)
    # what touches is one, from the first begin to the last end: on the average as long as its parts
    assert alone.sum() == pytest.approx(on.sum(), rel=1e-4)


@settings(max_examples=50, deadline=None)
@given(delay=st.floats(0, 5), seed=st.integers(0, 1000), rise=st.sampled_from([0.0, 0.003]))
def test_any_delay_conserves_total_impulse(delay: float, seed: int, rise: float) -> None:
    on = np.random.default_rng(seed).choice([0.0, 0.0125, 0.05], 12)
    start = 0.05 * np.arange(12)
    edges = np.linspace(0, 2, 41)
    at_once, _ = integrals(pulses(np.ones_like(start), start, on, jet(rise, rise), 5e-5), edges)
    delayed, _ = integrals(pulses(np.ones_like(start), start + 0.05 * delay, on, jet(rise, rise), 5e-5), edges)
    assert delayed.sum() == pytest.approx(at_once.sum(), abs=1e-13)
    assert at_once.sum() == pytest.approx(on.sum(), abs=1e-13)  # rise and fall of equal length cancel


def test_zero_delay_is_the_identity() -> None:
    used = flight.vehicle(delay=0.0)
    on = flight.pulses(40)
    still = flight.Flight(used, on, np.zeros((40, 3)), np.zeros((40, 3)))
    np.testing.assert_allclose(still.aligned().whole, on @ used.jet_wrench, atol=1e-15)
    assert still.aligned().usable.all()


def test_whole_delay_shifts_by_cycles_and_marks_unknown_commands() -> None:
    on = flight.pulses(40)
    still = flight.Flight(flight.vehicle(delay=2.0), on, np.zeros((40, 3)), np.zeros((40, 3)))
    aligned = still.aligned()
    np.testing.assert_allclose(aligned.whole[2:], (on @ still.used.jet_wrench)[:-2], atol=1e-15)
    assert aligned.usable.tolist() == [False, False] + [True] * 38


def test_triangular_window_gives_the_growth_of_cycle_means() -> None:
    """A double integrator driven by the signal: differences of its cycle-mean velocity equal rising plus falling impulse."""
    signal = pulses(np.ones(3), np.array([0.11, 0.32, 0.5]), np.array([0.03, 0.05, 0.02]), jet(0.004, 0.002), 1e-5)
    integral, moment = integrals(signal, EDGES)
    n = 200_000
    t = np.arange(n + 1) / n
    fine, _ = integrals(signal, t)
    velocity = np.concatenate([[0.0], np.cumsum(fine)])
    middle = (velocity[1:] + velocity[:-1]) / 2
    means = middle.reshape(20, -1).mean(1)
    rising = moment / 0.05
    falling = integral - rising
    np.testing.assert_allclose(np.diff(means), rising[:-1] + falling[1:], atol=1e-9)


def test_held_wrench_is_constant_over_its_cycle() -> None:
    start = np.array([0.0, 0.5])
    integral, moment = integrals(held(start, np.array([2.0, -1.0])), EDGES)
    np.testing.assert_allclose(integral, np.repeat([0.1, -0.05], 10), atol=1e-15)
    np.testing.assert_allclose(moment, integral * 0.025, atol=1e-15)


def test_a_lag_delays_impulse_but_keeps_it() -> None:
    signal = Signal(np.array([0.1, 0.2]), np.array([1.0, -1.0]), np.zeros(2))
    edges = np.linspace(0, 3, 301)
    lagged, _ = integrals(signal, edges, 0.05)
    assert lagged.sum() == pytest.approx(0.1, abs=1e-12)
    assert lagged[:20].sum() < 0.09


def test_opposed_jets_make_nothing_but_rounding_and_that_is_taken_off() -> None:
    """Three forces that cancel: to a machine, 0.1 + 0.2 - 0.3 is not zero."""
    jets = [{"name": str(x), "position_m": [0.0, 0.0, x], "force_n": [f, 0.0, 0.0]} for x, f in ((0.1, 0.1), (0.2, 0.2), (0.3, -0.3))]
    on = np.full((30, 3), 0.02)
    assert 0.1 + 0.2 - 0.3 != 0
    aligned = flight.Flight(flight.vehicle(delay=0.0, jets=jets), on, np.zeros((30, 3)), np.zeros((30, 3))).aligned()
    for part in (aligned.whole, aligned.rising, aligned.impulse_bins.reshape(-1, 6)):
        np.testing.assert_array_equal(part[:, 3], 0.0)
    np.testing.assert_allclose(aligned.whole[:, 1], 0.02 * (0.01 + 0.04 - 0.09), rtol=1e-12)  # the couple stays


@pytest.mark.parametrize("ppm", [10_000.0, -10_000.0])
def test_a_drifting_clock_moves_commands_by_what_it_is_ahead(ppm: float) -> None:
    """A pulse over one cycle of the commands' clock lies over two of the IMU's, which are longer or shorter; the oracle is by hand."""
    used = flight.vehicle(delay=2.0, imu={"clock_drift_ppm": ppm})
    on = np.zeros((160, 18))
    on[100, 0] = flight.CYCLE
    still = np.zeros((160, 3))
    log = flight.Flight(used, on, still, still).log()
    pace = 1 - 1e-6 * ppm
    edges = flight.CYCLE * np.arange(161) * pace
    begin, end = (flight.CYCLE * k for k in (102, 103))
    overlap = np.clip(np.minimum(edges[1:], end) - np.maximum(edges[:-1], begin), 0.0, None)
    aligned = align(log, used, 2.0, 0.0)
    np.testing.assert_allclose(aligned.channels.whole[:, 0], overlap, atol=1e-12)
    np.testing.assert_allclose(aligned.duration_s, flight.CYCLE * pace)
    # a part of the log keeps the time at which both clocks agreed
    np.testing.assert_allclose(align(log.part(90, 130), used, 2.0, 0.0).channels.whole[:, 0], overlap[90:130], atol=1e-12)


def test_a_droop_that_leaves_no_thrust_is_refused() -> None:
    log, used = faulty.sample("free-flyer", 30.0)
    most = int((log.command > 0).sum(1).max())
    for part, refused in ((1 / most, False), (1 / (most - 1), True)):
        found = faulty.stated(used, f"thrust.cycle_droop={part}")
        with pytest.raises(InputError, match=f"{most} jets fire together, and would give no thrust") if refused else nullcontext():
            check_supply(log, found, "v.toml")


@pytest.mark.parametrize("key", ["droop", "cycle_droop"])
def test_a_jet_loses_what_others_take_from_its_supply(key: str) -> None:
    """Oracle: thrust at each moment, by how many others are open then, or fire in the cycle; pulses of four cycles, without ramps."""
    rng = np.random.default_rng(5)
    start = 0.2 * np.arange(4) + 0.1
    on = np.where(rng.random((5, 4)) < 0.7, rng.uniform(0.01, 0.15, (5, 4)), 0.0)
    on[1] = on[0]  # two that close at once
    stated = Vehicle.model_validate(flight.vehicle("free", 2.0))
    jets = tuple(stated.jets[i].model_copy(update={"rise_s": 0.0, "fall_s": 0.0}) for i in range(5))
    used = stated.model_copy(update={"jets": jets, "thrust": stated.thrust.model_copy(update={key: 0.04})})
    t = (np.arange(400_000) + 0.5) / 400_000
    alone = np.array([sampled(start, each, 0.0, 0.0, t) for each in on])
    others = (on > 0).sum(0)[np.clip(((t - 0.1) / 0.2).astype(int), 0, 3)] if key == "cycle_droop" else alone.sum(0)
    expected = (alone * (1 - 0.04 * (others - 1))).reshape(5, 20, -1)
    integral, moment = jet_integrals(start, on, used, EDGES, 0.0)
    np.testing.assert_allclose(integral.T, expected.mean(2) * 0.05, atol=5e-6)
    np.testing.assert_allclose(moment.T, (expected * (t.reshape(20, -1) % 0.05)).mean(2) * 0.05, atol=5e-7)


@pytest.mark.parametrize("droop", [0.0, 0.04])
def test_a_jet_gives_another_part_while_it_fails(droop: float) -> None:
    """Oracle: thrust at each moment; what a shut valve doesn't take from the supply leaves more to the others."""
    rng = np.random.default_rng(6)
    start = 0.2 * np.arange(4) + 0.1
    on = np.where(rng.random((5, 4)) < 0.7, rng.uniform(0.01, 0.15, (5, 4)), 0.0)
    stated = Vehicle.model_validate(flight.vehicle("free", 2.0))
    jets = tuple(stated.jets[i].model_copy(update={"rise_s": 0.0, "fall_s": 0.0}) for i in range(5))
    failures = (
        Failure(jet=jets[0].name, start_s=0.3, end_s=0.7),
        Failure(jet=jets[2].name, thrust=0.6, start_s=0.45),
        Failure(jet=jets[3].name, thrust=-1.0),
    )
    thrust = stated.thrust.model_copy(update={"failures": failures, "droop": droop})
    t = (np.arange(400_000) + 0.5) / 400_000
    part = np.ones((5, 4))
    part[0, 1:3], part[2, 2:], part[3] = 0.0, 0.6, -1.0
    alone = np.array([sampled(start, each, 0.0, 0.0, t) for each in np.where(part == 0, 0.0, on)])
    given = part[:, np.clip(((t - 0.1) / 0.2).astype(int), 0, 3)]
    expected = (given * alone * (1 - droop * (alone.sum(0) - 1))).reshape(5, 20, -1)
    integral, moment = jet_integrals(start, on, stated.model_copy(update={"jets": jets, "thrust": thrust}), EDGES, 0.0)
    np.testing.assert_allclose(integral.T, expected.mean(2) * 0.05, atol=5e-6)
    np.testing.assert_allclose(moment.T, (expected * (t.reshape(20, -1) % 0.05)).mean(2) * 0.05, atol=5e-7)


def test_a_log_is_usable_from_its_delay_and_ten_lags_on() -> None:
    """As long as a command is on its way, and until a lagging actuator has forgotten what it did before the log began."""
    used = flight.vehicle("free", 2.0)
    still = np.zeros((60, 3))
    log = flight.Flight(used, flight.pulses(60, seed=4), still, still).log()
    assert first_usable_s(log, used, 0.1, 0.03) == pytest.approx(0.1 + 10 * 0.03, abs=1e-6)
    assert first_usable_s(log, used, 58 * flight.CYCLE, 0.0) == pytest.approx(58 * flight.CYCLE, abs=1e-6)
    with pytest.raises(InputError, match=r"lasts 3 s, too short for a command delay of 2\.95 s"):
        first_usable_s(log, used, 59 * flight.CYCLE, 0.0)
    aligned = align(log, used, 2.0, 0.0)
    np.testing.assert_allclose(aligned.end_s, log.cycle_end_s, rtol=0, atol=1e-12)


def test_independent_errors_of_pulses_add_up_in_squares() -> None:
    issued = flight.pulses(60, seed=4)
    still = np.zeros((60, 3))
    for sigma in (0.0, 0.02):
        used = flight.vehicle("free", 2.0, thrust={"pulse_sigma": sigma})
        aligned = align(flight.Flight(used, issued, still, still).log(), used, 2.0, 0.0)
        if sigma == 0:
            assert aligned.pulse_covariance is None
            continue
        assert aligned.pulse_covariance is not None
        each = sigma * aligned.channels.whole[:, :, None] * used.jet_wrench
        np.testing.assert_allclose(aligned.pulse_covariance, np.einsum("kja,kjb->kab", each, each), rtol=1e-9, atol=1e-18)


@pytest.mark.thorough
@pytest.mark.parametrize("lag_s", [0.1, 0.2])
def test_a_log_that_begins_while_thrust_lags_is_estimated_from_when_that_is_forgotten(lag_s: float) -> None:
    """What acted before the log is not in it. After five time constants such logs had been told of a torque, and of no cause."""
    noise = (
        "vehicle.imu.gyro_noise_rad_s=1e-5",
        "vehicle.imu.accel_noise_m_s2=1e-3",
        "sensors.gyro_noise_rad_s=0",
        "sensors.accel_noise_m_s2=0",
    )
    flight = fly("free-flyer", *RANDOM, f"vehicle.thrust.lag_s={lag_s}", *noise)
    log = flight.log(0)
    begun = log.part(int(np.flatnonzero(log.command.any(1))[0]) + 2, log.cycles)
    found = flow.examine(begun, VehicleSource(flight.vehicle, "", ""))
    assert not found.notices
    assert np.abs((found.conclusions[0].values - flight.truth[0, 0]) / found.conclusions[0].sigmas).max() < 0.3


def test_what_a_sampled_imu_shows_of_a_pulse_is_read_at_its_records_ends() -> None:
    """Two records a cycle; a pulse of 0.6 cycles is on at the end of the first and not of the second."""
    used, issued, half = flight.vehicle("free", 0.0), np.zeros((40, 18)), flight.CYCLE / 2
    issued[20, 0] = 0.6 * flight.CYCLE
    one, times, still = flight.Flight(used, issued, np.zeros((40, 3)), np.zeros((40, 3))).log(), half * np.arange(1, 81), np.zeros((80, 3))
    log = replace(one, records_per_cycle=2, time_s=times, interval_s=np.full(80, half), delta_theta_imu_rad=still, delta_v_imu_m_s=still)
    log = replace(log, sampled=(True, True))
    found = align(log, used, 0.0, 0.0)
    # the accelerometer: one of two readings shows the force. The gyro: after 0.5 and 1 cycle it has 0.5 and 0.6 cycles of torque, 0.55 in
    # the mean, 0.25 of which stood at the middle of the first record, from which these readings are counted
    for shown, cycles in ((found.whole[20], 0.5), (found.rising[19], 0.25), (found.falling[20], 0.3), (found.rising[20], 0.05)):
        np.testing.assert_allclose(shown, cycles * flight.CYCLE * used.jet_wrench[0], atol=1e-3 * flight.CYCLE)


@pytest.mark.parametrize("lag_s", [0.0, 0.02])
def test_a_wheel_turns_the_body_by_what_its_momentum_grows_by(lag_s: float) -> None:
    """Also beside thrust that lags: a wheel's speed was measured, and doesn't."""
    spin = {"name": "w", "axis": (0.0, 0.6, 0.8), "spin_inertia_kg_m2": 2e-3, "locked_in_inertia": True, "column": "speed"}
    used = flight.vehicle("free", 0.0, wheels=[spin])
    still, speed = np.zeros((40, 3)), 50 + 20 * np.sin(np.arange(40) / 3)
    log = replace(flight.Flight(used, np.zeros((40, 18)), still, still).log(), spinning=(WheelLog(speed, None, None),))
    found = align(log, used, 0.0, lag_s)
    grown = 2e-3 * np.diff(speed)[:, None] * [0.0, 0.6, 0.8]
    np.testing.assert_allclose(found.whole[1:, :3], -grown, atol=1e-12)
    assert found.stored is not None
    np.testing.assert_allclose(found.stored.mean[1:].mean(1)[:, 0], 2e-3 * (speed[1:] + speed[:-1]) / 2, rtol=1e-12)


def test_ramps_and_lags_of_commands_before_a_part_of_a_log_reach_into_it() -> None:
    """A part is what the whole is there, to the last digit: commands reach as far as delay, three cycles, ramps and forty lags."""
    used = flight.vehicle("free", 2.0, jets=[jet | {"rise_s": 0.11, "fall_s": 0.13} for jet in flight.jets()])
    log = flight.Flight(used, flight.pulses(200, seed=3), np.zeros((200, 3)), np.zeros((200, 3))).log()
    for lag_s in (0.0, 0.05):
        whole, part = align(log, used, 2.0, lag_s), align(log, used, 2.0, lag_s, slice(120, 200))
        for name in ("rising", "falling", "whole", "impulse_bins", "skew_bins"):
            np.testing.assert_allclose(getattr(part, name), getattr(whole, name)[120:], rtol=0, atol=1e-15)


def test_limits_of_a_commanded_wrench_are_none_of_jets() -> None:
    """A vehicle file may state both; 18 jets are no six components."""
    log, used = faulty.sample("free-flyer", 5.0)
    plain, limited = (align(log, faulty.stated(used, one), 2.0, 0.0) for one in ("name='jets'", "thrust.wrench_limits=[1, 1, 1, 1, 1, 1]"))
    assert np.abs(plain.whole).max() > 0
    np.testing.assert_array_equal(limited.whole, plain.whole)
