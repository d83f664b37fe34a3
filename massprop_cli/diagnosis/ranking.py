"""Hypotheses ranked by likelihood, each fitted when its turn comes.

What a channel's own hypotheses (its thrust, place and direction) leave is no less than what is left where nothing is supposed of what
that channel does. So one fit for each channel says when its turn comes at the earliest, and most of its own are never fitted. Where its own
leave clearly more than that, they are fitted again from the body of that fit: a wrong jet may have drawn the body into another minimum.
"""

import heapq
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis.channelwise import Free
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.comparison import ROUGHLY, Fitted, fitted
from massprop_cli.diagnosis.hypothesis import Hypothesis

CLEAR = 14.0
"""−2 log of the odds (1 : 1000) by which a cause must come before its rivals to stand alone."""
Score = Callable[[Array, Fitted, int], float]
"""−2 log of how likely a hypothesis is that leaves chi-square (6,), one of so many of its kind."""


class Ranking:
    """Those whose score is below ``most``, the most likely first; ``likelihood`` is what is left, in a score without prices."""

    def __init__(
        self, model: Model, free: Free, supposed: Sequence[Hypothesis], score: Score, likelihood: Callable[[Array], float], most: float
    ) -> None:
        self._model, self._free, self._supposed = model, free, supposed
        self._score, self._likelihood, self._most = score, likelihood, most
        kinds = [one.code for one in supposed]
        self._alternatives = [kinds.count(kind) for kind in kinds]
        self._found: dict[int, tuple[float, Fitted]] = {}
        self._of: dict[int, list[int]] = {}
        self._rivals: list[Hypothesis] = []
        others = []
        for i, one in enumerate(supposed):
            channel = model.channel(one)
            if channel is None or channel >= model.thrusting:  # one that is left free keeps the momentum that it stores
                others.append(i)
            else:
                self._of.setdefault(channel, []).append(i)
        freed = [model.without(channel) for channel in self._of]
        bounds = self._fitted(freed)
        self._left = {channel: one.chi_square for channel, one in zip(self._of, bounds, strict=True)}
        self._body = {channel: one.value("theta") for channel, one in zip(self._of, bounds, strict=True)}
        self._fit(others)

    def __iter__(self) -> Iterator[tuple[float, Fitted]]:
        """Score and fit of each."""
        return self.within(np.inf)

    @property
    def known(self) -> list[tuple[float, Fitted]]:
        """Those that are fitted by now, in any order."""
        return [each for each in self._found.values() if each[0] < self._most]

    def faint(self, supposed: Hypothesis) -> bool:
        """Whether one came as a rival alone, too faint to be named itself."""
        return any(one is supposed for one in self._rivals)

    def within(self, most: float, reach: Callable[[], float] = lambda: np.inf, rivals: float = 0.0) -> Iterator[tuple[float, Fitted]]:
        """Without those of channels that leave more than so much of chi-square whatever is supposed of them.

        Nor of those, while it goes on, whose score is beyond ``reach`` then. With the ``rivals`` of the first, whose scores are so near its
        own, though they be too faint to be named themselves.
        """
        bar = self._most
        waiting = [(score, 1, i) for i, (score, _) in self._found.items()]
        known = self._found.keys()
        for channel, own in self._of.items():
            left = self._left[channel]
            if not known >= set(own) and left.sum() <= most:
                # no less than with the price of one that is dead or the other way round
                earliest = self._likelihood(left) + 2 * float(np.log(min(self._alternatives[i] for i in own)))
                waiting.append((earliest, 0, channel))
        heapq.heapify(waiting)
        while waiting:
            score, fit, which = heapq.heappop(waiting)
            if score >= bar:
                return
            if fit:
                bar, rivals = max(bar, score + rivals), 0.0
                if score >= self._most:
                    self._rivals.append(self._found[which][1].hypothesis)
                yield self._found[which]
                continue
            if score > reach():
                continue
            self._fit_channel(which)
            for i in self._of[which]:
                heapq.heappush(waiting, (self._found[i][0], 1, i))

    def _fit_channel(self, channel: int) -> None:
        """All of a channel's own."""
        own = self._of[channel]
        self._fit(own)
        least = min(self._likelihood(self._found[i][1].chi_square) for i in own)
        if least > self._likelihood(self._left[channel]) + CLEAR:
            before = {i: self._found[i] for i in own}
            self._fit(own, self._body[channel])
            self._found |= {i: min(before[i], self._found[i], key=lambda one: one[0]) for i in own}

    def _fit(self, which: Sequence[int], theta: Array | None = None) -> None:
        for i, one in zip(which, self._fitted([self._supposed[i] for i in which], theta), strict=True):
            self._found[i] = self._score(one.chi_square, one, self._alternatives[i]), one

    def _fitted(self, supposed: Sequence[Hypothesis], theta: Array | None = None) -> list[Fitted]:
        return fitted(self._model, self._free, self._free.variance, supposed, theta, ROUGHLY, there=theta is not None)
