"""Columns of a commanded wrench whose largest value is 1: normalised, or limited to it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import ROUNDING
from massprop_cli.base.levels import CLEAR
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.hypotheses import along
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.errorparameters.table import PRIORS
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.telemetry import Log

CODE = "commands-normalised"
FEWEST = 2
"""Least number of such torques or forces; one may be chance."""
SIZE = 3.0
"""Prior sigma of a scale less 1."""
BEGUN = (1.0, 0.1, 0.01, 10.0)
"""Initial scales."""


def unit_columns(log: Log) -> list[str]:
    """Columns of a commanded wrench whose largest value is 1."""
    return [name for name, most in zip(WRENCH, np.abs(log.command).max(0), strict=True) if abs(most - 1) < ROUNDING]


def suspected(names: Sequence[str], log: Log) -> tuple[str, ...]:
    """Channels that may be normalised; none if such torques, or forces, are too few."""
    named = unit_columns(log) if log.command_kind == "wrench" else []
    return tuple(name for name in names if name in named and sum(("torque" in name) == ("torque" in other) for other in named) >= FEWEST)


def scale_hypotheses(model: Model, names: Sequence[str], normalised_names: Sequence[str]) -> list[Hypothesis]:
    """Hypotheses that these columns are normalised, each with its own scale."""
    # a scale common to all commands is not observable
    free = normalised_names[:-1] if len(normalised_names) == len(names) else normalised_names
    if not free:
        return []
    places = [model.place("thrust").start + names.index(name) for name in free]
    units = np.hstack([along(model, ("thrust", SIZE / PRIORS["thrust"] * (np.array(names) == name))) for name in free])
    starts = [dict.fromkeys(places, scale) if scale != 1 else {} for scale in BEGUN]
    return [Hypothesis(CODE, tuple(normalised_names), units, initial_values=start, prior_odds=-CLEAR) for start in starts]


def renamed(listed: Sequence[Hypothesis], names: Sequence[str], own: Sequence[str]) -> list[Hypothesis]:
    """Hypotheses with the code of normalised commands where they scale such columns, or all other columns, which is equivalent."""
    others = set(names) - set(own)

    def scales(one: Hypothesis) -> bool:
        subject, positive = set(one.subject), all(begin > 0 for begin in one.initial_values.values())
        return one.code == "thrust-scale" and positive and bool(subject) and (subject <= set(own) or subject == others)

    return [replace(one, code=CODE, subject=tuple(own), prior_odds=-CLEAR) if own and scales(one) else one for one in listed]
