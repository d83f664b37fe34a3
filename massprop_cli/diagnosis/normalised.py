"""Columns of a commanded wrench whose largest value is 1: divided by it, or limited to it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.hypotheses import along
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.errorparameters.table import PRIORS
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.telemetry import Log

CODE = "commands-normalised"
EXACT = 1e-6
"""Away from 1, of the largest value of a column that is divided by its largest value."""
FEWEST = 2
"""Torques, or forces, that have it, below which it may be chance."""
SIZE = 3.0
"""Expected size of what a scale differs from 1 by: it may be any."""
LIKELY = -14.0
"""−2 log of the odds (1,000 : 1) of a scale of such columns against any other cause, before the motion speaks for either."""
BEGUN = (1.0, 0.1, 0.01, 10.0)
"""Scales from which on one is looked for: it may be any."""


def ones(log: Log) -> list[str]:
    """Columns of a commanded wrench whose largest value is 1."""
    return [name for name, most in zip(WRENCH, np.abs(log.command).max(0), strict=True) if abs(most - 1) < EXACT]


def suspected(names: Sequence[str], log: Log) -> tuple[str, ...]:
    """Of channels with these ``names`` those that may be normalised; none where torques, or forces, that have it are too few."""
    named = ones(log) if log.command_kind == "wrench" else []
    return tuple(name for name in names if name in named and sum(("torque" in name) == ("torque" in other) for other in named) >= FEWEST)


def supposed(model: Model, names: Sequence[str], own: Sequence[str]) -> list[Hypothesis]:
    """That these columns are normalised, each by a number of its own."""
    # a scale common to all that is commanded shows nowhere
    free = own[:-1] if len(own) == len(names) else own
    if not free:
        return []
    places = [model.place("thrust").start + names.index(name) for name in free]
    units = np.hstack([along(model, ("thrust", SIZE / PRIORS["thrust"] * (np.array(names) == name))) for name in free])
    starts = [dict.fromkeys(places, begin) if begin != 1 else {} for begin in BEGUN]
    return [Hypothesis(CODE, tuple(own), units, start=start, rare=LIKELY) for start in starts]


def renamed(listed: Sequence[Hypothesis], names: Sequence[str], own: Sequence[str]) -> list[Hypothesis]:
    """With what says that some of these give another part of what is stated as one that says that they are normalised.

    Or that all the others do: as well these do, and the body is another.
    """
    others = set(names) - set(own)

    def scales(one: Hypothesis) -> bool:
        about, whole = set(one.subject), all(begin > 0 for begin in one.start.values())
        return one.code == "thrust-scale" and whole and bool(about) and (about <= set(own) or about == others)

    return [replace(one, code=CODE, subject=tuple(own), rare=LIKELY) if own and scales(one) else one for one in listed]
