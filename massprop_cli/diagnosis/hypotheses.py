"""List of all single-cause hypotheses."""

import itertools
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.base.levels import UNUSUAL
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.design import INTEGRATED, RAMPS, SUPPLY
from massprop_cli.diagnosis.hypothesis import STRAIGHT, Hypothesis
from massprop_cli.errorparameters.sensor import DEGREE, GRAVITY, WORDS
from massprop_cli.errorparameters.table import BY_NAME, PRIORS
from massprop_cli.errorparameters.thrust import RPM
from massprop_cli.prepare.actuators import NOWHERE, lines_of

AXES = "xyz"
DECIMATED = (2, 3, 4, 5, 10)
"""Records of which a recorder may keep one."""
UNITS_M = (1e-3, 1e-2, 0.0254)
"""Length units of drawings, m."""
REACHED = 10.0
"""Prior sigmas within which a fit from the stated place reaches the IMU's place."""
FEW = 8
"""Most devices of which three are exchanged at once."""


def listed(model: Model, names: Sequence[str]) -> list[Hypothesis]:
    """Hypotheses with unknowns near their stated values, for a log with these channel names."""
    point = [wrench_point(model, len(names))] if model.kind == "wrench" and model.thrusting else []
    of_channels = [*_channels(model, names), *_devices(model, names), *_groups(model, names), *point]
    return [*of_channels, *timing(model), *_sensors(model), *_tilts(model), *_others(model)]


def along(model: Model, *moves: tuple[str, Array]) -> Array:
    """(nx, 1) direction of one unknown that changes several entries together."""
    column = np.zeros((len(model.stated), 1))
    for name, part in moves:
        column[model.place(name), 0] = PRIORS[name] * part
    return column


def _free(model: Model, *names: str, subject: tuple[str, ...] = ()) -> Hypothesis:
    """Hypothesis that each component of these parameters is unknown; its code is that of the last."""
    directions = [along(model, (name, unit)) for name in names for unit in np.eye(BY_NAME[name].size)]
    return Hypothesis(BY_NAME[names[-1]].code, subject, np.hstack(directions))


def wrench_point(model: Model, count: int) -> Hypothesis:
    """Commanded torques about another point, that is, all forces at another place."""
    pushes = (np.arange(count) < model.thrusting)[:, None]
    return Hypothesis("wrench-point", (), np.hstack([along(model, ("position", (unit * pushes).ravel())) for unit in np.eye(3)]))


def _channels(model: Model, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Hypotheses about single commanded channels."""
    for i, (name, force) in enumerate(zip(names[: model.thrusting], model.force, strict=False)):
        yield from _scales(model, names, (i,))
        if model.kind == "rotors" and model.couple[i].any():
            spun = _of_rotors(names, (i,))
            yield Hypothesis("rotor-spin", (name,), np.zeros((len(model.stated), 0)), reversed_rotors=spun, suspects=spun)
        size = float(np.linalg.norm(force))
        if size == 0 or model.kind == "wrench":
            continue
        for code, unit in (("jet-position", 1.0), ("jet-direction", size)):
            yield Hypothesis(code, (name,), _across(model, code.removeprefix("jet-"), i, force, unit), suspects=(i,))


def _scales(model: Model, names: Sequence[str], group: tuple[int, ...], begins: Sequence[float] = (0.0, -1.0)) -> Iterator[Hypothesis]:
    """A common thrust factor of channels, also from dead and reversed on, which a fit from 1 may not reach."""
    column, subject = along(model, ("thrust", np.isin(np.arange(len(names)), group).astype(float))), tuple(names[i] for i in group)
    yield Hypothesis("thrust-scale", subject, column, suspects=group)
    for begin in begins:
        yield Hypothesis("thrust-scale", subject, column, initial_values={model.place("thrust").start + i: begin for i in group})


def _reversed(model: Model, names: Sequence[str], group: Sequence[int]) -> Hypothesis:
    """Channels that all act the opposite way."""
    start = {model.place("thrust").start + i: -1.0 for i in group}
    return Hypothesis("thrust-scale", tuple(names[i] for i in group), np.zeros((len(model.stated), 0)), initial_values=start)


def _of_rotors(names: Sequence[str], which: Sequence[int]) -> tuple[int, ...]:
    """Channels of rotors: of their thrust, and of their stored momentum, which has the rotor's name."""
    return tuple(k for k, name in enumerate(names) if name in {names[i] for i in which})


def _across(model: Model, name: str, channel: int, line: Array, unit: float = 1.0) -> Array:
    """(nx, 2) directions of a channel's vector parameter across its line; along the line it has no effect."""
    channel_mask = np.eye(len(model.force))[channel]
    return np.hstack([along(model, (name, unit * np.outer(channel_mask, axis).ravel())) for axis in np.linalg.svd(line[None])[2][1:]])


def _devices(model: Model, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Hypotheses about single momentum devices: another scale, none, reversed, speed in rpm, one gimbal reversed."""
    for group in itertools.chain(*model.devices.values()):
        yield from _scales(model, names, group, (0.0, -1.0, *([RPM] if len(group) == 1 else [])))
        for i in group if len(group) > 1 else ():
            yield _reversed(model, names, [i])
    if 0 < model.thrusting < len(names) - 1:  # relative to the thrust; which of both is wrong is not observable
        yield scaled(model, names, range(model.thrusting, len(names)))


def device_axes(model: Model, names: Sequence[str]) -> list[Hypothesis]:
    """Turned axes of each wheel or control moment gyro, and of all of a kind; none on a table, which turns about one axis."""
    listed_axes = list[Hypothesis]()
    for kind in model.devices.values() if model.turns.all() else ():
        each = [Hypothesis("jet-direction", tuple(names[i] for i in group), _turned(model, group), suspects=group) for group in kind]
        names_of_kind = tuple(name for one in each for name in one.subject)
        listed_axes += [*each, *[Hypothesis("jet-direction", names_of_kind, np.hstack([one.directions for one in each]))] * (len(each) > 1)]
    return listed_axes


def _turned(model: Model, group: Sequence[int]) -> Array:
    """(nx, 2 or 3) directions that turn a device's axes together; a turn about a single axis has no effect."""
    axes = np.isin(np.arange(len(model.couple)), group)[:, None] * model.couple
    about = np.linalg.svd(model.couple[list(group)])[2][1 if len(group) == 1 else 0 :]
    return np.hstack([along(model, ("direction", np.cross(turn, axes).ravel())) for turn in about])


def two_channels(model: Model, names: Sequence[str]) -> list[Hypothesis]:
    """Thrust of any two channels."""
    units = [along(model, ("thrust", unit)) for unit in np.eye(len(names))]
    pairs = itertools.combinations(range(len(names)), 2)
    return [Hypothesis("thrust-scale", (names[i], names[j]), np.hstack([units[i], units[j]]), suspects=(i, j)) for i, j in pairs]


def swapped(model: Model, names: Sequence[str], does: Sequence[int] = ()) -> list[Hypothesis]:
    """Any two or three actuators with each other's effect, starting from the exchanges ``does``; without unknowns."""
    exchanges, no_unknowns = [], np.zeros((len(model.stated), 0))
    devices = [(i,) for i in range(model.thrusting) if model.kind != "wrench"], *model.devices.values()
    for group in (turn for kind in devices for turn in _turns(kind, bool(does))):
        order = list(does or range(len(names)))
        for device, other in zip(group, (*group[1:], group[0]), strict=True):
            for i, j in zip(device, other, strict=True):
                order[i] = (does or range(len(names)))[j]
        moved = tuple(k for k, does_of in enumerate(order) if does_of != k)
        if not moved:  #  swapped back
            continue
        code = "jets-swapped" if model.kind == "jets" and moved[0] < model.thrusting else "actuators-swapped"
        exchanges.append(Hypothesis(code, tuple(names[k] for k in moved), no_unknowns, suspects=moved, wiring=tuple(order)))
    return exchanges


def _turns(devices: Sequence[tuple[int, ...]], begun: bool) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Any two devices; of a few devices, without previous exchanges, any three in both orders."""
    yield from itertools.combinations(devices, 2)
    for first, *others in itertools.combinations(devices, 3) if not begun and len(devices) <= FEW else ():
        yield from ((first, *rest) for rest in itertools.permutations(others))


def _groups(model: Model, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Common factors of channels that push along one line, that turn about one axis, or both."""
    torque, force = model.wrench(model.stated)
    bearing_torque = np.cross(np.zeros(3) if model.bearing is None else model.bearing, force)
    lines = [lines_of(force), lines_of(torque - bearing_torque)]
    for group in model.together:  # a fit from 1 may not reach dead or reversed
        column, subject = along(model, ("thrust", np.isin(np.arange(len(names)), group).astype(float))), tuple(names[i] for i in group)
        for begin in (0.0, -1.0):
            start = {model.place("thrust").start + i: begin for i in group}
            yield Hypothesis("thrust-scale", subject, column, initial_values=start, suspects=group)
    turning = tuple(np.flatnonzero(model.couple[: model.thrusting].any(1)).tolist())
    if model.kind == "rotors" and turning:  # the opposite sign convention
        spun = _of_rotors(names, turning)
        yield Hypothesis("rotor-spin", tuple(names[i] for i in turning), np.zeros((len(model.stated), 0)), reversed_rotors=spun)
    if len(names) > 1:  # a common positive factor is not observable, a common sign is
        yield _reversed(model, names, range(len(names)))
    if model.kind == "wrench":  # axes of another convention, for example forward-right-down
        along_of = np.argmax(np.abs(torque) + np.abs(force), 1)
        for about in range(3):
            yield _reversed(model, names, np.flatnonzero(along_of != about).tolist())
    seen = {tuple(range(len(names)))}
    for keys in (lines[0], lines[1], list(zip(*lines, strict=True))):
        for key in dict.fromkeys(keys):
            group = tuple(i for i, own in enumerate(keys) if own == key)
            if len(group) > 1 and key != NOWHERE and group not in seen:
                seen.add(group)
                yield scaled(model, names, group)


def scaled(model: Model, names: Sequence[str], group: Sequence[int], begin: float = 1.0) -> Hypothesis:
    """Channels with a common thrust factor, from ``begin`` on."""
    start = {} if begin == 1 else {model.place("thrust").start + i: begin for i in group}
    weights = np.isin(np.arange(len(names)), group) * max(1.0, abs(begin - 1) / PRIORS["thrust"])
    return Hypothesis("thrust-scale", tuple(names[i] for i in group), along(model, ("thrust", weights)), initial_values=start)


def timing(model: Model) -> Iterator[Hypothesis]:
    """Hypotheses of what delays the motion."""
    if set(RAMPS) <= model.places.keys():  # valves that open late, close late, or both
        ramps = (("rise",), ("fall",), ("rise", "fall"))
        yield from (Hypothesis("thrust-rise", (), along(model, *((ramp, np.ones(1)) for ramp in own))) for own in ramps)
    if set(SUPPLY) <= model.places.keys():
        yield from (_free(model, name) for name in ("droop", "cycle_droop"))
    # clocks agree at the start of the log, and the segment may lie anywhere
    yield from (_free(model, *names) for names in (("delay",), ("lag",), ("gyro_lag",), ("accel_lag",), ("delay", "drift")))


def _sensors(model: Model) -> Iterator[Hypothesis]:
    for sensor in ("gyro", "accel"):
        subjects = (*zip(AXES, strict=True), ())
        for subject, part in zip(subjects, (*np.eye(3), np.ones(3)), strict=True):
            yield Hypothesis(f"{sensor}-scale", subject, along(model, (f"{sensor}_scale", part)))
    yield from (_free(model, name) for name in ("gyro_bias", "accel_bias") if name not in model.biases)


def _tilts(model: Model) -> Iterator[Hypothesis]:
    both = [along(model, *((name, unit) for name in BY_NAME["mounting"].moved)) for unit in np.eye(3)]
    yield Hypothesis("imu-mounting", (), np.hstack(both))
    # on a table an accelerometer turned about Z equals a turned IMU, and one turned about X or Y a bias
    alone = {sensor: word for sensor, word in WORDS.items() if sensor == "gyro" or model.turns.all()}
    yield from (_free(model, f"{sensor}_turn", subject=(word,)) for sensor, word in alone.items())


class OtherUnit(NamedTuple):
    """Other content of the IMU's columns than their names state."""

    code: str
    words: str
    gyro: Array
    """(3,) measured over true value of each gyro axis, IMU axes."""
    accelerometer: Array
    prior_odds: float = 0.0
    """−2 log of the prior odds against others of its kind."""


def other_units(record_s: float, increments: bool) -> list[OtherUnit]:
    """Other units of some or all axes, and increments for rates or the reverse, with records of ``record_s``."""
    # rates in columns of increments are larger by 1 / record_s, and the reverse
    kind, content = (1 / record_s, "hold rates, not increments") if increments else (record_s, "hold increments, not rates")
    every, gyro, accelerometer = np.ones(3), "gyro columns", "accelerometer columns"
    listed_units = []
    for axes in (axes for count in (1, 2, 3) for axes in itertools.combinations(range(3), count)):
        of_axes = np.isin(np.arange(3), axes)
        rare, of = UNUSUAL * (not of_axes.all()), "" if of_axes.all() else f" of {' and '.join(AXES[i] for i in axes)}"
        listed_units.append(
            OtherUnit("gyro-units", f"{gyro}{of} are in degrees, not radians", np.where(of_axes, 1 / DEGREE, 1.0), every, rare)
        )
        listed_units.append(OtherUnit("accel-units", f"{accelerometer}{of} are in g", every, np.where(of_axes, 1 / GRAVITY, 1.0), rare))
    listed_units.append(OtherUnit("gyro-units", f"{gyro} were converted to radians twice", DEGREE * every, every))
    listed_units.append(
        OtherUnit("gyro-units", f"{gyro} are in degrees, not radians, and {accelerometer} in g", every / DEGREE, every / GRAVITY)
    )
    for words, factor in (("are in milli-g", 1e3 / GRAVITY), ("are in mm/s^2", 1e3)):
        listed_units.append(OtherUnit("accel-units", f"{accelerometer} {words}", every, factor * every, UNUSUAL))
    for count in DECIMATED if increments else ():
        dropped = f"gyro and accelerometer columns hold one increment of every {count}: the others were dropped, not summed"
        listed_units.append(OtherUnit("column-kind", dropped, every / count, every / count, UNUSUAL))
    return listed_units + [
        # a common factor of both sensors shows only in terms quadratic in the rates, like a bias
        OtherUnit("column-kind", f"{which} {content}{more}", g * every, a * every, UNUSUAL * (bool(more) or g == a))
        for which, more, g, a in (
            ("gyro and accelerometer columns", "", kind, kind),
            ("gyro and accelerometer columns", ", the gyro's in degrees", kind / DEGREE, kind),
            ("gyro and accelerometer columns", ", the accelerometer's in g", kind, kind / GRAVITY),
            ("gyro and accelerometer columns", ", in degrees and in g", kind / DEGREE, kind / GRAVITY),
            (gyro, "", kind, 1.0),
            (gyro, ", in degrees", kind / DEGREE, 1.0),
            (accelerometer, "", 1.0, kind),
            (accelerometer, ", in g", 1.0, kind / GRAVITY),
        )
    ]


def units(model: Model, record_s: float, increments: bool) -> list[Hypothesis]:
    """The same as hypotheses."""
    no_unknowns = np.zeros((len(model.stated), 0))

    def body_turn(factors: Array) -> Array:
        turn: Array = model.mounting @ np.diag(factors) @ model.mounting.T
        return STRAIGHT if (factors == 1).all() else turn

    return [
        Hypothesis(
            one.code,
            (one.words,),
            no_unknowns,
            gyro=body_turn(one.gyro),
            accelerometer=body_turn(one.accelerometer),
            prior_odds=one.prior_odds,
        )
        for one in other_units(record_s, increments)
    ]


def mountings(model: Model) -> list[Hypothesis]:
    """The IMU turned by right angles, mirrored or transposed; and either sensor alone."""
    no_unknowns, mounting = np.zeros((len(model.stated), 0)), model.mounting
    # the rates were read with the stated mounting; turns are about body axes, or about the IMU's own
    by_body = [mounting @ turn.T for turn in _signed_permutations()]
    by_imu = [mounting @ turn @ mounting.T for turn in _signed_permutations()]
    turns = np.array([np.eye(3), mounting @ mounting, *by_body, *by_imu])
    equal = np.abs(turns[:, None] - turns).max((2, 3)) < ROUNDING
    listed_turns = [
        Hypothesis(
            "imu-mounting", ("the transpose of the stated matrix",) if i == 1 else (), no_unknowns, gyro=turns[i], accelerometer=turns[i]
        )
        for i in sorted(set(equal.argmax(1).tolist()))[1:]  # the first of equal ones, without the stated one
    ]
    for turn in by_imu:
        if np.abs(turn - np.eye(3)).max() > ROUNDING:
            listed_turns.append(Hypothesis("imu-mounting", ("gyro",), no_unknowns, gyro=turn))
            listed_turns.append(Hypothesis("imu-mounting", ("accelerometer",), no_unknowns, accelerometer=turn))
    return listed_turns


def imu_position(model: Model) -> Hypothesis:
    """The IMU at another place."""
    return _free(model, "imu")


def _in_another_unit(model: Model) -> Iterator[Hypothesis]:
    """The IMU's place stated in another unit, if that is beyond the reach of a fit from the stated place."""
    place = model.place("imu")
    for unit in UNITS_M:
        shift = (unit - 1) * model.imu
        if np.abs(shift).max() > REACHED * PRIORS["imu"]:
            start = {place.start + i: float(part) for i, part in enumerate(shift)}
            column = along(model, ("imu", shift / PRIORS["imu"]))
            yield Hypothesis("imu-position", (), column, initial_values=start)


def _others(model: Model) -> Iterator[Hypothesis]:
    yield imu_position(model)
    yield from _in_another_unit(model)
    on_bearing = ("bearing", "room_torque") * (model.bearing is not None) + ("tilt",) * (INTEGRATED in model.places)
    yield from (_free(model, name) for name in (*on_bearing, "torque", "drag"))
    if model.thrusting:  # momentum devices use no propellant
        yield _free(model, "mass_rate", "inertia_rate")


@cache
def _signed_permutations() -> list[Array]:
    """The 48 ways to name and sign three axes; half of them are left-handed."""
    turns: list[Array] = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            turns.append(turn)
    return turns
