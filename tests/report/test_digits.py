import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from massprop_cli.report import digits

USABLE = [
    (0.6200034, 3.4e-6, "0.6200034", "0.0000034"),
    (22.004, 0.25, "22.00", "0.25"),
    (0.5, 0.0996, "0.50", "0.10"),
    (0.5, 0.0994, "0.500", "0.099"),
    (812.7, 99.6, "810", "100"),
    (812.7, 9.96, "813", "10"),
    (21734.6, 123.4, "21730", "120"),
    (-825.1234567, 4.0, "-825.1", "4.0"),
    (0.001, 300.0, "0", "300"),
    (-0.001, 0.3, "0.00", "0.30"),
    (5.1, 300.0, "10", "300"),
    (1.66e-5, 9.1e-7, "1.660e-5", "9.1e-7"),
    (3.1e-10, 2e-9, "3e-10", "2.0e-9"),
    (1e-12, 2e-9, "0", "2.0e-9"),
    (0.5, 1e-11, "0.500000000000", "0.000000000010"),
    (2.15e9, 1.2e6, "2.1500e+9", "1.2e+6"),
    (12.0, 4e8, "0", "4.0e+8"),
    (0.62, 0.0, "0.62", "0"),
    (0.0, 0.0, "0", "0"),
]


@pytest.mark.parametrize(("value", "sigma", "shown", "spread"), USABLE)
def test_two_figures_of_sigma_decide_the_digits_of_a_value(value: float, sigma: float, shown: str, spread: str) -> None:
    assert digits.numbers(value, sigma) == (shown, spread)
    assert digits.numbers(value, sigma, "not_converged") == (shown, spread)


@pytest.mark.parametrize("verdict", ["contradicted", "not_excited", "unobservable"])
@pytest.mark.parametrize(
    ("value", "sigma", "shown", "spread"),
    [
        (-825.1234567, 4.0, "-830", "4.0"),
        (0.6200034, 3.4e-6, "0.62", "0.0000034"),
        (0.996, 1e-3, "1.0", "0.0010"),
        (5.1, 300.0, "10", "300"),
        (0.00123, 0.5, "0.00", "0.50"),
        (1.66e-5, 9.1e-9, "1.7e-5", "9.1e-9"),
        (0.62345, 0.0, "0.62", "0"),
    ],
)
def test_a_value_without_a_usable_verdict_has_two_figures_at_most(
    verdict: str, value: float, sigma: float, shown: str, spread: str
) -> None:
    assert digits.numbers(value, sigma, verdict) == (shown, spread)


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.5, "0.5"), (1.66e-5, "1.66e-5"), (1e-05, "1e-5"), (2.5e12, "2.5e+12"), (-0.0, "0"), (22.0, "22"), (1 / 3, "0.333333333")],
)
def test_what_was_given_is_as_short_as_it_is_with_the_exponents_of_all_other_numbers(value: float, shown: str) -> None:
    assert digits.stated(value) == shown
    assert float(shown) == pytest.approx(value, rel=1e-9)


def test_what_is_not_known_is_a_dash() -> None:
    assert digits.numbers(None, None) == digits.numbers(1.0, None) == ("–", "–")


@pytest.mark.parametrize(
    ("value", "count", "shown"),
    [(0.0062345, 2, "0.0062"), (0.0996, 2, "0.10"), (996.0, 2, "1000"), (0.0, 2, "0"), (-2.5e-8, 2, "-2.5e-8"), (22.0, 3, "22.0")],
)
def test_significant_figures_are_counted_after_rounding(value: float, count: int, shown: str) -> None:
    assert digits.figures(value, count) == shown


@given(st.floats(-1e300, 1e300), st.floats(5e-324, 1e300))
def test_what_is_shown_is_within_half_of_the_second_figure_of_sigma(value: float, sigma: float) -> None:
    shown, spread = digits.numbers(value, sigma)
    assert float(spread) == pytest.approx(sigma, rel=0.0501, abs=5e-324)
    step = 10.0 ** math.floor(math.log10(float(spread))) / 10
    assert abs(float(shown) - value) <= 0.5001 * step + 1e-15 * abs(value)
    assert len(shown) <= 26
    rough, _ = digits.numbers(value, sigma, "contradicted")
    assert len(rough.split("e")[0].strip("-0.").replace(".", "").rstrip("0")) <= 2
