"""``massprop report``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from massprop_cli.base import exits
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.cli import options
from massprop_cli.cli.guard import fail, folder_of_its_own, guarded
from massprop_cli.cli.terminal import put
from massprop_cli.result.rendered import TEXTS

if TYPE_CHECKING:
    from massprop_cli.inputs.expect import Expectations
    from massprop_cli.result.read import Recorded

FIGURES: tuple[Literal["svg", "png"], ...] = ("svg", "png")
"""File formats of figures."""
NAMED = 50
"""Maximum number of missed expectations in the last line."""


@guarded
def report(
    results: Annotated[list[Path], typer.Argument(metavar="RESULT...", help="Result folders or their result.json.", show_default=False)],
    format_: Annotated[
        str | None, options.option("Formats (default html); svg, png for figures.", options.OUTPUT, "--format", metavar="html,md,csv,junit")
    ] = None,
    figure: Annotated[
        list[str] | None, options.option("Draw this figure, or 'all'; may be repeated.", options.OUTPUT, metavar="NAME")
    ] = None,
    out: Annotated[
        Path | None,
        options.out("Folder (default: folder of the result; massprop-out for several)."),
    ] = None,
    expect: options.Expect = None,
    open_: Annotated[bool, options.option("Open report.html in the browser.", options.OUTPUT, "--open")] = False,
    quiet: Annotated[bool, options.quiet("Do not print the paths that were written.")] = False,
) -> None:
    """Render results: report.html, report.md, report.csv, report.junit.xml, and figures as NAME.svg or NAME.png.

    One file covers all results. Figures of several results are named FOLDER-NAME.svg. Prints the paths of all written files. Exit 0: done;
    3: a result cannot be read; 4: a requirement of the expect file is not reached; 5: a value is missing or outside its expectation, by
    --expect or by the expect file of the estimate.

    Examples:
        massprop report massprop-out/log --open
        massprop report massprop-out/log run-1 --format html,md,csv,junit --out review
        massprop report massprop-out/log --figure inertia --figure correlation --format svg,png
    """
    texts, kinds = _formats(format_, bool(figure))
    if open_ and "html" not in texts:
        raise UsageError("--open: shows report.html, but --format does not ask for html; add it")
    folder_of_its_own(out)
    import numpy as np

    from massprop_cli import job
    from massprop_cli.inputs import expect as expectations
    from massprop_cli.result import read
    from massprop_cli.result.read import labels

    wanted = expectations.load(expect) if expect is not None else None
    once = {realpath(path): path for path in results}
    recorded = [_tested(read.read(path), wanted) for path in once.values()]
    with np.errstate(all="ignore"):  # some results differ by orders of magnitude
        files = _texts(recorded, texts) | _figures(recorded, figure or [], kinds)
    folder = out or (recorded[0].path.parent if len(recorded) == 1 else Path("massprop-out"))
    of_result = len(recorded) == 1 and realpath(folder) == realpath(recorded[0].path.parent)
    for path in _write(folder, files, of_result):
        if not quiet:
            put(str(path))
    if open_:
        typer.launch(str((folder / TEXTS["html"]).resolve()))
    names = labels(recorded)
    demands = job.Demands(expected=wanted, allow_contradicted=True)
    each = [(name, job.unmet(item.result, demands)) for item, name in zip(recorded, names, strict=True)]
    unreached = [f"{name}: {message}" for name, unmet in each for message in (*unmet.unconverged, *unmet.imprecise)]
    missed = [f"{name}: {message}" for name, unmet in each for message in unmet.missed]
    if unreached:
        fail(f"required but not reached: {'; '.join(unreached[:NAMED])}", exits.NOT_CONVERGED)
    if missed:
        more = f"; and {len(missed) - NAMED} more" if len(missed) > NAMED else ""
        fail(f"not as expected: {'; '.join(missed[:NAMED])}{more}", exits.NOT_EXPECTED)


def _formats(given: str | None, with_figures: bool) -> tuple[list[str], list[Literal["svg", "png"]]]:
    """Formats of texts and of figures, without duplicates, in the order of ``TEXTS`` and ``FIGURES``."""
    if given is None:
        return ([], ["svg"]) if with_figures else (["html"], [])
    names = [name.strip() for name in given.split(",")]
    for name in names:
        if name not in (*TEXTS, *FIGURES):
            raise UsageError(f"--format {name}: no such format; choose from {', '.join((*TEXTS, *FIGURES))}")
    kinds = [name for name in FIGURES if name in names]
    if kinds and not with_figures:
        raise UsageError(f"--format {kinds[0]}: is for figures; name one with --figure, or --figure all")
    return [name for name in TEXTS if name in names], kinds or (["svg"] if with_figures else [])


def _tested(item: Recorded, wanted: Expectations | None) -> Recorded:
    """Result tested against ``wanted``; unchanged without it."""
    from dataclasses import replace

    from massprop_cli.result import judge

    try:
        return item if wanted is None else replace(item, result=judge.judge(item.result, wanted))
    except InputError as error:
        raise InputError(f"{item.path}: {error}") from None


def _texts(recorded: Sequence[Recorded], names: Sequence[str]) -> dict[str, bytes]:
    from massprop_cli.report import html, junit, markdown, spreadsheet

    writers: dict[str, Callable[[], str]] = {
        "html": lambda: html.stamped(html.page(recorded), recorded),
        "md": lambda: markdown.stamped(markdown.text(recorded), recorded),
        "csv": lambda: spreadsheet.text(recorded),
        "junit": lambda: junit.text(junit.outcomes(recorded)),
    }
    return {TEXTS[name]: writers[name]().encode() for name in names}


def _figures(recorded: Sequence[Recorded], asked: Sequence[str], kinds: Sequence[Literal["svg", "png"]]) -> dict[str, bytes]:
    if not asked:
        return {}
    from massprop_cli.report import figures
    from massprop_cli.result.read import labels

    def names(item: Recorded) -> list[str]:
        """Names of the requested figures; "all" leaves out figures that need time for a combined result."""
        if "all" not in asked:
            return list(dict.fromkeys(asked))
        return [name for name in figures.NAMES if not item.joint or name in figures.WITHOUT_TIME]

    titles = [""] if len(recorded) == 1 else [f"{label.replace('/', '-')}-" for label in labels(recorded)]
    if len(set(titles)) < len(titles):
        titles = [f"{number}-{title}" for number, title in enumerate(titles, 1)]
    return {
        f"{title}{name}.{kind}": figures.draw(name, item, kind)
        for item, title in zip(recorded, titles, strict=True)
        for name in names(item)
        for kind in kinds
    }


def _write(folder: Path, contents: dict[str, bytes], of_result: bool) -> list[Path]:
    """Write all files or none. ``own``: the folder is that of the result, which records the names of its rendered files."""
    from massprop_cli.base import files
    from massprop_cli.result import rendered

    with files.staged(folder) as stage:
        for name, content in contents.items():
            stage.save(name, content)
        stage.place()
        if of_result:
            rendered.record(folder, contents)
    return [folder / name for name in contents]
