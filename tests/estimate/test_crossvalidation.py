"""Segments predicted by all others: against the fit of all of them, over seeds, and where a log is of two bodies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import kstest

from massprop_cli import flow
from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.estimate import crossvalidation
from massprop_cli.estimate.crossvalidation import CrossValidation, cross_validation
from massprop_cli.estimate.discrepancy import PosedSegments
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.resolved import Resolved
from massprop_cli.report import junit
from massprop_cli.result.schema import Result
from tests.commandline import massprop
from tests.flown import RANDOM, fly

LOG = Path("sample_logs/free-flyer/log.parquet").resolve()


def validated(found: Analysis) -> CrossValidation:
    """The first phase."""
    assert isinstance(found.vehicle, Resolved)
    assert found.plain is not None
    settled = found.settled[0]
    assert settled.reference is not None
    return cross_validation(found.samples, settled.cycles, settled.reference, found.vehicle, found.plain.consider)


def test_a_prediction_by_all_others_is_the_whole_fit_less_its_leverage(monkeypatch: pytest.MonkeyPatch) -> None:
    """By normal equations of all rows: d = (1 − H)⁻¹ r and T = rᵀ (1 − H)⁻¹ r, with the fit's residual r and H = R P Rᵀ."""
    rng = np.random.default_rng(4)
    rows: list[Array] = [np.eye(12, 13), *(rng.standard_normal((30, 13)) for _ in range(5))]
    posed = PosedSegments(rows, [slice(k, k + 1) for k in range(5)], np.arange(1.0, 11.0), np.eye(10))
    monkeypatch.setattr(crossvalidation, "posed_segments", lambda *_: posed)
    found = validated(
        flow.examine(fly("free-flyer", *RANDOM, seeds=(3,)).log(0), VehicleSource(fly("free-flyer", *RANDOM).vehicle, "", ""))
    )
    stacked = np.vstack(rows)
    covariance = np.linalg.inv(stacked[:, :-1].T @ stacked[:, :-1])
    whole = covariance @ stacked[:, :-1].T @ stacked[:, -1]
    for segment, one in zip(rows[1:], found.segments, strict=True):
        reduced = triangle_of(segment)[:-1]
        left = reduced[:, -1] - reduced[:, :-1] @ whole
        leverage = reduced[:, :-1] @ covariance @ reduced[:, :-1].T
        assert one.freedom == 12
        assert np.isclose(one.chi_square, left @ np.linalg.solve(np.eye(12) - leverage, left), rtol=1e-9)


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("name", ["testbed"])
def test_chances_of_clean_segments_are_uniform_and_segment_sigmas_hold(name: str) -> None:
    """104 segments; the mean squares of eight numbers scatter by half."""
    flight, chances, ratios = fly(name, *RANDOM, seeds=tuple(range(1, 14))), list[float](), list[Array]()
    for member in range(13):
        with np.errstate(all="ignore"):
            found = flow.examine(flight.log(member), VehicleSource(flight.vehicle, "", ""))
        one = validated(found)
        chances += [segment.p for segment in one.segments]
        ratios.append(one.sigmas / np.array([estimate.sigma or np.nan for estimate in found.conclusions[0].estimates.values()]))
    assert kstest(chances, "uniform").pvalue > 1e-3
    rms = np.sqrt(np.nanmean(np.array(ratios) ** 2, 0))
    assert abs(np.sqrt((rms**2).mean()) - 1) < 0.15, rms
    assert ((rms > 0.6) & (rms < 1.5)).all(), rms


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_body_that_is_another_in_the_second_half_is_not_predicted() -> None:
    """Commands of the first half are logged 1 % too small, as if the body were lighter there."""
    flight = fly("free-flyer", *RANDOM)
    log = flight.log(0)
    late = np.arange(len(log.command)) >= len(log.command) // 2
    changed = replace(log, command=np.where(late[:, None], log.command, 0.99 * log.command))
    chances = [validated(flow.examine(one, VehicleSource(flight.vehicle, "", ""))).p for one in (log, changed)]
    assert chances[0] > 0.05
    assert chances[1] < 1e-6


@pytest.mark.thorough
def test_the_command_tests_each_segment_and_reports_the_scatter(tmp_path: Path) -> None:
    found = massprop(tmp_path, "estimate", LOG, "--cross-validate", "0.95", "--json", "--out", "o")
    assert found.returncode == 0, found.stderr
    phase = Result.model_validate_json(found.stdout).phases[0]
    assert phase.cross_validation is not None
    assert phase.cross_validation.passes
    spans = [(one.start_s, one.end_s) for one in phase.cross_validation.segments]
    assert np.allclose(spans, [(7.5 * k, 7.5 * k + 7.5) for k in range(8)], atol=0.11)
    scatter = {name: (one.segment_sigma or np.inf) / (one.sigma or 0.0) for name, one in phase.estimates.items()}
    assert all(0.3 < ratio < 3.0 for ratio in scatter.values()), scatter
    strict = massprop(tmp_path, "estimate", LOG, "--cross-validate", "0.5", "--out", "o", "-q")
    assert strict.returncode == 5
    assert "phase all: the other segments do not predict 52.5 to 60 s: chi-square 27.16 of 13" in strict.stderr
    failed = Result.model_validate_json((tmp_path / "o" / "result.json").read_text())
    assert 'name="cross_validation">\n   <failure message="phase all: the other' in junit.text([junit.LogOutcome("log", failed)])
    refused = massprop(tmp_path, "estimate", LOG, "--cross-validate", "1.5", "--out", "p")
    assert refused.returncode == 3
    assert "estimator.cross_validate" in refused.stderr
