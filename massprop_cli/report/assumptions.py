"""What the values rest on and the log can't tell, or not well, as text: what one step of each assumption does to each value."""

from __future__ import annotations

from collections.abc import Sequence

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.dataclass import dataclass
from massprop_cli.report import digits, vocabulary
from massprop_cli.result.schema import Assumption, DockedObject, PhaseItem, Result

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
    """Those that nothing vouches for: what no log can tell, and what the vehicle file does not state."""
    return [one for one in found.assumptions if not one.stated or one.code in ("thrust-scale", "mass-thrust") or _in_sigma(one)]


def _in_sigma(assumption: Assumption) -> bool:
    """Whether it is an uncertainty that every sigma holds already; its effects are what it adds to them."""
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
    """One assumption in words."""
    return f"{assumption.message} [{assumption.code}, {'stated by the vehicle file' if assumption.stated else 'a default'}]"


def sigma_heading(found: Result) -> str:
    """What a column of sigmas is called: they hold nothing of the thrust's uncertainty where none is stated, whatever else is known."""
    moves = any(assumption.code == "thrust-scale" and assumption.effects for assumption in found.assumptions)
    return EXACT_THRUST if moves and found.vehicle.thrust_scale_sigma == 0 and not found.vehicle.wheels else SIGMA


def implied_thrust(body: PhaseItem | DockedObject) -> str:
    """What a mass from elsewhere says of the thrust; empty where there is none."""
    if isinstance(body, DockedObject) or body.implied_thrust_scale is None:
        return ""
    found = body.implied_thrust_scale
    value, sigma = digits.numbers(found.value, found.sigma)
    return f"the {found.by.replace('.', ' ')} implies {value} ± {sigma} of the stated thrust"
