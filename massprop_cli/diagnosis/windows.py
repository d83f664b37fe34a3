"""Time windows in which one channel may have given another part of its stated force, all on one reduction of the log.

By a body, a channel's pulses within a window make a column of rates and specific force. How much more likely the log is with another part
of that column is told by products of the column's parts with one another, with what the body leaves of the log, and with what another body
would change.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, IntArray
from massprop_cli.diagnosis.channelwise import SLOW, waves
from massprop_cli.diagnosis.design import INTEGRATED
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.segment import edges_of
from massprop_cli.estimate.whitening import Disturbance, white_rows
from massprop_cli.model.plant import plant_of
from massprop_cli.model.responsemap import ResponseMap

STEP = 1e-4
"""Of each of θ's natural size, the step of a derivative."""


class Window(NamedTuple):
    """Some cycles in which a channel gives another part of what is stated."""

    channel: int
    """Among those that fired."""
    first: int
    stop: int
    begin_s: float
    """When the first of these cycles begins; −∞ where it is the first of all."""
    end_s: float
    """When the last of them ends; ∞ where it is the last of all."""
    thrust: float
    """What of its stated thrust it gives in them."""
    sigma: float
    """Of that."""
    gain: float
    """−2 log likelihood that it leaves less than one part all along does."""


class Reduced:
    """A look's log as white rows over the noise, less what a body makes of it, and what another body would change."""

    def __init__(self, screening: Screening, by: Screening, beside: Disturbance) -> None:
        case, theta = screening.case, by.stated.value("theta")
        self.design = case.design(screening.piece, theta)
        self._beside = beside
        self._slow = waves(len(self.design.mean), SLOW if INTEGRATED in self.design.places else 0)
        rates, turning = self._white(self.design.growth)
        force = self._heard(self.design.mean)
        measured = turning, self._heard(self.design.force)
        model, x, turn = screening.model, by.stated.x, np.eye(3)[None]
        sizes = ResponseMap(plant_of(case.vehicle)).sizes(theta)
        moves = np.hstack([np.eye(len(x), 10) * (STEP * sizes), STEP * model.uncertain])
        every = model.coefficients(np.vstack([x, x + moves.T]), turn, turn)
        self.by, slopes = every[0], np.moveaxis(every[1:] - every[0], 0, -1) / STEP
        self.weight = 1 / np.maximum(by.free.variance, TINY)
        self.columns = [rates, force]
        self._axes = slice(0, 3), slice(3, 6)
        self.left = [y - w @ self.by[:, axes] for y, w, axes in zip(measured, self.columns, self._axes, strict=True)]
        self.slopes = [slopes[:, axes] * np.sqrt(self.weight[axes])[:, None] for axes in self._axes]
        tangents = [np.einsum("kp,pan->kan", w, s).reshape(-1, s.shape[-1]) for w, s in zip(self.columns, self.slopes, strict=True)]
        told = np.vstack([*tangents, np.eye(tangents[0].shape[1])])
        rest = np.concatenate([(r * np.sqrt(self.weight[a])).ravel() for r, a in zip(self.left, self._axes, strict=True)])
        self.inverse = np.linalg.inv(told.T @ told)
        self.pull = told[: len(rest)].T @ rest
        self.chi_square = float(rest @ rest - self.pull @ self.inverse @ self.pull)
        self.count = 3 * int(self.design.used.sum())

    def _white(self, growth: Array) -> tuple[Array, Array]:
        """(K, n) columns, and (K, 3) the rates, white beside the disturbance, less what the unknown beginnings explain."""
        _, white, _ = next(white_rows(self.design.driven._replace(growth=growth), [self._beside]))
        began = white.shape[1] - 3 - growth.shape[1]
        base = np.linalg.qr(white[:, :began])[0]
        rows = white[:, began:] - base @ (base.T @ white[:, began:])
        return -rows[:, :-3], rows[:, -3:]

    def _heard(self, mean: Array) -> Array:
        """(K, n) columns of the specific force, less what wanders."""
        weight = self.design.heard[self.design.used[:, 1], None]
        rows = weight * mean[self.design.used[:, 1]]
        if not self._slow.shape[1]:
            return rows
        base = np.linalg.qr(weight * self._slow[self.design.used[:, 1]])[0]
        return np.asarray(rows - base @ (base.T @ rows))

    def likeliest(self, channel: int, near: Window | None = None) -> Window | None:
        """The window of one channel that leaves least, between edges of equal parts, and any cycles near those of another window.

        None where one part all along leaves no more.
        """
        edges = self._edges(near)
        size, told = self._parts(channel, edges)
        ahead = np.pad(size, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
        own = np.diag(ahead)[None, :] + np.diag(ahead)[:, None] - ahead - ahead.T
        sums = np.pad(told, (1, 0)).cumsum()
        clear = np.triu(own > ROUNDING * max(float(np.diag(size).max()), TINY), 1)
        own, said = np.where(clear, own, np.inf), sums[None, :] - sums[:, None]
        gain = -self.count * np.log1p(-np.minimum(said**2 / own / self.chi_square, 1 - ROUNDING))
        ends = max(gain[0, :].max(), gain[:, -1].max())
        first, stop = divmod(int(np.argmax(gain)), len(edges))
        if gain[first, stop] < ends + CLEAR:  # one edge alone
            first, stop = (0, int(np.argmax(gain[0]))) if gain[0].max() == ends else (int(np.argmax(gain[:, -1])), len(edges) - 1)
        gained = float(gain[first, stop] - max(gain[0, -1], 0.0))
        if gained < CLEAR:
            return None
        by, sigma = float(said[first, stop] / own[first, stop]), float(own[first, stop] ** -0.5)
        return Window(channel, *self._cycles(int(edges[first]), int(edges[stop])), 1 + by, sigma, gained)

    def _edges(self, near: Window | None) -> IntArray:
        edges = edges_of(0, len(self.design.mean))
        if near is None:
            return edges
        at = [int(np.searchsorted(edges, edge)) for edge in (near.first, near.stop) if 0 < edge < edges[-1]]
        around = [np.arange(edges[max(i - 2, 0)], edges[min(i + 2, len(edges) - 1)] + 1) for i in at]
        return np.asarray(np.unique(np.concatenate([edges, *around])))

    def _cycles(self, first: int, stop: int) -> tuple[int, int, float, float]:
        """A window's cycles, and when they begin and end."""
        start_s, duration_s = self.design.start_s, self.design.duration_s
        begin_s = -np.inf if first == 0 else float(start_s[first])
        return first, stop, begin_s, np.inf if stop == len(start_s) else float(start_s[stop - 1] + duration_s[stop - 1])

    def _parts(self, channel: int, edges: IntArray) -> tuple[Array, Array]:
        """(B, B) products of a channel's parts between each two edges, and (B,) their products with what is left, less another body's."""
        cycle = np.arange(len(self.design.mean))[:, None]
        within = (cycle >= edges[:-1]) & (cycle < edges[1:])
        rising, falling, whole = (part[:, channel, None] * within for part in self.design.acted)
        rates, _ = self._white(rising[:-1] + falling[1:])
        force = self._heard(whole / self.design.duration_s[:, None])
        own = self.by[self.design.places["channels"].start + channel]
        size, told = np.zeros((len(edges) - 1, len(edges) - 1)), np.zeros(len(edges) - 1)
        turned = np.zeros((len(edges) - 1, len(self.pull)))
        for part, columns, left, slopes, axes in zip((rates, force), self.columns, self.left, self.slopes, self._axes, strict=True):
            weighed = own[axes] * np.sqrt(self.weight[axes])
            size = size + (weighed @ weighed) * (part.T @ part)
            told = told + (part.T @ left) @ (weighed * np.sqrt(self.weight[axes]))
            turned = turned + (part.T @ columns) @ np.einsum("pan,a->pn", slopes, weighed)
        return size - turned @ self.inverse @ turned.T, told - turned @ self.inverse @ self.pull
