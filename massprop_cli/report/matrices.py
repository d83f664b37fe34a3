"""Inertia as a page shows it: 3 × 3 matrices, principal moments and axes, every number a text."""

import numpy as np
from numpy.typing import NDArray

from massprop_cli import CG, INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.report import body, digits
from massprop_cli.result.judge import INFORMED
from massprop_cli.result.schema import DockedObject, PhaseItem

AXES = "XYZ"


@dataclass(frozen=True)
class Cell:
    """A number of a matrix."""

    text: str
    rough: bool
    """Whether no usable verdict stands behind it."""


@dataclass(frozen=True)
class Grid:
    """A 3 × 3 matrix."""

    title: str
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Axis:
    """A principal moment and its axis."""

    moment: str
    sigma: str
    direction: tuple[str, ...]
    near: str
    rough: bool


def matrices(phase: PhaseItem | DockedObject, bearing_mass_kg: float, about_origin: Array) -> list[Grid]:
    """Inertia about the CG and about O, in both conventions of products."""
    verdicts = _verdicts(phase)
    moved = [item.verdict for name, item in phase.estimates.items() if name in (*CG, "mass")]
    # not excited CG or mass are in the sigma of an inertia about O; a sigma that doesn't hold is in nothing
    o_verdicts = np.full((3, 3), "contradicted", dtype=object) if "contradicted" in moved else verdicts
    about_cg = body.inertia(phase)
    found = []
    for point, matrix, sigmas, told in (
        ("the CG", about_cg, body.inertia_sigmas(phase), verdicts),
        ("O", about_origin, body.about_origin_sigmas(phase, bearing_mass_kg), o_verdicts),
    ):
        for convention, shown in (("tensor", matrix), ("positive integral", matrix * (2 * np.eye(3) - 1))):
            found.append(Grid(f"About {point}, {convention}", _grid(shown, sigmas, told)))
    return found


def nearest(phase: PhaseItem) -> Grid | None:
    """The nearest inertia that a body could have, with the figures that the estimate's sigmas bear; None where there is none."""
    found = phase.physical.nearest_consistent
    if found is None:
        return None
    return Grid("Nearest consistent, about the CG, tensor", _grid(body.array(found), body.inertia_sigmas(phase), _verdicts(phase)))


def _verdicts(phase: PhaseItem | DockedObject) -> NDArray[np.object_]:
    """(3, 3) of the inertia's elements."""
    verdicts = np.empty((3, 3), dtype=object)
    for (i, j), item in zip(body.UPPER, phase.estimates.values(), strict=False):
        verdicts[i, j] = verdicts[j, i] = item.verdict
    return verdicts


def _grid(matrix: Array, sigmas: Array, verdicts: NDArray[np.object_]) -> tuple[tuple[Cell, ...], ...]:
    def cell(value: float, sigma: float, verdict: str) -> Cell:
        return Cell(_numbers(value, sigma, verdict)[0], np.isfinite(value) and verdict not in INFORMED)

    return tuple(tuple(cell(float(matrix[i, j]), float(sigmas[i, j]), str(verdicts[i, j])) for j in range(3)) for i in range(3))


def _numbers(value: float, sigma: float, verdict: str) -> tuple[str, str]:
    """The texts of :func:`digits.numbers`, also for NaN; without a sigma a value has five figures."""
    if not np.isfinite(value):
        return digits.ABSENT, digits.ABSENT
    if np.isfinite(sigma):
        shown, spread = digits.numbers(value, sigma, verdict)
        return digits.minus(shown), digits.minus(spread)
    return digits.minus(f"{value:.5g}" if verdict in INFORMED else digits.figures(value)), digits.ABSENT


def axes(phase: PhaseItem | DockedObject) -> list[Axis]:
    """Principal moments, ascending, and their axes; none if the inertia is not known."""
    found = body.principal(phase)
    if found is None:
        return []
    verdicts = [phase.estimates[name].verdict for name in INERTIA]
    verdict = next((one for one in verdicts if one not in INFORMED), "converged")
    rough = verdict not in INFORMED
    shown = []
    for moment, sigma, direction in zip(found.moments, found.sigmas, found.axes.T, strict=True):
        value, spread = _numbers(float(moment), float(sigma), verdict)
        most = int(np.argmax(np.abs(direction)))
        angle = np.degrees(np.arccos(min(1.0, abs(float(direction[most])))))
        parts = tuple(digits.minus(f"{part:.{2 if rough else 5}f}") for part in direction)
        shown.append(Axis(value, spread, parts, f"{angle:.{0 if rough else 2}f}° from {AXES[most]}", rough))
    return shown
