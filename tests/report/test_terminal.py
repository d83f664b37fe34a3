import io

import pytest
from rich.console import Console

from massprop_cli import QUANTITIES
from massprop_cli.conclude.reason import HARDLY_INFORMED
from massprop_cli.inputs.expect import Expectations, Wanted
from massprop_cli.inputs.tolerance import FOUR_SIGMA, Tolerance
from massprop_cli.inputs.tolerancefile import Gate
from massprop_cli.report import difference, digits, terminal, vocabulary
from massprop_cli.result.compare import compare
from massprop_cli.result.judge import judge
from massprop_cli.result.schema import Result
from tests import recorded


def held() -> Result:
    wanted = {"ixx": Wanted(0.5, FOUR_SIGMA), "mass": Wanted(22.5, Tolerance(5.0, "relative"))}
    return judge(recorded.result(), Expectations("expect.toml", "c" * 64, wanted, (), {}))


def printed(found: Result, width: int = 132) -> str:
    out = io.StringIO()
    terminal.show(found, Console(file=out, width=width, no_color=True, highlight=False))
    return out.getvalue()


def cells(text: str, quantity: str) -> list[str]:
    row = next(line for line in text.splitlines() if line.strip("│ ").startswith(quantity))
    return [cell.strip() for cell in row.strip("│").split("│")]


def test_expectations_stand_beside_the_values_with_a_sign() -> None:
    text = printed(held())
    assert cells(text, "ixx") == ["ixx", "0.620", "0.010", "kg m²", "converged", "12.50 s", "0.5", "4 sigma", "✗"]
    assert cells(text, "mass")[6:] == ["22.5", "5 %", "✓"]
    assert cells(text, "izz")[6:] == ["", "", ""]


def test_without_expectations_there_are_no_columns_for_them() -> None:
    assert cells(printed(recorded.result()), "mass") == ["mass", "22.00", "0.25", "kg", "converged", "12.50 s"]


@pytest.mark.parametrize(
    ("vehicle", "said", "scale"),
    [
        ({"jets": ["a", "b"]}, "commands by 2 jets", "Mass and inertia are proportional to the thrust that the vehicle file states"),
        (
            {"jets": ["a"], "wheels": ["x", "y"]},
            "commands by 1 jet and by the momentum stored in x, y",
            "Inertia and mass scale with stored momentum and thrust",
        ),
        (
            {"jets": ["a"], "wheels": ["x"], "environment": "pedestal"},
            "commands by 1 jet and by the momentum stored in x",
            "Inertia scales with stored momentum and thrust",
        ),
        ({"jets": [], "wheels": ["x"]}, "commands by the momentum stored in x", "Inertia is proportional to the stored momentum that the"),
        ({"commands": "wrench", "jets": []}, "commands by torque and force", "Mass and inertia are proportional to the thrust"),
        ({"jets": []}, "no commands", "Only gravity turns this body"),
    ],
)
def test_what_commands_a_vehicle_is_what_gives_its_inertia_the_scale(vehicle: dict[str, object], said: str, scale: str) -> None:
    found = recorded.result()
    found = found.model_copy(update={"vehicle": found.vehicle.model_copy(update=vehicle)})
    assert vocabulary.commands(found.vehicle) == said
    assert vocabulary.thrust_scale(found).startswith(scale)


@pytest.mark.parametrize("width", [20, 40, 79, 80, 100])
def test_no_number_is_cut_short_however_narrow_the_terminal(width: int) -> None:
    text = printed(held(), width)
    out = io.StringIO()
    docked = recorded.result([recorded.phase("a"), recorded.phase("b")], docked_object=recorded.docked())
    found = compare(recorded.recorded(docked), recorded.recorded(docked), Gate())
    difference.show(found, Console(file=out, width=width, no_color=True, highlight=False))
    for name in QUANTITIES:
        for number in digits.numbers(recorded.VALUES[name], recorded.SIGMAS[name]):
            assert number in text
        assert digits.numbers(recorded.VALUES[name], recorded.SIGMAS[name])[0] in out.getvalue()


def test_names_with_markup_are_shown_as_they_are() -> None:
    data = recorded.result([recorded.phase("[bold]x[/nope]")]).model_dump(by_alias=True)
    found = Result.model_validate(data | {"vehicle": data["vehicle"] | {"name": "[red]tug"}})
    text = printed(found)
    assert "phase [bold]x[/nope]" in text
    assert "[red]tug" in text


def test_each_verdict_but_converged_has_its_reason_and_what_would_cure_it() -> None:
    silent = {"value": None, "sigma": None}
    izz = silent | {"verdict": "not_excited", "reason": f"{HARDLY_INFORMED}; it needs torque about Z", "reason_code": "hardly-informed"}
    cg_y = silent | {"verdict": "unobservable", "reason": "no force across Y"}
    text = printed(recorded.result([recorded.phase("all", izz=izz, cg_y=cg_y)]))
    assert "izz not_excited: the motion in this phase gives too little information on it; it needs torque about Z\n" in text
    assert "cg_y unobservable: no force across Y; it needs force across Y (along X or Z), or fast rotation about X or Z\n" in text
    assert text.count("it needs") == 2


def test_where_a_fault_is_named_no_motion_is_said_to_cure_what_it_touches() -> None:
    text = printed(recorded.result([recorded.contradicted()]))
    assert (
        "izz not_excited: the motion in this phase gives too little information on it; correct the contradiction of this phase first\n"
        in text
    )
    assert "cg_x not_converged: it still moved more than the tolerance; correct the contradiction of this phase first\n" in text
    assert [line.split()[0] for line in text.splitlines() if "it needs" in line] == ["cg_y"], "unobservable, fault or none"
    assert text.count(recorded.CAUSE) == 1


@pytest.mark.parametrize("width", [70, 80])
def test_a_narrow_terminal_has_fewer_columns_and_says_which(width: int) -> None:
    text = printed(held(), width)
    rows = [line for line in text.splitlines() if line.startswith(("┃", "│"))]
    assert rows
    assert max(map(len, rows)) <= width
    heading = rows[0]
    for name in ("quantity", "value", "± sigma", "unit", "verdict", "met"):
        assert name in heading
    (gone,) = [line.removeprefix("not shown for want of width: ") for line in text.splitlines() if "want of width" in line]
    for name in gone.split(", "):
        assert name not in heading
    assert "want of width" not in printed(held(), 132)


def test_what_may_be_copied_has_the_minus_of_a_keyboard() -> None:
    text = printed(recorded.result([recorded.phase("all", ixy={"value": -0.04})], assumptions=recorded.assumptions()), 132)
    assert "-0.04" in text
    assert "\N{MINUS SIGN}" not in text


def coloured(found: Result) -> str:
    out = io.StringIO()
    terminal.show(found, Console(file=out, width=132, force_terminal=True, color_system="standard", highlight=False))
    return out.getvalue()


@pytest.mark.parametrize("verdict", ["contradicted", "not_excited", "unobservable"])
def test_a_value_without_a_usable_verdict_has_two_figures_and_is_dimmed(verdict: str) -> None:
    found = recorded.result([recorded.phase("all", ixx={"value": -825.1234567, "sigma": 4.0, "verdict": verdict})])
    assert cells(printed(found), "ixx")[1:3] == ["-830", "4.0"]
    assert "\x1b[2m-830\x1b[0m" in coloured(found)
    assert "\x1b[2m2.800" not in coloured(found)


def test_a_contradicted_phase_says_the_cause_in_bold_red_under_its_table() -> None:
    found = recorded.result([recorded.contradicted("single"), recorded.phase("combined")])
    assert cells(printed(found), "ixx") == ["ixx", "-830", "4.0", "kg m²", "contradicted", ""]
    before, after = printed(found).split(f"contradicted: {recorded.CAUSE}\n")
    assert "phase single" in before
    assert "phase combined" not in before
    assert "phase combined" in after
    assert f"\x1b[1;31mcontradicted: {recorded.CAUSE}\x1b[0m" in coloured(found)
    assert "contradicted" not in printed(recorded.result())


def test_the_mended_answer_stands_apart_under_what_mends_it_with_the_settings_to_give() -> None:
    bad = recorded.mended("the rates don't add up", ixx={"verdict": "contradicted", "value": -825.1, "sigma": 4.0})
    text = printed(recorded.result([recorded.contradicted()], mended=[recorded.mended(), bad]))
    result, good, still = text.split("Corrected estimate (not the result): With jet roll_p1 turned round [jet-sign]\n")
    assert cells(result, "ixx")[1] == "-830"
    assert cells(good, "ixx") == ["ixx", "0.620", "0.010", "kg m²", "converged"]
    assert "  --set 'jets.roll_p1.force_n=[0.0, 0.0, -1.112]'\n  --set cycle.command_delay_cycles=2.0\n" in good
    assert cells(still, "ixx") == ["ixx", "-830", "4.0", "kg m²", "contradicted"]
    assert "still contradicted: the rates don't add up" in still
    assert "contradicted" not in good
    assert "mended" not in printed(recorded.result())


def test_assumptions_stand_after_the_tables_with_the_change_of_each_value() -> None:
    text = printed(recorded.result([recorded.contradicted()], mended=[recorded.mended()], assumptions=recorded.assumptions()))
    result, rest = text.split("Assumptions behind the values\n")
    assert "± sigma (thrust taken as exact)" in result
    # what the vehicle file states and the log could show is left to the page
    assert "imu-position" not in rest
    assert "- 1 more that the vehicle file states are in result.json and in the report" in rest
    assert cells(rest, "ixx") == ["ixx", "+0.0062", "0", "kg m²"]
    assert cells(rest, "mass") == ["mass", "+0.22", "–", "kg"]
    assert cells(rest, "noticed?") == ["noticed?", "no", "yes, 12 σ", ""]
    assert "Assumptions" not in printed(recorded.result())
    assert "taken as exact" not in printed(recorded.result())


@pytest.mark.parametrize("width", [80, 100, 132])
def test_an_explained_heading_does_not_push_the_table_over_the_edge(width: int) -> None:
    text = printed(recorded.result(assumptions=recorded.assumptions()), width)
    table_lines = text[: text.index("mass ")].splitlines()
    assert max(map(len, table_lines)) <= width
    assert "± sigma" in text
    assert "(thrust taken as exact)" in text


def test_what_a_known_mass_implies_stands_under_the_table() -> None:
    scale = {"by": "known.mass", "value": 1.034, "sigma": 0.0021}
    text = printed(recorded.result([recorded.phase() | {"implied_thrust_scale": scale}]))
    assert "The known mass implies 1.0340 ± 0.0021 of the stated thrust.\n" in text


def test_markup_in_a_cause_a_setting_or_an_assumption_is_shown_as_it_is() -> None:
    name = "[red]x[/nope]"
    mended = recorded.mended(name) | {"code": name, "message": name, "settings": [f"a={name}"]}
    steps = [one | {"code": name, "message": name, "step": name, "stated": False} for one in recorded.assumptions(name)]
    text = printed(recorded.result([recorded.contradicted(contradiction=name)], mended=[mended], assumptions=steps))
    assert f"contradicted: {name}\n" in text
    assert f"still contradicted: {name}\n" in text
    assert f"--set 'a={name}'" in text
    assert f"- {name} [{name}, a default]" in text
    assert f"change of the values for one step, phase {name}" in text
