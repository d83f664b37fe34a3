"""Other readings of a log's columns, each tested by an off-line fit.

If no hypothesis (:mod:`massprop_cli.diagnosis.hypotheses`) explains a log of rotors, a few readings are fitted: other IMU units, other
rotor units, and rotor columns in any order. A reading is named if only that one makes the log fit.

The order follows from the response to each column. Let b be the growth of the rate and a the specific force per newton, by regression. The
rotor with wrench (τ, F) about O satisfies, with inertia I, CG c, mass m and an IMU at p,

    I b + c × F = τ,        a − b × p = F / m − b × c,

which is linear in I, c and 1/m. The orders of least residual are fitted.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CERTAIN, CLEAR, EVEN, FINALISTS
from massprop_cli.base.rigidbody import cross
from massprop_cli.diagnosis import segment
from massprop_cli.diagnosis.bins import LONGEST
from massprop_cli.diagnosis.corrections import Correction, GimbalColumns, RotorColumns
from massprop_cli.diagnosis.explanation import IN_MAP, IN_VEHICLE_FILE
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.hypotheses import other_units
from massprop_cli.diagnosis.screening import CLOSE
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

ORDERS, EVERY = 4, 7
"""Number of orders that are fitted; most rotors of which every order is compared, of more only two or three exchanged."""


SPEEDS = {"in rpm": RPM, "in revolutions per second": 2 * np.pi}
COMMANDS = {"in percent": 0.01, "integers up to 255": 1 / 255, "integers up to 1000": 1e-3, "integers up to 65535": 1 / 65535}
"""Units of rotors' columns, with factors to rad/s or to commands from 0 to 1."""


class ColumnReading(NamedTuple):
    """A reading of a log's columns."""

    code: str
    words: str
    """Text that continues "the log fits if …"."""
    correction: Correction
    prior_odds: float = 0.0
    """−2 log of the prior odds against other readings."""


def reread(log: Log, vehicle: Resolved, timing: Timing, pieces: Sequence[tuple[Phase, slice]], no_matter: bool = False) -> Diagnosis | None:
    """Reading with which the log fits, and its rivals; None if no reading fits.

    It must fit better than the stated reading, or with ``no_matter`` give a body of possible density.
    """
    phase, whole = max(pieces, key=lambda one: one[1].stop - one[1].start)
    part, (cycles,) = segment.bounded(log, vehicle, timing, [whole], LONGEST)
    part_case, whole_case = (
        _Case(log_part, vehicle, timing, (phase, piece), impulses(log_part, vehicle, timing.delay, timing.lag_s(vehicle)))
        for log_part, piece in ((part, cycles), (log, whole))
    )
    stated = part_case.look(Correction(), roughly=True).cost
    rated = [(part_case.look(one.correction, roughly=True).cost + one.prior_odds, i, one) for i, one in enumerate(_readings(whole_case))]
    fitting: list[tuple[float, int, ColumnReading]] = []
    for cost, i, reading in sorted(rated)[:FINALISTS]:
        fit = whole_case.look(reading.correction) if cost < (np.inf if no_matter else stated - CLEAR) else NO_FIT
        fitting += [(fit.cost + reading.prior_odds, i, reading)] if fit.fits and not (no_matter and fit.exceeds_density) else []
    named = [reading for cost, _, reading in sorted(fitting) if cost < min(fitting)[0] + EVEN]
    if not named:
        return None
    message = f"the log fits if {', or else '.join(one.words for one in named)}"
    rivals = tuple(one.correction for one in named[1:])
    return Diagnosis((Fault(Notice(named[0].code, message), named[0].correction, rivals=rivals),))


class _ReadingFit(NamedTuple):
    """Result of a fit under one reading."""

    cost: float
    """−2 log likelihood of the measurements, with free noise levels."""
    fits: bool
    exceeds_density: bool = False


NO_FIT = _ReadingFit(np.inf, False)


class _Case(NamedTuple):
    log: Log
    vehicle: Resolved
    timing: Timing
    phase: tuple[Phase, slice]
    made: Impulses
    """Impulses of the commands, which do not depend on the IMU's reading."""

    def look(self, correction: Correction, roughly: bool = False) -> _ReadingFit:
        """Fit the log under a correction of its columns."""
        impulse = self.made if correction.rotors is None and correction.gimbals is None else None
        try:
            with np.errstate(all="ignore"):  # a wrong reading may overflow
                samples = self.timing.of(correction.log(self.log), self.vehicle, impulse)
                rough = phases.rough_fits(samples, [self.phase], self.vehicle) if roughly else None
                (fit,) = rough or phases.as_stated(samples, [self.phase], self.vehicle, Consider()).fits
        except (InputError, np.linalg.LinAlgError):
            return NO_FIT
        innovations = None if fit is None else fit.history.moments()
        if fit is None or innovations is None or not innovations.count:
            return NO_FIT
        variance = innovations.variance[~fit.history.unread]
        # Jacobian of the change of units
        sizes = [float(np.abs(np.linalg.det(np.array(one)))) for one in (correction.gyro, correction.accelerometer) if one]
        cost = float((innovations.count * np.log(variance + TINY)).sum()) - 2 * innovations.count * float(np.log(sizes).sum())
        mean_squares = [float((part**2).sum(1).mean()) for part in (samples.rate_rad_s, samples.specific_force_m_s2)]
        moving = max(np.sqrt(mean_squares) / (self.vehicle.imu.gyro_noise_rad_s, self.vehicle.imu.accel_noise_m_s2)) > CERTAIN
        fits = bool(moving and (variance < CLOSE + CERTAIN * np.sqrt(2 / innovations.count)).all())
        return _ReadingFit(cost, fits, exceeds_density(fit.history.values[-1], fit.history.sigmas[-1]))


def _readings(case: _Case) -> Iterator[ColumnReading]:
    if case.vehicle.rotors:
        yield from _other_units(case.log)
        yield from _other_orders(case)
        yield from _of_rotors(case)
    yield from _gimbals_in_degrees(case)


def _gimbals_in_degrees(case: _Case) -> Iterator[ColumnReading]:
    """All gimbal angles in degrees, or one alone."""
    spinning = case.vehicle.spinning
    names, gyros = tuple(GIMBAL.of(one.name) for one in spinning), [isinstance(one, GyroLog) for one in case.log.spinning]
    where = IN_VEHICLE_FILE if case.log.made is None else IN_MAP
    each = [np.arange(len(gyros)) == i for i in np.flatnonzero(gyros)]
    for turned in [np.array(gyros), *each] if len(each) > 1 else each:
        names_text = ", ".join(name for name, one in zip(names, turned, strict=True) if one)
        words = f"gimbal angles are in degrees, not radians ({names_text}); correct the log, or scale these columns by {DEGREE:.6g} {where}"
        yield ColumnReading("gimbal-units", words, Correction(gimbals=GimbalColumns(names, tuple(np.where(turned, DEGREE, 1.0).tolist()))))


def _of_rotors(case: _Case) -> Iterator[ColumnReading]:
    """All rotor speeds or commands in another unit, if all are of one kind."""
    kinds = {rotor.column for rotor in case.vehicle.rotors}
    if len(kinds) > 1:
        return
    (kind,), names = kinds, _columns_of(case.vehicle)
    where, order = IN_VEHICLE_FILE if case.log.made is None else IN_MAP, tuple(range(len(names)))
    for unit, factor in (SPEEDS if kind == "speed" else COMMANDS).items():
        who = f"{'speeds' if kind == 'speed' else 'commands'} of rotors are {unit} ({', '.join(names)})"
        words = f"{who}; correct the log, or scale these columns by {factor:.6g} {where}"
        correction = Correction(rotors=RotorColumns(names, order, factor))
        yield ColumnReading("speed-units" if kind == "speed" else "command-units", words, correction)


def _columns_of(vehicle: Resolved) -> tuple[str, ...]:
    """Names of the columns that drive the rotors."""
    return tuple(next(column for column in one.COLUMNS if column.key == one.column).of(one.name) for one in vehicle.rotors)


def _other_units(log: Log) -> Iterator[ColumnReading]:
    """Other units of the axes that the log has."""
    where = IN_VEHICLE_FILE if log.made is None else IN_MAP
    record_s = float(log.interval_s.mean())
    absent = ~np.array(log.axes)
    for unit in other_units(record_s, log.rate_columns == DELTA_THETA):
        if (np.append(unit.gyro, unit.accelerometer)[absent] != 1).any():
            continue
        factors = [
            tuple(map(tuple, np.diag(1 / factors_of).tolist())) if (factors_of != 1).any() else ()
            for factors_of in (unit.gyro, unit.accelerometer)
        ]
        by = " and ".join(dict.fromkeys(f"{1 / one:.6g}" for one in (*unit.gyro, *unit.accelerometer) if one != 1))
        words = f"its {unit.words}; correct the log, or scale these columns by {by} {where}"
        yield ColumnReading(unit.code, words, Correction(gyro=factors[0], accelerometer=factors[1]), unit.prior_odds)


def _other_orders(case: _Case) -> Iterator[ColumnReading]:
    """Orders of the rotors in which the responses to their columns leave the least residual."""
    vehicle = case.vehicle
    names = _columns_of(vehicle)
    answers = _responses(case)
    wrench = channel_wrench(case.log, vehicle)[: len(names)]
    orders = _orders(len(names))
    costs = _order_costs(*answers, np.array(vehicle.imu.position_m), wrench, orders)
    for at in np.argsort(costs, kind="stable")[: ORDERS + 1]:
        rotor_of = orders[at].tolist()  # column i is that of rotor does[i]
        exchanged = [i for i, rotor in enumerate(rotor_of) if rotor != i]
        if not exchanged:
            continue
        order = tuple(int(rotor_of.index(i)) for i in range(len(rotor_of)))
        text = "; ".join(f"column {names[i]} belongs to rotor {vehicle.rotors[rotor_of[i]].name}" for i in exchanged)
        words = f"{text}; swap their wires, columns or entries in the vehicle file"
        yield ColumnReading("actuators-swapped", words, Correction(rotors=RotorColumns(names, order)))


def _orders(count: int) -> Array:
    """(n, count) rotor of each column."""
    if count <= EVERY:
        return np.array(list(itertools.permutations(range(count))))
    orders = {tuple(range(count))}
    for exchanged in (*itertools.combinations(range(count), 2), *itertools.permutations(range(count), 3)):
        order = list(range(count))
        for i, j in zip(exchanged, (*exchanged[1:], exchanged[0]), strict=True):
            order[i] = j
        orders.add(tuple(order))
    return np.array(sorted(orders))


def _responses(case: _Case) -> tuple[Array, Array]:
    """(C, 6) response to each column, and its sigmas: growth of the rate, rad/s² per newton, and specific force, m/s² per newton."""
    log, vehicle, timing, (_, cycles), made = case
    samples = timing.of(log, vehicle, made)
    rate, force = samples.rate_rad_s[cycles], samples.specific_force_m_s2[cycles]
    turning = products(rate)
    rising, falling, whole = (part[cycles] for part in (made.rising, made.falling, made.whole))
    responses = []
    for motion, impulse, body_columns in (
        (np.diff(rate, axis=0), rising[:-1] + falling[1:], (turning[1:] + turning[:-1]) / 2),
        (force, whole, turning),
    ):
        regressors = np.hstack([impulse, body_columns, np.ones((len(impulse), 1))])
        size = np.maximum(np.sqrt((regressors**2).sum(0)), TINY)
        inverse = np.linalg.pinv(regressors / size, rcond=ROUNDING)
        coefficients = inverse @ motion
        spread = np.sqrt(((motion - regressors / size @ coefficients) ** 2).mean(0)) * np.sqrt((inverse**2).sum(1))[:, None]
        count = impulse.shape[1]
        responses.append(((coefficients / size[:, None])[:count], (spread / size[:, None])[:count]))
    # a mean over a cycle corresponds to an impulse over its length
    (rate_growth, rate_sigma), (force_response, force_sigma) = responses[0], (vehicle.cycle.period_s * part for part in responses[1])
    sigmas = np.maximum(np.hstack([rate_sigma, force_sigma]), TINY)
    return np.hstack([rate_growth, force_response]), np.where((np.ptp(whole, axis=0) > 0)[:, None], sigmas, np.inf)


def _order_costs(responses: Array, sigmas: Array, imu_position: Array, wrench: Array, orders: Array) -> Array:
    """(n,) residual of the columns' responses with the best body, for each order of the rotors."""
    responses, sigmas = responses[: len(wrench)], sigmas[: len(wrench)]  # without columns of stored momentum
    torque, force = wrench[:, :3][orders], wrench[:, 3:][orders]
    rate_growth, force_response = responses[:, :3], responses[:, 3:]
    count = len(orders)
    design: Array = np.zeros((count, len(responses), 6, 10))
    target: Array = np.zeros((count, len(responses), 6))
    unit = np.eye(3)
    for column, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
        design[:, :, i, column] += rate_growth[:, j]
        if i != j:
            design[:, :, j, column] += rate_growth[:, i]
    for axis in range(3):
        design[:, :, :3, 6 + axis] = cross(np.broadcast_to(unit[axis], force.shape), force)
        design[:, :, 3:, 6 + axis] = -cross(rate_growth, np.broadcast_to(unit[axis], rate_growth.shape))
    design[:, :, 3:, 9] = force
    target[:, :, :3] = torque
    target[:, :, 3:] = force_response - cross(rate_growth, np.broadcast_to(imu_position, rate_growth.shape))
    # torque sigmas from the scale of the inertia
    size = np.linalg.norm(wrench[:, :3]) / max(float(np.linalg.norm(rate_growth)), TINY)
    weight = 1 / np.hstack([sigmas[:, :3] * size, sigmas[:, 3:]])
    weighted, weighted_target = (design * weight[None, :, :, None]).reshape(count, -1, 10), (target * weight).reshape(count, -1)
    weighted = weighted / np.maximum(np.sqrt((weighted**2).sum(1, keepdims=True)), TINY)
    solution = np.linalg.pinv(weighted) @ weighted_target[..., None]
    return np.asarray(((weighted_target - (weighted @ solution)[..., 0]) ** 2).sum(1))
