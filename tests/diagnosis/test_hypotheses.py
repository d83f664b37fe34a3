"""What each hypothesis makes of the free coefficients, against flights that have it (computed another way: tests/flight.py)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, rotation, tensor
from massprop_cli.diagnosis.channelwise import free_response
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import _LeastSquares, fitted
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.hypotheses import mountings, other_units
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.errorparameters.thrust import about_cg
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.timing import Timing
from tests import flight
from tests.flight import resolved

DELAY = Timing(2.0, 0.0)
PIECE = slice(2, 320)
VARIANCE = np.repeat([1e-4, 0.02], 3) ** 2
TURN = np.array([0.02, -0.03, 0.01])
CANT = 0.42
BACK = 1.112 * np.tan(CANT) * np.array([np.sin(CANT), -np.cos(CANT), 0.0])
"""Across a force of 1.112 N along x that is stated to be turned by so much about z."""
Mistake = Callable[[Log, Vehicle], tuple[Log, Vehicle]]


def theta(kind: str) -> Array:
    """(10,) the truth as the model's entries."""
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    inertia, moment = tensor(truth[:6]), truth[6:9]
    if kind != "free":
        rotating = truth[9] - 5.0
        inertia = inertia + rotating * (moment @ moment * np.eye(3) - np.outer(moment, moment))
        moment = rotating * moment
    return np.concatenate([elements(np.linalg.inv(inertia)), moment, [1 / truth[9]]])


def left(log: Log, used: Vehicle, kind: str, **entries: Array) -> float:
    """Chi-square that the true body leaves of a log, with entries of x as given."""
    free = free_response(Case(log, resolved(used), DELAY), slice(2, log.cycles))
    model = Model.of(free, used, 0.0, "jets")
    x = model.stated
    x[:10] = theta(kind)
    for name, value in entries.items():
        x[model.place(name)] = value
    rows = _LeastSquares.of_all(model, free, VARIANCE, [Hypothesis("", (), np.eye(len(x)))])
    return float((rows.residuals(x[None]) ** 2).sum())


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_the_cg_stands_from_o_in_every_environment(kind: str) -> None:
    """θ holds a first moment about the bearing, which may be elsewhere than stated."""
    bearing, away = (0.004, -0.003, 0.01) if kind != "free" else (0.0, 0.0, 0.0), np.array([1e-3, 0.0, -2e-3]) * (kind != "free")
    flown = flight.standard(kind)
    used = flight.vehicle(kind, environment={"bearing_position_m": bearing})
    model = Model.of(free_response(Case(flown.log(), resolved(used), DELAY), PIECE), used, 0.0, "jets")
    x = model.stated
    x[:10], x[model.place("bearing")] = theta(kind), away
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    np.testing.assert_allclose(model.cg(x), truth[6:9] + bearing + away, atol=1e-12)


@pytest.mark.parametrize(
    ("point_m", "sigma_m", "force", "about"),
    [
        ((0.0167, 0.0, 0.0034), 0.0, np.eye(3)[1:2], True),
        ((0.0167, 0.0, 0.0034), 0.0, np.eye(3), False),
        ((0.0167, 0.0229, 0.0034), 0.0, np.eye(3), True),
        ((0.0177, 0.0249, 0.0034), 0.0, np.eye(3), False),
        ((0.0177, 0.0249, 0.0034), 0.001, np.eye(3), True),
        ((0.0267, 0.0329, 0.0034), 0.02, np.eye(3), False),
        ((0.0167, 0.0, 0.0034), 0.0, np.zeros((0, 3)), False),
    ],
)
def test_torques_are_about_the_cg_as_far_as_forces_and_noise_tell(
    point_m: tuple[float, ...], sigma_m: float, force: Array, about: bool
) -> None:
    """A force along y has the same torque about all points of a line along y."""
    assert about_cg(np.array(point_m), np.full(3, sigma_m), np.array([0.0167, 0.023, 0.0034]), force) == about


def scaled(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad * np.exp([0.0, 0.01, 0.0])), used


def felt(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s * np.exp(0.05)), used


def turned(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    by = rotation(TURN).T
    return replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad @ by, delta_v_imu_m_s=log.delta_v_imu_m_s @ by), used


def biased(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad + 0.003 * flight.CYCLE), used


def pushed(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return replace(log, delta_v_imu_m_s=log.delta_v_imu_m_s + 0.1 * flight.CYCLE), used


def further(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return log, used.model_copy(update={"imu": used.imu.model_copy(update={"position_m": (0.0, -0.06, 0.12)})})


def weak(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return log, with_jet(used, 0, force_n=tuple(2 * f for f in used.jets[0].force_n))


def misplaced(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    return log, with_jet(used, 4, position_m=tuple(np.add(used.jets[4].position_m, (0.0, 0.02, 0.0))))


def canted(log: Log, used: Vehicle) -> tuple[Log, Vehicle]:
    """The file has a jet turned by 24 degrees."""
    return log, with_jet(used, 4, force_n=tuple(rotation(np.array([0.0, 0.0, CANT])) @ used.jets[4].force_n))


def with_jet(used: Vehicle, at: int, **update: object) -> Vehicle:
    jets = tuple(jet.model_copy(update=update) if i == at else jet for i, jet in enumerate(used.jets))
    return Vehicle.model_construct(**{**dict(used), "jets": jets})


CASES: list[tuple[str, Mistake, Array]] = [
    ("gyro_scale", scaled, np.array([0.0, 0.01, 0.0])),
    ("accel_scale", felt, np.full(3, 0.05)),
    ("gyro_bias", biased, np.full(3, 0.003)),
    ("accel_bias", pushed, np.full(3, 0.1)),
    ("imu", further, np.array([0.1, 0.0, 0.0])),
    ("thrust", weak, np.where(np.arange(18) == 0, 0.5, 1.0)),
    ("position", misplaced, np.where(np.arange(54) == 13, -0.02, 0.0)),
    ("direction", canted, np.concatenate([np.zeros(12), BACK, np.zeros(39)])),
]


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
@pytest.mark.parametrize(("entry", "mistake", "value"), CASES)
def test_an_entry_makes_what_a_flight_with_it_shows(kind: str, entry: str, mistake: Mistake, value: Array) -> None:
    flown = flight.standard(kind)
    own = left(flown.log(), flown.used, kind)
    log, used = mistake(flown.log(), flown.used)
    without, within = left(log, used, kind), left(log, used, kind, **{entry: value})
    assert without > 30 * own
    # of second order in what moves the vertical; else as good as before
    assert within < own + 0.02 * without if kind != "free" else within < 1.05 * own + 1e-3 * without


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_a_turned_imu_is_a_turn_of_both_its_sensors(kind: str) -> None:
    """On a bearing the attitude that is integrated from it is turned too."""
    flown = flight.standard(kind)
    own = left(flown.log(), flown.used, kind)
    log, used = turned(flown.log(), flown.used)
    wrong = left(log, used, kind, gyro_turn=-TURN, accel_turn=-TURN)
    assert wrong > 100 * own
    # of second order in what moves the vertical
    assert left(log, used, kind, gyro_turn=TURN, accel_turn=TURN) < 2 * own + 1 + (0.005 * wrong if kind != "free" else 0)


@pytest.mark.parametrize(("by", "what"), [(0.05, "delay"), (0.05, "rise")])
def test_commands_that_come_later_are_of_first_order(by: float, what: str) -> None:
    truth = flight.TRUTH
    late = flight.vehicle(delay=2.0 + by) if what == "delay" else flight.vehicle(jets=flight.jets(rise_s=2 * by * flight.CYCLE))
    flown = flight.fly(late, flight.pulses(160), truth, step_s=flight.CYCLE / 20)
    stated = flight.vehicle()
    without = left(flown.log(), stated, "free")
    entries = ("rise", "fall") if what == "rise" else (what,)
    assert left(flown.log(), stated, "free", **dict.fromkeys(entries, np.array([by]))) < 0.02 * without


def test_a_fit_finds_the_body_and_what_is_wrong_from_noise() -> None:
    flown = flight.standard("free")
    log, used = weak(flown.log(np.random.default_rng(3)), flown.used)
    free = free_response(Case(log, resolved(used), DELAY), PIECE)
    model = Model.of(free, used, 0.0, "jets")
    column = np.zeros((len(model.stated), 1))
    column[model.place("thrust").start] = 0.3
    stated, found = fitted(
        model, free, VARIANCE, [Hypothesis("", (), np.zeros((len(column), 0))), Hypothesis("thrust-scale", ("a",), column, suspects=(0,))]
    )
    assert stated.chi_square.sum() > 1e4
    freedom = 6 * free.size - 11
    assert found.chi_square.sum() < freedom + 6 * np.sqrt(2 * freedom)
    assert abs(found.factors[0] - 0.5) < 5 * 0.3 * found.spread[0]
    inertia = np.linalg.inv(tensor(found.x[:6]))
    np.testing.assert_allclose(elements(inertia)[[0, 3, 5]], flight.TRUTH[[0, 3, 5]], rtol=2e-3)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_no_mounting_is_supposed_twice_or_as_it_is_stated_whatever_the_rounding(angle: float) -> None:
    """Right angles in the body's axes and in the IMU's own, of which those of an IMU along the body's axes are the same."""
    rng = np.random.default_rng(0)
    mounted = rotation(np.array([angle, 0.2 * angle, 0.0])) @ (np.eye(3) + 3e-10 * rng.standard_normal((3, 3)))
    flown = flight.standard()
    model = replace(Model.of(free_response(Case(flown.log(), flown.resolved, DELAY), PIECE), flown.used, 0.0, "jets"), mounting=mounted)
    whole = [one.gyro for one in mountings(model) if np.array_equal(one.gyro, one.accelerometer)]
    apart = np.abs(np.array(whole)[:, None] - whole).max((2, 3)) + np.eye(len(whole))
    assert apart.min() > 1e-3
    assert np.abs(np.array(whole) - np.eye(3)).max((1, 2)).min() > 1e-3
    assert len(whole) == (47 if angle == 0 else 1 + 48 + 47)


def test_units_of_the_accelerometer_are_told_from_rates_of_about_the_same_size() -> None:
    """Milli-g make 102 of 1, and rates over a hundredth of a second 100: of both alike the one that is named more often comes first."""
    each = {one.words: one for one in other_units(0.01, increments=True)}
    milli, rates = each["accelerometer columns are in milli-g"], each["accelerometer columns hold rates, not increments"]
    np.testing.assert_allclose(milli.accelerometer / rates.accelerometer, 1.0197162, rtol=1e-7)
    assert milli.prior_odds > rates.prior_odds == 0.0
