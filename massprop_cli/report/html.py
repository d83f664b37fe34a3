"""One self-contained page: a report of one result, or a comparison of several. Same results, same bytes."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Any

from massprop_cli import QUANTITIES
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.escape import visible
from massprop_cli.base.lazy import jinja2, markupsafe
from massprop_cli.report import assumptions, body, checks, digits, figures, matrices, timing, view, vocabulary
from massprop_cli.report.figures import Picture, canvas, comparison, correlation, palette
from massprop_cli.report.svg import gathered, inline, quoted, script
from massprop_cli.result.read import Recorded, labels
from massprop_cli.result.schema import Matrix, PhaseItem, Result

MISSING = (
    "This figure needs history.parquet, which is missing beside result.json or was written by another version. "
    "Make the result again with massprop estimate, and the report from its folder."
)
OF_LOGS = "This result combines several logs and has no time history: see the report of each log for figures of fit, commands and response."
OF_PHASE = ("inertia", "cg", "mass", "settling")
OF_FIT = ("rate-fit", "force-fit", "whiteness", "command-fit", "innovations")
STACKED = ("rate-fit", "force-fit")
"""Figures whose panels belong together in twos, one below the other."""
OF_LOG = ("firing", "torque", "force", "rate", "acceleration")


@dataclass(frozen=True)
class Figure:
    """A picture in the page, or why it isn't there."""

    name: str
    anchor: str
    title: str
    caption: str
    panels: tuple[Any, ...]
    """Markup."""


def page(recorded: Sequence[Recorded]) -> str:
    """A full report of one result; several are compared. The page loads nothing from anywhere."""
    if not recorded:
        raise ValueError("a page needs a result")
    templates = environment()
    if len(recorded) == 1:
        return gathered(templates.get_template("report.html.j2").render(_report(recorded[0])))
    return gathered(templates.get_template("comparison.html.j2").render(_comparison(recorded)))


def stamped(text: str, recorded: Sequence[Recorded]) -> str:
    """A page with the SHA-256 of each result.json that it was made from at its end, where that was read from a file."""
    several = [f"{escape(name)}/" if len(recorded) > 1 else "" for name in labels(recorded)]
    said = [f"{name}result.json, SHA-256 <code>{one.sha256}</code>" for name, one in zip(several, recorded, strict=True) if one.sha256]
    before, mark, after = text.rpartition("</footer>")
    return f"{before} Made from {'; '.join(said)}.{mark}{after}" if said and mark else text


def environment() -> Any:
    """The templates, with the palette and the words that they share."""
    found = jinja2.Environment(
        loader=jinja2.PackageLoader("massprop_cli.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: visible(value) if type(value) is str else value,
    )
    found.filters["quoted"] = lambda text: markupsafe.Markup(quoted(text))
    found.globals |= {
        "light": palette.css(dark=False),
        "dark": palette.css(dark=True),
        "words": vocabulary,
        "view": view,
        "digits": digits,
        "printed": script("printed.js"),
    }
    return found


def _report(recorded: Recorded) -> Mapping[str, Any]:
    result = recorded.result
    tables = view.tables(result)
    phases = [_phase(recorded, number, item, table) for (number, item), table in zip(enumerate(result.phases, 1), tables, strict=False)]
    held = [check.inside for phase in phases for check in phase["checks"]]
    return {
        "result": result,
        "tables": tables,
        "conventions": vocabulary.conventions(result),
        "phases": phases,
        "scripts": [script("uplot.js"), script("live.js")],
        "sheet": script("uplot.css").text,
        "docked": _docked(recorded, tables[-1]),
        "fits": checks.verdict(held),
        "assumptions": assumptions,
        "fit": _figures(OF_FIT, recorded, ""),
        "joint": OF_LOGS if recorded.joint else "",
        "stacked": STACKED,
        "expectations": _figure("expectations", recorded, "expectations") if any(table.has("expected") for table in tables) else None,
        "signals": _figures(OF_LOG, recorded, ""),
        "delay": timing.rows(result),
        "settings": settings(result),
        "verdicts": view.signs(tables),
    }


def settings(result: Result) -> list[tuple[str, str, str]]:
    """Key, value and where it came from."""
    sources = result.provenance.setting_sources
    return [(key, _setting(value), sources.get(key, "")) for key, value in result.provenance.settings.items()]


def _setting(value: object) -> str:
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_setting(part) for part in value)
    return str(value)


def _phase(recorded: Recorded, number: int, item: PhaseItem, table: view.QuantityTable) -> dict[str, Any]:
    bearing_mass = recorded.result.vehicle.bearing_mass_kg
    return {
        "anchor": table.anchor,
        "title": table.title,
        "pivot": view.about_pivot(item, table),
        "grids": matrices.matrices(item, bearing_mass, body.array(item.inertia_about_origin)),
        "axes": matrices.axes(item),
        "note": item.physical.note,
        "nearest": matrices.nearest(item),
        "ellipsoid": _figure("ellipsoid", recorded, f"ellipsoid{number}", item.name),
        "pair": _figures(("excitation", "correlation"), recorded, str(number), item.name),
        "correlations": _correlations(item.covariance),
        "against_time": _figures(OF_PHASE, recorded, str(number), item.name),
        "checks": [
            *(checks.innovations(item.innovations) if item.innovations else []),
            *(checks.cross_validation(item.cross_validation) if item.cross_validation else []),
        ],
    }


def _docked(recorded: Recorded, table: view.QuantityTable) -> dict[str, Any] | None:
    found = recorded.result.docked_object
    if found is None:
        return None
    alone = replace(recorded, result=recorded.result.model_copy(update={"phases": []}))
    return {
        "anchor": table.anchor,
        "title": table.title,
        "grids": matrices.matrices(found, 0.0, body.about_origin(found)),
        "axes": matrices.axes(found),
        "correlation": drawn("correlation", figures.TITLES["correlation"], correlation.picture(alone), "correlation-docked"),
        "correlations": _correlations(found.covariance),
    }


def _correlations(covariance: Matrix) -> list[tuple[str, list[str]]]:
    """One row for each quantity."""
    found = correlation.correlation(covariance)
    return [(vocabulary.SYMBOLS[name], [correlation.written(v) for v in row]) for name, row in zip(QUANTITIES, found, strict=True)]


def _figures(names: Sequence[str], recorded: Recorded, number: str, phase: str | None = None) -> list[Figure]:
    """The figures that the result can have; a result of several logs has none against time."""
    kept = [name for name in names if name in figures.WITHOUT_TIME or not recorded.joint]
    return [_figure(name, recorded, f"{name}{number}", phase) for name in kept]


def _figure(name: str, recorded: Recorded, prefix: str, phase: str | None = None) -> Figure:
    try:
        return drawn(name, figures.TITLES[name], figures.picture(name, recorded, phase), prefix)
    except InputError:
        return Figure(name, f"figure-{prefix}", figures.TITLES[name], MISSING, ())


def drawn(name: str, title: str, picture: Picture, prefix: str) -> Figure:
    """A picture as a page has it; ``prefix`` makes its ids the page's only ones."""
    svgs = [canvas.render([panel], "svg") for panel in picture.panels]
    panels = [inline(svg, f"{prefix}-{n}", panel.says) for n, (svg, panel) in enumerate(zip(svgs, picture.panels, strict=True), 1)]
    # our own drawing, with its texts escaped
    return Figure(name, f"figure-{prefix}", title, picture.caption, tuple(markupsafe.Markup(panel) for panel in panels))


def _comparison(recorded: Sequence[Recorded]) -> Mapping[str, Any]:
    entries: list[dict[str, Any]] = [
        {"anchor": f"result-{n}", "name": name, "result": one.result, "tables": view.tables(one.result)}
        for n, (one, name) in enumerate(zip(recorded, labels(recorded), strict=True), 1)
    ]
    rows = [(entry, table) for entry in entries for table in entry["tables"]]
    return {
        "entries": entries,
        "rows": rows,
        "vehicles": _vehicles(rows),
        "verdicts": view.signs(table for _, table in rows),
    }


def _vehicles(rows: Sequence[tuple[dict[str, Any], view.QuantityTable]]) -> list[dict[str, Any]]:
    """Results of each vehicle side by side: two vehicles on one axis would hide what differs between results of each."""
    groups: dict[str, list[tuple[dict[str, Any], view.QuantityTable]]] = {}
    for entry, table in rows:
        groups.setdefault(entry["result"].vehicle.name, []).append((entry, table))
    found = []
    for number, (vehicle, group) in enumerate(groups.items(), 1):
        names = [f"{entry['name']}{f', {table.short}' if len(entry['tables']) > 1 else ''}" for entry, table in group]
        picture = comparison.picture([table.estimates for _, table in group], names)
        figure = drawn("comparison", f"Values side by side: {vehicle or 'vehicle without a name'}", picture, f"comparison{number}")
        first = group[0][1].estimates
        apart = [view.differences(table.estimates, first) for _, table in group[1:]]
        found.append({"name": vehicle, "figure": figure, "first": names[0], "differences": list(zip(names[1:], apart, strict=True))})
    return found
