"""A hypothesis about keys of the vehicle file, whose values come from free-response regressions."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.hypotheses import along
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.errorparameters.table import PRIORS

KeyValues = dict[str, object]
"""Values of keys of the vehicle file."""


class KeyHypothesis(NamedTuple):
    """Other values of keys of the vehicle file, and the change of the delay that goes with them."""

    codes: tuple[str, ...]
    """Codes of the faults: one, or several at once."""
    key_values: KeyValues
    sigma_key_values: tuple[KeyValues, ...] = ()
    """Key values with each estimated number one sigma further."""
    delay_change: float = 0.0
    """Change of the command delay, cycles."""
    delay_sigma: float = 0.0
    """Prior sigma of that change, cycles; 0: known."""

    def fitted(self, screening: Screening) -> Fitted:
        """The hypothesis with its key values, before any fit."""
        no_unknowns = np.zeros((len(screening.stated.x), 0))
        directions = along(screening.model, ("delay", np.full(1, self.delay_sigma / PRIORS["delay"]))) if self.delay_sigma else no_unknowns
        first, *others = self.codes
        hypothesis = Hypothesis(first, (), directions, key_values=self.key_values, sigma_key_values=self.sigma_key_values)
        for code in others:
            hypothesis = replace(hypothesis, code="", parts=(hypothesis, Hypothesis(code, (), no_unknowns)))
        return screening.unfitted(hypothesis, delay=self.delay_change)
