"""Pooled statistics against simulated logs whose truth is known, over many seeds, and against other constructions."""

import numpy as np
import pytest
from scipy import stats

from massprop_cli import QUANTITIES
from massprop_cli.campaign import baseline, kept, page, pooled
from massprop_cli.campaign.baseline import Earlier
from massprop_cli.campaign.outcome import CampaignRow, Outcome, PhaseQuantities, StatedVehicle, Value
from massprop_cli.campaign.pooled import LogValues
from massprop_cli.campaign.summary import summary
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.tolerancefile import Gate
from massprop_cli.result.schema import Result
from tests import faulty, flight, recorded

SEEDS = 400


def draw(rng: np.random.Generator, n: int, shared: float = 0.0, slope: float = 0.0, truth: float = 22.0) -> LogValues:
    """Logs with sigmas of their own from 0.05 to 0.5, and one common error of ``shared``."""
    own = rng.uniform(0.05, 0.5, n)
    number = np.arange(1.0, n + 1)
    value = truth + slope * number + own * rng.standard_normal(n) + shared * rng.standard_normal()
    return LogValues(number, value, np.hypot(own, shared), np.full(n, shared), np.zeros(n))


@pytest.mark.parametrize("shared", [0.0, 0.3])
def test_the_mean_is_as_good_as_it_says_with_and_without_a_shared_error(shared: float) -> None:
    rng = np.random.default_rng(1)
    means = [pooled.mean(draw(rng, 20, shared)) for _ in range(SEEDS)]
    z = np.array([(found.value - 22.0) / found.sigma for found in means])
    low, high = stats.chi2.ppf([0.001, 0.999], SEEDS)
    assert low < (z**2).sum() < high
    assert all(found.shared == pytest.approx(shared) for found in means)
    assert all(found.sigma >= shared for found in means), "a shared error does not average out"


def test_the_mean_is_that_of_generalised_least_squares() -> None:
    samples = draw(np.random.default_rng(2), 7, 0.3)
    covariance = np.diag(samples.unshared**2) + 0.3**2
    weight = np.linalg.inv(covariance)
    variance = 1 / weight.sum()
    found = pooled.mean(samples)
    assert found.value == pytest.approx(variance * (weight @ samples.value).sum(), rel=1e-12)
    assert found.sigma == pytest.approx(np.sqrt(variance), rel=1e-12)


@pytest.mark.parametrize("shared", [0.0, 5.0])
def test_scatter_is_chi_square_where_sigmas_hold_whatever_is_shared(shared: float) -> None:
    rng = np.random.default_rng(3)
    found = [scatter for _ in range(SEEDS) if (scatter := pooled.scatter(draw(rng, 12, shared)))]
    assert {one["degrees_of_freedom"] for one in found} == {11}
    assert stats.kstest([one["p_value"] for one in found], "uniform").pvalue > 0.001
    assert stats.kstest([one["chi_square"] for one in found], stats.chi2(11).cdf).pvalue > 0.001
    for one in found[:5]:
        assert one["p_value"] == pytest.approx(stats.chi2.sf(one["chi_square"], 11), rel=1e-10)
        assert one["scatter_ratio"] == pytest.approx(np.sqrt(one["chi_square"] / 11))


def test_sigmas_claimed_too_small_are_seen() -> None:
    honest = draw(np.random.default_rng(4), 30)
    found = pooled.scatter(LogValues(honest.number, honest.value, honest.sigma / 2, honest.shared, honest.possibly_shared))
    assert found["scatter_ratio"] == pytest.approx(2.0, abs=0.5)
    assert found["p_value"] < 1e-6


def test_a_trend_is_that_of_weighted_least_squares_and_as_good_as_it_says() -> None:
    rng = np.random.default_rng(5)
    z = []
    for _ in range(SEEDS):
        samples = draw(rng, 15, 0.4, slope=-0.02)
        found = pooled.trend(samples)
        z.append((found["trend_per_log"] + 0.02) / found["trend_sigma"])
    low, high = stats.chi2.ppf([0.001, 0.999], SEEDS)
    assert low < (np.array(z) ** 2).sum() < high
    design = np.stack([np.ones(15), samples.number], 1) / samples.unshared[:, None]
    slope = np.linalg.lstsq(design, samples.value / samples.unshared, rcond=None)[0][1]
    assert found["trend_per_log"] == pytest.approx(slope, rel=1e-9)
    assert found["trend_sigma"] == pytest.approx(np.sqrt(np.linalg.inv(design.T @ design)[1, 1]), rel=1e-9)


def test_strays_are_found_farthest_first_and_good_logs_are_left_alone() -> None:
    rng = np.random.default_rng(6)
    samples = draw(rng, 20)
    value = samples.value.copy()
    value[[3, 11]] += np.array([400.0, -9.0])
    found = pooled.outliers(LogValues(samples.number, value, samples.sigma, samples.shared, samples.possibly_shared))
    assert list(found) == [3, 11]
    rest = np.delete(np.arange(20), [3, 11])
    weight = samples.unshared[rest] ** -2
    mean = weight @ value[rest] / weight.sum()
    assert found[11] == pytest.approx((value[11] - mean) / np.hypot(samples.unshared[11], weight.sum() ** -0.5), rel=1e-9)
    false = sum(len(pooled.outliers(draw(rng, 20))) for _ in range(SEEDS))
    assert false <= stats.poisson.ppf(0.999, SEEDS * 20 * 2 * stats.norm.sf(4))


def test_one_or_two_logs_are_no_scatter_and_no_outlier() -> None:
    one = draw(np.random.default_rng(7), 1)
    assert pooled.scatter(one) == {}
    assert pooled.trend(one) == {}
    assert pooled.mean(one).value == one.value[0]
    two = draw(np.random.default_rng(7), 2)
    assert pooled.outliers(LogValues(two.number, two.value + np.array([0, 1e6]), two.sigma, two.shared, two.possibly_shared)) == {}


@pytest.mark.thorough
def test_the_shared_part_of_a_sigma_is_what_logs_of_one_thruster_set_scatter_by_together() -> None:
    """The posterior of many logs with one thrust error and one weighing error, drawn, against the formula."""
    rng = np.random.default_rng(8)
    used = flight.vehicle(thrust={"scale_sigma": 0.03}, known={"mass": {"value": 22.0, "sigma": 0.1}})
    spread = 0.004 * np.abs(flight.TRUTH)
    spread[9] = 0.01 * 22.0
    draws = []
    for _ in range(3000):
        kappa, weighed = 0.03 * rng.standard_normal(), 22.0 + 0.1 * rng.standard_normal()
        mine = used.model_copy(update={"known": {"mass": used.known["mass"].model_copy(update={"value": weighed})}})
        own = flight.TRUTH + spread * rng.standard_normal((2, 10))
        own[:, [0, 1, 2, 3, 4, 5, 9]] /= 1 + kappa
        mean, covariance = own.copy(), np.tile(np.diag(spread**2), (2, 1, 1))
        mean[:, 9] = 1 / own[:, 9]
        covariance[:, 9, 9] = (spread[9] / own[:, 9] ** 2) ** 2
        draws.append(quantities(Parameters.of(mean, covariance), mine)[0] - flight.TRUTH)
    errors = np.array(draws)
    mean = flight.TRUTH[None].copy()
    mean[:, 9] = 1 / 22.0
    covariance = np.diag(spread**2)[None].copy()
    covariance[0, 9, 9] = (spread[9] / 22.0**2) ** 2
    values, after = quantities(Parameters.of(mean, covariance), used)
    estimates = {
        name: {"value": float(value), "sigma": float(sigma)}
        for name, value, sigma in zip(QUANTITIES, values[0], np.sqrt(np.diag(after[0])), strict=True)
    }
    stated = {"covariance": after[0].tolist(), "known": {"mass": (22.0, 0.1)}}
    phase = recorded.result([recorded.phase("all", **estimates) | stated]).phases[0]
    shared = kept.shared(phase, used)
    common = (errors[:, 0] * errors[:, 1]).mean(0)
    for index in (0, 3, 5, 9):
        assert common[index] == pytest.approx(shared[index] ** 2, rel=0.2), QUANTITIES[index]
        assert np.sqrt((errors[:, 0, index] ** 2).mean()) == pytest.approx(np.sqrt(after[0, index, index]), rel=0.1)
    assert shared[6] == 0.0


def test_without_known_quantities_all_that_is_shared_is_the_thrust_scale() -> None:
    used = flight.vehicle(thrust={"scale_sigma": 0.02})
    shared = kept.shared(recorded.result().phases[0], used)
    assert shared[[0, 9]] == pytest.approx([0.02 * 0.62, 0.02 * 22.0])
    assert shared[6:9] == pytest.approx([0, 0, 0])


def uncertain(*assumptions: tuple[str, dict[str, float]]) -> Result:
    base = {"message": "", "step": "", "stated": True}
    listed = [base | {"code": code, "effects": [{"phase": "all", "change": change}]} for code, change in assumptions]
    return recorded.result(assumptions=listed)


def test_an_uncertain_geometry_and_delay_are_the_same_in_every_log_and_do_not_average_out() -> None:
    """A hundred logs of an IMU that sits 0.9 mm off would have claimed its CG to 0.1 mm."""
    found = uncertain(
        ("uncertain-imu-position", {"cg_x": 0.0009}), ("command-delay", {"ixx": 0.002, "mass": -99.0}), ("gravity", {"izz": 1.0})
    )
    used = faulty.stated(flight.vehicle(), "cycle.command_delay_sigma_cycles=0.2")
    (body,) = kept.bodies(found, used, used)
    share = {name: item.alike for name, item in body.estimates.items()}
    assert share["cg_x"] == pytest.approx(0.0009)
    assert share["ixx"] == pytest.approx(2 * 0.002)
    assert share["mass"] == recorded.SIGMAS["mass"]  # never more than all
    assert share["izz"] == share["cg_y"] == 0.0
    moved = {n: Value(**(body.estimates["cg_x"].model_dump() | {"value": -0.018 + 1e-5 * n})) for n in range(1, 101)}
    rows = [row(n, 22.0, bodies=[body.model_copy(update={"estimates": body.estimates | {"cg_x": moved[n]}})]) for n in range(1, 101)]
    pool_of_all = pooled.pooled(rows)[0].estimates["cg_x"]
    assert pool_of_all.sigma == pytest.approx(0.0009, rel=0.02)
    assert pool_of_all.scatter_ratio == pytest.approx(0.29, rel=0.02), "that they scatter less than it is no fault, and more would be"


def test_an_error_that_logs_may_have_alike_is_promised_away_by_neither_mean_nor_scatter() -> None:
    """Errors of a part that is the same in all logs, or none, or between: the mean holds its sigma, scatter never exceeds by chance."""
    rng = np.random.default_rng(9)
    for common in (0.0, 0.5, 1.0):
        z, exceeding = [], 0
        for _ in range(SEEDS):
            base = draw(rng, 10)
            alike = 2.0 * base.sigma.mean()
            moved = alike * (np.sqrt(common) * rng.standard_normal() + np.sqrt(1 - common) * rng.standard_normal(10))
            one = LogValues(base.number, base.value + moved, np.hypot(base.sigma, alike), base.shared, np.full(10, alike))
            found, apart = pooled.mean(one), pooled.scatter(one)
            z.append((found.value - 22.0) / found.sigma)
            exceeding += apart["p_value"] < 0.01
        assert np.sqrt(np.mean(np.square(z))) < 1.1
        assert exceeding <= stats.poisson.ppf(0.999, SEEDS * 0.01)
    assert np.sqrt(np.mean(np.square(z))) > 0.9


def test_of_a_delay_that_each_log_tells_for_itself_it_has_its_own_error() -> None:
    """Where it narrows a stated one from 0.2 to 0.02 cycles, a tenth of what is left; where it finds it, all."""
    found = uncertain(("command-delay", {"ixx": 0.002}))
    used = faulty.stated(flight.vehicle(), "cycle.command_delay_sigma_cycles=0.02")
    stated = faulty.stated(flight.vehicle(), "cycle.command_delay_sigma_cycles=0.2")
    auto = faulty.stated(flight.vehicle(), 'cycle.command_delay_cycles="auto"')
    assert kept.bodies(found, used, stated)[0].estimates["ixx"].alike == pytest.approx(0.1 * 0.2 * 0.002)
    assert kept.bodies(found, used, auto)[0].estimates["ixx"].alike == 0.0


def test_a_docked_object_of_an_uncertain_geometry_is_not_pooled() -> None:
    """How the error of both phases goes into their difference isn't told."""
    found = recorded.result(
        [recorded.phase("all"), recorded.phase("both")], docked_object=recorded.docked() | {"before": "all", "after": "both"}
    )
    used = flight.vehicle()
    assert kept.bodies(found, used, used)[-1].estimates["mass"].shared == 0.0
    beside = found.model_copy(update={"assumptions": uncertain(("uncertain-jet-position", {"izz": 0.01})).assumptions})
    assert {item.shared for item in kept.bodies(beside, used, used)[-1].estimates.values()} == {None}


def row(number: int, mass: float, sigma: float = 0.25, **changes: object) -> CampaignRow:
    estimates = {
        name: Value(value=mass if name == "mass" else 1.0 + 0.01 * number, sigma=sigma, shared=0.0, verdict="converged")
        for name in QUANTITIES
    }
    stated = {
        "fingerprint": "f",
        "exit_code": 0,
        "message": "",
        "input_sha256": f"{number:064d}",
        "vehicle": StatedVehicle(name="tug", sha256="v", environment="free", bearing_mass_kg=0.0),
        "method": "default",
        "bodies": [PhaseQuantities(part="phase", name="all", estimates=estimates)],
    }
    return CampaignRow(name=f"log-{number}", log=f"log-{number}.csv", tags=[], outcome=Outcome.model_validate(stated | changes))


def test_logs_of_one_recording_are_named_and_count_once() -> None:
    """Two by their bytes, one by its values to the last digit; then a log and its copy alone, which pool nothing."""
    rows = [row(1, 22.0), row(2, 22.1), row(3, 22.0, input_sha256=f"{1:064d}"), row(4, 22.3), row(5, 22.1)]
    same = rows[1].outcome
    assert same is not None
    rows[4] = rows[4].model_copy(update={"outcome": same.model_copy(update={"input_sha256": f"{5:064d}"})})
    told = summary("mix", rows)
    assert told.copies == {"log-3": "log-1", "log-5": "log-2"}
    (pool,) = told.pooled
    assert pool.estimates["mass"].logs == 3
    assert pool.estimates["mass"].value == pytest.approx((22.0 + 22.1 + 22.3) / 3)
    alone = summary("pair", [rows[0], rows[2]])
    assert alone.pooled == []
    assert page.counts(alone) == "2 done; log-3 has the recording of log-1: counted once in pooled values"


def test_a_baseline_that_tells_nothing_is_no_baseline_to_stand_against() -> None:
    dim = {name: Value(value=1.0, sigma=9.0, verdict="not_excited") for name in QUANTITIES}
    empty = row(1, 22.0, bodies=[PhaseQuantities(part="phase", name="all", estimates=dim)])
    rows = [row(1, 22.0), row(2, 22.1)]
    told = baseline.compare(rows, Earlier(summary("before", [empty]), "s"), Gate())
    assert [item.message for item in told.beyond] == ["nothing to compare: no log of the baseline has a value"]
    assert summary("now", rows, told).exit_code == 5
    assert baseline.compare(rows, Earlier(summary("before", [row(1, 22.0)]), "s"), Gate()).beyond == []


def test_a_campaign_pools_each_vehicle_and_counts_a_copied_log_once() -> None:
    rows = [row(1, 22.0), row(2, 22.2), row(2, 22.2), row(3, 25.0, vehicle=StatedVehicle(name="rover", sha256="w", environment="free", bearing_mass_kg=0.0))]  # fmt: skip  # noqa: E501
    (found,) = pooled.pooled(rows)
    assert (found.vehicle, found.estimates["mass"].logs) == ("tug", 2)
    assert found.estimates["mass"].value == pytest.approx(22.1)
    assert found.estimates["mass"].sigma == pytest.approx(0.25 / np.sqrt(2))
    assert found.estimates["mass"].trend_per_log is None


def test_a_recording_that_stands_there_in_two_formats_counts_once() -> None:
    """Its values differ by rounding alone; those of two logs never agree to a thousandth of a sigma in all quantities."""
    rng = np.random.default_rng(3)
    values = 22.0 + 0.25 * rng.standard_normal(40)
    rows = [row(n, value) for n, value in enumerate(values, 1)]
    again = [row(n, value * (1 + 1e-12), input_sha256=f"{100 + n:064d}") for n, value in enumerate(values[:7], 1)]
    (found,) = pooled.pooled([*rows, *again])
    assert (found.estimates["mass"].logs, found.estimates["ixx"].logs) == (40, 40)
    assert found.estimates["mass"].sigma == pytest.approx(0.25 / np.sqrt(40))


def test_what_was_not_told_and_what_claims_no_sigma_is_not_pooled() -> None:
    dim = row(3, 99.0)
    assert dim.outcome is not None
    values = dim.outcome.bodies[0].estimates | {"mass": Value(value=99.0, sigma=0.1, shared=0.0, verdict="not_excited")}
    dim = row(3, 99.0, bodies=[PhaseQuantities(part="phase", name="all", estimates=values)])
    (found,) = pooled.pooled([row(1, 22.0), row(2, 22.1), dim])
    assert (found.estimates["mass"].logs, found.estimates["ixx"].logs) == (2, 3)
    assert pooled.pooled([row(1, 22.0, method="thesis"), row(2, 22.0, method="thesis")]) == []


def test_an_outlier_is_named_and_the_mean_without_it_stands_beside() -> None:
    found = summary("c", [*(row(n, 22.0) for n in range(1, 10)), row(10, 32.0)]).pooled[0].estimates["mass"]
    assert [stray.log for stray in found.outliers] == ["log-10"]
    assert found.value == pytest.approx(23.0)
    assert found.without_outliers == pytest.approx((22.0, 0.25 / 3))
