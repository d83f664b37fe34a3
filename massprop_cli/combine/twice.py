"""Refusal of the same log given twice: as the same file, within a combined result, or in another file format."""

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.result.read import MEMBERS, Recorded
from massprop_cli.result.schema import PhaseItem, Result

ALIKE = 1e-3
"""Largest difference of values, sigmas, and of sigmas, relative, of one recording in two formats; different recordings differ by more."""
ENOUGH = 3
"""Least number of quantities with values for this comparison."""


def logs(result: Result) -> frozenset[str]:
    """SHA-256 digests of the logs of a result."""
    made = result.provenance
    return frozenset(made.settings.get(MEMBERS) or [made.input_sha256])


def refuse(recorded: Sequence[Recorded]) -> None:
    """Raise :class:`InputError` if two results include the same log."""
    seen: dict[str, Recorded] = {}
    for one in recorded:
        for log in logs(one.result):
            if log in seen:
                raise InputError(f"{one.path}: {_same_log(one, seen[log])}; its information would count twice. Name it once")
        seen |= dict.fromkeys(logs(one.result), one)
    for (first, mine), (one, theirs) in combinations([(one, values_and_sigmas(one.result)) for one in recorded], 2):
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
    """Raise :class:`InputError` if the same phase of a log is on both sides of docking; different phases are allowed."""
    for (first, phase), (one, other) in product(before, after):
        if logs(first.result) & logs(one.result) and phase.name == other.name:
            raise InputError(
                f"{one.path}: phase {other.name} of the same log is on both sides of docking; name the log of the vehicle alone by "
                "--before and that with the object by --after"
            )


def values_and_sigmas(result: Result) -> Array:
    """(10 per phase, 2) values and sigmas, NaN without an estimate."""
    estimates = [phase.estimates[name] for phase in result.phases for name in QUANTITIES]
    return np.array([(item.value, item.sigma) for item in estimates], dtype=float)


def alike(mine: Array, theirs: Array) -> bool:
    """Whether values and sigmas (n, 2), NaN without an estimate, are those of the same recording."""
    if mine.shape != theirs.shape or (np.isnan(mine) != np.isnan(theirs)).any():
        return False
    known = ~np.isnan(mine).any(1)
    return known.sum() >= ENOUGH and bool((np.abs(mine - theirs)[known] <= ALIKE * mine[known, 1:]).all())
