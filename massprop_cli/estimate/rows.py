"""Results of a regression: estimates by cycle, the information that they come from, and the response to assumptions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass


@dataclass(frozen=True)
class AssumptionResponse:
    """Change of estimate and residuals by one unit of each of e assumptions."""

    shift: Array
    """(10, e) change of the state parameters at the end."""
    gram: Array
    """(1 + e, 1 + e) inner products of whitened post-fit residuals: first the log's, then the change by each assumption."""

    added: Mapping[str, Array] = field(default_factory=dict)
    """(10,) increase of the state parameters' variance by each kind of uncertain geometry, and by damping."""
    damping: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(3, 2) estimated damping of the rotation about each axis and its sigma, N m s; empty without damping states."""

    @property
    def misfit(self) -> Array:
        """(e, e) inner products among the assumptions; the diagonal is the chi-square of one unit."""
        return self.gram[1:, 1:]


class Parameters(NamedTuple):
    """State parameters of K rows."""

    mean: Array
    """(K, 10) ixx … izz about the CG [kg m²], CG from O [m], 1/m [1/kg]; body axes."""
    covariance: Array
    """(K, 10, 10) covariance to first order."""
    relative: Array
    """(K, 3) relative sigmas of J_xx, J_yy and J_zz, which measure the curvature of I = J⁻¹."""

    @staticmethod
    def of(mean: Array, covariance: Array) -> Parameters:
        """Parameters without curvature."""
        return Parameters(mean, covariance, np.zeros((len(mean), 3)))


class Rows(NamedTuple):
    """Estimates after each of K cycles; NaN where there is no estimate."""

    parameters: Parameters
    innovation: Array
    """(K, 6) innovations as torque [N m] and force [N]."""
    sigma: Array
    """(K, 6) their predicted sigmas."""
    normalised: Array
    """(K, 6) whitened innovations."""

    @staticmethod
    def empty(count: int) -> Rows:
        """Rows of ``count`` cycles without an estimate."""
        blank = [np.full((count, *shape), np.nan) for shape in ((10,), (10, 10), (3,), (6,), (6,), (6,))]
        return Rows(Parameters(*blank[:3]), *blank[3:])

    def last(self) -> Rows:
        """The last row alone."""
        return Rows(Parameters(*(part[-1:] for part in self.parameters)), *(part[-1:] for part in self[1:]))

    def ending(self, parameters: Parameters) -> Rows:
        """The rows with other parameters in the last one."""
        both = zip(self.parameters, parameters, strict=True)
        return self._replace(parameters=Parameters(*(np.concatenate([old[:-1], new]) for old, new in both)))


class TriangleSolution(NamedTuple):
    """Solution of K information triangles for the departure of θ."""

    root: Array
    """(K, 10, 10) root of the covariance, without the pull towards the initial reference."""
    step: Array
    """(K, 10, 1 + e) departure of θ, and its derivatives with respect to the assumptions."""
    theta: Array
    """(K, 10) θ; what the data do not inform stays near the initial reference."""
    sigma: Array
    """(K, 10) sigma of each of θ, without the pull towards the initial reference."""


@dataclass(frozen=True)
class Posed:
    """Information of K cycles on θ, linear about one θ; n nuisance parameters, e assumptions."""

    theta: Array
    """(10,) θ of the linearisation."""
    scale: Array
    """(10,) prior sigmas, the unit of the departure from θ."""
    rows: Array
    """(K, 6, n + 11 + e) whitened rows: nuisance parameters, departure of θ, measured value, assumptions."""
    triangles: Array
    """(K + 1, n + 10, n + 11 + e) square-root information before the cycles and after each."""
    solution: TriangleSolution
    """Of the triangles after each cycle."""

    def first(self, count: int) -> Posed:
        """The information of the first ``count`` cycles."""
        solution = TriangleSolution(*(part[:count] for part in self.solution))
        return replace(self, rows=self.rows[:count], triangles=self.triangles[: count + 1], solution=solution)
