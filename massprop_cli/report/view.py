"""A result as a page shows it: every number a text with as many figures as its sigma bears."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.report import body, words
from massprop_cli.report.result import EstimateItem, PhaseItem, Result

AXES = ("X", "Y", "Z")
ABSENT = "–"


@dataclass(frozen=True)
class Row:
    """One quantity."""

    symbol: str
    value: str
    sigma: str
    unit: str
    verdict: str
    """As a class of CSS and, with spaces, in words."""
    sign: str
    reason: str
    final: str
    nominal: str
    expected: str
    met: bool | None
    difference: str


@dataclass(frozen=True)
class Table:
    """The ten quantities of a phase or of the docked object."""

    anchor: str
    title: str
    rows: tuple[Row, ...]
    estimates: dict[str, EstimateItem]

    @property
    def nominal(self) -> bool:
        """Whether any has a nominal value."""
        return any(row.nominal for row in self.rows)

    @property
    def final(self) -> bool:
        """Whether any was final at some moment."""
        return any(row.final for row in self.rows)

    @property
    def expected(self) -> bool:
        """Whether any was expected."""
        return any(row.expected for row in self.rows)

    @property
    def converged(self) -> int:
        """How many are converged."""
        return sum(row.verdict == "converged" for row in self.rows)

    @property
    def open(self) -> tuple[Row, ...]:
        """Those that are not converged."""
        return tuple(row for row in self.rows if row.verdict != "converged")

    @property
    def missed(self) -> tuple[Row, ...]:
        """Those outside their expectation."""
        return tuple(row for row in self.rows if row.met is False)


@dataclass(frozen=True)
class Grid:
    """A 3 × 3 matrix."""

    title: str
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Axis:
    """A principal moment and its axis."""

    moment: str
    sigma: str
    direction: tuple[str, ...]
    near: str


def tables(result: Result) -> list[Table]:
    """One for each phase, and one for the docked object."""
    several = len(result.phases) > 1
    found = []
    for number, phase in enumerate(result.phases, 1):
        name = f"Phase {phase.name}" if several or phase.name != "all" else "Whole log"
        span = f"{minus(f'{phase.start_s:.3f}'.rstrip('0').rstrip('.'))} to {f'{phase.end_s:.3f}'.rstrip('0').rstrip('.')} s"
        found.append(table(f"phase-{number}", f"{name}, {span}", phase.estimates))
    docked = result.docked_object
    if docked is not None:
        found.append(table("docked", f"Docked object: {docked.after} less {docked.before}", docked.estimates))
    return found


def table(anchor: str, title: str, estimates: dict[str, EstimateItem]) -> Table:
    """The table of ten estimates."""
    return Table(anchor, title, tuple(_row(name, item) for name, item in estimates.items()), estimates)


def _row(name: str, item: EstimateItem) -> Row:
    value, sigma = (minus(text) for text in words.numbers(item.value, item.sigma))
    expected = item.expected
    return Row(
        symbol=words.SYMBOLS[name],
        value=value,
        sigma=sigma,
        unit=words.unit(item.unit),
        verdict=item.verdict,
        sign=words.SIGNS[item.verdict],
        reason=item.reason,
        final="" if item.final_at_s is None else f"{item.final_at_s:.2f} s",
        nominal="" if item.nominal is None else minus(f"{item.nominal:.6g}"),
        expected="" if expected is None else f"{minus(f'{expected.value:.6g}')} ± {expected.stated}",
        met=None if expected is None else expected.met,
        difference="" if expected is None or expected.sigmas is None else f"{minus(f'{expected.sigmas:+.1f}')} σ",
    )


def matrices(phase: PhaseItem, bearing_mass_kg: float, about_origin: Array) -> list[Grid]:
    """Inertia about the CG and about O, in both conventions of products."""
    about_cg = body.inertia(phase)
    cg_sigmas = np.full((3, 3), np.nan)
    for (i, j), item in zip(body.UPPER, phase.estimates.values(), strict=False):
        cg_sigmas[i, j] = cg_sigmas[j, i] = np.nan if item.sigma is None else item.sigma
    o_sigmas = body.about_origin_sigmas(phase, bearing_mass_kg)
    found = []
    for point, matrix, sigmas in (("the CG", about_cg, cg_sigmas), ("O", about_origin, o_sigmas)):
        for convention, shown in (("tensor", matrix), ("positive integral", body.other_convention(matrix))):
            found.append(Grid(f"About {point}, {convention}", grid(shown, sigmas)))
    return found


def grid(matrix: Array, sigmas: Array) -> tuple[tuple[str, ...], ...]:
    """Numbers with the figures that their sigmas bear."""
    return tuple(tuple(_cell(v, s) for v, s in zip(row, sigma, strict=True)) for row, sigma in zip(matrix, sigmas, strict=True))


def _cell(value: float, sigma: float) -> str:
    if not np.isfinite(value):
        return ABSENT
    return minus(words.numbers(float(value), float(sigma))[0] if np.isfinite(sigma) else f"{value:.5g}")


def axes(phase: PhaseItem) -> list[Axis]:
    """Principal moments, ascending, and their axes; none if the inertia is not known."""
    found = body.principal(phase)
    if found is None:
        return []
    shown = []
    for moment, sigma, direction in zip(found.moments, found.sigmas, found.axes.T, strict=True):
        value, spread = words.numbers(float(moment), float(sigma)) if np.isfinite(sigma) else (f"{moment:.5g}", ABSENT)
        nearest = int(np.argmax(np.abs(direction)))
        angle = np.degrees(np.arccos(min(1.0, abs(float(direction[nearest])))))
        parts = tuple(minus(f"{part:.5f}") for part in direction)
        shown.append(Axis(minus(value), minus(spread), parts, f"{angle:.2f}° from {AXES[nearest]}"))
    return shown


def cures(table: Table) -> list[tuple[str, Row, str]]:
    """For each quantity that is not converged: its name, row, and what would help."""
    keys = {symbol: key for key, symbol in words.SYMBOLS.items()}
    return [(row.symbol, row, words.remedy(keys[row.symbol], row.verdict)) for row in table.open]


def minus(text: str) -> str:
    """With a real minus sign, exponents too; nothing rounds to a negative zero."""
    return text.replace("-", "−" if any(digit in text for digit in "123456789") else "")


def signs(found: Iterable[Table]) -> list[str]:
    """Verdicts that occur, in the order of :data:`words.VERDICTS`."""
    there = {row.verdict for table in found for row in table.rows}
    return [verdict for verdict in words.VERDICTS if verdict in there]
