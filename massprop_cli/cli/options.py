"""Options that several commands take, and the groups in which help shows them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from massprop_cli.base.errors import InputError


class Method(StrEnum):
    """Estimators."""

    default = "default"
    thesis = "thesis"


INPUT, SETTINGS, DEMANDS, OUTPUT = "What goes in", "Settings", "What must hold", "What comes out"
"""Groups of options."""

Vehicle = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False, rich_help_panel=INPUT),
]
NeededVehicle = Annotated[
    Path,
    typer.Option(metavar="FILE", help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False, rich_help_panel=INPUT),
]
MapFile = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        help="Map file (TOML) of another recording.",
        envvar="MASSPROP_MAP",
        show_default=False,
        rich_help_panel=INPUT,
    ),
]
Chosen = Annotated[
    Method | None,
    typer.Option(
        help="Estimator: default, or the thesis's own filters.", envvar="MASSPROP_METHOD", show_default=False, rich_help_panel=SETTINGS
    ),
]
Delay = Annotated[
    str | None,
    typer.Option(
        metavar="CYCLES|auto", help="Command delay in cycles.", envvar="MASSPROP_DELAY", show_default=False, rich_help_panel=SETTINGS
    ),
]
Assign = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted vehicle-file key; may be repeated.", rich_help_panel=SETTINGS),
]
Require = Annotated[
    str | None,
    typer.Option(
        metavar="ixx,mass<2%,...",
        help="Exit 4 unless these converge in every phase ('all'), and that precisely.",
        rich_help_panel=DEMANDS,
    ),
]
AllowContradicted = Annotated[
    bool,
    typer.Option("--allow-contradicted", help="Do not exit 6 where log and vehicle file contradict each other.", rich_help_panel=DEMANDS),
]
Expect = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Expected values (TOML, JSON or a truth.json); exit 5 unless met.",
        show_default=False,
        rich_help_panel=DEMANDS,
    ),
]
Junit = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write JUnit XML to this file.", show_default=False, rich_help_panel=OUTPUT)
]
NoColor = Annotated[bool, typer.Option("--no-color", help="No colour (NO_COLOR works too).", rich_help_panel=OUTPUT)]


def out(help_: str) -> Any:
    """``--out`` of a command that writes a folder."""
    return typer.Option(metavar="FOLDER", help=help_, envvar="MASSPROP_OUT", show_default=False, rich_help_panel=OUTPUT)


def as_json(what: str) -> Any:
    """``--json``."""
    return typer.Option("--json", help=f"Print {what} on stdout and nothing else.", rich_help_panel=OUTPUT)


def quiet(what: str) -> Any:
    """``--quiet``."""
    return typer.Option("--quiet", "-q", help=what, rich_help_panel=OUTPUT)


def assignments(context: typer.Context, given: Mapping[str, object], assign: Sequence[str] | None) -> list[str]:
    """``dotted.key=value`` in the order in which they count: environment, ``--set``, flags.

    ``given`` holds the values of the options method, refine and delay, None or False where not given.
    """
    spelt: dict[str, Callable[[Any], str]] = {
        "method": lambda value: f'estimator.method="{value.value}"',
        "refine": lambda _: "estimator.refine=true",
        "delay": lambda value: f"cycle.command_delay_cycles={_delay(value)}",
    }
    stated = {key: spelt[key](value) for key, value in given.items() if value is not None and value is not False}
    from_environment = [key for key in stated if getattr(context.get_parameter_source(key), "name", "") == "ENVIRONMENT"]
    return [*(stated.pop(key) for key in from_environment), *(assign or []), *stated.values()]


def _delay(text: str) -> str:
    """The option's value as TOML; :class:`InputError` unless it is a delay."""
    try:
        if text != "auto" and not 0 <= float(text) < float("inf"):
            raise ValueError
    except ValueError:
        raise InputError(f"--delay {text!r}: not a delay; give a number of control cycles, 0 or more (may be fractional)") from None
    return '"auto"' if text == "auto" else repr(float(text))
