"""Rounding of numbers for people: two significant figures of sigma determine the decimals of a value (GUM, 7.2.6).

A value without a usable verdict has at most two significant figures.
"""

import re
from decimal import Context, Decimal

from massprop_cli.result.judge import INFORMED

ABSENT = "–"
LONGEST = 7
"""Largest number of places before and after the decimal point; beyond it, a number has an exponent."""
FIGURES = 17
"""Significant figures of a double."""
_EXACT = Context(prec=1000)


def numbers(value: float | None, sigma: float | None, verdict: str = "converged") -> tuple[str, str]:
    """Value and sigma as text; with sigma 0, the value has six figures."""
    if value is None or sigma is None:
        return ABSENT, ABSENT
    usable = verdict in INFORMED
    if not sigma > 0:
        return f"{value:.6g}" if usable else figures(value), figures(sigma)
    decimals = 1 - _exponent(sigma)
    shown = min(decimals, (FIGURES if usable else 2) - 1 - _exponent(value)) if value else decimals
    small = decimals > LONGEST and (abs(value) < 1e-3 or decimals > 12)
    large = shown < 0 and max(_exponent(value), _exponent(sigma)) >= LONGEST
    return _written(value, shown, small or large), _written(sigma, decimals, small or large)


def with_sigma(value: float | None, sigma: float | None, verdict: str = "converged") -> str:
    """Value ± sigma, as :func:`numbers` writes them."""
    return " ± ".join(numbers(value, sigma, verdict))


def figures(value: float, count: int = 2) -> str:
    """The value to ``count`` significant figures."""
    exponent = _exponent(value, count)
    return _written(value, count - 1 - exponent if value else 0, powers=not -5 <= exponent < LONGEST)


def stated(value: float, count: int = 9) -> str:
    """A stated number or a time with at most ``count`` significant figures, without trailing zeros."""
    return re.sub(r"e([+-])0+", r"e\1", f"{value + 0.0:.{count}g}")


def minus(text: str) -> str:
    """The text with typographic minus signs, also in exponents; zero has no sign."""
    return text.replace("-", "−" if any(digit in text for digit in "123456789") else "")


def _exponent(value: float, count: int = 2) -> int:
    """The decimal exponent after rounding, since 0.0996 rounds to 0.10; 0 for 0."""
    return int(f"{value:.{count - 1}e}".split("e")[1])


def _written(value: float, decimals: int, powers: bool) -> str:
    """The value rounded to ``decimals``, which may be negative; ``powers``: with an exponent. Zero has no sign."""
    rounded = Decimal(repr(value)).quantize(Decimal(1).scaleb(-decimals), context=_EXACT)
    if rounded == 0:
        return "0" if powers else f"{0:.{max(decimals, 0)}f}"
    return f"{rounded:e}" if powers else f"{rounded:f}"
