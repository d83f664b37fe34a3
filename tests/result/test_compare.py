import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from massprop_cli import QUANTITIES, schemas
from massprop_cli.base import escape
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import tolerancefile
from massprop_cli.inputs.tolerance import Tolerance
from massprop_cli.inputs.tolerancefile import Gate
from massprop_cli.result.compare import Comparison, beyond, compare, failure
from massprop_cli.result.schema import Result
from tests import recorded
from tests.commandline import massprop
from tests.refusal import contents

NOT_EXCITED = {"verdict": "not_excited", "value": 22.0, "sigma": 1e6, "final_at_s": None, "reason": "hardly informed"}
FOUR = Gate()


def one(**changes: Any) -> Result:
    return recorded.result([recorded.phase("all", **changes)])


def between(new: Result, old: Result, allowed: Gate = FOUR) -> Comparison:
    return compare(recorded.recorded(new, "new"), recorded.recorded(old, "old"), allowed)


def load(folder: Path, text: str, max_sigma: float = 4.0) -> Gate:
    path = folder / "tolerance.toml"
    path.write_text(text, encoding="utf-8")
    return tolerancefile.load(path, max_sigma)


def test_a_difference_is_held_against_the_sigmas_of_both() -> None:
    found = between(one(mass={"value": 23.0, "sigma": 0.3}), one(mass={"value": 22.0, "sigma": 0.4}))
    mass = found.parts[0].differences["mass"]
    assert (mass.difference, mass.difference_sigma, mass.sigmas) == (1.0, 0.5, 2.0)
    assert (mass.tolerance, mass.stated, mass.within) == (2.0, "4 sigma", True)
    assert found.within
    assert beyond(found) == []


def test_a_difference_beyond_four_sigmas_is_named_with_both_values() -> None:
    found = between(one(mass={"value": 24.1, "sigma": 0.3}), one(mass={"value": 22.0, "sigma": 0.4}))
    assert not found.within
    assert beyond(found) == ["mass in phase all: 24.1, in the baseline 22, off by +2.1 kg, +4.2 sigma, allowed 2 kg (4 sigma)"]


def test_a_result_differs_from_itself_by_nothing() -> None:
    same = one(mass={"sigma": 0.0}, ixx=NOT_EXCITED)
    found = between(same, same)
    assert found.within
    differences = found.parts[0].differences
    assert {d.difference for name, d in differences.items() if name != "ixx"} == {0.0}
    assert {d.sigmas for name, d in differences.items() if name != "ixx"} == {0.0}
    assert differences["ixx"].note == "missing in both"
    assert any("one log" in note for note in found.notes)


def test_exchanging_both_turns_every_sign() -> None:
    old, new = one(), one(mass={"value": 22.3}, ixx={"value": 0.61})
    there, back = (between(a, b).parts[0].differences for a, b in ((new, old), (old, new)))
    for name in QUANTITIES:
        assert there[name].difference == -(back[name].difference or 0.0)
        assert there[name].sigmas == -(back[name].sigmas or 0.0)
        assert there[name].within == back[name].within


def test_what_the_baseline_has_and_the_result_lacks_is_beyond_whatever_is_allowed() -> None:
    found = between(one(mass=NOT_EXCITED), one(), Gate(Tolerance(1e9, "sigma")))
    assert beyond(found) == ["mass in phase all: 22 kg in the baseline, missing in the result (not_excited)"]
    assert found.parts[0].differences["mass"].difference is None


def test_what_the_result_has_beyond_the_baseline_is_no_fault() -> None:
    found = between(one(), one(mass=NOT_EXCITED))
    assert found.within
    assert found.parts[0].differences["mass"].note == "missing in the baseline"


@pytest.mark.parametrize("sigma", [0.0, None])
def test_without_sigmas_a_gate_in_sigmas_admits_an_equal_value_alone(sigma: float | None) -> None:
    found = between(one(mass={"value": 22.1, "sigma": sigma}), one(mass={"sigma": sigma})).parts[0].differences["mass"]
    assert (found.within, found.sigmas) == (False, None)
    assert "only an equal value" in found.note
    assert between(one(mass={"sigma": sigma}), one(mass={"sigma": sigma})).within


def test_a_tolerance_file_goes_by_quantity_and_phase_and_what_it_leaves_out_goes_by_sigmas(tmp_path: Path) -> None:
    allowed = load(
        tmp_path,
        '[all]\nmass = "10 %"\ntolerance = "50 sigma"\n[[phases]]\nname = "b"\nmass = "0.5 kg"\n[docked]\nizz = "1 kg m^2"\n',
        max_sigma=2.0,
    )
    assert allowed.of("mass", "a") == Tolerance(10.0, "relative")
    assert allowed.of("mass", "b") == Tolerance(0.5, "absolute", "kg")
    assert allowed.of("ixx", "b") == Tolerance(50.0, "sigma")
    assert allowed.of("izz", None) == Tolerance(1.0, "absolute", "kg m^2")
    assert allowed.of("mass", None) == Tolerance(2.0, "sigma")
    new, old = ([recorded.phase(name, mass={"value": value}) for name in ("a", "b")] for value in (24.0, 22.0))
    found = between(recorded.result(new), recorded.result(old), allowed)
    assert [part.differences["mass"].within for part in found.parts] == [True, False]
    assert found.parts[0].differences["mass"].tolerance == pytest.approx(2.2)


def test_a_docked_object_is_compared_and_one_that_is_lost_is_missing() -> None:
    phases = [recorded.phase("single"), recorded.phase("combined")]
    with_it = recorded.result(phases, docked_object=recorded.docked())
    other = recorded.result(phases, docked_object=recorded.docked(mass={"value": 30.0}))
    assert [line.partition(":")[0] for line in beyond(between(other, with_it))] == ["mass in docked object (combined less single)"]
    assert len(beyond(between(recorded.result(phases), with_it))) == 10
    found = between(with_it, recorded.result(phases))
    assert (found.within, found.compared) == (True, 20)
    assert found.warnings == [
        "nothing could be compared in docked object (combined less single): no quantity has a value in both "
        "(result: 10 converged; baseline: 10 absent)"
    ]


def test_two_results_without_a_value_in_both_do_not_pass_for_equal() -> None:
    told = between(one(**dict.fromkeys(QUANTITIES, NOT_EXCITED)), one(**dict.fromkeys(QUANTITIES, NOT_EXCITED)))
    assert (told.within, told.compared, beyond(told)) == (False, 0, [])
    said = "nothing could be compared in phase all: no quantity has a value in both (result: 10 not_excited; baseline: 10 not_excited)"
    assert failure(told) == said
    lost = between(one(**dict.fromkeys(QUANTITIES, NOT_EXCITED)), one(**dict.fromkeys(QUANTITIES[1:], NOT_EXCITED)))
    assert failure(lost).endswith("beyond the baseline: ixx in phase all: 0.62 kg m^2 in the baseline, missing in the result (not_excited)")


def test_one_quantity_in_both_is_enough_to_compare() -> None:
    few = one(**dict.fromkeys(QUANTITIES[1:], NOT_EXCITED))
    found = between(few, few)
    assert (found.within, found.compared, found.warnings, failure(found)) == (True, 1, [], "")


def changed(**changes: Any) -> Result:
    """A result with changes of parts of result.json, e.g. ``vehicle={"name": "x"}``."""
    data = recorded.result().model_dump(by_alias=True)
    return Result.model_validate(data | {key: data[key] | value for key, value in changes.items()})


@dataclass(frozen=True)
class Unlike:
    """A result that does not go with the baseline, and what the message names."""

    result: Result
    names: tuple[str, ...]


UNLIKE = {
    "another vehicle": Unlike(changed(vehicle={"name": "barge"}), ("vehicle is 'barge'", "'tug'")),
    "another environment": Unlike(changed(vehicle={"environment": "air_bearing"}), ("environment", "'air_bearing'", "'free'")),
    "another bearing": Unlike(changed(vehicle={"bearing_mass_kg": 5.0}), ("bearing mass [kg] is 5.0", "0.0")),
    "other phases": Unlike(recorded.result([recorded.phase("x"), recorded.phase("y")]), ("phases is 'x, y'", "'all'")),
}


@pytest.mark.parametrize("unlike", UNLIKE.values(), ids=UNLIKE.keys())
def test_a_comparison_is_refused_with(unlike: Unlike) -> None:
    with pytest.raises(InputError) as refusal:
        between(unlike.result, recorded.result())
    for name in (*unlike.names, "/results/new/result.json", "/results/old/result.json", "Name a baseline"):
        assert name in str(refusal.value)


def test_another_docking_is_refused() -> None:
    phases = [recorded.phase("single"), recorded.phase("combined")]
    old = recorded.result(phases, docked_object=recorded.docked())
    new = recorded.result(phases, docked_object=recorded.docked() | {"before": "combined", "after": "single"})
    with pytest.raises(InputError, match="docked object is 'single less combined', and 'combined less single'"):
        between(new, old)


def test_a_changed_vehicle_file_version_or_method_is_a_note() -> None:
    settings = {"settings": {"estimator.method": "thesis"}, "massprop": "0.2.0", "vehicle_sha256": "d" * 64, "input_sha256": "e" * 64}
    notes = " | ".join(between(changed(provenance=settings), recorded.result()).notes)
    assert "vehicle files differ" in notes
    assert "massprop 0.2.0 and 0.1.0" in notes
    assert "made by the methods thesis and default" in notes
    assert "are not errors" in notes
    assert "one log" not in notes


BAD_TOLERANCES = {
    "is empty": ("", ("states no tolerance", "[all]", '"2 %"')),
    "has a bare number": ("[all]\nmass = 22.0\n", ("line 2", "all.mass = 22.0", '"0.05 kg m^2"')),
    "is an expect file": ("[all]\nmass = { value = 22.0 }\n", ("line 2", "all.mass", '"2 %"')),
    "has an unknown quantity": ('[all]\nmas = "2 %"\n', ("line 2", "'all.mas'", "'mass'")),
    "has a foreign unit": ('[all]\nmass = "2 m"\n', ("line 2", "all.mass", '"2 m"', "in kg")),
    "has a quantity outside tables": ('mass = "2 %"\n', ("mass", "[all]")),
    "has one absolute tolerance for all": ('[all]\ntolerance = "2 kg"\n', ("line 2", "all.tolerance", "several units")),
    "names a phase twice": ('[[phases]]\nname = "all"\nmass = "2 %"\n' * 2, ("'all'", "used twice")),
    "names an unknown phase": ('[[phases]]\nname = "cruise"\nmass = "2 %"\n', ("'cruise'", "'all'")),
}


@pytest.mark.parametrize(("text", "names"), BAD_TOLERANCES.values(), ids=BAD_TOLERANCES.keys())
def test_a_tolerance_file_is_refused_that(text: str, names: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal:
        between(recorded.result(), recorded.result(), load(tmp_path, text))
    for name in (str(tmp_path / "tolerance.toml"), *names):
        assert name in str(refusal.value)


def test_json_fits_its_schema_and_is_the_same_each_time() -> None:
    text = escape.document(between(one(mass=NOT_EXCITED), one()))
    jsonschema.validate(json.loads(text), schemas.schema("compare"))
    assert text == escape.document(between(one(mass=NOT_EXCITED), one()))


# massprop compare


def save(folder: Path, found: Result) -> Path:
    folder.mkdir()
    (folder / "result.json").write_text(escape.document(found), encoding="utf-8")
    return folder


def test_compare_prints_a_table_writes_nothing_and_exits_0(tmp_path: Path) -> None:
    new, old = save(tmp_path / "new", one(mass={"value": 22.3})), save(tmp_path / "old", one())
    before = contents(tmp_path)
    done = massprop(tmp_path, "compare", new, old / "result.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert contents(tmp_path) == before
    row = next(line for line in done.stdout.splitlines() if "mass" in line)
    assert "".join(row.split()) == "│mass│22.30│22.00│0.30│0.35│+0.85│kg│4sigma│✓│"
    assert "tensor's own elements" in done.stdout
    assert "body axes" in done.stdout


def test_compare_exits_5_with_one_line_beyond_the_gate(tmp_path: Path) -> None:
    new, old = save(tmp_path / "new", one(mass={"value": 22.3})), save(tmp_path / "old", one())
    done = massprop(tmp_path, "compare", new, old, "--max-sigma", "0.5", "-q")
    assert (done.returncode, done.stdout) == (5, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("massprop: beyond the baseline: mass in phase all: 22.3, in the baseline 22, off by +0.3 kg, +0.849 sigma")
    (tmp_path / "t.toml").write_text('[all]\nmass = "5 %"\n')
    assert massprop(tmp_path, "compare", new, old, "--max-sigma", "0.5", "-q", "--tolerance", "t.toml").returncode == 0
    done = massprop(tmp_path, "compare", new, old, "--max-sigma", "0.5", "--json")
    assert done.returncode == 5
    assert math.isclose(json.loads(done.stdout)["parts"][0]["differences"]["mass"]["difference"], 0.3)


def test_compare_exits_5_where_nothing_could_be_compared_and_warns_of_a_part_of_which_nothing_could(tmp_path: Path) -> None:
    nothing = dict.fromkeys(QUANTITIES, NOT_EXCITED)
    save(tmp_path / "none", one(**nothing))
    done = massprop(tmp_path, "compare", "none", "none", "--json")
    assert (done.returncode, json.loads(done.stdout)["compared"]) == (5, 0)
    assert done.stderr.startswith("massprop: nothing could be compared in phase all: no quantity has a value in both (result: 10 not_ex")
    assert len(done.stderr.splitlines()) == 1
    save(tmp_path / "half", recorded.result([recorded.phase("a"), recorded.phase("b", **nothing)]))
    done = massprop(tmp_path, "compare", "half", "half")
    assert done.returncode == 0
    assert done.stderr.startswith("massprop: warning: nothing could be compared in phase b: ")
    assert massprop(tmp_path, "compare", "half", "half", "-q").stderr == ""


REFUSED = {
    "a folder without a result": (("empty",), "holds no result.json", 3),
    "a missing result": (("nowhere",), "no such result.json", 3),
    "another vehicle": (("barge",), "vehicle is 'tug', and 'barge'", 3),
    "a result that is no JSON": (("broken",), "not valid JSON", 3),
    "a missing tolerance file": (("old", "--tolerance", "nowhere.toml"), "no such tolerance file", 3),
    "a gate that is no number of sigmas": (("old", "--max-sigma", "nan"), "--max-sigma", 2),
}


@pytest.mark.parametrize(("arguments", "says", "code"), REFUSED.values(), ids=REFUSED.keys())
def test_compare_refuses(arguments: tuple[str, ...], says: str, code: int, tmp_path: Path) -> None:
    save(tmp_path / "new", one())
    save(tmp_path / "old", one())
    save(tmp_path / "barge", changed(vehicle={"name": "barge"}))
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "result.json").write_text("{")
    done = massprop(tmp_path, "compare", "new", *arguments)
    assert (done.returncode, done.stdout) == (code, "")
    assert "Traceback" not in done.stderr
    assert says in done.stderr


def test_a_contradicted_value_is_within_nothing_of_a_baseline() -> None:
    found = between(one(mass={"verdict": "contradicted"}), one())
    assert beyond(found) == ["mass in phase all: 22 kg in the baseline, contradicted in the result (contradicted)"]
    assert not found.within
    both = between(one(mass={"verdict": "contradicted"}), one(mass={"verdict": "contradicted"}))
    assert both.parts[0].differences["mass"].note == "contradicted in both"
    half = between(one(mass={"verdict": "contradicted"}), one(mass=NOT_EXCITED))
    assert half.parts[0].differences["mass"].note == "contradicted in the result, missing in the baseline"
