"""What jets and commanded wrenches may do otherwise than stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters.parameter import ErrorParameter, FittedHypothesis, SpecialCase, Step, Wording, vector
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.equipment import MOST_DROOP, Jet
from massprop_cli.prepare.actuators import together

NEAR = 0.05
"""Parts of the stated thrust within which a jet is dead or reversed: a sixth of the prior sigma of a jet that is neither."""
REVERSED = -0.5
"""Part of the stated thrust below which a jet pushes the other way: beside another error that is near to as much as stated."""
WRENCH_POINT = "thrust.wrench_point_m"
_REFIT = "a correction is refitted one sigma further on instead"


def _at_jets(setup: Setup, key: str, value: Array) -> Setup:
    """With a row of a key for each channel that fired; as it is where commands are no jets'."""
    if setup.log.command_kind != "jets":
        return setup
    every = setup.value(key)
    every[list(setup.fired)] = value
    return setup.having(key, every)


def _turned(setup: Setup, error: Array) -> Setup:
    """Forces of the same size along other directions."""
    force = setup.value("jets.force_n")[list(setup.fired)] if setup.log.command_kind == "jets" else np.zeros((len(setup.fired), 3))
    along = force + error.reshape(-1, 3)
    size, stated = (np.linalg.norm(part, axis=-1, keepdims=True) for part in (along, force))
    return _at_jets(setup, "jets.force_n", along * (stated / np.where(stated > 0, size, 1.0)))


def _scaled(setup: Setup, error: Array) -> Setup:
    """Forces, or commands, times a factor."""
    fired = list(setup.fired)
    if setup.log.command_kind == "wrench":
        command = np.ones(setup.log.command.shape[1])
        command[fired] += error
        return setup._replace(log=replace(setup.log, command=setup.log.command * command))
    if setup.log.command_kind != "jets":
        return setup
    return _at_jets(setup, "jets.force_n", setup.value("jets.force_n")[fired] * (1 + error[:, None]))


def _about(setup: Setup, error: Array) -> Setup:
    return setup.having(WRENCH_POINT, setup.value(WRENCH_POINT) + error)


def _moved(setup: Setup, error: Array) -> Setup:
    if setup.log.command_kind == "wrench":  # torques about another point: all its forces are moved alike
        return _about(setup, error.reshape(-1, 3).mean(0))
    if setup.log.command_kind != "jets":
        return setup
    return _at_jets(setup, "jets.position_m", setup.value("jets.position_m")[list(setup.fired)] + error.reshape(-1, 3))


def _angle(finding: FittedHypothesis) -> Mapping[str, object]:
    stated, true = (force[finding.channel] for force in finding.force)
    cosine = stated @ true / np.linalg.norm(stated) / np.linalg.norm(true)
    return {"jet": finding.subject[0], "angle": np.degrees(np.arccos(np.clip(cosine, -1, 1))), "force": vector(true)}


def _place(finding: FittedHypothesis) -> Mapping[str, object]:
    return {"jet": finding.subject[0], "by": vector(finding.errors["position"].reshape(-1, 3)[finding.channel], 1e3)}


def _who(finding: FittedHypothesis) -> Mapping[str, object]:
    several, listed = len(finding.subject) > 1, ", ".join(finding.subject)
    who = listed if not finding.by_jets else f"jets {listed}" if several else f"jet {listed}"
    scale = "mend the unit or scale of these, or of the others, under [columns]" if several else "mend the scale under [columns]"
    verbs = {"push": "push", "give": "give", "do": "do"} if several else {"push": "pushes", "give": "gives", "do": "does"}
    turned = "" if abs(finding.factor + 1) < NEAR else f", with {-finding.factor:.3g} of the thrust"
    return {
        "who": who,
        "factor": finding.factor,
        "turned": turned,
        "scale": "mend force_n or calibrate" if finding.by_jets else scale,
        **verbs,
    }


def _apart(one: Jet, other: Jet) -> float:
    """Between two jets, m and N."""
    return float(
        np.hypot(np.linalg.norm(np.subtract(one.position_m, other.position_m)), np.linalg.norm(np.subtract(one.force_n, other.force_n)))
    )


def _swapped(finding: FittedHypothesis) -> Mapping[str, object]:
    jets, stated = finding.subject, finding.stated.vehicle.jets
    wired = [one for one in finding.corrected.vehicle.jets if one.name in jets]
    does = {one.name: min(stated, key=lambda other: _apart(one, other)).name for one in wired}
    as_another = "; ".join(f"{name} does what is stated of {does[name]}" for name in jets)
    how = "swapped: each does what is stated of the other" if len(jets) == 2 else f"wired round: {as_another}"
    return {"jets": f"{', '.join(jets[:-1])} and {jets[-1]}", "how": how}


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


def _ramps(finding: FittedHypothesis) -> Mapping[str, object]:
    rise, fall = (2e3 * finding.mean(name) * finding.stated.period_s for name in ("rise", "fall"))
    by = rise or fall
    longer = f"thrust takes {abs(by):.3g} ms {'longer' if by > 0 else 'less'}"
    if rise and fall:
        return {"ramps": f"{longer} to rise and to fall than rise_s and fall_s say", "them": "them"}
    ramp, valve, gives = ("rise", "opens", by < 0) if rise else ("fall", "closes", by > 0)
    effect = f"of a valve that {valve} {abs(by) / 2:.3g} ms {'later' if by > 0 else 'earlier'}, so each pulse gives"
    return {"ramps": f"{longer} to {ramp} than {ramp}_s says, as {effect} {'more' if gives else 'less'}", "them": "it"}


def about_cg(point: Array, cg: Array) -> bool:
    """Whether a point that is found for torques is the CG."""
    return bool(np.linalg.norm(point - cg) < NEAR * np.linalg.norm(point))


def _point_of(finding: FittedHypothesis) -> Array:
    found: Array = finding.stated.value(WRENCH_POINT) + finding.errors["position"][:3]
    return found


def _point(finding: FittedHypothesis) -> Mapping[str, object]:
    return {"point": vector(_point_of(finding), 1e3)}


def _droop_stated(setup: Setup) -> bool:
    return bool({"droop", "cycle_droop"} & setup.vehicle.thrust.model_fields_set)


def _supply(setup: Setup) -> str:
    thrust = setup.vehicle.thrust
    if _droop_stated(setup):
        return f"each jet loses {100 * (thrust.droop + thrust.cycle_droop):g} % of its thrust for each further one"
    return "each jet gives the same however many others are open (thrust.droop is not stated)"


def _sharing(setup: Setup) -> bool:
    return setup.log.command_kind == "jets" and together(setup.log) > 1


_LOST = (
    "each jet loses {{percent:.3g}} ± {{percent_sigma:.2g}} % of its thrust for each further one {when}, as of a supply whose pressure sags"
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
        wording=Wording("{ramps}", "mend {them}", _ramps),
    )


PARAMETERS = (
    ErrorParameter(
        "direction",
        "jet-direction",
        "direction of each jet's force",
        "N",
        prior=0.2,  # of the force, so rad: a bracket that is mounted 12 degrees off
        usual=float(np.radians(1)),
        key="jets.force_n",
        sigma_key="jets.direction_sigma_rad",
        size=3,
        per_channel=True,
        change=_turned,
        uncertain=("jet-direction", "jets point where they are stated to within jets.direction_sigma_rad"),
        wording=Wording("jet {jet} pushes {angle:.3g} degrees away from its force_n, with {force} N", "mend it", _angle),
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
        per_channel=True,
        change=_scaled,
        uncertain=("jet-thrust", "each jet's own thrust is as uncertain as jets.thrust_sigma says"),
        wording=Wording("{who} ({factor:+.4g}) {give} another part of the stated thrust than others", "{scale}", _who),
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
        size=3,
        per_channel=True,
        change=_moved,
        uncertain=("jet-position", "jets sit where they are stated to within jets.position_sigma_m"),
        wording=Wording("jet {jet} sits {by} mm away from its position_m", "mend it", _place),
    ),
    ErrorParameter(
        "wrench_point",
        "wrench-point",
        "point about which commanded torques are",
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
        wording=Wording("commanded torques are about {point} mm and not about thrust.wrench_point_m", "state it", _point),
    ),
    _ramp("rise", "rising", "time that thrust takes to rise"),
    _ramp("fall", "falling", "time that thrust takes to fall"),
    _droop("droop", "sagging", "thrust lost to other jets that are open", "while that is open"),
    _droop("cycle_droop", "ebbing", "thrust lost to other jets that fire in the cycle", "that fires in its cycle", "thrust-droop"),
)


def _reversed(finding: FittedHypothesis) -> bool:
    return finding.factor < REVERSED


def _all_reversed(finding: FittedHypothesis) -> bool:
    return _reversed(finding) and 1 < len(finding.subject) == len(finding.names)


_ALL_JETS = "all jets push the other way: force_n is what pushes the vehicle, not the plume"
_ALL_COMMANDS = "all commands act the other way: commands are what acts on the vehicle, not what it reacts to"
_OTHER_WAY = "{who} {push} the other way than stated{turned}"
_ABOUT_CG = "commanded torques are about the CG, {point} mm from O, and not about O"
_LIMITED = "of commanded wrenches no more acts than {limits}, as of an allocation that saturates"
_SWAPPED = "jets {jets} are {how}"
SPECIAL_CASES = (
    SpecialCase("thrust-scale", "jet-sign", lambda f: f.by_jets and _all_reversed(f), Wording(_ALL_JETS, "mend the sign of every force_n")),
    SpecialCase("thrust-scale", "command-sign", _all_reversed, Wording(_ALL_COMMANDS, "mend their signs under [columns]")),
    SpecialCase("thrust-scale", "jet-sign", lambda f: f.by_jets and _reversed(f), Wording(_OTHER_WAY, "mend force_n", _who)),
    SpecialCase("thrust-scale", "command-sign", _reversed, Wording(_OTHER_WAY, "mend the sign under [columns]", _who)),
    SpecialCase(
        "thrust-scale",
        "jet-dead",
        lambda f: abs(f.factor) < NEAR,
        Wording("{who} {do} not push at all", "look at valves and wiring", _who),
    ),
    SpecialCase(
        "wrench-point",
        "wrench-point",
        lambda finding: about_cg(_point_of(finding), finding.cg),
        Wording(_ABOUT_CG, "state thrust.wrench_point_m, or log them about O", _point),
    ),
    SpecialCase(
        "pulse-position", "pulse-position", lambda _: True, Wording("pulses {place} their cycles{delay}", "state {key}", _pulse_at)
    ),
    SpecialCase("commands-limited", "commands-limited", lambda _: True, Wording(_LIMITED, "state thrust.wrench_limits", _limits)),
    SpecialCase("jets-swapped", "jets-swapped", lambda _: True, Wording(_SWAPPED, "swap wires, columns or entries", _swapped)),
)
