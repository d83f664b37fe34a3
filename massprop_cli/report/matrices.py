"""Inertia matrices, principal moments and axes of a report, as text."""

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
    """Number in a matrix."""

    text: str
    rough: bool
    """Whether its verdict makes the number unusable."""


@dataclass(frozen=True)
class Grid:
    """3 × 3 matrix with a title."""

    title: str
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Axis:
    """Principal moment with its axis."""

    moment: str
    sigma: str
    direction: tuple[str, ...]
    near: str
    """Angle from the nearest body axis."""
    rough: bool


def matrices(phase: PhaseItem | DockedObject, bearing_mass_kg: float, about_origin: Array) -> list[Grid]:
    """Inertia about the CG and about O, in both sign conventions of products.

    ``about_origin``: (3, 3) inertia about O, kg m².
    """
    verdicts = _verdicts(phase)
    transfer = [item.verdict for name, item in phase.estimates.items() if name in (*CG, "mass")]
    # the sigma about O includes the sigmas of CG and mass, unless one is contradicted and so has no valid sigma
    o_verdicts = np.full((3, 3), "contradicted", dtype=object) if "contradicted" in transfer else verdicts
    about_cg = body.inertia(phase)
    grids = []
    for point, matrix, sigmas, of_point in (
        ("the CG", about_cg, body.inertia_sigmas(phase), verdicts),
        ("O", about_origin, body.about_origin_sigmas(phase, bearing_mass_kg), o_verdicts),
    ):
        for convention, shown in (("tensor", matrix), ("positive integral", matrix * (2 * np.eye(3) - 1))):
            grids.append(Grid(f"About {point}, {convention}", _grid(shown, sigmas, of_point)))
    return grids


def nearest(phase: PhaseItem) -> Grid | None:
    """The nearest physically consistent inertia, rounded by the estimate's sigmas; None if the estimate is consistent."""
    found = phase.physical.nearest_consistent
    if found is None:
        return None
    return Grid("Nearest consistent, about the CG, tensor", _grid(body.array(found), body.inertia_sigmas(phase), _verdicts(phase)))


def _verdicts(phase: PhaseItem | DockedObject) -> NDArray[np.object_]:
    """(3, 3) verdicts of the inertia's elements."""
    verdicts = np.empty((3, 3), dtype=object)
    for (i, j), item in zip(body.UPPER, phase.estimates.values(), strict=False):
        verdicts[i, j] = verdicts[j, i] = item.verdict
    return verdicts


def _grid(matrix: Array, sigmas: Array, verdicts: NDArray[np.object_]) -> tuple[tuple[Cell, ...], ...]:
    def cell(value: float, sigma: float, verdict: str) -> Cell:
        return Cell(_numbers(value, sigma, verdict)[0], np.isfinite(value) and verdict not in INFORMED)

    return tuple(tuple(cell(float(matrix[i, j]), float(sigmas[i, j]), str(verdicts[i, j])) for j in range(3)) for i in range(3))


def _numbers(value: float, sigma: float, verdict: str) -> tuple[str, str]:
    """Value and sigma as :func:`digits.numbers`, also for NaN; without a sigma, a value has five significant figures."""
    if not np.isfinite(value):
        return digits.ABSENT, digits.ABSENT
    if np.isfinite(sigma):
        shown, spread = digits.numbers(value, sigma, verdict)
        return digits.minus(shown), digits.minus(spread)
    return digits.minus(f"{value:.5g}" if verdict in INFORMED else digits.figures(value)), digits.ABSENT


def axes(phase: PhaseItem | DockedObject) -> list[Axis]:
    """Principal moments, ascending, and axes; empty without an inertia."""
    principal = body.principal(phase)
    if principal is None:
        return []
    verdicts = [phase.estimates[name].verdict for name in INERTIA]
    verdict = next((one for one in verdicts if one not in INFORMED), "converged")
    rough = verdict not in INFORMED
    shown = []
    for moment, sigma, direction in zip(principal.moments, principal.sigmas, principal.axes.T, strict=True):
        value, spread = _numbers(float(moment), float(sigma), verdict)
        most = int(np.argmax(np.abs(direction)))
        angle = np.degrees(np.arccos(min(1.0, abs(float(direction[most])))))
        parts = tuple(digits.minus(f"{part:.{2 if rough else 5}f}") for part in direction)
        shown.append(Axis(value, spread, parts, f"{angle:.{0 if rough else 2}f}° from {AXES[most]}", rough))
    return shown
