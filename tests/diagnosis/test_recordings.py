"""What a recorder or a person wrote otherwise than the vehicle file says is named, and corrected by its keys."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.diagnosis import inspection, recordings
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario, simulate
from tests import faulty
from tests.diagnosis.test_commanded_wrench import WRENCH, flight
from tests.flight import resolved
from tests.flown import BY_SPEED, PLAN, fly


def at_the_start_of_records(log: Log, used: Vehicle, _: Array) -> tuple[Log, Vehicle]:
    """As a strapdown unit with compensated rotation and sculling has its velocity increments."""
    seen = (rotation(log.delta_theta_imu_rad / 2) @ log.delta_v_imu_m_s[..., None])[..., 0]
    return replace(log, delta_v_imu_m_s=seen), used


@pytest.mark.thorough
def test_increments_in_the_axes_of_each_records_start_are_taken_back() -> None:
    """Where a body turns by 0.02 rad in a record under a specific force of gravity."""
    flown = fly("testbed", *PLAN)
    log, used = at_the_start_of_records(flown.log(0), flown.vehicle, flown.truth[0][0])
    codes = [notice.code for notice in faulty.examined(log, used).notices]
    assert codes == ["accel-axes"], codes
    back = faulty.examined(log, faulty.stated(used, 'imu.accel_axes="start"'))
    clean = faulty.examined(flown.log(0), flown.vehicle)
    assert back.notices == ()
    apart = np.abs(back.conclusions[0].values - clean.conclusions[0].values) / clean.conclusions[0].sigmas
    assert apart.max() < 0.05


PULSES = ", ".join(
    f'{{motion="random", axes=["{axis}"], level={level}, start_s={3.3 * n}, end_s={3.3 * n + 3.3}}}'
    for n, (axis, level) in enumerate((("roll", 0.3), ("pitch", 0.4), ("yaw", 0.6), ("x", 0.7), ("y", 0.3), ("z", 0.5)))
)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(("at", "delay"), [("centre", "2.0"), pytest.param("end", '"auto"', marks=pytest.mark.thorough)])
def test_pulses_elsewhere_in_their_cycles_are_named_and_mended(at: str, delay: str) -> None:
    """Found delays of 2.33 and 2.67 cycles had stood for it, beside a clock that drifts or a cause unknown."""
    flown = fly("free-flyer", "duration_s=20.0", f"plan=[{PULSES}]", f"actuators.pulse_at={at}")
    used = faulty.stated(flown.vehicle, f"cycle.command_delay_cycles={delay}")
    found = faulty.examined(flown.log(0), used)
    assert [(notice.code, f'state cycle.pulse_at = "{at}"' in notice.message) for notice in found.notices] == [("pulse-position", True)]
    mended = faulty.examined(flown.log(0), faulty.stated(used, f'cycle.pulse_at="{at}"'))
    assert mended.notices == ()
    assert mended.timing.delay == pytest.approx(2.0, abs=0.02)
    estimates = mended.conclusions[0].estimates.values()
    assert all(abs((one.value or 0) - value) < 4 * (one.sigma or 0) for one, value in zip(estimates, flown.truth[0][0], strict=True))


@pytest.mark.parametrize(
    ("jet", "later_s"),
    [
        ("roll_n2", 0.05),
        pytest.param("roll_p1", 0.02, marks=pytest.mark.thorough),
        pytest.param("pitch_p2", 0.013, marks=pytest.mark.thorough),
    ],
)
def test_a_jet_that_is_later_than_the_others_is_named_with_its_delay(jet: str, later_s: float) -> None:
    """Though it is always commanded together with another one. Stated, its delay leaves nothing to be said."""
    flown = fly("free-flyer", *PLAN, f"actuators.jet_delays_s={{{jet}={later_s}}}")
    index = [one.name for one in flown.vehicle.jets].index(jet)
    found = faulty.examined(flown.log(0), flown.vehicle)
    (said,) = found.notices
    assert (said.code, f"jet {jet} " in said.message) == ("jet-late", True)
    (answer,) = found.mended
    key, _, value = answer.settings[0].partition("=")
    assert key == f"jets.{index}.delay_s"
    assert float(value) == pytest.approx(later_s, abs=5e-4)
    stated = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, f"jets.{index}.delay_s={later_s}"))
    assert stated.notices == ()
    for conclusion in (answer.conclusions[0], stated.conclusions[0]):
        z = (conclusion.values - flown.truth[0][0]) / np.sqrt(np.diag(conclusion.covariance))
        assert np.abs(z).max() < 4


@pytest.mark.parametrize(
    ("scenario", "key", "older_s"),
    [
        pytest.param("pedestal", "speed_latency_s", 0.02, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param("wheels", "speed_window_s", 0.03, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param("wheels", "speed_latency_s", 0.005, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param("wheels-and-jets", "speed_latency_s", 0.05, marks=[pytest.mark.thorough, pytest.mark.seeds]),
    ],
)
def test_speeds_of_wheels_that_are_older_than_stated_are_named_with_their_age(scenario: str, key: str, older_s: float) -> None:
    """A mean over a window is about as old as half of it. Stated, that leaves nothing to be said."""
    flight = fly(scenario, *BY_SPEED, *(f"vehicle.wheels.{n}.{key}={older_s}" for n in range(3)))
    found = faulty.examined(flight.log(0), faulty.stated(flight.vehicle, *(f"wheels.{n}.{key}=0.0" for n in range(3))))
    assert [notice.code for notice in found.notices] == ["speed-late"]
    (answer,) = found.mended
    age_s = older_s / 2 if key == "speed_window_s" else older_s
    for number in range(3):
        name, _, value = answer.settings[number].partition("=")
        assert name == f"wheels.{number}.speed_latency_s"
        assert float(value) == pytest.approx(age_s, abs=2e-4)
    truth = flight.truth[0][0][:6]
    z = (answer.conclusions[0].values[:6] - truth) / np.sqrt(np.diag(answer.conclusions[0].covariance)[:6])
    assert np.abs(z).max() < 4
    stated = faulty.examined(flight.log(0), flight.vehicle)
    assert stated.notices == ()


@pytest.mark.thorough
def test_a_jet_that_is_logged_a_cycle_before_its_twin_is_late_and_not_dead_beside_one_of_twice_the_thrust() -> None:
    """Both act together, so free coefficients give all that they do to the other one and leave nothing."""
    flown = fly("free-flyer", *PLAN)
    log, index = flown.log(0), [one.name for one in flown.vehicle.jets].index("pitch_p2")
    command = log.command.copy()
    command[:-1, index], command[-1, index] = log.command[1:, index], 0.0
    found = faulty.examined(replace(log, command=command), flown.vehicle)
    (said,) = found.notices
    assert (said.code, "jet pitch_p2 " in said.message) == ("jet-late", True)
    (answer,) = found.mended
    key, _, value = answer.settings[0].partition("=")
    assert key == f"jets.{index}.delay_s"
    assert float(value) == pytest.approx(0.05, abs=5e-4)
    z = (answer.conclusions[0].values - flown.truth[0][0]) / np.sqrt(np.diag(answer.conclusions[0].covariance))
    assert np.abs(z).max() < 4


def test_a_log_made_on_a_bearing_is_not_one_of_free_flight() -> None:
    log, used = faulty.sample("air-bearing", 15.0)
    found = faulty.examined(log, faulty.stated(used, 'environment.kind="free"'))
    assert found.notices[0].code == "gravity-felt"
    assert {one.verdict for one in found.conclusions[0].estimates.values()} <= {"contradicted", "unobservable", "not_excited"}


def test_commands_that_were_logged_more_rarely_than_given_leave_least_next_to_one() -> None:
    """And so do no others: commands of whatever strength, late or early, that are held as the logged ones are."""
    flown = flight()
    used, log = Resolved.stated(flown.vehicle), flown.log(0)
    assert used is not None
    logged = replace(log, command=log.command[np.arange(len(log.command)) // 5 * 5])
    said = inspection.sparse_commands(Case(logged, used, stated_timing(used)))
    assert "every 5 control cycles" in said
    assert "command_time_s" in said
    assert inspection.sparse_commands(Case(log, used, stated_timing(used))) == ""
    # a slow controller's: the motion follows what is held
    held, mass = logged.command, 20.0
    turned = np.cumsum(held[:, :3], 0) * used.cycle.period_s
    rate = (turned + np.vstack([np.zeros((1, 3)), turned[:-1]])) / 2
    rng = np.random.default_rng(1)
    slow = replace(
        logged,
        delta_theta_imu_rad=used.cycle.period_s * (rate + 1e-4 * rng.normal(size=rate.shape)),
        delta_v_imu_m_s=used.cycle.period_s * (held[:, 3:] / mass + 1e-3 * rng.normal(size=rate.shape)),
    )
    for late in (0, 1, 3):
        shifted = replace(slow, command=np.roll(3.0 * held, -late, axis=0))
        assert inspection.sparse_commands(Case(shifted, used, stated_timing(used))) == ""


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.thorough), pytest.param(3, marks=pytest.mark.thorough)])
def test_records_that_were_lost_with_their_commands_name_no_other_cause(seed: int) -> None:
    """Three cycles: the rate changes by what nobody knows, and the next increments are those of half their interval."""
    flown = simulate.fly(scenario.load("free-flyer", (*PLAN, *WRENCH)), [seed])
    log, rows = flown.log(0), np.random.default_rng(seed)
    gone = rows.choice(np.flatnonzero(log.command.any(1))[20:-20], 3, replace=False)
    kept = np.setdiff1d(np.arange(log.cycles), gone)
    time_s = log.time_s[kept]
    cut = replace(
        log,
        rows=len(kept),
        time_s=time_s,
        interval_s=np.diff(time_s, prepend=time_s[0] - log.interval_s[0]),
        delta_theta_imu_rad=log.delta_theta_imu_rad[kept],
        delta_v_imu_m_s=log.delta_v_imu_m_s[kept],
        command=log.command[kept],
    )
    found = faulty.examined(cut, flown.vehicle)
    codes = {notice.code for notice in found.notices}
    assert codes <= {"long-interval", "cause-unknown", "model-discrepancy", "disturbance-torque", "gyro-misfit", "accelerometer-misfit"}
    assert "cause-unknown" not in codes or "3 record(s) were lost" in found.unknown
    assert not any(
        one.verdict == "converged" and abs((one.value or 0.0) - value) > 4 * (one.sigma or 0.0)
        for one, value in zip(found.conclusions[0].estimates.values(), flown.truth[0][0], strict=True)
    )


@pytest.mark.parametrize("name", ["thrust", "yaw"])
def test_commands_of_a_smaller_delay_are_not_said_to_be_logged_after_they_acted(name: str) -> None:
    """Of a real flight, stated four cycles too long: they were to be moved up by five."""
    folder = faulty.SAMPLES / "crazyflie"
    stated = faulty.stated(vehiclefile.load(folder / "vehicle.toml").vehicle, "cycle.command_delay_cycles=4.0")
    log = read(read_table(folder / f"{name}.parquet"), stated)
    assert recordings.logged_after(Case(log, resolved(stated), Timing(4.0, 0.0))) == 0
