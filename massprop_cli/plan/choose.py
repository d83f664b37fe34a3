"""Which motions, and how long each: greedy, then exchanged, by the worst ratio of the sigma that is predicted to the one that is wanted."""

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
"""Information on the quantities over their natural size before anything is flown: a hundred times that is the sigma, as the estimator's."""
SHARP = 8
"""Power of the mean of ratios that stands for the worst: it still falls where one step corrects what isn't worst yet."""
SIGNED = ("ixx", "iyy", "izz", "mass")
"""Quantities that are above 0 for any body."""
SWEEPS = 4
"""Most rounds of exchanges."""


Criterion = Literal["worst", "a", "d"]
"""What of the wanted quantities is made small."""


@dataclass(frozen=True)
class PlanGoal:
    """What is wanted, and of which bodies."""

    requirements: tuple[Requirement, ...]
    bodies: Array
    """(G, 10)"""
    vehicle: Vehicle
    """For the uncertainty of its thrust, and what of it is known."""
    beyond: Array = field(default_factory=lambda: np.ones(10))
    """(10,) how many times the bound a sigma is, through what no bound counts (:func:`massprop_cli.plan.rehearsal.beyond_bound`)."""

    @property
    def limits(self) -> Array:
        """(G, n) sigmas that are wanted, in units. A part of a product or of a CG coordinate is one of the guess: others may have none."""
        rows = []
        for body in self.bodies:
            own = [body if item.quantity in SIGNED else self.bodies[0] for item in self.requirements]
            pairs = zip(self.requirements, self.index, own, strict=True)
            rows.append([item.precision.sigma(values[i]) for item, i, values in pairs if item.precision])
        return np.array(rows)

    @property
    def index(self) -> list[int]:
        """Of the wanted quantities."""
        return [QUANTITIES.index(item.quantity) for item in self.requirements]

    def sigmas(self, information: Array) -> Array:
        """(…, G, 10) sigmas in units, from information (…, G, n, n) in natural sizes, n as of :meth:`covariance`."""
        covariance = self.covariance(information)
        return np.asarray(np.sqrt(np.einsum("...ii->...i", covariance)))

    def covariance(self, information: Array) -> Array:
        """(…, G, 10, 10) in units, with the common uncertainty of the thrust and what is known.

        ``information`` (…, G, n, n) is on the ten quantities and on the rate at the start, or without that. With momentum devices its last
        column is of the thrust's scale, in its sigmas: they may calibrate it.
        """
        prior = PRIOR * np.eye(information.shape[-1])
        if self.vehicle.spinning:
            prior[-1, -1] = 1.0
        sizes = np.array([natural_sizes(body) for body in self.bodies])
        sizes = sizes * self.beyond
        bound = np.linalg.inv(information + prior)[..., :10, :10] * (sizes[:, :, None] * sizes[:, None, :])
        for g, body in enumerate(self.bodies):
            proportional = by_scale(body, self.vehicle)
            bound[..., g, :, :] += open_scale(self.vehicle) ** 2 * np.outer(proportional, proportional)
        for name, known in self.vehicle.known.items():
            column = bound[..., QUANTITIES.index(name)]
            gain = column / (column[..., QUANTITIES.index(name)] + known.sigma**2)[..., None]
            bound = bound - gain[..., :, None] * column[..., None, :]
        return np.asarray(bound)

    def ratios(self, information: Array) -> Array:
        """(…, G, n) sigma that is predicted over the one that is wanted."""
        return np.asarray(self.sigmas(information)[..., self.index] / self.limits)

    def score(self, information: Array, criterion: Criterion) -> Array:
        """(…,) what is made small."""
        if criterion == "d":
            chosen = self.index
            covariance = self.covariance(information)[..., chosen, :][..., chosen]
            scaled = covariance / (self.limits[:, :, None] * self.limits[:, None, :])
            return np.asarray(np.linalg.slogdet(scaled)[1].max(-1))
        ratios = self.ratios(information)
        if criterion == "a":
            return np.asarray((ratios**2).mean(-1).max(-1))
        return np.asarray((ratios**SHARP).sum((-1, -2)) ** (1 / SHARP))


@dataclass(frozen=True)
class Tried:
    """A motion, flown for a block of cycles with every body."""

    motion: Manoeuvre
    information: Array
    """(G, 10 or 11, the same) in natural sizes; the rate at its start counts as unknown."""
    used: dict[str, float]
    """The most of any body."""


def choose(
    tried: Sequence[Tried],
    wanted: PlanGoal,
    criterion: Criterion,
    most: int,
    enough: float,
    fits: Callable[[Sequence[int]], bool],
    start: Sequence[int] = (),
) -> list[int]:
    """Blocks by number in ``tried``, greedy, then exchanged, to ratios of ``enough`` or ``most`` blocks; ``fits`` limits their sum."""
    told = np.array([one.information for one in tried])
    chosen = [*start]
    while len(chosen) < most:
        options = [i for i in range(len(tried)) if fits([*chosen, i])]
        if not options:
            break
        scores = wanted.score(_sum(told, chosen) + told[options], criterion)
        chosen.append(options[int(np.argmin(scores))])
        chosen = _exchanged(told, chosen, wanted, criterion, fits)
        if wanted.ratios(_sum(told, chosen)).max() <= enough:
            break
    return sorted(chosen, key=chosen.index)


def _sum(told: Array, chosen: Sequence[int]) -> Array:
    return np.asarray(told[list(chosen)].sum(0) if chosen else np.zeros(told.shape[1:]))


def _exchanged(told: Array, chosen: list[int], wanted: PlanGoal, criterion: Criterion, fits: Callable[[Sequence[int]], bool]) -> list[int]:
    """Each kind of block in turn for whichever other does better, until none does."""
    best = float(wanted.score(_sum(told, chosen), criterion))
    for _ in range(SWEEPS):
        before = best
        for old in dict.fromkeys(chosen):
            rest = [*chosen]
            rest.remove(old)
            scores = wanted.score(_sum(told, rest) + told, criterion)
            for new in np.argsort(scores):
                if not scores[new] < best - 1e-4 * abs(best):
                    break
                if fits([*rest, int(new)]):
                    chosen, best = [*rest, int(new)], float(scores[new])
                    break
        if best >= before - 1e-4 * abs(before):
            break
    return chosen
