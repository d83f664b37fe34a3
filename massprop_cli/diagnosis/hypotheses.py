"""The list of all hypotheses."""

import itertools
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.design import INTEGRATED, RAMPS, SUPPLY
from massprop_cli.diagnosis.hypothesis import STRAIGHT, Hypothesis
from massprop_cli.errorparameters.sensor import DEGREE, GRAVITY, WORDS
from massprop_cli.errorparameters.table import BY_NAME, PRIORS
from massprop_cli.errorparameters.thrust import RPM
from massprop_cli.prepare.actuators import NOWHERE, lines_of

AXES = "xyz"
TWO = 9.2
"""−2 log of the odds, 1 : 100, that a unit is another as well."""
DECIMATED = (2, 3, 4, 5, 10)
"""Records of which a recorder may keep one."""
UNITS_M = (1e-3, 1e-2, 0.0254)
"""Lengths that drawings are in."""
REACHED = 10.0
"""Priors of the IMU's place within which it is found from where it is stated."""
FEW = 8
"""Devices, of which three may be wired round that no exchange of two leads to."""


def listed(model: Model, names: Sequence[str]) -> list[Hypothesis]:
    """All that move x by a little at a time, for a log whose channels that fired have ``names``."""
    point = [wrench_point(model, len(names))] if model.kind == "wrench" and model.thrusting else []
    of_channels = [*_channels(model, names), *_devices(model, names), *_groups(model, names), *point]
    return [*of_channels, *timing(model), *_sensors(model), *_tilts(model), *_others(model)]


def along(model: Model, *moves: tuple[str, Array]) -> Array:
    """(nx, 1) of one unknown that moves several entries together."""
    column = np.zeros((len(model.stated), 1))
    for name, part in moves:
        column[model.place(name), 0] = PRIORS[name] * part
    return column


def _free(model: Model, *names: str, subject: tuple[str, ...] = ()) -> Hypothesis:
    """Each component of these parameters, under the code of the last."""
    units = [along(model, (name, unit)) for name in names for unit in np.eye(BY_NAME[name].size)]
    return Hypothesis(BY_NAME[names[-1]].code, subject, np.hstack(units))


def wrench_point(model: Model, count: int) -> Hypothesis:
    """Commanded torques about another point, as if all forces acted there."""
    pushes = (np.arange(count) < model.thrusting)[:, None]
    return Hypothesis("wrench-point", (), np.hstack([along(model, ("position", (unit * pushes).ravel())) for unit in np.eye(3)]))


def _channels(model: Model, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Each that is commanded."""
    for i, (name, force) in enumerate(zip(names[: model.thrusting], model.force, strict=False)):
        yield from _scales(model, names, (i,))
        if model.kind == "rotors" and model.couple[i].any():
            own = _of_rotors(names, (i,))
            yield Hypothesis("rotor-spin", (name,), np.zeros((len(model.stated), 0)), spun=own, suspects=own)
        size = float(np.linalg.norm(force))
        if size == 0 or model.kind == "wrench":
            continue
        for code, unit in (("jet-position", 1.0), ("jet-direction", size)):
            yield Hypothesis(code, (name,), _across(model, code.removeprefix("jet-"), i, force, unit), suspects=(i,))


def _scales(model: Model, names: Sequence[str], group: tuple[int, ...], begins: Sequence[float] = (0.0, -1.0)) -> Iterator[Hypothesis]:
    """Channels that give another part together; and from dead and reversed on: too far to be led there where two always fire together."""
    column, subject = along(model, ("thrust", np.isin(np.arange(len(names)), group).astype(float))), tuple(names[i] for i in group)
    yield Hypothesis("thrust-scale", subject, column, suspects=group)
    for begin in begins:
        yield Hypothesis("thrust-scale", subject, column, start={model.place("thrust").start + i: begin for i in group})


def _reversed(model: Model, names: Sequence[str], group: Sequence[int]) -> Hypothesis:
    """Channels that all do the opposite of what is stated."""
    start = {model.place("thrust").start + i: -1.0 for i in group}
    return Hypothesis("thrust-scale", tuple(names[i] for i in group), np.zeros((len(model.stated), 0)), start=start)


def _of_rotors(names: Sequence[str], which: Sequence[int]) -> tuple[int, ...]:
    """The channels of rotors: of their thrust, and of the momentum that they store, which has the rotor's name."""
    return tuple(k for k, name in enumerate(names) if name in {names[i] for i in which})


def _across(model: Model, name: str, channel: int, line: Array, unit: float = 1.0) -> Array:
    """(nx, 2) of a parameter of a channel along two directions across its own line: along that nothing changes."""
    marks = np.eye(len(model.force))[channel]
    return np.hstack([along(model, (name, unit * np.outer(marks, axis).ravel())) for axis in np.linalg.svd(line[None])[2][1:]])


def _devices(model: Model, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Each that stores momentum: another part of it, none, the other way round, its speed in rpm; a gimbal that turns the other way."""
    for group in itertools.chain(*model.devices.values()):
        yield from _scales(model, names, group, (0.0, -1.0, *([RPM] if len(group) == 1 else [])))
        for i in group if len(group) > 1 else ():
            yield _reversed(model, names, [i])
    if 0 < model.thrusting < len(names) - 1:  # against what pushes: which of both is off nothing tells
        yield scaled(model, names, range(model.thrusting, len(names)))


def device_axes(model: Model, names: Sequence[str]) -> list[Hypothesis]:
    """Each wheel or control moment gyro turned as a whole, and all of a kind; on a table they turn about one axis alone."""
    found = list[Hypothesis]()
    for kind in model.devices.values() if model.turns.all() else ():
        each = [Hypothesis("jet-direction", tuple(names[i] for i in group), _turned(model, group), suspects=group) for group in kind]
        every = tuple(name for one in each for name in one.subject)
        found += [*each, *[Hypothesis("jet-direction", every, np.hstack([one.free for one in each]))] * (len(each) > 1)]
    return found


def _turned(model: Model, group: Sequence[int]) -> Array:
    """(nx, 2 or 3) of a device's axes, one or two, that turn together; about a single one nothing changes."""
    axes = np.isin(np.arange(len(model.couple)), group)[:, None] * model.couple
    about = np.linalg.svd(model.couple[list(group)])[2][1 if len(group) == 1 else 0 :]
    return np.hstack([along(model, ("direction", np.cross(turn, axes).ravel())) for turn in about])


def two_channels(model: Model, names: Sequence[str]) -> list[Hypothesis]:
    """The thrust of any two channels."""
    units = [along(model, ("thrust", unit)) for unit in np.eye(len(names))]
    pairs = itertools.combinations(range(len(names)), 2)
    return [Hypothesis("thrust-scale", (names[i], names[j]), np.hstack([units[i], units[j]]), suspects=(i, j)) for i, j in pairs]


def swapped(model: Model, names: Sequence[str], does: Sequence[int] = ()) -> list[Hypothesis]:
    """Any two jets, each of which does what is stated of the other, where jets do what is stated of those that ``does`` says already.

    Nothing is left to be found.
    """
    found, none = [], np.zeros((len(model.stated), 0))
    devices = [(i,) for i in range(model.thrusting) if model.kind != "wrench"], *model.devices.values()
    for group in (turn for kind in devices for turn in _turns(kind, bool(does))):
        order = list(does or range(len(names)))
        for own, other in zip(group, (*group[1:], group[0]), strict=True):
            for i, j in zip(own, other, strict=True):
                order[i] = (does or range(len(names)))[j]
        others = tuple(k for k, does_of in enumerate(order) if does_of != k)
        if not others:  # swapped back
            continue
        code = "jets-swapped" if model.kind == "jets" and others[0] < model.thrusting else "actuators-swapped"
        found.append(Hypothesis(code, tuple(names[k] for k in others), none, suspects=others, does=tuple(order)))
    return found


def _turns(devices: Sequence[tuple[int, ...]], begun: bool) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Any two of them; and of few, where nothing is exchanged as yet, any three both ways round."""
    yield from itertools.combinations(devices, 2)
    for first, *others in itertools.combinations(devices, 3) if not begun and len(devices) <= FEW else ():
        yield from ((first, *rest) for rest in itertools.permutations(others))


def _groups(model: Model, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Channels that push along one line, those that turn about one axis, and those that do both alike."""
    torque, force = model.wrench(model.stated)
    moved = np.cross(np.zeros(3) if model.bearing is None else model.bearing, force)
    lines = [lines_of(force), lines_of(torque - moved)]
    for group in model.together:  # both dead or mounted the other way round: too far to be led there
        column, subject = along(model, ("thrust", np.isin(np.arange(len(names)), group).astype(float))), tuple(names[i] for i in group)
        for begin in (0.0, -1.0):
            start = {model.place("thrust").start + i: begin for i in group}
            yield Hypothesis("thrust-scale", subject, column, start=start, suspects=group)
    turning = tuple(np.flatnonzero(model.couple[: model.thrusting].any(1)).tolist())
    if model.kind == "rotors" and turning:  # by another convention
        spun = _of_rotors(names, turning)
        yield Hypothesis("rotor-spin", tuple(names[i] for i in turning), np.zeros((len(model.stated), 0)), spun=spun)
    if len(names) > 1:  # how much all give together nothing tells, but which way
        yield _reversed(model, names, range(len(names)))
    if model.kind == "wrench":  # in the axes of another convention: forward-right-down, say
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
    """Channels that all give the same part of what is stated; looked for from ``begin`` on: another unit may be any factor."""
    start = {} if begin == 1 else {model.place("thrust").start + i: begin for i in group}
    marks = np.isin(np.arange(len(names)), group) * max(1.0, abs(begin - 1) / PRIORS["thrust"])
    return Hypothesis("thrust-scale", tuple(names[i] for i in group), along(model, ("thrust", marks)), start=start)


def timing(model: Model) -> Iterator[Hypothesis]:
    """What makes motion late."""
    if set(RAMPS) <= model.places.keys():  # valves that open or close late, or both alike
        ramps = (("rise",), ("fall",), ("rise", "fall"))
        yield from (Hypothesis("thrust-rise", (), along(model, *((ramp, np.ones(1)) for ramp in own))) for own in ramps)
    if set(SUPPLY) <= model.places.keys():
        yield from (_free(model, name) for name in ("droop", "cycle_droop"))
    # clocks agree where the log begins, and the stretch is somewhere in it
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
    # on a table a turn of the accelerometer about Z is one of the whole IMU, and one about X or Y, which feels some of the weight, a bias
    alone = {sensor: word for sensor, word in WORDS.items() if sensor == "gyro" or model.turns.all()}
    yield from (_free(model, f"{sensor}_turn", subject=(word,)) for sensor, word in alone.items())


class OtherUnit(NamedTuple):
    """What the columns of the IMU may hold instead of what their names say."""

    code: str
    words: str
    gyro: Array
    """(3,) what each axis shows of what is, IMU axes."""
    accelerometer: Array
    rare: float = 0.0
    """−2 log of its odds against others of its kind."""


def other_units(record_s: float, increments: bool) -> list[OtherUnit]:
    """Other units of a sensor, of some of its axes or of all; increments for rates, or the other way, over records of ``record_s``."""
    # of numbers that stand for rates in columns of increments they show as much more as a record is short, and the other way round
    kind, held = (1 / record_s, "hold rates, not increments") if increments else (record_s, "hold increments, not rates")
    every, gyro, accelerometer = np.ones(3), "gyro columns", "accelerometer columns"
    found = []
    for axes in (axes for count in (1, 2, 3) for axes in itertools.combinations(range(3), count)):
        own = np.isin(np.arange(3), axes)
        rare, of = TWO * (not own.all()), "" if own.all() else f" of {' and '.join(AXES[i] for i in axes)}"
        found.append(OtherUnit("gyro-units", f"{gyro}{of} are in degrees, not radians", np.where(own, 1 / DEGREE, 1.0), every, rare))
        found.append(OtherUnit("accel-units", f"{accelerometer}{of} are in g", every, np.where(own, 1 / GRAVITY, 1.0), rare))
    found.append(OtherUnit("gyro-units", f"{gyro} were turned into radians twice", DEGREE * every, every))
    found.append(OtherUnit("gyro-units", f"{gyro} are in degrees, not radians, and {accelerometer} in g", every / DEGREE, every / GRAVITY))
    for words, factor in (("are in milli-g", 1e3 / GRAVITY), ("are in mm/s^2", 1e3)):
        found.append(OtherUnit("accel-units", f"{accelerometer} {words}", every, factor * every, TWO))
    for count in DECIMATED if increments else ():
        dropped = f"gyro and accelerometer columns hold one increment of {count}, and the others were dropped, not summed"
        found.append(OtherUnit("column-kind", dropped, every / count, every / count, TWO))
    return found + [
        # of both in one proportion the log shows nothing but what is quadratic in the rates, as of a bias
        OtherUnit("column-kind", f"{which} {held}{more}", g * every, a * every, TWO * (bool(more) or g == a))
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
    none = np.zeros((len(model.stated), 0))

    def shown(factors: Array) -> Array:
        turn: Array = model.mounting @ np.diag(factors) @ model.mounting.T
        return STRAIGHT if (factors == 1).all() else turn

    return [
        Hypothesis(one.code, (one.words,), none, gyro=shown(one.gyro), accelerometer=shown(one.accelerometer), rare=one.rare)
        for one in other_units(record_s, increments)
    ]


def mountings(model: Model) -> list[Hypothesis]:
    """The IMU turned by right angles, mirrored or transposed; either sensor of it alone."""
    none, mounting = np.zeros((len(model.stated), 0)), model.mounting
    # along the body's axes the true mounting is ``turn``; else its own axes are others; the rates were read through the stated one
    by_body = [mounting @ turn.T for turn in _signed_permutations()]
    own = [mounting @ turn @ mounting.T for turn in _signed_permutations()]
    reads = np.array([np.eye(3), mounting @ mounting, *by_body, *own])
    alike = np.abs(reads[:, None] - reads).max((2, 3)) < ROUNDING
    found = [
        Hypothesis("imu-mounting", ("the transpose of what is stated",) if i == 1 else (), none, gyro=reads[i], accelerometer=reads[i])
        for i in sorted(set(alike.argmax(1).tolist()))[1:]  # the first of its like, but for what is stated
    ]
    for read in own:
        if np.abs(read - np.eye(3)).max() > ROUNDING:
            found.append(Hypothesis("imu-mounting", ("gyro",), none, gyro=read))
            found.append(Hypothesis("imu-mounting", ("accelerometer",), none, accelerometer=read))
    return found


def imu_position(model: Model) -> Hypothesis:
    """The IMU elsewhere."""
    return _free(model, "imu")


def _in_another_unit(model: Model) -> Iterator[Hypothesis]:
    """The IMU where it is by what is stated in another unit, further off than is looked for from where it is stated."""
    place = model.place("imu")
    for unit in UNITS_M:
        away = (unit - 1) * model.imu
        if np.abs(away).max() > REACHED * PRIORS["imu"]:
            start = {place.start + i: float(part) for i, part in enumerate(away)}
            column = along(model, ("imu", away / PRIORS["imu"]))
            yield Hypothesis("imu-position", (), column, start=start)


def _others(model: Model) -> Iterator[Hypothesis]:
    yield imu_position(model)
    yield from _in_another_unit(model)
    on_bearing = ("bearing", "room_torque") * (model.bearing is not None) + ("tilt",) * (INTEGRATED in model.places)
    yield from (_free(model, name) for name in (*on_bearing, "torque", "drag"))
    if model.thrusting:  # what stores momentum uses none
        yield _free(model, "mass_rate", "inertia_rate")


@cache
def _signed_permutations() -> list[Array]:
    """The 48 ways to name and sign three axes; half of them are left-handed."""
    found: list[Array] = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            found.append(turn)
    return found
