import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from massprop_cli import QUANTITIES
from massprop_cli.base.escape import line
from massprop_cli.inputs.expect import Expectations, Wanted
from massprop_cli.inputs.tolerance import Tolerance
from massprop_cli.report import spreadsheet
from massprop_cli.result.judge import judge
from tests import recorded


def read(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline=""), strict=True))


def log(path: str) -> dict[str, object]:
    return {"path": path, "rows": 1, "cycles": 1, "duration_s": 1.0, "cycle_s": 1.0}


def test_a_row_stands_for_each_phase_and_docked_object_of_each_result() -> None:
    two = recorded.result([recorded.phase("single"), recorded.phase("combined")], docked_object=recorded.docked())
    found = read(spreadsheet.text([recorded.recorded(two, "dock"), recorded.recorded(folder="plain")]))
    assert [(row["result"], row["part"], row["phase"]) for row in found] == [
        ("dock", "phase", "single"),
        ("dock", "phase", "combined"),
        ("dock", "docked", "combined less single"),
        ("plain", "phase", "all"),
    ]
    assert (found[0]["start_s"], found[0]["end_s"], found[2]["end_s"]) == ("0.0", "60.0", "")


def test_columns_are_the_same_whatever_the_results() -> None:
    assert spreadsheet.text([]) == ",".join(spreadsheet.COLUMNS) + "\r\n"
    assert spreadsheet.text([recorded.recorded()]).startswith(spreadsheet.text([]))
    assert len(set(spreadsheet.COLUMNS)) == len(spreadsheet.COLUMNS)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_in_full_precision(value: float) -> None:
    (row,) = read(
        spreadsheet.text([recorded.recorded(recorded.result([recorded.phase("all", izz={"value": value, "sigma": abs(value)})]))])
    )
    assert float(row["izz_kg_m2"]) == value
    assert float(row["izz_sigma_kg_m2"]) == abs(value)


def test_units_stand_in_the_names_and_frame_and_convention_in_columns() -> None:
    (row,) = read(spreadsheet.text([recorded.recorded()]))
    for name in QUANTITIES:
        unit = "kg_m2" if name.startswith("i") else "m" if name.startswith("cg") else "kg"
        assert float(row[f"{name}_{unit}"]) == recorded.VALUES[name]
        assert float(row[f"{name}_sigma_{unit}"]) == recorded.SIGMAS[name]
        assert row[f"{name}_verdict"] == "converged"
        assert row[f"{name}_final_at_s"] == "12.5"
    assert (row["inertia_about"], row["axes"], row["products_of_inertia"]) == ("cg", "body", "tensor")
    assert (row["environment"], row["method"], row["delay_cycles"]) == ("free", "default", "2.0")


def test_what_is_missing_is_empty_and_named_with_the_motion_that_cures_it() -> None:
    gap = {"verdict": "unobservable", "value": None, "sigma": None, "final_at_s": None, "reason": "no motion shows it"}
    (row,) = read(spreadsheet.text([recorded.recorded(recorded.result([recorded.phase("all", mass=gap)]))]))
    assert (row["mass_kg"], row["mass_sigma_kg"], row["mass_final_at_s"]) == ("", "", "")
    assert row["missing"] == "mass: unobservable: no motion shows it; it needs force in both directions"


def test_expectations_and_warnings_have_columns() -> None:
    wanted = {"mass": Wanted(23.0, Tolerance(2.0, "relative"))}
    found = judge(
        recorded.result(warnings=[{"code": "jet-dead", "message": "jet a"}, {"code": "x", "message": "b"}]),
        Expectations("/somewhere/expect.toml", "c" * 64, wanted, (), {}),
    )
    (row,) = read(spreadsheet.text([recorded.recorded(found)]))
    assert (row["mass_expected_kg"], row["mass_tolerance_kg"], row["mass_tolerance_stated"], row["mass_met"]) == (
        "23.0",
        "0.46",
        "2 %",
        "false",
    )
    assert (row["ixx_expected_kg_m2"], row["ixx_met"]) == ("", "")
    assert row["expectations"] == "expect.toml"
    assert row["warnings"] == "jet a [jet-dead]; b [x]"


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", " =1"])
def test_a_name_that_a_spreadsheet_takes_for_a_formula_is_guarded(name: str) -> None:
    (row,) = read(spreadsheet.text([recorded.recorded(recorded.result(log=log(name)))]))
    assert row["log"] == f"'{line(name)}"


def test_a_negative_number_is_a_number() -> None:
    (row,) = read(spreadsheet.text([recorded.recorded()]))
    assert row["ixz_kg_m2"] == "-0.07"


@pytest.mark.parametrize("name", ["a,b", 'say "x"', "a\r\nb", "\x00", "\ud800", ""])
def test_names_that_hold_separators_stay_in_their_cell(name: str) -> None:
    text = spreadsheet.text([recorded.recorded(recorded.result(log=log(name)))])
    text.encode()
    (row,) = read(text)
    assert row["log"] == line(name)
    assert list(row) == list(spreadsheet.COLUMNS)


def test_lines_end_as_rfc_4180_says() -> None:
    text = spreadsheet.text([recorded.recorded()])
    assert text.count("\r\n") == text.count("\n") == 2


def test_a_contradiction_has_a_column_and_numbers_stay_in_full_precision() -> None:
    docked = recorded.docked() | {"contradiction": "phase single is contradicted"}
    found = recorded.result([recorded.contradicted("single"), recorded.phase("combined")], docked_object=docked)
    one, two, three = read(spreadsheet.text([recorded.recorded(found)]))
    assert [row["contradiction"] for row in (one, two, three)] == [recorded.CAUSE, "", "phase single is contradicted"]
    assert (one["ixx_kg_m2"], one["ixx_sigma_kg_m2"], one["ixx_verdict"]) == ("-825.1234567", "4.0", "contradicted")
    assert f"mass: contradicted: {recorded.CAUSE}; correct the cause" in one["missing"]
    assert "torque about" not in one["missing"]
