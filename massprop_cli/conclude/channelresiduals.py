"""Channel residual test: residuals against each command channel.

A channel whose thrust, place or direction is not as stated turns the body by a little more each time, so that the rates depart by what its
commands have summed up to; and it is felt while it acts. What is left, made white, is projected on both, axis by axis: six standard normals
if the model holds, smaller ones for what was fitted. Sharper than a test of all channels together, which drowns one among them.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.conclude.score import Doubt
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import REFUTED, deviate, threshold
from massprop_cli.model.layout import MU
from massprop_cli.prepare.compensate import BLOCK, Samples, Source

AXES = 6
"""Directions in which a channel may do something else than stated."""


def followed(settled: Sequence[History], samples: Source, names: Sequence[str], scatter: float) -> list[Doubt]:
    """Channels that what is left of the off-line fits follows, the surest first; ``scatter`` is its mean square."""
    explained = np.zeros(len(names))
    for history in settled:
        if history.reference is not None:
            explained += _explained(history, samples)
    explained /= max(scatter, 1.0)
    told = sum(history.reference is not None for history in settled)
    freedom = AXES * max(told, 1)
    sigmas = deviate(explained / freedom, freedom)
    limit = threshold(REFUTED, len(names))
    moves = [_moves(history) for history in settled]

    def doubt(i: int) -> Doubt:
        size = np.sqrt(explained[i])
        return Doubt(
            f"response to {names[i]} or what moves like it",
            float(sigmas[i]),
            limit,
            tuple(None if one is None else size * one for one in moves),
        )

    return [doubt(int(i)) for i in np.argsort(-sigmas, kind="stable") if sigmas[i] > limit]


def _explained(history: History, samples: Source) -> Array:
    """(C,) sum of squares of what is left along what each channel did."""
    totals: list[Array] = []
    for turned, acted, rate, force in _parts(history, samples):
        now = [(turned**2).sum(0), turned.sum(0), turned.T @ rate, rate.sum(0), (acted**2).sum(0), acted.T @ force, np.array(len(rate))]
        totals = [a + b for a, b in zip(totals, now, strict=True)] if totals else now
    square, mean, by_rate, rate, acted, by_force, count = totals
    # a rate that is off from the beginning on is fitted, so that of what is summed up the mean tells nothing
    square, by_rate = square - mean**2 / count, by_rate - mean[:, None] * rate / count
    found: Array = np.zeros(len(square))
    for power, along in ((square, by_rate), (acted, by_force)):
        found += np.where(power > 0, (along**2).sum(1) / np.where(power > 0, power, 1.0), 0.0)
    return found


def _parts(history: History, samples: Source) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Part by part: what each channel has summed up to, and did; and what is left of rates and specific force. (K, C) and (K, 3)."""
    before: Array | float = 0.0
    last: Array | None = None
    cycles = history.cycles
    for first in range(cycles.start, cycles.stop, BLOCK):
        part = slice(first, min(first + BLOCK, cycles.stop))
        here: Samples = samples.part(part)
        channels = here.executed.channels
        falling = channels.falling
        gone = np.zeros_like(falling[:1]) if last is None else last
        summed = before + np.cumsum(channels.rising + np.vstack([gone, falling[:-1]]), axis=0)
        before, last = summed[-1], falling[-1:]
        left = history.normalised[part.start - cycles.start : part.stop - cycles.start]
        told = np.isfinite(left).all(1)
        yield summed[told], channels.whole[told], left[told, :3], left[told, 3:]


def _moves(history: History) -> Array | None:
    """(10, 1) by how much the state parameters may be off for each sigma that is left; None without a reference."""
    if history.reference is None:
        return None
    found: Array = np.sqrt(np.diag(history.bare[1]))[:, None]
    found[MU] /= history.bare[0][MU] ** 2
    return found
