"""Errors that a log shows without any hypothesis: gravity in free flight, commands that were not logged."""

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, median
from massprop_cli.diagnosis import NO_CAUSE
from massprop_cli.diagnosis.design import Case
from massprop_cli.inputs.actuators.rotor import SPEED
from massprop_cli.inputs.logtable import LONG
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.model.gyroscopic import products

RARELY, MOSTLY, LEAST = range(2, 41), 0.98, 12
"""Intervals between changes of commands, cycles; part of the changes that must keep the interval; least number of changes."""
UNEQUAL, NEXT_TO = 30.0, 0.75
"""−2 log likelihood ratio per cycle of the n, by which residual variances differ; and the largest ratio of the least to the mean. That
ratio is at least 0.77 for slow controllers with another fault, and at most 0.68 for missing commands."""
WEIGHT, ONE_WAY = 0.03, 0.5
"""Relative difference from gravity within which an accelerometer measures it; mean force over root mean square force, beyond which thrust
may support the vehicle."""


def gravity_felt(case: Case) -> Notice | None:
    """Notice that the accelerometer measures gravity in free flight; None otherwise."""
    log, environment = case.log, case.vehicle.environment
    if environment.kind != "free":
        return None
    samples = case.timing.of(log, case.vehicle)
    specific_force = median(np.linalg.norm(samples.specific_force_m_s2, axis=1))
    thrust = samples.executed.channels.whole @ samples.wrench[:, 3:]
    supported = float(np.linalg.norm(thrust.mean(0))) > ONE_WAY * float(np.sqrt((thrust**2).sum(1).mean()))
    if supported or abs(specific_force / environment.gravity_m_s2 - 1) > WEIGHT:
        return None
    words = f'the accelerometer reads {specific_force:.4g} m/s^2 (median), as on the ground, but environment.kind is "free"'
    return Notice("gravity-felt", f'{words}; state "air_bearing", "pedestal" or "planar"')


def sparse_commands(case: Case) -> str:
    """Sentence that commands were logged more rarely than they were issued; empty otherwise.

    Commands that change only in every n-th cycle may be those of a slow controller. So the motion is regressed on the logged wrench, the
    previous and the next one, for each cycle of the n separately. If all commands are logged, the residual variance is the same in each of
    the n, whatever else is wrong. If not, it is least next to a logged command.
    """
    slow = {rotor.name: each for rotor, each in zip(case.vehicle.rotors, case.log.cycles_apart, strict=False) if each > 1}
    if slow:
        named = ", ".join(SPEED.of(name) for name in slow)
        return (
            f"{NO_CAUSE}: {named} has a speed only every {max(slow.values())} control cycles, and these rotors move the vehicle in "
            "between. Log their speeds in every control cycle, or their commands"
        )
    commands = _each_cycle(case.log)
    interval, first = (1, 0) if commands is None else _rhythm(commands)
    if commands is None or interval == 1:
        return ""
    variance, count = _variance_by_cycle(case, commands, interval, first)
    if not len(variance):
        return ""
    mean = (count * variance).sum(0) / count.sum()
    log_ratio = float((count * np.log(mean / variance)).sum())
    if log_ratio < UNEQUAL * interval or (variance / mean).mean(1).min() > NEXT_TO:
        return ""
    return (
        f"{NO_CAUSE}: logged commands change only every {interval} control cycles, and the motion in between does not follow them. "
        "Probably not every command was logged. Log every command with its time (command_time_s)"
    )


def lost_records(log: Log) -> str:
    """Sentence that records and their commands were lost; empty if none was, or if commands have times of their own."""
    rows = np.flatnonzero(log.interval_s > LONG * median(log.interval_s))
    if log.command_s is not None or not len(rows):
        return ""
    return (
        f"{NO_CAUSE}: {len(rows)} record(s) were lost, the first before {log.time_s[rows[0]]:.6g} s, with their commands. Split the log "
        "there, or record every command with its time (command_time_s)"
    )


def _each_cycle(log: Log) -> Array | None:
    """(K, C) command in force in each control cycle; None if the log begins before the first command."""
    if log.command_s is None:
        return log.command
    rows = np.searchsorted(log.command_s, log.time_s[:: log.records_per_cycle][: log.cycles], "right") - 1
    commands: Array = log.command[rows]
    return None if rows[0] < 0 else commands


def _rhythm(commands: Array) -> tuple[int, int]:
    """Interval of the changes of commands, cycles, and the first of these cycles; interval 1 if they change in any cycle."""
    changes = np.flatnonzero((np.diff(commands, axis=0) != 0).any(1)) + 1
    if len(changes) < LEAST:
        return 1, 0
    return max(((n, at) for n in RARELY for at in range(n) if np.mean(changes % n == at) > MOSTLY), default=(1, 0))


def _variance_by_cycle(case: Case, commands: Array, interval: int, first: int) -> tuple[Array, Array]:
    """Residual variances of each of the n cycles: (n, 6) of rates and specific force, and (n, 1) degrees of freedom.

    Empty for a short log.
    """
    samples, empty = case.timing.of(case.log, case.vehicle), np.zeros((0, 1))
    wrench = commands @ samples.executed.channels.wrench[: commands.shape[1]]
    wrench = wrench[:, np.ptp(wrench, axis=0) > 0]
    rate = samples.rate_rad_s
    body_columns = [products(rate), samples.up_b[:-1], np.ones((len(rate), 1))]
    regressors = np.hstack([np.roll(wrench, interval, 0), wrench, np.roll(wrench, -interval, 0), *body_columns])
    regressors = regressors / np.maximum(np.sqrt((regressors**2).mean(0)), TINY)
    motion = np.hstack([np.diff(rate, axis=0, prepend=rate[:1]), samples.specific_force_m_s2])
    usable = np.arange(2 * interval, len(rate) - 2 * interval)
    variances, counts = [], []
    for cycle in range(interval):
        of_cycle = usable[(usable - first) % interval == cycle]
        if len(of_cycle) - regressors.shape[1] < LEAST:
            return empty, empty
        residual = motion[of_cycle] - regressors[of_cycle] @ np.linalg.lstsq(regressors[of_cycle], motion[of_cycle], rcond=ROUNDING)[0]
        counts.append(len(of_cycle) - regressors.shape[1])
        variances.append((residual**2).sum(0) / counts[-1] + TINY)
    return np.array(variances), np.array(counts)[:, None]
