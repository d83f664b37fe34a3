"""What limits each value: the largest of its own noise and of what one step of an assumption, that the log wouldn't notice, does to it."""

from __future__ import annotations

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.docking import difference_slope
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.assumptions import TOLD
from massprop_cli.result.schema import DockedObject, Effect, PhaseItem, Result

KINDS = {
    "thrust-scale": "thrust scale",
    "mass-thrust": "thrust of some jets",
    "imu-position": "geometry: IMU position",
    "imu-mounting": "geometry: IMU mounting",
    "bearing-position": "geometry: bearing position",
    "initial-attitude": "geometry: attitude at the start",
    "bearing-mass": "bearing's mass",
    "command-delay": "delay",
    "gyro-scale": "gyro scale",
    "accelerometer-scale": "accelerometer scale",
}
"""What an assumption's code is called among the limits."""
NOISE, KNOWN = "noise", "known"


@dataclass(frozen=True)
class Limit:
    """What a value is known no better than."""

    kind: str
    """Noise, known, or what is assumed."""
    size: float
    """By how much, in the value's unit."""
    step: str
    """Of the assumption; empty for what is in the sigma."""
    unit: str

    @property
    def said(self) -> str:
        """As a cell of a table."""
        return self.kind if not self.step else f"{self.kind}, {self.step}: {digits.figures(self.size)} {vocabulary.unit(self.unit)}"


def limit(name: str, part: PhaseItem | DockedObject, result: Result) -> Limit | None:
    """Of one quantity; None where it has no value or no sigma to compare with, or none that holds.

    The thrust scale's stated uncertainty is in the sigma already; it counts as the limit where it is more than the rest of it.
    """
    item = part.estimates[name]
    if item.value is None or item.sigma is None or item.verdict not in ("converged", "not_converged"):
        return None
    if name in part.known:
        return Limit(KNOWN, item.sigma, "", item.unit)
    stated, own = result.vehicle.thrust_scale_sigma, NOISE
    found = []
    for one in _unnoticed(part, result):
        change = abs(one.change.get(name, 0.0))
        if one.code != "thrust-scale" or not stated > 0:
            found.append(Limit(KINDS.get(one.code, one.code), change, one.step, item.unit))
        elif 2 * (change * stated / 0.01) ** 2 > item.sigma**2:
            own = KINDS[one.code]
    return max([Limit(own, item.sigma, "", item.unit), *found], key=lambda each: each.size)


@dataclass(frozen=True)
class _Step:
    """One step of an assumption in one phase."""

    code: str
    step: str
    change: dict[str, float]


def _unnoticed(part: PhaseItem | DockedObject, found: Result) -> list[_Step]:
    """Those that the log itself would not tell; of the docked object what they make of its two phases."""
    if isinstance(part, DockedObject):
        return _of_docked(part, found)
    return [
        _Step(one.code, one.step, effect.change)
        for one in found.assumptions
        for effect in one.effects
        if effect.phase == part.name and not _told(effect)
    ]


def _of_docked(part: DockedObject, found: Result) -> list[_Step]:
    """To first order: the slope of the docked object's ten values, times what both phases' values move by."""
    ends = [phase for name in (part.before, part.after) for phase in found.phases if phase.name == name]
    if len(ends) != 2:
        return []
    values = np.array([[end.estimates[name].value for name in QUANTITIES] for end in ends], dtype=float)
    values[:, -1] -= found.vehicle.bearing_mass_kg
    if not np.isfinite(values).all():
        return []
    slope, steps = difference_slope(*values), []
    for one in found.assumptions:
        effects = {effect.phase: effect for effect in one.effects}
        if not any(_told(effect) for effect in effects.values()):
            moved = [effects[end.name].change.get(name, 0.0) if end.name in effects else 0.0 for end in ends for name in QUANTITIES]
            steps.append(_Step(one.code, one.step, dict(zip(QUANTITIES, (slope @ moved).tolist(), strict=True))))
    return steps


def _told(effect: Effect) -> bool:
    return effect.seen_sigma is not None and effect.seen_sigma >= TOLD
