import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from massprop_cli import QUANTITIES, schemas
from massprop_cli.base import configfile
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import expect
from massprop_cli.inputs.tolerance import FOUR_SIGMA, Tolerance
from massprop_cli.result.judge import judge, missed
from massprop_cli.result.schema import EstimateItem, Expected, Result
from tests import recorded
from tests.commandline import massprop
from tests.refusal import contents

SAMPLES = Path(__file__).parents[2] / "sample_logs"
GOOD = """
poi_convention = "tensor"
tolerance = "3 sigma"
[all]
mass = 22.0
ixy = { value = 0.04, tolerance = 0.01 }
[all.ixx]
value = 0.62
tolerance = "2 %"
[[phases]]
name = "single"
mass = { value = 20.0, tolerance = "0.5 kg" }
[[phases]]
name = "combined"
tolerance = "5 %"
izz = 2.5
[docked]
cg_z = 0.1
"""


def load(folder: Path, text: str, name: str = "expect.toml") -> expect.Expectations:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return expect.load(path)


def expected(item: EstimateItem) -> Expected:
    assert item.expected is not None
    return item.expected


def of(found: Result, quantity: str, phase: int = 0) -> Expected:
    return expected(found.phases[phase].estimates[quantity])


def test_an_expect_file_gives_values_and_tolerances_per_phase_for_all_and_for_the_docked_object(tmp_path: Path) -> None:
    found = load(tmp_path, GOOD)
    assert found.every == {
        "ixx": expect.Wanted(0.62, Tolerance(2.0, "relative")),
        "ixy": expect.Wanted(0.04, Tolerance(0.01, "absolute")),
        "mass": expect.Wanted(22.0, Tolerance(3.0, "sigma")),
    }
    assert found.phases == (
        ("single", {"mass": expect.Wanted(20.0, Tolerance(0.5, "absolute", "kg"))}),
        ("combined", {"izz": expect.Wanted(2.5, Tolerance(5.0, "relative"))}),
    )
    assert found.docked == {"cg_z": expect.Wanted(0.1, Tolerance(3.0, "sigma"))}


def test_json_says_the_same_as_toml_and_both_fit_the_schema(tmp_path: Path) -> None:
    data = configfile.parse_toml(GOOD, "")
    jsonschema.validate(data, schemas.schema("expect"))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"all": {"mas": 1.0}}, schemas.schema("expect"))
    toml, as_json = load(tmp_path, GOOD), load(tmp_path, json.dumps(data), "expect.json")
    assert (as_json.every, as_json.phases, as_json.docked) == (toml.every, toml.phases, toml.docked)


def test_products_of_the_positive_integral_convention_change_their_sign_and_nothing_else_does(tmp_path: Path) -> None:
    found = load(tmp_path, 'poi_convention = "positive_integral"\n[all]\nixx = 0.62\nixy = -0.04\nixz = 0.07\niyz = 0.0\n').every
    assert {name: wanted.value for name, wanted in found.items()} == {"ixx": 0.62, "ixy": 0.04, "ixz": -0.07, "iyz": 0.0}


def test_a_table_may_state_its_own_convention(tmp_path: Path) -> None:
    text = '[all]\npoi_convention = "tensor"\nixy = 0.04\n[docked]\npoi_convention = "positive_integral"\nixy = 0.3\n'
    found = load(tmp_path, text)
    assert (found.every["ixy"].value, found.docked["ixy"].value) == (0.04, -0.3)


def test_a_product_of_zero_needs_no_convention(tmp_path: Path) -> None:
    assert load(tmp_path, "[all]\nixy = 0\n").every == {"ixy": expect.Wanted(0.0, FOUR_SIGMA)}


@pytest.mark.parametrize("path", sorted(SAMPLES.rglob("truth.json")), ids=lambda path: str(path.parent.relative_to(SAMPLES)))
def test_every_truth_of_a_sample_log_is_an_expect_file(path: Path) -> None:
    truth = json.loads(path.read_text())
    found = expect.load(path)
    assert len(found.phases) == len(truth["phases"])
    for (name, wanted), stated in zip(found.phases, truth["phases"], strict=True):
        assert name == stated.get("name")
        pivot = {f"about_pivot.{quantity}": value for quantity, value in stated.get("about_pivot", {}).items()}
        assert {quantity: w.value for quantity, w in wanted.items()} == {quantity: stated[quantity] for quantity in QUANTITIES} | pivot
        assert {w.tolerance for w in wanted.values()} == {FOUR_SIGMA}
    assert len(found.docked) == (10 if "docked" in truth else 0)


@dataclass(frozen=True)
class Bad:
    """A file that is refused, and what the message names beside it."""

    text: str
    names: tuple[str, ...]
    file: str = "expect.toml"


BAD = {
    "is not TOML": Bad("[all\n", ("not valid TOML", "line 1")),
    "is not JSON": Bad('{"all": ', ("not valid JSON", "line 1"), "expect.json"),
    "is a list": Bad("[1]", ("holds a list", "massprop schema expect"), "expect.json"),
    "is deeply nested": Bad("[" * 100_000, ("not valid JSON",), "expect.json"),
    "expects nothing": Bad("", ("has no expectation", "[all]")),
    "is a result": Bad('{"schema": "massprop/result/1"}', ("'massprop/result/1'", "'massprop/expect/1'"), "result.json"),
    "has an unknown quantity": Bad("[all]\nmas = 22.0\n", ("line 2", "'all.mas'", "'mass'")),
    "has an unknown key": Bad("tolerence = 1\n[all]\nmass = 22.0\n", ("line 1", "'tolerence'", "'tolerance'")),
    "has an unknown key in a quantity": Bad("[all.mass]\nvalue = 1\nsigma = 1\n", ("line 3", "'all.mass.sigma'", "nearest")),
    "has a key of truth files": Bad("seed = 1\n[all]\nmass = 22.0\n", ("line 1", "'seed'")),
    "has a quantity outside tables": Bad("mass = 22.0\n", ("mass", "[all]")),
    "has phases as tables": Bad("[phases.single]\nmass = 22.0\n", ("phases.single", "[[phases]]", 'name = "single"')),
    "has a phase without a name": Bad("[[phases]]\nmass = 22.0\n", ("line 1", "phases.0.name", "add it")),
    "names a phase twice": Bad('[[phases]]\nname="a"\nmass=1\n[[phases]]\nname="a"\nixx=1\n', ("'a'", "used twice", "one table")),
    "has text for a value": Bad('[all]\nmass = "22"\n', ("line 2", "all.mass.value", "'22'", "number")),
    "has a switch for a value": Bad("[all]\nmass = true\n", ("line 2", "all.mass.value", "True", "number")),
    "has no value": Bad('[all]\nmass = { tolerance = "2 %" }\n', ("line 2", "'all.mass.value' is missing", "add it")),
    "expects infinity": Bad("[all]\nmass = inf\n", ("line 2", "all.mass.value", "inf", "finite")),
    "expects NaN": Bad('{"all": {"mass": NaN}}', ("all.mass.value", "nan", "finite"), "expect.json"),
    "expects too much": Bad('{"all": {"mass": 1e400}}', ("all.mass.value", "inf", "finite"), "expect.json"),
    "says a key twice": Bad('{"all": {"mass": 1, "mass": 2}}', ("'mass'", "twice", "keep one"), "expect.json"),
    "has a negative tolerance": Bad("[all.mass]\nvalue = 1\ntolerance = -1\n", ("line 3", "all.mass.tolerance", "-1", "0 or more")),
    "has a tolerance without unit": Bad(
        '[all.mass]\nvalue = 1\ntolerance = "1"\n', ("line 3", "all.mass.tolerance", "'1'", "the unit is missing", '"2 %"')
    ),
    "has a tolerance in a foreign unit": Bad('[all.mass]\nvalue=1\ntolerance = "1 m"\n', ("all.mass", '"1 m"', "unit of mass", "in kg")),
    "has one absolute tolerance for all": Bad("tolerance = 0.1\n[all]\nmass=1\n", ("line 1", "tolerance", "several units", '"2 %"')),
    "has one absolute tolerance for a phase": Bad("[all]\ntolerance = 0.1\nmass=1\n", ("line 2", "all.tolerance", "several units")),
    "allows a share of zero": Bad('[all]\ncg_x = { value = 0, tolerance = "2 %" }\n', ("all.cg_x = 0", "2 %", "sigmas")),
    "expects a product without convention": Bad("[all]\nixy = 0.1\n", ("all.ixy = 0.1", "poi_convention", "positive_integral")),
    "is a truth without convention": Bad(
        '{"env": "free", "phases": [{"iyz": 0.1}]}', ("phases.0.iyz = 0.1", 'poi_convention = "tensor"'), "truth.json"
    ),
    "has a convention that is none": Bad('poi_convention = "product"\n[all]\nmass=1\n', ("line 1", "poi_convention", "'tensor'")),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
def test_an_expect_file_is_refused_that(bad: Bad, tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal:
        load(tmp_path, bad.text, bad.file)
    for name in (str(tmp_path / bad.file), *bad.names):
        assert name in str(refusal.value)
    assert len(str(refusal.value)) < 500


# Judging


def judged(tmp_path: Path, text: str, **changes: dict[str, Any]) -> Result:
    return judge(recorded.result([recorded.phase("all", **changes)]), load(tmp_path, text))


def test_a_value_within_its_tolerance_is_met_and_one_outside_is_not(tmp_path: Path) -> None:
    text = "[all]\nmass = {value = 23.0, tolerance = 1.0}\nixx = {value = 0.5, tolerance = 0.1}\ncg_x = -0.018\ncg_y = 0.0\n"
    found = judged(tmp_path, text)
    mass, ixx, cg_x, cg_y = (of(found, name) for name in ("mass", "ixx", "cg_x", "cg_y"))
    assert mass == Expected(value=23.0, tolerance=1.0, stated="1 kg", met=True, difference=-1.0, sigmas=-4.0)
    assert (ixx.met, ixx.tolerance, ixx.stated) == (False, 0.1, "0.1 kg m^2")
    assert ixx.difference == pytest.approx(0.12)
    assert (cg_x.met, cg_x.tolerance, cg_x.stated) == (True, 0.004, "4 sigma")
    assert (cg_y.met, cg_y.sigmas) == (False, 13.5)
    assert found.phases[0].estimates["izz"].expected is None
    assert [line.partition(":")[0] for line in missed(found)] == ["ixx in phase all", "cg_y in phase all"]


def test_an_expectation_does_not_move_the_estimate(tmp_path: Path) -> None:
    before = recorded.result()
    after = judge(before, load(tmp_path, "[all]\nmass = 99.0\n"))
    for name in QUANTITIES:
        assert after.phases[0].estimates[name].model_copy(update={"expected": None}) == before.phases[0].estimates[name]
    assert before.expectations is None


def test_the_result_names_what_it_was_held_against(tmp_path: Path) -> None:
    found = judged(tmp_path, "[all]\nmass = 22.0\n")
    assert found.expectations is not None
    assert found.expectations.path == "expect.toml"
    assert len(found.expectations.sha256) == 64


@pytest.mark.parametrize("verdict", ["not_excited", "unobservable"])
@pytest.mark.parametrize("value", [22.0, None])
def test_what_the_motion_did_not_tell_is_missing_whatever_its_value(verdict: str, value: float | None, tmp_path: Path) -> None:
    sigma = None if value is None else 1e6
    found = judged(tmp_path, "[all]\nmass = 22.0\n", mass={"verdict": verdict, "value": value, "sigma": sigma, "reason": "it wants force"})
    assert not of(found, "mass").met
    (line,) = missed(found)
    assert "missing" in line
    assert verdict in line
    assert "it wants force" in line


@pytest.mark.parametrize("sigma", [0.0, None])
@pytest.mark.parametrize(("value", "met"), [(22.0, True), (22.0000001, False)])
def test_without_a_sigma_a_tolerance_in_sigmas_admits_the_exact_value_alone(
    sigma: float | None, value: float, met: bool, tmp_path: Path
) -> None:
    found = judged(tmp_path, "[all]\nmass = 22.0\n", mass={"value": value, "sigma": sigma})
    assert of(found, "mass").met is met
    assert met or "only the exact value" in missed(found)[0]


def test_a_value_that_still_moves_counts_by_its_value(tmp_path: Path) -> None:
    assert of(judged(tmp_path, "[all]\nmass = 22.0\n", mass={"verdict": "not_converged"}), "mass").met


def test_a_phase_goes_before_all_and_the_docked_object_is_apart(tmp_path: Path) -> None:
    text = '[all]\nmass = 22.0\nixx = 0.62\n[[phases]]\nname = "combined"\nmass = 30.0\n[docked]\nizz = 9.0\n'
    two = recorded.result([recorded.phase("single"), recorded.phase("combined")], docked_object=recorded.docked())
    found = judge(two, load(tmp_path, text))
    assert of(found, "mass", 0).met
    assert (of(found, "mass", 1).met, of(found, "mass", 1).value) == (False, 30.0)
    assert of(found, "ixx", 1).met
    assert found.docked_object is not None
    assert {name: item.expected is not None for name, item in found.docked_object.estimates.items() if name in ("izz", "mass")} == {
        "izz": True,
        "mass": False,
    }
    assert [line.partition(":")[0] for line in missed(found)] == ["mass in phase combined", "izz in docked object (combined less single)"]


def test_a_second_judgement_leaves_nothing_of_the_first(tmp_path: Path) -> None:
    first = judged(tmp_path, "[all]\nmass = 99.0\n")
    second = judge(first, load(tmp_path, "[all]\nixx = 0.62\n"))
    assert second.phases[0].estimates["mass"].expected is None
    assert missed(second) == []


NOT_OF_THIS_RESULT = {
    "another phase": ('[[phases]]\nname = "single"\nmass = 1\n', "e.toml", ("'single'", "'all'", "Name one of these")),
    "more phases": ('{"env": "free", "phases": [{"mass": 1}, {"mass": 2}]}', "t.json", ("2 phases without names", "'all'")),
    "a phase without a name among named ones": (
        '{"env": "free", "phases": [{"mass": 1}, {"name": "all", "mass": 2}]}',
        "t.json",
        ("without a name", "'all'"),
    ),
    "a docked object": ("[docked]\nmass = 1\n", "e.toml", ("docked object", "[docking]")),
}


@pytest.mark.parametrize(("text", "file", "names"), NOT_OF_THIS_RESULT.values(), ids=NOT_OF_THIS_RESULT.keys())
def test_expectations_are_refused_of(text: str, file: str, names: tuple[str, ...], tmp_path: Path) -> None:
    wanted = load(tmp_path, text, file)
    with pytest.raises(InputError) as refusal:
        judge(recorded.result(), wanted)
    for name in (str(tmp_path / file), *names):
        assert name in str(refusal.value)


# massprop estimate --expect

LOG = SAMPLES / "high-rate" / "log.parquet"


def test_estimate_meets_the_truth_of_a_sample_log(tmp_path: Path) -> None:
    done = massprop(tmp_path, "estimate", LOG, "--out", "out", "--expect", SAMPLES / "high-rate" / "truth.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("✓") == 10
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    jsonschema.validate(written, schemas.schema("result"))
    assert written["expectations"]["path"] == "truth.json"
    assert written["phases"][0]["estimates"]["mass"]["expected"]["met"] is True


def test_estimate_exits_5_with_one_line_that_names_each_missed_quantity_after_writing(tmp_path: Path) -> None:
    (tmp_path / "e.toml").write_text('[all]\nmass = { value = 25.0, tolerance = "2 %" }\nixx = 0.55\niyy = 3.0\n')
    done = massprop(tmp_path, "estimate", LOG, "--out", "out", "--expect", "e.toml", "--json")
    assert done.returncode == 5
    assert done.stdout == (tmp_path / "out" / "result.json").read_text()
    (line,) = done.stderr.splitlines()
    assert "mass in phase all: expected 25 ± 0.5 kg (2 %), got 18.9" in line
    assert "iyy in phase all: expected 3 ± " in line
    assert "ixx" not in line


def test_what_is_required_and_not_converged_goes_before_what_is_not_as_expected(tmp_path: Path) -> None:
    (tmp_path / "e.toml").write_text("[all]\nmass = 99.0\n")
    settings = ("--set", "convergence.count=100000", "--require", "mass", "-q")
    assert massprop(tmp_path, "estimate", LOG, "--out", "out", "--expect", "e.toml", *settings).returncode == 4


@pytest.mark.parametrize("text", ["[all]\nmas = 1\n", '[[phases]]\nname = "cruise"\nmass = 1\n', "[docked]\nmass = 1\n"])
def test_estimate_writes_nothing_if_the_expect_file_can_not_be_used(text: str, tmp_path: Path) -> None:
    (tmp_path / "e.toml").write_text(text)
    before = contents(tmp_path)
    done = massprop(tmp_path, "estimate", LOG, "--out", "out", "--expect", "e.toml")
    assert (done.returncode, done.stdout) == (3, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("massprop: e.toml")
    assert contents(tmp_path) == before


def test_a_missing_expect_file_is_refused(tmp_path: Path) -> None:
    done = massprop(tmp_path, "estimate", LOG, "--expect", "nowhere.toml")
    assert done.returncode == 3
    assert "nowhere.toml: no such expect file" in done.stderr


def test_a_contradicted_value_meets_no_expectation_and_says_the_cause() -> None:
    wanted = expect.Expectations("e", "c" * 64, {"mass": expect.Wanted(22.0, Tolerance(50.0, "relative"))}, (), {})
    found = judge(recorded.result([recorded.contradicted()]), wanted)
    assert not of(found, "mass").met
    assert missed(found) == [f"mass in phase all: expected 22 ± 11 kg (50 %), contradicted: {recorded.CAUSE}"]
