"""Choice of motions and durations by greedy search and exchange; the default criterion is the worst ratio of predicted to wanted sigma."""

from collections.abc import Callable, Sequence
from dataclasses import field
from typing import Literal

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.estimate.quantities import by_scale, open_scale
from massprop_cli.inputs.require import Requirement
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.plan.motions import Manoeuvre
from massprop_cli.testbed.bound import natural_sizes

PRIOR = 1e-4
"""Prior information on the quantities in natural sizes, as in the estimator: the prior sigma is 100 natural sizes."""
NORM = 8
"""Order of the norm that approximates the worst ratio; unlike the maximum, it also decreases with a ratio that is not the worst."""
SIGNED = ("ixx", "iyy", "izz", "mass")
"""Quantities that are positive for any body."""
SWEEPS = 4
"""Largest number of exchange rounds."""


Criterion = Literal["worst", "a", "d"]
"""Minimised function of the ratios of predicted to wanted sigma: norm of order :data:`NORM`, mean square, or log determinant."""


@dataclass(frozen=True)
class PlanGoal:
    """The required precisions, and the bodies for which a plan must reach them."""

    requirements: tuple[Requirement, ...]
    bodies: Array
    """(G, 10) quantities of each body, the guess first, SI."""
    vehicle: Vehicle
    """Vehicle whose thrust-scale sigma and known values the predicted covariance includes."""
    bound_ratio: Array = field(default_factory=lambda: np.ones(10))
    """(10,) ratio of an estimate's sigma to its Cramér–Rao bound (:func:`massprop_cli.plan.rehearsal.beyond_bound`), without ``floor``."""
    floor: Array = field(default_factory=lambda: np.zeros(10))
    """(10,) sigmas that remain after any duration, as what only a prior tells."""

    @property
    def limits(self) -> Array:
        """(G, n) wanted sigmas, SI.

        For a product of inertia or a CG coordinate, a relative precision refers to the guess, since it may be 0 for another body.
        """
        rows = []
        for body in self.bodies:
            references = [body if item.quantity in SIGNED else self.bodies[0] for item in self.requirements]
            pairs = zip(self.requirements, self.index, references, strict=True)
            rows.append([item.precision.sigma(values[i]) for item, i, values in pairs if item.precision])
        return np.array(rows)

    @property
    def index(self) -> list[int]:
        """Indices of the wanted quantities in QUANTITIES."""
        return [QUANTITIES.index(item.quantity) for item in self.requirements]

    def sigmas(self, information: Array) -> Array:
        """(…, G, 10) predicted sigmas, SI, from ``information`` as in :meth:`covariance`."""
        covariance = self.covariance(information)
        return np.asarray(np.sqrt(np.einsum("...ii->...i", covariance)))

    def covariance(self, information: Array) -> Array:
        """(…, G, 10, 10) predicted covariance, SI, with the thrust-scale uncertainty and the known values.

        ``information`` (…, G, n, n) is the information matrix of the ten quantities in natural sizes, with or without the initial rate.
        With momentum devices, its last parameter is the thrust scale in units of its sigma, because the log may calibrate it.
        """
        prior = PRIOR * np.eye(information.shape[-1])
        if self.vehicle.spinning:
            prior[-1, -1] = 1.0
        sizes = np.array([natural_sizes(body) for body in self.bodies])
        sizes = sizes * self.bound_ratio
        bound = np.linalg.inv(information + prior)[..., :10, :10] * (sizes[:, :, None] * sizes[:, None, :])
        bound = bound + np.diag(self.floor**2)
        for g, body in enumerate(self.bodies):
            proportional = by_scale(body, self.vehicle)
            bound[..., g, :, :] += open_scale(self.vehicle) ** 2 * np.outer(proportional, proportional)
        for name, known in self.vehicle.known.items():
            column = bound[..., QUANTITIES.index(name)]
            gain = column / (column[..., QUANTITIES.index(name)] + known.sigma**2)[..., None]
            bound = bound - gain[..., :, None] * column[..., None, :]
        return np.asarray(bound)

    def ratios(self, information: Array) -> Array:
        """(…, G, n) ratio of predicted to wanted sigma."""
        return np.asarray(self.sigmas(information)[..., self.index] / self.limits)

    def score(self, information: Array, criterion: Criterion) -> Array:
        """(…,) value of the criterion over all bodies; a plan minimises it."""
        if criterion == "d":
            index = self.index
            covariance = self.covariance(information)[..., index, :][..., index]
            scaled = covariance / (self.limits[:, :, None] * self.limits[:, None, :])
            return np.asarray(np.linalg.slogdet(scaled)[1].max(-1))
        ratios = self.ratios(information)
        if criterion == "a":
            return np.asarray((ratios**2).mean(-1).max(-1))
        return np.asarray((ratios**NORM).sum((-1, -2)) ** (1 / NORM))


@dataclass(frozen=True)
class Candidate:
    """A motion for one block of cycles, simulated with all bodies."""

    motion: Manoeuvre
    information: Array
    """(G, 10 or 11, 10 or 11) information matrix in natural sizes, with the initial rate eliminated as a nuisance parameter."""
    used: dict[str, float]
    """Largest use of each limit over all bodies, by name."""


def choose(
    candidates: Sequence[Candidate],
    goal: PlanGoal,
    criterion: Criterion,
    most: int,
    enough: float,
    allowed: Callable[[Sequence[int]], bool],
    start: Sequence[int] = (),
) -> list[int]:
    """Choose blocks by greedy addition, each followed by exchanges; blocks are indices of ``candidates``.

    The search ends at ``most`` blocks, at ratios of ``enough``, or when ``allowed`` permits no further block. It begins with ``start``.
    """
    information = np.array([one.information for one in candidates])
    chosen = [*start]
    while len(chosen) < most:
        options = [i for i in range(len(candidates)) if allowed([*chosen, i])]
        if not options:
            break
        scores = goal.score(_sum(information, chosen) + information[options], criterion)
        chosen.append(options[int(np.argmin(scores))])
        chosen = _exchanged(information, chosen, goal, criterion, allowed)
        if goal.ratios(_sum(information, chosen)).max() <= enough:
            break
    return sorted(chosen, key=chosen.index)


def _sum(information: Array, chosen: Sequence[int]) -> Array:
    """Information matrices of the chosen blocks, added."""
    return np.asarray(information[list(chosen)].sum(0) if chosen else np.zeros(information.shape[1:]))


def _exchanged(
    information: Array, chosen: list[int], goal: PlanGoal, criterion: Criterion, allowed: Callable[[Sequence[int]], bool]
) -> list[int]:
    """Replace one block of each motion in turn by the best allowed candidate, until no exchange improves the score."""
    best = float(goal.score(_sum(information, chosen), criterion))
    for _ in range(SWEEPS):
        before = best
        for old in dict.fromkeys(chosen):
            others = [*chosen]
            others.remove(old)
            scores = goal.score(_sum(information, others) + information, criterion)
            for new in np.argsort(scores):
                if not scores[new] < best - 1e-4 * abs(best):
                    break
                if allowed([*others, int(new)]):
                    chosen, best = [*others, int(new)], float(scores[new])
                    break
        if best >= before - 1e-4 * abs(before):
            break
    return chosen
