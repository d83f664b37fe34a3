"""Lost commands test: likelihood ratio of "a part p of the commands was not executed" against "all were executed".

Lost commands bias mass and inertia high by the part lost; an estimated disturbance treats their residuals as noise. The normalised residual
u of a cycle along the response to its commands is standard normal if they were executed, and has the mean −√c if they were lost. c is the
power of the response over the noise. The log likelihood ratio is

    L = Σ log(1 − p + p exp(−√c u − c/2)).

The alternative is a relative scatter s of the pulses, which causes no bias and has the log likelihood ratio

    V = Σ (u² s² c / (1 + s² c) − log(1 + s² c)) / 2.

Commands count as lost if the largest L exceeds the threshold and the largest V.
"""

import numpy as np

from massprop_cli import INERTIA
from massprop_cli.base.arrays import NORMAL_MEDIAN, ROUNDING, Array, median
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, share
from massprop_cli.model.plant import plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import BLOCK, Source, gathered

LOST, SCATTER = np.geomspace(1e-3, 0.3, 13), np.geomspace(0.005, 1.0, 13)
"""Candidates for the part p of lost commands, and for the relative scatter s of the pulses."""
SURE = -float(np.log(share(DOUBTFUL, len(LOST))))
"""Threshold of L. The likelihood ratio has the mean 1 under the null hypothesis, so that L exceeds −log α with a probability of at most α
(Markov's inequality)."""
MOST = 600.0
"""Largest exponent, against overflow."""


def lost_commands_test(history: History, samples: Source, used: Resolved) -> dict[str, Reason]:
    """Reasons, by quantity, against the verdict "converged": some commands were probably not executed.

    Empty with wheels or rotors, whose speeds are measured, and with uncertain jet geometry, whose errors remain in the residuals.
    """
    if history.reference is None or history.residual is None or used.spinning or used.rotors or used.estimates_assumptions:
        return {}
    projection, power = _projection(history, samples, used)
    commanded = power > ROUNDING
    if not commanded.any():
        return {}
    projection, power = projection[commanded], power[commanded]
    if max(loss_ratios(projection, power)) < max(SURE, scatter_ratio(projection, power)):
        return {}
    return dict.fromkeys((*INERTIA, "mass"), Reason("commands-lost"))


def loss_ratios(projection: Array, power: Array) -> list[float]:
    """Log likelihood ratio L for each p of ``LOST``, from each cycle's ``projection`` u √c (K,) and ``power`` c > 0 (K,)."""
    ratio = np.minimum(-projection - power / 2, MOST)
    return [float(np.log1p(p * np.expm1(ratio)).sum()) for p in LOST]


def scatter_ratio(projection: Array, power: Array) -> float:
    """Largest log likelihood ratio V over the scatters s of ``SCATTER``; arguments as in :func:`loss_ratios`."""
    variances = [s**2 * power for s in SCATTER]
    return max(float((projection**2 / power * v / (1 + v) - np.log1p(v)).sum()) / 2 for v in variances)


def _projection(history: History, samples: Source, used: Resolved) -> tuple[Array, Array]:
    """(K,) u √c: residuals projected on the response to each cycle's commands; (K,) c: power of that response. Both over the noise."""
    assert history.reference is not None
    assert history.residual is not None
    cycles, plant = history.cycles, plant_of(used)
    moment, inverse_inertia = plant.jet_moment(history.reference), plant.inverse_inertia(plant.theta(history.reference))
    residual, sigma = history.residual
    unknown = gathered(samples, cycles, lambda here: here.executed.uncommanded)
    residual = np.where((unknown | np.append(False, unknown[:-1]))[:, None], np.nan, residual)
    count = cycles.stop - cycles.start
    projection, power = np.zeros(count), np.zeros(count)
    noise = np.array([_noise_factor(residual[:, axis], sigma[:, axis]) for axis in range(6)])
    for first in range(0, count, BLOCK):
        part, after = slice(first, min(first + BLOCK, count)), slice(first + 1, min(first + BLOCK, count - 1) + 1)
        here = samples.part(slice(cycles.start + part.start, cycles.start + part.stop)).executed
        rate_steps = [impulse @ (inverse_inertia @ moment).T for impulse in (here.falling, here.rising)]
        specific_force = history.reference.mu * here.whole[:, 3:] / here.duration_s[:, None]
        # a command changes the mean rate in two steps: from the previous cycle to its own, and from its own to the next
        responses = (
            (rate_steps[0], part, slice(0, 3)),
            (rate_steps[1], after, slice(0, 3)),
            (specific_force, part, slice(3, 6)),
        )
        for response, rows, axes in responses:
            scale = noise[axes] * sigma[rows, axes]
            valid = np.isfinite(residual[rows, axes]) & (scale > 0)
            expected = np.divide(response[: len(scale)], scale, out=np.zeros_like(scale), where=valid)
            normalised = np.divide(residual[rows, axes], scale, out=np.zeros_like(scale), where=valid)
            commands = slice(first, first + len(scale))
            projection[commands] += (normalised * expected).sum(1)
            power[commands] += (expected**2).sum(1)
    return projection, power


def _noise_factor(residual: Array, sigma: Array) -> float:
    """Standard deviation of the normalised residuals, by the median, which outliers hardly change."""
    valid = np.isfinite(residual) & (sigma > 0)
    return (1 / NORMAL_MEDIAN) * median(np.abs(residual[valid] / sigma[valid])) if valid.any() else 0.0
