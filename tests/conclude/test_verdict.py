from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from massprop_cli import INERTIA
from massprop_cli.conclude.contradict import unphysical_contradiction
from massprop_cli.conclude.physical import breach, nearest_consistent
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Conclusion, Estimate, conclude, contradicted, in_doubt
from massprop_cli.estimate.history import History
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.result.build import physical
from tests import flight

SIZES = np.array([4.0] * 6 + [0.5] * 3 + [16.0])


def history(rows: int = 300) -> History:
    values = np.tile(np.array([1.0, 0.1, 0.1, 1.5, 0.1, 1.5, 0.01, 0.01, 0.01, 16.0]), (rows, 1))
    return History(
        phase=Phase(name="all", start_s=0.0, end_s=99.0),
        cycles=slice(0, rows),
        time_s=0.05 * np.arange(1, rows + 1),
        values=values,
        sigmas=np.tile(1e-3 * SIZES, (rows, 1)),
        covariance=np.diag((1e-3 * SIZES) ** 2),
        innovation=np.zeros((rows, 6)),
        innovation_sigma=np.ones((rows, 6)),
        normalised=np.zeros((rows, 6)),
        natural_sizes=SIZES,
        information_share=np.full((10, 6), 1 / 6),
        drowned=np.zeros(6, dtype=bool),
        observable=np.ones(10, dtype=bool),
        bare=(values[-1], np.diag((1e-3 * SIZES) ** 2)),
    )


def vehicle(method: str = "default", **convergence: object) -> Vehicle:
    return flight.vehicle(estimator={"method": method}, convergence=convergence)


def test_standing_still_and_informed_is_converged_from_the_start_of_the_stretch() -> None:
    found = history()
    found.values[:50, 0] += np.linspace(5, 0.1, 50)
    estimate = conclude(found, vehicle()).estimates["ixx"]
    assert estimate.verdict == "converged"
    assert estimate.final_at_s == pytest.approx(0.05 * 51, abs=0.051)
    assert estimate.value == 1.0


def test_a_quantity_that_stood_still_uninformed_is_not_excited() -> None:
    found = history()
    found.sigmas[:, 9] = 5.0  # above a quarter of 16
    assert conclude(found, vehicle()).estimates["mass"].verdict == "not_excited"


def test_an_estimate_that_ends_on_the_way_says_so_and_not_that_the_motion_was_poor() -> None:
    found = history()
    found.values[200:, 0], found.sigmas[200:, 0] = np.nan, np.nan
    found.values[:, 9], found.sigmas[:, 9] = np.nan, np.nan  # of what was never told there is nothing that ended
    estimates = conclude(found, vehicle()).estimates
    assert (estimates["ixx"].value, estimates["ixx"].verdict) == (None, "not_converged")
    assert estimates["ixx"].reason == Reason.of("estimate-ended", until_s=10.0)
    assert estimates["mass"].verdict == "not_excited"


def test_a_moment_known_to_half_its_own_value_is_not_excited() -> None:
    found = history()
    found.sigmas[:, 0] = 0.5
    assert conclude(found, vehicle()).estimates["ixx"].verdict == "not_excited"


def test_too_short_a_stretch_is_not_converged() -> None:
    found = history(90)
    assert {e.verdict for e in conclude(found, vehicle()).estimates.values()} == {"not_converged"}
    assert {e.verdict for e in conclude(found, vehicle(count=50)).estimates.values()} == {"converged"}


def test_what_is_missing_is_counted() -> None:
    found = history(80)
    assert conclude(found, vehicle()).estimates["ixx"].reason == Reason.of("unsteady", steady=79, count=100)
    found.values[60, 0] += 1.0
    assert conclude(found, vehicle()).estimates["ixx"].reason == Reason.of("unsteady", steady=18, count=100)


@pytest.mark.parametrize(("rows", "share", "verdict"), [(80, 0.05, "converged"), (80, 0.2, "not_converged"), (24, 0.05, "not_converged")])
def test_a_sigma_far_below_the_tolerance_makes_up_for_updates_that_are_missing(rows: int, share: float, verdict: str) -> None:
    """The tolerance is a hundredth of the natural size; a quarter of the hundred updates must have come."""
    found = history(rows)
    found.sigmas[:] = share * 0.01 * SIZES
    estimate = conclude(found, vehicle()).estimates["mass"]
    assert estimate.verdict == verdict
    assert (estimate.final_at_s is not None) == (verdict == "converged")


def test_a_jump_near_the_end_breaks_convergence_under_default_but_stays_latched_under_thesis() -> None:
    found = history()
    found.values[280:, 0] += 0.5
    assert conclude(found, vehicle()).estimates["ixx"].verdict == "not_converged"
    latched = conclude(found, vehicle("thesis")).estimates["ixx"]
    assert (latched.verdict, latched.value) == ("converged", 1.0)


def test_thesis_latches_anew_after_a_larger_change() -> None:
    found = history()
    found.values[120:, 0] += 0.5
    latched = conclude(found, vehicle("thesis")).estimates["ixx"]
    assert latched.value == 1.5
    assert latched.final_at_s == pytest.approx(0.05 * 122)


def test_thesis_value_is_the_one_at_which_the_count_was_reached() -> None:
    found = history()
    found.values[:, 9] = np.linspace(10, 20, 300)  # 0.033 a step, within 0.1
    latched = conclude(found, vehicle("thesis")).estimates["mass"]
    assert latched.value == found.values[100, 9]


def test_thesis_covariance_is_that_of_the_sigmas_where_the_counts_were_reached() -> None:
    """Of each quantity's own update, with the correlations of the end."""
    found = history()
    found.sigmas[:] *= np.linspace(3.0, 1.0, len(found.sigmas))[:, None]
    found.covariance[0, 9] = found.covariance[9, 0] = 0.5 * found.sigmas[-1, 0] * found.sigmas[-1, 9]
    conclusion = conclude(found, vehicle("thesis"))
    sigmas = np.array([estimate.sigma for estimate in conclusion.estimates.values()], dtype=float)
    assert (sigmas > 1.5 * found.sigmas[-1]).all()
    np.testing.assert_allclose(np.sqrt(np.diag(conclusion.covariance)), sigmas, rtol=1e-12)
    assert conclusion.covariance[0, 9] == pytest.approx(0.5 * sigmas[0] * sigmas[9], rel=1e-12)


def test_what_is_contradicted_keeps_its_value_and_what_nothing_shows_stays_unobservable() -> None:
    found = replace(history(), observable=np.arange(10) != 1)
    before = conclude(found, vehicle())
    touched = np.zeros(10, dtype=bool)
    touched[:2] = True
    after = contradicted(before, (Reason("steady"),), touched).estimates
    assert (after["ixx"].verdict, after["ixx"].value, after["ixx"].final_at_s) == ("contradicted", before.estimates["ixx"].value, None)
    assert {name: one for name, one in after.items() if name != "ixx"} == {n: one for n, one in before.estimates.items() if n != "ixx"}
    assert after["ixy"].verdict == "unobservable"


def test_tolerances_scale_with_the_vehicle_by_default() -> None:
    found = history()
    tiny = replace(
        found, values=1e-5 * found.values, sigmas=1e-5 * found.sigmas, covariance=1e-10 * found.covariance, natural_sizes=1e-5 * SIZES
    )
    tiny.values[::2, 0] *= 1.2  # 20 % to and fro: steady only for a tolerance made for 20 kg
    assert conclude(tiny, vehicle()).estimates["ixx"].verdict == "not_converged"
    assert conclude(tiny, vehicle(relative=False)).estimates["iyy"].verdict == "converged"


def test_unobservable_and_untold_quantities_have_no_value() -> None:
    found = history()
    found.observable[7] = False
    found.sigmas[:, 8] = 1.0
    estimates = conclude(found, vehicle()).estimates
    assert (estimates["cg_y"].verdict, estimates["cg_y"].value) == ("unobservable", None)
    assert (estimates["cg_z"].verdict, estimates["cg_z"].value) == ("not_excited", None)
    covariance = conclude(found, vehicle()).covariance
    assert np.isnan(covariance[7]).all()
    assert np.isfinite(covariance[np.ix_([0, 9], [0, 9])]).all()


def test_channels_that_disturbances_dominate_do_not_count_as_excitation() -> None:
    found = history()
    found.information_share[5] = [0, 0, 0.9, 0.1, 0, 0]
    found.drowned[2] = True
    estimates = conclude(found, vehicle()).estimates
    assert estimates["izz"].verdict == "not_excited"
    assert estimates["ixx"].verdict == "converged"


def test_inertia_about_the_origin_is_steiners() -> None:
    conclusion = conclude(history(), vehicle())
    points = np.array([[0.3, 0.1, -0.2], [-0.1, 0.2, 0.4]])
    inertia = sum(8.0 * ((p @ p) * np.eye(3) - np.outer(p, p)) for p in points)
    c = points.mean(0)
    about_cg = sum(8.0 * (((p - c) @ (p - c)) * np.eye(3) - np.outer(p - c, p - c)) for p in points)
    found = history()
    found.values[:] = np.concatenate([about_cg[np.triu_indices(3)], c, [16.0]])
    np.testing.assert_allclose(conclude(found, vehicle()).inertia_about_origin, inertia, atol=1e-12)
    assert conclusion.principal_moments[0] > 0


def test_a_thesis_filter_that_knows_less_than_the_body_is_large_has_not_converged() -> None:
    """Its absolute tolerances and P0 were made for 20 kg: on a body of 1e-5 kg m² they would call anything converged."""
    found = history()
    tiny = replace(found, values=1e-5 * found.values, natural_sizes=1e-5 * SIZES)
    assert {e.verdict for e in conclude(tiny, vehicle("thesis")).estimates.values()} == {"not_excited"}


def test_a_flat_bodys_noise_breaks_no_law_and_a_body_that_none_can_be_does() -> None:
    """A plate's moments are at the limit of what a body has: half of its estimates are beyond, none by more than their sigmas allow."""
    rng = np.random.default_rng(8)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    root = 1e-3 * rng.normal(size=(6, 6))
    found = conclude(history(), vehicle())

    def drawn(moments: list[float]) -> Conclusion:
        six = (turn @ np.diag(moments) @ turn.T)[np.triu_indices(3)] + root @ rng.normal(size=6)
        covariance = np.zeros((10, 10))
        covariance[:6, :6] = root @ root.T
        told = {
            name: Estimate(value, 1.0, "kg m^2", "converged", None, Reason("steady"))
            for name, value in zip(INERTIA, six.tolist(), strict=True)
        }
        return replace(found, estimates=found.estimates | told, covariance=covariance)

    # a rod's least moment is none but for noise
    thin = [breach(drawn([0.0, 1.5, 1.5001])) for _ in range(100)]
    below = [one for one in thin if one and "not positive definite" in one.message]
    assert 30 < len(below) < 70
    assert not any(one.certain for one in below)
    assert all("within its sigma" in one.message for one in below)
    none = breach(drawn([-0.05, 1.5, 1.6]))
    assert none is not None
    assert none.certain
    flat = [drawn([0.9, 1.5, 2.4]) for _ in range(400)]
    broken = [breach(one) for one in flat]
    assert not any(one.certain for one in broken if one)
    assert 0.4 < np.mean([one is not None for one in broken]) < 0.6
    lacking = [one.principal_moments @ [-1, -1, 1] for one in flat]
    # beyond twice what scatters by draws are a fortieth of a normal distribution, and the note says the sigma that they scatter by
    sigmas = [float(one.message.split(" ± ")[1].split()[0]) for one in broken if one]
    np.testing.assert_allclose(sigmas, np.std(lacking), rtol=0.1)
    none = breach(drawn([0.9, 1.5, 2.4 + 6 * float(np.std(lacking)) + 0.01]))
    assert none is not None
    assert none.certain
    assert breach(drawn([0.9, 1.6, 2.4])) is None


@pytest.mark.parametrize(
    ("density", "said", "certain"),
    [(0.02, "less dense than air", False), (0.2, "", False), (1e4, "", False), (4e4, "denser than any", True)],
)
def test_a_body_that_is_thinner_than_air_is_said_and_one_denser_than_osmium_contradicted(density: float, said: str, certain: bool) -> None:
    """Oracle: of a ball 2/5 m R² thrice, with the radius that its mass and density give."""
    mass, whole = 16.0, conclude(history(), vehicle())
    radius = (mass / (4 / 3 * np.pi * density)) ** (1 / 3)
    moments = dict(zip(INERTIA, 2 / 5 * mass * radius**2 * np.array([1.0, 0, 0, 1, 0, 1]), strict=True))
    told = {name: Estimate(value, 1e-4 * value, "kg m^2", "converged", None, Reason("steady")) for name, value in moments.items()}
    told["mass"] = Estimate(mass, 1e-3, "kg", "converged", None, Reason("steady"))
    scale = 2 / 5 * mass * radius**2
    ball = replace(whole, estimates=whole.estimates | told, covariance=np.eye(10) * (1e-4 * scale) ** 2, rotating_mass=mass)
    found, against = breach(ball), unphysical_contradiction(ball)
    assert (found is not None) == bool(said)
    assert found is None or (said in found.message and f"{density:.2g} kg/m^3" in found.message)
    assert (against is not None) == certain
    assert against is None or set(np.flatnonzero(against.affected)) == {*range(6), 9}


def test_a_mass_below_its_bearings_is_none_and_has_no_nearest_inertia() -> None:
    """Also of an inertia that is not wholly informed, of which nothing is near."""
    whole = conclude(history(), vehicle())
    partly = replace(whole, estimates=whole.estimates | {"izz": Estimate(None, None, "kg m^2", "not_excited", None, Reason("drowned"))})
    for one in (whole, partly):
        found = physical(replace(one, rotating_mass=-0.5))
        assert "the mass is less than environment.bearing_mass_kg: the rotating mass is -0.5 kg" in found.note
        assert found.nearest_consistent is None
    assert physical(partly).note == ""


def test_the_nearest_consistent_inertia_is_one_that_a_body_could_have() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        inertia = turn @ np.diag(rng.uniform(-0.2, 3.0, 3)) @ turn.T
        nearest = nearest_consistent(inertia)
        low, middle, high = np.linalg.eigvalsh(nearest)
        assert low > -1e-12
        assert low + middle >= high - 1e-12
        moments, axes = np.linalg.eigh(inertia)
        second, _ = nnls(1 - np.eye(3), moments)
        np.testing.assert_allclose(nearest, (axes * (second.sum() - second)) @ axes.T, rtol=0, atol=1e-12)
    thesis = np.diag([0.35, 2.5, 2.0])
    np.testing.assert_allclose(nearest_consistent(thesis), np.diag([0.4, 2.45, 2.05]), rtol=0, atol=1e-12)
    real = np.diag([1.0, 1.5, 2.0])
    np.testing.assert_allclose(nearest_consistent(real), real, rtol=0, atol=1e-14)


def test_a_quantity_that_was_not_excited_says_which_motion_it_wants() -> None:
    found = history()
    found.sigmas[:, 7] = SIZES[7]
    found.observable[9] = False
    estimates = conclude(found, vehicle()).estimates
    assert estimates["cg_y"].verdict == "not_excited"
    assert "force across Y (along X or Z)" in str(estimates["cg_y"].reason)
    assert estimates["mass"].verdict == "unobservable"
    assert "needs force" in str(estimates["mass"].reason)


@pytest.mark.parametrize(("index", "limit"), [(0, 0.05), (7, 0.05), (9, 0.1)])
def test_the_thesis_calls_steady_what_moves_by_no_more_than_its_tolerances(index: int, limit: float) -> None:
    """0.05 kg m², 0.05 m and 0.1 kg from update to update (Wright 2000, chapter 4)."""
    for share, verdict in ((0.98, "converged"), (1.02, "not_converged")):
        found = history()
        found.values[::2, index] += share * limit
        assert list(conclude(found, vehicle("thesis")).estimates.values())[index].verdict == verdict


def test_only_what_was_converged_is_held_back_by_doubt() -> None:
    found = history()
    found.sigmas[:, 9] = 5.0
    before, why = conclude(found, vehicle()), Reason("changed")
    after = in_doubt(before, {"ixx": why, "mass": why}).estimates
    assert (after["ixx"].verdict, after["ixx"].value, after["ixx"].final_at_s, after["ixx"].reason) == ("not_converged", 1.0, None, why)
    assert {name: one for name, one in after.items() if name != "ixx"} == {
        name: one for name, one in before.estimates.items() if name != "ixx"
    }


def test_what_turns_on_a_bearing_has_its_inertia_about_it_too_and_a_free_body_has_not() -> None:
    """Steiner's theorem for the mass less the bearing's."""
    used = flight.vehicle("air_bearing", environment={"bearing_position_m": (0.2, -0.1, 0.3)})
    pivot = conclude(history(), used).pivot
    assert pivot is not None
    arm, six = np.array([0.01, 0.01, 0.01]) - (0.2, -0.1, 0.3), [1.0, 0.1, 0.1, 1.5, 0.1, 1.5]
    about = (11.0 * (arm @ arm * np.eye(3) - np.outer(arm, arm)))[np.triu_indices(3)] + six
    np.testing.assert_allclose(pivot[0], np.append(about, 11.0 * arm), rtol=1e-12)
    whole = conclude(history(), vehicle())
    assert whole.pivot is None
    assert whole.thrust_scale_sigma == 0.0


def test_on_a_bearing_a_cg_without_a_mass_says_what_to_weigh() -> None:
    found = history()
    found.sigmas[:, 6:] = 50.0
    hung = conclude(found, flight.vehicle("air_bearing")).estimates
    assert {hung[name].reason.code for name in ("cg_x", "cg_y", "cg_z")} == {"unweighed"}
    assert "unweighed" not in {one.reason.code for one in conclude(found, vehicle()).estimates.values()}
    found.sigmas[:, 9] = 1e-3
    assert "unweighed" not in {one.reason.code for one in conclude(found, flight.vehicle("air_bearing")).estimates.values()}


def test_what_counts_is_what_is_informed_at_the_end_by_the_prior_of_its_own_method() -> None:
    found = history()
    found.sigmas[:100, 0] = 5.0
    assert conclude(found, vehicle()).estimates["ixx"].verdict == "converged"
    found.sigmas[-1, 0] = 5.0
    assert conclude(found, vehicle()).estimates["ixx"].verdict == "not_excited"
    sharp = {"p1": [1e-9] * 9}
    for method, verdict in (("default", "converged"), ("thesis", "not_excited")):
        used = flight.vehicle(estimator={"method": method, "thesis": sharp})
        assert conclude(history(), used).estimates["iyy"].verdict == verdict
