"""Expect file (``massprop schema expect``; TOML, JSON or truth.json): expected values and tolerances. It does not change an estimate."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, FiniteFloat, JsonValue, model_validator

from massprop_cli import ABOUT_PIVOT, MOMENT, PIVOT, QUANTITIES
from massprop_cli.base import configfile
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.require import Requirement
from massprop_cli.inputs.require import Stated as Required
from massprop_cli.inputs.section import Section
from massprop_cli.inputs.tolerance import FOUR_SIGMA, Stated, Tolerance, check_units
from massprop_cli.inputs.vehicle import PRODUCTS

Convention = Literal["tensor", "positive_integral"]
SCHEMA, TRUTH = "massprop/expect/1", "massprop/truth/1"
_TRUTH_KEYS = ("env", "bound")
"""Keys by which a truth.json without a schema is recognised."""


class Quantity(Section):
    """Expected value; a bare number is a value without a tolerance of its own."""

    value: FiniteFloat = Field(description="expected value in the quantity's unit")
    tolerance: Stated | None = Field(None, description='a number in the quantity\'s unit, "2 %", "4 sigma" or "0.05 kg m^2"')


def _numbers_too(schema: dict[str, Any]) -> None:
    for name in {*QUANTITIES, *MOMENT} & schema["properties"].keys():
        schema["properties"][name]["anyOf"].insert(0, {"type": "number"})


class ExpectedInertia(Section, json_schema_extra=_numbers_too):
    """Expected inertia; subclasses add the quantities in ``NAMES``."""

    NAMES: ClassVar[tuple[str, ...]] = ()

    tolerance: Stated | None = Field(
        None, description="tolerance of quantities without one of their own; absent: that of the enclosing table"
    )
    ixx: Quantity | None = None
    ixy: Quantity | None = None
    ixz: Quantity | None = None
    iyy: Quantity | None = None
    iyz: Quantity | None = None
    izz: Quantity | None = None

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Quantities with an expected value."""
        return {name: getattr(self, name) for name in self.NAMES if getattr(self, name) is not None}

    @model_validator(mode="after")
    def _fits_units(self) -> Self:
        check_units({name: quantity.tolerance for name, quantity in self.quantities.items()}, self.tolerance)
        return self


class ExpectedBody(ExpectedInertia):
    """Expected values of one body: any of the ten quantities."""

    NAMES = QUANTITIES

    poi_convention: Convention | None = Field(None, description="sign convention of these products of inertia; absent: that of the file")
    cg_x: Quantity | None = None
    cg_y: Quantity | None = None
    cg_z: Quantity | None = None
    mass: Quantity | None = None


class ExpectedPivot(ExpectedInertia):
    """Expected values about the pivot: any of the nine quantities of ``about_pivot``."""

    NAMES = ABOUT_PIVOT

    moment_x: Quantity | None = None
    moment_y: Quantity | None = None
    moment_z: Quantity | None = None


class PivotedBody(ExpectedBody):
    """Expected values of a body, also about the pivot of an air bearing or pedestal."""

    about_pivot: ExpectedPivot | None = Field(None, description="inertia [kg m^2] and first moment [kg m] about the pivot")


class PhaseBody(PivotedBody):
    """Expected values of one phase."""

    name: str


class ExpectFile(Section):
    """Expect file. Values of a phase override those of ``all``."""

    schema_: Literal["massprop/expect/1"] = Field("massprop/expect/1", alias="schema")
    poi_convention: Convention | None = Field(
        None,
        description=(
            'sign of products of inertia: "tensor": ixy = -sum m x y; "positive_integral": the opposite. Required for an '
            "expected product other than 0"
        ),
    )
    tolerance: Stated | None = Field(
        None, description='tolerance of quantities without one of their own: "2 %" or "4 sigma"; default: 4 sigma'
    )
    require: Required | None = Field(
        None, description='quantities that must converge in every phase, with precision: "mass<2%, ixx", or a list'
    )
    all: PivotedBody = Field(PivotedBody(), description="expected values in every phase")
    phases: tuple[PhaseBody, ...] = ()
    docked: ExpectedBody = Field(ExpectedBody(), description="expected values of the docked object")

    @model_validator(mode="after")
    def _is_coherent(self) -> Self:
        configfile.check_once((phase.name for phase in self.phases), "phase", "write its expectations in one table")
        check_units({}, self.tolerance)
        return self


class TruthPhase(PivotedBody):
    """True values of one phase; phases without names are in the result's order."""

    name: str | None = None


class TruthFile(Section):
    """truth.json: the ten quantities with their true values and the simulated case."""

    schema_: Literal["massprop/truth/1"] = Field("massprop/truth/1", alias="schema")
    scenario: JsonValue = None
    seed: JsonValue = None
    env: JsonValue = None
    delay_cycles: JsonValue = None
    bound: JsonValue = None
    docked_bound: JsonValue = None
    poi_convention: Convention | None = None
    phases: tuple[TruthPhase, ...]
    docked: ExpectedBody = ExpectedBody.unset()


@dataclass(frozen=True)
class Wanted:
    """Expected value, with products as tensor elements, and its tolerance."""

    value: float
    tolerance: Tolerance


@dataclass(frozen=True)
class Expectations:
    """All expectations of a result."""

    source: str
    """File name for messages."""
    sha256: str
    every: dict[str, Wanted]
    """Expectations of every phase."""
    phases: tuple[tuple[str | None, dict[str, Wanted]], ...]
    """Expectations by phase name; without names, in the order of the result's phases."""
    docked: dict[str, Wanted]
    required: tuple[Requirement, ...] = ()
    """Quantities that must converge in every phase, with precision."""
    of_truth: bool = False
    """Whether it is a truth.json, which has all ten quantities; those that do not affect the motion are then not required."""


def load(path: Path) -> Expectations:
    """Read an expect file. Raises :class:`InputError` with file, line and key."""
    return parse(configfile.read_text(path, "expect file"), path)


def parse(text: str, path: Path) -> Expectations:
    """Parse an expect file; ``path`` gives its format and is for messages."""
    data, lines = tables(text, path)
    truth = data.get("schema") == TRUTH or ("schema" not in data and any(key in data for key in _TRUTH_KEYS))
    model: type[ExpectFile | TruthFile] = TruthFile if truth else ExpectFile
    file = configfile.validate(model, _with_value_tables(data), str(path), lines)
    every = file.all if isinstance(file, ExpectFile) else PivotedBody()
    default = (file.tolerance if isinstance(file, ExpectFile) else None) or FOUR_SIGMA

    def wanted(body: ExpectedBody, place: str) -> dict[str, Wanted]:
        convention, stated = body.poi_convention or file.poi_convention, body.tolerance or default
        about = body.about_pivot if isinstance(body, PivotedBody) else None
        each = [(name, name, quantity, stated) for name, quantity in body.quantities.items()]
        each += [(f"{PIVOT}{name}", name, one, about.tolerance or stated) for name, one in about.quantities.items()] if about else []
        return {key: _wanted(name, one, convention, one.tolerance or of_all, f"{path}: {place}.{key}") for key, name, one, of_all in each}

    bodies: tuple[PhaseBody | TruthPhase, ...] = file.phases
    phases = tuple((phase.name, wanted(phase, f"phases.{number}")) for number, phase in enumerate(bodies))
    digest, required = hashlib.sha256(text.encode()).hexdigest(), (file.require or ()) if isinstance(file, ExpectFile) else ()
    found = Expectations(str(path), digest, wanted(every, "all"), phases, wanted(file.docked, "docked"), required, truth)
    if not (found.required or found.every or found.docked or any(expected for _, expected in phases)):
        raise InputError(f'{path}: has no expectation; write for instance [all] and below it mass = {{ value = 22.0, tolerance = "2 %" }}')
    return found


def tables(text: str, path: Path) -> tuple[dict[str, Any], str]:
    """Parsed TOML or JSON, and its text for line numbers (empty for JSON). Raises :class:`InputError` if unreadable or misplaced."""
    as_json = path.suffix.lower() == ".json"
    data = _from_json(text, str(path)) if as_json else configfile.parse_toml(text, str(path))
    loose = next((key for key in data if key in QUANTITIES), None)
    if loose is not None:
        raise InputError(f"{path}: {loose} is outside any table; write it under [all], [[phases]] or [docked]")
    if isinstance(data.get("phases"), dict) and data["phases"]:
        first = next(iter(data["phases"]))
        raise InputError(f'{path}: phases.{first}: phases are a list; write [[phases]] and below it name = "{first}"')
    return data, "" if as_json else text


def _from_json(text: str, source: str) -> dict[str, Any]:
    """Parsed JSON table. Raises :class:`InputError` for invalid JSON or a repeated key."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            twice = configfile.repeated(name for name, _ in pairs)
            raise InputError(f"{source}: key {twice!r} is twice in one table; keep one")
        return found

    try:
        data = json.loads(text, object_pairs_hook=once)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: not valid JSON: {error}") from None
    if not isinstance(data, dict):
        raise InputError(f"{source}: holds a {type(data).__name__}, not a table of expectations; see massprop schema expect")
    return data


def _with_value_tables(data: Mapping[str, Any]) -> dict[str, Any]:
    """Data with each bare value of a quantity as a table."""

    def body(given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        found = {key: {"value": v} if key in (*QUANTITIES, *MOMENT) and not isinstance(v, dict) else v for key, v in given.items()}
        return found | ({"about_pivot": body(given["about_pivot"])} if "about_pivot" in given else {})

    phases = data.get("phases")
    found = {key: body(value) if key in ("all", "docked") else value for key, value in data.items()}
    return found | ({"phases": [body(phase) for phase in phases]} if isinstance(phases, list) else {})


def _wanted(name: str, quantity: Quantity, convention: str | None, tolerance: Tolerance, place: str) -> Wanted:
    value = quantity.value
    if name in PRODUCTS and convention is None and value != 0:
        raise InputError(
            f"{place} = {value:g}: the sign convention of products is not stated; "
            'add poi_convention = "tensor" (ixy = -sum m x y) or "positive_integral" at the top of the file'
        )
    if tolerance.kind == "relative" and value == 0 and tolerance.amount > 0:
        raise InputError(
            f'{place} = 0: {tolerance.stated(name)} of 0 is nothing; give it an absolute tolerance or one in sigmas ("4 sigma")'
        )
    flip = name in PRODUCTS and convention == "positive_integral" and value != 0
    return Wanted(-value if flip else value, tolerance)
