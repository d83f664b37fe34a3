"""How far a value may lie from another: a number in its unit, or a text ``"2 %"``, ``"4 sigma"`` or ``"0.05 kg m^2"``."""

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
    """A tolerance as it was stated."""

    amount: float
    """In units, in per cent, or in sigmas."""
    kind: Literal["absolute", "relative", "sigma"]
    unit: str = ""
    """Of an absolute tolerance; empty where a bare number was given."""

    def stated(self, quantity: str) -> str:
        """In words, with its unit: what :func:`parse` reads back."""
        ending = {"absolute": self.unit or _UNITS[quantity], "relative": "%", "sigma": "sigma"}[self.kind]
        return f"{self.amount!r} {ending}".replace(".0 ", " ")

    def absolute(self, about: float, sigma: float | None) -> float | None:
        """In the quantity's unit, about a value; None where it is in sigmas and there is no sigma."""
        if self.kind == "sigma":
            return None if sigma is None else self.amount * sigma
        return self.amount if self.kind == "absolute" else self.amount / 100 * abs(about)

    def misfit(self, quantity: str) -> str:
        """Why this can't be a tolerance of ``quantity``, or an empty text."""
        unit = _UNITS[quantity]
        if self.unit in ("", unit):
            return ""
        return f'the tolerance "{self.amount:g} {self.unit}" is not in the unit of {quantity}; give it in {unit}'


def check_units(stated: Mapping[str, Tolerance | None], of_all: Tolerance | None) -> None:
    """A validator's error where the tolerance of a quantity is in the unit of another, or that of all quantities in any."""
    for quantity, own in stated.items():
        problem = own.misfit(quantity) if own is not None else ""
        if problem:
            raise at_key(quantity, problem)
    if of_all is not None and of_all.kind == "absolute":
        said = 'is for quantities of several units; give "2 %" or "4 sigma" here, and absolute tolerances quantity by quantity'
        raise at_key("tolerance", said)


FOUR_SIGMA = Tolerance(4.0, "sigma")
"""Where nothing else is stated."""


def parse(given: object) -> Tolerance:
    """A tolerance from a number or a text; ValueError says how to write one."""
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        return Tolerance(_amount(given), "absolute")
    found = _TEXT.fullmatch(given) if isinstance(given, str) else None
    if found is None:
        raise ValueError(f"not a tolerance; {_REMEDY}")
    amount, ending = _amount(float(found.group(1))), " ".join(found.group(2).split())
    if ending == "%":
        return Tolerance(amount, "relative")
    if ending.lower() in _SIGMA:
        return Tolerance(amount, "sigma")
    unit = ending.replace("²", "^2").replace("*", " ").replace("·", " ")
    if unit not in _UNITS.values():
        said = f"{ending!r} is not a unit of a mass property (kg m^2, m, kg)" if ending else "the unit is missing"
        raise ValueError(f"{said}; {_REMEDY}")
    return Tolerance(amount, "absolute", unit)


def _amount(number: float) -> float:
    if not 0 <= number < 1e300:
        raise ValueError("a tolerance must be finite and 0 or more")
    return float(number)


Stated = Annotated[Tolerance, PlainValidator(parse, json_schema_input_type=float | str)]
"""A tolerance in a file."""
