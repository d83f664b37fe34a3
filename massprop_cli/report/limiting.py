"""What limits each value: the largest of its own noise and of what one step of an assumption, that the log wouldn't notice, does to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from massprop_cli.report import digits
from massprop_cli.report.assumptions import TOLD
from massprop_cli.result.schema import Assumption, DockedObject, PhaseItem, Result

KINDS = {
    "thrust-scale": "thrust scale",
    "mass-thrust": "thrust scale",
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

    @property
    def said(self) -> str:
        """As a cell of a table."""
        return self.kind if not self.step else f"{self.kind}, {self.step}: {digits.figures(self.size)}"


def limit(name: str, part: PhaseItem | DockedObject, result: Result) -> Limit | None:
    """Of one quantity; None where it has no value or no sigma to compare with, or none that holds.

    The thrust scale's stated uncertainty is in the sigma already; it counts as the limit where it is more than the rest of it.
    """
    item = part.estimates[name]
    if item.value is None or item.sigma is None or item.verdict not in ("converged", "not_converged"):
        return None
    if name in part.known:
        return Limit(KNOWN, item.sigma, "")
    stated, own = result.vehicle.thrust_scale_sigma, NOISE
    found = []
    for one in _unnoticed(part, result.assumptions):
        change = abs(one.change.get(name, 0.0))
        if one.code != "thrust-scale" or not stated > 0:
            found.append(Limit(KINDS.get(one.code, one.code), change, one.step))
        elif 2 * (change * stated / 0.01) ** 2 > item.sigma**2:
            own = KINDS[one.code]
    return max([Limit(own, item.sigma, ""), *found], key=lambda each: each.size)


@dataclass(frozen=True)
class _Step:
    """One step of an assumption in one phase."""

    code: str
    step: str
    change: dict[str, float]


def _unnoticed(part: PhaseItem | DockedObject, assumptions: Sequence[Assumption]) -> list[_Step]:
    """Those of a phase that the log itself would not tell; of the docked object none are known."""
    if isinstance(part, DockedObject):
        return []
    return [
        _Step(one.code, one.step, effect.change)
        for one in assumptions
        for effect in one.effects
        if effect.phase == part.name and (effect.seen_sigma is None or effect.seen_sigma < TOLD)
    ]
