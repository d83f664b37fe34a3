"""The kind and filter of an IMU's records where nobody states them, and in a log that does not fit one sensor that is later than the other.

Rates and specific force are regressed on the commands as each kernel would show them, with nothing known of the body
(:func:`massprop_cli.diagnosis.freeresponse.unexplained_by`). A kernel is taken where it explains the log better than means without a
low-pass by :data:`CLEAR` of −2 log likelihood; its cutoff is then found with its sigma, as one that is stated as "auto".
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from typing import Literal, NamedTuple

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis import delay
from massprop_cli.diagnosis.freeresponse import line_minimum, motion_of, unexplained_by
from massprop_cli.diagnosis.resolve import PHASE
from massprop_cli.errorparameters.sensor import WORDS
from massprop_cli.errorparameters.setup import stating
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.columns import DELTA_THETA, DELTA_V
from massprop_cli.inputs.equipment import LATEST_S, LowPass
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare.timing import Timing

CLEAR, LIKELY = 12.0, 4.0
"""−2 log likelihood beyond which a kernel is none by chance: of some forty, much alike, one log in a hundred has it. And beyond which
one sensor differs from the other's clear low-pass: they are mostly in one chip."""
UNUSUAL = 10.0
"""−2 log of the prior odds of means behind a low-pass against samples behind one."""
CUTOFFS_HZ = (220.0, 150.0, 105.0, 75.0, 53.0, 38.0, 27.0, 19.0, 13.0, 9.5)
BEGUN_HZ = CUTOFFS_HZ[1::3]
"""Those that are tried first."""
Order = Literal[0, 1, 2]
LOW_PASSES: tuple[Order, ...] = (1, 2)
SHIFTS = (-2.0, -1.0, 1.0, 2.0)
"""Sigmas of a phase that is not stated, by which means or samples without a low-pass may be early or late."""
LATER, FINEST = (-2.0, -1.0, 0.0, 1.0, 2.0), 1 / 256
"""Cycles by which one sensor may be later than the commands and the other sensor, and the step at which the search for it ends."""
NEAR = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Cycles by which commands may be later than the delay that explains most for a kernel of another kind."""
LONGEST, FEW = 4800, 1200
"""Cycles that are looked at; for which of both sensors is later."""


class _Kernel(NamedTuple):
    sampled: bool
    order: Order = 0
    cutoff_hz: float = 0.0
    later: float = 0.0
    """Cycles of latency, where order is 0."""

    def low_pass(self, vehicle: Vehicle) -> LowPass:
        """As a vehicle file states it."""
        return LowPass(order=self.order, cutoff_hz=self.cutoff_hz or None, latency_s=self.later * vehicle.cycle.period_s)


class KernelsFound(NamedTuple):
    """A log and its vehicle file, as the kernels are that the log shows."""

    log: Log
    """With a notice of them."""
    source: VehicleSource
    """With cutoffs that are still to be found."""
    nearest: VehicleSource
    """With about the most likely ones, between those that were tried."""
    apart: bool = False
    """Whether one sensor is later than the other."""


def found(log: Log, source: VehicleSource, say: Progress, unfit: bool = False) -> KernelsFound:
    """Log and vehicle file with what the log shows of kernels that are not stated.

    Of increments, which are what they are, low-passes alone, and where the log is ``unfit`` without any. In such a log one sensor may be
    later than the other, too.
    """
    vehicle, as_stated = source.vehicle, KernelsFound(log, source, source)
    rates = log.rate_columns != DELTA_THETA and log.force_columns != DELTA_V
    unstated = [sensor for sensor in delay.SENSORS if f"{sensor}_filter" not in vehicle.imu.model_fields_set]
    open_kind = not unfit and "measures" not in vehicle.imu.model_fields_set and log.made is None and not any(log.sampled)
    lagged = vehicle.imu.gyro_lag_s > 0 or vehicle.imu.accel_lag_s > 0
    if not (rates or unfit) or len(unstated) < len(delay.SENSORS) or lagged or vehicle.estimator.method != "default":
        return as_stated
    say("finding what the IMU records", 0.0)
    tried = _Tried.of(log, vehicle)
    costs = _costs(tried, (False, True) if open_kind else (any(log.sampled),), LOW_PASSES if rates != unfit else ())
    best = _best(costs, tried.later(any(log.sampled)) if unfit else {}) if costs else None
    if best is None or (best[0].later and best[1].later):
        return as_stated
    filters = {f"{sensor}_filter": one for sensor, one in zip(delay.SENSORS, best, strict=True) if one.order or one.later}
    sampled = best[0].sampled
    kind: dict[str, object] = {"measures": "sample"} if sampled and open_kind else {}
    if not (filters or kind):
        return as_stated
    sought, nearest = (
        replace(source, vehicle=vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=kind | own)}))
        for own in (
            {key: LowPass(order=one.order, **{"cutoff_hz" if one.order else "latency_s": "auto"}) for key, one in filters.items()},
            {key: _likeliest(costs, key, one).low_pass(vehicle) for key, one in filters.items()},
        )
    )
    log = replace(log, sampled=(sampled, sampled), notices=(*log.notices, _notice(best, sampled and open_kind)))
    return KernelsFound(log, sought, nearest, any(one.later for one in best))


def _likeliest(costs: Mapping[_Kernel, tuple[float, float]], key: str, best: _Kernel) -> _Kernel:
    """With the cutoff by a parabola through the costs of the best of :data:`CUTOFFS_HZ` and of those beside it."""
    sensor, at = delay.SENSORS.index(key.removesuffix("_filter")), CUTOFFS_HZ.index(best.cutoff_hz) if best.order else 0
    if not 0 < at < len(CUTOFFS_HZ) - 1:
        return best
    near = CUTOFFS_HZ[at - 1 : at + 2]
    bent, slope, _ = np.polyfit(np.log(near), [costs[best._replace(cutoff_hz=cutoff)][sensor] for cutoff in near], 2)
    return best._replace(cutoff_hz=float(np.exp(np.clip(-slope / (2 * bent), *np.log([near[-1], near[0]]))))) if bent > 0 else best


def without(source: VehicleSource) -> VehicleSource:
    """The vehicle file with no low-pass, stated so."""
    return replace(source, vehicle=stating(source.vehicle, {f"imu.{sensor}_filter": None for sensor in delay.SENSORS}))


def _begun(log: Log, cycles: int) -> Log:
    """Its first cycles; all of it where momentum by its torque follows from all that went before."""
    return log if any(one.integrated for one in log.spinning) else log.part(0, min(log.cycles, cycles))


class _Tried(NamedTuple):
    """A part of a log, and by which timing its motion is regressed on its commands."""

    log: Log
    vehicle: Vehicle
    at: Timing
    first: int
    """Cycle from which on commands are known, whatever delays them."""

    @staticmethod
    def of(log: Log, vehicle: Vehicle) -> _Tried:
        """With the delay that explains most where none is stated."""
        part = _begun(log, LONGEST)
        stated = vehicle.cycle.command_delay_cycles
        lag = 0.0 if vehicle.thrust.lag_s == "auto" else vehicle.thrust.lag_s / vehicle.cycle.period_s
        at = Timing(0.0, lag) if stated == "auto" else Timing(stated, lag)
        if stated == "auto":
            at = next((rated.at for rated in delay.search(part, vehicle, [lag])), at)
        first = int(np.ceil(at.delay + 2)) + 5 * int(np.ceil(lag + 1 / (2 * np.pi * CUTOFFS_HZ[-1] * vehicle.cycle.period_s)))
        # of the bins within a cycle nothing is asked
        return _Tried(part, stating(vehicle, {"estimator.bins_per_cycle": 2}), at, first)

    def cost(self, sampled: bool, low_passes: Mapping[str, LowPass | None], shift: float = 0.0) -> tuple[float, float]:
        """−2 log likelihood of gyro and accelerometer; ``shift``, cycles: by which commands come later."""
        timing = self.at._replace(delay=max(self.at.delay + shift, 0.0))
        vehicle = stating(self.vehicle, {f"imu.{sensor}_filter": one for sensor, one in low_passes.items()})
        return unexplained_by(replace(self.log, sampled=(sampled, sampled)), vehicle, timing, self.first)

    def bare_shift(self, sampled: bool) -> float:
        """Cycles by which commands come later if sensors have no low-pass, which would make up for a delay that is still to be found."""
        if self.vehicle.cycle.command_delay_cycles != "auto":
            return 0.0
        short = self._replace(log=_begun(self.log, FEW))
        return line_minimum(lambda shift: sum(short.cost(sampled, {}, shift)), NEAR, NEAR[-1] / 2, FINEST)

    def later(self, sampled: bool) -> dict[tuple[_Kernel, _Kernel], float]:
        """−2 log likelihood where either sensor is later than the other by what explains most, or the commands are later for both.

        With the price of the former: where one sensor tells little the two leave as much, and a wrong delay is the more likely.
        In free flight commands that come later for one sensor say as much; on a bearing gravity turns between the two, too.
        """
        short, bare = self._replace(log=_begun(self.log, FEW)), _Kernel(sampled)
        log = replace(short.log, sampled=(sampled, sampled))
        motion = motion_of(self.at.of(log, self.vehicle))

        @cache
        def costs(later: float) -> tuple[float, float]:
            with suppress(InputError):
                if self.at.delay + later >= 0:
                    return unexplained_by(log, self.vehicle, self.at._replace(delay=self.at.delay + later), self.first, motion)
            return np.inf, np.inf

        def cost(later: float, shown: tuple[bool, bool]) -> float:
            if abs(later) * self.vehicle.cycle.period_s > LATEST_S:
                return np.inf
            if all(shown) or not self.vehicle.pivoted:
                return costs(later * shown[0])[0] + costs(later * shown[1])[1]
            with suppress(InputError):
                low_pass = bare._replace(later=later).low_pass(self.vehicle)
                return sum(short.cost(sampled, dict.fromkeys(itertools.compress(delay.SENSORS, shown), low_pass)))
            return np.inf

        found = dict[tuple[_Kernel, _Kernel], float]()
        for shown in ((True, False), (False, True), (True, True)):
            own = partial(cost, shown=shown)
            by = line_minimum(own, LATER, LATER[-1] / 2, FINEST)
            gyro, accelerometer = (bare._replace(later=by * one) for one in shown)
            found[(gyro, accelerometer)] = own(by) + (0.0 if all(shown) else CLEAR)
        return found


def _costs(tried: _Tried, kinds: tuple[bool, ...], orders: tuple[Order, ...]) -> dict[_Kernel, tuple[float, float]]:
    """−2 log likelihood of gyro and accelerometer by each kernel that is tried; none where the log is too short."""
    phase, costs = PHASE * float(np.mean(tried.log.interval_s)) / tried.vehicle.cycle.period_s, dict[_Kernel, tuple[float, float]]()

    def add(one: _Kernel) -> None:
        low_passes = dict.fromkeys(delay.SENSORS, one.low_pass(tried.vehicle) if one.order else None)
        likeliest, around = (0.0, ()) if one.order else (tried.bare_shift(one.sampled), SHIFTS)
        shifts = dict.fromkeys([0.0, likeliest, *(likeliest + by * phase for by in around)])
        each = [tried.cost(one.sampled, low_passes, shift) for shift in shifts]
        costs[one] = min(gyro for gyro, _ in each), min(accelerometer for _, accelerometer in each)

    try:
        for kind in kinds:
            add(_Kernel(kind))
        for kind, order in itertools.product(kinds, orders):
            due = {_Kernel(kind, order, cutoff) for cutoff in BEGUN_HZ}
            while due:
                for one in due:
                    add(one)
                due = _beside_the_best(costs, kind, order)
    except InputError:
        return {}
    return costs


def _beside_the_best(costs: Mapping[_Kernel, tuple[float, float]], kind: bool, order: int) -> set[_Kernel]:
    """What is still to be tried: cutoffs on both sides of the one that leaves least of either sensor, where it is less than with none."""
    own = [one for one in costs if (one.sampled, one.order) == (kind, order)]
    found = set[_Kernel]()
    for sensor in range(len(delay.SENSORS)):
        best = min(own, key=lambda one: costs[one][sensor])
        if costs[best][sensor] < costs[_Kernel(kind)][sensor]:
            at = CUTOFFS_HZ.index(best.cutoff_hz)
            found |= {best._replace(cutoff_hz=cutoff) for cutoff in CUTOFFS_HZ[max(at - 1, 0) : at + 2]}
    return found - costs.keys()


def _best(costs: Mapping[_Kernel, tuple[float, float]], others: Mapping[tuple[_Kernel, _Kernel], float]) -> tuple[_Kernel, _Kernel] | None:
    """Of gyro and accelerometer, both sampled or neither, or of ``others``; None where what is stated does as well."""
    plain = next(iter(costs))

    def least(sensor: int, sampled: bool, other: _Kernel | None = None) -> _Kernel:
        own = {one: both[sensor] for one, both in costs.items() if one.sampled == sampled}
        bare, best = next(one for one in own if one.order == 0), min(own, key=lambda one: own[one])
        if own[best] < own[bare] - (CLEAR if other is None else LIKELY):
            return best
        return other if other is not None and own[other] < own[bare] + LIKELY else bare

    pairs = []
    for kind in {one.sampled for one in costs}:
        pair = least(0, kind), least(1, kind)
        clear = next((one for one in pair if one.order), None)
        pairs.append(pair if clear is None else (least(0, kind, clear), least(1, kind, clear)))
    total = {(gyro, accelerometer): costs[gyro][0] + costs[accelerometer][1] for gyro, accelerometer in pairs}
    for gyro, accelerometer in total:
        if not gyro.sampled and (gyro.order or accelerometer.order):  # sensors that average hardly have a low-pass before
            total[gyro, accelerometer] += UNUSUAL
    total.update(others)
    best = min(total, key=lambda pair: total[pair])
    return best if total[best] < sum(costs[plain]) - CLEAR else None


def _notice(best: tuple[_Kernel, _Kernel], sampled: bool) -> Notice:
    late = next(((sensor, one) for sensor, one in zip(delay.SENSORS, best, strict=True) if one.later), None)
    if late is not None:
        sensor, one = late
        order = "later" if one.later > 0 else "earlier"
        return Notice(
            "imu-kernel",
            f"the log fits if the {WORDS[sensor]}'s records are {order} than their times and the other sensor's: by a latency that was "
            f"estimated and used. Look at how records are buffered and stamped, or state imu.{sensor}_filter with order = 0 and latency_s",
        )
    orders = {0: "behind no low-pass", 1: "behind a low-pass of first order", 2: "behind a low-pass of second order"}
    kind = "samples at their times" if best[0].sampled else "means over their intervals"
    words = [f"the {WORDS[sensor]}'s are {orders[one.order]}" for sensor, one in zip(delay.SENSORS, best, strict=True)]
    keys = [
        *(["imu.measures"] if sampled else []),
        *(f"imu.{sensor}_filter" for sensor, one in zip(delay.SENSORS, best, strict=True) if one.order),
    ]
    return Notice(
        "imu-kernel",
        f"{' and '.join(keys)} {'are' if len(keys) > 1 else 'is'} not stated; of what the IMU's records may be, this log is most likely "
        f"under {kind}, {words[0]}, {words[1]}. It was read so, and cutoffs were estimated; state them if the data sheet does",
    )
