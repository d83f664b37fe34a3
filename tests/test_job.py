"""One log with the same demands ends in the same code and the same words: by the command, in a campaign, and from Python."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from junitparser import JUnitXml

from massprop_cli import QUANTITIES, estimate_log, run_campaign
from massprop_cli.base.errors import UsageError
from massprop_cli.inputs.require import requirements
from massprop_cli.job import Demands, Unmet, unconverged, unmet
from tests import recorded
from tests.campaigns import simulate
from tests.commandline import massprop

FEW = {"convergence.count": 119}
"""More sustained updates than the log has: nothing converges."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("job") / "flights", 1) / "seed-0001" / "log.parquet"


@pytest.mark.parametrize(
    ("require", "expected", "code"),
    [
        pytest.param(None, False, 0, id="nothing is asked", marks=pytest.mark.thorough),
        pytest.param("Mass,iXX", False, 4, id="not converged"),
        pytest.param(None, True, 5, id="not as expected"),
        pytest.param("mass", True, 4, id="both", marks=pytest.mark.thorough),
    ],
)
def test_command_campaign_and_python_end_in_the_same_code_and_words(
    log: Path, require: str | None, expected: bool, code: int, tmp_path: Path
) -> None:
    file = tmp_path / "expect.toml"
    file.write_text('[all]\nmass = { value = 99.0, tolerance = "1 %" }\n', encoding="utf-8")
    asked = ["--require", require] if require else []
    asked += ["--expect", str(file)] if expected else []
    done = massprop(tmp_path, "estimate", log, "--set", "convergence.count=119", "-q", "--out", "one", *asked)
    wanted = file if expected else None
    alone = estimate_log(log, settings=FEW, require=require or (), expected=wanted)
    campaign = run_campaign(log, tmp_path / "many", settings=FEW, require=require or (), expected=wanted, jobs=1)
    outcome = campaign.outcomes["seed-0001"]
    assert outcome is not None
    assert (done.returncode, alone.exit_code, outcome.exit_code) == (code, code, code)
    assert alone.message == outcome.message
    assert done.stderr == (f"massprop: {alone.message}\n" if code else "")
    assert (tmp_path / "one" / "result.json").read_bytes() == (tmp_path / "many/results/seed-0001/result.json").read_bytes()
    assert ("required but not converged: " in alone.message) == (code == 4)
    assert ("not as expected: mass in phase all: expected 99" in alone.message) == expected


@pytest.mark.parametrize("verdict", ["not_converged", "not_excited", "unobservable"])
def test_any_verdict_but_converged_leaves_a_requirement_unmet(verdict: str) -> None:
    found = recorded.result([recorded.phase("a"), recorded.phase("b", ixx={"verdict": verdict, "reason": "because"})])
    assert unconverged(found, ("ixx", "mass")) == [f"ixx in phase b is {verdict} (because)"]


def test_a_verdict_that_is_not_known_yet_leaves_a_requirement_unmet() -> None:
    found = recorded.result()
    strange = found.phases[0].estimates["mass"].model_copy(update={"verdict": "doubted"})
    phase = found.phases[0].model_copy(update={"estimates": found.phases[0].estimates | {"mass": strange}})
    assert len(unconverged(found.model_copy(update={"phases": [phase]}), QUANTITIES)) == 1


def test_contradicted_goes_before_not_converged_and_that_before_not_expected_and_all_are_said() -> None:
    both = Unmet(unconverged=("ixx is late",), missed=("mass is off", "ixx is off"))
    assert (both.exit_code, both.message) == (4, "required but not converged: ixx is late. not as expected: mass is off; ixx is off")
    every = Unmet(contradicted=("ixx in phase all (a jet)",), imprecise=("mass is coarse",))
    said = "the log contradicts the vehicle file: ixx in phase all (a jet). required but not precise enough: mass is coarse"
    assert (every.exit_code, every.message) == (6, said)


def test_a_contradicted_quantity_exits_6_unless_that_is_allowed() -> None:
    found = recorded.result([recorded.phase("a"), recorded.phase("b", ixx={"verdict": "contradicted", "reason": "a jet is reversed"})])
    told = unmet(found, Demands())
    assert (told.exit_code, told.contradicted) == (6, ("ixx in phase b (a jet is reversed)",))
    assert unmet(found, Demands(allow_contradicted=True)).exit_code == 0
    assert unmet(found, Demands(requirements("ixx"), allow_contradicted=True)).exit_code == 4


@pytest.mark.thorough
def test_code_junit_and_annotations_agree_on_a_contradicted_log(log: Path, tmp_path: Path) -> None:
    """A delay that is stated a cycle short, by the command, the check, and in a campaign."""
    asked = ["--set", "cycle.command_delay_cycles=1.0"]
    done = massprop(tmp_path, "estimate", log, "-q", "--out", "one", *asked)
    checked = massprop(tmp_path, "check", log, "-q", *asked)
    many = massprop(tmp_path, "batch", log, "-q", "--out", "many", "--junit", "many.xml", *asked, GITHUB_ACTIONS="true")
    assert (done.returncode, checked.returncode, many.returncode) == (6, 6, 6), done.stderr + many.stderr
    assert (tmp_path / "one" / "result.json").exists()
    failures = JUnitXml.fromfile(str(tmp_path / "many.xml")).failures
    assert failures > 0
    assert "::error" in many.stderr


@pytest.mark.parametrize(
    ("stated", "meant"),
    [
        (None, ()),
        ((), ()),
        ("ixx", ("ixx",)),
        (" Mass ,IXX,ixx", ("ixx", "mass")),
        (["Cg_x", "mass"], ("cg_x", "mass")),
        ("ALL", QUANTITIES),
        (["ixx", "all"], QUANTITIES),
    ],
)
def test_required_quantities_are_read_alike_from_text_and_names(stated: str | Sequence[str] | None, meant: tuple[str, ...]) -> None:
    assert tuple(item.quantity for item in requirements(stated)) == meant


def test_what_is_no_quantity_is_named_as_it_was_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"--require Weight: no such quantity; choose from ixx, .*, mass or all"):
        requirements("ixx,Weight")
    with pytest.raises(UsageError, match="no such quantity"):
        run_campaign(tmp_path, require="weight")
