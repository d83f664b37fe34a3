"""Outliers of gyro and accelerometer, found without a model of the vehicle's body.

Growth of the mean rate and specific force are regressed on each channel's commands now and in previous cycles, the rates, their products,
the vertical and a constant. A gyro outlier leaves opposite residuals in two successive steps, which no torque does: ``size = (residual into
the cycle − residual out of it) / 2``. An accelerometer outlier differs from both neighbours. Outliers are removed and the rest is regressed
again, until none remains. A wrong model gives many or gradual residuals; then none is an outlier.

The other sensor alone measures an outlier's cycle: the outlier's noise is infinite (:mod:`massprop_cli.model.system`), so no estimate
depends on it. Where the model needs a rate, the previous one is used; its error is of second order.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import NORMAL_MEDIAN, Array, BoolArray, IntArray, frozen, last_before, median, runs
from massprop_cli.base.levels import BLOCK, CERTAIN, EDGE, ENOUGH, MAIN_PART, RESOLUTION, SLOW_ITERATIONS
from massprop_cli.diagnosis.design import CYCLES_PER_COLUMN
from massprop_cli.diagnosis.lackoffit import LAGS
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
"""Sigmas beyond which a reading is an outlier (benchmarks/faults.py)."""
SHARE = 0.015
"""Largest part of the rows that may be outliers."""
SELDOM = 0.1
"""Largest part of the records that may come late."""
ALONE = 1.5
"""Factor on the limit at the end, where one step alone shows an outlier and its neighbour looks the same."""
BEGUN, EARLY = 3, 3.0
"""Number of first cycles, in which earlier commands may act, and the factor on the limit there."""
RUN = 2
"""Most successive outliers; more are motion."""
LEAST = 3
"""Least cycles with known commands."""
LISTED = 8
"""Rows that a notice lists."""
SENSORS = ("gyro", "accel")
_LONG = {"gyro": "gyro", "accel": "accelerometer"}


class SensorOutliers(NamedTuple):
    """Outliers of one sensor."""

    cycles: IntArray
    sigmas: Array
    """Distance of each, sigmas."""


def with_outliers(log: Log, vehicle: Vehicle, samples: Stream, pieces: Sequence[slice]) -> tuple[Vehicle, list[Notice]]:
    """Vehicle with the times of outliers in ``pieces``, unless the vehicle file states them, and notices."""
    times, notices = {}, list[Notice]()
    doubled = _doubled(log)
    if len(doubled) and vehicle.imu.gyro_outliers_s is None and vehicle.imu.accel_outliers_s is None:
        times_doubled = tuple(round(float(log.time_s[row]), 9) for row in np.unique(np.append(doubled, doubled + 1)).tolist())
        rows_text = f"{len(doubled)} record(s), the first at row {int(doubled[0])}, hold only 0, and the next ones hold the motion of both"
        text = f"{rows_text}: they arrived late; massprop uses neither (imu.gyro_outliers_s, accel_outliers_s)"
        return stating(vehicle, {f"imu.{sensor}_outliers_s": times_doubled for sensor in SENSORS}), [Notice("records-doubled", text)]
    for sensor, outliers_found in zip(SENSORS, _search(log, vehicle, samples, pieces), strict=True):
        key = f"{sensor}_outliers_s"
        if getattr(vehicle.imu, key) is None and len(outliers_found.cycles):
            rows = [_row(log, sensor, int(cycle)) for cycle in outliers_found.cycles]
            times[f"imu.{key}"] = tuple(round(float(log.time_s[row]), 9) for row in rows)
            lost = np.flatnonzero(log.interval_s > LONG * median(log.interval_s))
            after = np.array(rows) - np.append(-np.inf, lost)[np.searchsorted(lost, rows, "right")]
            notices += _notices(log, sensor, np.array(rows), outliers_found.sigmas, after < EDGE * log.records_per_cycle)
    return stating(vehicle, times), notices


def _notices(log: Log, sensor: str, rows: IntArray, sigmas: Array, lost: BoolArray) -> Iterator[Notice]:
    """Notices of outliers; where a record was ``lost``, a reading is no mean over its interval, or a command is unknown."""

    def text(rows_mask: BoolArray, description: str) -> str:
        listed = ", ".join(f"{row} ({log.time_s[row]:.6g} s)" for row in rows[rows_mask][:LISTED].tolist()) + ", …" * bool(
            rows_mask.sum() > LISTED
        )
        out = f"{sigmas[rows_mask].min():.3g} to {sigmas[rows_mask].max():.3g} sigma off"
        used = f"not used (imu.{sensor}_outliers_s; [] uses all)"
        return f"the {_LONG[sensor]} has {rows_mask.sum()} reading(s) {description}, {out}, in rows (from 0) {listed}; {used}"

    if lost.any():
        description = "where a record was lost, which are not means over their intervals or follow a lost command"
        yield Notice("long-interval", text(lost, description))
    if not lost.all():
        yield Notice("outliers", text(~lost, "that are not of the motion"))


def _doubled(log: Log) -> IntArray:
    """Rows whose increments came with those of the next row: 0 throughout, between rows that are not."""
    readings = np.hstack([log.delta_theta_imu_rad, log.delta_v_imu_m_s])[:, list(log.axes)]
    zeros = (readings == 0).sum(1)
    all_zero = zeros == readings.shape[1]
    if (zeros == readings.shape[1] - 1).sum() > BY_CHANCE * all_zero.sum():
        return np.zeros(0, dtype=int)  # coarse sensors at rest
    alone = all_zero & ~np.append(all_zero[1:], True) & ~np.append(True, all_zero[:-1])
    if not log.rate_columns[0].startswith("delta") or all_zero.sum() != alone.sum() or alone.sum() > SELDOM * len(all_zero):
        return np.zeros(0, dtype=int)
    return np.flatnonzero(alone)


def without_outliers(log: Log, vehicle: Vehicle) -> Log:
    """Log with the stated outliers marked as ignored, and the previous reading in their place."""
    ignored = np.stack([_cycles_at(log, getattr(vehicle.imu, f"{sensor}_outliers_s") or ()) for sensor in SENSORS], 1)
    if not ignored.any():
        return log
    theta, velocity = (
        _with_previous_rate(log, increments, flags)
        for increments, flags in zip((log.delta_theta_imu_rad, log.delta_v_imu_m_s), ignored.T, strict=True)
    )
    ignored = ignored if log.ignored is None else ignored | log.ignored
    return replace(log, delta_theta_imu_rad=frozen(theta), delta_v_imu_m_s=frozen(velocity), ignored=ignored)


def _cycles_at(log: Log, times: Sequence[float]) -> BoolArray:
    """(K,) cycles with records that end at these times."""
    flags = np.zeros(log.cycles, dtype=bool)
    for time in times:
        row = int(np.argmin(np.abs(log.time_s - time)))
        flags[row // log.records_per_cycle] |= abs(log.time_s[row] - time) <= log.interval_s[row] / 2
    return flags


def _with_previous_rate(log: Log, increments: Array, flags: BoolArray) -> Array:
    """(n, 3) increments with the previous rate in flagged cycles; at the start of the log, the next one."""
    per_cycle = (-1, log.records_per_cycle)
    whole, duration = increments.reshape(*per_cycle, 3).sum(1), log.interval_s.reshape(per_cycle).sum(1)
    rate = (whole / duration[:, None])[last_before(~flags)]
    return np.where(
        np.repeat(flags, log.records_per_cycle)[:, None], np.repeat(rate, log.records_per_cycle, 0) * log.interval_s[:, None], increments
    )


def _row(log: Log, sensor: str, cycle: int) -> int:
    """Row of the record of a cycle that is farthest from those around it."""
    increments = log.delta_theta_imu_rad if sensor == "gyro" else log.delta_v_imu_m_s
    records = log.records_per_cycle
    first, stop = max(cycle - 1, 0) * records, min(cycle + 2, log.cycles) * records
    rates_near = increments[first:stop] / log.interval_s[first:stop, None]
    rates_own = increments[cycle * records : (cycle + 1) * records] / log.interval_s[cycle * records : (cycle + 1) * records, None]
    medians = np.array([median(column) for column in rates_near.T])
    return cycle * records + int(((rates_own - medians) ** 2).sum(1).argmax())


def _search(log: Log, vehicle: Vehicle, samples: Stream, pieces: Sequence[slice]) -> tuple[SensorOutliers, SensorOutliers]:
    """Outliers of gyro and accelerometer."""
    noise = (vehicle.imu.gyro_noise_rad_s or 0.0, vehicle.imu.accel_noise_m_s2 or 0.0)
    usable = int(np.searchsorted(cycle_edges(log, slice(0, len(samples)))[0], samples.usable_s))
    sizes = [np.zeros(len(samples)), np.zeros(len(samples))]
    for piece in pieces:
        edges = np.linspace(piece.start, piece.stop, -(-(piece.stop - piece.start) // BLOCK) + 1).astype(int)
        for start, stop in pairwise(edges):
            # segments overlap, so that only the ends of a piece are ends
            extended = slice(max(start - BEGUN - 1, 0), min(stop + 2, piece.stop))
            cycles = slice(start, stop)
            for sensor, find in enumerate((_of_gyro, _of_accelerometer)):
                if np.split(samples.unread, 2)[sensor].all():
                    continue
                sigmas_found = find(samples.part(extended), noise[sensor], max(max(usable, piece.start) - extended.start, 0))
                sizes[sensor][cycles] = sigmas_found[cycles.start - extended.start : cycles.stop - extended.start]
    return _accepted(sizes[0], log.rows), _accepted(sizes[1], log.rows)


def _accepted(sigmas: Array, rows: int) -> SensorOutliers:
    """Readings beyond the limit, if they are few and distinct."""
    far = sigmas > SIGMAS
    for start, stop in runs(far):
        far[start:stop] &= stop - start <= RUN
    outlying = np.flatnonzero(far)
    tail = int(((sigmas > CERTAIN) & (sigmas <= SIGMAS)).sum())
    if len(outlying) > SHARE * rows or tail > len(outlying) / 2:
        outlying = outlying[:0]
    return SensorOutliers(outlying, sigmas[outlying])


def _of_gyro(here: Samples, noise: float, first: int) -> Array:
    """(K,) distance of each cycle's rate, sigmas; commands before cycle ``first`` are unknown."""
    executed = here.executed
    duration = executed.duration_s[:, None]
    window_s = (duration[1:] + duration[:-1]) / 2
    up = here.up_b[1:-1] * window_s
    falling, impulses = executed.channels.falling, executed.channels.step

    def residual_of(rate: Array, used: BoolArray) -> Array:
        median_rate = _median_rate(rate)
        middle = (median_rate[1:] + median_rate[:-1]) / 2
        precession = _precession(here, median_rate)
        others = np.hstack([products(middle) * window_s, middle * window_s, (precession[1:] + precession[:-1]) * window_s, up, window_s])
        return _residual(np.diff(rate, axis=0), impulses, falling[:1], others, used[1:] & used[:-1])

    def size(residual_rows: Array) -> tuple[Array, BoolArray]:
        incoming, outgoing = np.vstack([-residual_rows[:1], residual_rows]), np.vstack([residual_rows, -residual_rows[-1:]])
        sizes = (incoming - outgoing) / 2
        opposite = np.abs(incoming + outgoing) < MAIN_PART * 2 * np.abs(sizes)
        return sizes, opposite

    return _removed(here.rate_rad_s, residual_of, size, _commanded(impulses), noise, _usable_cycles(here, "gyro", first))


def _of_accelerometer(here: Samples, noise: float, first: int) -> Array:
    """(K,) distance of each cycle's specific force, sigmas."""
    executed, rate = here.executed, here.rate_rad_s
    impulses = executed.channels.whole / executed.duration_s[:, None]
    up = (here.up_b[1:] + here.up_b[:-1]) / 2
    median_rate = _median_rate(rate)
    others = np.hstack([products(median_rate), median_rate, _precession(here, median_rate), up, np.ones((len(rate), 1))])

    def residual_of(force: Array, used: BoolArray) -> Array:
        return _residual(force, impulses, np.zeros_like(impulses[:1]), others, used)

    def size(residual_rows: Array) -> tuple[Array, BoolArray]:
        around = (np.vstack([residual_rows[1:2], residual_rows[:-1]]) + np.vstack([residual_rows[1:], residual_rows[-2:-1]])) / 2
        return residual_rows - around, np.ones(residual_rows.shape, dtype=bool)

    return _removed(here.specific_force_m_s2, residual_of, size, _commanded(impulses)[:-1], noise, _usable_cycles(here, "accel", first))


class _UsableCycles(NamedTuple):
    """Usable cycles of K."""

    usable: BoolArray
    """(K,) cycles with a used reading and known commands."""
    first: int
    """First cycle whose earlier commands are known."""


def _usable_cycles(here: Samples, sensor: str, first: int) -> _UsableCycles:
    """Usable cycles of one sensor. An unknown reading or command also affects the regressors and comparisons of its neighbours."""
    executed, axes = here.executed, slice(3 * SENSORS.index(sensor), 3 * SENSORS.index(sensor) + 3)
    unknown = executed.uncommanded | np.asarray((executed.ignored & ~here.unread)[:, axes].any(1))
    before, after = RUN, max(LAGS) + 1
    near = np.lib.stride_tricks.sliding_window_view(np.pad(unknown, (after, before)), before + after + 1)
    return _UsableCycles(np.asarray(~near.any(1)), first)


def _precession(here: Samples, rate: Array) -> Array:
    """(K, 3) torque by stored momentum at rates (K, 3); no columns without stored momentum."""
    stored = here.executed.stored
    return np.zeros((len(rate), 0)) if stored is None else stored.precession(rate)


def _median_rate(rate: Array) -> Array:
    """(K, 3) median of each rate and its neighbours, so that an outlier does not distort the regressors.

    At an end, the line through the next two rates replaces the missing neighbour.
    """
    first, last = (2 * rate[[1, -2]] - rate[[2, -3]])[:, None] if len(rate) > RUN else rate[[1, -2], None]
    before, after = np.vstack([first, rate[:-1]]), np.vstack([rate[1:], last])
    return np.asarray(np.sort(np.stack([before, rate, after]), axis=0)[1])


def _commanded(commands: Array) -> BoolArray:
    """(K + 1,) cycles with commands in a step or the previous one."""
    some = (commands != 0).any(1)
    return np.asarray(np.append(some, False) | np.append(False, some))


def _residual(motion: Array, commands: Array, before: Array, others: Array, used: BoolArray) -> Array:
    """Residual of the motion (N, 3) by commands (N, C), now and earlier, and other columns.

    Fitted on the ``used`` rows; zero if these are too few.

    ``before`` (1, C): the last commands before them.
    """
    for lags in (LAGS, LAGS[:1]):
        history = np.vstack([np.zeros((max(LAGS) - 1, commands.shape[1])), before, commands])
        columns = np.hstack([*(history[max(LAGS) - lag : len(history) - lag] for lag in lags), others])
        size = np.sqrt((columns[used] ** 2).sum(0))
        columns = columns[:, size > 0] / size[size > 0]
        if used.sum() >= CYCLES_PER_COLUMN * columns.shape[1]:
            return np.asarray(motion - columns @ np.linalg.lstsq(columns[used], motion[used], rcond=1e-9)[0])
    return np.zeros_like(motion)


def _removed(
    measured: Array,
    residual_of: Callable[[Array, BoolArray], Array],
    size: Callable[[Array], tuple[Array, BoolArray]],
    busy: BoolArray,
    noise: float,
    usable: _UsableCycles,
) -> Array:
    """(K,) distance, in sigmas, of outliers removed from ``measured`` (K, 3), and of the remaining readings."""
    first = usable.first
    if len(measured) < first + LEAST:
        return np.zeros(len(measured))
    cleaned, total, outlying = measured.copy(), np.zeros_like(measured), np.zeros(measured.shape, dtype=bool)
    least_scale = max(1.2 * noise, RESOLUTION * float(np.sqrt((measured**2).mean())))
    trusted = usable.usable & (np.arange(len(measured)) >= first)
    for _ in range(SLOW_ITERATIONS):
        # rows outside the regression have no residual to compare the first ones with
        sizes, distinct = size(residual_of(cleaned, trusted & ~outlying.any(1))[first:])
        sizes, distinct = np.pad(sizes, ((first, 0), (0, 0))), np.pad(distinct, ((first, 0), (0, 0)))
        scale = np.maximum(_scales(sizes, busy), least_scale)
        removed = np.where(outlying, sizes, 0.0)
        if (np.abs(removed) < scale).all():  # earlier removals have converged
            distance = np.where(distinct & ~outlying & usable.usable[:, None], np.abs(sizes), 0.0) / scale
            distance[: first + BEGUN], distance[-1] = distance[: first + BEGUN] / EARLY, distance[-1] / ALONE
            neighbours = np.vstack([distance[1:2], np.maximum(distance[2:], distance[:-2]), distance[-2:-1]])
            # the largest first, since they leave residuals that look like outliers
            peak = (distance > max(SIGMAS, MAIN_PART * distance.max())) & (distance >= neighbours)
            if not peak.any():
                break
            outlying, removed = outlying | peak, np.where(peak, sizes, 0.0)
        cleaned, total = cleaned - removed, total + removed
    sigmas: Array = np.where(outlying, np.abs(total), np.minimum(np.abs(sizes), SIGMAS * scale)) / scale
    return np.asarray(np.where(usable.usable, sigmas.max(1), 0.0))


def _scales(sizes: Array, busy: BoolArray) -> Array:
    """(K, 3) robust sigma of each axis, with and without commands, since a misfit of the commands is larger with them."""
    scale = np.empty_like(sizes)
    for axis in range(3):
        column = np.abs(sizes[:, axis])
        overall = median(column) / NORMAL_MEDIAN
        for group in (busy, ~busy):
            scale[group, axis] = max(median(column[group]) / NORMAL_MEDIAN, overall) if group.sum() >= ENOUGH else overall
    return scale
