"""Estimates on a fixed pedestal, against motion that is integrated apart (tests/anypedestal.py)."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import ABOUT_PIVOT, CG, INERTIA, QUANTITIES, flow
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.estimate import kernelflight
from massprop_cli.export import resolve
from massprop_cli.inputs import columns, vehiclefile
from massprop_cli.inputs.equipment import LowPass
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.kernel import kernel
from massprop_cli.result import build, schema
from tests import anypedestal, faulty
from tests.flown import fly


@cache
def moved(seed: int, kind: anypedestal.Kind, count: int) -> tuple[anypedestal.Tables, anypedestal.Flown, np.random.Generator]:
    """Some tables, how they move, and the generator that has drawn both."""
    rng = np.random.default_rng(seed)
    own = anypedestal.tables(rng, count)
    return own, anypedestal.fly(rng, own, kind, 0.05, 30.0), rng


@cache
def found_of(
    seed: int, kind: anypedestal.Kind, count: int, noise: float = 1.0, biases: bool = False, weighed: bool = True, inertia: float = 0.0
) -> tuple[anypedestal.Tables, list[Analysis]]:
    """Estimates of some tables, of which mass and, with a relative sigma ``inertia``, moments of inertia are known."""
    own, flown, rng = moved(seed, kind, count)
    rng, answers = deepcopy(rng), []
    for body in range(count):
        known = {"mass": {"value": float(own.mass[body]), "sigma": 1e-3 * float(own.mass[body])}} if weighed else {}
        size = inertia * float(np.trace(own.inertia[body])) / 3
        for name, value in zip(INERTIA, own.inertia[body][np.triu_indices(3)], strict=True):
            if inertia:
                known[name] = {"value": float(value + noise * size * rng.normal()), "sigma": size}
        used = anypedestal.vehicle_of(own, body, flown, biases, **known)
        log = anypedestal.log_of(rng, own, body, flown, used, noise, biases)
        answers.append(flow.examine(log, VehicleSource(used, "", "")))
    return own, answers


def deviations(own: anypedestal.Tables, answers: list[Analysis]) -> Array:
    """(V, 9) of ``about_pivot``, in sigmas."""
    found = [[told.about_pivot[name] for name in ABOUT_PIVOT] for told in conclusions(answers)]
    value, sigma = (np.array([[getattr(one, part) for one in row] for row in found], dtype=float) for part in ("value", "sigma"))
    z: Array = (value - own.nine) / sigma
    return z


def conclusions(answers: list[Analysis]) -> list[Conclusion]:
    return [answer.conclusions[0] for answer in answers]


@pytest.mark.parametrize(
    ("kind", "biases", "inertia", "most"),
    [
        ("jets", False, 0.0, 0.05),
        pytest.param("wheels", False, 0.0, 0.05, marks=pytest.mark.thorough),
        pytest.param("swing", False, 0.01, 0.1, marks=pytest.mark.thorough),
        pytest.param("jets", True, 0.0, 1.5, marks=pytest.mark.thorough),
        pytest.param("wheels", True, 0.0, 0.9, marks=pytest.mark.thorough),
    ],
)
def test_without_noise_nothing_is_left(kind: anypedestal.Kind, biases: bool, inertia: float, most: float) -> None:
    own, answers = found_of(1, kind, 2, noise=0.0, biases=biases, inertia=inertia)
    assert np.abs(deviations(own, answers)).max() < most
    for told, truth in zip(conclusions(answers), own.ten, strict=True):
        assert np.abs((told.values - truth) / told.sigmas).max() < most


def test_noisy_sensors_put_no_bearing_elsewhere() -> None:
    """The gyro's noise moves the vertical that the weight pulls along, in steps with the CG; of the bearing itself little is told."""
    rng = np.random.default_rng(5)
    own = anypedestal.tables(rng, 2)
    own = replace(own, noise=np.tile([3e-3, 0.2], (2, 1)))
    flown = anypedestal.fly(rng, own, "wheels", 0.05, 40.0)
    used = anypedestal.vehicle_of(own, 0, flown, biases=False, mass={"value": float(own.mass[0]), "sigma": 1e-4 * float(own.mass[0])})
    answer = flow.examine(anypedestal.log_of(rng, own, 0, flown, used), VehicleSource(used, "", ""))
    assert "bearing-position" not in [doubt.assumption for doubt in answer.doubts]
    assert {one.verdict for one in answer.conclusions[0].about_pivot.values()} == {"converged"}


def test_biases_alone_are_no_fault_of_a_free_body() -> None:
    """Without noise they add their own squares to chi-square, which a body that changes would explain better."""
    rng = np.random.default_rng([0, 3])
    own = anypedestal.tables(rng, 4)
    own = replace(own, pivot=own.cg)
    flown = anypedestal.fly(rng, own, "wheels", 0.05, 30.0, 0.0)
    used = anypedestal.vehicle_of(own, 3, flown, biases=True)
    used = used.model_copy(update={"environment": used.environment.model_copy(update={"kind": "free"})})
    log = anypedestal.log_of(rng, own, 3, flown, used, noise=0.0, biases=True)
    answer = flow.examine(log, VehicleSource(used, "", ""))
    assert not answer.faults
    assert {answer.conclusions[0].estimates[name].verdict for name in INERTIA} == {"converged"}


@pytest.mark.parametrize(
    ("kind", "count", "inertia"),
    [
        ("jets", 1, 0.0),
        *(pytest.param(*one, marks=[pytest.mark.thorough, pytest.mark.seeds]) for one in (("wheels", 2, 0.0), ("swing", 2, 0.01))),
    ],
)
def test_inertia_and_first_moment_about_the_pivot_converge_within_their_sigmas(kind: anypedestal.Kind, count: int, inertia: float) -> None:
    own, answers = found_of(3, kind, count, inertia=inertia)
    assert np.abs(deviations(own, answers)).max() < 4
    assert {one.verdict for told in conclusions(answers) for one in told.about_pivot.values()} == {"converged"}
    assert all(
        told.estimates["mass"].sigma == pytest.approx(1e-3 * mass) for told, mass in zip(conclusions(answers), own.mass, strict=True)
    )


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "biases", "inertia"), [("jets", False, 0.0), ("wheels", False, 0.0), ("swing", False, 0.01)])
def test_sigmas_hold_over_many_tables(kind: anypedestal.Kind, biases: bool, inertia: float) -> None:
    count = 4 if kind == "swing" else 6
    own, answers = found_of(7, kind, count, biases=biases, inertia=inertia)
    z = deviations(own, answers)
    # all values of a swing follow one, the inertia that is known; of others half are as good as independent
    independent = count if kind == "swing" else z.size / 2
    assert abs((np.abs(z) < 1.96).mean() - 0.95) < 2.5 * np.sqrt(0.95 * 0.05 / independent)
    assert abs(np.sqrt((z**2).mean()) - 1) < 2.5 / np.sqrt(2 * independent)
    assert np.abs(z).max() < 4.5


def test_a_weighed_mass_gives_cg_and_inertia_about_it_and_leaves_the_first_moment_alone() -> None:
    """A mass that is a permille heavier moves the CG towards the pivot by as much, and κ and I_p not at all."""
    own, (answer,) = found_of(3, "jets", 1)
    told = answer.conclusions[0]
    arm = told.values[6:9] - own.pivot[0]
    assert np.array([told.about_pivot[name].value for name in ABOUT_PIVOT[6:]]) == pytest.approx(told.values[9] * arm, rel=1e-9)
    moment = np.array([told.about_pivot[name].sigma for name in ABOUT_PIVOT[6:]], dtype=float) / told.values[9]
    assert told.sigmas[6:9] == pytest.approx(np.hypot(moment, 1e-3 * arm), rel=0.02)


def test_without_a_mass_the_nine_are_the_same_and_the_ten_say_what_to_weigh() -> None:
    own, (weighed,) = found_of(3, "jets", 1)
    _, (unweighed,) = found_of(3, "jets", 1, weighed=False)
    one, other = weighed.conclusions[0], unweighed.conclusions[0]
    for name in ABOUT_PIVOT:
        value, sigma = one.about_pivot[name].value, one.about_pivot[name].sigma
        assert value is not None
        assert other.about_pivot[name].value == pytest.approx(value, abs=0.05 * (sigma or 0))
        assert other.about_pivot[name].sigma == pytest.approx(sigma, rel=0.02)
    assert {other.estimates[name].verdict for name in QUANTITIES} == {"unobservable"}
    assert all(other.estimates[name].value is None for name in QUANTITIES)
    assert "weigh the vehicle and state known.mass" in str(other.estimates["cg_z"].reason)
    assert np.isfinite(own.nine).all()


def test_a_free_swing_with_nothing_known_tells_ratios_alone_and_says_so() -> None:
    _, answers = found_of(4, "swing", 1)
    told = answers[0].conclusions[0]
    assert {one.verdict for one in told.about_pivot.values()} == {"unobservable"}
    assert "only the ratio of first moment to inertia" in str(told.about_pivot["moment_z"].reason)
    assert all(told.estimates[name].value is None for name in (*INERTIA, *CG))


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_free_swing_logged_as_mean_rates_gives_what_its_increments_give() -> None:
    """Nothing is commanded, so no sensor shows a command late; a low-pass of 4 ms moves a swing of seconds by less than noise."""
    own, flown, rng = moved(5, "swing", 1)
    known = {
        name: {"value": float(value), "sigma": 0.01 * float(np.trace(own.inertia[0])) / 3}
        for name, value in zip(INERTIA, own.inertia[0][np.triu_indices(3)], strict=True)
    }
    known["mass"] = {"value": float(own.mass[0]), "sigma": 1e-3 * float(own.mass[0])}
    used = anypedestal.vehicle_of(own, 0, flown, False, **known)
    log = anypedestal.log_of(deepcopy(rng), own, 0, flown, used)
    expected = flow.examine(log, VehicleSource(used, "", "")).conclusions[0]
    rates = replace(log, rate_columns=columns.GYRO, force_columns=columns.ACCEL)
    filtered: dict[str, LowPass] = {"gyro_filter": LowPass(order=2, cutoff_hz=40.0)}
    for imu, most in (({}, 0.1), (filtered, 1.0)):
        behind = used.model_copy(update={"imu": used.imu.model_copy(update=imu)})
        found = flow.examine(rates, VehicleSource(behind, "", "")).conclusions[0]
        assert np.abs((found.values - expected.values) / expected.sigmas)[:9].max() < most
        np.testing.assert_allclose(found.sigmas[:9], expected.sigmas[:9], rtol=0.02)


def test_a_body_hung_from_a_joint_is_told_beside_the_bias_of_its_gyro() -> None:
    """Half a metre below it, what swings it turns the IMU far more than gravity: without its lever arm, biases were ten times too large."""
    rng = np.random.default_rng(7)
    own = anypedestal.tables(rng, 3, offset_m=0.15)
    flown = anypedestal.fly(rng, own, "swing", 0.05, 30.0)
    for body in range(3):
        answer = swung(rng, own, flown, body, biases=True)
        found = answer.conclusions[0]
        assert not answer.notices
        assert {one.verdict for one in found.estimates.values()} == {"converged"}
        assert np.abs((found.values - own.ten[body]) / found.sigmas).max() < 3.5


def test_a_wide_swing_that_turns_a_fifth_of_a_radian_a_cycle_is_no_fault() -> None:
    """Near its instability a swing magnifies what the model of a cycle leaves, here up to a thousand times."""
    rng = np.random.default_rng(5)
    own = anypedestal.tables(rng, 3, offset_m=0.05)
    fine = anypedestal.fly(rng, own, "swing", 0.0125, 30.0, tilt_rad=0.9)
    turned, pushed = (part.reshape(3, -1, 4, 3).sum(2) for part in (fine.turned, fine.pushed))
    flown = replace(fine, period_s=0.05, turned=turned, pushed=pushed, issued=fine.issued[:, ::4])
    assert (np.linalg.norm(turned, axis=-1).max(1) > 0.13).all()
    for body in range(3):
        answer = swung(rng, own, flown, body)
        found = answer.conclusions[0]
        assert not answer.notices
        assert not [one for one in found.estimates.values() if one.verdict == "contradicted"]
        assert np.abs((found.values - own.ten[body]) / found.sigmas).max() < 3.5


def test_a_table_of_known_inertia_is_turned_by_wheels_as_one_of_unknown() -> None:
    """It may swing, and so its motion from cycle to cycle is that of a swing: with the momentum of its wheels."""
    own, answers = found_of(5, "wheels", 2, inertia=0.01)
    assert [answer.notices for answer in answers] == [(), ()]
    assert np.abs(deviations(own, answers)).max() < 3.5


def swung(rng: np.random.Generator, own: anypedestal.Tables, flown: anypedestal.Flown, body: int, biases: bool = False) -> Analysis:
    """A swing of a body whose mass is known to a thousandth and whose inertia to a hundredth."""
    size = 0.01 * float(np.trace(own.inertia[body])) / 3
    known = {
        name: {"value": float(value + size * rng.normal()), "sigma": size}
        for name, value in zip(INERTIA, own.inertia[body][np.triu_indices(3)], strict=True)
    }
    known["mass"] = {"value": float(own.mass[body]), "sigma": 1e-3 * float(own.mass[body])}
    used = anypedestal.vehicle_of(own, body, flown, biases, **known)
    return flow.examine(anypedestal.log_of(rng, own, body, flown, used, biases=biases), VehicleSource(used, "", ""))


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_pendulum_far_from_its_joint_swings_by_the_inertia_that_is_known() -> None:
    """κ / (I + κ² / m) has two solutions, and I is of second order in κ: a linear update was 130 sigma off, and converged."""
    rng = np.random.default_rng(4)
    own = anypedestal.tables(rng, 4, offset_m=0.03)
    flown = anypedestal.fly(rng, own, "swing", 0.05, 15.0)
    for body in range(2):
        found = swung(rng, own, flown, body).conclusions[0]
        assert np.linalg.norm(own.arm[body]) > 0.06
        assert found.estimates["cg_z"].verdict == "converged"
        assert np.abs((found.values - own.ten[body]) / found.sigmas).max() < 3.5
        assert found.sigmas[8] < 0.02 * np.linalg.norm(own.arm[body])


@pytest.mark.thorough
@pytest.mark.seeds
def test_known_inertias_that_the_ratios_of_a_swing_deny_are_contradicted() -> None:
    """Each by itself may be right, since the log's scale is open; together they are not."""
    own, flown, rng = moved(5, "swing", 1)
    size = 0.01 * float(np.trace(own.inertia[0])) / 3
    known = {
        name: {"value": float(value) * (0.6 if name == "izz" else 1.0), "sigma": size}
        for name, value in zip(INERTIA, own.inertia[0][np.triu_indices(3)], strict=True)
    }
    known["mass"] = {"value": float(own.mass[0]), "sigma": 1e-3 * float(own.mass[0])}
    used = anypedestal.vehicle_of(own, 0, flown, False, **known)
    found = flow.examine(anypedestal.log_of(deepcopy(rng), own, 0, flown, used), VehicleSource(used, "", ""))
    assert "known-mismatch" in [notice.code for notice in found.notices]
    assert {one.verdict for one in found.conclusions[0].estimates.values()} == {"contradicted"}


def test_a_result_has_the_nine_with_value_sigma_unit_and_verdict() -> None:
    _, (answer,) = found_of(3, "wheels", 1)
    found = schema.Result.model_validate_json(escape.document(build.result(answer)))
    nine = found.phases[0].about_pivot
    assert tuple(nine) == ABOUT_PIVOT
    assert {one.unit for one in nine.values()} == {"kg m^2", "kg m"}
    assert all(one.value is not None and one.sigma is not None and one.verdict == "converged" for one in nine.values())


@pytest.mark.thorough
def test_where_second_orders_lead_the_causal_estimate_astray_it_is_led_by_the_fit() -> None:
    """A gyro's bias of 1e-3 rad/s beside a first moment that is told to 3e-7 kg m: it had been contradicted, 4.2 sigma from the fit."""
    rng = np.random.default_rng([0, 4])
    own = anypedestal.tables(rng, 4)
    flown = anypedestal.fly(rng, own, "wheels", 0.05, 30.0)
    used = anypedestal.vehicle_of(own, 2, flown, True)
    log = anypedestal.log_of(np.random.default_rng([0, 2, 1]), own, 2, flown, used, biases=True)
    found = flow.examine(log, VehicleSource(used, "", ""))
    told = found.conclusions[0]
    assert told.contradiction == ""
    assert {one.verdict for one in told.about_pivot.values()} == {"converged"}
    values, sigmas = (np.array([getattr(told.about_pivot[name], part) for name in ABOUT_PIVOT], dtype=float) for part in ("value", "sigma"))
    assert np.abs((values - own.nine[2]) / sigmas).max() < 3
    assert len(found.histories[0].time_s) == log.cycles - 1  # wheels tell their torque from the second speed on


@pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
@pytest.mark.parametrize(
    ("kind", "biases", "noise"),
    [("wheels", True, 1.0), pytest.param("jets", False, 1.0, marks=pytest.mark.thorough), ("wheels", False, 0.0)],
)
def test_on_board_it_says_the_nine_cycle_by_cycle(kind: anypedestal.Kind, biases: bool, noise: float) -> None:
    """Of 30 tables: 95 % intervals cover, within what these values scatter by; without noise the values are the truth's."""
    own, flown, rng = moved(9104, kind, 30)
    rng, answers = deepcopy(rng), []
    for body in range(30):
        used = anypedestal.vehicle_of(own, body, flown, biases)
        log = anypedestal.log_of(rng, own, body, flown, used, noise, biases)
        exact = tuple(f"wheels.{number}.speed_step_rad_s=0.0" for number in range(len(used.wheels)))
        resolved = resolve.stated(VehicleSource(vehiclefile.changed(used, exact), "", ""))
        flight = kernelflight.Flight(resolved.commands, resolved.phases[0].vehicle, resolved.phases[0].rule)
        whole = slice(0, log.cycles)
        answers.append(flight.step(kernelflight.cycles_of(log, whole, whole), last=True))
    values, sigmas = (np.array([getattr(said, part)[-1, :9] for said in answers]) for part in ("values", "sigmas"))
    z = (values - own.nine) / sigmas
    if noise == 0:
        assert np.abs(z).max() < 0.05
        return
    assert 0.9 <= np.mean(np.abs(z) < 1.96) <= 0.99
    assert 0.85 < np.sqrt((z**2).mean()) < 1.15


@pytest.mark.thorough
def test_a_bias_is_told_where_a_body_hangs_far_below_its_pivot() -> None:
    """Its weight pulls by 70 N m for each radian that the bias carries the attitude off: one pass about none called it a docking."""
    hung = ("truth.cg_x=0.01", "truth.cg_y=-0.02", "truth.cg_z=-0.58", "initial.rate_rad_s=[0.2, 0.2, 0.1]")
    flown = fly("pedestal", *hung, seeds=(1,))
    found = flow.examine(flown.log(0), VehicleSource(flown.vehicle, "", ""))
    told = found.conclusions[0]
    assert {notice.code for notice in found.notices} == set()
    assert {one.verdict for one in told.about_pivot.values()} == {"converged"}
    assert max(abs(z) for z in faulty.z_scores(found, flown.truth[0, 0]).values()) < 3.5
