"""What values rest on and the log can't tell, or not well, as text: what one step of each assumption does, and what limits values."""

from collections.abc import Sequence

import numpy as np

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.docking import difference_slope
from massprop_cli.report import digits, vocabulary
from massprop_cli.result.schema import Assumption, DockedObject, Effect, PhaseItem, Result

TOLD = 5.0
"""Sigmas of misfit from which on the log itself would tell that an assumption is one step off."""
NOTICED = "the log would notice"
SIGMA = "± sigma"
EXACT_THRUST = f"{SIGMA} (thrust taken as exact)"


@dataclass(frozen=True)
class Sensitivity:
    """One phase: a column for each assumption, a row for each quantity."""

    phase: str
    steps: tuple[tuple[str, str], ...]
    """Code and step of each assumption."""
    rows: tuple[tuple[str, str, tuple[str, ...]], ...]
    """Quantity, unit, and the change of its value for each assumption."""
    noticed: tuple[str, ...]
    """Whether the log would notice each."""


def open_ones(found: Result) -> list[Assumption]:
    """Assumptions that are not verified: the log cannot show them, or the vehicle file does not state them."""
    return [one for one in found.assumptions if not one.stated or one.code in ("thrust-scale", "mass-thrust") or _in_sigma(one)]


def _in_sigma(assumption: Assumption) -> bool:
    """Whether every sigma includes it already; its effects are its part of the sigmas."""
    return assumption.code.startswith("uncertain-")


def sensitivities(shown: Sequence[Assumption]) -> list[Sensitivity]:
    """For each phase that any assumption has a say in."""
    names = dict.fromkeys(effect.phase for assumption in shown for effect in assumption.effects)
    return [_sensitivity(shown, name) for name in names]


def _sensitivity(shown: Sequence[Assumption], phase: str) -> Sensitivity:
    held = [(assumption, effect) for assumption in shown for effect in assumption.effects if effect.phase == phase]
    return Sensitivity(
        phase=phase,
        steps=tuple((assumption.code, assumption.step) for assumption, _ in held),
        rows=tuple(
            (name, vocabulary.unit(UNITS[name]), tuple(_change(effect.change.get(name), _in_sigma(one)) for one, effect in held))
            for name in QUANTITIES
        ),
        noticed=tuple("in sigma" if _in_sigma(assumption) else _noticed(effect.seen_sigma) for assumption, effect in held),
    )


def _change(change: float | None, in_sigma: bool) -> str:
    if change is None:
        return digits.ABSENT
    return f"{'± ' if in_sigma else '+' if change > 0 else ''}{digits.figures(change)}"


def _noticed(seen_sigma: float | None) -> str:
    if seen_sigma is None:
        return "no"
    return f"{'yes' if seen_sigma >= TOLD else 'hardly'}, {digits.figures(seen_sigma)} σ"


def said(assumption: Assumption) -> str:
    """An assumption as a sentence."""
    return f"{assumption.message} [{assumption.code}, {'stated by the vehicle file' if assumption.stated else 'a default'}]"


def sigma_heading(found: Result) -> str:
    """The heading of a column of sigmas; it says so where they include no uncertainty of the thrust."""
    moves = any(assumption.code == "thrust-scale" and assumption.effects for assumption in found.assumptions)
    return EXACT_THRUST if moves and found.vehicle.thrust_scale_sigma == 0 and not found.vehicle.wheels else SIGMA


def implied_thrust(body: PhaseItem | DockedObject) -> str:
    """The thrust scale that a mass from elsewhere implies, as text; empty where there is none."""
    if isinstance(body, DockedObject) or body.implied_thrust_scale is None:
        return ""
    found = body.implied_thrust_scale
    return f"the {found.by.replace('.', ' ')} implies {digits.with_sigma(found.value, found.sigma)} of the stated {found.of}"


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
class AccuracyLimit:
    """The largest contribution to the error of a value."""

    kind: str
    """Noise, known, or what is assumed."""
    size: float
    """By how much, in the value's unit."""
    step: str
    """Of the assumption; empty for what is in the sigma."""
    unit: str

    @property
    def said(self) -> str:
        """The text of a table's cell."""
        return self.kind if not self.step else f"{self.kind}, {self.step}: {digits.figures(self.size)} {vocabulary.unit(self.unit)}"


def limit(name: str, part: PhaseItem | DockedObject, result: Result) -> AccuracyLimit | None:
    """Of one quantity; None without a value or a valid sigma. The thrust scale, which the sigma includes, counts where it dominates."""
    item = part.estimates[name]
    if item.value is None or item.sigma is None or item.verdict not in ("converged", "not_converged"):
        return None
    if name in part.known:
        return AccuracyLimit(KNOWN, item.sigma, "", item.unit)
    stated, own = result.vehicle.thrust_scale_sigma, NOISE
    found = []
    for one, changes in _unnoticed(part, result):
        change = abs(changes.get(name, 0.0))
        if one.code != "thrust-scale" or not stated > 0:
            found.append(AccuracyLimit(KINDS.get(one.code, one.code), change, one.step, item.unit))
        elif 2 * (change * stated / 0.01) ** 2 > item.sigma**2:
            own = KINDS[one.code]
    return max([AccuracyLimit(own, item.sigma, "", item.unit), *found], key=lambda each: each.size)


def _unnoticed(part: PhaseItem | DockedObject, found: Result) -> list[tuple[Assumption, dict[str, float]]]:
    """Assumptions whose error the log cannot show, and the change of each value by one step of them."""
    if isinstance(part, DockedObject):
        return _of_docked(part, found)
    every = [(one, effect) for one in found.assumptions for effect in one.effects]
    return [(one, effect.change) for one, effect in every if effect.phase == part.name and not _told(effect)]


def _of_docked(part: DockedObject, found: Result) -> list[tuple[Assumption, dict[str, float]]]:
    """To first order: the slope of the docked object's ten values, times the changes of both phases' values."""
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
            steps.append((one, dict(zip(QUANTITIES, (slope @ moved).tolist(), strict=True))))
    return steps


def _told(effect: Effect) -> bool:
    return effect.seen_sigma is not None and effect.seen_sigma >= TOLD
