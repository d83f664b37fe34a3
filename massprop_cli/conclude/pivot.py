"""Conclusions about a pivot: inertia and first moment about it, and the ten quantities where a known mass makes them observable."""

from collections.abc import Set
from dataclasses import replace
from typing import Literal

import numpy as np

from massprop_cli import ABOUT_PIVOT, PIVOT_UNITS, QUANTITIES
from massprop_cli.conclude.analysis import Analysis, CorrectedEstimate
from massprop_cli.conclude.assumptions import AssumptionEffects
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Conclusion, Estimate
from massprop_cli.inputs.vehicle import Vehicle


def with_pivot(found: Analysis) -> Analysis:
    """The analysis with ``about_pivot`` in each conclusion, on an air bearing or a fixed pedestal."""
    if not found.vehicle.pivoted:
        return found
    free_swing = not len(found.samples.capability)

    def conclusions_of(of: Analysis | CorrectedEstimate) -> tuple[Conclusion, ...]:
        return tuple(_with_pivot(one, of.vehicle.in_phase(one.phase), free_swing) for one in of.conclusions)

    conclusions, mended = conclusions_of(found), tuple(replace(one, conclusions=conclusions_of(one)) for one in found.mended)
    unweighed = {one.phase.name for one in conclusions if one.estimates["cg_x"].verdict == "unobservable"}
    effects = tuple(_reported_effects(one, unweighed) for one in found.assumptions)
    return replace(found, conclusions=conclusions, mended=mended, assumptions=effects)


def _reported_effects(assumption: AssumptionEffects, unweighed: Set[str]) -> AssumptionEffects:
    """The assumption without its effects on the unreported quantities of the phases ``unweighed``."""
    effects = tuple(replace(effect, change={}) if effect.phase in unweighed else effect for effect in assumption.effects)
    return replace(assumption, effects=effects)


def _with_pivot(conclusion: Conclusion, vehicle: Vehicle, free_swing: bool) -> Conclusion:
    """The conclusion with the nine quantities about the pivot; on a pedestal the ten become unobservable without a known mass."""
    if not vehicle.on_pedestal:
        return replace(conclusion, about_pivot={} if conclusion.pivot is None else estimates_about(conclusion))
    ratios_only = free_swing and not vehicle.knows_inertia
    about = {} if conclusion.pivot is None else estimates_about(conclusion, "ratios-only" if ratios_only else "")
    if "mass" in vehicle.known and not ratios_only:
        return replace(conclusion, about_pivot=about)
    unweighed = "mass" not in vehicle.known
    reasons = {name: Reason("ratios-only" if ratios_only else "unweighed-pedestal") for name in QUANTITIES}
    reasons["mass"] = Reason("unweighed-pedestal")
    hidden = {name: _unobservable(one, reasons[name]) for name, one in conclusion.estimates.items() if unweighed or name != "mass"}
    estimates = conclusion.estimates | hidden
    known = np.array([one.value is not None for one in estimates.values()])
    covariance = np.where(known[:, None] & known, conclusion.covariance, np.nan)
    return replace(
        conclusion, about_pivot=about, estimates=estimates, covariance=covariance, bare=(np.full(10, np.nan), np.full((10, 10), np.nan))
    )


def estimates_about(conclusion: Conclusion, unobservable: Literal["", "ratios-only"] = "") -> dict[str, Estimate]:
    """Nine estimates about the pivot, with the verdicts of the corresponding ten; ``unobservable`` is the reason for no values."""
    assert conclusion.pivot is not None
    values, sigmas = conclusion.pivot[0], np.sqrt(np.maximum(np.diag(conclusion.pivot[1]), 0.0))
    estimates = {}
    for name, counterpart, value, sigma in zip(ABOUT_PIVOT, QUANTITIES, values, sigmas, strict=False):
        one = conclusion.estimates[counterpart]
        known = one.value is not None and np.isfinite(value + sigma)
        estimates[name] = replace(one, value=float(value) if known else None, sigma=float(sigma) if known else None, unit=PIVOT_UNITS[name])
        if unobservable:
            estimates[name] = _unobservable(estimates[name], Reason(unobservable))
    return estimates


def _unobservable(estimate: Estimate, reason: Reason) -> Estimate:
    """The estimate without a value, for this reason."""
    return replace(estimate, value=None, sigma=None, verdict="unobservable", final_at_s=None, reason=reason)
