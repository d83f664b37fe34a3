"""Assumptions that the log cannot test, as text: the sensitivity of values to each assumption, and the largest error contribution."""

from collections.abc import Sequence

import numpy as np

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.docking import difference_slope
from massprop_cli.report import digits, vocabulary
from massprop_cli.result.schema import Assumption, DockedObject, Effect, PhaseItem, Result

DETECTABLE = 5.0
"""Smallest misfit, sigmas, at which the log shows that an assumption is wrong by one step."""
NOTICED = "the log would notice"
SIGMA = "± sigma"
EXACT_THRUST = f"{SIGMA} (thrust taken as exact)"


@dataclass(frozen=True)
class Sensitivity:
    """Changes of one phase's values for one step of each assumption, as text."""

    phase: str
    steps: tuple[tuple[str, str], ...]
    """Code and step of each assumption."""
    rows: tuple[tuple[str, str, tuple[str, ...]], ...]
    """Quantity, unit, and change of its value for each assumption."""
    noticed: tuple[str, ...]
    """Whether the log would show a wrong assumption, for each."""


def unverified(result: Result) -> list[Assumption]:
    """Assumptions that the log cannot test, or that the vehicle file does not state."""
    return [one for one in result.assumptions if not one.stated or one.code in ("thrust-scale", "mass-thrust") or _in_sigma(one)]


def _in_sigma(assumption: Assumption) -> bool:
    """Whether the sigmas include the assumption's uncertainty; its effects are then parts of the sigmas."""
    return assumption.code.startswith("uncertain-")


def sensitivities(shown: Sequence[Assumption]) -> list[Sensitivity]:
    """Sensitivities of each phase with an effect of these assumptions."""
    names = dict.fromkeys(effect.phase for assumption in shown for effect in assumption.effects)
    return [_sensitivity(shown, name) for name in names]


def _sensitivity(shown: Sequence[Assumption], phase: str) -> Sensitivity:
    effects = [(assumption, effect) for assumption in shown for effect in assumption.effects if effect.phase == phase]
    return Sensitivity(
        phase=phase,
        steps=tuple((assumption.code, assumption.step) for assumption, _ in effects),
        rows=tuple(
            (name, vocabulary.unit(UNITS[name]), tuple(_change(effect.change.get(name), _in_sigma(one)) for one, effect in effects))
            for name in QUANTITIES
        ),
        noticed=tuple("in sigma" if _in_sigma(assumption) else _noticed(effect.seen_sigma) for assumption, effect in effects),
    )


def _change(change: float | None, in_sigma: bool) -> str:
    """A change, or a part of a sigma, as text."""
    if change is None:
        return digits.ABSENT
    return f"{'± ' if in_sigma else '+' if change > 0 else ''}{digits.figures(change)}"


def _noticed(seen_sigma: float | None) -> str:
    """Whether the log would show the assumption wrong, with the misfit in sigmas."""
    if seen_sigma is None:
        return "no"
    return f"{'yes' if seen_sigma >= DETECTABLE else 'hardly'}, {digits.figures(seen_sigma)} σ"


def sentence(assumption: Assumption) -> str:
    """An assumption as a sentence."""
    return f"{assumption.message} [{assumption.code}, {'stated by the vehicle file' if assumption.stated else 'a default'}]"


def sigma_heading(result: Result) -> str:
    """Heading of a column of sigmas, with a note if they do not include a thrust uncertainty."""
    moves = any(assumption.code == "thrust-scale" and assumption.effects for assumption in result.assumptions)
    return EXACT_THRUST if moves and result.vehicle.thrust_scale_sigma == 0 and not result.vehicle.wheels else SIGMA


def implied_thrust(body: PhaseItem | DockedObject) -> str:
    """The thrust scale that an independently known mass implies, as text; empty without one."""
    if isinstance(body, DockedObject) or body.implied_thrust_scale is None:
        return ""
    implied = body.implied_thrust_scale
    return f"the {implied.by.replace('.', ' ')} implies {digits.with_sigma(implied.value, implied.sigma)} of the stated {implied.of}"


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
"""Short name of an assumption by its code, for accuracy limits."""
NOISE, KNOWN = "noise", "known"


@dataclass(frozen=True)
class AccuracyLimit:
    """Largest contribution to the error of a value."""

    kind: str
    """"noise", "known", or the short name of an assumption."""
    size: float
    """Size of the contribution, in ``unit``."""
    step: str
    """Step of the assumption; empty for a contribution to the sigma."""
    unit: str

    @property
    def text(self) -> str:
        """Text of a table cell."""
        return self.kind if not self.step else f"{self.kind}, {self.step}: {digits.figures(self.size)} {vocabulary.unit(self.unit)}"


def limit(name: str, part: PhaseItem | DockedObject, result: Result) -> AccuracyLimit | None:
    """Largest error contribution of one quantity; None without a value or a valid sigma.

    The sigma is one contribution: "thrust scale" if this makes more than half of its variance, else "noise".
    """
    item = part.estimates[name]
    if item.value is None or item.sigma is None or item.verdict not in ("converged", "not_converged"):
        return None
    if name in part.known:
        return AccuracyLimit(KNOWN, item.sigma, "", item.unit)
    stated, in_sigma = result.vehicle.thrust_scale_sigma, NOISE
    contributions = []
    for one, changes in _undetectable(part, result):
        change = abs(changes.get(name, 0.0))
        if one.code != "thrust-scale" or not stated > 0:
            contributions.append(AccuracyLimit(KINDS.get(one.code, one.code), change, one.step, item.unit))
        elif 2 * (change * stated / 0.01) ** 2 > item.sigma**2:
            in_sigma = KINDS[one.code]
    return max([AccuracyLimit(in_sigma, item.sigma, "", item.unit), *contributions], key=lambda each: each.size)


def _undetectable(part: PhaseItem | DockedObject, result: Result) -> list[tuple[Assumption, dict[str, float]]]:
    """Assumptions whose error the log cannot show, with the change of each value for one step."""
    if isinstance(part, DockedObject):
        return _of_docked(part, result)
    every = [(one, effect) for one in result.assumptions for effect in one.effects]
    return [(one, effect.change) for one, effect in every if effect.phase == part.name and not _detectable(effect)]


def _of_docked(part: DockedObject, result: Result) -> list[tuple[Assumption, dict[str, float]]]:
    """The same for a docked object, to first order: the derivative of its ten values times the changes of both phases' values."""
    ends = [phase for name in (part.before, part.after) for phase in result.phases if phase.name == name]
    if len(ends) != 2:
        return []
    values = np.array([[end.estimates[name].value for name in QUANTITIES] for end in ends], dtype=float)
    values[:, -1] -= result.vehicle.bearing_mass_kg
    if not np.isfinite(values).all():
        return []
    slope, steps = difference_slope(*values), []
    for one in result.assumptions:
        effects = {effect.phase: effect for effect in one.effects}
        if not any(_detectable(effect) for effect in effects.values()):
            changes = [effects[end.name].change.get(name, 0.0) if end.name in effects else 0.0 for end in ends for name in QUANTITIES]
            steps.append((one, dict(zip(QUANTITIES, (slope @ changes).tolist(), strict=True))))
    return steps


def _detectable(effect: Effect) -> bool:
    """Whether the log would show an error of one step."""
    return effect.seen_sigma is not None and effect.seen_sigma >= DETECTABLE
