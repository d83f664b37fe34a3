"""Eight results of one vehicle whose model does not fit: what they share does not average out, what is each one's own does."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from massprop_cli import QUANTITIES, job
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.campaign import kept
from massprop_cli.campaign.outcome import CampaignRow, Outcome
from massprop_cli.campaign.pooled import Pooled, pooled
from massprop_cli.combine import flow
from massprop_cli.job import Unmet
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Result
from massprop_cli.testbed import output, scenario
from tests import flight, recorded

SEEDS, LOGS = 200, 8
STATED, DOUBTED = 0.002, 0.004
"""Relative sigmas of the thrust's scale: stated, and beyond it by a log that does not fit."""
TRUTH = np.array(list(recorded.VALUES.values()))
SIZE = 1e-3 * np.array([0.6, 0.6, 0.6, 2.8, 2.8, 2.5, 0.3, 0.3, 0.3, 22.0])


def results(rng: np.random.Generator, common: float, off: float = 0.0) -> list[Recorded]:
    """Of eight logs: own errors of 1 to 3 sizes, ``common`` sizes of one error of all, and one of the thrust; the first is ``off`` more."""
    scaled = np.where([name.startswith("cg") for name in QUANTITIES], 0.0, TRUTH)
    moved = np.hypot(STATED, DOUBTED) * rng.standard_normal() * scaled + common * SIZE * rng.standard_normal(10)
    found = []
    for number in range(LOGS):
        own = rng.uniform(1.0, 3.0) * SIZE
        values = TRUTH + moved + own * rng.standard_normal(10) + (off * own if number == 0 else 0.0)
        proportional = np.where(scaled == 0, 0.0, values)
        covariance = np.diag(own**2 + (common * SIZE) ** 2) + (STATED**2 + DOUBTED**2) * np.outer(proportional, proportional)
        found.append(Recorded(Path(f"/results/log-{number}/result.json"), result(number, values, covariance, own, common * SIZE), {}))
    return found


def result(number: int, values: Array, covariance: Array, own: Array, shared: Array) -> Result:
    told = {
        name: {"value": float(value), "sigma": float(sigma)}
        for name, value, sigma in zip(QUANTITIES, values, np.sqrt(np.diag(covariance)), strict=True)
    }
    half = (shared / np.sqrt(2)).tolist()
    shares = {"thrust": half, "mounting": half, "body": (0.6 * own).tolist(), "noise": (0.8 * own).tolist()}
    discrepancy = {"scale": 1.0, "thrust_scale_sigma": DOUBTED, "behaves_like": [], "shares": shares}
    base = recorded.result()
    phase = recorded.phase("all", **told) | {"covariance": covariance.tolist(), "discrepancy": discrepancy}
    made = base.provenance.model_dump() | {"input_sha256": f"{number:064d}"}
    stated = base.vehicle.model_dump() | {"thrust_scale_sigma": STATED}
    return recorded.result([phase], provenance=made, vehicle=stated)


def campaign(found: Sequence[Recorded], scale_sigma: float = STATED) -> dict[str, Pooled]:
    used = flight.vehicle(thrust={"scale_sigma": scale_sigma})
    rows = []
    for one in found:
        told: Outcome = kept.of_result(one.result, Unmet(), kept.bodies(one.result, used, used), [], "default")
        rows.append(CampaignRow(name=one.name, log=one.name, tags=[], outcome=told))
    (pool,) = pooled(rows)
    return pool.estimates


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("common", [pytest.param(0.0, marks=pytest.mark.thorough), 2.0])
def test_a_campaigns_mean_covers_and_its_scatter_raises_no_false_alarm(common: float) -> None:
    rng = np.random.default_rng(5)
    covered, naive, alarms = [], [], 0
    for _ in range(SEEDS):
        for truth, item in zip(TRUTH, campaign(results(rng, common)).values(), strict=True):
            assert item.value is not None
            assert item.sigma is not None
            assert item.shared is not None
            assert item.p_value is not None
            off = abs(item.value - truth)
            covered.append(off < 1.96 * item.sigma)
            naive.append(off < 1.96 * np.sqrt(item.sigma**2 - item.shared**2))
            alarms += item.p_value < 0.01
    assert 0.93 < np.mean(covered) < 0.97
    assert np.mean(naive) < 0.75, "as if nothing were shared"
    assert alarms <= stats.poisson.ppf(0.999, 0.01 * SEEDS * 10)


@pytest.mark.thorough
@pytest.mark.parametrize("common", [0.0, 2.0])
def test_a_combined_result_covers_and_says_where_it_scatters(common: float) -> None:
    rng = np.random.default_rng(6)
    covered, alarms = [], 0
    for _ in range(60):
        found = flow.together(results(rng, common))
        items = found.phases[0].estimates
        covered += [
            abs((item.value or 0.0) - truth) < 1.96 * (item.sigma or 0.0) for item, truth in zip(items.values(), TRUTH, strict=True)
        ]
        alarms += bool(found.warnings)
        np.testing.assert_allclose(found.phases[0].alike or np.zeros(10), common * SIZE, rtol=1e-3)
    assert 0.93 < np.mean(covered) < 0.97
    assert alarms <= stats.poisson.ppf(0.999, 0.005 * 60)
    (told,) = (one.message for one in flow.together(results(rng, common, off=9.0)).warnings if one.code == "results-disagree")
    assert "log-0 differs from the joint estimate of the others: ixx by" in told


def test_what_a_combined_result_shares_is_there_when_it_is_combined_again() -> None:
    """Four and four are as eight at once, but for the weights."""
    found = results(np.random.default_rng(7), 2.0)
    halves = [flow.together(part) for part in (found[:4], found[4:])]
    again = flow.together([Recorded(Path(f"/results/half-{n}/result.json"), half, {}) for n, half in enumerate(halves)])
    whole = flow.together(found)
    np.testing.assert_allclose(again.phases[0].alike, whole.phases[0].alike, rtol=1e-2)
    one, other = ([item.sigma for item in each.phases[0].estimates.values()] for each in (again, whole))
    np.testing.assert_allclose(np.array(one[6:9], dtype=float), np.array(other[6:9], dtype=float), rtol=0.02)


@pytest.mark.seeds
@pytest.mark.thorough
def test_an_uncertain_geometry_is_one_and_the_same_in_all_logs(tmp_path: Path) -> None:
    """Jets that are displaced, and stronger or weaker, in the vehicle file of three logs by errors as it states them."""
    plan = 'plan=[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=15.0}]'
    off = []
    for trial in range(6):
        rng, found = np.random.default_rng(100 + trial), list[Recorded]()
        output.simulate(scenario.load("free-flyer", ["duration_s=15", plan]), tmp_path / str(trial), 10 * trial + 1, 3)
        logs = sorted((tmp_path / str(trial)).glob("*/log.parquet"))
        stated = tomllib.loads((logs[0].parent / "vehicle.toml").read_text())["jets"]
        wrong = {"position_sigma_m": 0.002, "thrust_sigma": 0.01}
        jets = [
            one
            | {"position_m": (np.array(one["position_m"]) + 0.002 * rng.standard_normal(3)).tolist()}
            | {"force_n": (np.array(one["force_n"]) * (1 + 0.01 * rng.standard_normal())).tolist()}
            | wrong
            for one in stated
        ]
        for log in logs:
            made = job.of_file(log, assignments=[f"jets={configfile.written(jets)}"])
            found.append(Recorded(tmp_path / log.parent.name / "result.json", made.result, {}))
        truth = json.loads((logs[0].parent / "truth.json").read_text())["phases"][0]
        phase = flow.together(found).phases[0]
        off.append([((item.value or 0.0) - truth[name]) / (item.sigma or 1.0) for name, item in phase.estimates.items()])
        single = [item.sigma or 0.0 for item in found[0].result.phases[0].estimates.values()]
        joint = np.array([item.sigma for item in phase.estimates.values()], dtype=float)
        of_jets = [0, 3, 5, 6, 7, 8]  # noise has no part in moments of inertia and CG
        assert (joint[of_jets] > 0.8 * np.array(single)[of_jets]).all()
    assert (np.abs(off) < 1.96).mean() > 0.88
    assert np.sqrt(np.square(off).mean()) < 1.25


def test_a_value_under_uncertain_is_one_and_the_same_in_all_logs(tmp_path: Path) -> None:
    """All thrust 2 % uncertain: three logs tell no more of it than one."""
    plan = 'plan=[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=15.0}]'
    output.simulate(scenario.load("free-flyer", ["duration_s=15", plan]), tmp_path, 1, 3)
    logs = sorted(tmp_path.glob("*/log.parquet"))
    jets = tomllib.loads((logs[0].parent / "vehicle.toml").read_text())["jets"]
    stronger = {f"jets.{i}.force_n": (1.02 * np.array(one["force_n"])).tolist() for i, one in enumerate(jets)}
    stated = [f"uncertain={configfile.written([stronger])}"]
    found = [Recorded(log.parent / "result.json", job.of_file(log, assignments=stated).result, {}) for log in logs]
    joint = flow.together(found).phases[0].estimates
    for name in ("ixx", "iyy", "izz"):
        assert (joint[name].sigma or 0.0) > 0.019 * (joint[name].value or 0.0)
