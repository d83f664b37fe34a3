"""A result as text for reports: tables of quantities, with numbers rounded by their sigmas."""

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.escape import line
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.report import assumptions, digits, vocabulary
from massprop_cli.report.vocabulary import reason
from massprop_cli.result.judge import INFORMED, contradiction
from massprop_cli.result.schema import DockedObject, EstimateItem, Mended, MendedPhase, PhaseItem, Result

SCATTER = "± by segments"
"""Heading of the sigmas from the scatter of segments."""
CORRECTED = "Corrected estimate"
"""Title of an estimate with a diagnosed fault corrected, which is shown in addition to the result."""


@dataclass(frozen=True)
class Row:
    """One quantity as text."""

    symbol: str
    value: str
    sigma: str
    percent: str
    """Sigma relative to the value; empty without a usable verdict."""
    unit: str
    verdict: str
    """Code of the verdict, also its CSS class."""
    sign: str
    reason: str
    reason_code: str
    final: str
    nominal: str
    expected: str
    met: bool | None
    difference: str
    """Value minus expected value, in ``unit``; empty without an expectation."""
    relative: str
    """The difference relative to the expected value, and in sigmas."""
    limit: str
    """Largest error contribution; empty without a usable verdict."""

    @property
    def rough(self) -> bool:
        """Whether the verdict makes the value unusable."""
        return self.verdict not in INFORMED


@dataclass(frozen=True)
class QuantityTable:
    """Table of the ten quantities of a phase or of the docked object."""

    anchor: str
    title: str
    short: str
    """Name of the phase."""
    rows: tuple[Row, ...]
    estimates: dict[str, EstimateItem]
    sigma: str
    """Heading of the sigmas."""
    implied: str
    """The thrust scale that a known mass implies; empty without one."""
    contradiction: str
    """How log and vehicle file contradict each other; empty without a contradiction."""

    def has(self, column: str) -> bool:
        """Whether a column has any text."""
        return any(getattr(row, column) for row in self.rows)

    def count(self, verdict: str) -> int:
        """Number of quantities with this verdict."""
        return sum(row.verdict == verdict for row in self.rows)

    @property
    def open(self) -> tuple[Row, ...]:
        """Quantities that are not converged."""
        return tuple(row for row in self.rows if row.verdict != "converged")

    @property
    def missed(self) -> tuple[Row, ...]:
        """Quantities outside their expectation."""
        return tuple(row for row in self.rows if row.met is False)


def tables(result: Result) -> list[QuantityTable]:
    """Tables of all phases and of the docked object."""
    several = len(result.phases) > 1
    found = []
    for number, phase in enumerate(result.phases, 1):
        name = f"Phase {phase.name}" if several or phase.name != "all" else "Whole log"
        span = f"{digits.minus(f'{phase.start_s:.3f}'.rstrip('0').rstrip('.'))} to {f'{phase.end_s:.3f}'.rstrip('0').rstrip('.')} s"
        found.append(table(f"phase-{number}", f"{name}, {span}", phase, result))
    docked = result.docked_object
    if docked is not None:
        found.append(table("docked", f"Docked object: {docked.after} less {docked.before}", docked, result))
    return found


def texts(estimates: Mapping[str, EstimateItem], heading: str) -> dict[str, list[str]]:
    """Columns of estimates as plain text, "" for an empty cell; ``heading`` is that of the sigmas.

    The columns after "final at" are omitted if they are empty.
    """
    items, expected = estimates.values(), [item.expected for item in estimates.values()]
    numbers = [digits.numbers(item.value, item.sigma, item.verdict) for item in items]
    always: dict[str, list[str]] = {
        "quantity": [*estimates],
        "value": [value for value, _ in numbers],
        heading: [sigma for _, sigma in numbers],
        "unit": [vocabulary.unit(item.unit) for item in items],
        "verdict": [item.verdict for item in items],
        "final at": ["" if item.final_at_s is None else f"{item.final_at_s:.2f} s" for item in items],
    }
    scatter = [(item.value, item.segment_sigma) for item in items]
    more = {
        SCATTER: ["" if sigma is None else digits.numbers(value, sigma)[1] for value, sigma in scatter],
        "nominal": ["" if item.nominal is None else digits.stated(item.nominal) for item in items],
        "expected": ["" if one is None else digits.stated(one.value) for one in expected],
        "tolerance": ["" if one is None else vocabulary.unit(one.stated) for one in expected],
        "met": ["" if one is None else "✓" if one.met else "✗" for one in expected],
    }
    return always | {name: cells for name, cells in more.items() if any(cells)}


def about_pivot(phase: PhaseItem, of_phase: QuantityTable) -> QuantityTable | None:
    """The table of the quantities about a fixed pivot, from the table of the phase; None without a pivot."""
    if not phase.about_pivot:
        return None
    rows = tuple(_row(name, item, of_phase.contradiction, None) for name, item in phase.about_pivot.items())
    anchor, title = f"{of_phase.anchor}-pivot", f"{of_phase.title}: {vocabulary.ABOUT_PIVOT}"
    return replace(of_phase, anchor=anchor, title=title, rows=rows, estimates=phase.about_pivot, implied="")


def table(anchor: str, title: str, part: PhaseItem | DockedObject, result: Result) -> QuantityTable:
    """The table of a phase or of the docked object."""
    cause = contradiction(part)
    rows = tuple(_row(name, item, cause, assumptions.limit(name, part, result)) for name, item in part.estimates.items())
    short = part.name if isinstance(part, PhaseItem) else "docked"
    return QuantityTable(
        anchor, title, short, rows, part.estimates, assumptions.sigma_heading(result), assumptions.implied_thrust(part), cause
    )


def _row(name: str, item: EstimateItem, contradicted: str, limit: assumptions.AccuracyLimit | None) -> Row:
    value, sigma = (digits.minus(text) for text in digits.numbers(item.value, item.sigma, item.verdict))
    expected = item.expected
    return Row(
        symbol=vocabulary.SYMBOLS[name],
        value=value,
        sigma=sigma,
        percent=_percent(item),
        unit=vocabulary.unit(item.unit),
        verdict=item.verdict,
        sign=vocabulary.SIGNS[item.verdict],
        reason=reason(item, contradicted),
        reason_code=item.reason_code,
        final="" if item.final_at_s is None else f"{item.final_at_s:.2f} s",
        nominal="" if item.nominal is None else digits.minus(f"{item.nominal:.6g}"),
        expected="" if expected is None else f"{digits.minus(f'{expected.value:.6g}')} ± {expected.stated}",
        met=None if expected is None else expected.met,
        difference=_difference(item),
        relative=_relative(item),
        limit="" if limit is None else digits.minus(limit.text),
    )


def _percent(item: EstimateItem) -> str:
    """Sigma relative to the value."""
    if not item.value or item.sigma is None or item.verdict not in INFORMED:
        return ""
    return f"{digits.minus(digits.figures(100 * item.sigma / abs(item.value)))} %"


def _difference(item: EstimateItem) -> str:
    """Value minus expected value, with the decimals of the value."""
    if item.expected is None or item.expected.difference is None:
        return ""
    shown, _ = digits.numbers(item.expected.difference, item.sigma, item.verdict)
    return _signed(shown)


def _relative(item: EstimateItem) -> str:
    """Value minus expected value, relative and in sigmas."""
    found = item.expected
    if found is None or found.difference is None:
        return ""
    texts = [f"{_signed(digits.figures(100 * found.difference / abs(found.value)))} %"] if found.value else []
    texts += [f"{_signed(f'{found.sigmas:.1f}')} σ"] if found.sigmas is not None else []
    return ", ".join(texts)


def _signed(text: str) -> str:
    """The text with its sign, also a plus; zero has no sign."""
    shown = digits.minus(text)
    return shown if shown.startswith(("−", digits.ABSENT)) or not any(digit in shown for digit in "123456789") else f"+{shown}"


def differences(estimates: Mapping[str, EstimateItem], first: Mapping[str, EstimateItem]) -> list[tuple[str, str]]:
    """Difference of each quantity from another result, and in sigmas, sqrt(s1² + s2²); empty without two usable values."""
    found = []
    for name, item in estimates.items():
        other = first[name]
        if item.value is None or other.value is None or not {item.verdict, other.verdict} <= set(INFORMED):
            found.append((digits.ABSENT, ""))
            continue
        difference, sigma = item.value - other.value, float(np.hypot(item.sigma or 0.0, other.sigma or 0.0))
        shown = _signed(digits.numbers(difference, sigma)[0])
        found.append((shown, f"{_signed(f'{difference / sigma:.1f}')} σ" if sigma > 0 else ""))
    return found


def remedies(table: QuantityTable) -> list[tuple[str, Row, str]]:
    """Names, row and remedy of quantities that are not converged; those with equal verdict, reason and remedy are one entry."""
    keys = {symbol: key for key, symbol in vocabulary.SYMBOLS.items()}
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in sorted(table.open, key=lambda row: row.verdict != "contradicted"):
        remedy = vocabulary.remedy(keys[row.symbol], row.verdict, table.contradiction, row.reason_code)
        groups.setdefault((row.verdict, row.reason, remedy), []).append(row)
    return [(", ".join(row.symbol for row in rows), rows[0], remedy) for (*_, remedy), rows in groups.items()]


def spread(sigma: str) -> str:
    """A sigma as text after its value."""
    return sigma if sigma == digits.ABSENT else f"± {sigma}"


def signs(found: Iterable[QuantityTable]) -> list[str]:
    """Verdicts in the tables, in the order of :data:`massprop_cli.report.vocabulary.VERDICTS`."""
    present = {row.verdict for table in found for row in table.rows}
    return [verdict for verdict in vocabulary.VERDICTS if verdict in present]


def corrections(found: Mended) -> list[str]:
    """The options of ``massprop estimate`` that correct a fault, quoted for a shell."""
    return [f"--set {shlex.quote(line(setting))}" for setting in found.settings]


def beyond_options(found: Mended) -> str:
    """A note that the options alone do not give these values; empty if they do."""
    return "" if found.whole else "These options alone do not give these values: massprop also rotated the readings of a sensor."


def corrected(phase: MendedPhase) -> list[tuple[str, str, str, str, Verdict]]:
    """Quantity, value, sigma, unit, verdict of a corrected estimate."""
    about = {f"{name} about the pivot": item for name, item in phase.about_pivot.items()}
    return [
        (name, *digits.numbers(item.value, item.sigma, item.verdict), vocabulary.unit(item.unit), item.verdict)
        for name, item in {**phase.estimates, **about}.items()
    ]


def still_contradicted(phase: MendedPhase) -> str:
    """The contradiction that remains after the correction; empty without one."""
    return f"still contradicted: {phase.contradiction}" if phase.contradiction else ""
