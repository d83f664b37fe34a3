"""Residuals of rates and specific force about a reference, and the change of the mass properties that would explain most of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import linearise
from massprop_cli.model.parameters import parameters, stepped
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.compensate import Source

STRETCH = 4096
"""Most cycles over which one body is to explain what it can, before what is left is looked at."""


class Left(NamedTuple):
    """What is left of a measurement, and of which rows: nothing is of readings that are not used."""

    rest: Array
    """(n, 3), 0 where nothing was read."""
    read: BoolArray
    """(n, 3)"""

    @property
    def axes(self) -> BoolArray:
        """(3,) of which anything was read."""
        return np.asarray(self.read.any(0))

    @property
    def variance(self) -> Array:
        """(3,) mean square of what was read."""
        return _mean(self.rest**2, self.read)

    @property
    def lagged(self) -> Array:
        """(3,) mean product of neighbours that were both read."""
        return _mean(self.rest[1:] * self.rest[:-1], self._both)

    @property
    def stepped(self) -> Array:
        """(3,) mean squared difference of the same."""
        return _mean(np.diff(self.rest, axis=0) ** 2, self._both)

    @property
    def _both(self) -> BoolArray:
        return self.read[1:] & self.read[:-1]

    @staticmethod
    def of(parts: Sequence[tuple[Array, BoolArray]]) -> Left:
        """One after the other."""
        return Left(np.concatenate([rest for rest, _ in parts]), np.concatenate([read for _, read in parts]))


def _mean(values: Array, read: BoolArray) -> Array:
    """(3,) of those of (n, 3) that were read."""
    return np.asarray((values * read).sum(0) / np.maximum(np.count_nonzero(read, 0), 1))


def unfelt(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Left:
    """Of K cycles, specific force that no mass properties near ``reference`` explain, m/s²; each stretch of the log has its own."""
    found = []
    for stretch in _stretches(cycles):
        system = linearise(samples, stretch, reference, vehicle)
        used = ~samples.part(stretch).executed.ignored[:, 3:]
        found.append((_fit(system.observation[:, 3:, _told(samples, vehicle)], system.specific_force, used)[1], used))
    return Left.of(found)


def _stretches(cycles: slice) -> list[slice]:
    """Cycles in parts of equal length, no longer than :data:`STRETCH`."""
    count = cycles.stop - cycles.start
    edges = np.linspace(cycles.start, cycles.stop, -(-count // STRETCH) + 1).astype(int)
    return [slice(int(first), int(end)) for first, end in pairwise(edges)]


def _fit(regressors: Array, target: Array, used: BoolArray) -> tuple[Array, Array]:
    """Least squares of ``target`` (K, 3) on ``regressors`` (K, 3, 10): (10,) coefficients and (K, 3) the rest, of ``used`` (K, 3) rows."""
    regressors, target = regressors * used[..., None], target * used
    rows = regressors.reshape(-1, regressors.shape[-1])
    size = np.sqrt((rows**2).sum(0))
    size = np.where(size > 0, size, 1.0)
    basis, triangle = np.linalg.qr(rows / size)
    step = np.linalg.lstsq(triangle, basis.T @ target.ravel(), rcond=1e-9)[0] / size
    return step, target - (rows @ step).reshape(target.shape)


def residual_growth(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Left:
    """Of K − 1 steps, growth of the mean rate that no mass properties near ``reference`` explain, rad/s: two Gauss–Newton steps.

    Each stretch of a long log has its own.
    """
    found = []
    for stretch in _stretches(slice(cycles.start, cycles.stop - 1)):
        piece, near = slice(stretch.start, stretch.stop + 1), reference
        here = samples.part(piece)
        growth, read = np.diff(here.rate_rad_s, axis=0), ~here.executed.ignored[:, :3]
        used = read[1:] & read[:-1]
        left = growth * used
        for _ in range(2):
            system = linearise(samples, piece, near, vehicle)
            if not np.isfinite(system.transition).all():
                break  # beside a body that is far off, fast turns run away
            step, left = _fit(system.transition[:, RATE][..., _told(samples, vehicle)], growth - system.steps, used)
            near = stepped(near, parameters(near) + step[PARAMETERS]) or near
        found.append((left, used))
    return Left.of(found)


def _told(samples: Source, vehicle: Vehicle) -> list[int]:
    """Which states explain motion for good: mass properties, damping, and scales beside wheels."""
    layout = Layout.of(samples, vehicle)
    return [*range(PARAMETERS.stop), *range(layout.damping.start, layout.damping.stop), *range(layout.scale.start, layout.scale.stop)]
