"""What the numbers of a log that doesn't fit show by themselves, before any hypothesis: gravity, commands that were not logged."""

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, median
from massprop_cli.diagnosis.design import Case
from massprop_cli.inputs.actuators.rotor import SPEED
from massprop_cli.inputs.logtable import LONG
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.model.gyroscopic import products

RARELY, MOSTLY, LEAST = range(2, 41), 0.98, 12
"""Cycles after which commands may change, part of the changes that come so, and how many there must be."""
UNEQUAL, NEXT_TO = 30.0, 0.75
"""−2 log likelihood ratio, per cycle of the n, by which residual variances differ; and the least of them over their mean. The latter is
0.77 or more of slow controllers with another fault, and 0.68 or less where commands are missing."""
WEIGHT, ONE_WAY = 0.03, 0.5
"""Part of gravity within which an accelerometer feels it; part of its usual size beyond which a mean force may hold a vehicle up."""


def seen(case: Case) -> Notice | None:
    """What the numbers themselves show of a log that doesn't fit."""
    log, environment = case.log, case.vehicle.environment
    if environment.kind != "free":
        return None
    samples = case.timing.of(log, case.vehicle)
    felt = median(np.linalg.norm(samples.specific_force_m_s2, axis=1))
    pushed = samples.executed.channels.whole @ samples.wrench[:, 3:]
    held_up = float(np.linalg.norm(pushed.mean(0))) > ONE_WAY * float(np.sqrt((pushed**2).sum(1).mean()))
    if held_up or abs(felt / environment.gravity_m_s2 - 1) > WEIGHT:
        return None
    words = f'the accelerometer feels {felt:.4g} m/s^2 (median), as on the ground, and environment.kind is "free"'
    return Notice("gravity-felt", f'{words}; state "air_bearing", "pedestal" or "planar"')


def sparse(case: Case) -> str:
    """A sentence that commands were logged more rarely than given; empty where that is not so.

    Commands that change in every n-th cycle alone may be those of a slow controller. So the motion is regressed on the logged wrench, the
    one before and the one behind it, for each cycle of the n separately. If all commands are logged, the residual variance is the same in
    each of the n, whatever else is wrong. If not, it is least next to a logged command.
    """
    slow = {rotor.name: each for rotor, each in zip(case.vehicle.rotors, case.log.cycles_apart, strict=False) if each > 1}
    if slow:
        named = ", ".join(SPEED.of(name) for name in slow)
        return (
            f"log and vehicle file don't fit, cause unknown: {named}: a speed in every {max(slow.values())}. control cycle alone, and what "
            "these rotors do in between moves the vehicle. Log their speeds in every control cycle, or their commands"
        )
    given = _each_cycle(case.log)
    every, first = (1, 0) if given is None else _rhythm(given)
    if given is None or every == 1:
        return ""
    variance, count = _left_between(case, given, every, first)
    if not len(variance):
        return ""
    mean = (count * variance).sum(0) / count.sum()
    unequal = float((count * np.log(mean / variance)).sum())
    if unequal < UNEQUAL * every or (variance / mean).mean(1).min() > NEXT_TO:
        return ""
    return (
        f"log and vehicle file don't fit, cause unknown: logged commands change only in every {every}. control cycle, and the motion in "
        "between does not follow them. Probably not every command was logged. Log every command with its time (command_time_s)"
    )


def lost(log: Log) -> str:
    """A sentence that records were lost, and commands in them; empty where none was, or commands have times of their own."""
    rows = np.flatnonzero(log.interval_s > LONG * median(log.interval_s))
    if log.command_s is not None or not len(rows):
        return ""
    return (
        f"log and vehicle file don't fit, cause unknown: {len(rows)} record(s) were lost, the first before {log.time_s[rows[0]]:.6g} s, "
        "and what was commanded in them is not in the log. Split the log there, or record every command with its time (command_time_s)"
    )


def _each_cycle(log: Log) -> Array | None:
    """(K, C) the command that stands in each control cycle; None where the log begins before them."""
    if log.command_s is None:
        return log.command
    rows = np.searchsorted(log.command_s, log.time_s[:: log.records_per_cycle][: log.cycles], "right") - 1
    found: Array = log.command[rows]
    return None if rows[0] < 0 else found


def _rhythm(given: Array) -> tuple[int, int]:
    """After how many cycles commands change, and in which first; 1 where they do in any."""
    rows = np.flatnonzero((np.diff(given, axis=0) != 0).any(1)) + 1
    if len(rows) < LEAST:
        return 1, 0
    return max(((n, at) for n in RARELY for at in range(n) if np.mean(rows % n == at) > MOSTLY), default=(1, 0))


def _left_between(case: Case, given: Array, every: int, first: int) -> tuple[Array, Array]:
    """(n, 6) residual variance of rates and specific force in each of the n cycles, and (n, 1) degrees of freedom; empty of a short log."""
    samples, none = case.timing.of(case.log, case.vehicle), np.zeros((0, 1))
    wrench = given @ samples.executed.channels.wrench[: given.shape[1]]
    wrench = wrench[:, np.ptp(wrench, axis=0) > 0]
    rate = samples.rate_rad_s
    load = [products(rate), samples.up_b[:-1], np.ones((len(rate), 1))]
    causes = np.hstack([np.roll(wrench, every, 0), wrench, np.roll(wrench, -every, 0), *load])
    causes = causes / np.maximum(np.sqrt((causes**2).mean(0)), TINY)
    moved = np.hstack([np.diff(rate, axis=0, prepend=rate[:1]), samples.specific_force_m_s2])
    inner = np.arange(2 * every, len(rate) - 2 * every)
    left, counts = [], []
    for cycle in range(every):
        own = inner[(inner - first) % every == cycle]
        if len(own) - causes.shape[1] < LEAST:
            return none, none
        rest = moved[own] - causes[own] @ np.linalg.lstsq(causes[own], moved[own], rcond=ROUNDING)[0]
        counts.append(len(own) - causes.shape[1])
        left.append((rest**2).sum(0) / counts[-1] + TINY)
    return np.array(left), np.array(counts)[:, None]
