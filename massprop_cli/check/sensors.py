"""The IMU's channels as they stand: dead, stuck, repeated, clipped, coarse."""

from functools import partial

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.check.finding import Finding, finding, rows
from massprop_cli.inputs.clipped import at_extremes
from massprop_cli.inputs.tablefile import Place
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle

STUCK = 6
"""Equal values in a row of a channel that never repeats itself otherwise."""
UNLIKELY = 1e-9
"""Chance below which a run of equal values is no chance."""
COARSE = 3.0
"""Smallest step over the noise of a record above which values lie on a staircase."""
ROUNDING = 1e-12
_finding = partial(finding, "imu")


def sensors(log: Log, vehicle: Vehicle, place: Place) -> list[Finding]:
    """Findings of gyro and accelerometer."""
    imu, found = vehicle.imu, []
    rates = (
        ("gyro", log.rate_columns, log.delta_theta_imu_rad, imu.gyro_noise_rad_s, imu.gyro_range_rad_s),
        ("accelerometer", log.force_columns, log.delta_v_imu_m_s, imu.accel_noise_m_s2, imu.accel_range_m_s2),
    )
    noisy = all(noise != 0 for _, _, _, noise, _ in rates)
    both = np.concatenate([log.delta_theta_imu_rad, log.delta_v_imu_m_s], 1)
    repeated = np.concatenate([[False], _same(both).all(1)])
    if noisy and repeated.mean() > 0.01:
        said = f"{100 * repeated.mean():.3g} % of the records repeat the one before in all six channels: the log is faster than the IMU"
        found.append(_finding("repeated-record", "fault", said, "log each sample once, or with its own time", rows(repeated, place)))
    for (name, columns, increments, noise, limit), logged in zip(rates, (log.axes[:3], log.axes[3:]), strict=True):
        clipped = at_extremes(increments, log.interval_s)
        for axis, column in enumerate(columns):
            if not logged[axis] and column not in log.empty:
                continue
            values = increments[:, axis] / log.interval_s
            found += _channel(name, column, values, noise, limit, clipped[:, axis], repeated, place)
        found += _coarse(name, increments / log.interval_s[:, None], noise, log.records_per_cycle)
    return found


def _same(values: Array) -> BoolArray:
    """Whether each value is the one before, but for the rounding of a multiplication by its interval."""
    return np.asarray(np.abs(np.diff(values, axis=0)) <= ROUNDING * np.abs(values[1:]))


def _channel(
    name: str, column: str, values: Array, noise: float | None, limit: float | None, clipped: BoolArray, repeated: BoolArray, place: Place
) -> list[Finding]:
    if _same(values).all():
        if noise == 0:
            return []  # a perfect sensor of an axis that is left alone
        remedy = "see to the sensor and its channel in the recorder"
        return [_finding("dead-axis", "fault", f"{column} is {values[0]:g} throughout: the {name}'s axis is dead", remedy)]
    found = []
    if limit is not None:
        full = np.abs(values) >= 0.999 * limit
        said = f"{column} at the {name}'s range in {int(full.sum())} records"
        remedy = "fly a gentler motion, or widen the sensor's range; the phase before is good"
    else:
        full = clipped
        said = f"{column} is {float(values[np.argmax(full)]):.6g} per second in {int(full.sum())} records and never beyond: clipped"
        remedy = f"state the {name}'s range in the vehicle file if it is one, and fly a gentler motion"
    if full.any():
        found.append(_finding(f"{name}-saturated", "fault", said, remedy, rows(full, place)))
        full = np.abs(values) >= 0.999 * (np.abs(values[full][0]) if limit is None else limit)
    run = standing(values, repeated) & ~full  # at the end of its range it stands still
    if noise != 0 and run.any():
        remedy = "see to the sensor; cut these records ([[phases]])"
        said = f"{column} stands still in {int(run.sum())} records while others move"
        found.append(_finding("stuck", "fault", said, remedy, rows(run, place)))
    return found


def standing(values: Array, repeated: BoolArray) -> BoolArray:
    """Records in runs of equal values longer than chance makes them of a channel that repeats itself as often as this does elsewhere."""
    same = np.concatenate([[False], _same(values)]) & ~repeated
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    long = ends - starts
    elsewhere = (same.sum() - long + 1) / (len(values) - long + 1)
    unlikely = (long >= STUCK - 1) & (len(values) * elsewhere**long < UNLIKELY)
    found = np.zeros(len(values), dtype=bool)
    for start, end in zip(starts[unlikely], ends[unlikely], strict=True):
        found[start - 1 : end] = True
    return found


def _coarse(name: str, values: Array, noise: float | None, records: int) -> list[Finding]:
    if not noise:
        return []
    # sorted, not np.unique, which imports masked arrays
    steps = [(step := np.diff(np.sort(axis)))[step > 1e-9 * np.abs(axis).max()] for axis in values.T]
    coarsest = max((float(step.min()) for step in steps if len(step) > 1), default=0.0)
    if coarsest <= COARSE * noise * np.sqrt(records):
        return []
    said = f"the {name} counts in steps of {coarsest:.3g} per second, {coarsest / (noise * np.sqrt(records)):.3g} times its stated noise"
    return [_finding("quantised", "fault", said, f"state the noise with the step in it (step / sqrt(12)), or log the {name} finer")]
