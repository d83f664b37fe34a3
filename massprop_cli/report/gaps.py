"""What a result does not tell, and the motion that would."""

from __future__ import annotations

from massprop_cli.judge import parts
from massprop_cli.report import words
from massprop_cli.report.result import EstimateItem, PhaseItem, Result


def gaps(found: Result) -> list[str]:
    """A sentence for each quantity of each phase that is not converged: verdict, reason, cure."""
    return [
        f"{name} in {part}: {gap(name, item)}"
        for part, body in parts(found)
        if isinstance(body, PhaseItem)
        for name, item in body.estimates.items()
        if item.verdict != "converged"
    ]


def gap(quantity: str, item: EstimateItem) -> str:
    """Why a quantity is not converged, and what to do."""
    cure = words.cure(quantity)
    wanted = "" if cure in item.reason else f"; it wants {cure}"
    return f"{item.verdict}: {item.reason}{wanted}"
