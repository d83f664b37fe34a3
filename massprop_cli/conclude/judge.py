"""Conclusions, judged by all that was found: what is contradicted, the docked object, and every notice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis, MendedAnswer
from massprop_cli.conclude.contradict import Contradiction, by_faults, by_known, by_lost, by_misfit, by_no_body, together, unheld
from massprop_cli.conclude.docking import Docked, docked_object, lighter, masses_apart
from massprop_cli.conclude.executed import unexecuted
from massprop_cli.conclude.physical import breach
from massprop_cli.conclude.reason import REPORTED, Reason
from massprop_cli.conclude.score import by_doubts, hanging
from massprop_cli.conclude.swing import swinging
from massprop_cli.conclude.verdict import Conclusion, contradicted, in_doubt
from massprop_cli.conclude.white import unlike_noise
from massprop_cli.diagnosis import UNKNOWN
from massprop_cli.inputs.telemetry import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved


def judged(found: Analysis, mended: Sequence[MendedAnswer]) -> Analysis:
    """With what is contradicted, the docked object, and every notice."""
    each = [_one(found, i, mended) for i in range(len(found.conclusions))]
    conclusions, factors = tuple(conclusion for conclusion, _ in each), tuple(factor for _, factor in each)
    docked = docked_object(conclusions, found.vehicle)
    notices = tuple(_notices(found, conclusions, docked))
    return replace(found, conclusions=conclusions, docked=docked, notices=notices, lack_of_fit=factors, mended=tuple(mended))


def _one(found: Analysis, i: int, mended: Sequence[MendedAnswer]) -> tuple[Conclusion, Array]:
    """One phase's conclusion; and (6,) by how much too small its sigmas are, channel by channel."""
    conclusion, settled = found.conclusions[i], found.settled[i]
    own = [f for f in found.faults if f.change_s is None or conclusion.phase.start_s < f.change_s < conclusion.phase.end_s]
    answers = [next((c for c in answer.conclusions if c.phase.name == conclusion.phase.name), None) for answer in mended]
    against = [
        by_faults(conclusion, own, answers, [values[i] for answer in mended for values in answer.rivals]),
        by_known(found.histories[i]),
    ]
    factor: Array = np.ones(6)
    if isinstance(found.vehicle, Resolved):
        misfit, factor = by_misfit(conclusion, settled, found.samples, found.vehicle, found.stated)
        doubted, lost = by_doubts(conclusion, i, found.doubts), by_lost(found.histories[i], settled)
        nameless = [_explained(misfit, found.unknown), doubted, lost, by_no_body(conclusion)]
        against += [] if own else nameless
    cause = together(against)
    if found.unknown or (own and all(fault.notice.code == UNKNOWN for fault in own)):
        conclusion = in_doubt(conclusion, unheld(conclusion, found.vehicle))
    elif not own:
        conclusion = in_doubt(conclusion, hanging(conclusion, i, found.doubts, settled.natural_sizes))
        # against a floor that stands in for noise no model fits
        if isinstance(found.vehicle, Resolved) and all(notice.code != "noise-floor" for notice in found.notices):
            swing = swinging(settled, found.samples, found.vehicle, found.stated)
            lost_commands = unexecuted(settled, found.samples, found.vehicle)
            conclusion = in_doubt(conclusion, unlike_noise(settled, found.vehicle) | swing | lost_commands)
    return conclusion if cause is None else contradicted(conclusion, cause.causes, cause.touched), factor


def _explained(against: Contradiction | None, unknown: str) -> Contradiction | None:
    """With what was tried to find its cause."""
    return (
        against if against is None or not unknown else replace(against, causes=(Reason.of("unexplained", message=unknown), *against.causes))
    )


def _notices(found: Analysis, conclusions: tuple[Conclusion, ...], docked: Docked | None) -> Iterator[Notice]:
    causes = [fault.notice for fault in found.faults if fault.notice not in found.notices]
    yield from causes
    for conclusion in conclusions:
        if conclusion.causes and not any(cause.code in REPORTED for cause in conclusion.causes):
            yield Notice("contradicted", f"phase {conclusion.phase.name}: {conclusion.contradiction}")
    yield from found.notices
    yield from _physical(found.conclusions)
    yield from _docking_notices(docked, conclusions, found.vehicle)


def _docking_notices(docked: Docked | None, conclusions: tuple[Conclusion, ...], used: Vehicle) -> list[Notice]:
    apart = masses_apart(conclusions, used) if docked is None else None
    if apart is not None:
        message = (
            f"the two phases' masses differ by {apart[0]:.3g} ± {apart[1]:.2g} kg, too little to tell of a docking, so no docked object is "
            "given; name the phases under [docking] (before, after) if there is one"
        )
        return [Notice("no-docked-object", message)]
    mass = docked.estimates["mass"].value if docked else None
    if docked is None or mass is None or mass > 0:
        return []
    return [Notice("docked-mass", str(lighter(mass, f"phase {docked.after}", f"phase {docked.before}", "mend [docking]")))]


def _physical(conclusions: Sequence[Conclusion]) -> list[Notice]:
    found = []
    for conclusion in conclusions:
        broken = breach(conclusion)
        if broken is not None and broken.certain:
            found.append(Notice("unphysical-inertia", f"phase {conclusion.phase.name}: {broken.said}"))
    return found
