"""Commands and exit codes. Heavy rooms are imported inside the commands, so that ``--help`` stays fast."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from massprop_cli import QUANTITIES, __version__
from massprop_cli.errors import InputError, UsageError

if TYPE_CHECKING:
    from massprop_cli.analysis import Analysis

EXIT_BUG, EXIT_USAGE, EXIT_INPUT, EXIT_NOT_CONVERGED = 1, 2, 3, 4

app = typer.Typer(
    name="massprop",
    help="Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Method(StrEnum):
    """Estimators."""

    default = "default"
    thesis = "thesis"


class SchemaName(StrEnum):
    """Files with a schema."""

    log = "log"
    vehicle = "vehicle"
    scenario = "scenario"
    result = "result"


def _guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Errors become one line on stderr and the contract's exit code."""

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except InputError as error:
            _fail(str(error), EXIT_INPUT)
        except UsageError as error:
            _fail(str(error), EXIT_USAGE)
        except (typer.Exit, typer.Abort):
            raise
        except OSError as error:
            _fail(f"the output cannot be written ({error.strerror or error}); is the disk full or the pipe closed?", EXIT_INPUT)
        except Exception as error:
            if os.environ.get("MASSPROP_DEBUG"):
                raise
            _fail(f"internal error (a bug in massprop): {type(error).__name__}: {error}. MASSPROP_DEBUG=1 shows where", EXIT_BUG)

    return run


def _fail(message: str, code: int) -> None:
    typer.echo(f"massprop: {' '.join(message.split())}", err=True)
    raise typer.Exit(code)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"massprop {__version__}")
        raise typer.Exit


@app.callback()
def _main(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False) -> None:
    """Mass properties of a vehicle, with honest sigmas, from recorded commands and IMU data."""


@app.command()
@_guarded
def estimate(
    context: typer.Context,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Telemetry log, .parquet or .csv.", show_default=False)],
    vehicle: Annotated[Path | None, typer.Option(help="Vehicle file (TOML).", envvar="MASSPROP_VEHICLE", show_default=False)] = None,
    out: Annotated[
        Path | None, typer.Option(help="Result folder (default: massprop-out/LOGSTEM).", envvar="MASSPROP_OUT", show_default=False)
    ] = None,
    method: Annotated[Method | None, typer.Option(help="Estimator.", envvar="MASSPROP_METHOD", show_default=False)] = None,
    delay: Annotated[str | None, typer.Option(help="Command delay in cycles.", envvar="MASSPROP_DELAY", show_default=False)] = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Report the off-line maximum-likelihood fit instead of the last causal row.")
    ] = False,
    assign: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted vehicle-file key.")] = None,
    require: Annotated[
        str | None, typer.Option(metavar="ixx,mass,...", help="Exit 4 unless these converge in every phase ('all').")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json on stdout and nothing else.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No table, no warnings.")] = False,
    no_color: Annotated[bool, typer.Option("--no-color", help="No colour (NO_COLOR works too).")] = False,
) -> None:
    """Replay the estimator through a log: ten mass properties with sigmas and verdicts.

    Writes result.json, history.parquet and run.json into the result folder. Exit 0 done, 3 unusable input, 4 a required quantity is
    not converged.
    """
    required = _required(require)
    import numpy as np

    from massprop_cli import analysis, store
    from massprop_cli.report import result

    if out is not None and not str(out).strip(". "):
        raise UsageError(f"--out {str(out)!r}: name a folder of its own")
    options = {
        "method": [f'estimator.method="{method.value}"'] if method else [],
        "refine": ["estimator.refine=true"] if refine else [],
        "delay": [f"cycle.command_delay_cycles={_delay(delay)}"] if delay is not None else [],
    }
    from_environment = [key for key in options if getattr(context.get_parameter_source(key), "name", "") == "ENVIRONMENT"]
    assignments = [value for key in from_environment for value in options.pop(key)]
    assignments += [*(assign or []), *(value for values in options.values() for value in values)]
    # what overflows or divides by zero ends as "nothing can be said", not as noise on stderr
    with _progress(quiet or as_json) as progress, np.errstate(all="ignore"):
        found = analysis.analyse(log, vehicle, assignments, progress)
    text = result.to_json(result.result(found))
    store.write(out or Path("massprop-out") / log.stem, found, text)
    if not quiet:
        for notice in found.notices:
            typer.echo(f"massprop: warning: {notice.message} [{notice.code}]", err=True)
    if as_json:
        sys.stdout.write(text)
    elif not quiet:
        _show(found, no_color)
    _check_required(found, required)


@contextmanager
def _progress(silent: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A bar on stderr while the block runs, on a terminal only; it goes away when done."""
    if silent or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


def _show(found: Analysis, no_color: bool) -> None:
    from rich.console import Console

    from massprop_cli.report import table

    terminal = sys.stdout.isatty()
    table.show(found, Console(no_color=no_color or None, width=None if terminal else 132, highlight=False))


def _delay(text: str) -> str:
    """The option's value as TOML; :class:`InputError` unless it is a delay."""
    try:
        if text != "auto" and not 0 <= float(text) < float("inf"):
            raise ValueError
    except ValueError:
        raise InputError(f"--delay {text!r}: not a delay; give a number of control cycles, 0 or more (may be fractional)") from None
    return '"auto"' if text == "auto" else repr(float(text))


def _required(text: str | None) -> list[str]:
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    names = list(QUANTITIES) if names == ["all"] else names
    for name in names:
        if name not in QUANTITIES:
            raise UsageError(f"--require {name}: no such quantity; choose from {', '.join(QUANTITIES)} or all")
    return names


def _check_required(found: Analysis, required: list[str]) -> None:
    missed = [
        f"{name} in phase {conclusion.phase.name} is {conclusion.estimates[name].verdict} ({conclusion.estimates[name].reason})"
        for conclusion in found.conclusions
        for name in required
        if conclusion.estimates[name].verdict != "converged"
    ]
    if missed:
        _fail(f"required but not converged: {'; '.join(missed)}", EXIT_NOT_CONVERGED)


@app.command()
@_guarded
def simulate(
    scenario: Annotated[
        str | None, typer.Argument(metavar="SCENARIO", help="Scenario file (TOML) or a packaged scenario.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder (default: massprop-out/NAME-seed-N, or massprop-out/NAME).", envvar="MASSPROP_OUT", show_default=False),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed (default: the scenario's own).", show_default=False)] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="Fly this many seeds, from --seed on: a campaign folder.", show_default=False)
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write log.csv instead of log.parquet.")] = False,
    assign: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a dotted scenario-file key.")] = None,
    list_: Annotated[bool, typer.Option("--list", help="Name the packaged scenarios.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing.")] = False,
) -> None:
    """Fly a scenario on the testbed in software: a log with known truth.

    Writes log.parquet (the vehicle embedded), vehicle.toml and truth.json; with --seeds a folder of such folders. Same seed, same bytes.
    """
    import numpy as np

    from massprop_cli.testbed import output
    from massprop_cli.testbed import scenario as scenarios

    if list_:
        for name in scenarios.packaged():
            typer.echo(f"{name:14s}{scenarios.load(name).scenario.description}")
        return
    if scenario is None:
        raise UsageError("name a scenario file or a packaged scenario; massprop simulate --list names those")
    if out is not None and not str(out).strip(". "):
        raise UsageError(f"--out {str(out)!r}: name a folder of its own")
    source = scenarios.load(scenario, assign or [])
    first = source.scenario.seed if seed is None else seed
    with np.errstate(all="ignore"):
        notices = output.warnings(source)
    for warning in [] if quiet else notices:
        typer.echo(f"massprop: warning: {warning.message} [{warning.code}]", err=True)
    name = source.scenario.name
    folder = out or Path("massprop-out") / (f"{name}-seed-{first}" if seeds is None else name)
    with _progress(quiet) as progress, np.errstate(all="ignore"):
        written = output.simulate(source, folder, first, seeds, "csv" if csv else "parquet", progress)
    if not quiet:
        typer.echo(f"massprop: {written} written to {folder}", err=True)


@app.command()
@_guarded
def schema(name: Annotated[SchemaName, typer.Argument(help="Which file.")]) -> None:
    """Print the JSON Schema of a file."""
    from massprop_cli import schemas

    typer.echo(json.dumps(schemas.schema(name.value), indent=1, ensure_ascii=False))


def main() -> None:
    """Entry point."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks ² or ± still gets its table
    app()
