"""Final verdicts of all phases, the docked object, and all notices."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis, MendedAnswer
from massprop_cli.conclude.constancy import constancy_test
from massprop_cli.conclude.contradict import Contradiction, by_faults, by_known, by_lost, by_misfit, by_no_body, by_size, together, unheld
from massprop_cli.conclude.discrepancy import Discrepancy, discrepancy, with_discrepancy, with_touched
from massprop_cli.conclude.docking import Docked, backwards, docked_object, lighter, masses_apart
from massprop_cli.conclude.lostcommands import lost_commands_test
from massprop_cli.conclude.oscillation import oscillation_test
from massprop_cli.conclude.physical import breach
from massprop_cli.conclude.reason import REPORTED, Reason
from massprop_cli.conclude.score import by_doubts, hanging, unseen
from massprop_cli.conclude.verdict import Conclusion, contradicted, in_doubt
from massprop_cli.conclude.whiteness import whiteness_test
from massprop_cli.diagnosis import UNKNOWN
from massprop_cli.diagnosis.design import Case, Designs
from massprop_cli.diagnosis.normalised import FEWEST, ones
from massprop_cli.diagnosis.screening import busiest, screened
from massprop_cli.estimate.discrepancy import LEAST
from massprop_cli.estimate.disturbances import beyond_commands, sized
from massprop_cli.estimate.history import History
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved

AT_ORIGIN = (4.0, 0.005)
"""Sigmas, and part of the vehicle's size, within which a CG is at O."""
SWINGS = 8.0
"""Cycles beyond which what swings on is no misfit of timing."""


def judged(found: Analysis, mended: Sequence[MendedAnswer] = ()) -> Analysis:
    """With what is contradicted, the docked object, and every notice.

    Values of a log that does not fit come beside all error parameters (:mod:`massprop_cli.conclude.discrepancy`).
    """
    each = [_one(found, i, mended) for i in range(len(found.conclusions))]
    told = tuple(one.discrepancy for one in each)
    at_origin = [_at_origin(found, i, one.conclusion) for i, one in enumerate(each)]
    scaled_alike, hanging = _untold_scale(found)
    scaled = dict.fromkeys(hanging, Reason.of("scale-untold"))
    untold = [scaled | (dict.fromkeys(CG, Reason.of("wrench-point-untold")) if at else {}) for at in at_origin]
    conclusions = tuple(in_doubt(one.conclusion, reasons) for one, reasons in zip(each, untold, strict=True))
    docked = docked_object(conclusions, found.vehicle)
    named = any(fault.notice.code != UNKNOWN for fault in found.faults)
    notices = (
        *_discrepancies(conclusions, told, named),
        *_notices(found, conclusions, docked, at_origin),
        *_normalised(scaled_alike, found.unknown),
    )
    factors = tuple(one.factor for one in each)
    return replace(
        found, conclusions=conclusions, docked=docked, notices=notices, lack_of_fit=factors, mended=tuple(mended), discrepancies=told
    )


class _Judged(NamedTuple):
    conclusion: Conclusion
    factor: Array
    """(6,) by how much too small the sigmas are, channel by channel."""
    discrepancy: Discrepancy | None


def _one(found: Analysis, i: int, mended: Sequence[MendedAnswer]) -> _Judged:
    conclusion, settled = found.conclusions[i], found.settled[i]
    own = [f for f in found.faults if f.change_s is None or conclusion.phase.start_s < f.change_s < conclusion.phase.end_s]
    unnamed = bool(found.unknown) or (bool(own) and all(fault.notice.code == UNKNOWN for fault in own))
    answers = [next((c for c in answer.conclusions if c.phase.name == conclusion.phase.name), None) for answer in mended]
    rivals = [values[i] for answer in mended for values in answer.rivals]
    named = by_faults(conclusion, own, answers, rivals)
    nameless, factor = _nameless(found, i)
    nameless = [] if own else nameless
    # a disturbance that is no noise stands for something else
    judgeable = _judgeable(found, settled)
    unlike = {} if own or judgeable is None else whiteness_test(settled, judgeable)
    biased = (
        {} if own and not unnamed else _biased(found, settled, judgeable) | constancy_test(settled, found.samples.end_s, settled.values[-1])
    )
    misfit = unnamed or bool(nameless)
    told = _told(found, i) if own or misfit or (unlike and sized(found.vehicle, found.stated)) else None
    if told is not None and (unnamed or not own or rivals):
        told = told.covering([*(answer.values for answer in answers if answer is not None), *rivals])
    known, vehicle = by_known(found.histories[i], found.vehicle), found.vehicle.in_phase(conclusion.phase)
    if told is not None and not told.refuted and (unnamed or not own):
        doubts = _slow(biased, found.stated) if misfit else unlike | biased
        conclusion = with_discrepancy(in_doubt(conclusion, doubts), told, settled, vehicle)
        conclusion = in_doubt(conclusion, unseen(conclusion, i, found.doubts, settled.natural_sizes))
        return _Judged(_against(conclusion, together([known, by_no_body(conclusion)])), factor, told)
    if unnamed:
        conclusion = in_doubt(conclusion, unheld(conclusion, found.vehicle))
    elif not own:
        conclusion = in_doubt(conclusion, unlike | biased | hanging(conclusion, i, found.doubts, settled.natural_sizes))
    refuted = together([named, *nameless])
    if told is not None and refuted is not None:
        conclusion = with_touched(conclusion, told, refuted.touched, settled, vehicle)
    return _Judged(_against(conclusion, together([named, known, *nameless])), factor, told)


def _against(conclusion: Conclusion, cause: Contradiction | None) -> Conclusion:
    return conclusion if cause is None else contradicted(conclusion, cause.causes, cause.touched)


def _nameless(found: Analysis, i: int) -> tuple[list[Contradiction], Array]:
    """What contradicts and has no name; and (6,) by how much too small the sigmas of each channel are."""
    conclusion, settled = found.conclusions[i], found.settled[i]
    if not isinstance(found.vehicle, Resolved):
        return [], np.ones(6)
    factor: Array = np.ones(6)
    misfit = None
    if not settled.noise_free:
        misfit, factor = by_misfit(conclusion, settled, found.samples, found.vehicle, found.stated)
    if misfit is not None and found.unknown:  # with what was tried to find its cause
        misfit = replace(misfit, causes=(Reason.of("unexplained", message=found.unknown), *misfit.causes))
    doubted, lost = by_doubts(conclusion, i, found.doubts), by_lost(found.histories[i], settled)
    size = by_size(conclusion, found.vehicle, found.stated, found.samples)
    every = (size, misfit, doubted, lost, by_no_body(conclusion))
    return [one for one in every if one is not None], factor


def _slow(biased: Mapping[str, Reason], stated: Vehicle) -> dict[str, Reason]:
    """Without what swings within a few cycles: a misfit of any kind looks like that."""
    least_s = SWINGS * stated.cycle.period_s
    return {name: why for name, why in biased.items() if float(dict(why.data).get("period_s", np.inf)) > least_s}


def _told(found: Analysis, i: int) -> Discrepancy | None:
    if not isinstance(found.vehicle, Resolved) or found.plain is None:
        return None
    if beyond_commands(found.vehicle, found.stated, found.samples) is not None:
        return None  # no error parameter's usual size is one of this
    return discrepancy(found.samples, found.timing, found.vehicle, found.settled[i], found.plain, i)


def _judgeable(found: Analysis, settled: History) -> Resolved | None:
    """The vehicle whose residuals say something.

    Against a floor that stands in for noise no model fits; and where nothing is left, as of a log without noise, nothing in it moves a
    value by a sigma: a template explains of squares no more than all of them.
    """
    floor = any(one.code == "noise-floor" for one in found.notices)
    return None if floor or not isinstance(found.vehicle, Resolved) or settled.noise_free else found.vehicle


def _biased(found: Analysis, settled: History, vehicle: Resolved | None) -> dict[str, Reason]:
    """Why values are not to be called converged where residuals are of a kind that makes them too small or too large, unseen."""
    if vehicle is None:
        return {}
    seldom = max(found.log.cycles_apart, default=0)
    return oscillation_test(settled, found.samples, vehicle, found.stated, seldom) | lost_commands_test(settled, found.samples, vehicle)


def _discrepancies(conclusions: Sequence[Conclusion], told: Sequence[Discrepancy | None], named: bool) -> Iterator[Notice]:
    for conclusion, one in zip(conclusions, told, strict=True):
        if one is not None and not one.refuted and not any(cause.code == "named-fault" for cause in conclusion.causes) and not named:
            like = f"; it behaves like {' and '.join(one.behaves_like)}, or something else that does the same" if one.behaves_like else ""
            usual = f"whatever a careful lab may have stated wrongly, times {max(one.scale, LEAST):.2g}, and what none of that explains"
            given = [i for i, each in enumerate(conclusion.estimates.values()) if each.value is not None]
            like += f". Most informative next step: {one.tells(given)}"
            message = f"log and vehicle file don't explain one another, and every sigma includes what may be wrong: {usual}{like}"
            yield Notice("model-discrepancy", f"phase {conclusion.phase.name}: {message}")


def _notices(found: Analysis, conclusions: tuple[Conclusion, ...], docked: Docked | None, at_origin: Sequence[bool]) -> Iterator[Notice]:
    causes = [fault.notice for fault in found.faults if fault.notice not in found.notices]
    yield from causes
    for conclusion in conclusions:
        if conclusion.causes and not any(cause.code in REPORTED for cause in conclusion.causes):
            yield Notice("contradicted", f"phase {conclusion.phase.name}: {conclusion.contradiction}")
    yield from found.notices
    for conclusion in found.conclusions:
        if (broken := breach(conclusion)) is not None and broken.certain:
            yield Notice("unphysical-inertia", f"phase {conclusion.phase.name}: {broken.said}")
    for conclusion, at in zip(conclusions, at_origin, strict=True):
        if at:
            said = f"phase {conclusion.phase.name}: the CG is found at O, about which commanded torques are taken to be"
            remedy = (
                "if they are about the CG, it is somewhere else; state thrust.wrench_point_m: where they are about, or [0, 0, 0] if it is O"
            )
            yield Notice("wrench-point", f"{said}: {remedy}")
    yield from _docking_notices(docked, conclusions, found.vehicle)


def _docking_notices(docked: Docked | None, conclusions: tuple[Conclusion, ...], used: Vehicle) -> list[Notice]:
    apart = masses_apart(conclusions, used) if docked is None else None
    if apart is not None:
        message = (
            f"the two phases' masses differ by {apart[0]:.3g} ± {apart[1]:.2g} kg, too little to show a docking, so no docked object is "
            "given; name the phases under [docking] (before, after) if there is one"
        )
        return [Notice("no-docked-object", message)]
    mass = docked.estimates["mass"].value if docked else None
    if docked is None or mass is None or not backwards(mass, docked.covariance):
        return [Notice("known-mismatch", f"docked object: {message}") for message in (docked.belied if docked else ())]
    return [Notice("docked-mass", str(lighter(mass, f"phase {docked.after}", f"phase {docked.before}", "correct [docking]")))]


def _untold_scale(found: Analysis) -> tuple[list[str], tuple[str, ...]]:
    """The command components, each of which has the largest value 1, and the quantities that hang on their scale.

    A scale common to all shows in no motion, and one of all torques, or of all forces, hardly. Empty where that is not so, or known values
    or the log tell the scale; no components where another cause has a name.
    """
    log, known = found.log, set(found.vehicle.known)
    if log.command_kind != "wrench" or found.vehicle.thrust.wrench_limits is not None:
        return [], ()
    moved, named = np.abs(log.command).max(0) > 0, set(ones(log))
    for own, scaled in ((slice(0, 6), (*INERTIA, "mass")), (slice(0, 3), (*INERTIA, *CG)), (slice(3, 6), ("mass", *CG))):
        names = [name for name, moves in zip(WRENCH[own], moved[own], strict=True) if moves]
        told = any(name in known and (name != "mass" or moved[3:].any()) for name in scaled)
        if len(names) >= FEWEST and set(names) <= named and not told:
            if found.faults:  # which move other values, perhaps
                return [], scaled
            # one that all have in common shows nowhere, but is hardly that of torques and of forces
            every = len(names) == moved.sum()
            return (names if every else [], ()) if _scales_told(found) else (names, scaled)
    return [], ()


def _scales_told(found: Analysis) -> bool:
    """Whether a log that fits tells that the scale of such columns is 1, in one of its phases."""
    if found.unknown:
        return False
    case = Case(found.log, cast("Resolved", found.vehicle), found.timing, Designs())
    each = (screened(*busiest(case, settled.cycles)) for settled in found.settled)
    return any(screening is not None and screening.scales_told for screening in each)


def _normalised(ones: Sequence[str], unknown: str) -> Iterator[Notice]:
    if ones:
        said = f"the largest values of {', '.join(ones)} are all 1, as of commands that are normalised"
        fits = "" if unknown else "; the log fits with any scale of them"
        remedy = "state the scale of each under [columns]; or, if 1 N m and 1 N are what they are limited to, thrust.wrench_limits"
        yield Notice("commands-normalised", f"{said}{fits}. If they are not in N m and N, {remedy}")


def _at_origin(found: Analysis, i: int, conclusion: Conclusion) -> bool:
    """Whether a CG is found just where commanded torques are about: as if they were about it, which no log tells from one that is there.

    By the log's own sigmas: what a misfit adds to them puts the CG anywhere, and not there.
    """
    if found.log.command_kind != "wrench" or "wrench_point_m" in found.vehicle.thrust.model_fields_set:
        return False
    place, sigmas = (part[6:9] for part in (found.conclusions[i].values, found.conclusions[i].sigmas))
    size = float(found.settled[i].natural_sizes[QUANTITIES.index("cg_x")])
    told = all(conclusion.estimates[name].verdict == "converged" for name in CG)
    return told and near_origin(place, sigmas, size)


def near_origin(place: Array, sigmas: Array, size: float) -> bool:
    """Whether a CG (3,) is at O as far as its sigmas tell, in a vehicle of this natural size, m."""
    return bool((np.abs(place) < AT_ORIGIN[0] * sigmas).all() and np.linalg.norm(place) < AT_ORIGIN[1] * size)
