"""Residuals of rates and specific force after a fit of the mass properties to each segment of the log."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.levels import LONG
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import linearise
from massprop_cli.model.parameters import parameters, stepped
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.compensate import Source


class SegmentResiduals(NamedTuple):
    """Residuals of n rows, and which of them count."""

    value: Array
    """(n, 3), 0 where the reading is not used."""
    used: BoolArray
    """(n, 3) whether the reading is used."""

    @property
    def axes(self) -> BoolArray:
        """(3,) axes with any used reading."""
        return np.asarray(self.used.any(0))

    @property
    def variance(self) -> Array:
        """(3,) mean square."""
        return _mean(self.value**2, self.used)

    @property
    def lagged(self) -> Array:
        """(3,) lag-one autocovariance, from neighbours that are both used."""
        return _mean(self.value[1:] * self.value[:-1], self._both)

    @property
    def stepped(self) -> Array:
        """(3,) mean squared difference of neighbours that are both used."""
        return _mean(np.diff(self.value, axis=0) ** 2, self._both)

    @property
    def _both(self) -> BoolArray:
        return self.used[1:] & self.used[:-1]

    @staticmethod
    def of(parts: Sequence[tuple[Array, BoolArray]]) -> SegmentResiduals:
        """Residuals of consecutive segments."""
        return SegmentResiduals(np.concatenate([value for value, _ in parts]), np.concatenate([used for _, used in parts]))


def _mean(values: Array, used: BoolArray) -> Array:
    """(3,) means of the used values of (n, 3)."""
    return np.asarray((values * used).sum(0) / np.maximum(np.count_nonzero(used, 0), 1))


def residual_force(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> SegmentResiduals:
    """(K, 3) specific force that no mass properties near ``reference`` explain, m/s²; each segment has its own."""
    parts = []
    for segment in _segments(cycles):
        system = linearise(samples, segment, reference, vehicle)
        used = ~samples.part(segment).executed.ignored[:, 3:]
        parts.append((_fit(system.observation[:, 3:, _constant_states(samples, vehicle)], system.specific_force, used)[1], used))
    return SegmentResiduals.of(parts)


def _segments(cycles: slice) -> list[slice]:
    """Segments of equal length, no longer than :data:`LONG`."""
    count = cycles.stop - cycles.start
    edges = np.linspace(cycles.start, cycles.stop, -(-count // LONG) + 1).astype(int)
    return [slice(int(first), int(end)) for first, end in pairwise(edges)]


def _fit(regressors: Array, target: Array, used: BoolArray) -> tuple[Array, Array]:
    """Least squares of the ``used`` rows of ``target`` (K, 3) on ``regressors`` (K, 3, n): (n,) coefficients and (K, 3) residuals."""
    regressors, target = regressors * used[..., None], target * used
    rows = regressors.reshape(-1, regressors.shape[-1])
    size = np.sqrt((rows**2).sum(0))
    size = np.where(size > 0, size, 1.0)
    basis, triangle = np.linalg.qr(rows / size)
    step = np.linalg.lstsq(triangle, basis.T @ target.ravel(), rcond=1e-9)[0] / size
    return step, target - (rows @ step).reshape(target.shape)


def residual_growth(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> SegmentResiduals:
    """(K − 1, 3) growth of the mean rate that no mass properties near ``reference`` explain, rad/s; each segment has its own.

    Two Gauss–Newton steps.
    """
    parts = []
    for segment in _segments(slice(cycles.start, cycles.stop - 1)):
        piece, about = slice(segment.start, segment.stop + 1), reference
        here = samples.part(piece)
        growth, read = np.diff(here.rate_rad_s, axis=0), ~here.executed.ignored[:, :3]
        used = read[1:] & read[:-1]
        residual = growth * used
        for _ in range(2):
            system = linearise(samples, piece, about, vehicle)
            if not np.isfinite(system.transition).all():
                break  # fast rotation diverges about a reference that is far off
            step, residual = _fit(system.transition[:, RATE][..., _constant_states(samples, vehicle)], growth - system.steps, used)
            about = stepped(about, parameters(about) + step[PARAMETERS]) or about
        parts.append((residual, used))
    return SegmentResiduals.of(parts)


def _constant_states(samples: Source, vehicle: Vehicle) -> list[int]:
    """Indices of the constant states that explain the motion: mass properties, damping, and scales with momentum devices."""
    layout = Layout.of(samples, vehicle)
    return [*range(PARAMETERS.stop), *range(layout.damping.start, layout.damping.stop), *range(layout.scale.start, layout.scale.stop)]
