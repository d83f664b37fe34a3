"""Assumptions of a combined result: those of its logs, and what one step of each does to all logs together."""

from collections.abc import Sequence

import numpy as np

from massprop_cli import CG
from massprop_cli.combine.phase import Part, Phased
from massprop_cli.result.schema import BY_OBJECT, Assumption, Effect, PhaseItem

IN_SIGMA = "uncertain-"
"""Begins the codes of what every sigma includes: of that, each log may have its own part."""


def together(found: Sequence[Phased]) -> list[Assumption]:
    """Each assumption of any log once, with its effect on every phase."""
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
    """Whether what is known of the body, or a stated object, gives the scale of the thrust."""
    item, scale = phased.item, phased.item.implied_thrust_scale
    uncertain = phased.parts[0].vehicle.thrust_scale_sigma > 0
    return (scale is not None and scale.by == BY_OBJECT) or (uncertain and any(name not in CG for name in item.known))


def _effect(code: str, step: str, phased: Phased) -> Effect:
    """The mean of the changes of all logs, each quantity weighted by its variances; the log's misfits by their squares."""
    item = phased.item
    own = [_own(code, step, part) for part in phased.parts]
    change = {}
    for name, estimate in item.estimates.items():
        weights = np.array([_weight(part.phase, name) for part in phased.parts])
        moved = np.array([0.0 if one is None else one.change.get(name, 0.0) for one in own])
        if estimate.value is not None and name not in item.known and weights.any() and moved.any():
            change[name] = float(weights @ moved / weights.sum())
    seen = [one.seen_sigma for one in own if one is not None and one.seen_sigma is not None]
    return Effect(phase=item.name, change=change, seen_sigma=float(np.linalg.norm(seen)) if seen else None)


def _own(code: str, step: str, part: Part) -> Effect | None:
    """Of one log, in the phase that counts; None where its values do not rest on that."""
    found = [one for one in part.recorded.result.assumptions if (one.code, one.step) == (code, step)]
    return next((effect for one in found for effect in one.effects if effect.phase == part.phase.name), None)


def _weight(phase: PhaseItem, name: str) -> float:
    sigma = phase.estimates[name].sigma
    return 0.0 if phase.estimates[name].value is None or not sigma else 1 / sigma**2
