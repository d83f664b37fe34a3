"""A hypothesis: the error parameters that may differ from what is stated.

x is that of :mod:`massprop_cli.diagnosis.coefficients`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass

STRAIGHT = np.eye(3)
"""No turn; by identity, so that none is told from one that came to nothing."""


@dataclass(frozen=True)
class Hypothesis:
    """Entries of x that may differ from what is stated."""

    code: str
    subject: tuple[str, ...]
    """What it is about: channel names, axes, a unit."""
    free: Array
    """(nx, d) directions in which x may move, each scaled to one sigma of what is to be expected."""
    start: Mapping[int, float] = field(default_factory=dict)
    """Entries that begin elsewhere."""
    gyro: Array = field(default_factory=lambda: STRAIGHT)
    """(3, 3) turn or mirror that the gyro's axes are supposed to have beyond the stated."""
    accelerometer: Array = field(default_factory=lambda: STRAIGHT)
    suspects: tuple[int, ...] = ()
    """Channels whose commands are not to be relied on to find a body first."""
    parts: tuple[Hypothesis, ...] = ()
    """Of two at once, each."""
    states: Mapping[str, object] = field(default_factory=dict)
    """Keys of the vehicle file that have other values by it, in which the motion is not linear."""
    rare: float = 0.0
    """−2 log of its odds against others of its kind."""
    further: tuple[Mapping[str, object], ...] = ()
    """The same with each number that was sought in the log one sigma away."""
    does: tuple[int, ...] = ()
    """The channel of which each does what is stated, where some are wired as others are."""
    spun: tuple[int, ...] = ()
    """Channels of rotors that turn the other way round than stated: of their thrust, and of the momentum that they store."""
    freed: int | None = None
    """A channel of which nothing at all is supposed: what it does is free."""

    @cached_property
    def moved(self) -> BoolArray:
        """(nx,) which entries it moves."""
        return np.asarray(self.free.any(1))

    @cached_property
    def begins(self) -> tuple[tuple[int, float], ...]:
        """Entries that begin elsewhere, and where."""
        return tuple(self.start.items())

    def beside(self, other: Hypothesis) -> Hypothesis:
        """Both at once; what begins elsewhere or is turned must be in place already."""
        both = {**self.states, **other.states}
        return Hypothesis("", (), np.hstack([self.free, other.free]), parts=(self, other), states=both)

    def whatever(self, channel: int) -> Hypothesis:
        """The same where nothing is supposed of what one channel does."""
        # by position: thousands are made, which takes ``replace`` thrice as long
        return Hypothesis(self.code, self.subject, self.free, self.start, self.gyro, self.accelerometer, (channel,), freed=channel)

    @property
    def turns(self) -> bool:
        """Whether it turns or mirrors the gyro's axes; another unit does neither."""
        scale = np.diag(self.gyro)
        return bool((self.gyro != np.diag(scale)).any() or (scale < 0).any())

    @property
    def moves(self) -> Hypothesis:
        """What is left to be found once it is in place."""
        return Hypothesis(self.code, self.subject, self.free)
