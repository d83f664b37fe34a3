"""Results of a regression: estimates by cycle, the rows that they were solved from, and effects of the assumptions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass


@dataclass(frozen=True)
class Response:
    """What one unit of each of e assumptions would have changed."""

    shift: Array
    """(10, e) of the state parameters at the end."""
    gram: Array
    """(1 + e, 1 + e) inner products of what is left of the whitened innovations, first of the log's own, then of what each would add."""

    added: Mapping[str, Array] = field(default_factory=dict)
    """Of each kind of uncertain geometry, and of damping: (10,) by how much its uncertainty widens the variance of the state parameters."""
    damping: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(3, 2) torque against the rate about each axis over it, and its sigma, N m s; empty where none is looked for."""

    @property
    def misfit(self) -> Array:
        """(e, e) of the assumptions among themselves: the diagonal is chi-square for one unit."""
        return self.gram[1:, 1:]


class Parameters(NamedTuple):
    """State parameters of K rows."""

    mean: Array
    """(K, 10) ixx … izz about the CG [kg m²], CG from O [m], 1/m [1/kg]; body axes."""
    covariance: Array
    """(K, 10, 10) by slopes alone."""
    relative: Array
    """(K, 3) sigmas of J_xx, J_yy and J_zz over these: by so much I = J⁻¹ is curved."""

    @staticmethod
    def of(mean: Array, covariance: Array) -> Parameters:
        """Of what is linear."""
        return Parameters(mean, covariance, np.zeros((len(mean), 3)))


class Rows(NamedTuple):
    """Estimates after each of K cycles; NaN where nothing can be said."""

    parameters: Parameters
    innovation: Array
    """(K, 6) torque [N m] and force [N]."""
    sigma: Array
    """(K, 6)"""
    normalised: Array
    """(K, 6)"""

    @staticmethod
    def untold(count: int) -> Rows:
        """Of so many cycles of which nothing is said."""
        nothing = [np.full((count, *shape), np.nan) for shape in ((10,), (10, 10), (3,), (6,), (6,), (6,))]
        return Rows(Parameters(*nothing[:3]), *nothing[3:])

    def last(self) -> Rows:
        """The last row alone."""
        return Rows(Parameters(*(part[-1:] for part in self.parameters)), *(part[-1:] for part in self[1:]))

    def ending(self, found: Parameters) -> Rows:
        """With another estimate in the last row."""
        both = zip(self.parameters, found, strict=True)
        return self._replace(parameters=Parameters(*(np.concatenate([own[:-1], new]) for own, new in both)))


class TriangleSolution(NamedTuple):
    """What K triangles on θ's departure tell of it."""

    root: Array
    """(K, 10, 10) of the covariance by the data alone."""
    step: Array
    """(K, 10, 1 + e) the departure, and what assumptions do to it."""
    theta: Array
    """(K, 10) θ, what isn't told kept near where the search began."""
    sigma: Array
    """(K, 10) of each by the data alone."""


@dataclass(frozen=True)
class Posed:
    """What K cycles say about θ, linear about one."""

    theta: Array
    """(10,)"""
    scale: Array
    """(10,) prior sigmas, in which its departure is counted."""
    rows: Array
    """(K, 6, n + 11 + e) on n nuisances and θ's departure; measured, and by assumptions."""
    triangles: Array
    """(K + 1, n + 10, n + 11 + e) before the cycles and after each."""
    told: TriangleSolution
    """Of the triangles after each cycle."""

    def first(self, count: int) -> Posed:
        """Of so many cycles."""
        told = TriangleSolution(*(part[:count] for part in self.told))
        return replace(self, rows=self.rows[:count], triangles=self.triangles[: count + 1], told=told)
