"""Shifts that the filter carries beside its mean, against estimating again with the assumption changed."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross_matrix
from massprop_cli.conclude.assumptions import AssumptionEffects, sensitivity_analysis
from massprop_cli.diagnosis import delay
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import BY_NAME
from massprop_cli.estimate import engine, offline
from massprop_cli.estimate.history import History
from massprop_cli.flow import Analysis
from massprop_cli.model.assumptioncolumns import assumption_columns
from massprop_cli.model.plant import plant_of
from massprop_cli.model.regressors import regressors
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider, OtherReading, Reading, Variant, variant
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from massprop_cli.result.build import effective_settings
from tests import faulty
from tests.flight import resolved


@pytest.fixture(scope="module")
def flyer() -> Analysis:
    return faulty.examined(*faulty.sample("free-flyer"))


@pytest.fixture(scope="module")
def bearing() -> Analysis:
    return faulty.examined(*faulty.sample("air-bearing"))


def by_code(found: Analysis, code: str) -> list[AssumptionEffects]:
    return [assumption for assumption in found.assumptions if assumption.code == code]


def again(found: Analysis, *assignments: str, delay: float = 2.0) -> Array:
    """(10,) values of the off-line fit under another vehicle file, noise and disturbances as before."""
    used = faulty.stated(found.vehicle, *assignments)
    samples = Timing(delay, 0.0).of(found.log, used)
    (history,) = found.settled
    assert history.reference is not None
    moved: Array = offline.fit(samples, history.cycles, history.phase, history.reference, resolved(used)).history.values[-1]
    return moved


def held(assumption: AssumptionEffects, moved: Array, found: Analysis, relative: float) -> None:
    """The effect against the shift ``moved`` (10,): to ``relative`` of itself or a fiftieth of a sigma."""
    (effect,) = assumption.effects
    for i, name in enumerate(QUANTITIES):
        sigma = found.settled[0].sigmas[-1, i]
        assert effect.change.get(name, 0.0) == pytest.approx(moved[i], rel=relative, abs=0.02 * sigma), name


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_imu_a_millimetre_further_on_shifts_what_is_estimated_as_it_says(flyer: Analysis, axis: int) -> None:
    place = [0.1, -0.06, 0.12]
    place[axis] += 1e-3
    moved = again(flyer, f"imu.position_m={place}") - flyer.settled[0].values[-1]
    held(by_code(flyer, "imu-position")[axis], moved, flyer, 0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_the_imu_reads_is_all_that_its_turn_and_the_gyros_scale_change(flyer: Analysis, axis: int) -> None:
    """Against the log read anew a little changed, which goes through motion, coupling and lever arm: these stay, to first order."""
    cycles, (settled,) = slice(100, 300), flyer.settled
    assert settled.reference is not None
    own = np.array(flyer.vehicle.imu.body_from_imu)[:, axis]
    turn, angle = cross_matrix(np.eye(3)[axis]), 1e-6
    here, stated = OtherReading(flyer.samples), Setup(flyer.log, flyer.vehicle, Timing(2.0, 0.0))
    turned = BY_NAME["mounting"].differing(stated, angle, axis).vehicle
    scaled = OtherReading(flyer.samples.changed(gyro=1 + 1e-6 * np.eye(3)[axis]))
    variants = (
        *(Reading(turn, turn), Reading(np.outer(own, own), np.zeros((3, 3)))),
        *(Variant(here, OtherReading(flyer.samples.changed(turned), turned), angle), Variant(here, scaled, 1e-6)),
    )
    at = regressors(flyer.samples, cycles, settled.reference, flyer.vehicle), flyer.samples, cycles, settled.reference, flyer.vehicle
    columns = assumption_columns(*at, Consider(variants), ResponseMap(plant_of(flyer.vehicle)))
    driven, measured = (each[..., 1:] for each in columns)
    assert not any(each[..., 0].any() for each in columns)
    moved = np.abs(measured[:, :3, 2:]).max()
    assert moved > 0.1
    # beside the rate; the step of the differences; a fiftieth of the noise of 0.02 m/s^2
    np.testing.assert_allclose(driven[..., :2], driven[..., 2:], atol=1e-4 * moved)
    np.testing.assert_allclose(measured[:, :3, :2], measured[:, :3, 2:], atol=1e-6)
    np.testing.assert_allclose(measured[:, 3:, :2], measured[:, 3:, 2:], atol=4e-4)


def test_divert_jets_alone_carry_the_mass_and_nothing_in_the_log_shows_it(flyer: Analysis) -> None:
    (assumption,) = by_code(flyer, "mass-thrust")
    diverts = [jet.name for jet in flyer.vehicle.jets if jet.name.startswith("divert")]
    assert f"depends only on the thrust of {', '.join(diverts)};" in assumption.message
    (effect,) = assumption.effects
    assert effect.seen_sigma is not None
    assert effect.seen_sigma < 1
    stronger = faulty.pushing(flyer.vehicle, dict.fromkeys(diverts, 1.01))
    assignments = [f"jets.{i}.force_n={list(jet.force_n)}" for i, jet in enumerate(stronger.jets) if jet.name in diverts]
    held(assumption, again(flyer, *assignments) - flyer.settled[0].values[-1], flyer, 0.05)
    assert effect.change["mass"] == pytest.approx(0.01 * flyer.settled[0].values[-1, 9], rel=0.05)


def test_all_thrust_a_percent_stronger_is_a_percent_of_mass_and_inertia_and_stands_in_the_result(flyer: Analysis) -> None:
    (assumption,) = by_code(flyer, "thrust-scale")
    assert not assumption.stated
    (effect,) = assumption.effects
    assert effect.seen_sigma is None
    assert set(effect.change) == {"ixx", "ixy", "ixz", "iyy", "iyz", "izz", "mass"}
    for name, change in effect.change.items():
        assert change == pytest.approx(0.01 * (flyer.conclusions[0].estimates[name].value or 0.0), rel=1e-12)


def test_a_weighed_mass_does_not_calibrate_thrust_that_is_taken_as_exact(flyer: Analysis) -> None:
    """Inertia is as it was, so what an error of the thrust does to it is said as it was; with a stated sigma it follows the mass."""
    log, used = faulty.sample("free-flyer")
    heavier = faulty.stated(used, "known.mass={value=22.2, sigma=0.02}")
    weighed = faulty.examined(log, heavier)
    (before,), (after,) = by_code(flyer, "thrust-scale"), by_code(weighed, "thrust-scale")
    assert weighed.conclusions[0].values[0] == pytest.approx(flyer.conclusions[0].values[0], rel=1e-6)
    assert "states no uncertainty of it" in after.message
    assert after.effects[0].change == {name: pytest.approx(v, rel=1e-4) for name, v in before.effects[0].change.items() if name != "mass"}
    told = faulty.examined(log, faulty.stated(heavier, "thrust.scale_sigma=0.05"))
    assert by_code(told, "thrust-scale") == []
    assert told.conclusions[0].values[0] == pytest.approx(1.02 * flyer.conclusions[0].values[0], rel=0.01)


def test_all_thrust_a_percent_stronger_moves_the_cg_on_a_bearing_whose_part_does_not_turn(bearing: Analysis) -> None:
    """Its CG was said to stay."""
    (assumption,) = by_code(bearing, "thrust-scale")
    assert "moves the CG, because the bearing's mass does not turn" in assumption.message
    stronger = faulty.pushing(bearing.vehicle, dict.fromkeys([jet.name for jet in bearing.vehicle.jets], 1.01))
    jets = [f"jets.{i}.force_n={list(jet.force_n)}" for i, jet in enumerate(stronger.jets)]
    moved = again(bearing, *jets) - bearing.settled[0].values[-1]
    held(assumption, moved, bearing, 0.05)
    assert set(CG) & set(assumption.effects[0].change)


def test_an_imu_position_that_is_not_stated_is_said_to_be_a_default() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    imu = used.imu.model_copy(update={"position_m": (0.0, 0.0, 0.0)})
    imu.__pydantic_fields_set__.discard("position_m")
    found = faulty.examined(log, used.model_copy(update={"imu": imu}))
    assumption = by_code(found, "imu-position")[0]
    assert not assumption.stated
    assert "not stated; assumed as 0, 0, 0 m" in assumption.message


@pytest.mark.parametrize(("code", "key"), [("bearing-mass", "bearing_mass_kg"), ("gravity", "gravity_m_s2")])
def test_a_bearing_says_what_its_mass_and_gravity_do(bearing: Analysis, code: str, key: str) -> None:
    (assumption,) = by_code(bearing, code)
    step = 1e-4  # so small that the linear part is all
    value = getattr(bearing.vehicle.environment, key)
    moved = (again(bearing, f"environment.{key}={value * (1 + step)}") - bearing.settled[0].values[-1]) * 0.01 / step
    held(assumption, moved, bearing, 0.1)


@pytest.mark.parametrize(("line", "by"), [("divert_x", 0.04), ("divert_y", 0.04), ("roll", 0.001)])
def test_a_jets_thrust_on_a_bearing_shifts_and_shows_what_fitting_again_does(bearing: Analysis, line: str, by: float) -> None:
    """Of a push only the level part moves body and base; the vertical one the bearing takes."""
    assert bearing.examination is not None
    (response,) = bearing.examination.responses
    (settled,) = bearing.settled
    assert response is not None
    assert settled.reference is not None
    names = [jet.name for jet in bearing.vehicle.jets]
    step = np.zeros(response.shift.shape[1])
    step[len(step) - len(names) :] = [name.startswith(line) for name in names]
    ends = []
    for factor in np.exp([-by, 0.0, by]):
        used = faulty.pushing(bearing.vehicle, {name: float(factor) for name in names if name.startswith(line)})
        samples = Timing(2.0, 0.0).of(bearing.log, used)
        ends.append(offline.fit(samples, settled.cycles, settled.phase, settled.reference, resolved(used)).history)
    moved = (ends[2].values[-1] - ends[0].values[-1]) / (2 * by)
    shift = response.shift @ step
    shift[9] /= -(settled.reference.mu**2)
    for found, expected, sigma, name in zip(shift, moved, settled.sigmas[-1], QUANTITIES, strict=True):
        assert found == pytest.approx(expected, rel=0.02, abs=2.0 * sigma), name  # of a percent: a fiftieth of a sigma
    squares = [sum(float((part**2).sum()) for part in end.whitened()) for end in ends]
    curvature, slope = (squares[0] + squares[2] - 2 * squares[1]) / (2 * by**2), (squares[2] - squares[0]) / (4 * by)
    assert float(step @ response.misfit @ step) == pytest.approx(curvature, rel=0.05)
    assert float(response.gram[0, 1:] @ step) == pytest.approx(slope, rel=0.05, abs=0.2 * np.sqrt(curvature))


def test_a_delay_a_tenth_of_a_cycle_longer_shifts_what_is_estimated_as_it_says(flyer: Analysis) -> None:
    (assumption,) = by_code(flyer, "command-delay")
    step = 0.002
    moved = (again(flyer, delay=2.0 + step) - again(flyer, delay=2.0 - step)) * 0.1 / (2 * step)
    held(assumption, moved, flyer, 0.1)


def shorter(consider: Consider) -> History:
    log, used = faulty.sample("free-flyer", 20.0)
    samples = Timing(2.0, 0.0).of(log, used)
    return engine.replay(samples, slice(2, 400), faulty.examined(log, used).histories[0].phase, resolved(used), consider)


def test_an_uncertain_delay_enters_every_sigma_by_its_shift_and_no_value() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    timing = Timing(2.0, 0.0)
    later = variant(BY_NAME["delay"], Setup(log, used, timing), Stream.of(log, used, timing))
    assert later is not None
    plain, wide = shorter(Consider()), shorter(Consider((later,), np.array([[0.01**2]])))
    np.testing.assert_allclose(wide.values, plain.values, rtol=1e-6, atol=1e-9, equal_nan=True)
    told = np.isfinite(plain.sigmas[:, 0])
    assert (wide.sigmas[told, :9] >= plain.sigmas[told, :9] * (1 - 1e-9)).all()
    # against the filter fed with commands read a little later and a little earlier
    ends = [
        engine.replay(Timing(2.0 + by, 0.0).of(log, used), slice(2, 400), plain.phase, resolved(used)).values[-1, :9]
        for by in (-0.002, 0.002)
    ]
    shift = (ends[1] - ends[0]) / 0.004
    expected = np.sqrt(plain.sigmas[-1, :9] ** 2 + (0.01 * shift) ** 2)
    np.testing.assert_allclose(wide.sigmas[-1, :9], expected, rtol=0.1)


def test_the_sigma_of_a_delay_that_was_found_is_among_the_settings_and_gives_the_result_back() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    found = faulty.examined(log, faulty.stated(used, 'cycle.command_delay_cycles="auto"'))
    assert found.detected is not None
    settings = effective_settings(found)
    assert settings["cycle.command_delay_sigma_cycles"] == found.detected.sigma.delay > 0
    given = [f"cycle.{key}={settings[f'cycle.{key}']!r}" for key in ("command_delay_cycles", "command_delay_sigma_cycles")]
    back = faulty.examined(log, faulty.stated(used, *given))
    np.testing.assert_array_equal(back.histories[0].sigmas, found.histories[0].sigmas)
    np.testing.assert_array_equal(back.histories[0].values, found.histories[0].values)


@pytest.mark.parametrize("later", [-0.04, 0.05])
def test_a_delay_a_little_off_is_told_by_its_column_as_by_a_search(later: float) -> None:
    log, used = faulty.sample("free-flyer")
    said = faulty.stated(used, f"cycle.command_delay_cycles={2.0 - later}")
    samples = Stream.of(log, said, Timing(2.0 - later, 0.0))
    about = faulty.examined(log, used).settled
    told = sensitivity_analysis(log, resolved(said), Timing(2.0 - later, 0.0), samples, about).delay()
    assert told is not None
    found, sigma, before, after = told
    searched = delay.detect(Setup(log, resolved(said), Timing(2.0 - later, 0.0)), [about[0].cycles], ["delay"])
    assert searched is not None
    assert sigma == pytest.approx(searched.sigma.delay, rel=0.1)
    # the sample's delay is two cycles; the column is linear, the step a fraction of a cycle
    assert found == pytest.approx(later, rel=0.02, abs=4 * sigma)
    rows = 6 * (about[0].cycles.stop - about[0].cycles.start)
    assert after == pytest.approx(rows, abs=4 * np.sqrt(2 * rows))  # noise alone is left
    assert before > 2 * rows
