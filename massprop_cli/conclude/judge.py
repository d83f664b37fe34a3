"""Final verdicts of all phases, the docked object, and all notices."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis, CorrectedEstimate
from massprop_cli.conclude.constancy import constancy_test
from massprop_cli.conclude.contradict import (
    Contradiction,
    combined,
    disturbance_contradiction,
    divergence_contradiction,
    fault_contradiction,
    known_value_contradiction,
    misfit_contradiction,
    unknown_cause,
    unphysical_contradiction,
)
from massprop_cli.conclude.discrepancy import Discrepancy, discrepancy, with_affected, with_discrepancy
from massprop_cli.conclude.docking import Docked, docked_object, has_negative_mass, mass_difference, negative_mass
from massprop_cli.conclude.lostcommands import lost_commands_test
from massprop_cli.conclude.oscillation import oscillation_test
from massprop_cli.conclude.physical import breach
from massprop_cli.conclude.reason import REPORTED, Reason
from massprop_cli.conclude.score import assumption_contradiction, doubtful_values, unseen_changes
from massprop_cli.conclude.verdict import Conclusion, contradicted, in_doubt
from massprop_cli.conclude.whiteness import whiteness_test
from massprop_cli.diagnosis import UNKNOWN
from massprop_cli.diagnosis.design import Case, Designs
from massprop_cli.diagnosis.normalised import FEWEST, unit_columns
from massprop_cli.diagnosis.screening import busiest, screened
from massprop_cli.estimate.discrepancy import LEAST
from massprop_cli.estimate.disturbances import beyond_commands, sized
from massprop_cli.estimate.history import History
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved

AT_ORIGIN = (4.0, 0.005)
"""Largest distance of a CG at O: in its sigmas, and as a part of the vehicle's natural size."""
SLOW_CYCLES = 8.0
"""Shortest period of an oscillation that a misfit of timing does not cause, cycles."""


def judged(found: Analysis, corrected: Sequence[CorrectedEstimate] = ()) -> Analysis:
    """The analysis with final verdicts, the docked object and all notices.

    A log with an unexplained misfit gets the estimates with model discrepancy (:mod:`massprop_cli.conclude.discrepancy`).
    """
    phases = [_judged_phase(found, i, corrected) for i in range(len(found.conclusions))]
    discrepancies = tuple(one.discrepancy for one in phases)
    at_origin = [_at_origin(found, i, one.conclusion) for i, one in enumerate(phases)]
    normalised, by_scale = _unknown_scale(found)
    reasons = dict.fromkeys(by_scale, Reason.of("scale-untold"))
    every = [reasons | (dict.fromkeys(CG, Reason.of("wrench-point-untold")) if at else {}) for at in at_origin]
    conclusions = tuple(in_doubt(one.conclusion, doubts) for one, doubts in zip(phases, every, strict=True))
    docked = docked_object(conclusions, found.vehicle)
    named = any(fault.notice.code != UNKNOWN for fault in found.faults)
    notices = (
        *_discrepancy_notices(conclusions, discrepancies, named),
        *_notices(found, conclusions, docked, at_origin),
        *_normalised_notice(normalised, found.unknown),
    )
    return replace(
        found,
        conclusions=conclusions,
        docked=docked,
        notices=notices,
        lack_of_fit=tuple(one.factors for one in phases),
        mended=tuple(corrected),
        discrepancies=discrepancies,
    )


class _Judged(NamedTuple):
    """Final conclusion of one phase."""

    conclusion: Conclusion
    factors: Array
    """(6,) factor by which the sigmas from each channel are too small."""
    discrepancy: Discrepancy | None


def _judged_phase(found: Analysis, i: int, corrected: Sequence[CorrectedEstimate]) -> _Judged:
    """Final conclusion of phase number ``i``, from its faults, the corrected estimates, and the residual tests."""
    conclusion, settled = found.conclusions[i], found.settled[i]
    sizes = settled.natural_sizes
    faults = [f for f in found.faults if f.change_s is None or conclusion.phase.start_s < f.change_s < conclusion.phase.end_s]
    unnamed = bool(found.unknown) or (bool(faults) and all(fault.notice.code == UNKNOWN for fault in faults))
    alternatives = [next((c for c in one.conclusions if c.phase.name == conclusion.phase.name), None) for one in corrected]
    rivals = [values[i] for one in corrected for values in one.rivals]
    named = fault_contradiction(conclusion, faults, alternatives, rivals)
    nameless, factors = _unnamed_contradictions(found, i)
    nameless = [] if faults else nameless
    testable = _testable(found, settled)
    not_white = {} if faults or testable is None else whiteness_test(settled, testable)
    misfit = unnamed or bool(nameless)
    discrepant = _discrepancy(found, i) if faults or misfit or (not_white and sized(found.vehicle, found.stated)) else None
    if discrepant is not None and (unnamed or not faults or rivals):
        discrepant = discrepant.covering([*(one.values for one in alternatives if one is not None), *rivals])
    widened = discrepant if discrepant is not None and not discrepant.refuted and (unnamed or not faults) else None
    biased = {} if faults and not unnamed else _bias_tests(found, i, testable, widened)
    known, vehicle = known_value_contradiction(found.histories[i], found.vehicle), found.vehicle.in_phase(conclusion.phase)
    if widened is not None:
        conclusion = with_discrepancy(in_doubt(conclusion, _slow(biased, found.stated)), widened, settled, vehicle)
        conclusion = in_doubt(conclusion, unseen_changes(conclusion, i, found.doubts, sizes))
        return _Judged(_contradicted_by(conclusion, combined([known, unphysical_contradiction(conclusion)])), factors, widened)
    if unnamed:
        conclusion = in_doubt(conclusion, unknown_cause(conclusion, found.vehicle))
    elif not faults:
        conclusion = in_doubt(conclusion, not_white | biased | doubtful_values(conclusion, i, found.doubts, sizes))
    refuted = combined([named, *nameless])
    if discrepant is not None and refuted is not None:
        conclusion = with_affected(conclusion, discrepant, refuted.affected, settled, vehicle)
    return _Judged(_contradicted_by(conclusion, combined([named, known, *nameless])), factors, discrepant)


def _contradicted_by(conclusion: Conclusion, cause: Contradiction | None) -> Conclusion:
    return conclusion if cause is None else contradicted(conclusion, cause.causes, cause.affected)


def _unnamed_contradictions(found: Analysis, i: int) -> tuple[list[Contradiction], Array]:
    """Contradictions without a named cause; (6,) factor by which the sigmas from each channel are too small."""
    conclusion, settled = found.conclusions[i], found.settled[i]
    if not isinstance(found.vehicle, Resolved):
        return [], np.ones(6)
    factors: Array = np.ones(6)
    misfit = None
    if not settled.noise_free:
        misfit, factors = misfit_contradiction(conclusion, settled, found.samples, found.vehicle, found.stated)
    if misfit is not None and found.unknown:
        misfit = replace(misfit, causes=(Reason.of("unexplained", message=found.unknown), *misfit.causes))
    contradictions = (
        disturbance_contradiction(conclusion, found.vehicle, found.stated, found.samples),
        misfit,
        assumption_contradiction(conclusion, i, found.doubts),
        divergence_contradiction(found.histories[i], settled),
        unphysical_contradiction(conclusion),
    )
    return [one for one in contradictions if one is not None], factors


def _slow(biased: Mapping[str, Reason], stated: Vehicle) -> dict[str, Reason]:
    """Reasons without oscillations of a few cycles, which any misfit may imitate."""
    least_s = SLOW_CYCLES * stated.cycle.period_s
    return {name: reason for name, reason in biased.items() if float(dict(reason.data).get("period_s", np.inf)) > least_s}


def _discrepancy(found: Analysis, i: int) -> Discrepancy | None:
    """Model discrepancy of a phase; None without fits, and with a disturbance larger than the commands, which is too large for one."""
    if not isinstance(found.vehicle, Resolved) or found.plain is None:
        return None
    if beyond_commands(found.vehicle, found.stated, found.samples) is not None:
        return None
    return discrepancy(found.samples, found.timing, found.vehicle, found.settled[i], found.plain, i)


def _testable(found: Analysis, settled: History) -> Resolved | None:
    """Vehicle whose residuals can be tested; None with a noise floor, which no model reaches, and for a log without noise.

    Without noise, no regressor can explain residuals of one sigma.
    """
    floor = any(one.code == "noise-floor" for one in found.notices)
    return None if floor or not isinstance(found.vehicle, Resolved) or settled.noise_free else found.vehicle


def _bias_tests(found: Analysis, i: int, vehicle: Resolved | None, discrepant: Discrepancy | None) -> dict[str, Reason]:
    """Reasons, by quantity, of the tests for oscillation, lost commands and changes; only for changes without a ``vehicle``.

    A bias that the final sigmas include, those of ``discrepant`` if there is one, is no reason.
    """
    settled, conclusion = found.settled[i], found.conclusions[i]
    sigmas = conclusion.sigmas if discrepant is None else np.sqrt(np.diag(discrepant.covariance))
    changes = constancy_test(settled, found.samples.end_s, settled.values[-1], sigmas)
    if vehicle is None:
        return changes
    sample_cycles = max(found.log.cycles_apart, default=0)
    widened = sigmas / np.sqrt(np.diag(conclusion.bare[1])) if discrepant is not None else np.ones(10)
    oscillations = oscillation_test(settled, found.samples, vehicle, found.stated, widened, sample_cycles)
    return oscillations | lost_commands_test(settled, found.samples, vehicle) | changes


def _discrepancy_notices(conclusions: Sequence[Conclusion], discrepancies: Sequence[Discrepancy | None], named: bool) -> Iterator[Notice]:
    for conclusion, one in zip(conclusions, discrepancies, strict=True):
        if one is not None and not one.refuted and not any(cause.code == "named-fault" for cause in conclusion.causes) and not named:
            like = f"; it behaves like {' and '.join(one.behaves_like)}, but other errors may do the same" if one.behaves_like else ""
            usual = f"every error parameter at {max(one.scale, LEAST):.2g} of its usual sigma, and residuals that no parameter explains"
            reported = [i for i, estimate in enumerate(conclusion.estimates.values()) if estimate.value is not None]
            like += f". Most informative next step: {one.next_step(reported)}"
            message = f"the vehicle file does not explain the log; sigmas include model error ({usual}){like}"
            yield Notice("model-discrepancy", f"phase {conclusion.phase.name}: {message}")


def _notices(found: Analysis, conclusions: tuple[Conclusion, ...], docked: Docked | None, at_origin: Sequence[bool]) -> Iterator[Notice]:
    """Yield the notices of named causes, contradictions, the run, physical bounds, the wrench point and docking, in this order."""
    causes = [fault.notice for fault in found.faults if fault.notice not in found.notices]
    yield from causes
    for conclusion in conclusions:
        if conclusion.causes and not any(cause.code in REPORTED for cause in conclusion.causes):
            yield Notice("contradicted", f"phase {conclusion.phase.name}: {conclusion.contradiction}")
    yield from found.notices
    for conclusion in found.conclusions:
        if (violation := breach(conclusion)) is not None and violation.certain:
            yield Notice("unphysical-inertia", f"phase {conclusion.phase.name}: {violation.message}")
    for conclusion, at in zip(conclusions, at_origin, strict=True):
        if at:
            message = f"phase {conclusion.phase.name}: the estimated CG is at O, and commanded torques are assumed to be about O"
            remedy = (
                "if they are about the CG instead, the CG is elsewhere. State their point as thrust.wrench_point_m ([0, 0, 0] if it is O)"
            )
            yield Notice("wrench-point", f"{message}; {remedy}")
    yield from _docking_notices(docked, conclusions, found.vehicle)


def _docking_notices(docked: Docked | None, conclusions: tuple[Conclusion, ...], used: Vehicle) -> list[Notice]:
    small = mass_difference(conclusions, used) if docked is None else None
    if small is not None:
        message = (
            f"the two phases' masses differ by {small[0]:.3g} ± {small[1]:.2g} kg, too little to show a docking, so massprop reports no "
            "docked object; name the phases under [docking] (before, after) if there is one"
        )
        return [Notice("no-docked-object", message)]
    mass = docked.estimates["mass"].value if docked else None
    if docked is None or mass is None or not has_negative_mass(mass, docked.covariance):
        return [Notice("known-mismatch", f"docked object: {message}") for message in (docked.known_mismatches if docked else ())]
    return [Notice("docked-mass", str(negative_mass(mass, f"phase {docked.after}", f"phase {docked.before}", "correct [docking]")))]


def _unknown_scale(found: Analysis) -> tuple[list[str], tuple[str, ...]]:
    """Command components that may be normalised, because the largest value of each is 1, and the quantities that depend on their scale.

    A scale common to all commands does not change the residuals; one of all torques, or of all forces, hardly. Empty if known values or the
    log give the scale. No components if another cause is named.
    """
    log, known = found.log, set(found.vehicle.known)
    if log.command_kind != "wrench" or found.vehicle.thrust.wrench_limits is not None:
        return [], ()
    used, suspects = np.abs(log.command).max(0) > 0, set(unit_columns(log))
    for part, scaled in ((slice(0, 6), (*INERTIA, "mass")), (slice(0, 3), (*INERTIA, *CG)), (slice(3, 6), ("mass", *CG))):
        names = [name for name, is_used in zip(WRENCH[part], used[part], strict=True) if is_used]
        calibrated = any(name in known and (name != "mass" or used[3:].any()) for name in scaled)
        if len(names) >= FEWEST and set(names) <= suspects and not calibrated:
            if found.faults:  # the fault may be the cause
                return [], scaled
            # the log cannot show a scale common to all, but torques and forces rarely have the same one
            every = len(names) == used.sum()
            return (names if every else [], ()) if _scale_is_one(found) else (names, scaled)
    return [], ()


def _scale_is_one(found: Analysis) -> bool:
    """Whether the log fits and shows, in at least one phase, that the scale of such columns is 1."""
    if found.unknown:
        return False
    case = Case(found.log, cast("Resolved", found.vehicle), found.timing, Designs())
    screenings = (screened(*busiest(case, settled.cycles)) for settled in found.settled)
    return any(screening is not None and screening.unit_scales_confirmed for screening in screenings)


def _normalised_notice(names: Sequence[str], unknown: str) -> Iterator[Notice]:
    if names:
        finding = f"the largest values of {', '.join(names)} are all 1, so commands may be normalised"
        fits = "" if unknown else "; the log does not show their scale"
        remedy = "state the scale of each under [columns]; or, if they are limited to 1 N m and 1 N, thrust.wrench_limits"
        yield Notice("commands-normalised", f"{finding}{fits}. If they are not in N m and N, {remedy}")


def _at_origin(found: Analysis, i: int, conclusion: Conclusion) -> bool:
    """Whether a converged CG is at O, which it also seems to be if commanded torques are about the CG instead of O.

    Tests the sigmas without model discrepancy, which would include O too easily.
    """
    if found.log.command_kind != "wrench" or "wrench_point_m" in found.vehicle.thrust.model_fields_set:
        return False
    cg, sigmas = (part[6:9] for part in (found.conclusions[i].values, found.conclusions[i].sigmas))
    size = float(found.settled[i].natural_sizes[QUANTITIES.index("cg_x")])
    converged = all(conclusion.estimates[name].verdict == "converged" for name in CG)
    return converged and near_origin(cg, sigmas, size)


def near_origin(cg: Array, sigmas: Array, size: float) -> bool:
    """Whether a CG (3,) with these sigmas (3,), m, is at O; ``size``: natural size of the vehicle, m."""
    return bool((np.abs(cg) < AT_ORIGIN[0] * sigmas).all() and np.linalg.norm(cg) < AT_ORIGIN[1] * size)
