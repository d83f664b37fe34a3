from __future__ import annotations

import pytest

from massprop_cli import QUANTITIES
from massprop_cli.report import assumptions, vocabulary
from massprop_cli.result.schema import Result
from tests import recorded

KNOWN = {"known": {"mass": (22.0, 0.01)}}


def result(scale_sigma: float = 0.0, phases: list[dict[str, object]] | None = None, **changes: object) -> Result:
    found = recorded.result(phases, **({"assumptions": recorded.assumptions()} | changes))
    return found.model_copy(update={"vehicle": found.vehicle.model_copy(update={"thrust_scale_sigma": scale_sigma})})


def test_every_value_has_its_change_for_one_step_in_two_figures_and_whether_the_log_would_notice() -> None:
    (found,) = assumptions.sensitivities(result().assumptions)
    assert found.phase == "all"
    assert found.steps == (("thrust-scale", "1 %"), ("imu-position", "1 mm"), ("pulse-shape", "1 ms"))
    rows = {name: (unit, changes) for name, unit, changes in found.rows}
    assert list(rows) == list(QUANTITIES)
    assert rows["ixx"] == ("kg m²", ("+0.0062", "–", "0"))
    assert rows["ixz"] == ("kg m²", ("-0.00070", "–", "–"))
    assert rows["cg_x"] == ("m", ("–", "-0.0010", "–"))
    assert rows["mass"] == ("kg", ("+0.22", "+120", "–"))
    assert found.noticed == ("no", "hardly, 2.1 σ", "yes, 12 σ")


def test_each_phase_has_its_own_and_an_assumption_without_effects_has_words_alone() -> None:
    silent = {"code": "rigid", "message": "The body is rigid", "step": "1 %", "stated": False, "effects": []}
    found = result(assumptions=[*recorded.assumptions("single", "combined"), silent])
    assert [one.phase for one in assumptions.sensitivities(found.assumptions)] == ["single", "combined"]
    assert all("rigid" not in dict(one.steps) for one in assumptions.sensitivities(found.assumptions))
    assert assumptions.sentence(found.assumptions[-1]) == "The body is rigid [rigid, a default]"
    assert assumptions.sentence(found.assumptions[0]).endswith("[thrust-scale, stated by the vehicle file]")
    assert assumptions.sensitivities(recorded.result().assumptions) == []


@pytest.mark.parametrize(
    ("found", "heading"),
    [
        (result(), assumptions.EXACT_THRUST),
        (result(0.02), assumptions.SIGMA),
        (result(phases=[recorded.phase() | KNOWN]), assumptions.EXACT_THRUST),
        (result(0.02, phases=[recorded.phase() | KNOWN]), assumptions.SIGMA),
        (result(assumptions=[]), assumptions.SIGMA),
        (result(assumptions=recorded.assumptions()[1:]), assumptions.SIGMA),
        (result(assumptions=[recorded.assumptions()[0] | {"effects": []}]), assumptions.SIGMA),
    ],
)
def test_sigmas_are_said_to_take_the_thrust_as_exact_where_nothing_calibrates_it(found: Result, heading: str) -> None:
    assert assumptions.sigma_heading(found) == heading
    assert assumptions.EXACT_THRUST == "± sigma (thrust taken as exact)"


def test_a_known_mass_calibrates_thrust_whose_uncertainty_is_stated_and_no_other_and_the_phase_that_it_is_known_in() -> None:
    """Where thrust.scale_sigma is 0 the estimator takes the thrust as exact whatever is known: inertia doesn't follow the mass."""
    one, two = recorded.phase("single") | KNOWN, recorded.phase("combined")
    assert "calibrated" not in vocabulary.thrust_scale(result(phases=[one]))
    assert "no thrust.scale_sigma is stated" in vocabulary.thrust_scale(result(phases=[one]))
    assert vocabulary.thrust_scale(result(0.02, phases=[one])).endswith("Here these known values calibrate it: mass.")
    half = vocabulary.thrust_scale(result(0.02, phases=[one, two]))
    assert half.endswith(
        "Every sigma of mass and inertia includes its stated uncertainty, 2 %; in phase single these known values calibrate it: mass."
    )
    assert vocabulary.thrust_scale(result(0.02, phases=[two])).endswith(
        "Every sigma of mass and inertia includes its stated uncertainty, 2 %."
    )
    turned = recorded.phase() | {"known": {"cg_x": (0.0, 0.001)}}
    assert "calibrated" not in vocabulary.thrust_scale(result(0.02, phases=[turned]))


def test_what_a_known_mass_says_of_the_thrust_is_a_sentence() -> None:
    scale = {"by": "known.mass", "value": 1.03412, "sigma": 0.0021}
    (phase,) = result(phases=[recorded.phase() | {"implied_thrust_scale": scale}]).phases
    assert assumptions.implied_thrust(phase) == "the known mass implies 1.0341 ± 0.0021 of the stated thrust"
    (expected,) = result(phases=[recorded.phase() | {"implied_thrust_scale": scale | {"by": "expected mass"}}]).phases
    assert assumptions.implied_thrust(expected).startswith("the expected mass implies")
    (wheeled,) = result(phases=[recorded.phase() | {"implied_thrust_scale": scale | {"of": "momentum of wheels"}}]).phases
    assert assumptions.implied_thrust(wheeled).endswith("of the stated momentum of wheels")
    assert assumptions.implied_thrust(result().phases[0]) == ""
