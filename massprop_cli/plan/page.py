"""Self-contained page plan.html: the tables of a plan, and each sigma against time."""

from massprop_cli.base.lazy import markupsafe, ticker
from massprop_cli.plan import limits as limited
from massprop_cli.plan import table
from massprop_cli.plan.document import PlanFile, QuantityItem
from massprop_cli.report import digits, html, vocabulary
from massprop_cli.report.figures import axis, canvas, palette
from massprop_cli.report.figures.panel import Axes, Panel
from massprop_cli.report.svg import gathered, inline


def text(plan: PlanFile) -> str:
    """The text of the page; equal plans give equal bytes."""
    observable = {name: item for name, item in plan.quantities.items() if item.told == "well"}
    panels = [_panel(plan, name, item) for name, item in observable.items()]
    drawn = [inline(canvas.render([panel], "svg"), f"plan-{panel.key}", panel.alt_text) for panel in panels]
    page = html.environment().get_template("plan.html.j2")
    rows = [(name, vocabulary.SYMBOLS[name], table.cells(item), item) for name, item in plan.quantities.items()]
    content = {
        "plan": plan,
        "rows": rows,
        "longer": table.longer(plan),
        "further": {name: table.further(item) for name, item in plan.quantities.items()},
        "taught": table.informed,
        "limits": [(limited.LIMITS[name][0], table.limit(item)) for name, item in plan.limits.items()],
        "legend": table.legend(plan),
        # the drawings are safe: canvas.render escapes their texts
        "panels": [markupsafe.Markup(one) for one in drawn],
    }
    return gathered(page.render(content))


def _panel(plan: PlanFile, name: str, item: QuantityItem) -> Panel:
    """Predicted and wanted sigma of one quantity against time."""
    course = [(at, sigma) for at, sigma in zip(plan.time_s, plan.course[name], strict=True) if sigma is not None]

    def paint(axes: Axes) -> None:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(
            ticker.LogLocator(subs=(1.0,) if course and course[0][1] > 30 * course[-1][1] else (1.0, 2.0, 5.0), numticks=6)
        )
        axes.yaxis.set_major_formatter(ticker.FuncFormatter(lambda tick, _: digits.figures(float(tick), 1)))
        axes.yaxis.set_minor_formatter(ticker.NullFormatter())
        axis.heading(axes, f"{vocabulary.SYMBOLS[name]}: sigma", vocabulary.unit(item.unit))
        axis.time(axes, 0.0, plan.duration_s)
        for number, part in enumerate(plan.timeline):
            axes.axvspan(part.start_s, part.end_s, color=palette.SHADE, alpha=1.0 - 0.6 * (number % 2), zorder=0, linewidth=0)
        axes.plot(*zip(*course, strict=True), color=palette.BLUE, gid=f"{name}-sigma")
        if item.wanted_sigma is not None:
            axes.axhline(item.wanted_sigma, color=palette.GREEN, linestyle=(0, (3, 1.5)), gid=f"{name}-wanted")

    wanted = "" if item.wanted_sigma is None else f", wanted {item.wanted_sigma:.2g}"
    return Panel(
        name, f"predicted sigma of {vocabulary.SYMBOLS[name]} against time, {item.sigma:.2g} {item.unit} at the end{wanted}", paint
    )
