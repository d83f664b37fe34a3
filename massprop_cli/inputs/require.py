"""Requirements: quantities that must converge, and their precision. Used by ``--require``, ``--want`` and keys of files.

Example: ``"mass<2%, ixx, cg_z < 0.5 mm"``. The sign is optional (``"mass 2 %"``). Per cent refer to the estimated value; a precision limits
one sigma.
"""

import re
from collections.abc import Sequence
from typing import Annotated

from pydantic import PlainValidator

from massprop_cli import ALL_UNITS, CG, MOMENT, PIVOT, QUANTITIES
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError, UsageError

ALL = "all"
_ITEM = re.compile(r"([^\s<≤]+)(?:\s*(?:<=|[<≤\s])(.*))?")
_SPACED = re.compile(r"^(cg) (?=[xyz]\b)", re.IGNORECASE)
_AMOUNT = re.compile(r"\+?((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D.*)?")
_SCALES = {
    "kg": {"kg": 1.0, "g": 1e-3},
    "m": {"m": 1.0, "mm": 1e-3},
    "kg m": {"kg m": 1.0, "g cm": 1e-5, "g mm": 1e-6},
    "kg m^2": {"kg m^2": 1.0},
}
"""Accepted units of a precision, with factors, by SI unit of the quantity."""


@dataclass(frozen=True)
class Precision:
    """Largest accepted sigma."""

    amount: float
    """Fraction of the value if relative, else in the quantity's SI unit."""
    relative: bool
    written: str

    def sigma(self, value: float) -> float:
        """Largest accepted sigma of ``value``, in the quantity's SI unit."""
        return self.amount * abs(value) if self.relative else self.amount


@dataclass(frozen=True)
class Requirement:
    """Quantity that must converge, with an optional precision."""

    quantity: str
    precision: Precision | None = None

    def __str__(self) -> str:
        return self.quantity if self.precision is None else f"{self.quantity}<{self.precision.written}"


class MisreadError(ValueError):
    """Unusable requirement: unreadable (``syntax``) or without meaning."""

    def __init__(self, message: str, syntax: bool) -> None:
        super().__init__(message)
        self.syntax = syntax


def requirements(stated: str | Sequence[str] | None, option: str = "--require") -> tuple[Requirement, ...]:
    """Requirements in the order of the quantities, from texts with commas. "all" is the ten quantities; a named quantity overrides it.

    Raises :class:`UsageError` for an unreadable text, :class:`InputError` for a precision without meaning.
    """
    try:
        return read(stated)
    except MisreadError as error:
        raise (UsageError if error.syntax else InputError)(f"{option} {error}") from None


def precise(stated: str) -> tuple[Requirement, ...]:
    """Requirements of ``--want``, each with a precision. Raises :class:`InputError` without one or about a pivot."""
    found = requirements(stated, "--want")
    pivoted = next((item.quantity for item in found if item.quantity.startswith(PIVOT)), None)
    if pivoted is not None:
        raise InputError(f"--want {pivoted}: a plan gives sigmas of only the ten quantities; name one of {', '.join(QUANTITIES)}")
    bare = next((item.quantity for item in found if item.precision is None), None)
    if bare is not None or not found:
        raise InputError(
            f'--want {bare or "nothing"}: states no precision; write for instance "{bare or "mass"} 2 %" or "{_example(bare or "mass")}"'
        )
    return found


def read(stated: object) -> tuple[Requirement, ...]:
    """Requirements as in :func:`requirements`. Raises :class:`MisreadError` with the problem."""
    texts = [] if stated is None else [*stated] if isinstance(stated, (list, tuple)) else [stated]
    if not all(isinstance(text, str) for text in texts):
        raise MisreadError(f'{stated!r}: not a requirement; write for instance "mass<2%, ixx"', True)
    found: dict[str, Precision | None] = {}
    for name, precision in [_item(item.strip()) for text in texts for item in str(text).split(",")]:
        before = found.get(name)
        if before is not None and precision is not None and before != precision:
            raise MisreadError(f"{name}<{precision.written}: {name}<{before.written} is required as well; keep one of them", True)
        found[name] = precision or before
    named = [name for name in ALL_UNITS if name in found or (name in QUANTITIES and ALL in found)]
    return tuple(Requirement(name, found.get(name) or (found.get(ALL) if name in QUANTITIES else None)) for name in named)


def _item(text: str) -> tuple[str, Precision | None]:
    """Lower-case name and precision of one quantity."""
    parts = _ITEM.fullmatch(_SPACED.sub(r"\1_", text))
    written, amount = parts.groups() if parts else (text, None)
    name = written.lower()
    name = f"{PIVOT}{name}" if name in MOMENT else name  # moments exist only about a pivot
    if name not in (*ALL_UNITS, ALL):
        problem = f"{text or 'nothing'}: no such quantity; choose from {', '.join(QUANTITIES)} or {ALL}"
        problem += f"; about a pivot {PIVOT}ixx, … or {MOMENT[0]}, …"
        # a name alone may be a typing error; a precision of an unknown quantity is a wrong requirement
        raise MisreadError(problem, syntax=amount is None or _AMOUNT.fullmatch(amount.strip()) is None)
    return name, None if amount is None else _precision(text, name, amount.strip())


def _precision(text: str, name: str, amount: str) -> Precision:
    found = _AMOUNT.fullmatch(amount)
    if found is None:
        raise MisreadError(f'{text}: {amount!r} is not a precision; write for instance "{_example(name)}" or "{name}<2%"', True)
    number, unit = float(found[1]), " ".join((found[2] or "").replace("²", "^2").replace("*", " ").replace("·", " ").split())
    scales = _SCALES[ALL_UNITS[name]] if name != ALL else {}
    if unit != "%" and unit not in scales:
        allowed = " or ".join(["%", *scales])
        problem = f"{unit!r} is not a unit of {name}" if unit else "the unit is missing"
        raise MisreadError(f'{text}: {problem}; give it in {allowed}, for instance "{_example(name)}"', False)
    if not 0 < number < 1e300:
        raise MisreadError(f"{text}: a precision must be finite and above 0", False)
    return Precision(number * (0.01 if unit == "%" else scales[unit]), unit == "%", f"{found[1]} {unit}".replace(" %", "%"))


def _example(name: str) -> str:
    amounts = {**dict.fromkeys(CG, "0.5 mm"), "mass": "200 g", ALL: "2%", **{f"{PIVOT}{moment}": "100 g mm" for moment in MOMENT}}
    return f"{name}<{amounts.get(name, '0.01 kg m^2')}"


Stated = Annotated[tuple[Requirement, ...], PlainValidator(read, json_schema_input_type=str | list[str])]
"""Requirements in a file: a text with commas, or a list of texts."""
