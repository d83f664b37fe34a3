"""Tolerances: a number in the quantity's unit, or a text such as ``"2 %"``, ``"4 sigma"`` or ``"0.05 kg m^2"``."""

import re
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import PlainValidator

from massprop_cli import PIVOT_UNITS, UNITS
from massprop_cli.base.configfile import at_key
from massprop_cli.base.dataclass import dataclass

_TEXT = re.compile(r"\s*\+?((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_SIGMA = ("sigma", "sigmas", "σ")
_UNITS = UNITS | PIVOT_UNITS
_REMEDY = 'write a number in the quantity\'s own unit, "2 %", "4 sigma" or "0.05 kg m^2"'


@dataclass(frozen=True)
class Tolerance:
    """Tolerance as stated."""

    amount: float
    """Number of units, per cent or sigmas."""
    kind: Literal["absolute", "relative", "sigma"]
    unit: str = ""
    """Unit of an absolute tolerance; empty for a bare number."""

    def stated(self, quantity: str) -> str:
        """Tolerance as text with its unit, which :func:`parse` reads back."""
        ending = {"absolute": self.unit or _UNITS[quantity], "relative": "%", "sigma": "sigma"}[self.kind]
        return f"{self.amount!r} {ending}".replace(".0 ", " ")

    def absolute(self, about: float, sigma: float | None) -> float | None:
        """Absolute tolerance of the value ``about``, in the quantity's unit; None for a tolerance in sigmas without a sigma."""
        if self.kind == "sigma":
            return None if sigma is None else self.amount * sigma
        return self.amount if self.kind == "absolute" else self.amount / 100 * abs(about)


def check_units(stated: Mapping[str, Tolerance | None], of_all: Tolerance | None) -> None:
    """Raise a validator's error if a quantity's tolerance has another quantity's unit, or if ``of_all`` is absolute."""
    for quantity, own in stated.items():
        unit = _UNITS[quantity]
        if own is not None and own.unit not in ("", unit):
            raise at_key(quantity, f'the tolerance "{own.amount:g} {own.unit}" is not in the unit of {quantity}; give it in {unit}')
    if of_all is not None and of_all.kind == "absolute":
        problem = 'is for quantities of several units; give "2 %" or "4 sigma" here, and absolute tolerances quantity by quantity'
        raise at_key("tolerance", problem)


FOUR_SIGMA = Tolerance(4.0, "sigma")
"""Default tolerance."""


def parse(given: object) -> Tolerance:
    """Make a tolerance from a number or a text. Raises ValueError with the valid forms."""
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        return Tolerance(_amount(given), "absolute")
    match = _TEXT.fullmatch(given) if isinstance(given, str) else None
    if match is None:
        raise ValueError(f"not a tolerance; {_REMEDY}")
    amount, ending = _amount(float(match.group(1))), " ".join(match.group(2).split())
    if ending == "%":
        return Tolerance(amount, "relative")
    if ending.lower() in _SIGMA:
        return Tolerance(amount, "sigma")
    unit = ending.replace("²", "^2").replace("*", " ").replace("·", " ")
    if unit not in _UNITS.values():
        problem = f"{ending!r} is not a unit of a mass property (kg m^2, m, kg)" if ending else "the unit is missing"
        raise ValueError(f"{problem}; {_REMEDY}")
    return Tolerance(amount, "absolute", unit)


def _amount(number: float) -> float:
    if not 0 <= number < 1e300:
        raise ValueError("a tolerance must be finite and 0 or more")
    return float(number)


Stated = Annotated[Tolerance, PlainValidator(parse, json_schema_input_type=float | str)]
"""Tolerance in a file."""
