"""Tolerance file (``massprop schema tolerance``): limits of a result's difference from a baseline, as texts with units."""

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
    """Limits of an inertia; subclasses add the quantities in ``NAMES``."""

    NAMES: ClassVar[tuple[str, ...]] = ()

    tolerance: Text = Field(None, description="limit of quantities without one of their own; absent: that of the enclosing table")
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
        """Limit of a quantity; None if not stated."""
        own: Tolerance | None = getattr(self, quantity)
        return own or self.tolerance


class Limits(InertiaLimits):
    """Limits of one body."""

    NAMES = QUANTITIES

    cg_x: Text = None
    cg_y: Text = None
    cg_z: Text = None
    mass: Text = None


class AboutPivotLimits(InertiaLimits):
    """Limits of quantities about the pivot."""

    NAMES = ABOUT_PIVOT

    moment_x: Text = None
    moment_y: Text = None
    moment_z: Text = None


class PivotedLimits(Limits):
    """Limits of a body, also about the pivot of an air bearing or pedestal."""

    about_pivot: AboutPivotLimits = Field(AboutPivotLimits(), description="limits of inertia and first moment about the pivot")

    def of(self, quantity: str) -> Tolerance | None:
        """Limit of a quantity; names of those about the pivot have a prefix."""
        name = quantity.removeprefix(PIVOT)
        return super().of(quantity) if name == quantity else self.about_pivot.of(name) or self.tolerance


class PhaseLimits(PivotedLimits):
    """Limits of one phase."""

    name: str


class ToleranceFile(Section):
    """Tolerance file. Quantities without a limit use the default number of sigmas."""

    schema_: Literal["massprop/tolerance/1"] = Field("massprop/tolerance/1", alias="schema")
    all: PivotedLimits = Field(PivotedLimits(), description="limits in every phase")
    phases: tuple[PhaseLimits, ...] = ()
    docked: Limits = Field(Limits(), description="limits of the docked object")

    @model_validator(mode="after")
    def _names_each_phase_once(self) -> Self:
        configfile.check_once((phase.name for phase in self.phases), "phase", "write its tolerances in one table")
        return self


@dataclass(frozen=True)
class Gate:
    """Limits with their default."""

    fallback: Tolerance = FOUR_SIGMA
    file: ToleranceFile = field(default_factory=ToleranceFile)
    source: str = ""

    def of(self, quantity: str, phase: str | None) -> Tolerance:
        """Limit of a quantity in a phase; None: of the docked object."""
        own = [limits for limits in self.file.phases if limits.name == phase]
        for limits in [self.file.docked] if phase is None else [*own, self.file.all]:
            stated = limits.of(quantity)
            if stated is not None:
                return stated
        return self.fallback

    def check(self, phases: list[str]) -> None:
        """Raise :class:`InputError` if the file names a phase that the results do not have."""
        for limits in self.file.phases:
            if limits.name not in phases:
                has = ", ".join(repr(name) for name in phases)
                raise InputError(f"{self.source}: names phase {limits.name!r}, which the results do not have; they have {has}")


def load(path: Path | None, max_sigma: float) -> Gate:
    """Limits of a tolerance file, or ``max_sigma`` sigmas. Raises :class:`InputError` with file, line and key."""
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
