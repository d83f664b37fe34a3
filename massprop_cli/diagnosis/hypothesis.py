"""A hypothesis: the error parameters that may differ from their stated values.

x is the parameter vector of :mod:`massprop_cli.diagnosis.coefficients`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass

STRAIGHT = np.eye(3)
"""No turn. Tested by identity, so that a computed unit matrix counts as a turn."""


@dataclass(frozen=True)
class Hypothesis:
    """Entries of x that may differ from the stated values."""

    code: str
    subject: tuple[str, ...]
    """Channel names, axes or the unit concerned."""
    directions: Array
    """(nx, d) directions of the unknowns in x, each scaled to its prior sigma."""
    initial_values: Mapping[int, float] = field(default_factory=dict)
    """Initial values of entries that do not start at the stated value."""
    gyro: Array = field(default_factory=lambda: STRAIGHT)
    """(3, 3) supposed turn, mirror or unit of the gyro beyond the stated mounting, body axes."""
    accelerometer: Array = field(default_factory=lambda: STRAIGHT)
    """(3, 3) that of the accelerometer."""
    suspects: tuple[int, ...] = ()
    """Channels whose commands the initial regression does not use."""
    parts: tuple[Hypothesis, ...] = ()
    """The two hypotheses of a pair."""
    key_values: Mapping[str, object] = field(default_factory=dict)
    """Supposed values of keys of the vehicle file on which the motion depends nonlinearly."""
    prior_odds: float = 0.0
    """−2 log of the prior odds against others of its kind."""
    sigma_key_values: tuple[Mapping[str, object], ...] = ()
    """``key_values`` with each estimated number one sigma further."""
    wiring: tuple[int, ...] = ()
    """For each channel, the channel whose stated effect it has; empty: its own."""
    reversed_rotors: tuple[int, ...] = ()
    """Rotor channels (thrust and stored momentum) that turn the other way than stated."""
    free_channel: int | None = None
    """Channel whose effect is free; None: no channel."""

    @cached_property
    def varied(self) -> BoolArray:
        """(nx,) entries that the directions vary."""
        return np.asarray(self.directions.any(1))

    @cached_property
    def initial_items(self) -> tuple[tuple[int, float], ...]:
        """Initial values as (entry, value), to serve as a key."""
        return tuple(self.initial_values.items())

    def combined_with(self, other: Hypothesis) -> Hypothesis:
        """The pair of both. Initial values and turns must be applied already."""
        both = {**self.key_values, **other.key_values}
        return Hypothesis("", (), np.hstack([self.directions, other.directions]), parts=(self, other), key_values=both)

    def with_free_channel(self, channel: int) -> Hypothesis:
        """The same hypothesis with the effect of one channel free."""
        # positional arguments: thousands are made, and ``replace`` takes three times as long
        return Hypothesis(
            self.code, self.subject, self.directions, self.initial_values, self.gyro, self.accelerometer, (channel,), free_channel=channel
        )

    @property
    def turns_gyro(self) -> bool:
        """Whether it turns or mirrors the gyro's axes; another unit does neither."""
        scale = np.diag(self.gyro)
        return bool((self.gyro != np.diag(scale)).any() or (scale < 0).any())

    @property
    def unknowns_only(self) -> Hypothesis:
        """Its unknowns alone, for a fit after initial values and turns are applied."""
        return Hypothesis(self.code, self.subject, self.directions)
