"""The same log given twice, which would count its information twice: by its bytes, within joint results, and in another file format."""

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.result.read import MEMBERS, Recorded
from massprop_cli.result.schema import PhaseItem, Result

ALIKE = 1e-3
"""Sigmas, and part of a sigma, within which all values of two recordings never are by chance; rounding by a format is less."""
ENOUGH = 3
"""Quantities that must be told to say so."""


def logs(result: Result) -> frozenset[str]:
    """Digests of the logs that a result is of."""
    made = result.provenance
    return frozenset(made.settings.get(MEMBERS) or [made.input_sha256])


def refuse(recorded: Sequence[Recorded]) -> None:
    """:class:`InputError` where two of these results hold the same log."""
    seen: dict[str, Recorded] = {}
    for one in recorded:
        for log in logs(one.result):
            if log in seen:
                raise InputError(f"{one.path}: {_same_log(one, seen[log])}; its information would count twice. Name it once")
        seen |= dict.fromkeys(logs(one.result), one)
    for (first, mine), (one, theirs) in combinations([(one, told(one.result)) for one in recorded], 2):
        if alike(mine, theirs):
            raise InputError(
                f"{one.path}: all values and sigmas are those of {first.path}: the same recording in another file, whose information would "
                "count twice. Name one of them"
            )


def _same_log(one: Recorded, first: Recorded) -> str:
    if one.path.resolve() == first.path.resolve():
        return "is named twice"
    return f"{'shares a log with' if one.joint or first.joint else 'is of the same log as'} {first.path}"


def refuse_across(before: Sequence[tuple[Recorded, PhaseItem]], after: Sequence[tuple[Recorded, PhaseItem]]) -> None:
    """:class:`InputError` where one phase of one log stands on both sides of docking; its other phases may."""
    for (first, phase), (one, other) in product(before, after):
        if logs(first.result) & logs(one.result) and phase.name == other.name:
            raise InputError(
                f"{one.path}: phase {other.name} of the same log stands before docking and after it; name the log of the vehicle alone by "
                "--before and that with the object by --after"
            )


def told(result: Result) -> Array:
    """(10 per phase, 2) values and sigmas, NaN where nothing can be said."""
    estimates = [phase.estimates[name] for phase in result.phases for name in QUANTITIES]
    return np.array([(item.value, item.sigma) for item in estimates], dtype=float)


def alike(mine: Array, theirs: Array) -> bool:
    """Whether values and sigmas (n, 2), NaN where nothing can be said, are those of the same recording."""
    if mine.shape != theirs.shape or (np.isnan(mine) != np.isnan(theirs)).any():
        return False
    told = ~np.isnan(mine).any(1)
    return told.sum() >= ENOUGH and bool((np.abs(mine - theirs)[told] <= ALIKE * mine[told, 1:]).all())
