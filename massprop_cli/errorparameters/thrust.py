"""What jets and commanded wrenches may do otherwise than stated."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters import channels
from massprop_cli.errorparameters.actuatornames import KEYS, NEAR, entries, nouns, table_of, who
from massprop_cli.errorparameters.parameter import ErrorParameter, FittedHypothesis, SpecialCase, Step, Wording, vector
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.actuators.actuator import unit
from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.inputs.equipment import MOST_DROOP
from massprop_cli.prepare.actuators import together

RPM = float(np.pi / 30)
"""rad/s of one revolution a minute."""
CHANCE, LIKELY = 2.0, 0.25
"""Sigmas, and part of its distance from O, within which the point that torques are about is the CG."""
REVERSED = -0.5
"""Part of the stated thrust below which a jet pushes the other way: beside another error that is near to as much as stated."""
WRENCH_POINT = "thrust.wrench_point_m"
_REFIT = "massprop repeats a correction with it one sigma further instead"


def _about(setup: Setup, error: Array) -> Setup:
    return setup.having(WRENCH_POINT, setup.value(WRENCH_POINT) + error)


def _moved(setup: Setup, error: Array) -> Setup | None:
    if setup.log.command_kind == "wrench":  # torques about another point: all its forces are moved alike
        return _about(setup, error.reshape(-1, 3).mean(0))
    return channels.moved(setup, error.reshape(-1, 3))


def _angle(finding: FittedHypothesis) -> Mapping[str, object]:
    stated, true = (force[finding.channel] for force in finding.force)
    cosine = stated @ true / np.linalg.norm(stated) / np.linalg.norm(true)
    return {
        "who": who(finding)["who"],
        "key": "force_n" if table_of(finding) == "jets" else "axis",
        "angle": np.degrees(np.arccos(np.clip(cosine, -1, 1))),
        "force": vector(true),
    }


def _axes(finding: FittedHypothesis) -> Mapping[str, object]:
    """Of wheels or control moment gyros, whose axes turn together."""
    (one, _), keys = nouns(finding), ("gimbal_axis", "spin_axis") if table_of(finding) == "control_moment_gyros" else ("axis",)
    tables = (getattr(setup.vehicle, table_of(finding)) for setup in (finding.stated, finding.corrected))
    pairs = [(before, after) for before, after in zip(*tables, strict=True) if before.name in entries(finding)]
    angles = {before.name: np.degrees(_turn(before.axes, after.axes)) for before, after in pairs}
    named, verb = ("axes", "are") if len(keys) > 1 else ("axis", "is")
    whole = ", ".join(f"{key} {vector(unit(getattr(pairs[0][1], key)))}".removeprefix("axis ") for key in keys)
    return {
        "axes": ", ".join(
            f"the {named} of {one}{name} {verb} {angle:.3g} degrees away from the stated {named}" for name, angle in angles.items()
        ),
        "each": "each of them" if len(pairs) > 1 else f"it: {whole}",
    }


def _turn(stated: Array, turned: Array) -> float:
    """By how many rad axes (a, 3) turned; of two, which are at right angles, with what is at right angles to both."""
    before, after = (np.vstack([one, np.cross(one[:1], one[1:])]) for one in (stated, turned))
    cosine = (np.trace(before @ after.T) - 1) / 2 if len(before) == 3 else float(before[0] @ after[0])
    return float(np.arccos(np.clip(cosine, -1, 1)))


def _place(finding: FittedHypothesis) -> Mapping[str, object]:
    return {"who": who(finding)["who"], "by": vector(finding.errors["position"].reshape(-1, 3)[finding.channel], 1e3)}


def _swapped(finding: FittedHypothesis) -> Mapping[str, object]:
    names, (_, many) = entries(finding), nouns(finding)
    does = {name: replace(finding, subject=(other,)) for name, other in finding.does.items()}
    as_another = "; ".join(
        f"{entries(replace(finding, subject=(name,)))[0]} acts as stated for {entries(does[name])[0]}" for name in finding.subject
    )
    how = "swapped: each acts as stated for the other" if len(names) == 2 else f"wired in another order: {as_another}"
    return {"jets": f"{many}{', '.join(names[:-1])} and {names[-1]}", "how": how}


def _limits(finding: FittedHypothesis) -> Mapping[str, object]:
    limits, largest = finding.corrected.vehicle.thrust.wrench_limits or (), np.abs(finding.stated.log.command).max(0)
    said = [
        f"{limit:.4g} {unit} {word} {axis}"
        for limit, most, (word, unit), axis in zip(limits, largest, 3 * [("about", "N m")] + 3 * [("along", "N")], 2 * "XYZ", strict=True)
        if limit < most
    ]
    return {"limits": ", ".join(said)}


def _pulse_at(finding: FittedHypothesis) -> Mapping[str, object]:
    cycle, place = finding.corrected.vehicle.cycle, {"begin": "begin with", "centre": "lie in the middle of", "end": "end with"}
    delay = f" and act {finding.corrected.timing.delay:.4g} cycles after their commands" if finding.errors["delay"].any() else ""
    return {"place": place[cycle.pulse_at], "delay": delay, "key": f'cycle.pulse_at = "{cycle.pulse_at}"'}


def _short(finding: FittedHypothesis) -> Mapping[str, object]:
    thrust, stated = finding.corrected.vehicle.thrust, finding.stated.vehicle.thrust
    key = "least_on_s" if thrust.least_on_s != stated.least_on_s else "dead_on_s"
    does = "last that long, as if the driver gave no shorter pulses", "give no thrust, as if valves did not open so fast"
    return {"short": getattr(thrust, key), "does": does[key == "dead_on_s"], "key": key}


def _one_later(finding: FittedHypothesis) -> Mapping[str, object]:
    (one,) = (jet for jet, other in zip(finding.corrected.vehicle.jets, finding.stated.vehicle.jets, strict=True) if jet != other)
    return {"jet": one.name, "later": one.delay_s}


def _speeds_later(finding: FittedHypothesis) -> Mapping[str, object]:
    pairs = zip(finding.corrected.vehicle.wheels, finding.stated.vehicle.wheels, strict=True)
    return {"later": next(wheel.speed_latency_s - other.speed_latency_s for wheel, other in pairs if wheel != other)}


def _rubbing(finding: FittedHypothesis) -> Mapping[str, object]:
    def said(wheel: Wheel) -> str:
        parts = (wheel.coulomb_friction_n_m, "N m"), (wheel.viscous_friction_n_m_s, "N m s")
        return f"{' and '.join(f'{part:.3g} {unit}' for part, unit in parts if part) or 'none'} of wheel {wheel.name}"

    return {"friction": ", ".join(said(wheel) for wheel in finding.corrected.vehicle.wheels if wheel.column == "torque")}


def _ramps(finding: FittedHypothesis) -> Mapping[str, object]:
    rise, fall = (2e3 * finding.mean(name) * finding.stated.period_s for name in ("rise", "fall"))
    by = rise or fall
    first, second = (f"{abs(part):.3g} ms {'longer' if part > 0 else 'less'}" for part in (by, fall))
    longer = f"thrust takes {first}"
    if rise and fall and first == second:
        return {"ramps": f"{longer} to rise and to fall than rise_s and fall_s state", "them": "them"}
    if rise and fall:
        return {"ramps": f"{longer} to rise than rise_s states, and {second} to fall than fall_s states", "them": "them"}
    ramp, valve, gives = ("rise", "opens", by < 0) if rise else ("fall", "closes", by > 0)
    effect = f"a valve that {valve} {abs(by) / 2:.3g} ms {'later' if by > 0 else 'earlier'}: each pulse gives"
    return {"ramps": f"{longer} to {ramp} than {ramp}_s states, like {effect} {'more' if gives else 'less'} impulse", "them": "it"}


def about_cg(point: Array, sigma: Array, cg: Array, force: Array) -> bool:
    """Whether a point (3,) ± (3,) that is found for torques is the CG, as far as forces (C, 3) tell: along one line nothing does."""
    across = (force**2).sum() * np.eye(3) - force.T @ force
    away, size = (float(one @ across @ one) ** 0.5 for one in (point - cg, point))
    scatter = float(np.diag(across) @ sigma**2) ** 0.5
    return bool(away < max(NEAR * size, min(CHANCE * scatter, LIKELY * size)))


def _point_of(finding: FittedHypothesis) -> Array:
    return finding.stated.value(WRENCH_POINT) + finding.errors["position"][:3]


def _point(finding: FittedHypothesis) -> Mapping[str, object]:
    return {"point": vector(_point_of(finding), 1e3)}


def _droop_stated(setup: Setup) -> bool:
    return bool({"droop", "cycle_droop"} & setup.vehicle.thrust.model_fields_set)


def _supply(setup: Setup) -> str:
    thrust = setup.vehicle.thrust
    if _droop_stated(setup):
        return f"each jet loses {100 * (thrust.droop + thrust.cycle_droop):g} % of its thrust for each other jet that fires"
    return "each jet gives its full thrust while other jets are open (thrust.droop is not stated)"


def _sharing(setup: Setup) -> bool:
    return setup.log.command_kind == "jets" and together(setup.log) > 1


_LOST = (
    "each jet loses {{percent:.3g}} ± {{percent_sigma:.2g}} % of its thrust for each other jet {when}, as if the supply pressure dropped"
)


def _droop(key: str, column: str, what: str, when: str, part_of: str = "") -> ErrorParameter:
    return ErrorParameter(
        key,
        "thrust-droop",
        what,
        "parts",
        usual=0.01,
        prior=0.03,  # a supply that is worse is re-plumbed: a sixth of what the vehicle file allows, at two sigma a third
        key=f"thrust.{key}",
        no_sigma=_REFIT,
        lowest=0.0,
        highest=MOST_DROOP,
        slack=0.002,  # what the thrust of a jet gains beside another by chance in a log of 1,000 cycles
        columns=(column,),
        late=True,
        redone="commands",
        difference=0.01,
        wording=Wording(_LOST.format(when=when), f"state thrust.{key}"),
        step=Step(f"thrust-{key.replace('_', '-')}", 0.01, "1 % for each", _supply, _sharing, part_of, stated=_droop_stated),
    )


def _ramp(name: str, column: str, what: str) -> ErrorParameter:
    return ErrorParameter(
        name,
        "thrust-rise",
        what,
        "cycles",
        usual=0.05,
        prior=0.3,  # a ramp as long as 0.6 cycles: valves are chosen to be faster than the cycle
        key=f"jets.{name}_s",
        no_sigma=_REFIT,
        lowest=0.0,
        slack=0.5,
        scale=lambda vehicle: 2 * vehicle.cycle.period_s,  # half of the thrust comes later by half the ramp
        columns=("smeared", column),
        bends="always",
        late=True,
        redone="commands",
        difference=0.02,
        wording=Wording("{ramps}", "correct {them}", _ramps),
    )


PARAMETERS = (
    ErrorParameter(
        "direction",
        "jet-direction",
        "direction of each jet's force, of a wheel's axis, or of a control moment gyro's axes",
        "N",
        prior=0.2,  # of the force, so rad: a bracket that is mounted 12 degrees off
        usual=float(np.radians(1)),
        key="jets.force_n",
        sigma_key="jets.direction_sigma_rad",
        states="size",
        size=3,
        per_channel=True,
        change=lambda setup, error: channels.turned(setup, error.reshape(-1, 3)),
        uncertain=("jet-direction", "jet directions are as stated, within jets.direction_sigma_rad"),
        wording=Wording("{who} pushes {angle:.3g} degrees away from its {key}: the force is {force} N", "correct {key}", _angle),
    ),
    ErrorParameter(
        "thrust",
        "thrust-scale",
        "thrust of each jet or component of the commanded wrench",
        "1",
        prior=0.3,  # calibrated thrust is within a few percent; a wrong regulator setting or nozzle is a third
        usual=0.05,
        key="jets.force_n",
        sigma_key="jets.thrust_sigma",
        states="size",
        per_channel=True,
        change=channels.scaled,
        uncertain=("jet-thrust", "the thrust of each jet is as stated, within jets.thrust_sigma"),
        wording=Wording("{who} {give} {factor:+.4g} times the stated {of}, unlike the others", "{scale}", who),
    ),
    ErrorParameter(
        "position",
        "jet-position",
        "position of each jet",
        "m",
        prior=0.03,  # the size of a bracket: a mistaken mounting hole
        usual=0.01,
        key="jets.position_m",
        sigma_key="jets.position_sigma_m",
        states="size",
        size=3,
        per_channel=True,
        change=_moved,
        uncertain=("jet-position", "jet positions are as stated, within jets.position_sigma_m"),
        wording=Wording("{who} sits {by} mm away from its position_m", "correct it", _place),
    ),
    ErrorParameter(
        "wrench_point",
        "wrench-point",
        "point about which commanded torques act",
        "m",
        prior=0.03,  # as far as a CG is from where its controller has it
        usual=0.01,
        key=WRENCH_POINT,
        no_sigma=_REFIT,
        size=3,
        change=lambda setup, error: _about(setup, error) if setup.log.command_kind == "wrench" else None,
        redone="commands",
        difference=0.001,
        entries=("position",),
        wording=Wording("commanded torques are about the point {point} mm from O, not about thrust.wrench_point_m", "correct it", _point),
    ),
    _ramp("rise", "rising", "rise time of the thrust"),
    _ramp("fall", "falling", "fall time of the thrust"),
    _droop("droop", "sagging", "thrust lost to other jets that are open", "that is open"),
    _droop("cycle_droop", "ebbing", "thrust lost to other jets that fire in the cycle", "that fires in its cycle", "thrust-droop"),
)


def _reversed(finding: FittedHypothesis) -> bool:
    return finding.factor < REVERSED


def _all_reversed(finding: FittedHypothesis) -> bool:
    return _reversed(finding) and 1 < len(finding.subject) == len(finding.names)


def _jets(finding: FittedHypothesis) -> bool:
    return table_of(finding) == "jets"


def _dead(finding: FittedHypothesis) -> bool:
    return abs(finding.factor) < NEAR


def _in_rpm(finding: FittedHypothesis) -> bool:
    return table_of(finding) == "wheels" and abs(finding.factor / RPM - 1) < NEAR


def _gimbal_reversed(finding: FittedHypothesis) -> bool:
    return table_of(finding) == "control_moment_gyros" and len(finding.subject) == 1 and _reversed(finding)


def _about_its_cg(finding: FittedHypothesis) -> bool:
    return about_cg(_point_of(finding), finding.sigmas["position"][:3], finding.cg, finding.force[0])


def _stores(finding: FittedHypothesis) -> bool:
    return table_of(finding) in KEYS and table_of(finding) != "rotors"


def _columns(finding: FittedHypothesis) -> Mapping[str, object]:
    return {"columns": ", ".join(finding.subject)}


_NOTHING = "{who} {do} not push at all"
_RPM = "the speed of {who} is logged in rpm"
_SPUN = "{who} {turn} opposite to the stated spin"
_GIMBAL = "the gimbal of {who} turns opposite to the stated direction"
_ALL_JETS = "all jets push opposite to the stated direction: force_n is the force on the vehicle, not on the plume"
_ALL_COMMANDS = "all commands act opposite to their sign: a command is the force or torque on the vehicle, not its reaction"
_OTHER_WAY = "{who} {push} opposite to the stated direction{turned}"
_ABOUT_CG = "commanded torques are about the CG, {point} mm from O, not about O"
_LIMITED = "commanded wrenches act only up to {limits}, as if the allocation saturated"
_NORMALISED = "{columns} hold normalised commands (largest value 1), not N m and N"
_LATER = "pulses of jet {jet} begin {later:.3g} s later than the command delay of all jets"
_SHORT = "pulses commanded for less than {short:.3g} s {does}"
_SPEEDS_LATER = "logged wheel speeds are {later:.3g} s older than speed_latency_s states"
_RUBBING = "the friction of wheels differs from the vehicle file: {friction}"
_SWAPPED = "{jets} are {how}"
SPECIAL_CASES = (
    SpecialCase(
        "thrust-scale", Wording(_ALL_JETS, "correct the sign of every force_n"), lambda f: _jets(f) and _all_reversed(f), "jet-sign"
    ),
    SpecialCase("thrust-scale", Wording(_ALL_COMMANDS, "correct their signs under [columns]"), _all_reversed, "command-sign"),
    SpecialCase("thrust-scale", Wording(_OTHER_WAY, "correct force_n", who), lambda f: _jets(f) and _reversed(f), "jet-sign"),
    SpecialCase(
        "thrust-scale", Wording(_GIMBAL, "correct the sign of its column, or its gimbal_axis", who), _gimbal_reversed, "command-sign"
    ),
    SpecialCase("thrust-scale", Wording(_OTHER_WAY, "correct the sign under [columns]", who), _reversed, "command-sign"),
    SpecialCase("thrust-scale", Wording(_NOTHING, "check valves and wiring", who), lambda f: _jets(f) and _dead(f), "jet-dead"),
    SpecialCase("thrust-scale", Wording(_NOTHING, "check its motor, its wiring and its column", who), _dead, "actuator-dead"),
    SpecialCase("thrust-scale", Wording(_RPM, "correct the scale under [columns]", who), _in_rpm, "speed-units"),
    SpecialCase("wrench-point", Wording(_ABOUT_CG, "state thrust.wrench_point_m, or log torques about O", _point), _about_its_cg),
    SpecialCase("jet-direction", Wording("{axes}", "correct {each}", _axes), _stores, "wheel-axis"),
    SpecialCase("pulse-position", Wording("pulses {place} their cycles{delay}", "state {key}", _pulse_at)),
    SpecialCase("short-pulses", Wording(_SHORT, "state thrust.{key}", _short)),
    SpecialCase("jet-late", Wording(_LATER, "state its delay_s, or check its driver and valve", _one_later)),
    SpecialCase("speed-late", Wording(_SPEEDS_LATER, "state speed_latency_s of each wheel", _speeds_later)),
    SpecialCase("wheel-friction", Wording(_RUBBING, "state coulomb_friction_n_m and viscous_friction_n_m_s of each wheel", _rubbing)),
    SpecialCase("commands-limited", Wording(_LIMITED, "state thrust.wrench_limits", _limits)),
    SpecialCase("commands-normalised", Wording(_NORMALISED, "state the scale of each under [columns]", _columns)),
    SpecialCase("rotor-spin", Wording(_SPUN, "correct spin, or swap two wires of the motor", who)),
    *(
        SpecialCase(code, Wording(_SWAPPED, "swap their wires, columns or entries in the vehicle file", _swapped))
        for code in ("jets-swapped", "actuators-swapped")
    ),
)
