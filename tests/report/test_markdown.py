import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from massprop_cli import QUANTITIES
from massprop_cli.base.escape import line
from massprop_cli.inputs.expect import Expectations, Wanted
from massprop_cli.inputs.tolerance import FOUR_SIGMA, Tolerance
from massprop_cli.report import markdown, vocabulary
from massprop_cli.result.judge import judge
from massprop_cli.result.schema import Result
from tests import recorded

READER = MarkdownIt("commonmark", {"html": True, "linkify": False}).enable("table")


def rendered(text: str) -> str:
    return str(READER.render(text))


def tables(text: str) -> list[list[list[str]]]:
    """Cells of each table, as a reader sees them."""
    found: list[list[list[str]]] = []
    for token in READER.parse(text):
        if token.type == "table_open":
            found.append([])
        elif token.type == "tr_open":
            found[-1].append([])
        elif token.type == "inline" and found and token.level == 4:
            found[-1][-1].append(_plain(token))
    return found


def items(text: str) -> list[str]:
    """Texts outside tables."""
    return [_plain(token) for token in READER.parse(text) if token.type == "inline" and token.level < 4]


def _plain(token: Any) -> str:
    return "".join(child.content for child in token.children or [] if child.type in ("text", "text_special", "code_inline"))


def held(found: Result) -> Result:
    wanted = {"ixx": Wanted(0.5, FOUR_SIGMA), "mass": Wanted(22.5, Tolerance(5.0, "relative"))}
    return judge(found, Expectations("expect.toml", "c" * 64, wanted, (), {}))


def test_one_result_is_a_table_per_phase_with_units_and_verdicts_in_words() -> None:
    (table,) = tables(markdown.text([recorded.recorded()]))
    assert table[0] == ["quantity", "value", "± sigma", "unit", "verdict", "final at"]
    assert [row[0] for row in table[1:]] == list(QUANTITIES)
    assert table[1] == ["ixx", "0.620", "0.010", "kg m²", "✓ converged", "12.50 s"]
    assert table[10] == ["mass", "22.00", "0.25", "kg", "✓ converged", "12.50 s"]


def test_expectations_stand_beside_the_values_and_what_is_missed_above_them() -> None:
    text = markdown.text([recorded.recorded(held(recorded.result()))])
    (table,) = tables(text)
    assert table[0][6:] == ["expected", "tolerance", "met"]
    assert table[1][6:] == ["0.5", "4 sigma", "✗ missed"]
    assert table[2][6:] == ["–", "–", "–"]
    assert table[10][6:] == ["22.5", "5 %", "✓ met"]
    assert "✗ 1 not as expected (tested against expect.toml):" in items(text)
    assert "ixx in phase all: expected 0.5 ± 0.04 kg m^2 (4 sigma), got 0.62 (off by +0.12, +12 sigma)" in items(text)


def test_it_says_what_is_missing_which_motion_cures_it_and_every_warning() -> None:
    gap = {"verdict": "not_excited", "value": None, "sigma": None, "final_at_s": None, "reason": "drowned"}
    found = recorded.result([recorded.phase("all", mass=gap)], warnings=[{"code": "jet-dead", "message": "jet roll_p1 is dead"}])
    text = markdown.text([recorded.recorded(found)])
    assert tables(text)[0][10] == ["mass", "–", "–", "kg", "○ not excited", "–"]
    said = items(text)
    assert "mass in phase all: not_excited: drowned; it needs force in both directions" in said
    assert "jet roll_p1 is dead (jet-dead)" in said
    assert any(entry.startswith("Products are the tensor's own elements, ixy = −Σ m x y") for entry in said)
    assert any("body axes" in entry for entry in said)


def test_nominal_values_have_a_column_where_there_are_any() -> None:
    text = markdown.text([recorded.recorded(recorded.result([recorded.phase("all", ixx={"nominal": 0.6})]))])
    (table,) = tables(text)
    assert [row[6] for row in table[:3]] == ["nominal", "0.6", "–"]


def test_phases_and_docked_object_have_a_table_each() -> None:
    two = recorded.result([recorded.phase("single"), recorded.phase("combined")], docked_object=recorded.docked())
    text = markdown.text([recorded.recorded(two)])
    assert len(tables(text)) == 3
    headings = re.findall(r"<h3>(.*?)</h3>", rendered(text))
    assert headings == ["Phase single, 0 to 60 s", "Phase combined, 0 to 60 s", "Docked object (combined less single)"]


def test_several_results_begin_with_an_overview() -> None:
    many = [recorded.recorded(held(recorded.result()), "monday"), recorded.recorded(folder="friday")]
    text = markdown.text(many)
    assert tables(text)[0] == [
        ["result", "log", "vehicle", "converged", "as expected", "warnings"],
        ["monday", "log.parquet", "tug", "10 of 10", "✗ 1 of 2", "0"],
        ["friday", "log.parquet", "tug", "10 of 10", "–", "0"],
    ]
    assert "2 results, 1 tested against expectations, 1 of them not as expected." in items(text)


def test_results_of_one_folder_name_are_told_apart_by_the_folder_above() -> None:
    text = markdown.text([recorded.recorded(folder="monday/log"), recorded.recorded(folder="friday/log")])
    assert [row[0] for row in tables(text)[0][1:]] == ["monday/log", "friday/log"]


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_page_stays_under_200_kilobytes_and_says_how_many_were_left_out() -> None:
    one = held(recorded.result())
    many = [recorded.recorded(one, f"seed-{number:04d}") for number in range(1000)]
    text = markdown.text(many)
    said, (overview, *each) = items(text), tables(text)
    assert 150_000 < len(text.encode()) <= 200_000
    assert "1000 results, 1000 tested against expectations, 1000 of them not as expected." in said
    assert f"{1000 - len(each)} of 1000 results are left out or shortened, to keep this page under 200 kB." in said
    assert f"{1000 - (len(overview) - 1)} more of 1000 results are left out of this table." in said
    assert 0 < len(each) < len(overview) < 1000


def test_one_result_that_is_too_long_is_cut_between_its_sections() -> None:
    warnings = [{"code": "c", "message": "x" * 1500} for _ in range(1000)]
    text = markdown.text([recorded.recorded(recorded.result(warnings=warnings))])
    assert len(text.encode()) <= 200_000
    assert "1 of 1 results are left out or shortened, to keep this page under 200 kB." in items(text)
    assert len(tables(text)[0]) == 11
    assert any(entry.startswith("Products are") for entry in items(text))


HOSTILE = [
    "a|b|c",
    "a\nb\r\n| c |",
    "<script>alert(1)</script>",
    "&lt;b&gt;",
    "[click](http://evil.example)",
    "![image](http://evil.example/x.png)",
    "**bold** _it_ `code` ~~gone~~",
    "\\|",
    "# heading",
    "- item",
    "1. item",
    "1234) item",
    "0.1.0",
    "> quote",
    "---",
    "=",
    "http://evil.example",
    "\x00\x1b[31m\u202e",
    "a\\",
    "$x$ @team #12",
]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_name_is_shown_as_it_is_and_does_nothing(name: str) -> None:
    log = {"path": name, "rows": 1, "cycles": 1, "duration_s": 1.0, "cycle_s": 1.0}
    hostile = recorded.result([recorded.phase(name)], log=log, warnings=[{"code": "c", "message": name}])
    text = markdown.text([recorded.recorded(hostile), recorded.recorded(folder="b")])
    overview, first, _ = tables(text)
    assert overview[1][1] == line(name)
    assert {len(row) for row in overview} == {6}
    assert {len(row) for row in first} == {6}
    html = rendered(text)
    assert not re.search(r"<(script|a|img|b|code|em|blockquote|hr|s|ol)\b", html)
    assert f"{line(name)} (c)" in items(text)


@given(st.text())
def test_any_text_in_a_cell_reads_back_as_it_was(name: str) -> None:
    log = {"path": name, "rows": 1, "cycles": 1, "duration_s": 1.0, "cycle_s": 1.0}
    text = markdown.text([recorded.recorded(recorded.result(log=log)), recorded.recorded(folder="b")])
    assert tables(text)[0][1][1] == line(name)


def test_same_results_give_the_same_bytes() -> None:
    assert markdown.text([recorded.recorded()]) == markdown.text([recorded.recorded()])


def test_a_contradiction_comes_first_and_offers_no_motion_as_its_cure() -> None:
    found = recorded.result([recorded.contradicted("single"), recorded.phase("combined")], docked_object=recorded.docked())
    text = markdown.text([recorded.recorded(found), recorded.recorded(folder="fine")])
    (entry,) = [entry for entry in items(text) if "Contradicted in" in entry]
    assert f"Contradicted in phase single: {recorded.CAUSE}" in entry
    assert text.index("Contradicted in") < text.index("Log log.parquet")
    overview, single, *_ = tables(text)
    assert overview[1][3] == "20 of 30, ‼ 7 contradicted"
    assert overview[2][3] == "10 of 10"
    assert single[1] == ["ixx", "-830", "4.0", "kg m²", "‼ contradicted", "–"]
    assert f"ixx in phase single: contradicted: {recorded.CAUSE}; correct the cause; no motion helps" in items(text)
    assert (
        "izz in phase single: not_excited: the motion in this phase gives too little information on it; correct the contradiction of this "
        "phase first" in items(text)
    )
    for name in QUANTITIES:
        assert vocabulary.motion_for(name) not in text or name == "cg_y"
    assert "Contradicted" not in markdown.text([recorded.recorded()])


def test_the_mended_answer_has_its_own_heading_and_the_settings_to_give() -> None:
    found = recorded.result([recorded.contradicted()], mended=[recorded.mended("still odd")])
    text = markdown.text([recorded.recorded(found)])
    result, mended = tables(text)
    assert result[1][1:3] == ["-830", "4.0"]
    assert mended[0] == ["quantity", "value", "± sigma", "unit", "verdict"]
    assert mended[1] == ["ixx", "0.620", "0.010", "kg m²", "✓ converged"]
    assert text.index("### Corrected estimate") < text.index("    --set 'jets.roll_p1.force_n=[0.0, 0.0, -1.112]'\n    --set cycle")
    assert "Not the result: With jet roll_p1 turned round (jet-sign)" in items(text)
    assert any("still contradicted: still odd" in entry for entry in items(text))


def test_assumptions_have_a_table_of_what_one_step_changes_per_phase() -> None:
    phases = [recorded.phase("single"), recorded.phase("combined")]
    found = recorded.result(phases, assumptions=recorded.assumptions("single", "combined"))
    text = markdown.text([recorded.recorded(found)])
    one, _, steps, again = tables(text)
    assert one[0][2] == "± sigma (thrust taken as exact)"
    assert steps == again
    assert steps[0] == ["quantity", "unit", "thrust-scale, 1 %", "imu-position, 1 mm", "pulse-shape, 1 ms"]
    assert steps[1] == ["ixx", "kg m²", "+0.0062", "–", "0"]
    assert steps[-1] == ["the log would notice", "", "no", "hardly, 2.1 σ", "yes, 12 σ"]
    assert "Thrust rises at once [pulse-shape, a default]" in items(text)
    assert "Change of the values for one step, phase combined:" in items(text)


def test_what_a_known_mass_implies_of_the_thrust_is_said() -> None:
    scale = {"by": "known.mass", "value": 1.034, "sigma": 0.0021}
    text = markdown.text([recorded.recorded(recorded.result([recorded.phase() | {"implied_thrust_scale": scale}]))])
    assert "The known mass implies 1.0340 ± 0.0021 of the stated thrust." in items(text)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_cause_setting_or_assumption_is_shown_as_it_is(name: str) -> None:
    mended = recorded.mended(name) | {"code": name, "message": name, "settings": [name]}
    steps = [one | {"code": name, "message": name, "step": name} for one in recorded.assumptions(name)]
    text = markdown.text(
        [recorded.recorded(recorded.result([recorded.contradicted(contradiction=name)], mended=[mended], assumptions=steps))]
    )
    text.encode()
    assert [{len(row) for row in table} for table in tables(text)] == [{6}, {5}, {5}]
    assert not re.search(r"<(script|a|img|b|em|blockquote|hr|s|ol)\b", rendered(text))
    assert len(re.findall("<pre>", rendered(text))) == 1
