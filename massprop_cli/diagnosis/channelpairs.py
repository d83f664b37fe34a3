"""Several channels at once: actuators of a kind that do what is stated of one another, and any two that give another thrust."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.diagnosis import hypotheses
from massprop_cli.diagnosis.comparison import ROUGHLY, Fitted
from massprop_cli.diagnosis.corrections import around, correction_of
from massprop_cli.diagnosis.explanation import alone, chosen, words_of
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.refit import Refit, beyond, hopeless, tried_each
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.inputs.notice import Notice

SLIGHT = 0.01
"""Part of its thrust below which a second channel is no cause beside one with which the log fits."""
EXCHANGES = 4
"""Most pairs of jets that are exchanged one after another."""
CHANNELS = 3
"""How many pairs of channels are tried."""


def swapped(screening: Screening) -> Diagnosis | None:
    """Actuators of a kind, each of which does what is stated of another."""
    return chosen(screening, wired(screening))


def wired(screening: Screening) -> list[Refit]:
    """Two of them, or more of which two after two are exchanged, or of few any three."""
    refits, does, least = list[Refit](), tuple[int, ...](), np.inf
    for _ in range(EXCHANGES):
        likeliest = _likeliest(screening, hypotheses.swapped(screening.model, screening.names, does))
        if not likeliest or screening.likelihood(likeliest[0].chi_square) > least - CLEAR:
            break
        least, does = screening.likelihood(likeliest[0].chi_square), likeliest[0].hypothesis.does
        refits += _tried(screening, likeliest)
        if any(refit.fits for refit in refits):
            break
    return refits


def two_channels(screening: Screening, one_fits: bool) -> Diagnosis | None:
    """The thrust of any two channels at once; where one cause fits already, only if both are off by more than :data:`SLIGHT`."""
    likeliest = _likeliest(screening, hypotheses.two_channels(screening.model, screening.names))
    fitting = [one for one in _tried(screening, likeliest) if one.fits]
    if one_fits:  # a channel that is hardly off stands for a misfit of another kind
        fitting = [one for one in fitting if not (np.abs(one.fitted.factors - 1) < SLIGHT).any()]
    refit = min(fitting, key=lambda one: one.score, default=None)
    if refit is None:
        return None
    both, near = correction_of(screening.case, refit.case, refit.fitted), around(screening.case, refit.fitted)
    return Diagnosis(
        tuple(
            Fault(Notice(code, f"the log fits if {words}"), both, around=near)
            for name in refit.fitted.hypothesis.subject
            for code, words in [words_of(alone(refit.fitted, name), screening.names, screening.case, refit.case)]
        ),
        score=refit.score,
    )


def _likeliest(screening: Screening, supposed: Sequence[Hypothesis]) -> list[Fitted]:
    found = screening.fitted(supposed, still=ROUGHLY)
    return sorted(found, key=lambda one: (screening.likelihood(one.chi_square), one.hypothesis.subject))[:CHANNELS]


def _tried(screening: Screening, likeliest: Sequence[Fitted]) -> list[Refit]:
    return tried_each(screening, (one for one in likeliest if not hopeless(screening, one, beyond(screening))))
