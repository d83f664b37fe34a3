"""What is said of the causes with which a log fits: the most likely one, its rivals, and the settings that correct it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis import UNKNOWN, hypotheses, normalised
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import Correction, applied, around, certain, correction_of, skewed
from massprop_cli.diagnosis.delay import near
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.refit import Refit, over_all
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.search import codes
from massprop_cli.errorparameters import table
from massprop_cli.inputs.notice import Notice

ABSENT = "log and vehicle file don't fit; causes are looked for only in logs with all three axes of gyro and accelerometer"
DEAD = "the gyro or the accelerometer reads 0 in every cycle: it is not recorded, or dead"
UNANSWERED = (
    "log and vehicle file don't fit, cause unknown: the motion is no noise, and hardly follows the commands; are they this recording's, on "
    "its clock, and were they executed?"
)
LOGGED_AFTER = (
    "the motion follows commands that are logged {:g} control cycle(s) after they acted: no delay is below 0; log them as they are "
    "issued, or move their columns up by {} control cycle(s)"
)
IN_VEHICLE_FILE, IN_MAP = "under [columns]", "in the map (unit, scale, axes)"
"""Where the columns of a plain log are corrected, and those of a recording."""
NEARLY = 4.6
"""−2 log of the odds (1 : 10) below which of two kinds neither is named."""
EVEN = 6.0
"""−2 log of the odds (1 : 20) below which two of a kind are named side by side."""

ALIKE = 1e-9
"""Between factors that are one."""
UNIT = float(np.log(2.0))
"""Log of a factor from which on it is a unit's, of torques or of forces: a smaller one is a scale, and may be stated as uncertain."""


def chosen(screening: Screening, refits: Sequence[Refit]) -> Diagnosis | None:
    """The most likely of those with which the log fits."""
    fitting = fitting_causes(screening, refits)
    if not fitting:
        return None
    rivals = [refit for refit in fitting[1:] if refit.score < fitting[0].score + CLEAR]
    first = over_all(screening, fitting[0])
    alike = [refit for refit in (_in_proportion(screening, first), _about_another_point(screening, first)) if refit is not None]
    rivals = [*alike, *(rival for rival in rivals if all(_about(rival) != _about(own) for own in alike))]
    detected = None
    if first.fitted.hypothesis.code == "delay-mismatch":
        after = float(first.fitted.chi_square.sum() / screening.freedom)
        by = first.case.timing.delay - screening.case.timing.delay
        detected = near(screening.case.timing, by, float(first.fitted.spread[0]), after)
    return Diagnosis(_explained(screening, first, rivals, len(alike)), detected, score=first.score)


def fitting_causes(screening: Screening, refits: Sequence[Refit]) -> list[Refit]:
    """Those with which the log fits, but for rivals of what doesn't; these come last where they are too faint to be named themselves."""
    fitting = [
        (screening.ranked.faint(refit.fitted.hypothesis), refit) for refit in refits if refit.fits and not by_wander(refit, screening)
    ]
    if all(faint for faint, _ in fitting):
        return []
    return [refit for _, refit in sorted(fitting, key=lambda one: (one[0], one[1].score))]


def by_wander(refit: Refit, screening: Screening) -> bool:
    """Whether it goes with a torque that wanders: its mean, its part along the rate, or what the accelerometer feels of it."""
    beside = (refit.screening or screening).free.beside
    return bool(codes(refit) & {"gyro-bias", "accel-bias", "steady-torque", "rate-torque"}) and any(one.walk > 0 for one in beside)


def _explained(screening: Screening, refit: Refit, rivals: Sequence[Refit] = (), alike: int = 0) -> tuple[Fault, ...]:
    """In words, with the settings that correct it: one for each of two causes at once.

    What a rival that is nearly as likely has not got is not named; the first ``alike`` of them make the same motion.
    """
    said = _said(screening, refit)
    message, beside, sure = _joined(said), [], [code for code, _ in said]
    for i, rival in enumerate(rivals):
        its = _said(screening, rival)
        if _about(rival) == _about(refit):
            continue  # the same, found from elsewhere
        if i < alike or ([code for code, _ in its] == [code for code, _ in said] and rival.score < refit.score + EVEN):
            message += f", or else {_joined(its)}"
        else:
            beside.append(f"{_joined(its)} (odds {np.exp((refit.score - rival.score) / 2):.2g} to 1)")
            sure = [code for code in sure if code in dict(its) or rival.score > refit.score + NEARLY]
    turned, heavier = _of_what_turns(refit)
    message = f"the log fits if {message}{turned}"
    if beside:
        message += "; rivals that the log can't rule out: " + "; or ".join(beside[:2])
    if not sure:
        message = f"log and vehicle file don't fit, cause unknown: {message}"
    others = (correction_of(screening.case, rival.case, rival.fitted) for rival in rivals)
    # a scale that all commands have in common shows nowhere: no correction is right
    scaled = normalised.CODE in codes(refit)
    correction = None if scaled else correction_of(screening.case, refit.case, refit.fitted)
    near = (*around(screening.case, refit.fitted), *skewed(correction, refit.fitted))
    instead = (*(other for other in others if other is not None), *_of_the_others(correction), *heavier)
    return tuple(Fault(Notice(code, message), correction, around=near, rivals=instead) for code in dict.fromkeys(sure or [UNKNOWN]))


def _of_the_others(correction: Correction | None) -> Iterator[Correction]:
    """Where all torques, or all forces, of a commanded wrench are in another unit: as well the others are, and the body another."""
    if correction is None or not correction.command:
        return
    for own, others in ((slice(0, 3), slice(3, 6)), (slice(3, 6), slice(0, 3))):
        moved = [factor for factor in correction.command[own] if factor != 1]
        factor, alike = (moved or [1.0])[0], len(set(moved)) == 1 and set(correction.command[others]) == {1.0}
        if alike and factor and abs(np.log(abs(factor))) > UNIT:  # what does nothing is in no unit
            parts = [1.0] * 6
            parts[others] = [1.0 / factor] * 3
            yield replace(correction, command=tuple(parts))


def _in_proportion(screening: Screening, refit: Refit) -> Refit | None:
    """Where all that pushes gives one part of what is stated beside what stores momentum, or the other way round: the other one instead.

    Forces, momentum, inertia and mass in one proportion make the same motion, so the log tells nothing of which it is.
    """
    found, model, names = refit.fitted, refit.fitted.model, screening.names
    sides = [range(model.thrusting), range(model.thrusting, len(names))]
    for one, other in (sides, sides[::-1]):
        whole = tuple(names[i] for i in one)
        part = next((part for part in found.parts if part.hypothesis.code == "thrust-scale" and part.hypothesis.subject == whole), None)
        if part is None or not whole or not other or not (factor := float(np.median(part.factors))) > 0:
            continue
        x = found.x.copy()
        x[model.place("thrust")] /= factor  # and the body, of which nothing is said
        return _instead(screening, refit, part, hypotheses.scaled(model, names, other, 1 / factor), x)
    return None


def _instead(screening: Screening, refit: Refit, part: Fitted, other: Hypothesis, x: Array) -> Refit | None:
    """The same motion by another cause in the place of one part."""
    rest = [own.hypothesis for own in refit.fitted.parts if own is not part]
    found = replace(refit.fitted, hypothesis=other.beside(*rest) if rest else other, x=x)
    case = applied(screening.case, found)
    return None if case is None else replace(refit, fitted=found, case=case)


def _about_another_point(screening: Screening, refit: Refit) -> Refit | None:
    """Where the IMU is elsewhere: as well commanded torques are about another point, and IMU and CG as far from where they are held to be.

    Or the other way round, unless that point is the CG, or the IMU's place is in another unit, which is no coincidence.
    """
    found, model = refit.fitted, refit.fitted.model
    if model.kind != "wrench" or not model.thrusting or model.bearing is not None:
        return None  # under gravity the CG shows where it is
    place, point = hypotheses.imu_position(model), hypotheses.wrench_point(model, len(screening.names))
    for one, other, error in ((place, point, found.error("imu")), (point, place, found.error("position")[:3])):
        part = next((part for part in found.parts if part.hypothesis.code == one.code), None)
        if part is None or part.hypothesis.start or (one is point and certain(part)):
            continue
        x = np.where(one.moved, model.stated, found.x) - other.free @ error / np.abs(other.free).max()
        return _instead(screening, refit, part, other, x)
    return None


def _of_what_turns(refit: Refit) -> tuple[str, tuple[Correction, ...]]:
    """Where all rotors that store momentum give one part of their thrust: as well they store that much more, and the body is another."""
    rotors, part = refit.case.vehicle.rotors, refit.fitted.parts[-1]
    group, factors = part.hypothesis.subject, refit.fitted.factors
    all_of_them = part.hypothesis.code == "thrust-scale" and len(rotors) > 1 and group == tuple(rotor.name for rotor in rotors)
    inertia = [rotor.spin_inertia_kg_m2 for rotor in rotors if rotor.spin_inertia_kg_m2 is not None]
    if not all_of_them or not float(np.ptp(factors)) < ALIKE or len(inertia) < len(rotors) or not factors[0] > 0:
        return "", ()
    keys = tuple(f"rotors.{i}.spin_inertia_kg_m2={own / factors[0]:.9g}" for i, own in enumerate(inertia))
    return f", or else they have {1 / factors[0]:.4g} of the stated spin_inertia_kg_m2", (Correction(keys),)


def _said(screening: Screening, refit: Refit) -> list[tuple[str, str]]:
    """(code, words) of each cause; a delay that is to be found is none beside another, which the search for it did not know of.

    Nor is another scale beside normalised commands, of which each has one.
    """
    said = list(dict.fromkeys(words_of(part, screening.names, screening.case, refit.case) for part in refit.fitted.parts))
    if normalised.CODE in dict(said):
        said = [one for one in said if one[0] not in ("thrust-scale", normalised.CODE)] + [
            one for one in said if one[0] == normalised.CODE
        ][:1]
    sought = screening.case.vehicle.cycle.command_delay_cycles == "auto"
    return [one for one in said if one[0] != "delay-mismatch" or not sought] or said


def _joined(said: Sequence[tuple[str, str]]) -> str:
    return ", and ".join(words for _, words in said) + " as well" * (len(said) > 1)


def _about(refit: Refit) -> list[tuple[str, tuple[str, ...]]]:
    return sorted((part.hypothesis.code, part.hypothesis.subject) for part in refit.fitted.parts)


def words_of(found: Fitted, names: Sequence[str], stated: Case, corrected: Case) -> tuple[str, str]:
    """(code, words) that go on "the log fits if …"."""
    code, words = table.words_of(found.hypothesis.code, found.finding(names, stated.setup, corrected.setup))
    return code, words if stated.log.made is None else words.replace(IN_VEHICLE_FILE, IN_MAP)


def alone(found: Fitted, name: str) -> Fitted:
    """Of a hypothesis about several channels, what it says of one."""
    return replace(found, hypothesis=replace(found.hypothesis, subject=(name,)))
