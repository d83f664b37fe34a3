"""Joint off-line fit of several logs of one body: the triangles of all members stacked.

A log's response is linear in the coefficients φ of :mod:`massprop_cli.model.responsemap` whatever the body is, so its rows on φ, with the
beginnings of its own states taken out, add up, and θ is solved for from all of them. So a log in which one axis alone was driven brings
what it tells, where by itself it has no estimate. Assumptions that are uncertain in all logs are the same columns of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.estimate import offline
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.rows import Parameters
from massprop_cli.estimate.triangle import Run
from massprop_cli.model.layout import Layout
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

TOLD = 2.0
"""Information on a direction of θ, with that of the prior as 1, from which on a log counts as telling it."""


class Member(NamedTuple):
    """One phase of one log."""

    samples: Source
    cycles: slice
    vehicle: Resolved
    """Its disturbances count."""
    consider: Consider


class JointFit(NamedTuple):
    """What all members say together."""

    told: Parameters
    """One row."""
    reference: Reference
    stands: bool
    """Whether another pass would change nothing."""
    left: float
    """Chi-square of all that the fit leaves."""
    apart: tuple[tuple[float, int], ...]
    """Of each member: how much less chi-square it would have with a body of its own, and how many directions of θ it tells."""


class Jointly(Regression):
    """The regression on what several have taken in."""

    def __init__(self, members: Sequence[Member]) -> None:
        first = members[0]
        super().__init__(first.samples, first.cycles, first.vehicle, max((m.consider for m in members), key=lambda c: len(c.variants)))
        # beginnings are each member's own, and taken out
        self.free = 0
        self.members = [Regression(*member) for member in members]

    def fit(self, start: Reference) -> JointFit:
        """Gauss–Newton from ``start``, about its own last estimate until that stands still."""
        biases = [start.gyro_bias for _ in self.members]
        reference, bound = replace(start, gyro_bias=np.zeros(3)), False
        for _ in range(offline.SETTLINGS):
            runs = [self._through(own, replace(reference, gyro_bias=bias), bound) for own, bias in zip(self.members, biases, strict=True)]
            run = self.improved(self._together(runs, reference, bound))
            if run.bound == bound and self.still(run, offline.SETTLED):
                break
            reference, bound = run.estimate, run.bound
            phi, _ = self.phi_map.coefficients(self.phi_map.plant.theta(reference))
            biases = [_bias(own, one, phi) for own, one in zip(self.members, runs, strict=True)]
        stands, theta = self.still(run, offline.SETTLED), self.phi_map.plant.theta(run.estimate)
        corner = self._posed(run, theta, self._scale(theta))[-1 - self.assumed, -1 - self.assumed]
        apart = tuple(self._apart(own, one, run) for own, one in zip(self.members, runs, strict=True))
        return JointFit(self.row(run), run.estimate, stands, float(corner**2), apart)

    @staticmethod
    def _through(own: Regression, reference: Reference, bound: bool) -> Run:
        """All that a member has said, about a reference."""
        run = replace(own.begin(reference), bound=bound)
        for block in offline.blocks(own, run):
            run = block.after
        return run

    def _together(self, runs: Sequence[Run], reference: Reference, bound: bool) -> Run:
        rows = [self._of_phi(own, run) for own, run in zip(self.members, runs, strict=True)]
        return replace(runs[0], reference=reference, estimate=reference, bound=bound, state=None, triangle=triangle_of(np.vstack(rows)))

    def _of_phi(self, own: Regression, run: Run) -> Array:
        """A member's rows on φ, what is measured, and the assumptions: below those that hold its beginnings."""
        rows = run.triangle[own.free :, own.free :]
        missing = self.phi_map.size + 1 + self.assumed - rows.shape[1]
        return np.pad(rows, ((0, 0), (0, missing)))

    def _apart(self, own: Regression, one: Run, run: Run) -> tuple[float, int]:
        theta = self.phi_map.plant.theta(run.estimate)
        scale = self._scale(theta)
        alone = replace(run, triangle=self._of_phi(own, one), bound=True)
        triangle = self._posed(alone, theta, scale)
        by_theta, left = triangle[:10, :10], triangle[:10, 10]
        return float(left @ left), int((np.linalg.svd(by_theta, compute_uv=False) ** 2 > TOLD).sum())


def _bias(own: Regression, run: Run, phi: Array) -> Array:
    """(3,) the gyro's, of a member whose vehicle file says that it has one, for the body with coefficients ``phi``."""
    triangle, free, size = run.triangle, own.free, own.phi_map.size
    beginnings = np.linalg.solve(triangle[:free, :free], triangle[:free, free + size] - triangle[:free, free : free + size] @ phi)
    return own.state(run, Layout.of(own.samples, own.vehicle).gyro_bias, phi, beginnings, run.reference.gyro_bias)
