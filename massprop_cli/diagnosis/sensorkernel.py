"""Kind and low-pass of an IMU's records if not stated; in a log that does not fit, also a latency of one sensor.

Each kernel has a free-response cost (:func:`massprop_cli.diagnosis.freeresponse.log_costs`). It is used if it beats means without a
low-pass by :data:`CLEAR` of −2 log likelihood. Its cutoff is then estimated with its sigma, like one stated as "auto".
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from typing import Literal, NamedTuple

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import LONG, SHORT, UNUSUAL
from massprop_cli.diagnosis import delay
from massprop_cli.diagnosis.freeresponse import line_minimum, log_costs, motion_of
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
"""−2 log likelihood ratio of a significant kernel: among some forty similar ones, one log in a hundred exceeds it by chance. And that for a
sensor to differ from the other's clear low-pass, since both are mostly in one chip."""
CUTOFFS_HZ = (220.0, 150.0, 105.0, 75.0, 53.0, 38.0, 27.0, 19.0, 13.0, 9.5)
BEGUN_HZ = CUTOFFS_HZ[1::3]
"""Cutoffs that are tested first, Hz."""
PASSES = 2
"""Parabolas by which each sensor's best cutoff is refined. Between two of the above, −2 log likelihood is off by tens."""
Order = Literal[0, 1, 2]
LOW_PASSES: tuple[Order, ...] = (1, 2)
SHIFTS = (-2.0, -1.0, 1.0, 2.0)
"""Sigmas of an unstated phase by which means or samples without a low-pass may be early or late."""
LATER, FINEST = (-2.0, -1.0, 0.0, 1.0, 2.0), 1 / 256
"""Latencies of one sensor that are searched, cycles; last step of the search."""
NEAR = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Changes of the delay that are searched for kernels of another kind, cycles."""


class _Kernel(NamedTuple):
    sampled: bool
    order: Order = 0
    cutoff_hz: float = 0.0
    later: float = 0.0
    """Latency, cycles, if order is 0."""

    def low_pass(self, vehicle: Vehicle) -> LowPass:
        """Low-pass as a vehicle file states it."""
        return LowPass(order=self.order, cutoff_hz=self.cutoff_hz or None, latency_s=self.later * vehicle.cycle.period_s)


class KernelsFound(NamedTuple):
    """Log and vehicle file with the kernels that the log shows."""

    log: Log
    """Log with a notice."""
    source: VehicleSource
    """Vehicle file with open cutoffs."""
    nearest: VehicleSource
    """Vehicle file with approximate cutoffs."""
    apart: bool = False
    """Whether one sensor is later than the other."""


def found(log: Log, source: VehicleSource, say: Progress, unfit: bool = False) -> KernelsFound:
    """Log and vehicle file with kernels that are not stated but significant in the log.

    Increments are means by definition: only low-passes are searched, and only if the log is ``unfit`` without. If it is known what a record
    is, one sensor may also be later than the other.
    """
    vehicle, as_stated = source.vehicle, KernelsFound(log, source, source)
    rates = log.rate_columns != DELTA_THETA and log.force_columns != DELTA_V
    unstated = [sensor for sensor in delay.SENSORS if f"{sensor}_filter" not in vehicle.imu.model_fields_set]
    kind_open = not unfit and "measures" not in vehicle.imu.model_fields_set and log.made is None and not any(log.sampled)
    lagged = vehicle.imu.gyro_lag_s > 0 or vehicle.imu.accel_lag_s > 0
    if not (rates or unfit) or len(unstated) < len(delay.SENSORS) or lagged or vehicle.estimator.method != "default":
        return as_stated
    say("finding what the IMU records", 0.0)
    regression = _CommandRegression.of(log, vehicle)
    costs = _costs(regression, (False, True) if kind_open else (any(log.sampled),), LOW_PASSES if rates != unfit else ())
    best = _best(costs, {} if kind_open else regression.later(any(log.sampled))) if costs else None
    if best is None or (best[0].later and best[1].later):
        return as_stated
    filters = {f"{sensor}_filter": one for sensor, one in zip(delay.SENSORS, best, strict=True) if one.order or one.later}
    sampled = best[0].sampled
    kind: dict[str, object] = {"measures": "sample"} if sampled and kind_open else {}
    if not (filters or kind):
        return as_stated
    with_open, nearest = (
        replace(source, vehicle=vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update=kind | low_passes_of)}))
        for low_passes_of in (
            {key: LowPass(order=one.order, **{"cutoff_hz" if one.order else "latency_s": "auto"}) for key, one in filters.items()},
            {key: one.low_pass(vehicle) for key, one in filters.items()},
        )
    )
    log = replace(log, sampled=(sampled, sampled), notices=(*log.notices, _notice(best, sampled and kind_open)))
    return KernelsFound(log, with_open, nearest, any(one.later for one in best))


def without(source: VehicleSource) -> VehicleSource:
    """Vehicle file that states no low-pass."""
    return replace(source, vehicle=stating(source.vehicle, {f"imu.{sensor}_filter": None for sensor in delay.SENSORS}))


def _first_cycles(log: Log, cycles: int) -> Log:
    """First cycles of a log; all of it if momentum is integrated from its start."""
    return log if any(one.integrated for one in log.spinning) else log.part(0, min(log.cycles, cycles))


class _CommandRegression(NamedTuple):
    """A part of a log, and the timing of its regression on the commands."""

    log: Log
    vehicle: Vehicle
    at: Timing
    first: int
    """First cycle whose commands are known under any delay."""

    @staticmethod
    def of(log: Log, vehicle: Vehicle) -> _CommandRegression:
        """Regression with the stated delay, or that of least cost."""
        part = _first_cycles(log, LONG)
        stated = vehicle.cycle.command_delay_cycles
        lag = 0.0 if vehicle.thrust.lag_s == "auto" else vehicle.thrust.lag_s / vehicle.cycle.period_s
        at = Timing(0.0, lag) if stated == "auto" else Timing(stated, lag)
        if stated == "auto":
            at = next((rated.at for rated in delay.search(part, vehicle, [lag])), at)
        first = int(np.ceil(at.delay + 2)) + 5 * int(np.ceil(lag + 1 / (2 * np.pi * CUTOFFS_HZ[-1] * vehicle.cycle.period_s)))
        # intra-cycle bins are not used
        return _CommandRegression(part, stating(vehicle, {"estimator.bins_per_cycle": 2}), at, first)

    def cost(self, sampled: bool, low_passes: Mapping[str, LowPass | None], shift: float = 0.0) -> tuple[float, float]:
        """−2 log likelihood of gyro and accelerometer, with the delay changed by ``shift`` cycles."""
        timing = self.at._replace(delay=max(self.at.delay + shift, 0.0))
        vehicle = stating(self.vehicle, {f"imu.{sensor}_filter": one for sensor, one in low_passes.items()})
        return log_costs(replace(self.log, sampled=(sampled, sampled)), vehicle, timing, self.first)

    def bare_shift(self, sampled: bool) -> float:
        """Change of an open delay of least cost without low-passes, cycles; it compensates a missing low-pass."""
        if self.vehicle.cycle.command_delay_cycles != "auto":
            return 0.0
        short = self._replace(log=_first_cycles(self.log, SHORT))
        return line_minimum(lambda shift: sum(short.cost(sampled, {}, shift)), NEAR, NEAR[-1] / 2, FINEST)

    def later(self, sampled: bool) -> dict[tuple[_Kernel, _Kernel], float]:
        """−2 log likelihood with the best latency of one sensor, or of both, which is a delay.

        One sensor alone has a penalty, since both costs are similar if one sensor gives little information. In free flight, commands later
        for one sensor are equivalent. On a bearing gravity turns between the two sensors, too.
        """
        bare = _Kernel(sampled)
        short, whole = self._replace(log=_first_cycles(self.log, SHORT))._later_cost(sampled), self._later_cost(sampled)
        costs_of_pairs = dict[tuple[_Kernel, _Kernel], float]()
        for shown in ((True, False), (False, True), (True, True)):
            latency = line_minimum(partial(short, shown=shown), LATER, LATER[-1] / 2, FINEST)
            gyro, accelerometer = (bare._replace(later=latency * one) for one in shown)
            costs_of_pairs[(gyro, accelerometer)] = whole(latency, shown=shown) + (0.0 if all(shown) else CLEAR)
        return costs_of_pairs

    def _later_cost(self, sampled: bool) -> Callable[..., float]:
        """−2 log likelihood of both sensors, as a function of a latency, cycles, and of which sensors have it: ``shown``."""
        log = replace(self.log, sampled=(sampled, sampled))
        motion = motion_of(self.at.of(log, self.vehicle))

        @cache
        def costs(later: float) -> tuple[float, float]:
            with suppress(InputError):
                if self.at.delay + later >= 0:
                    return log_costs(log, self.vehicle, self.at._replace(delay=self.at.delay + later), self.first, motion)
            return np.inf, np.inf

        def cost(later: float, shown: tuple[bool, bool]) -> float:
            if abs(later) * self.vehicle.cycle.period_s > LATEST_S:
                return np.inf
            if all(shown) or not self.vehicle.pivoted:
                return costs(later * shown[0])[0] + costs(later * shown[1])[1]
            with suppress(InputError):
                low_pass = _Kernel(sampled, later=later).low_pass(self.vehicle)
                return sum(self.cost(sampled, dict.fromkeys(itertools.compress(delay.SENSORS, shown), low_pass)))
            return np.inf

        return cost


def _costs(regression: _CommandRegression, kinds: tuple[bool, ...], orders: tuple[Order, ...]) -> dict[_Kernel, tuple[float, float]]:
    """−2 log likelihood of gyro and accelerometer for each kernel; empty if the log is too short."""
    phase, costs = (
        PHASE * float(np.mean(regression.log.interval_s)) / regression.vehicle.cycle.period_s,
        dict[_Kernel, tuple[float, float]](),
    )

    def add(one: _Kernel) -> None:
        low_passes = dict.fromkeys(delay.SENSORS, one.low_pass(regression.vehicle) if one.order else None)
        likeliest, phases = (0.0, ()) if one.order else (regression.bare_shift(one.sampled), SHIFTS)
        shifts = dict.fromkeys([0.0, likeliest, *(likeliest + by * phase for by in phases)])
        costs_by_shift = [regression.cost(one.sampled, low_passes, shift) for shift in shifts]
        costs[one] = min(gyro for gyro, _ in costs_by_shift), min(accelerometer for _, accelerometer in costs_by_shift)

    try:
        for kind in kinds:
            add(_Kernel(kind))
        for kind, order in itertools.product(kinds, orders):
            pending = {_Kernel(kind, order, cutoff) for cutoff in BEGUN_HZ}
            while pending:
                for one in pending:
                    add(one)
                pending = _neighbours(costs, kind, order)
            for _ in range(PASSES):
                for one in _finer(costs, kind, order):
                    add(one)
    except InputError:
        return {}
    return costs


def _neighbours(costs: Mapping[_Kernel, tuple[float, float]], kind: bool, order: int) -> set[_Kernel]:
    """Cutoffs still to test: neighbours of each sensor's best one.

    They are tested even if that is no better than no low-pass, since the likelihood between two of the first cutoffs may be far higher.
    """
    of_kind = [one for one in costs if (one.sampled, one.order) == (kind, order)]
    best = {CUTOFFS_HZ.index(min(of_kind, key=lambda one: costs[one][sensor]).cutoff_hz) for sensor in range(len(delay.SENSORS))}
    return {of_kind[0]._replace(cutoff_hz=cutoff) for at in best for cutoff in CUTOFFS_HZ[max(at - 1, 0) : at + 2]} - costs.keys()


def _finer(costs: Mapping[_Kernel, tuple[float, float]], kind: bool, order: int) -> set[_Kernel]:
    """Kernel of each sensor at the minimum of the parabola through its best cutoff and its neighbours."""
    of_kind = sorted((one for one in costs if (one.sampled, one.order) == (kind, order)), key=lambda one: one.cutoff_hz)
    finer = set[_Kernel]()
    for sensor in range(len(delay.SENSORS)):
        at = min(range(len(of_kind)), key=lambda i: costs[of_kind[i]][sensor])
        near = of_kind[max(at - 1, 0) : at + 2]
        if len(near) == 3:
            logs = np.log([one.cutoff_hz for one in near])
            curvature, slope, _ = np.polyfit(logs, [costs[one][sensor] for one in near], 2)
            if curvature > 0:
                finer.add(near[1]._replace(cutoff_hz=float(np.exp(np.clip(-slope / (2 * curvature), logs[0], logs[2])))))
    return finer - costs.keys()


def _best(
    costs: Mapping[_Kernel, tuple[float, float]], pairs_later: Mapping[tuple[_Kernel, _Kernel], float]
) -> tuple[_Kernel, _Kernel] | None:
    """Kernels of gyro and accelerometer, both sampled or neither, or of ``pairs_later``; None if the stated case is as good."""
    plain = next(iter(costs))

    def least(sensor: int, sampled: bool, other: _Kernel | None = None) -> _Kernel:
        of_kind = {one: both[sensor] for one, both in costs.items() if one.sampled == sampled}
        bare, best = next(one for one in of_kind if one.order == 0), min(of_kind, key=lambda one: of_kind[one])
        if of_kind[best] < of_kind[bare] - (CLEAR if other is None else LIKELY):
            return best
        return other if other is not None and of_kind[other] < of_kind[bare] + LIKELY else bare

    pairs = []
    for kind in {one.sampled for one in costs}:
        pair = least(0, kind), least(1, kind)
        clear = next((one for one in pair if one.order), None)
        pairs.append(pair if clear is None else (least(0, kind, clear), least(1, kind, clear)))
    total = {(gyro, accelerometer): costs[gyro][0] + costs[accelerometer][1] for gyro, accelerometer in pairs}
    for gyro, accelerometer in total:
        if not gyro.sampled and (gyro.order or accelerometer.order):  # averaging sensors rarely have a low-pass
            total[gyro, accelerometer] += UNUSUAL
    total.update(pairs_later)
    best = min(total, key=lambda pair: total[pair])
    return best if total[best] < sum(costs[plain]) - CLEAR else None


def _notice(best: tuple[_Kernel, _Kernel], sampled: bool) -> Notice:
    late_sensor = next(((sensor, one) for sensor, one in zip(delay.SENSORS, best, strict=True) if one.later), None)
    if late_sensor is not None:
        sensor, one = late_sensor
        order = "later" if one.later > 0 else "earlier"
        return Notice(
            "imu-kernel",
            f"the log fits if the {WORDS[sensor]}'s records are {order} than their times and than those of the other sensor; massprop "
            f"estimated this latency and used it. Check how records are buffered and stamped, or state imu.{sensor}_filter with order = 0 "
            "and latency_s",
        )
    orders = {0: "without a low-pass", 1: "with a first-order low-pass", 2: "with a second-order low-pass"}
    kind = "samples at their times" if best[0].sampled else "means over their intervals"
    words = [f"the {WORDS[sensor]}'s {orders[one.order]}" for sensor, one in zip(delay.SENSORS, best, strict=True)]
    keys = [
        *(["imu.measures"] if sampled else []),
        *(f"imu.{sensor}_filter" for sensor, one in zip(delay.SENSORS, best, strict=True) if one.order),
    ]
    return Notice(
        "imu-kernel",
        f"{' and '.join(keys)} {'are' if len(keys) > 1 else 'is'} not stated; the log fits best if IMU records are {kind}, {words[0]}, "
        f"{words[1]}. massprop assumed this and estimated cutoffs; state them if the data sheet does",
    )
