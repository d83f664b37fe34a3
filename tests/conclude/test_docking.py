from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements
from massprop_cli.conclude import docking
from massprop_cli.conclude.reason import Reason
from massprop_cli.inputs.vehicle import Known, Phase
from tests import faulty, flight
from tests.analysed import SAMPLES, analysed


def body(points: Array, masses: Array) -> Array:
    """(10,) quantities of point masses, from their definitions."""
    total = masses.sum()
    cg = (masses[:, None] * points).sum(0) / total
    r = points - cg
    inertia = sum(m * ((p @ p) * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, r, strict=True))
    return np.concatenate([elements(np.asarray(inertia)), cg, [total]])


def test_difference_recovers_a_body_taken_from_a_pair() -> None:
    rng = np.random.default_rng(1)
    points, masses = rng.standard_normal((9, 3)), rng.uniform(1, 3, 9)
    alone, object_ = body(points[:5], masses[:5]), body(points[5:], masses[5:])
    np.testing.assert_allclose(docking.difference(alone, body(points, masses)), object_, atol=1e-12)


def test_published_docked_cube_follows_from_the_true_phases() -> None:
    """A 2 m cube of 3 kg/m³ at x = 2 m on the 20 kg vehicle: combined 16.35, 62.13, 61.63 kg m², CG 1.09 m, 44 kg."""
    alone = np.array([0.35, 0, 0, 2.5, 0, 2.0, 0, 0, 0, 20.0])
    parallel = 20 * 24 / 44 * 4
    combined = np.array([16.35, 0, 0, 18.5 + parallel, 0, 18.0 + parallel, 48 / 44, 0, 0, 44.0])
    np.testing.assert_allclose(docking.difference(alone, combined), [16, 0, 0, 16, 0, 16, 2, 0, 0, 24], atol=1e-12)
    assert round(combined[3], 2) == 62.14  # printed as 62.13


def test_docked_object_of_the_recorded_docking_is_covered_by_its_sigmas() -> None:
    found = analysed("docking").docked
    assert found is not None
    truth = json.loads((SAMPLES / "docking" / "truth.json").read_text())
    for name in QUANTITIES:
        estimate = found.estimates[name]
        assert estimate.value is not None
        assert estimate.sigma is not None
        assert abs(estimate.value - truth["docked"][name]) < 4 * estimate.sigma
        assert estimate.sigma < 1.3 * truth["docked_bound"][name]
    assert (found.before, found.after) == ("single", "combined")


def test_covariance_is_that_of_sampled_phases() -> None:
    """Draw both phases from their covariances and difference the draws: the sample covariance is the propagated one."""
    analysis = analysed("docking")
    assert analysis.docked is not None
    rng = np.random.default_rng(0)
    draws = [rng.multivariate_normal(c.values, c.covariance, 8_000, method="eigh") for c in analysis.conclusions]
    sampled = np.cov(np.stack([docking.difference(a, b) for a, b in zip(*draws, strict=True)]).T)
    sigma = np.sqrt(np.diag(sampled))
    np.testing.assert_allclose(np.sqrt(np.diag(analysis.docked.covariance)) / sigma, 1, atol=0.03)
    np.testing.assert_allclose(analysis.docked.covariance / np.outer(sigma, sigma), sampled / np.outer(sigma, sigma), atol=0.05)


def test_an_object_that_weighs_less_than_nothing_is_contradicted() -> None:
    log, used = faulty.sample("docking")
    found = faulty.examined(log, faulty.stated(used, "docking.before=combined", "docking.after=single"))
    assert found.docked is not None
    assert {item.verdict for item in found.docked.estimates.values()} == {"contradicted"}
    assert found.docked.contradiction.endswith("phase single weighs less than phase combined; correct [docking]")
    assert [notice.code for notice in found.notices] == ["docked-mass"]
    # each phase by itself is as it was
    assert "contradicted" not in {item.verdict for one in found.conclusions for item in one.estimates.values()}


@pytest.mark.parametrize("mass", [-0.32, 0.19])
def test_an_object_of_less_than_three_sigmas_of_mass_may_be_none(mass: float) -> None:
    """Whether the sign of its mass is right is chance: no warning, and nothing converged."""
    found, covariance = np.array([*np.ones(6), *np.zeros(3), mass]), np.diag([*np.full(9, 1e-6), 0.39**2])
    estimates = docking.docked_estimates(found, covariance, "converged", Reason("phases-converged"), np.zeros(10, dtype=bool))
    assert {one.verdict for one in estimates.values()} == {"not_converged"}
    assert "there may be no object; weigh it" in str(estimates["mass"].reason)
    assert not docking.has_negative_mass(mass, covariance)
    assert docking.has_negative_mass(-1.2, covariance)


@pytest.mark.parametrize(("factor", "told"), [(1.0, True), (1.1, False)])
def test_a_known_mass_of_the_object_that_the_log_refutes_is_contradicted(factor: float, told: bool) -> None:
    log, used = faulty.sample("docking")
    mass = factor * json.loads((SAMPLES / "docking" / "truth.json").read_text())["docked"]["mass"]
    found = faulty.examined(
        log, faulty.stated(used, f'docking={{before="single", after="combined", known={{mass={{value={mass}, sigma=0.01}}}}}}')
    )
    assert found.docked is not None
    assert [notice.code for notice in found.notices] == ([] if told else ["known-mismatch"])
    assert {item.verdict for item in found.docked.estimates.values()} == {"converged" if told else "contradicted"}
    assert (found.docked.contradiction == "") == told
    assert told or found.docked.contradiction.startswith(f"docking.known.mass = {mass:g} is ")


def test_an_object_that_is_released_is_found_as_one_that_docks() -> None:
    """The same two phases with their times exchanged, and no [docking] stated."""
    analysis = analysed("docking")
    single, combined = analysis.conclusions
    first, last = (
        replace(a, phase=a.phase.model_copy(update={"start_s": b.phase.start_s, "end_s": b.phase.end_s}))
        for a, b in ((combined, single), (single, combined))
    )
    found = docking.docked_object((first, last), analysis.vehicle.model_copy(update={"docking": None}))
    assert found is not None
    assert (found.before, found.after) == ("single", "combined")
    assert analysis.docked is not None
    assert {name: one.value for name, one in found.estimates.items()} == {
        name: one.value for name, one in analysis.docked.estimates.items()
    }


def test_what_may_be_nothing_at_all_is_no_contradiction() -> None:
    for mass, said in ((-0.2, False), (-0.4, True), (np.nan, False)):
        assert docking.has_negative_mass(mass, 0.01 * np.eye(10)) == said


def test_an_error_common_to_all_thrust_is_the_same_in_both_phases() -> None:
    """The difference of two masses that are too large by the same part is so as well."""
    analysis = analysed("docking")
    first, second = analysis.conclusions
    wary = tuple(replace(one, thrust_scale_sigma=0.02) for one in (first, second))
    told, unsure = docking.mass_difference((first, second), analysis.vehicle), docking.mass_difference((wary[0], wary[1]), analysis.vehicle)
    assert told is not None
    assert unsure is not None
    assert unsure[0] == told[0]
    assert unsure[1] == pytest.approx(np.hypot(told[1], 0.02 * told[0]), rel=1e-9)


def test_weighed_masses_leave_the_first_moments_of_both_phases_on_a_bearing() -> None:
    """By hand: each moment is told to a part in a million and each mass to 2.5 %, two sigmas off the weighed one."""
    part, bearing = 3.0, np.array([0.0, 0.0, 0.1])
    alone = np.array([0.35, 0, 0, 2.5, 0, 2.0, 0.01, -0.02, 0.09, 20.0])
    combined = np.array([1.35, 0, 0, 3.5, 0, 3.0, 0.03, -0.01, 0.08, 26.0])
    known = [Known(value=float(one[9]), sigma=1e-4) for one in (alone, combined)]
    phases = [Phase(name=name, start_s=10.0 * i, end_s=10.0 * i + 10, known={"mass": known[i]}) for i, name in enumerate(("a", "b"))]
    environment = {"bearing_position_m": bearing.tolist(), "bearing_mass_kg": part}
    vehicle = flight.vehicle("air_bearing", environment=environment).model_copy(update={"phases": tuple(phases)})

    def told(true: Array, phase: Phase) -> SimpleNamespace:
        moment, mass, values, spread = (true[9] - part) * (true[6:9] - bearing), 1.05 * true[9], true.copy(), 1e-12 * np.eye(10)
        values[6:9], values[9] = bearing + moment / (mass - part), mass
        slope = np.append(-moment / (mass - part) ** 2, 1.0)  # of CG and mass by mass
        spread[6:, 6:] += (0.025 * mass) ** 2 * np.outer(slope, slope)
        return SimpleNamespace(bare=(values, spread), phase=phase, thrust_scale_sigma=0.0)

    values, joint = docking._joint((told(alone, phases[0]), told(combined, phases[1])), vehicle)  # type: ignore[arg-type]
    np.testing.assert_allclose(values.reshape(2, 10)[:, 6:9], [alone[6:9], combined[6:9]], atol=2e-6)
    np.testing.assert_allclose(values[[9, 19]], [17.0, 23.0], atol=1e-3)
    assert np.sqrt(np.diag(joint).reshape(2, 10)[:, 6:9]).max() < 3e-6
