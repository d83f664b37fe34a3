"""What a result does not tell, and the motion that would; where log and vehicle file contradict each other, no motion would."""

from __future__ import annotations

from massprop_cli.conclude.reason import HARDLY_INFORMED
from massprop_cli.report import vocabulary
from massprop_cli.result.judge import contradiction, parts
from massprop_cli.result.schema import EstimateItem, PhaseItem, Result

NAMES_MOTION = (
    *("no-motion-informs", "sensor-absent", "sensor-absent-mass", "hardly-informed", "no-part"),
    *("unweighed-pedestal", "ratios-only"),
)
"""Reasons that name what would inform a quantity, or that nothing does."""


def gaps(found: Result) -> list[str]:
    """A sentence for each quantity of each phase that is not converged: verdict, reason, cure."""
    return [
        f"{name} in {part}: {gap(name, item, contradiction(body))}"
        for part, body in parts(found)
        if isinstance(body, PhaseItem)
        for name, item in {**body.estimates, **_own(body)}.items()
        if item.verdict != "converged"
    ]


def _own(phase: PhaseItem) -> dict[str, EstimateItem]:
    """What is about the pivot alone, where the ten have no values to say it of."""
    return phase.about_pivot if phase.estimates["izz"].verdict == "unobservable" else {}


def gap(quantity: str, item: EstimateItem, contradicted: str = "") -> str:
    """Why a quantity is not converged, and what to do; ``contradicted`` is the contradiction of its phase."""
    told = f"{item.verdict}: {reason(item, contradicted)}"
    if contradicted and item.verdict != "unobservable":
        return f"{told}; {vocabulary.remedy(quantity, item.verdict, contradicted)}"
    return told if item.reason_code in NAMES_MOTION else f"{told}; it wants {vocabulary.cure(quantity)}"


def reason(item: EstimateItem, contradicted: str = "") -> str:
    """Why, without the motion that it wants where none would help."""
    if item.verdict == "contradicted":
        return contradicted or item.reason
    return HARDLY_INFORMED if contradicted and item.reason_code == "hardly-informed" else item.reason
