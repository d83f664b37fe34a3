"""Pairs of channels: exchanged actuators of a kind, and any two with another thrust."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.levels import CLEAR, FINALISTS, ITERATIONS, SLIGHT
from massprop_cli.diagnosis import hypotheses
from massprop_cli.diagnosis.comparison import ROUGHLY, Fitted
from massprop_cli.diagnosis.corrections import correction_of, uncertain_corrections
from massprop_cli.diagnosis.explanation import about_one_channel, chosen, words_of
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.refit import Refit, chi_square_limit, hopeless, refitted_each
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.inputs.notice import Notice


def swapped(screening: Screening) -> Diagnosis | None:
    """Diagnosis by exchanged actuators."""
    return chosen(screening, wired(screening))


def wired(screening: Screening) -> list[Refit]:
    """Refits of exchanged actuators: two, several exchanges in succession, or of few any three."""
    refits, wiring, least = list[Refit](), tuple[int, ...](), np.inf
    for _ in range(ITERATIONS):
        likeliest = _likeliest(screening, hypotheses.swapped(screening.model, screening.names, wiring))
        if not likeliest or screening.likelihood(likeliest[0].chi_square) > least - CLEAR:
            break
        least, wiring = screening.likelihood(likeliest[0].chi_square), likeliest[0].hypothesis.wiring
        refits += _refits(screening, likeliest)
        if any(refit.fits for refit in refits):
            break
    return refits


def two_channels(screening: Screening, one_fits: bool) -> Diagnosis | None:
    """Diagnosis by the thrust of two channels. If one cause fits already, both must differ by more than :data:`SLIGHT`."""
    likeliest = _likeliest(screening, hypotheses.two_channels(screening.model, screening.names))
    fitting = [one for one in _refits(screening, likeliest) if one.fits]
    if one_fits:  # a small change of a channel stands for another misfit
        fitting = [one for one in fitting if not (np.abs(one.fitted.factors - 1) < SLIGHT).any()]
    refit = min(fitting, key=lambda one: one.score, default=None)
    if refit is None:
        return None
    correction, sigma_variants = (
        correction_of(screening.case, refit.case, refit.fitted),
        uncertain_corrections(screening.case, refit.fitted),
    )
    return Diagnosis(
        tuple(
            Fault(Notice(code, f"the log fits if {words}"), correction, around=sigma_variants)
            for name in refit.fitted.hypothesis.subject
            for code, words in [words_of(about_one_channel(refit.fitted, name), screening.names, screening.case, refit.case)]
        ),
        score=refit.score,
    )


def _likeliest(screening: Screening, exchanges: Sequence[Hypothesis]) -> list[Fitted]:
    fits = screening.fitted(exchanges, tolerance=ROUGHLY)
    return sorted(fits, key=lambda one: (screening.likelihood(one.chi_square), one.hypothesis.subject))[:FINALISTS]


def _refits(screening: Screening, likeliest: Sequence[Fitted]) -> list[Refit]:
    return refitted_each(screening, (one for one in likeliest if not hopeless(screening, one, chi_square_limit(screening))))
