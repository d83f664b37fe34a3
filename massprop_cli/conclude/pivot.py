"""What a fixed pedestal lets a log tell: inertia and first moment about the pivot, and of the ten what a weighed mass makes of them."""

from collections.abc import Set
from dataclasses import replace
from typing import Literal

import numpy as np

from massprop_cli import ABOUT_PIVOT, PIVOT_UNITS, QUANTITIES
from massprop_cli.conclude.analysis import Analysis, MendedAnswer
from massprop_cli.conclude.assumptions import AssumptionEffects
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Conclusion, Estimate
from massprop_cli.inputs.vehicle import Vehicle


def with_pivot(found: Analysis) -> Analysis:
    """The analysis with ``about_pivot`` in each conclusion, on a bearing or a fixed pedestal."""
    if not found.vehicle.pivoted:
        return found
    swings = not len(found.samples.capability)

    def shown(of: Analysis | MendedAnswer) -> tuple[Conclusion, ...]:
        return tuple(_with_pivot(one, of.vehicle.in_phase(one.phase), swings) for one in of.conclusions)

    conclusions, mended = shown(found), tuple(replace(answer, conclusions=shown(answer)) for answer in found.mended)
    unweighed = {one.phase.name for one in conclusions if one.estimates["cg_x"].verdict == "unobservable"}
    rests_on = tuple(_beside_mass(one, unweighed) for one in found.assumptions)
    return replace(found, conclusions=conclusions, mended=mended, assumptions=rests_on)


def _beside_mass(assumption: AssumptionEffects, unweighed: Set[str]) -> AssumptionEffects:
    """Without what it does to quantities that aren't reported."""
    effects = tuple(replace(effect, change={}) if effect.phase in unweighed else effect for effect in assumption.effects)
    return replace(assumption, effects=effects)


def _with_pivot(conclusion: Conclusion, vehicle: Vehicle, swings: bool) -> Conclusion:
    """With the nine; on a pedestal the ten are hidden where no mass makes them known."""
    if not vehicle.on_pedestal:
        return replace(conclusion, about_pivot={} if conclusion.pivot is None else estimates_about(conclusion))
    untold = swings and not vehicle.knows_inertia
    about = {} if conclusion.pivot is None else estimates_about(conclusion, "ratios-only" if untold else "")
    if "mass" in vehicle.known and not untold:
        return replace(conclusion, about_pivot=about)
    unweighed = "mass" not in vehicle.known
    reasons = {name: Reason("ratios-only" if untold else "unweighed-pedestal") for name in QUANTITIES}
    reasons["mass"] = Reason("unweighed-pedestal")
    hidden = {name: _hidden(one, reasons[name]) for name, one in conclusion.estimates.items() if unweighed or name != "mass"}
    shown = conclusion.estimates | hidden
    known = np.array([one.value is not None for one in shown.values()])
    covariance = np.where(known[:, None] & known, conclusion.covariance, np.nan)
    return replace(
        conclusion, about_pivot=about, estimates=shown, covariance=covariance, bare=(np.full(10, np.nan), np.full((10, 10), np.nan))
    )


def estimates_about(conclusion: Conclusion, untold: Literal["", "ratios-only"] = "") -> dict[str, Estimate]:
    """The nine with the verdicts of the ten that they correspond to; ``untold`` is why they have no values."""
    assert conclusion.pivot is not None
    values, sigmas = conclusion.pivot[0], np.sqrt(np.maximum(np.diag(conclusion.pivot[1]), 0.0))
    found = {}
    for name, like, value, sigma in zip(ABOUT_PIVOT, QUANTITIES, values, sigmas, strict=False):
        own = conclusion.estimates[like]
        told = own.value is not None and np.isfinite(value + sigma)
        found[name] = replace(own, value=float(value) if told else None, sigma=float(sigma) if told else None, unit=PIVOT_UNITS[name])
        if untold:
            found[name] = _hidden(found[name], Reason(untold))
    return found


def _hidden(estimate: Estimate, reason: Reason) -> Estimate:
    return replace(estimate, value=None, sigma=None, verdict="unobservable", final_at_s=None, reason=reason)
