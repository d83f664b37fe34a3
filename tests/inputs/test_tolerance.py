import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from massprop_cli import QUANTITIES
from massprop_cli.inputs.tolerance import Tolerance, check_units, parse


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (0.05, Tolerance(0.05, "absolute")),
        (0, Tolerance(0.0, "absolute")),
        ("2 %", Tolerance(2.0, "relative")),
        ("2%", Tolerance(2.0, "relative")),
        (" .5  % ", Tolerance(0.5, "relative")),
        ("4 sigma", Tolerance(4.0, "sigma")),
        ("1e1 Sigmas", Tolerance(10.0, "sigma")),
        ("3σ", Tolerance(3.0, "sigma")),
        ("0.05 kg m^2", Tolerance(0.05, "absolute", "kg m^2")),
        ("0.05 kg·m²", Tolerance(0.05, "absolute", "kg m^2")),
        ("5e-2 kg*m^2", Tolerance(0.05, "absolute", "kg m^2")),
        ("1 m", Tolerance(1.0, "absolute", "m")),
        ("+0.1 kg", Tolerance(0.1, "absolute", "kg")),
    ],
)
def test_a_tolerance_is_read(given: object, expected: Tolerance) -> None:
    assert parse(given) == expected


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (-1, "0 or more"),
        (float("nan"), "0 or more"),
        (float("inf"), "finite"),
        ("1e999 kg", "finite"),
        (10**400, "finite"),
        (True, "not a tolerance"),
        (None, "not a tolerance"),
        ([1], "not a tolerance"),
        ("", "not a tolerance"),
        ("-2 %", "not a tolerance"),
        ("two %", "not a tolerance"),
        ("1,5 %", "',5 %' is not a unit"),
        ("0.05", "the unit is missing"),
        ("5 mm", "'mm' is not a unit"),
        ("2 % %", "'% %' is not a unit"),
        ("4 sigma\nmass", "'sigma mass' is not a unit"),
    ],
)
def test_a_tolerance_is_refused_with_what_to_write(given: object, says: str) -> None:
    with pytest.raises(ValueError, match=r"finite|write a number in the quantity's own unit") as refusal:
        parse(given)
    assert says in str(refusal.value)


amounts = st.floats(min_value=0, max_value=1e299)


@given(amounts, st.sampled_from(["absolute", "relative", "sigma"]), st.sampled_from(QUANTITIES))
def test_what_is_stated_reads_back_as_the_same_tolerance(amount: float, kind: str, quantity: str) -> None:
    stated = Tolerance(amount, kind).stated(quantity)  # type: ignore[arg-type]
    again = parse(stated)
    assert (again.amount, again.kind) == (amount, kind)
    assert again.stated(quantity) == stated
    check_units({quantity: again}, None)


@given(st.text(max_size=20))
def test_any_text_is_a_tolerance_or_a_value_error_and_nothing_else(text: str) -> None:
    with contextlib.suppress(ValueError):
        assert parse(text).amount >= 0


def test_a_tolerance_is_absolute_about_a_value() -> None:
    assert Tolerance(0.1, "absolute").absolute(22.0, None) == 0.1
    assert Tolerance(2.0, "relative").absolute(-22.0, None) == pytest.approx(0.44)
    assert Tolerance(4.0, "sigma").absolute(22.0, 0.25) == 1.0
    assert Tolerance(4.0, "sigma").absolute(22.0, 0.0) == 0.0
    assert Tolerance(4.0, "sigma").absolute(22.0, None) is None


def test_a_unit_of_another_quantity_does_not_fit() -> None:
    check_units({"cg_x": parse("1 m")}, None)
    with pytest.raises(ValueError, match=r"give it in kg m\^2"):
        check_units({"ixx": parse("1 m")}, None)
