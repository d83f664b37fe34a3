"""Options that several commands share, and the groups that the help shows."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from massprop_cli.base.errors import InputError, UsageError

INPUT, SETTINGS, DEMANDS, OUTPUT = "Input", "Settings", "Requirements", "Output"
"""Groups of options in the help."""


def option(help_: str, panel: str, *names: str, **more: Any) -> Any:
    """Option in a group of the help; ``more`` are arguments of typer.Option."""
    return typer.Option(*names, help=help_, rich_help_panel=panel, **more)


Log = Annotated[
    Path, typer.Argument(metavar="LOG", help="Telemetry log, .parquet or .csv, or another recording with a map.", show_default=False)
]
ResultPath = Annotated[Path, typer.Argument(metavar="RESULT", help="Result folder or its result.json.", show_default=False)]
Vehicle = Annotated[Path | None, option("Vehicle file (TOML).", INPUT, metavar="FILE", envvar="MASSPROP_VEHICLE")]
RequiredVehicle = Annotated[Path, option("Vehicle file (TOML).", INPUT, metavar="FILE", envvar="MASSPROP_VEHICLE")]
MapFile = Annotated[Path | None, option("Map file (TOML) of another recording.", INPUT, "--map", metavar="FILE", envvar="MASSPROP_MAP")]
Method = Annotated[
    Literal["default", "thesis"] | None, option("Estimator: default, or the filters of the thesis.", SETTINGS, envvar="MASSPROP_METHOD")
]
Delay = Annotated[str | None, option("Command delay in cycles.", SETTINGS, metavar="CYCLES|auto", envvar="MASSPROP_DELAY")]
Assign = Annotated[list[str] | None, option("Override a dotted vehicle-file key; may be repeated.", SETTINGS, "--set", metavar="KEY=VALUE")]
Require = Annotated[
    str | None, option("Exit 4 unless these converge with this precision in every phase ('all').", DEMANDS, metavar="ixx,mass<2%,...")
]
AllowContradicted = Annotated[bool, option("Do not exit 6 if the log contradicts the vehicle file.", DEMANDS, "--allow-contradicted")]
Expect = Annotated[Path | None, option("Expected values (TOML, JSON or a truth.json); exit 5 unless met.", DEMANDS, metavar="FILE")]
Junit = Annotated[Path | None, option("Write JUnit XML to this file.", OUTPUT, metavar="FILE")]
NoColor = Annotated[bool, option("No colour (or set NO_COLOR).", OUTPUT, "--no-color")]


def out(help_: str) -> Any:
    """``--out`` option of a command that writes a folder."""
    return option(help_, OUTPUT, metavar="FOLDER", envvar="MASSPROP_OUT")


def as_json(what: str) -> Any:
    """``--json`` option."""
    return option(f"Print {what} on stdout and nothing else.", OUTPUT, "--json")


def quiet(what: str) -> Any:
    """``--quiet`` option."""
    return option(what, OUTPUT, "--quiet", "-q")


def assignments(context: typer.Context, given: Mapping[str, object], assign: Sequence[str] | None) -> list[str]:
    """``dotted.key=value`` assignments, last wins: environment, ``--set``, flags; ``given`` has None or False for absent options."""
    spelt: dict[str, Callable[[Any], str]] = {
        "method": 'estimator.method="{}"'.format,
        "refine": lambda _: "estimator.refine=true",
        "delay": lambda value: f"cycle.command_delay_cycles={_delay(value)}",
        "cross_validate": "estimator.cross_validate={}".format,
    }
    stated = {key: spelt[key](value) for key, value in given.items() if value is not None and value is not False}
    from_environment = [key for key in stated if getattr(context.get_parameter_source(key), "name", "") == "ENVIRONMENT"]
    return [*(stated.pop(key) for key in from_environment), *(assign or []), *stated.values()]


def check_sigmas(limit: float) -> None:
    """Raise :class:`UsageError` for an infinite or NaN ``--max-sigma``."""
    if not math.isfinite(limit):
        raise UsageError(f"--max-sigma {limit}: give a number of sigmas, 0 or more")


def _delay(text: str) -> str:
    """Value of ``--delay`` as TOML. Raises :class:`InputError` for anything but "auto" or a number of cycles."""
    try:
        if text != "auto" and not 0 <= float(text) < float("inf"):
            raise ValueError
    except ValueError:
        raise InputError(f"--delay {text!r}: not a delay; give a number of control cycles, 0 or more (may be fractional)") from None
    return '"auto"' if text == "auto" else repr(float(text))
