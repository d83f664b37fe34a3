"""Self-contained HTML page: a report of one result, or a comparison of several. Equal results give equal bytes."""

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
"""Text in place of a figure without history.parquet."""
OF_LOGS = "This result combines several logs and has no time history: see the report of each log for figures of fit, commands and response."
"""Text in place of the figures against time in a combined result."""
OF_PHASE = ("inertia", "cg", "mass", "settling")
"""Figures of each phase against time."""
OF_FIT = ("rate-fit", "force-fit", "whiteness", "command-fit", "innovations")
"""Figures of the model's fit."""
STACKED = ("rate-fit", "force-fit")
"""Figures with pairs of panels, one below the other."""
OF_LOG = ("firing", "torque", "force", "rate", "acceleration")
"""Figures of the signals of the whole log."""


@dataclass(frozen=True)
class Figure:
    """Figure in a page; without panels, the caption says why."""

    name: str
    anchor: str
    title: str
    caption: str
    panels: tuple[Any, ...]
    """SVG elements, as markup."""


def page(recorded: Sequence[Recorded]) -> str:
    """Text of the page: a report of one result, or a comparison of several. It loads no other files."""
    if not recorded:
        raise ValueError("a page needs a result")
    templates = environment()
    if len(recorded) == 1:
        return gathered(templates.get_template("report.html.j2").render(_report(recorded[0])))
    return gathered(templates.get_template("comparison.html.j2").render(_comparison(recorded)))


def stamped(text: str, recorded: Sequence[Recorded]) -> str:
    """The page with the SHA-256 digest of each result.json in its footer; a result without a file has none."""
    several = [f"{escape(name)}/" if len(recorded) > 1 else "" for name in labels(recorded)]
    sources = [f"{name}result.json, SHA-256 <code>{one.sha256}</code>" for name, one in zip(several, recorded, strict=True) if one.sha256]
    before, mark, after = text.rpartition("</footer>")
    return f"{before} Made from {'; '.join(sources)}.{mark}{after}" if sources and mark else text


def environment() -> Any:
    """The template environment, with palette, vocabulary and filters."""
    templates = jinja2.Environment(
        loader=jinja2.PackageLoader("massprop_cli.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: visible(value) if type(value) is str else value,
    )
    templates.filters["quoted"] = lambda text: markupsafe.Markup(quoted(text))
    templates.globals |= {
        "light": palette.css(dark=False),
        "dark": palette.css(dark=True),
        "words": vocabulary,
        "view": view,
        "digits": digits,
        "printed": script("printed.js"),
    }
    return templates


def _report(recorded: Recorded) -> Mapping[str, Any]:
    """Template data of a report."""
    result = recorded.result
    tables = view.tables(result)
    phases = [_phase(recorded, number, item, table) for (number, item), table in zip(enumerate(result.phases, 1), tables, strict=False)]
    inside = [check.inside for phase in phases for check in phase["checks"]]
    return {
        "result": result,
        "tables": tables,
        "conventions": vocabulary.conventions(result),
        "phases": phases,
        "scripts": [script("uplot.js"), script("live.js")],
        "sheet": script("uplot.css").text,
        "docked": _docked(recorded, tables[-1]),
        "fits": checks.verdict(inside),
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
    """Key, value and source of each setting."""
    sources = result.provenance.setting_sources
    return [(key, _setting(value), sources.get(key, "")) for key, value in result.provenance.settings.items()]


def _setting(value: object) -> str:
    """The value of a setting as text."""
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_setting(part) for part in value)
    return str(value)


def _phase(recorded: Recorded, number: int, item: PhaseItem, table: view.QuantityTable) -> dict[str, Any]:
    """Template data of a phase."""
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
    """Template data of the docked object; None without one."""
    docked = recorded.result.docked_object
    if docked is None:
        return None
    alone = replace(recorded, result=recorded.result.model_copy(update={"phases": []}))
    return {
        "anchor": table.anchor,
        "title": table.title,
        "grids": matrices.matrices(docked, 0.0, body.about_origin(docked)),
        "axes": matrices.axes(docked),
        "correlation": drawn("correlation", figures.TITLES["correlation"], correlation.picture(alone), "correlation-docked"),
        "correlations": _correlations(docked.covariance),
    }


def _correlations(covariance: Matrix) -> list[tuple[str, list[str]]]:
    """Rows of a correlation table: symbol, and correlations with all quantities."""
    found = correlation.correlation(covariance)
    return [(vocabulary.SYMBOLS[name], [correlation.written(v) for v in row]) for name, row in zip(QUANTITIES, found, strict=True)]


def _figures(names: Sequence[str], recorded: Recorded, number: str, phase: str | None = None) -> list[Figure]:
    """The named figures, except figures against time for a combined result."""
    kept = [name for name in names if name in figures.WITHOUT_TIME or not recorded.joint]
    return [_figure(name, recorded, f"{name}{number}", phase) for name in kept]


def _figure(name: str, recorded: Recorded, prefix: str, phase: str | None = None) -> Figure:
    """A figure of a result, or its replacement without history.parquet."""
    try:
        return drawn(name, figures.TITLES[name], figures.picture(name, recorded, phase), prefix)
    except InputError:
        return Figure(name, f"figure-{prefix}", figures.TITLES[name], MISSING, ())


def drawn(name: str, title: str, picture: Picture, prefix: str) -> Figure:
    """A picture as a figure of a page; ``prefix`` makes its ids unique in the page."""
    svgs = [canvas.render([panel], "svg") for panel in picture.panels]
    panels = [inline(svg, f"{prefix}-{n}", panel.alt_text) for n, (svg, panel) in enumerate(zip(svgs, picture.panels, strict=True), 1)]
    # the SVG is safe: canvas.render escapes its texts
    return Figure(name, f"figure-{prefix}", title, picture.caption, tuple(markupsafe.Markup(panel) for panel in panels))


def _comparison(recorded: Sequence[Recorded]) -> Mapping[str, Any]:
    """Template data of a comparison."""
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
    """Template data of each vehicle's results.

    Each vehicle has a figure, since the differences between vehicles would hide those between its results.
    """
    groups: dict[str, list[tuple[dict[str, Any], view.QuantityTable]]] = {}
    for entry, table in rows:
        groups.setdefault(entry["result"].vehicle.name, []).append((entry, table))
    vehicles = []
    for number, (vehicle, group) in enumerate(groups.items(), 1):
        names = [f"{entry['name']}{f', {table.short}' if len(entry['tables']) > 1 else ''}" for entry, table in group]
        picture = comparison.picture([table.estimates for _, table in group], names)
        figure = drawn("comparison", f"Values side by side: {vehicle or 'vehicle without a name'}", picture, f"comparison{number}")
        first = group[0][1].estimates
        texts = [view.differences(table.estimates, first) for _, table in group[1:]]
        vehicles.append({"name": vehicle, "figure": figure, "first": names[0], "differences": list(zip(names[1:], texts, strict=True))})
    return vehicles
