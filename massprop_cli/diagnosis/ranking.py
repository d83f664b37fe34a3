"""Hypotheses ranked by score, each fitted only when it may be next.

A channel's own hypotheses (its thrust, place and direction) have at least the chi-square of the fit in which its effect is free. So one fit
per channel bounds the scores of all of them, and most are never fitted. If all of them are clearly worse than that fit, they are fitted
again from its body, since a wrong jet may have led the body into another minimum.
"""

import heapq
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import CLEAR
from massprop_cli.diagnosis.channelwise import FreeResponse
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import ROUGHLY, Fitted, fitted
from massprop_cli.diagnosis.hypothesis import Hypothesis

Score = Callable[[Array, Fitted, int], float]
"""−2 log posterior odds of a hypothesis, from its chi-square (6,), its fit and the number of alternatives of its kind."""


class Ranking:
    """Hypotheses with a score below ``most``, in ascending order. ``likelihood`` is the score without penalties."""

    def __init__(
        self,
        model: Model,
        free: FreeResponse,
        hypotheses: Sequence[Hypothesis],
        score: Score,
        likelihood: Callable[[Array], float],
        most: float,
    ) -> None:
        self._model, self._free, self._supposed = model, free, hypotheses
        self._score, self._likelihood, self._most = score, likelihood, most
        codes = [one.code for one in hypotheses]
        self._alternatives = [codes.count(kind) for kind in codes]
        self._found: dict[int, tuple[float, Fitted]] = {}
        self._of: dict[int, list[int]] = {}
        self._rivals: list[Hypothesis] = []
        others = []
        for i, one in enumerate(hypotheses):
            channel = model.channel(one)
            # a device with a free channel would keep its stored momentum
            if channel is None or channel >= model.thrusting:
                others.append(i)
            else:
                self._of.setdefault(channel, []).append(i)
        free_fits = [model.without(channel) for channel in self._of]
        bounds = self._fitted(free_fits)
        self._left = {channel: one.chi_square for channel, one in zip(self._of, bounds, strict=True)}
        self._body = {channel: one.value("theta") for channel, one in zip(self._of, bounds, strict=True)}
        self._fit(others)

    def __iter__(self) -> Iterator[tuple[float, Fitted]]:
        """Score and fit of each."""
        return self.within(np.inf)

    @property
    def fitted_so_far(self) -> list[tuple[float, Fitted]]:
        """Hypotheses that are fitted so far, in any order."""
        return [each for each in self._found.values() if each[0] < self._most]

    def only_rival(self, hypothesis: Hypothesis) -> bool:
        """Whether a hypothesis was ranked only as a rival of the first, with a score too weak to be named itself."""
        return any(one is hypothesis for one in self._rivals)

    def within(self, most: float, reach: Callable[[], float] = lambda: np.inf, rivals: float = 0.0) -> Iterator[tuple[float, Fitted]]:
        """Score and fit of each, without channels whose free fit leaves more than ``most`` of chi-square.

        Channels whose bound exceeds the present ``reach`` are skipped. ``rivals`` extends the limit to scores within that distance of the
        first.
        """
        limit = self._most
        queue = [(score, 1, i) for i, (score, _) in self._found.items()]
        fitted_already = self._found.keys()
        for channel, members in self._of.items():
            chi_square = self._left[channel]
            if not fitted_already >= set(members) and chi_square.sum() <= most:
                # a dead or reversed channel has the least penalty
                earliest = self._likelihood(chi_square) + 2 * float(np.log(min(self._alternatives[i] for i in members)))
                queue.append((earliest, 0, channel))
        heapq.heapify(queue)
        while queue:
            score, is_fit, which = heapq.heappop(queue)
            if score >= limit:
                return
            if is_fit:
                limit, rivals = max(limit, score + rivals), 0.0
                if score >= self._most:
                    self._rivals.append(self._found[which][1].hypothesis)
                yield self._found[which]
                continue
            if score > reach():
                continue
            self._fit_channel(which)
            for i in self._of[which]:
                heapq.heappush(queue, (self._found[i][0], 1, i))

    def _fit_channel(self, channel: int) -> None:
        """Fit all hypotheses of one channel."""
        members = self._of[channel]
        self._fit(members)
        best = min(self._likelihood(self._found[i][1].chi_square) for i in members)
        if best > self._likelihood(self._left[channel]) + CLEAR:
            before = {i: self._found[i] for i in members}
            self._fit(members, self._body[channel])
            self._found |= {i: min(before[i], self._found[i], key=lambda one: one[0]) for i in members}

    def _fit(self, which: Sequence[int], theta: Array | None = None) -> None:
        for i, one in zip(which, self._fitted([self._supposed[i] for i in which], theta), strict=True):
            self._found[i] = self._score(one.chi_square, one, self._alternatives[i]), one

    def _fitted(self, hypotheses: Sequence[Hypothesis], theta: Array | None = None) -> list[Fitted]:
        return fitted(self._model, self._free, self._free.variance, hypotheses, theta, ROUGHLY, start_at_theta=theta is not None)
