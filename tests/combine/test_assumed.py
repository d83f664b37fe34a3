"""Assumptions of a combined result: those of its logs, with what a step of each does to all logs together; and its report."""

from pathlib import Path

import numpy as np
import pytest

from massprop_cli import INERTIA, QUANTITIES
from massprop_cli.combine import flow as combine
from massprop_cli.report import assumptions, html
from massprop_cli.result.read import MEMBERS, Recorded, read
from massprop_cli.testbed import output, scenario
from tests.combine.test_combine import PLAN, estimated


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two logs of 10 s."""
    folder = tmp_path_factory.mktemp("assumed")
    output.simulate(scenario.load("free-flyer", ("duration_s=10.0", PLAN)), folder, 1, 2)
    return folder


def results(logs: Path, name: str, *settings: str) -> list[Recorded]:
    """Of both."""
    for seed in (1, 2):
        estimated(logs / f"seed-000{seed}" / "log.parquet", logs / f"{name}-{seed}", *settings)
    return [read(logs / f"{name}-{seed}") for seed in (1, 2)]


@pytest.fixture(scope="module")
def each(logs: Path) -> list[Recorded]:
    """With thrust as stated."""
    return results(logs, "exact")


def test_one_per_cent_of_thrust_moves_what_logs_say_together_by_one_per_cent(each: list[Recorded]) -> None:
    found = combine.together(each)
    values = {name: item.value or 0.0 for name, item in found.phases[0].estimates.items()}
    (thrust,) = (one for one in found.assumptions if one.code == "thrust-scale")
    changes = thrust.effects[0].change
    assert set(changes) == {*INERTIA, "mass"}
    np.testing.assert_allclose([changes[name] for name in changes], [0.01 * values[name] for name in changes], rtol=2e-3)
    limit = assumptions.limit("mass", found.phases[0], found)
    assert limit is not None
    assert limit.size >= 0.01 * values["mass"] * 0.99
    assert limit.kind != assumptions.NOISE
    assert assumptions.sigma_heading(found) == assumptions.EXACT_THRUST


def test_a_weighed_mass_is_the_scale_of_logs_together(logs: Path) -> None:
    found = combine.together(results(logs, "weighed", "thrust.scale_sigma=0.02", "known.mass={value=22.0, sigma=0.01}"))
    codes = [one.code for one in found.assumptions]
    assert "gyro-scale" in codes
    assert "thrust-scale" not in codes
    assert assumptions.sigma_heading(found) == assumptions.SIGMA


def test_a_change_lies_between_those_of_the_logs_and_two_logs_notice_more_than_one(each: list[Recorded]) -> None:
    found = combine.together(each)
    assert found.assumptions
    for one in found.assumptions:
        own = [each_one for log in each for each_one in log.result.assumptions if (each_one.code, each_one.step) == (one.code, one.step)]
        for name in QUANTITIES:
            changes = [item.effects[0].change.get(name, 0.0) for item in own]
            assert min(changes) - 1e-12 <= one.effects[0].change.get(name, 0.0) <= max(changes) + 1e-12
        seen = [item.effects[0].seen_sigma or 0.0 for item in own]
        assert one.effects[0].seen_sigma in (None, pytest.approx(float(np.linalg.norm(seen))))


def test_the_report_of_a_combined_result_has_no_figure_that_it_can_not_have(each: list[Recorded], tmp_path: Path) -> None:
    joint = Recorded(tmp_path / "result.json", combine.together(each), {})
    assert MEMBERS in joint.result.provenance.settings
    page = html.page([joint])
    assert html.MISSING not in page
    assert page.count(html.OF_LOGS) == 1
    assert 'id="response"' not in page
    assert 'href="#response"' not in page
    assert "Correlation of the estimates" in page
    assert "thrust scale, 1 %" in page
    assert assumptions.EXACT_THRUST in page
