"""Notices and corrections for the causes with which a log fits: the most likely one, and its rivals."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.base.levels import CLEAR, EVEN
from massprop_cli.diagnosis import NO_CAUSE, UNKNOWN, hypotheses, normalised
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import Correction, applied, correction_of, is_certain, skew_corrections, uncertain_corrections
from massprop_cli.diagnosis.delay import timing_near
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.refit import Refit, refined_on_whole_log
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.search import codes
from massprop_cli.errorparameters import table
from massprop_cli.inputs.notice import Notice

ABSENT = "the vehicle file does not explain the log; massprop diagnoses only logs with all three axes of gyro and accelerometer"
DEAD = "the gyro or the accelerometer reads 0 in every cycle: check the sensor and its columns"
UNANSWERED = (
    f"{NO_CAUSE}: the motion exceeds the noise and hardly follows the commands; check that the commands are of this recording, on its "
    "clock, and were executed"
)
LOGGED_AFTER = (
    "the log has commands {:g} control cycle(s) after they acted, and a delay cannot be below 0; log them when they are issued, or move "
    "their columns up by {} control cycle(s)"
)
IN_VEHICLE_FILE, IN_MAP = "under [columns]", "in the map (unit, scale, axes)"
"""Where to correct the columns of a plain log, and those of a recording."""

NEARLY = 4.6
"""−2 log of the odds, 1 : 10, up to which neither of two codes is named."""
UNIT = float(np.log(2.0))
"""Log of the least factor that may be a unit of torques or forces; a smaller one is a scale, which can be stated as uncertain."""


def chosen(screening: Screening, refits: Sequence[Refit]) -> Diagnosis | None:
    """Diagnosis by the most likely cause with which the log fits; None without one."""
    fitting = fitting_causes(screening, refits)
    if not fitting:
        return None
    rivals = [refit for refit in fitting[1:] if refit.score < fitting[0].score + CLEAR]
    first = refined_on_whole_log(screening, fitting[0])
    equivalent = [refit for refit in (_proportional(screening, first), _about_another_point(screening, first)) if refit is not None]
    rivals = [*equivalent, *(rival for rival in rivals if all(_subjects(rival) != _subjects(equal) for equal in equivalent))]
    detected = None
    if first.fitted.hypothesis.code == "delay-mismatch":
        misfit = float(first.fitted.chi_square.sum() / screening.degrees_of_freedom)
        change = first.case.timing.delay - screening.case.timing.delay
        detected = timing_near(screening.case.timing, change, float(first.fitted.spread[0]), misfit)
    return Diagnosis(_faults(screening, first, rivals, len(equivalent)), detected, score=first.score)


def fitting_causes(screening: Screening, refits: Sequence[Refit]) -> list[Refit]:
    """Refits with which the log fits, the best first; those that were only rivals come last, and do not count alone."""
    fitting = [
        (screening.ranked.only_rival(refit.fitted.hypothesis), refit)
        for refit in refits
        if refit.fits and not goes_with_random_walk(refit, screening)
    ]
    if all(faint for faint, _ in fitting):
        return []
    return [refit for _, refit in sorted(fitting, key=lambda one: (one[0], one[1].score))]


def goes_with_random_walk(refit: Refit, screening: Screening) -> bool:
    """Whether a cause goes with a random-walk torque: its mean, its part along the rate, or its specific force."""
    disturbances = (refit.screening or screening).free.disturbances
    return bool(codes(refit) & {"gyro-bias", "accel-bias", "steady-torque", "rate-torque"}) and any(one.walk > 0 for one in disturbances)


def _faults(screening: Screening, refit: Refit, rivals: Sequence[Refit] = (), alike: int = 0) -> tuple[Fault, ...]:
    """Faults of a refit, one for each of its causes, with corrections.

    A code that a rival of similar score does not share is not named. The first ``alike`` rivals make the same motion.
    """
    causes = _causes(screening, refit)
    message, rival_texts, named = _joined(causes), [], [code for code, _ in causes]
    for i, rival in enumerate(rivals):
        rival_causes = _causes(screening, rival)
        if _subjects(rival) == _subjects(refit):
            continue  # the same, found from elsewhere
        if i < alike or ([code for code, _ in rival_causes] == [code for code, _ in causes] and rival.score < refit.score + EVEN):
            message += f", or else {_joined(rival_causes)}"
        else:
            rival_texts.append(f"{_joined(rival_causes)} (odds {np.exp((refit.score - rival.score) / 2):.2g} to 1)")
            named = [code for code in named if code in dict(rival_causes) or rival.score > refit.score + NEARLY]
    inertia_text, inertia_corrections = _rotor_inertia(refit)
    message = f"the log fits if {message}{inertia_text}"
    if rival_texts:
        message += "; rivals that the log cannot rule out: " + "; or ".join(rival_texts[:2])
    if not named:
        message = f"{NO_CAUSE}: {message}"
    corrections = (correction_of(screening.case, rival.case, rival.fitted) for rival in rivals)
    # a scale that all commands have in common shows nowhere: no correction is right
    normalised_commands = normalised.CODE in codes(refit)
    correction = None if normalised_commands else correction_of(screening.case, refit.case, refit.fitted)
    sigma_variants = (*uncertain_corrections(screening.case, refit.fitted), *skew_corrections(correction, refit.fitted))
    rival_corrections = (*(other for other in corrections if other is not None), *_other_half(correction), *inertia_corrections)
    return tuple(
        Fault(Notice(code, message), correction, around=sigma_variants, rivals=rival_corrections)
        for code in dict.fromkeys(named or [UNKNOWN])
    )


def _other_half(correction: Correction | None) -> Iterator[Correction]:
    """Corrections by the other half of a commanded wrench, where all torques or all forces are in another unit; the body then differs."""
    if correction is None or not correction.command:
        return
    for half, other_half in ((slice(0, 3), slice(3, 6)), (slice(3, 6), slice(0, 3))):
        factors = [factor for factor in correction.command[half] if factor != 1]
        factor, only_half = (factors or [1.0])[0], len(set(factors)) == 1 and set(correction.command[other_half]) == {1.0}
        if only_half and factor and abs(np.log(abs(factor))) > UNIT:  # a zero factor is no unit
            components = [1.0] * 6
            components[other_half] = [1.0 / factor] * 3
            yield replace(correction, command=tuple(components))


def _proportional(screening: Screening, refit: Refit) -> Refit | None:
    """The inverse factor on stored momentum instead of a factor on all thrust, or the reverse.

    Forces, momentum, inertia and mass in one proportion make the same motion.
    """
    fit, model, names = refit.fitted, refit.fitted.model, screening.names
    sides = [range(model.thrusting), range(model.thrusting, len(names))]
    for scaled, unscaled in (sides, sides[::-1]):
        subject = tuple(names[i] for i in scaled)
        scale = next(
            (scale for scale in fit.parts if scale.hypothesis.code == "thrust-scale" and scale.hypothesis.subject == subject), None
        )
        if scale is None or not subject or not unscaled or not (factor := float(np.median(scale.factors))) > 0:
            continue
        x = fit.x.copy()
        x[model.place("thrust")] /= factor  # the body scales too, but is not reported
        return _replaced(screening, refit, scale, hypotheses.scaled(model, names, unscaled, 1 / factor), x)
    return None


def _replaced(screening: Screening, refit: Refit, part: Fitted, other: Hypothesis, x: Array) -> Refit | None:
    """A refit with one part replaced by another cause of the same motion."""
    others = [part_of_pair.hypothesis for part_of_pair in refit.fitted.parts if part_of_pair is not part]
    fit = replace(refit.fitted, hypothesis=other.combined_with(*others) if others else other, x=x)
    case = applied(screening.case, fit)
    return None if case is None else replace(refit, fitted=fit, case=case)


def _about_another_point(screening: Screening, refit: Refit) -> Refit | None:
    """The reference point of commanded torques instead of the IMU's place, or the reverse, since both make the same motion.

    Not if that point is the CG, or if the IMU's place is in another unit, which would be no coincidence.
    """
    fit, model = refit.fitted, refit.fitted.model
    if model.kind != "wrench" or not model.thrusting or model.bearing is not None:
        return None  # gravity determines the CG
    place, point = hypotheses.imu_position(model), hypotheses.wrench_point(model, len(screening.names))
    for one, other, error in ((place, point, fit.error("imu")), (point, place, fit.error("position")[:3])):
        stated_part = next((stated_part for stated_part in fit.parts if stated_part.hypothesis.code == one.code), None)
        if stated_part is None or stated_part.hypothesis.initial_values or (one is point and is_certain(stated_part)):
            continue
        x = np.where(one.varied, model.stated, fit.x) - other.directions @ error / np.abs(other.directions).max()
        return _replaced(screening, refit, stated_part, other, x)
    return None


def _rotor_inertia(refit: Refit) -> tuple[str, tuple[Correction, ...]]:
    """More rotor inertia instead of one common thrust factor of all rotors that store momentum."""
    rotors, cause = refit.case.vehicle.rotors, refit.fitted.parts[-1]
    subject, factors = cause.hypothesis.subject, refit.fitted.factors
    all_of_them = cause.hypothesis.code == "thrust-scale" and len(rotors) > 1 and subject == tuple(rotor.name for rotor in rotors)
    inertia = [rotor.spin_inertia_kg_m2 for rotor in rotors if rotor.spin_inertia_kg_m2 is not None]
    if not all_of_them or not float(np.ptp(factors)) < ROUNDING or len(inertia) < len(rotors) or not factors[0] > 0:
        return "", ()
    keys = tuple(f"rotors.{i}.spin_inertia_kg_m2={own / factors[0]:.9g}" for i, own in enumerate(inertia))
    return f", or else they have {1 / factors[0]:.4g} times the stated spin_inertia_kg_m2", (Correction(keys),)


def _causes(screening: Screening, refit: Refit) -> list[tuple[str, str]]:
    """(code, words) of each cause.

    A delay next to another cause is omitted if the vehicle file says "auto", since its estimate did not know the other cause. A thrust
    scale next to normalised commands is omitted, since each normalised column has a scale.
    """
    causes = list(dict.fromkeys(words_of(part, screening.names, screening.case, refit.case) for part in refit.fitted.parts))
    if normalised.CODE in dict(causes):
        causes = [one for one in causes if one[0] not in ("thrust-scale", normalised.CODE)] + [
            one for one in causes if one[0] == normalised.CODE
        ][:1]
    estimated = screening.case.vehicle.cycle.command_delay_cycles == "auto"
    return [one for one in causes if one[0] != "delay-mismatch" or not estimated] or causes


def _joined(said: Sequence[tuple[str, str]]) -> str:
    return ", and ".join(words for _, words in said) + " as well" * (len(said) > 1)


def _subjects(refit: Refit) -> list[tuple[str, tuple[str, ...]]]:
    return sorted((part.hypothesis.code, part.hypothesis.subject) for part in refit.fitted.parts)


def words_of(fit: Fitted, names: Sequence[str], stated: Case, corrected: Case) -> tuple[str, str]:
    """(code, words) that continue "the log fits if …"."""
    code, words = table.words_of(fit.hypothesis.code, fit.finding(names, stated.setup, corrected.setup))
    return code, words if stated.log.made is None else words.replace(IN_VEHICLE_FILE, IN_MAP)


def about_one_channel(fit: Fitted, name: str) -> Fitted:
    """A fit about several channels, reduced to one of them."""
    return replace(fit, hypothesis=replace(fit.hypothesis, subject=(name,)))
