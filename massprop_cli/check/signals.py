"""Findings from a log's signals alone: sampling, gyro and accelerometer, commands, logged attitude."""

from functools import partial

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median, runs
from massprop_cli.base.quaternion import matrices, rotation_vector, turns_between
from massprop_cli.base.rigidbody import times
from massprop_cli.check.finding import Finding, finding, rows
from massprop_cli.inputs.clipped import at_extremes
from massprop_cli.inputs.formats.clocks import outlying
from massprop_cli.inputs.logtable import GAP, LONG
from massprop_cli.inputs.tablefile import Place
from massprop_cli.inputs.telemetry import JITTER, Log, jitter
from massprop_cli.inputs.vehicle import Vehicle

STUCK = 6
"""Minimum number of equal values in a row, for a channel that does not repeat elsewhere."""
UNLIKELY = 1e-9
"""Largest probability of a run of equal values that counts as a fault."""
COARSE = 3.0
"""Smallest quantisation step over the noise of one record that counts as coarse."""
ROUNDING = 1e-12
_finding = partial(finding, "imu")


def sensors(log: Log, vehicle: Vehicle, place: Place) -> list[Finding]:
    """Findings of gyro and accelerometer; ``place`` names a row."""
    imu, findings = vehicle.imu, []
    rates = (
        ("gyro", log.rate_columns, log.delta_theta_imu_rad, imu.gyro_noise_rad_s, imu.gyro_range_rad_s),
        ("accelerometer", log.force_columns, log.delta_v_imu_m_s, imu.accel_noise_m_s2, imu.accel_range_m_s2),
    )
    noisy = all(noise != 0 for _, _, _, noise, _ in rates)
    both = np.concatenate([log.delta_theta_imu_rad, log.delta_v_imu_m_s], 1)
    repeated = np.concatenate([[False], _same(both).all(1)])
    if noisy and repeated.mean() > 0.01:
        text = f"{100 * repeated.mean():.3g} % of the records repeat all six channels of the one before: the log is faster than the IMU"
        findings.append(_finding("repeated-record", "fault", text, "log each sample once, or with its own time", rows(repeated, place)))
    for (name, columns, increments, noise, limit), logged in zip(rates, (log.axes[:3], log.axes[3:]), strict=True):
        clipped = at_extremes(increments, log.interval_s)
        for axis, column in enumerate(columns):
            if not logged[axis] and column not in log.empty:
                continue
            values = increments[:, axis] / log.interval_s
            findings += _channel(name, column, values, noise, limit, clipped[:, axis], repeated, place)
        findings += _coarse(name, increments / log.interval_s[:, None], noise, log.records_per_cycle)
    return findings


def _same(values: Array) -> BoolArray:
    """(n - 1, ...) whether each value equals the previous one, within rounding."""
    return np.asarray(np.abs(np.diff(values, axis=0)) <= ROUNDING * np.abs(values[1:]))


def _channel(
    name: str, column: str, values: Array, noise: float | None, limit: float | None, clipped: BoolArray, repeated: BoolArray, place: Place
) -> list[Finding]:
    if _same(values).all():
        if noise == 0:
            return []  # a noiseless sensor on an axis without motion
        remedy = "check the sensor and its channel in the recorder"
        return [_finding("dead-axis", "fault", f"{column} is {values[0]:g} throughout: the {name}'s axis is dead", remedy)]
    findings = []
    if limit is not None:
        full = np.abs(values) >= 0.999 * limit
        text = f"{column} at the {name}'s range in {int(full.sum())} records"
        remedy = "use a gentler motion or a wider sensor range; the time before is usable"
    else:
        full = clipped
        text = f"{column} is {float(values[np.argmax(full)]):.6g} per second in {int(full.sum())} records and never larger: clipped"
        remedy = f"state the {name}'s range in the vehicle file if this is its range, and use a gentler motion"
    if full.any():
        findings.append(_finding(f"{name}-saturated", "fault", text, remedy, rows(full, place)))
        full = np.abs(values) >= 0.999 * (np.abs(values[full][0]) if limit is None else limit)
    run = improbable_runs(values, repeated) & ~full  # a saturated sensor repeats its range
    if noise != 0 and run.any():
        remedy = "check the sensor; leave these records out ([[phases]])"
        text = f"{column} repeats one value in {int(run.sum())} records while others change"
        findings.append(_finding("stuck", "fault", text, remedy, rows(run, place)))
    return findings


def improbable_runs(values: Array, repeated: BoolArray) -> BoolArray:
    """(n,) records in runs of equal values that are improbable at the channel's own rate of repetition outside the run."""
    same = np.concatenate([[False], _same(values)]) & ~repeated
    starts, ends = runs(same).T
    long = ends - starts
    elsewhere = (same.sum() - long + 1) / (len(values) - long + 1)
    unlikely = (long >= STUCK - 1) & (len(values) * elsewhere**long < UNLIKELY)
    findings = np.zeros(len(values), dtype=bool)
    for start, end in zip(starts[unlikely], ends[unlikely], strict=True):
        findings[start - 1 : end] = True
    return findings


def _coarse(name: str, values: Array, noise: float | None, records: int) -> list[Finding]:
    if not noise:
        return []
    # np.unique imports masked arrays, which is slow
    steps = [(step := np.diff(np.sort(axis)))[step > 1e-9 * np.abs(axis).max()] for axis in values.T]
    coarsest = max((float(step.min()) for step in steps if len(step) > 1), default=0.0)
    if coarsest <= COARSE * noise * np.sqrt(records):
        return []
    text = f"the {name} has a resolution of {coarsest:.3g} per second, {coarsest / (noise * np.sqrt(records)):.3g} times its stated noise"
    return [
        _finding(
            "quantised",
            "fault",
            text,
            f"include the resolution in the stated noise (step / sqrt(12)), or log the {name} with a finer resolution",
        )
    ]


def sampling(time_s: Array, place: Place) -> list[Finding]:
    """Findings of the time column (n,), s; ``place`` names a row."""
    bad = ~np.isfinite(time_s)
    if len(time_s) < 2 or bad.any() or outlying(time_s)[0].any():
        return []  # reading the log reports these
    steps = np.concatenate([[np.nan], np.diff(time_s)])
    forward = steps[1:][steps[1:] > 0]
    if not len(forward):
        return []
    usual = median(forward)
    findings = []
    for code, which, what, remedy in (
        (
            "duplicate-time",
            steps == 0,
            "records with the same time as the one before",
            "remove the copies, or record times with more digits",
        ),
        ("time-back", steps < 0, "backward steps of the clock", "sort the log, or split it where the clock was set"),
        ("gap", steps > GAP * usual, f"gaps of more than {GAP:g} usual intervals", "split the log there into separate files"),
    ):
        if which.any():
            worst = float(np.max(np.abs(steps[which])))
            size = "" if code == "duplicate-time" else f", the largest of {worst:.6g} s"
            text = f"{what}: {int(which.sum())} (usual interval {usual:.6g} s{size})"
            findings.append(finding("sampling", code, "unusable", text, remedy, rows(which, place)))
    if findings:
        return findings
    scatter = jitter(steps[1:])
    if scatter > JITTER:
        off = np.abs(steps - usual) > 3 * scatter * usual
        remedy = "stamp records with the IMU's clock, not at arrival, or state even = true under their clock in a map file"
        text = f"intervals scatter by {100 * scatter:.2g} % of {usual:.6g} s"
        findings.append(finding("sampling", "jitter", "fault", text, remedy, rows(off, place)))
    short = steps < usual / LONG
    if short.any() and scatter <= JITTER:
        text = f"{int(short.sum())} intervals shorter than {1 / LONG:.2g} of the usual {usual:.6g} s"
        remedy = "check that the recorder dropped and invented no records"
        findings.append(finding("sampling", "short-interval", "note", text, remedy, rows(short, place)))
    return findings


ALWAYS = 0.98
"""Smallest on-time of a jet that counts as always on, as a fraction of the cycle, and smallest fraction of such cycles."""
TOGETHER = 0.05
"""Smallest on-time of both opposed jets, as a fraction of the cycle, and smallest fraction of such cycles, for a note."""
ALIKE = 1e-6


def commands(log: Log, vehicle: Vehicle, place: Place) -> list[Finding]:
    """Findings of commands; ``place`` names a row."""
    if not log.command.any() and not any(one.moved for one in log.spinning):
        remedy = "check that commands were recorded under the names of the vehicle file"
        return [finding("commands", "nothing-commanded", "fault", "no command other than 0 in the whole log", remedy)]
    if log.command_kind != "jets":
        return []
    share = log.command / vehicle.cycle.period_s
    findings = []
    for number, jet in enumerate(vehicle.jets):
        if (share[:, number] > ALWAYS).mean() > ALWAYS:
            text = f"jet {jet.name} is on during all of every cycle"
            remedy = "check that its column holds executed commands and not a constant"
            findings.append(finding("commands", "jet-always-on", "fault", text, remedy))
    for first, second in _opposed(vehicle):
        both = np.minimum(share[:, first], share[:, second]) > TOGETHER
        if both.mean() > TOGETHER:
            names = f"{vehicle.jets[first].name} and {vehicle.jets[second].name}"
            text = f"jets {names} push against each other in {int(both.sum())} cycles: their thrust cancels and their errors remain"
            where = rows(_in_rows(log, both), place)
            findings.append(
                finding("commands", "opposed-jets", "note", text, "allocate the commands so that only one of them fires", where)
            )
    return findings


def _in_rows(log: Log, commanded: BoolArray) -> BoolArray:
    """(n,) records of the ``commanded`` rows of commands."""
    if log.command_s is None:
        return np.repeat(commanded, log.records_per_cycle)
    findings = np.zeros(len(log.time_s), dtype=bool)
    findings[np.minimum(np.searchsorted(log.time_s, log.command_s[commanded]), len(findings) - 1)] = True
    return findings


def never_fired(log: Log, vehicle: Vehicle) -> list[str]:
    """Names of jets, wrench components, rotors and momentum devices without any command."""
    by_kind = {
        "jets": [jet.name for jet in vehicle.jets],
        "wrench": [f"{kind} {axis}" for kind in ("torque", "force") for axis in "xyz"],
        "rotors": [rotor.name for rotor in vehicle.rotors],
    }
    names = by_kind[log.command_kind]
    idle = [name for name, column in zip(names, log.command.T, strict=True) if not column.any()]
    return [*idle, *(one.name for one, momentum in zip(vehicle.spinning, log.spinning, strict=True) if not momentum.moved)]


def _opposed(vehicle: Vehicle) -> list[tuple[int, int]]:
    wrench: Array = vehicle.jet_wrench
    size = np.abs(wrench).max(initial=0.0)  # empty without jets
    return [
        (i, j)
        for i in range(len(wrench))
        for j in range(i + 1, len(wrench))
        if np.abs(wrench[i] + wrench[j]).max() <= ALIKE * size and wrench[i].any()
    ]


MISFIT = 0.2
"""Largest gyro error as a fraction of its rotation, beyond white noise of gyro and attitude."""
MIN_ROTATIONS = 8
"""Minimum number of logged rotations."""
STILL_RAD = 1e-3
"""Minimum rms rotation, rad."""
TILTED = 0.05
"""Largest angle between mean specific force and vertical, rad; jet thrust averages out to less."""


ROCKING = 0.05
"""Largest rate about X and Y on a table, as a fraction of the yaw rate: an IMU 3° out of level."""


def _fault(code: str, text: str, remedy: str) -> Finding:
    return finding("attitude", code, "fault", text, remedy)


def on_table(log: Log, vehicle: Vehicle) -> list[Finding]:
    """Findings of an IMU on a table: rotation about body Z only, gravity along Z. Empty in other environments."""
    if vehicle.environment.kind != "planar":
        return []
    mount, findings = np.array(vehicle.imu.body_from_imu), []
    mean_force = (log.delta_v_imu_m_s @ mount.T / log.interval_s[:, None]).mean(0)
    off = float(np.linalg.norm(mean_force - [0.0, 0.0, vehicle.environment.gravity_m_s2])) if all(log.axes[3:]) else 0.0
    if off > TILTED * vehicle.environment.gravity_m_s2:
        text = f"the accelerometer reads {', '.join(f'{x:.4g}' for x in mean_force)} m/s^2 along body X, Y and Z (mean); Z points up"
        remedy = "correct imu.body_from_imu, the accelerometer's signs and unit, or environment.gravity_m_s2"
        findings.append(_fault("table-gravity", text, remedy))
    rate = log.delta_theta_imu_rad @ mount.T / log.interval_s[:, None]
    slow = rate - rate.mean(0)
    noise = (vehicle.imu.gyro_noise_rad_s or 0.0) * np.sqrt(log.records_per_cycle)
    rocking, yaw = (float(np.sqrt(max((part**2).sum(1).mean() - part.shape[1] * noise**2, 0.0))) for part in (slow[:, :2], slow[:, 2:]))
    if rocking > ROCKING * yaw and rocking > noise:
        text = f"the vehicle yaws by {yaw:.3g} rad/s (rms), and the gyro shows {rocking:.3g} rad/s about the two axes in the table plane"
        findings.append(_fault("table-rocking", text, "correct imu.body_from_imu, or check the pads: the vehicle rocks on them"))
    return findings


def attitude(log: Log, vehicle: Vehicle) -> list[Finding]:
    """Findings of the logged attitude; empty without one."""
    if log.attitude_wxyz is None:
        return []
    mount = np.array(vehicle.imu.body_from_imu)
    findings = []
    rows = np.flatnonzero(np.isfinite(log.attitude_wxyz[:, 0]))
    turned = np.diff(np.cumsum(log.delta_theta_imu_rad @ mount.T, 0)[rows], axis=0)
    logged = rotation_vector(turns_between(log.attitude_wxyz[rows]))
    if len(logged) < MIN_ROTATIONS:
        return []
    size = float(np.sqrt((turned**2).sum()))
    # the mean difference is the gyro's bias, which has its own warning
    off = turned - logged - (turned - logged).mean(0)
    noise = (vehicle.imu.gyro_noise_rad_s or 0.0) * vehicle.cycle.period_s / np.sqrt(log.records_per_cycle)
    # white attitude noise gives successive differences a negative correlation
    scatter = max(float(-(off[1:] * off[:-1]).mean()), 0.0)
    excess = float(np.sqrt(max((off**2).sum() - off.size * (noise**2 + 2 * scatter), 0.0)))
    if np.sqrt((turned**2).sum()) > STILL_RAD and excess > MISFIT * size:
        inverse = float(np.sqrt(((turned + logged - (turned + logged).mean(0)) ** 2).sum()))
        hint = (
            "it rotates in the opposite direction: is it body from world? Log its conjugate"
            if inverse < excess / 2
            else "check that both use the same axes"
        )
        percent = 100 * excess / max(size, STILL_RAD)
        text = f"the logged attitude and the gyro disagree: the gyro does not explain {percent:.3g} % of the rotation"
        findings.append(_fault("attitude-gyro", text, f"{hint} (quat_* is wxyz, world from body; imu.body_from_imu)"))
    if vehicle.pivoted and all(log.axes[3:]):
        findings += _gravity(log, mount)
    return findings


def _gravity(log: Log, mount: Array) -> list[Finding]:
    assert log.attitude_wxyz is not None
    rows = np.isfinite(log.attitude_wxyz[:, 0])
    mean_force = (log.delta_v_imu_m_s @ mount.T / log.interval_s[:, None])[rows]
    world = times(matrices(log.attitude_wxyz[rows]), mean_force).mean(0)
    angle = float(np.arctan2(np.hypot(world[0], world[1]), world[2]))
    if angle <= TILTED:
        return []
    text = f"specific force in world axes is {angle:.3g} rad ({np.degrees(angle):.3g}°) off the vertical (mean)"
    remedy = "correct the attitude's reference (Z up), imu.body_from_imu, or the accelerometer's signs"
    return [_fault("attitude-gravity", text, remedy)]
