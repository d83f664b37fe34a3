"""Joint off-line fit of several logs of one body: the information triangles of all members, stacked.

A log's response is linear in the coefficients φ of :mod:`massprop_cli.model.responsemap` for any body. With each member's initial states
eliminated, the rows on φ of all members add up, and θ follows from all of them. So a log in which one axis alone was excited contributes,
although it has no estimate by itself. An assumption that is uncertain in all logs is one column for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.levels import ITERATIONS
from massprop_cli.estimate import offline
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.rows import Parameters
from massprop_cli.estimate.triangle import Run
from massprop_cli.model.layout import Layout
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source

INFORMED = 2.0
"""Information on a direction of θ, relative to the prior's, above which a log informs that direction."""


class Member(NamedTuple):
    """One phase of one log, as part of a joint fit."""

    samples: Source
    cycles: slice
    vehicle: Resolved
    """With the disturbances of this log."""
    consider: Consider


class JointFit(NamedTuple):
    """Joint estimate of all members."""

    parameters: Parameters
    """One row."""
    reference: Reference
    converged: bool
    """Whether another pass would not change the estimate."""
    chi_square: float
    """Of the post-fit residuals of all members."""
    apart: tuple[tuple[float, int], ...]
    """For each member: decrease of its chi-square with a body of its own, and number of directions of θ that it informs."""


class Jointly(Regression):
    """Regression on the information of several members."""

    def __init__(self, members: Sequence[Member]) -> None:
        first = members[0]
        super().__init__(first.samples, first.cycles, first.vehicle, max((m.consider for m in members), key=lambda c: len(c.variants)))
        # initial states are each member's own, and eliminated
        self.unknowns = 0
        self.members = [Regression(*member) for member in members]

    def fit(self, start: Reference) -> JointFit:
        """Gauss–Newton iteration from ``start``, linearised about its own last estimate until that converges."""
        biases = [start.gyro_bias for _ in self.members]
        reference, tied = replace(start, gyro_bias=np.zeros(3)), False
        for _ in range(ITERATIONS):
            references = [replace(reference, gyro_bias=bias) for bias in biases]
            runs = [self._processed(member, about, tied) for member, about in zip(self.members, references, strict=True)]
            run = self.solved(self._stacked(runs, reference, tied))
            if converged := run.tied == tied and self.converged(run, offline.CONVERGED):
                break
            reference, tied = run.estimate, run.tied
            phi, _ = self.phi_map.coefficients(self.phi_map.plant.theta(reference))
            biases = [_bias(member, one, phi) for member, one in zip(self.members, runs, strict=True)]
        theta = self.phi_map.plant.theta(run.estimate)
        corner = self._posed(run, theta, self._prior_sigma(theta))[-1 - self.assumptions, -1 - self.assumptions]
        apart = tuple(self._apart(member, one, run) for member, one in zip(self.members, runs, strict=True))
        return JointFit(self.row(run), run.estimate, converged, float(corner**2), apart)

    @staticmethod
    def _processed(member: Regression, reference: Reference, tied: bool) -> Run:
        """The run through a member's whole phase, about ``reference``."""
        run = replace(member.begin(reference), tied=tied)
        for block in offline.blocks(member, run):
            run = block.after
        return run

    def _stacked(self, runs: Sequence[Run], reference: Reference, tied: bool) -> Run:
        rows = [self._rows_on_phi(member, run) for member, run in zip(self.members, runs, strict=True)]
        return replace(runs[0], reference=reference, estimate=reference, tied=tied, state=None, triangle=triangle_of(np.vstack(rows)))

    def _rows_on_phi(self, member: Regression, run: Run) -> Array:
        """A member's rows on φ, measured value, assumptions and geometry, with its initial states eliminated."""
        rows = run.triangle[member.unknowns :, member.unknowns :]
        found = np.zeros((len(rows), self.phi_map.size + 1 + self.assumptions + self.geometry_unknowns))
        known = self.phi_map.size + 1 + member.assumptions
        found[:, :known] = rows[:, :known]
        found[:, found.shape[1] - member.geometry_unknowns :] = rows[:, known:]
        return found

    def _apart(self, member: Regression, own: Run, run: Run) -> tuple[float, int]:
        """Decrease of a member's chi-square with a body of its own, and number of directions of θ that it informs."""
        theta = self.phi_map.plant.theta(run.estimate)
        scale = self._prior_sigma(theta)
        alone = replace(run, triangle=self._rows_on_phi(member, own), tied=True)
        triangle = self._posed(alone, theta, scale)
        first = self.geometry_unknowns
        by_theta, right = triangle[first : first + 10, first : first + 10], triangle[first : first + 10, first + 10]
        return float(right @ right), int((np.linalg.svd(by_theta, compute_uv=False) ** 2 > INFORMED).sum())


def _bias(member: Regression, run: Run, phi: Array) -> Array:
    """(3,) gyro bias of a member for the body with coefficients ``phi``; the reference's if it has no bias state."""
    triangle, m, size = run.triangle, member.unknowns, member.phi_map.size
    initial = np.linalg.solve(triangle[:m, :m], triangle[:m, m + size] - triangle[:m, m : m + size] @ phi)
    return member.state(run, Layout.of(member.samples, member.vehicle).gyro_bias, phi, initial, run.reference.gyro_bias)
