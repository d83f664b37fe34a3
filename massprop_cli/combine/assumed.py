"""Assumptions of a combined result: those of its logs, and the effect of one step of each on the combined values."""

from collections.abc import Sequence

import numpy as np

from massprop_cli import CG
from massprop_cli.combine.phase import Part, Phased
from massprop_cli.result.schema import BY_OBJECT, Assumption, Effect, PhaseItem

IN_SIGMA = "uncertain-"
"""Prefix of the codes of uncertainties that every sigma includes; these are omitted, because they differ between the logs."""


def together(found: Sequence[Phased]) -> list[Assumption]:
    """Assumptions of all logs, each once, with its effect on every phase."""
    every = [one for phased in found for part in phased.parts for one in part.recorded.result.assumptions]
    kept = {(one.code, one.step): one for one in reversed(every) if not one.code.startswith(IN_SIGMA)}
    listed = []
    for (code, step), one in reversed(kept.items()):
        effects = [_effect(code, step, phased) for phased in found if not (code == "thrust-scale" and _calibrated(phased))]
        effects = [effect for effect in effects if effect.change or effect.seen_sigma is not None]
        if effects:
            listed.append(one.model_copy(update={"effects": effects}))
    return listed


def _calibrated(phased: Phased) -> bool:
    """Whether a known value or a stated object calibrates the thrust scale."""
    item, scale = phased.item, phased.item.implied_thrust_scale
    uncertain = phased.parts[0].vehicle.thrust_scale_sigma > 0
    return (scale is not None and scale.by == BY_OBJECT) or (uncertain and any(name not in CG for name in item.known))


def _effect(code: str, step: str, phased: Phased) -> Effect:
    """Mean effect of all logs, weighted by the inverse variance of each quantity; misfits are added in squares."""
    item = phased.item
    effects = [_log_effect(code, step, part) for part in phased.parts]
    change = {}
    for name, estimate in item.estimates.items():
        weights = np.array([_weight(part.phase, name) for part in phased.parts])
        changes = np.array([0.0 if one is None else one.change.get(name, 0.0) for one in effects])
        if estimate.value is not None and name not in item.known and weights.any() and changes.any():
            change[name] = float(weights @ changes / weights.sum())
    misfits = [one.seen_sigma for one in effects if one is not None and one.seen_sigma is not None]
    return Effect(phase=item.name, change=change, seen_sigma=float(np.linalg.norm(misfits)) if misfits else None)


def _log_effect(code: str, step: str, part: Part) -> Effect | None:
    """Effect of an assumption on one log; None if the log has none."""
    found = [one for one in part.recorded.result.assumptions if (one.code, one.step) == (code, step)]
    return next((effect for one in found for effect in one.effects if effect.phase == part.phase.name), None)


def _weight(phase: PhaseItem, name: str) -> float:
    """Inverse variance of a quantity; 0 without a value."""
    sigma = phase.estimates[name].sigma
    return 0.0 if phase.estimates[name].value is None or not sigma else 1 / sigma**2
