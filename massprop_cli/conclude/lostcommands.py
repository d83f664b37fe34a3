"""Lost commands test: commands that the vehicle did not execute, as where packets are lost.

Their steps are missing from the motion, so that mass and inertia come out too large by the part that is lost; a disturbance that is sized
for what is left takes it for noise, which has no sign. Cycle by cycle the log says how much less than commanded came, ``u``, standard
normal where nothing is missing and ``−√c`` on the average where all is, c being the command's own power over the noise. With a part p of
the commands lost the likelihood grows by

    L = Σ log(1 − p + p exp(−√c u − c/2)),

which few cycles in many tell, though none by itself. Pulses that scatter about what they should give leave squares that grow with c,

    V = Σ (u² s² c / (1 + s² c) − log(1 + s² c)) / 2,

with a relative scatter s, and no bias: the likelier of the two is taken.
"""

import numpy as np

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array, median
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, share
from massprop_cli.model.plant import plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import BLOCK, Source, gathered

LOST, SCATTER = np.geomspace(1e-3, 0.3, 13), np.geomspace(0.005, 1.0, 13)
"""Parts p of the commands, and relative scatters s, that are tried."""
SURE = -float(np.log(share(DOUBTFUL, len(LOST))))
"""L beyond which some are lost. It is the log of a likelihood ratio, whose mean is 1 where none is and noise is white and normal, so chance
passes −log of a probability with that probability at most (Markov)."""
FAINT = 1e-9
"""Power of a command below which it tells nothing."""
NORMAL = 1.4826
"""One standard deviation of a normal over its median deviation."""
MOST = 600.0
"""Of an exponent."""


def unexecuted(history: History, samples: Source, used: Resolved) -> dict[str, Reason]:
    """Why values are not to be called converged that rest on commands of which some seem to have been lost, by quantity."""
    if history.reference is None or history.residual is None or used.spinning or used.rotors:
        return {}
    if (
        used.estimates_assumptions
    ):  # what single jets do otherwise than stated is found with the values, and stands in what they leave alone
        return {}
    along, power = _missing(history, samples, used)
    told = power > FAINT
    if not told.any():
        return {}
    if max(lost(along[told], power[told])) < max(SURE, scattered(along[told], power[told])):
        return {}
    return dict.fromkeys((*INERTIA, "mass"), Reason("commands-lost"))


def lost(along: Array, power: Array) -> list[float]:
    """L for each part p of ``LOST``, of what is left along each cycle's commands, u √c (K,), and their ``power`` c (K,), above 0."""
    ratio = np.minimum(-along - power / 2, MOST)
    return [float(np.log1p(p * np.expm1(ratio)).sum()) for p in LOST]


def scattered(along: Array, power: Array) -> float:
    """The largest V of any scatter s of ``SCATTER``, of the same."""
    grown = [s**2 * power for s in SCATTER]
    return max(float((along**2 / power * more / (1 + more) - np.log1p(more)).sum()) / 2 for more in grown)


def _missing(history: History, samples: Source, used: Resolved) -> tuple[Array, Array]:
    """(K,) each: what is left along what each cycle's commands should have done, and the power of that, both over the noise's power."""
    assert history.reference is not None
    assert history.residual is not None
    cycles, plant = history.cycles, plant_of(used)
    moment, turning = plant.jet_moment(history.reference), plant.inverse_inertia(plant.theta(history.reference))
    left, sigma = history.residual
    unknown = gathered(samples, cycles, lambda here: here.executed.uncommanded)
    left = np.where((unknown | np.append(False, unknown[:-1]))[:, None], np.nan, left)
    count = cycles.stop - cycles.start
    along, power = np.zeros(count), np.zeros(count)
    noise = np.array([_noise(left[:, axis], sigma[:, axis]) for axis in range(6)])
    for first in range(0, count, BLOCK):
        part, after = slice(first, min(first + BLOCK, count)), slice(first + 1, min(first + BLOCK, count - 1) + 1)
        here = samples.part(slice(cycles.start + part.start, cycles.start + part.stop)).executed
        turned = [each @ (turning @ moment).T for each in (here.falling, here.rising)]
        pushed = history.reference.mu * here.whole[:, 3:] / here.duration_s[:, None]
        # a cycle's commands turn the body in the step into it and in the one that follows, and push it while they act
        for effect, rows, axes in ((turned[0], part, slice(0, 3)), (turned[1], after, slice(0, 3)), (pushed, part, slice(3, 6))):
            scale = noise[axes] * sigma[rows, axes]
            seen = np.isfinite(left[rows, axes]) & (scale > 0)
            expected = np.divide(effect[: len(scale)], scale, out=np.zeros_like(scale), where=seen)
            found = np.divide(left[rows, axes], scale, out=np.zeros_like(scale), where=seen)
            own = slice(first, first + len(scale))
            along[own] += (found * expected).sum(1)
            power[own] += (expected**2).sum(1)
    return along, power


def _noise(left: Array, sigma: Array) -> float:
    """By how much what is left scatters, over what is expected of it; not by what a few cycles leave."""
    told = np.isfinite(left) & (sigma > 0)
    return NORMAL * median(np.abs(left[told] / sigma[told])) if told.any() else 0.0
