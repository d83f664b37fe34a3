"""The tolerance file (``massprop schema tolerance``): how far a result may lie from a baseline, as texts: a number reads as a value."""

from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, PlainValidator, model_validator

from massprop_cli import ABOUT_PIVOT, PIVOT, QUANTITIES
from massprop_cli.base import configfile
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import expect
from massprop_cli.inputs.section import Section
from massprop_cli.inputs.tolerance import FOUR_SIGMA, Tolerance, check_units, parse


def _text(given: object) -> Tolerance:
    if not isinstance(given, str):
        raise ValueError('a tolerance file holds texts with units; write "2 %", "4 sigma" or "0.05 kg m^2"')
    return parse(given)


Text = Annotated[Tolerance | None, PlainValidator(_text, json_schema_input_type=str)]


class InertiaLimits(Section):
    """What is allowed of an inertia, and of the ``NAMES`` beside it."""

    NAMES: ClassVar[tuple[str, ...]] = ()

    tolerance: Text = Field(None, description="of the quantities that are not named here; absent: that of what is around it")
    ixx: Text = None
    ixy: Text = None
    ixz: Text = None
    iyy: Text = None
    iyz: Text = None
    izz: Text = None

    @model_validator(mode="after")
    def _fits_units(self) -> Self:
        check_units({name: getattr(self, name) for name in self.NAMES}, self.tolerance)
        return self

    def of(self, quantity: str) -> Tolerance | None:
        """Of a quantity; None where nothing is stated."""
        own: Tolerance | None = getattr(self, quantity)
        return own or self.tolerance


class Limits(InertiaLimits):
    """What is allowed of one body's quantities."""

    NAMES = QUANTITIES

    cg_x: Text = None
    cg_y: Text = None
    cg_z: Text = None
    mass: Text = None


class AboutPivotLimits(InertiaLimits):
    """What is allowed about the pivot."""

    NAMES = ABOUT_PIVOT

    moment_x: Text = None
    moment_y: Text = None
    moment_z: Text = None


class PivotedLimits(Limits):
    """What is allowed of a body, also about the pivot of a bearing or pedestal."""

    about_pivot: AboutPivotLimits = Field(AboutPivotLimits(), description="inertia and first moment about the pivot")

    def of(self, quantity: str) -> Tolerance | None:
        """Of a quantity, those about the pivot with a prefix before their names."""
        name = quantity.removeprefix(PIVOT)
        return super().of(quantity) if name == quantity else self.about_pivot.of(name) or self.tolerance


class PhaseLimits(PivotedLimits):
    """What is allowed of one phase."""

    name: str


class ToleranceFile(Section):
    """A whole tolerance file. What it does not name is held to so many sigmas."""

    schema_: Literal["massprop/tolerance/1"] = Field("massprop/tolerance/1", alias="schema")
    all: PivotedLimits = Field(PivotedLimits(), description="in every phase")
    phases: tuple[PhaseLimits, ...] = ()
    docked: Limits = Field(Limits(), description="of the docked object")

    @model_validator(mode="after")
    def _names_each_phase_once(self) -> Self:
        configfile.check_once((phase.name for phase in self.phases), "phase", "write its tolerances in one table")
        return self


@dataclass(frozen=True)
class Gate:
    """What is allowed."""

    fallback: Tolerance = FOUR_SIGMA
    file: ToleranceFile = field(default_factory=ToleranceFile)
    source: str = ""

    def of(self, quantity: str, phase: str | None) -> Tolerance:
        """Of a quantity in a phase, or of the docked object (None)."""
        own = [limits for limits in self.file.phases if limits.name == phase]
        for limits in [self.file.docked] if phase is None else [*own, self.file.all]:
            stated = limits.of(quantity)
            if stated is not None:
                return stated
        return self.fallback

    def check(self, phases: list[str]) -> None:
        """:class:`InputError` where the file names a phase that the results lack."""
        for limits in self.file.phases:
            if limits.name not in phases:
                has = ", ".join(repr(name) for name in phases)
                raise InputError(f"{self.source}: names phase {limits.name!r}, which the results do not have; they have {has}")


def load(path: Path | None, max_sigma: float) -> Gate:
    """The gate of a tolerance file, and of so many sigmas beside it; :class:`InputError` names file, line and key."""
    fallback = Tolerance(max_sigma, "sigma")
    if path is None:
        return Gate(fallback)
    text = configfile.read_text(path, "tolerance file")
    data, lines = expect.tables(text, path)
    file = configfile.validate(ToleranceFile, data, str(path), lines)
    limits = [file.all, file.docked, *file.phases]
    pivots = [stated.about_pivot for stated in (file.all, *file.phases)]
    stated_at = [*((one, QUANTITIES) for one in limits), *((one, ABOUT_PIVOT) for one in pivots)]
    if all(getattr(one, name) is None for one, names in stated_at for name in (*names, "tolerance")):
        raise InputError(f'{path}: states no tolerance; write for instance [all] and below it mass = "2 %"')
    return Gate(fallback, file, str(path))
