"""Time windows in which one channel may give another part of its stated force, all from one reduction of the log.

For a given body, the pulses of a channel in a window form one regressor column. Its likelihood ratio follows from inner products: of the
column's parts between window edges, of these with the residuals, and of these with the tangents of the body.
"""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, IntArray
from massprop_cli.base.levels import CLEAR, DIFFERENCE
from massprop_cli.diagnosis.channelwise import HALF_WAVES, cosines
from massprop_cli.diagnosis.design import INTEGRATED
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.segment import edges_of
from massprop_cli.estimate.whitening import Disturbance, white_rows
from massprop_cli.model.plant import plant_of
from massprop_cli.model.responsemap import ResponseMap


class Window(NamedTuple):
    """Cycles in which a channel gives another part of its stated force."""

    channel: int
    """Number among the channels that act."""
    first: int
    stop: int
    begin_s: float
    """Start of the first cycle, s; −∞ if it is the first of all."""
    end_s: float
    """End of the last cycle, s; ∞ if it is the last of all."""
    thrust: float
    """Thrust in the window over stated thrust."""
    sigma: float
    """Sigma of ``thrust``."""
    gain: float
    """−2 log likelihood ratio against one thrust factor throughout."""


class WindowRegression:
    """Whitened residuals of a segment about a body, and their tangents by its mass properties and nuisance parameters."""

    def __init__(self, screening: Screening, by: Screening, disturbance: Disturbance) -> None:
        case, theta = screening.case, by.stated.value("theta")
        self.design = case.design(screening.piece, theta)
        self._disturbance = disturbance
        self._slow = cosines(len(self.design.mean), HALF_WAVES if INTEGRATED in self.design.places else 0)
        rates, turning = self._whitened(self.design.growth)
        force = self._weighted(self.design.mean)
        measured = turning, self._weighted(self.design.force)
        model, x, turn = screening.model, by.stated.x, np.eye(3)[None]
        sizes = ResponseMap(plant_of(case.vehicle)).sizes(theta)
        moves = np.hstack([np.eye(len(x), 10) * (DIFFERENCE * sizes), DIFFERENCE * model.uncertain])
        every = model.coefficients(np.vstack([x, x + moves.T]), turn, turn)
        self.by, slopes = every[0], np.moveaxis(every[1:] - every[0], 0, -1) / DIFFERENCE
        self.weight = 1 / np.maximum(by.free.variance, TINY)
        self.columns = [rates, force]
        self._axes = slice(0, 3), slice(3, 6)
        self.left = [y - w @ self.by[:, axes] for y, w, axes in zip(measured, self.columns, self._axes, strict=True)]
        self.slopes = [slopes[:, axes] * np.sqrt(self.weight[axes])[:, None] for axes in self._axes]
        tangents = [np.einsum("kp,pan->kan", w, s).reshape(-1, s.shape[-1]) for w, s in zip(self.columns, self.slopes, strict=True)]
        normal = np.vstack([*tangents, np.eye(tangents[0].shape[1])])
        residual = np.concatenate([(r * np.sqrt(self.weight[a])).ravel() for r, a in zip(self.left, self._axes, strict=True)])
        self.inverse = np.linalg.inv(normal.T @ normal)
        self.pull = normal[: len(residual)].T @ residual
        self.chi_square = float(residual @ residual - self.pull @ self.inverse @ self.pull)
        self.count = 3 * int(self.design.used.sum())

    def _whitened(self, growth: Array) -> tuple[Array, Array]:
        """(K, n) columns and (K, 3) rates, whitened, orthogonal to the unknown initial states."""
        _, white, _ = next(white_rows(self.design.driven._replace(growth=growth), [self._disturbance]))
        initial = white.shape[1] - 3 - growth.shape[1]
        base = np.linalg.qr(white[:, :initial])[0]
        rows = white[:, initial:] - base @ (base.T @ white[:, initial:])
        return -rows[:, :-3], rows[:, -3:]

    def _weighted(self, mean: Array) -> Array:
        """(K, n) weighted columns of the specific force, orthogonal to its slow wander."""
        weight = self.design.force_weight[self.design.used[:, 1], None]
        rows = weight * mean[self.design.used[:, 1]]
        if not self._slow.shape[1]:
            return rows
        base = np.linalg.qr(weight * self._slow[self.design.used[:, 1]])[0]
        return np.asarray(rows - base @ (base.T @ rows))

    def best_window(self, channel: int, near: Window | None = None) -> Window | None:
        """Maximum likelihood window of one channel, between edges of equal parts and any cycles near the edges of ``near``.

        None if one thrust factor throughout explains as much.
        """
        edges = self._edges(near)
        size, with_residual = self._parts(channel, edges)
        sums_2d = np.pad(size, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
        information = np.diag(sums_2d)[None, :] + np.diag(sums_2d)[:, None] - sums_2d - sums_2d.T
        sums = np.pad(with_residual, (1, 0)).cumsum()
        determined = np.triu(information > ROUNDING * max(float(np.diag(size).max()), TINY), 1)
        information, score = np.where(determined, information, np.inf), sums[None, :] - sums[:, None]
        gain = -self.count * np.log1p(-np.minimum(score**2 / information / self.chi_square, 1 - ROUNDING))
        open_gain = max(gain[0, :].max(), gain[:, -1].max())
        first, stop = divmod(int(np.argmax(gain)), len(edges))
        if gain[first, stop] < open_gain + CLEAR:  # the best window with only one edge inside the segment
            first, stop = (0, int(np.argmax(gain[0]))) if gain[0].max() == open_gain else (int(np.argmax(gain[:, -1])), len(edges) - 1)
        advantage = float(gain[first, stop] - max(gain[0, -1], 0.0))
        if advantage < CLEAR:
            return None
        change, sigma = float(score[first, stop] / information[first, stop]), float(information[first, stop] ** -0.5)
        return Window(channel, *self._cycles(int(edges[first]), int(edges[stop])), 1 + change, sigma, advantage)

    def _edges(self, near: Window | None) -> IntArray:
        edges = edges_of(0, len(self.design.mean))
        if near is None:
            return edges
        at = [int(np.searchsorted(edges, edge)) for edge in (near.first, near.stop) if 0 < edge < edges[-1]]
        around = [np.arange(edges[max(i - 2, 0)], edges[min(i + 2, len(edges) - 1)] + 1) for i in at]
        return np.asarray(np.unique(np.concatenate([edges, *around])))

    def _cycles(self, first: int, stop: int) -> tuple[int, int, float, float]:
        """Cycles of a window, and when it begins and ends, s."""
        start_s, duration_s = self.design.start_s, self.design.duration_s
        begin_s = -np.inf if first == 0 else float(start_s[first])
        return first, stop, begin_s, np.inf if stop == len(start_s) else float(start_s[stop - 1] + duration_s[stop - 1])

    def _parts(self, channel: int, edges: IntArray) -> tuple[Array, Array]:
        """(B, B) inner products of a channel's parts between edges, and (B,) those with the residuals, both projected off the tangents."""
        cycle = np.arange(len(self.design.mean))[:, None]
        within = (cycle >= edges[:-1]) & (cycle < edges[1:])
        rising, falling, whole = (part[:, channel, None] * within for part in self.design.impulses)
        rates, _ = self._whitened(rising[:-1] + falling[1:])
        force = self._weighted(whole / self.design.duration_s[:, None])
        coefficients = self.by[self.design.places["channels"].start + channel]
        size, with_residual = np.zeros((len(edges) - 1, len(edges) - 1)), np.zeros(len(edges) - 1)
        with_tangents = np.zeros((len(edges) - 1, len(self.pull)))
        for part, columns, residual, slopes, axes in zip((rates, force), self.columns, self.left, self.slopes, self._axes, strict=True):
            weighted = coefficients[axes] * np.sqrt(self.weight[axes])
            size = size + (weighted @ weighted) * (part.T @ part)
            with_residual = with_residual + (part.T @ residual) @ (weighted * np.sqrt(self.weight[axes]))
            with_tangents = with_tangents + (part.T @ columns) @ np.einsum("pan,a->pn", slopes, weighted)
        return size - with_tangents @ self.inverse @ with_tangents.T, with_residual - with_tangents @ self.inverse @ self.pull
