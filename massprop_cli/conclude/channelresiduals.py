"""Channel residual test: residuals against each command channel.

An error of a channel's thrust, place or direction changes the rates by its accumulated commands, and the specific force while it acts. The
whitened residuals are projected on both, axis by axis. The six projections are standard normal if the model holds, and smaller along fitted
directions. A test of all channels together has less power against an error of one channel.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.conclude.score import Doubt
from massprop_cli.diagnosis.lackoffit import CHANNELS
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import REFUTED, deviate, threshold
from massprop_cli.model.layout import MU
from massprop_cli.prepare.compensate import BLOCK, Samples, Source


def channel_residual_test(settled: Sequence[History], samples: Source, names: Sequence[str], scatter: float) -> list[Doubt]:
    """Channels with which the residuals of the off-line fits correlate, in descending order of significance.

    ``names`` are those of the C channels; ``scatter`` is the mean squared whitened residual.
    """
    explained = np.zeros(len(names))
    for history in settled:
        if history.reference is not None:
            explained += _explained(history, samples)
    explained /= max(scatter, 1.0)
    fits = sum(history.reference is not None for history in settled)
    freedom = CHANNELS * max(fits, 1)
    sigmas = deviate(explained / freedom, freedom)
    limit = threshold(REFUTED, len(names))
    shifts = [_shift_per_sigma(history) for history in settled]

    def doubt(i: int) -> Doubt:
        size = np.sqrt(explained[i])
        return Doubt(
            f"response to {names[i]} or what moves like it",
            float(sigmas[i]),
            limit,
            tuple(None if shift is None else size * shift for shift in shifts),
        )

    return [doubt(int(i)) for i in np.argsort(-sigmas, kind="stable") if sigmas[i] > limit]


def _explained(history: History, samples: Source) -> Array:
    """(C,) sum of squared whitened residuals along the regressors of each channel."""
    totals: list[Array] = []
    for accumulated, command, rate, force in _parts(history, samples):
        sums = [
            *((accumulated**2).sum(0), accumulated.sum(0), accumulated.T @ rate, rate.sum(0)),
            *((command**2).sum(0), command.T @ force, np.array(len(rate))),
        ]
        totals = [a + b for a, b in zip(totals, sums, strict=True)] if totals else sums
    square, total, rate_product, rate, command_square, force_product, count = totals
    # the fit estimates the initial rate, which absorbs the mean of the accumulated commands
    square, rate_product = square - total**2 / count, rate_product - total[:, None] * rate / count
    explained: Array = np.zeros(len(square))
    for power, product in ((square, rate_product), (command_square, force_product)):
        explained += np.where(power > 0, (product**2).sum(1) / np.where(power > 0, power, 1.0), 0.0)
    return explained


def _parts(history: History, samples: Source) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield by block: (K, C) accumulated commands and commands, (K, 3) whitened residuals of rate and of specific force."""
    before: Array | float = 0.0
    last: Array | None = None
    cycles = history.cycles
    for first in range(cycles.start, cycles.stop, BLOCK):
        part = slice(first, min(first + BLOCK, cycles.stop))
        here: Samples = samples.part(part)
        channels = here.executed.channels
        falling = channels.falling
        previous = np.zeros_like(falling[:1]) if last is None else last
        accumulated = before + np.cumsum(channels.rising + np.vstack([previous, falling[:-1]]), axis=0)
        before, last = accumulated[-1], falling[-1:]
        residual = history.normalised[part.start - cycles.start : part.stop - cycles.start]
        finite = np.isfinite(residual).all(1)
        yield accumulated[finite], channels.whole[finite], residual[finite, :3], residual[finite, 3:]


def _shift_per_sigma(history: History) -> Array | None:
    """(10, 1) largest error of the state parameters per sigma of residual; None without a reference."""
    if history.reference is None:
        return None
    shift: Array = np.sqrt(np.diag(history.bare[1]))[:, None]
    shift[MU] /= history.bare[0][MU] ** 2
    return shift
