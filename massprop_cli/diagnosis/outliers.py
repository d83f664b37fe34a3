"""Outliers of gyro and accelerometer, found without a model of the vehicle's body.

The growth of the mean rate and the specific force are regressed on what may move them, whatever the body: each command channel now and in
the cycles before, the rates, their products, the vertical, a constant. A gyro's outlier leaves as much of one step as it takes from the
next, ``size = (left of the step into a cycle − left of the step out of it) / 2``, and no torque does that; an accelerometer's stands out
between its neighbours. What is found is taken out and the rest regressed again, until nothing is found. Readings that follow from
a wrong model are many, or shade off into the others; then none is an outlier.

An outlier's cycle is measured by the other sensor alone: its noise counts as without bound (:mod:`massprop_cli.model.system`), so that no
row of the estimates depends on it. Where the model needs some rate, the one before stands in; an error of it enters to second order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, frozen, last_before, median, runs
from massprop_cli.errorparameters.setup import stating
from massprop_cli.inputs.logtable import LONG
from massprop_cli.inputs.marked import BY_CHANCE
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.stream import Stream

SIGMAS = 10.0
"""From how many sigmas on a reading is none of the motion. benchmarks/faults.py moves with it."""
TAIL = 5.0
"""There are no more than half as many readings between so many sigmas and ``SIGMAS`` as outliers: what shades off is a misfit."""
BEHIND = 4
"""Cycles from a lost record on in which a command that was lost with it may act."""
SHARE = 0.015
"""Part of the rows that may be outliers."""
SELDOM = 0.1
"""Part of the records that may come late."""
RETURNS = 0.5
"""Of a gyro's outlier, what may be left of the two steps together."""
FARTHEST = 0.5
"""Part of the farthest from which on outliers are taken out at once."""
ALONE = 1.5
"""At its end, where one step alone shows it, an outlier's neighbour looks as far out as itself: so much more is asked there, ..."""
BEGUN, EARLY = 3, 3.0
"""... and in the first cycles, in which commands from before may act."""
RUN = 2
"""Outliers in a row at most: more are motion."""
LAGS = (0, 1, 2)
"""Cycles by which commands may come later than stated."""
LEAST = 3
"""Cycles of known commands in which one can stand out."""
SPARE = 3
"""Cycles that there must be for each regressor."""
STRETCH = 1024
"""Cycles over which one response is to explain the motion."""
ROUNDS = 20
"""How often what was found is taken out."""
GROUP = 30
"""Least cycles with commands, and without, to have a scale of their own."""
RESOLUTION = 1e-4
"""Part of its signal below which nothing is told: what motion within a cycle leaves of a log without noise."""
LISTED = 8
"""Rows that a notice names."""
SENSORS = ("gyro", "accel")
_LONG = {"gyro": "gyro", "accel": "accelerometer"}


class SensorOutliers(NamedTuple):
    """Of one sensor."""

    cycles: IntArray
    sigmas: Array
    """How far out each is."""


def screened(log: Log, vehicle: Vehicle, samples: Stream, pieces: Sequence[slice]) -> tuple[Vehicle, list[Notice]]:
    """The vehicle with the times of what is not to be used in ``pieces`` where it doesn't state them, and what to tell of it."""
    times, notices = {}, list[Notice]()
    empty = _doubled(log)
    if len(empty) and vehicle.imu.gyro_outliers_s is None and vehicle.imu.accel_outliers_s is None:
        both = tuple(round(float(log.time_s[row]), 9) for row in np.unique(np.append(empty, empty + 1)).tolist())
        where = f"{len(empty)} record(s), the first at row {int(empty[0])}, hold 0 throughout, and the next ones what both should have"
        said = f"{where}: they came late; these and the next are not used (imu.gyro_outliers_s, accel_outliers_s)"
        return stating(vehicle, {f"imu.{sensor}_outliers_s": both for sensor in SENSORS}), [Notice("records-doubled", said)]
    for sensor, found in zip(SENSORS, _search(log, vehicle, samples, pieces), strict=True):
        key = f"{sensor}_outliers_s"
        if getattr(vehicle.imu, key) is None and len(found.cycles):
            rows = [_row(log, sensor, int(cycle)) for cycle in found.cycles]
            times[f"imu.{key}"] = tuple(round(float(log.time_s[row]), 9) for row in rows)
            lost = np.flatnonzero(log.interval_s > LONG * median(log.interval_s))
            after = np.array(rows) - np.append(-np.inf, lost)[np.searchsorted(lost, rows, "right")]
            notices += _notices(log, sensor, np.array(rows), found.sigmas, after < BEHIND * log.records_per_cycle)
    return stating(vehicle, times), notices


def _notices(log: Log, sensor: str, rows: IntArray, sigmas: Array, lost: BoolArray) -> Iterator[Notice]:
    """Where a record was ``lost`` a reading is no mean over its interval, or what was commanded is not known."""

    def said(own: BoolArray, what: str) -> str:
        listed = ", ".join(f"{row} ({log.time_s[row]:.6g} s)" for row in rows[own][:LISTED].tolist()) + ", …" * bool(own.sum() > LISTED)
        out = f"{sigmas[own].min():.3g} to {sigmas[own].max():.3g} sigma out"
        used = f"not used (imu.{sensor}_outliers_s; [] uses all)"
        return f"the {_LONG[sensor]} has {own.sum()} reading(s) {what}, {out}, in rows (from 0) {listed}; {used}"

    if lost.any():
        what = "where a record was lost, which are no means over their intervals or follow a lost command"
        yield Notice("long-interval", said(lost, what))
    if not lost.all():
        yield Notice("outliers", said(~lost, "that are none of the motion"))


def _doubled(log: Log) -> IntArray:
    """Rows whose increments came with those of the next: 0 in all that was logged, between others that are not."""
    every = np.hstack([log.delta_theta_imu_rad, log.delta_v_imu_m_s])[:, list(log.axes)]
    still = (every == 0).sum(1)
    none = still == every.shape[1]
    if (still == every.shape[1] - 1).sum() > BY_CHANCE * none.sum():
        return np.zeros(0, dtype=int)  # of coarse sensors at rest
    alone = none & ~np.append(none[1:], True) & ~np.append(True, none[:-1])
    if not log.rate_columns[0].startswith("delta") or none.sum() != alone.sum() or alone.sum() > SELDOM * len(none):
        return np.zeros(0, dtype=int)
    return np.flatnonzero(alone)


def without(log: Log, vehicle: Vehicle) -> Log:
    """The log with what ``imu.gyro_outliers_s`` and ``imu.accel_outliers_s`` name marked, and the reading before in its place."""
    ignored = np.stack([_named(log, getattr(vehicle.imu, f"{sensor}_outliers_s") or ()) for sensor in SENSORS], 1)
    if not ignored.any():
        return log
    theta, velocity = (
        _held(log, increments, flags) for increments, flags in zip((log.delta_theta_imu_rad, log.delta_v_imu_m_s), ignored.T, strict=True)
    )
    ignored = ignored if log.ignored is None else ignored | log.ignored
    return replace(log, delta_theta_imu_rad=frozen(theta), delta_v_imu_m_s=frozen(velocity), ignored=ignored)


def _named(log: Log, times: Sequence[float]) -> BoolArray:
    """(K,) the cycles with the records that end at these times."""
    flags = np.zeros(log.cycles, dtype=bool)
    for time in times:
        row = int(np.argmin(np.abs(log.time_s - time)))
        flags[row // log.records_per_cycle] |= abs(log.time_s[row] - time) <= log.interval_s[row] / 2
    return flags


def _held(log: Log, increments: Array, flags: BoolArray) -> Array:
    """(n, 3) increments of which the cycles that are flagged go on as the last one before; at the log's beginning as the first after."""
    per_cycle = (-1, log.records_per_cycle)
    whole, duration = increments.reshape(*per_cycle, 3).sum(1), log.interval_s.reshape(per_cycle).sum(1)
    rate = (whole / duration[:, None])[last_before(~flags)]
    return np.where(
        np.repeat(flags, log.records_per_cycle)[:, None], np.repeat(rate, log.records_per_cycle, 0) * log.interval_s[:, None], increments
    )


def _row(log: Log, sensor: str, cycle: int) -> int:
    """Of a cycle's records the one that lies farthest from those around it."""
    increments = log.delta_theta_imu_rad if sensor == "gyro" else log.delta_v_imu_m_s
    records = log.records_per_cycle
    first, stop = max(cycle - 1, 0) * records, min(cycle + 2, log.cycles) * records
    near = increments[first:stop] / log.interval_s[first:stop, None]
    own = increments[cycle * records : (cycle + 1) * records] / log.interval_s[cycle * records : (cycle + 1) * records, None]
    middle = np.array([median(column) for column in near.T])
    return cycle * records + int(((own - middle) ** 2).sum(1).argmax())


def _search(log: Log, vehicle: Vehicle, samples: Stream, pieces: Sequence[slice]) -> tuple[SensorOutliers, SensorOutliers]:
    """Outliers of gyro and accelerometer."""
    noise = (vehicle.imu.gyro_noise_rad_s or 0.0, vehicle.imu.accel_noise_m_s2 or 0.0)
    usable = int(np.searchsorted(cycle_edges(log, slice(0, len(samples)))[0], samples.usable_s))
    sizes = [np.zeros(len(samples)), np.zeros(len(samples))]
    for piece in pieces:
        edges = np.linspace(piece.start, piece.stop, -(-(piece.stop - piece.start) // STRETCH) + 1).astype(int)
        for start, stop in pairwise(edges):
            # each stretch begins and ends within its neighbours, so that none of its own cycles is an end but the piece's
            wide = slice(max(start - BEGUN - 1, 0), min(stop + 2, piece.stop))
            own = slice(start, stop)
            for sensor, find in enumerate((_of_gyro, _of_accelerometer)):
                if np.split(samples.unread, 2)[sensor].all():
                    continue
                found = find(samples.part(wide), noise[sensor], max(max(usable, piece.start) - wide.start, 0))
                sizes[sensor][own] = found[own.start - wide.start : own.stop - wide.start]
    return _judged(sizes[0], log.rows), _judged(sizes[1], log.rows)


def _judged(sigmas: Array, rows: int) -> SensorOutliers:
    """What is far out, if that is little and apart from all else."""
    far = sigmas > SIGMAS
    for start, stop in runs(far):
        far[start:stop] &= stop - start <= RUN
    out = np.flatnonzero(far)
    between = int(((sigmas > TAIL) & (sigmas <= SIGMAS)).sum())
    if len(out) > SHARE * rows or between > len(out) / 2:
        out = out[:0]
    return SensorOutliers(out, sigmas[out])


def _of_gyro(here: Samples, noise: float, first: int) -> Array:
    """(K,) by how many sigmas each cycle's rate is none of the motion; what acted before the ``first`` is not known."""
    executed = here.executed
    duration = executed.duration_s[:, None]
    lasting = (duration[1:] + duration[:-1]) / 2
    up = here.up_b[1:-1] * lasting
    falling, windowed = executed.channels.falling, executed.channels.step

    def left(rate: Array, used: BoolArray) -> Array:
        usual = _usual(rate)
        middle = (usual[1:] + usual[:-1]) / 2
        pulled = _precession(here, usual)
        beside = np.hstack([products(middle) * lasting, middle * lasting, (pulled[1:] + pulled[:-1]) * lasting, up, lasting])
        return _residual(np.diff(rate, axis=0), windowed, falling[:1], beside, used[1:] & used[:-1])

    def size(rest: Array) -> tuple[Array, BoolArray]:
        into, out = np.vstack([-rest[:1], rest]), np.vstack([rest, -rest[-1:]])
        found = (into - out) / 2
        returns = np.abs(into + out) < RETURNS * 2 * np.abs(found)
        return found, returns

    return _taken_out(here.rate_rad_s, left, size, _busy(windowed), noise, _told(here, "gyro", first))


def _of_accelerometer(here: Samples, noise: float, first: int) -> Array:
    """(K,) the same of its specific force."""
    executed, rate = here.executed, here.rate_rad_s
    whole = executed.channels.whole / executed.duration_s[:, None]
    up = (here.up_b[1:] + here.up_b[:-1]) / 2
    usual = _usual(rate)
    beside = np.hstack([products(usual), usual, _precession(here, usual), up, np.ones((len(rate), 1))])

    def left(force: Array, used: BoolArray) -> Array:
        return _residual(force, whole, np.zeros_like(whole[:1]), beside, used)

    def size(rest: Array) -> tuple[Array, BoolArray]:
        around = (np.vstack([rest[1:2], rest[:-1]]) + np.vstack([rest[1:], rest[-2:-1]])) / 2
        return rest - around, np.ones(rest.shape, dtype=bool)

    return _taken_out(here.specific_force_m_s2, left, size, _busy(whole)[:-1], noise, _told(here, "accel", first))


class _Told(NamedTuple):
    """Which of K cycles tell anything."""

    known: BoolArray
    """(K,) whose reading is used, and in which no lost command acts."""
    first: int
    """From which on the commands of before are known."""


def _told(here: Samples, sensor: str, first: int) -> _Told:
    """Of one sensor: what is unknown is in the regressors of the cycles after it, and in what those on both sides are compared with."""
    executed, own = here.executed, slice(3 * SENSORS.index(sensor), 3 * SENSORS.index(sensor) + 3)
    unknown = executed.uncommanded | np.asarray((executed.ignored & ~here.unread)[:, own].any(1))
    before, after = RUN, max(LAGS) + 1
    near = np.lib.stride_tricks.sliding_window_view(np.pad(unknown, (after, before)), before + after + 1)
    return _Told(np.asarray(~near.any(1)), first)


def _precession(here: Samples, rate: Array) -> Array:
    """(K, 3) torque that the wheels' momentum makes of rates (K, 3); no columns where there are none."""
    stored = here.executed.stored
    return np.zeros((len(rate), 0)) if stored is None else stored.precession(rate)


def _usual(rate: Array) -> Array:
    """(K, 3) the middle one of each rate and its neighbours, so that an outlier explains nothing by what it makes of the regressors.

    At an end, where one neighbour is missing, the line through the next two stands for it.
    """
    first, last = (2 * rate[[1, -2]] - rate[[2, -3]])[:, None] if len(rate) > RUN else rate[[1, -2], None]
    before, after = np.vstack([first, rate[:-1]]), np.vstack([rate[1:], last])
    return np.asarray(np.sort(np.stack([before, rate, after]), axis=0)[1])


def _busy(commands: Array) -> BoolArray:
    """(K + 1,) where something was commanded in a step or the one before."""
    some = (commands != 0).any(1)
    return np.asarray(np.append(some, False) | np.append(False, some))


def _residual(motion: Array, commands: Array, before: Array, beside: Array, used: BoolArray) -> Array:
    """What is left of the motion (N, 3) beside commands (N, C), now and before, and all else, as the ``used`` rows tell; else nothing.

    ``before`` (1, C) is what was commanded last before them.
    """
    for lags in (LAGS, LAGS[:1]):
        known = np.vstack([np.zeros((max(LAGS) - 1, commands.shape[1])), before, commands])
        columns = np.hstack([*(known[max(LAGS) - lag : len(known) - lag] for lag in lags), beside])
        size = np.sqrt((columns[used] ** 2).sum(0))
        columns = columns[:, size > 0] / size[size > 0]
        if used.sum() >= SPARE * columns.shape[1]:
            return np.asarray(motion - columns @ np.linalg.lstsq(columns[used], motion[used], rcond=1e-9)[0])
    return np.zeros_like(motion)


def _taken_out(
    measured: Array,
    left: Callable[[Array, BoolArray], Array],
    size: Callable[[Array], tuple[Array, BoolArray]],
    busy: BoolArray,
    noise: float,
    told: _Told,
) -> Array:
    """(K,) sigmas of what had to be taken out of ``measured`` (K, 3), and of what is left."""
    first = told.first
    if len(measured) < first + LEAST:
        return np.zeros(len(measured))
    mended, total, outlying = measured.copy(), np.zeros_like(measured), np.zeros(measured.shape, dtype=bool)
    least = max(1.2 * noise, RESOLUTION * float(np.sqrt((measured**2).mean())))
    known = told.known & (np.arange(len(measured)) >= first)
    for _ in range(ROUNDS):
        # what a regression makes of rows that it didn't see is nothing to hold the first ones against
        found, alone = size(left(mended, known & ~outlying.any(1))[first:])
        found, alone = np.pad(found, ((first, 0), (0, 0))), np.pad(alone, ((first, 0), (0, 0)))
        scale = np.maximum(_scales(found, busy), least)
        taken = np.where(outlying, found, 0.0)
        if (np.abs(taken) < scale).all():  # what was taken out before is all that it was
            out = np.where(alone & ~outlying & told.known[:, None], np.abs(found), 0.0) / scale
            out[: first + BEGUN], out[-1] = out[: first + BEGUN] / EARLY, out[-1] / ALONE
            beside = np.vstack([out[1:2], np.maximum(out[2:], out[:-2]), out[-2:-1]])
            # the farthest first: what they leave in a regression looks like more of them
            peak = (out > max(SIGMAS, FARTHEST * out.max())) & (out >= beside)
            if not peak.any():
                break
            outlying, taken = outlying | peak, np.where(peak, found, 0.0)
        mended, total = mended - taken, total + taken
    sigmas: Array = np.where(outlying, np.abs(total), np.minimum(np.abs(found), SIGMAS * scale)) / scale
    return np.asarray(np.where(told.known, sigmas.max(1), 0.0))


def _scales(found: Array, busy: BoolArray) -> Array:
    """(K, 3) robust sigma of each axis, with commands and without: a misfit of the commands is larger with them."""
    scale = np.empty_like(found)
    for axis in range(3):
        column = np.abs(found[:, axis])
        whole = median(column) / 0.6745
        for group in (busy, ~busy):
            scale[group, axis] = max(median(column[group]) / 0.6745, whole) if group.sum() >= GROUP else whole
    return scale
