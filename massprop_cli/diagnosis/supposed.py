"""A hypothesis that the vehicle file says otherwise: other values of its keys, which free coefficients found."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.hypotheses import along
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.errorparameters.table import PRIORS

States = dict[str, object]
"""Values of keys of the vehicle file."""


class Supposed(NamedTuple):
    """What may have been otherwise."""

    codes: tuple[str, ...]
    """Of a fault of one thing, or of several at once."""
    states: States
    further: tuple[States, ...] = ()
    """Keys with each number that was sought one sigma away."""
    later: float = 0.0
    """Cycles by which commands act later with it."""
    loose: float = 0.0
    """One sigma of the error of that, cycles; 0: none."""

    def fitted(self, screening: Screening) -> Fitted:
        """As a hypothesis, before anything is fitted to it."""
        none = np.zeros((len(screening.stated.x), 0))
        free = along(screening.model, ("delay", np.full(1, self.loose / PRIORS["delay"]))) if self.loose else none
        first, *others = self.codes
        supposed = Hypothesis(first, (), free, states=self.states, further=self.further)
        for code in others:
            supposed = replace(supposed, code="", parts=(supposed, Hypothesis(code, (), none)))
        return screening.supposing(supposed, delay=self.later)
