"""Recordings whose time is not the time of their motion: the stamps' fault, or the records'."""

from collections.abc import Callable
from functools import partial

import numpy as np
from case_kind import Columns, Kind, Made, Random, kept, per_cycle, step_s

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, GYRO, QUATERNION, TIME
from massprop_cli.inputs.vehicle import Vehicle

SPLIT = ("split", "imu.clock_even")
MOVED = (*DELTA_THETA, *DELTA_V)


def _stamped(columns: Columns, vehicle: Vehicle, time_s: Array, what: str) -> Made:
    return Made(columns | {TIME: time_s}, vehicle, what)


def _of(columns: Columns) -> tuple[Array, float, int]:
    """Times, mean interval and number of the records."""
    return np.array(columns[TIME], float), step_s(columns), len(columns[TIME])


def _clean(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    start_s = float(rng.choice([0.0, 17.0, 86_400.0, 1.7e9]))
    time_s = _of(columns)[0]
    return _stamped(columns, vehicle, time_s + start_s, f"from {start_s:g} s")


def _bursts(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    time_s, step_s, count = _of(columns)
    many, apart = int(rng.choice([2, 3, 4, 8])), float(rng.uniform(0.01, 0.1))
    last = np.minimum((np.arange(count) // many + 1) * many, count) - 1
    stamps = time_s[last] - (last - np.arange(count)) * apart * step_s + rng.uniform(0, 0.01) * step_s
    return _stamped(columns, vehicle, stamps, f"{many} in a packet, {1e3 * step_s:.3g} ms")


def _steps(columns: Columns, vehicle: Vehicle, rng: Random, least: float, most: float, times: int) -> Made:
    """Clock steps of ``least`` to ``most`` intervals, ``times`` times."""
    time_s, step_s, count = _of(columns)
    stamps = time_s.copy()
    sizes = rng.choice([-1, 1], times) * rng.uniform(least, most, times) * step_s
    for at, size in zip(rng.integers(count // 20, count * 19 // 20, times), sizes, strict=True):
        stamps[at:] += size
    return _stamped(columns, vehicle, stamps, f"{times} of {1e3 * np.abs(sizes).max():.3g} ms at {1e3 * step_s:.3g} ms")


def _small_steps(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    return _steps(columns, vehicle, rng, 0.3, 0.45, int(rng.integers(6, 15)))


def _large_step(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    return _steps(columns, vehicle, rng, 3.0, 400.0, 1)


def _float32(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    time_s, step_s, _ = _of(columns)
    start_s = float(rng.uniform(1000, 8000) * step_s / 0.05)
    return _stamped(columns, vehicle, (time_s + start_s).astype(np.float32), f"from {start_s:.4g} s, {1e3 * step_s:.3g} ms")


def _rounded(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    time_s, step_s, _ = _of(columns)
    part = float(rng.choice([0.02, 0.1, 0.3]))
    tick_s = part * step_s
    return _stamped(columns, vehicle, np.round((time_s + rng.uniform(0, tick_s)) / tick_s + 0.013) * tick_s * (1 + 1e-12), f"to {part:g}")


def _arrival(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """Stamps that are late by an exponential time, in order."""
    time_s, step_s, count = _of(columns)
    late = float(rng.uniform(0.03, 0.5))
    arrived = time_s + rng.exponential(late * step_s, count)
    for at in range(1, count):
        arrived[at] = max(arrived[at], arrived[at - 1] + 0.01 * step_s)
    return _stamped(columns, vehicle, arrived, f"late by {late:.2g} of {1e3 * step_s:.3g} ms")


def _stalls(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """Records are held up and then arrive at once."""
    time_s, step_s, count = _of(columns)
    arrived = time_s + rng.normal(0, 0.01 * step_s, count) + 0.03 * step_s
    times = int(rng.integers(3, 10))
    for at in rng.integers(count // 20, count * 19 // 20, times):
        until = time_s[at] + float(rng.uniform(3, 8)) * step_s
        held = (time_s >= time_s[at]) & (time_s < until)
        arrived[held] = until + 0.02 * step_s * np.arange(held.sum())
    arrived = np.maximum.accumulate(arrived + 1e-9 * np.arange(count))
    return _stamped(columns, vehicle, arrived + 1e-6 * step_s * np.arange(count), f"{times} stalls")


def _wraps(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    time_s, step_s, count = _of(columns)
    length = float(rng.choice([2.0**32 * 1e-6, 2.0**31 * 1e-6, 2.0**32 * 1e-3]))
    at = int(rng.integers(count // 10, count * 9 // 10))
    return _stamped(columns, vehicle, (time_s + length - time_s[at] + 0.3 * step_s) % length, f"{length:.6g} s at row {at}")


def _restart(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """The clock begins again while the motion continues."""
    time_s, step_s, count = _of(columns)
    at = int(rng.integers(count // 10, count * 9 // 10))
    stamps = np.concatenate([time_s[:at], time_s[at:] - time_s[at] + float(rng.uniform(0, 2)) * step_s])
    return _stamped(columns, vehicle, stamps, f"at row {at}")


def _cut(columns: Columns, vehicle: Vehicle, rng: Random, restarted: bool) -> Made | None:
    """Some seconds are missing; the clock shows it, or begins again."""
    time_s, _, count = _of(columns)
    each = per_cycle(columns, vehicle)
    at, lost = int(rng.uniform(0.2, 0.6) * count / each) * each, int(rng.integers(40, 80)) * each
    left = kept(columns, np.r_[:at, at + lost : count])
    stamps = left[TIME].copy()
    stamps[at:] -= (stamps[at] - time_s[0]) * restarted
    return _stamped(left, vehicle, stamps, f"{lost} rows from {at}")


def _late(columns: Columns, vehicle: Vehicle, rng: Random) -> Made | None:
    """Some records have zero increments, and the next record has both."""
    if not any(name in columns for name in DELTA_THETA):
        return None
    count = len(columns[TIME])
    rows = np.unique(rng.choice(np.arange(2, count - 2), max(3, round(float(rng.uniform(0.005, 0.04)) * count))))
    rows = rows[np.diff(rows, prepend=-9) > 1]
    changed = dict(columns)
    for name in MOVED:
        if name in columns:
            values = columns[name].copy()
            values[rows + 1] += values[rows]
            values[rows] = 0.0
            changed[name] = values
    return Made(changed, vehicle, f"{len(rows)} of {count}")


def _occluded(columns: Columns, vehicle: Vehicle, rng: Random) -> Made | None:
    """The attitude is missing for some seconds."""
    if QUATERNION[0] not in columns:
        return None
    count = len(columns[TIME])
    changed = {name: np.array(values, float) for name, values in columns.items()}
    for at in rng.integers(0, count - 20, int(rng.integers(1, 4))):
        for name in QUATERNION:
            changed[name][at : at + int(0.08 * count)] = np.nan
    return Made(changed, vehicle, "")


def _as_rates(columns: Columns) -> Columns:
    """The same log with mean rates in place of increments."""
    names, lasting = dict(zip(MOVED, (*GYRO, *ACCEL), strict=True)), step_s(columns)
    return {names.get(name, name): values / lasting if name in names else values for name, values in columns.items()}


def _rates(columns: Columns, vehicle: Vehicle, rng: Random, stamped: Callable[..., Made]) -> Made:
    return stamped(_as_rates(columns), vehicle, rng)


REBUILT = ("clock-rebuilt",)
KINDS = {
    "clock-clean": Kind("even stamps from another epoch", _clean),
    "clock-bursts": Kind("stamps of packets of 2 to 8 records", _bursts, REBUILT),
    "clock-bursts-rates": Kind("the same of mean rates", partial(_rates, stamped=_bursts), REBUILT),
    "clock-steps": Kind("6 to 14 steps of a third of an interval", _small_steps, REBUILT),
    "clock-set": Kind("one step of 3 to 400 intervals", _large_step, REBUILT, SPLIT),
    "clock-float32": Kind("stamps in float32, far from 0", _float32, REBUILT),
    "clock-rounded": Kind("stamps rounded to 0.02, 0.1 or 0.3 of an interval", _rounded, REBUILT),
    "clock-arrival": Kind("stamps of arrival", _arrival, REBUILT),
    "clock-arrival-rates": Kind("the same of mean rates", partial(_rates, stamped=_arrival), REBUILT),
    "clock-stalls": Kind("records held up, and then sent at once", _stalls, REBUILT),
    "clock-wraps": Kind("a counter of 31 or 32 bits wraps", _wraps, REBUILT),
    "clock-restart": Kind("the clock begins again, the motion goes on", _restart, REBUILT, SPLIT),
    "records-cut": Kind("2 to 80 s are missing, as the clock says", partial(_cut, restarted=False), (), ("gap",)),
    "records-cut-restart": Kind("the same, and the clock begins again", partial(_cut, restarted=True), (), ("split", "cut the log")),
    "records-late": Kind("increments of a record in the next one", _late, ("records-doubled",)),
    "attitude-occluded": Kind("attitude lost for some seconds", _occluded),
}
