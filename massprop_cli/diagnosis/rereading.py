"""Other ways to read a log's columns, each tested by an off-line fit of its own.

Where no hypothesis (:mod:`massprop_cli.diagnosis.hypotheses`) explains the log of rotors, each of a few readings is fitted as the log
is estimated: the IMU in other units, and rotors that have one another's columns in any order. A reading is named where the log fits under
it alone.

Which rotor a column is, its own answer tells. With growth b of the rate and a of the specific force per newton, of regressions on all
columns, the rotor of wrench (τ, F) about O has, with inertia I, CG c, mass m and an IMU at p,

    I b + c × F = τ,        a − b × p = F / m − b × c,

which is linear in I, c and 1/m: of all orders of the rotors those are fitted that leave least.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import cross
from massprop_cli.diagnosis import segment
from massprop_cli.diagnosis.corrections import Correction, GimbalColumns, RotorColumns
from massprop_cli.diagnosis.explanation import EVEN, IN_MAP, IN_VEHICLE_FILE
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypotheses import other_units
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.errorparameters.sensor import DEGREE
from massprop_cli.errorparameters.thrust import RPM
from massprop_cli.estimate import phases
from massprop_cli.estimate.known import exceeds_density
from massprop_cli.inputs.actuators.control_moment_gyro import GIMBAL, GyroLog
from massprop_cli.inputs.columns import DELTA_THETA
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.actuators import channel_wrench
from massprop_cli.prepare.align import Impulses, impulses
from massprop_cli.prepare.timing import Timing

FITS, CHANCE = 1.5, 6.0
"""Mean square of normalised innovations up to which a channel fits, and sigmas of chance more."""
MOVED = 5.0
"""Times its noise, what a sensor must show of a motion: anything fits readings that are smaller."""
FINALISTS = 3
"""How many are fitted until they stand."""
LONGEST = 400
"""Cycles that readings are fitted to."""
ORDERS, EVERY = 4, 7
"""Orders of rotors that are fitted; rotors up to which every order is compared, of more only two or three that are exchanged."""


SPEEDS = {"in rpm": RPM, "in revolutions a second": 2 * np.pi}
COMMANDS = {"in percent": 0.01, "counted to 255": 1 / 255, "counted to 1000": 1e-3, "counted to 65535": 1 / 65535}
"""Units of rotors' columns, and their factors to rad/s, or to commands from 0 to 1."""


class ColumnReading(NamedTuple):
    """How a log may have to be read."""

    code: str
    words: str
    """Go on "the log fits if …"."""
    correction: Correction
    rare: float = 0.0
    """−2 log of its odds against others."""


def reread(log: Log, vehicle: Resolved, timing: Timing, pieces: Sequence[tuple[Phase, slice]], no_matter: bool = False) -> Diagnosis | None:
    """The reading with which the log fits, beside those that are nearly as likely; None where it fits with none.

    It must fit better than as stated, or be of a body of matter where that is of ``no_matter``.
    """
    phase, whole = max(pieces, key=lambda one: one[1].stop - one[1].start)
    part, (cycles,) = segment.bounded(log, vehicle, timing, [whole], LONGEST)
    some, case = (
        _Case(own, vehicle, timing, (phase, piece), impulses(own, vehicle, timing.delay, timing.lag_s(vehicle)))
        for own, piece in ((part, cycles), (log, whole))
    )
    stated = some.look(Correction(), roughly=True).cost
    each = [(some.look(one.correction, roughly=True).cost + one.rare, i, one) for i, one in enumerate(_readings(case))]
    likely: list[tuple[float, int, ColumnReading]] = []
    for cost, i, reading in sorted(each)[:FINALISTS]:
        look = case.look(reading.correction) if cost < (np.inf if no_matter else stated - CLEAR) else NOTHING
        likely += [(look.cost + reading.rare, i, reading)] if look.fits and not (no_matter and look.no_matter) else []
    near = [reading for cost, _, reading in sorted(likely) if cost < min(likely)[0] + EVEN]
    if not near:
        return None
    message = f"the log fits if {', or else '.join(one.words for one in near)}"
    rivals = tuple(one.correction for one in near[1:])
    return Diagnosis((Fault(Notice(near[0].code, message), near[0].correction, rivals=rivals),))


class _Look(NamedTuple):
    cost: float
    """−2 log likelihood of free noise levels, of what was measured."""
    fits: bool
    no_matter: bool = False


NOTHING = _Look(np.inf, False)


class _Case(NamedTuple):
    log: Log
    vehicle: Resolved
    timing: Timing
    phase: tuple[Phase, slice]
    made: Impulses
    """What the commands do, however the IMU is read."""

    def look(self, correction: Correction, roughly: bool = False) -> _Look:
        """What a fit leaves of the log as it is read then."""
        made = self.made if correction.rotors is None and correction.gimbals is None else None
        try:
            with np.errstate(all="ignore"):  # of a reading that is far off numbers run away
                samples = self.timing.of(correction.log(self.log), self.vehicle, made)
                few = phases.rough_fits(samples, [self.phase], self.vehicle) if roughly else None
                (fit,) = few or phases.as_stated(samples, [self.phase], self.vehicle, Consider()).fits
        except (InputError, np.linalg.LinAlgError):
            return NOTHING
        left = None if fit is None else fit.history.moments()
        if fit is None or left is None or not left.count:
            return NOTHING
        variance = left.variance[~fit.history.unread]
        # as densely as what was measured lies
        sizes = [float(np.abs(np.linalg.det(np.array(one)))) for one in (correction.gyro, correction.accelerometer) if one]
        cost = float((left.count * np.log(variance + TINY)).sum()) - 2 * left.count * float(np.log(sizes).sum())
        shown = [float((part**2).sum(1).mean()) for part in (samples.rate_rad_s, samples.specific_force_m_s2)]
        moved = max(np.sqrt(shown) / (self.vehicle.imu.gyro_noise_rad_s, self.vehicle.imu.accel_noise_m_s2)) > MOVED
        fits = bool(moved and (variance < FITS + CHANCE * np.sqrt(2 / left.count)).all())
        return _Look(cost, fits, exceeds_density(fit.history.values[-1], fit.history.sigmas[-1]))


def _readings(case: _Case) -> Iterator[ColumnReading]:
    if case.vehicle.rotors:
        yield from _other_units(case.log)
        yield from _other_orders(case)
        yield from _of_rotors(case)
    yield from _gimbals_in_degrees(case)


def _gimbals_in_degrees(case: _Case) -> Iterator[ColumnReading]:
    """All angles, or one alone."""
    spinning = case.vehicle.spinning
    names, gyros = tuple(GIMBAL.of(one.name) for one in spinning), [isinstance(one, GyroLog) for one in case.log.spinning]
    where = IN_VEHICLE_FILE if case.log.made is None else IN_MAP
    each = [np.arange(len(gyros)) == i for i in np.flatnonzero(gyros)]
    for own in [np.array(gyros), *each] if len(each) > 1 else each:
        said = ", ".join(name for name, one in zip(names, own, strict=True) if one)
        words = f"gimbal angles are in degrees, not radians ({said}); correct the log, or scale the columns {where} ({DEGREE:.6g})"
        yield ColumnReading("gimbal-units", words, Correction(gimbals=GimbalColumns(names, tuple(np.where(own, DEGREE, 1.0).tolist()))))


def _of_rotors(case: _Case) -> Iterator[ColumnReading]:
    """All speeds or commands of rotors in another unit, where all are of one kind."""
    kinds = {rotor.column for rotor in case.vehicle.rotors}
    if len(kinds) > 1:
        return
    (kind,), names = kinds, _columns_of(case.vehicle)
    where, same = IN_VEHICLE_FILE if case.log.made is None else IN_MAP, tuple(range(len(names)))
    for unit, factor in (SPEEDS if kind == "speed" else COMMANDS).items():
        who = f"{'speeds' if kind == 'speed' else 'commands'} of rotors are {unit} ({', '.join(names)})"
        words = f"{who}; correct the log, or scale the columns {where} ({factor:.6g})"
        correction = Correction(rotors=RotorColumns(names, same, factor))
        yield ColumnReading("speed-units" if kind == "speed" else "command-units", words, correction)


def _columns_of(vehicle: Resolved) -> tuple[str, ...]:
    """Names of the rotors' columns, of each the one that tells what it does."""
    return tuple(next(column for column in one.COLUMNS if column.key == one.column).of(one.name) for one in vehicle.rotors)


def _other_units(log: Log) -> Iterator[ColumnReading]:
    """Other units of axes that the log has."""
    where = IN_VEHICLE_FILE if log.made is None else IN_MAP
    record_s = float(log.interval_s.mean())
    absent = ~np.array(log.axes)
    for unit in other_units(record_s, log.rate_columns == DELTA_THETA):
        if (np.append(unit.gyro, unit.accelerometer)[absent] != 1).any():
            continue
        factors = [tuple(map(tuple, np.diag(1 / own).tolist())) if (own != 1).any() else () for own in (unit.gyro, unit.accelerometer)]
        by = " and ".join(dict.fromkeys(f"{1 / one:.6g}" for one in (*unit.gyro, *unit.accelerometer) if one != 1))
        words = f"its {unit.words}; correct the log, or scale its columns {where} ({by})"
        yield ColumnReading(unit.code, words, Correction(gyro=factors[0], accelerometer=factors[1]), unit.rare)


def _other_orders(case: _Case) -> Iterator[ColumnReading]:
    """Orders of the rotors in which their columns' own answers leave least."""
    vehicle = case.vehicle
    names = _columns_of(vehicle)
    answers = _answers(case)
    wrench = channel_wrench(case.log, vehicle)[: len(names)]
    orders = _orders(len(names))
    costs = _left(*answers, np.array(vehicle.imu.position_m), wrench, orders)
    for at in np.argsort(costs, kind="stable")[: ORDERS + 1]:
        does = orders[at].tolist()  # column i is that of rotor does[i]
        moved = [i for i, own in enumerate(does) if own != i]
        if not moved:
            continue
        order = tuple(int(does.index(i)) for i in range(len(does)))
        said = "; ".join(f"column {names[i]} belongs to rotor {vehicle.rotors[does[i]].name}" for i in moved)
        yield ColumnReading("actuators-swapped", f"{said}; swap wires, columns or entries", Correction(rotors=RotorColumns(names, order)))


def _orders(count: int) -> Array:
    """(n, count) which rotor each column is."""
    if count <= EVERY:
        return np.array(list(itertools.permutations(range(count))))
    found = {tuple(range(count))}
    for some in (*itertools.combinations(range(count), 2), *itertools.permutations(range(count), 3)):
        order = list(range(count))
        for i, j in zip(some, (*some[1:], some[0]), strict=True):
            order[i] = j
        found.add(tuple(order))
    return np.array(sorted(found))


def _answers(case: _Case) -> tuple[Array, Array]:
    """(C, 6) of each column: growth of the rate, rad/s² per newton, and specific force at the IMU, m/s² per newton; and their sigmas."""
    log, vehicle, timing, (_, cycles), made = case
    samples = timing.of(log, vehicle, made)
    rate, force = samples.rate_rad_s[cycles], samples.specific_force_m_s2[cycles]
    turned = products(rate)
    rising, falling, whole = (part[cycles] for part in (made.rising, made.falling, made.whole))
    both = []
    for moved, by, more in (
        (np.diff(rate, axis=0), rising[:-1] + falling[1:], (turned[1:] + turned[:-1]) / 2),
        (force, whole, turned),
    ):
        causes = np.hstack([by, more, np.ones((len(by), 1))])
        size = np.maximum(np.sqrt((causes**2).sum(0)), TINY)
        inverse = np.linalg.pinv(causes / size, rcond=ROUNDING)
        solved = inverse @ moved
        spread = np.sqrt(((moved - causes / size @ solved) ** 2).mean(0)) * np.sqrt((inverse**2).sum(1))[:, None]
        count = by.shape[1]
        both.append(((solved / size[:, None])[:count], (spread / size[:, None])[:count]))
    # a mean over a cycle goes with an impulse over its length
    (grown, grown_sigma), (felt, felt_sigma) = both[0], (vehicle.cycle.period_s * part for part in both[1])
    sigmas = np.maximum(np.hstack([grown_sigma, felt_sigma]), TINY)
    return np.hstack([grown, felt]), np.where((np.ptp(whole, axis=0) > 0)[:, None], sigmas, np.inf)


def _left(answers: Array, sigmas: Array, place: Array, wrench: Array, orders: Array) -> Array:
    """(n,) what of the columns' answers a body leaves that each order of the rotors goes with."""
    answers, sigmas = answers[: len(wrench)], sigmas[: len(wrench)]  # the columns after thrust are those of stored momentum
    torque, force = wrench[:, :3][orders], wrench[:, 3:][orders]
    grown, felt = answers[:, :3], answers[:, 3:]
    count = len(orders)
    design: Array = np.zeros((count, len(answers), 6, 10))
    wanted: Array = np.zeros((count, len(answers), 6))
    unit = np.eye(3)
    for column, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
        design[:, :, i, column] += grown[:, j]
        if i != j:
            design[:, :, j, column] += grown[:, i]
    for axis in range(3):
        design[:, :, :3, 6 + axis] = cross(np.broadcast_to(unit[axis], force.shape), force)
        design[:, :, 3:, 6 + axis] = -cross(grown, np.broadcast_to(unit[axis], grown.shape))
    design[:, :, 3:, 9] = force
    wanted[:, :, :3] = torque
    wanted[:, :, 3:] = felt - cross(grown, np.broadcast_to(place, grown.shape))
    # sigmas of torques by the size that inertia has
    size = np.linalg.norm(wrench[:, :3]) / max(float(np.linalg.norm(grown)), TINY)
    weight = 1 / np.hstack([sigmas[:, :3] * size, sigmas[:, 3:]])
    weighed, aim = (design * weight[None, :, :, None]).reshape(count, -1, 10), (wanted * weight).reshape(count, -1)
    weighed = weighed / np.maximum(np.sqrt((weighed**2).sum(1, keepdims=True)), TINY)
    solved = np.linalg.pinv(weighed) @ aim[..., None]
    return np.asarray(((aim - (weighed @ solved)[..., 0]) ** 2).sum(1))
