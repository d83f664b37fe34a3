from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import xmlschema
from hypothesis import given
from hypothesis import strategies as st
from junitparser import Error, Failure, JUnitXml, Skipped

from massprop_cli import QUANTITIES
from massprop_cli.inputs.expect import Expectations, Wanted
from massprop_cli.inputs.tolerance import FOUR_SIGMA, Tolerance
from massprop_cli.report import junit
from massprop_cli.report.junit import LogOutcome
from massprop_cli.result.judge import judge
from massprop_cli.result.schema import Result
from tests import recorded

SCHEMA = xmlschema.XMLSchema10(Path(__file__).parents[1] / "data" / "jenkins-junit.xsd")
NOT_EXCITED = {"verdict": "not_excited", "value": None, "sigma": None, "final_at_s": None, "reason": "the motion hardly informed it"}


def document(*outcomes: LogOutcome) -> JUnitXml:
    """What a dashboard reads, after the schema has been checked."""
    text = junit.text(outcomes)
    SCHEMA.validate(text)
    return JUnitXml.fromstring(text.encode())


def cases(suite: Any) -> dict[str, Any]:
    return {case.name: case for case in suite}


def only(outcome: LogOutcome) -> dict[str, Any]:
    (suite,) = document(outcome)
    return cases(suite)


def held(found: Result, **values: float) -> Result:
    wanted = {name: Wanted(value, FOUR_SIGMA) for name, value in values.items()}
    return judge(found, Expectations("expect.toml", "c" * 64, wanted, (), {}))


def kinds(case: Any) -> list[type]:
    return [type(entry) for entry in case.result]


def test_without_expectations_each_quantity_is_a_case_that_passes_if_converged() -> None:
    found = only(LogOutcome("run", recorded.result([recorded.phase("all", cg_x=NOT_EXCITED, mass={"verdict": "not_converged"})])))
    assert list(found) == list(QUANTITIES)
    assert kinds(found["ixx"]) == []
    assert found["ixx"].classname == "run.phase all"
    assert found["ixx"].system_out == "ixx = 0.620 ± 0.010 kg m², converged"
    assert kinds(found["cg_x"]) == [Skipped]
    assert found["cg_x"].result[0].message == (
        "not_excited: the motion hardly informed it; it needs force across X (along Y or Z), or fast rotation about Y or Z"
    )
    assert kinds(found["mass"]) == [Skipped]


def test_with_expectations_each_expected_quantity_is_a_case_that_fails_if_missing_or_outside_its_tolerance() -> None:
    found = only(LogOutcome("run", held(recorded.result([recorded.phase("all", cg_x=NOT_EXCITED)]), ixx=0.5, mass=22.5, cg_x=0.0)))
    assert list(found) == ["ixx", "cg_x", "mass"]
    assert kinds(found["ixx"]) == [Failure]
    assert found["ixx"].result[0].message == "expected 0.5 ± 0.04 kg m^2 (4 sigma), got 0.62 (off by +0.12, +12 sigma)"
    assert kinds(found["mass"]) == []
    assert kinds(found["cg_x"]) == [Failure], "it exits 5 too"
    assert found["cg_x"].result[0].type == "not_excited"
    assert "expected 0 ± ? m (4 sigma), missing: not_excited" in found["cg_x"].result[0].message


def test_a_log_that_could_not_be_used_is_an_error_and_the_others_are_told() -> None:
    xml = document(LogOutcome("bad", error="bad.csv, line 3: nan"), LogOutcome("good", recorded.result()))
    bad, good = xml
    (case,) = bad
    assert kinds(case) == [Error]
    assert case.result[0].message == "bad.csv, line 3: nan"
    assert (bad.errors, bad.tests, good.errors, good.tests) == (1, 1, 0, 10)
    assert (xml.tests, xml.errors, xml.failures) == (11, 1, 0)


def test_required_quantities_that_are_not_converged_are_a_failure_with_its_reason() -> None:
    (suite,) = document(LogOutcome("run", recorded.result(), unmet="required but not converged: mass in phase all is not_excited"))
    assert (suite.tests, suite.failures, suite.errors) == (11, 1, 0)
    (case,) = (case for case in suite if case.name == "required")
    assert case.classname == "run.log"
    assert case.result[0].message == "required but not converged: mass in phase all is not_excited"


def test_counts_are_those_of_the_cases() -> None:
    (suite,) = document(LogOutcome("run", held(recorded.result([recorded.phase("all", cg_x=NOT_EXCITED)]), ixx=0.5, mass=22.5, cg_x=0.0)))
    assert (suite.tests, suite.failures, suite.errors, suite.skipped) == (3, 2, 0, 0)


def test_phases_and_docked_object_are_classes_of_one_suite() -> None:
    two = recorded.result([recorded.phase("single"), recorded.phase("com.bined")], docked_object=recorded.docked())
    (suite,) = document(LogOutcome("a.b/run", two))
    assert len(list(suite)) == 30
    names = dict.fromkeys(case.classname for case in suite)
    assert list(names) == ["a_b/run.phase single", "a_b/run.phase com_bined", "a_b/run.docked object (combined less single)"]


def test_warnings_and_conventions_stand_in_the_suite() -> None:
    found = recorded.result(warnings=[{"code": "delay-mismatch", "message": "two cycles late"}])
    document(LogOutcome("run", found))
    suite = ElementTree.fromstring(junit.text([LogOutcome("run", found)]))[0]
    assert suite.findtext("system-err") == "warning: two cycles late [delay-mismatch]"
    properties = {entry.get("name"): entry.get("value", "") for entry in suite.iter("property")}
    assert properties["vehicle"] == "tug"
    assert "ixy = −Σ m x y" in properties["conventions"]


def test_no_outcomes_make_an_empty_document() -> None:
    assert list(document()) == []


def test_same_outcomes_give_the_same_bytes() -> None:
    assert junit.text([LogOutcome("run", recorded.result())]) == junit.text([LogOutcome("run", recorded.result())])


@pytest.mark.parametrize("hostile", ["a\x00b\x1b[31m\x08", "]]>", "\"<&>'", "\ud800", "\u202eevil", "\ufffe\uffff", "a\r\nb\tc", ""])
def test_names_with_characters_that_xml_forbids_are_read_all_the_same(hostile: str) -> None:
    log = {"path": hostile, "rows": 1, "cycles": 1, "duration_s": 1.0, "cycle_s": 1.0}
    found = recorded.result([recorded.phase(hostile)], log=log, warnings=[{"code": hostile, "message": hostile}])
    document(LogOutcome(hostile, found), LogOutcome(hostile, error=hostile))


@given(st.lists(st.text(), max_size=3))
def test_any_text_makes_a_valid_document(texts: Sequence[str]) -> None:
    document(*(LogOutcome(text, error=text) for text in texts))


def test_an_absolute_tolerance_is_named_in_its_unit() -> None:
    wanted = Expectations("e", "c" * 64, {"mass": Wanted(25.0, Tolerance(0.5, "absolute"))}, (), {})
    case = only(LogOutcome("run", judge(recorded.result(), wanted)))["mass"]
    assert case.result[0].message == "expected 25 ± 0.5 kg, got 22 (off by -3, -12 sigma)"


def test_a_contradicted_quantity_fails_with_the_cause_expected_or_not() -> None:
    found = recorded.result([recorded.contradicted()])
    for cases_ in (only(LogOutcome("run", found)), only(LogOutcome("run", held(found, mass=22.0)))):
        assert kinds(cases_["mass"]) == kinds(cases_["ixx"]) == [Failure]
        assert recorded.CAUSE in cases_["mass"].result[0].message
        assert cases_["ixx"].result[0].message == f"contradicted: {recorded.CAUSE}; correct the cause; no motion helps"
        assert cases_["ixx"].system_out == "ixx = -830 ± 4.0 kg m², contradicted"
    assert cases_["mass"].result[0].message == f"expected 22 ± 1 kg (4 sigma), contradicted: {recorded.CAUSE}"
    (suite,) = document(LogOutcome("run", found))
    assert (suite.tests, suite.failures, suite.skipped) == (10, 7, 3)
    assert "torque about Z" not in junit.text([LogOutcome("run", found)])
