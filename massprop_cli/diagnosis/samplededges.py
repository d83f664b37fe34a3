"""A command delay beside which samples show something else at once.

A sample shows the thrust of its moment. Where commands act or end at samples' times, as those of one clock do, what it shows has a step in
the delay there, and a delay that is off by a microsecond makes half of a pulse's samples another's. No derivative tells of that.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import median
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.delay import FoundTiming, fitted, samples_of
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.actuators import opened
from massprop_cli.prepare.clock import by_commands_clock
from massprop_cli.prepare.sensor import ROUNDED_S
from massprop_cli.prepare.timing import Timing

SAME, MANY = 0.01, 0.1
"""Part of a record within which thrust steps at a sample: times are rounded. And part of the steps: a fiftieth does so by chance."""
NEAR = 6.0
"""Sigmas of the delay within which a step is looked at."""


def stepped(log: Log, vehicle: Vehicle, timing: Timing) -> tuple[float, float] | None:
    """Seconds by which thrust begins or ends after the accelerometer's samples, where it does at many, and by how much these times scatter.

    None where what the accelerometer shows has no such steps: it is no sample, a low-pass or a lag rounds it, or clocks are apart.
    """
    low_pass = vehicle.imu.accel_filter
    if not log.sampled[1] or log.command_kind == "rotors" or timing.lag or (low_pass is not None and (low_pass.order or low_pass.open)):
        return None
    sampled_s = by_commands_clock(log, vehicle, log.time_s) - (0.0 if low_pass is None else low_pass.latency)
    acting_s = log.command_start_s + timing.delay * vehicle.cycle.period_s
    if log.command_kind == "jets":
        _, begin_s, lasts_s = opened(acting_s, log.command.T, vehicle)[0]
        acting_s = np.concatenate([edge_s[lasts_s > 0] for edge_s in (begin_s, begin_s + lasts_s)])
    acting_s = acting_s[(acting_s > sampled_s[0]) & (acting_s < sampled_s[-1])]
    place = np.searchsorted(sampled_s, acting_s)
    before, after = acting_s - sampled_s[place - 1], acting_s - sampled_s[place]
    late = np.where(before < -after, before, after)
    late = late[np.abs(late) < SAME * median(log.interval_s)]
    return (float(np.median(late)), float(np.ptp(late))) if late.size > MANY * acting_s.size else None


def beside_samples(begun: Setup, pieces: Sequence[slice], found: FoundTiming, late_s: float, scatter_s: float) -> FoundTiming:
    """As found, or with all commands just before or just after samples that are near, whichever is likeliest.

    ``late_s`` and ``scatter_s`` as :func:`stepped` gives them.
    """
    if abs(late_s) > NEAR * found.sigma.delay * begun.period_s:
        return found
    best, least = found, np.inf
    for later_s in (0.0, scatter_s + 2 * ROUNDED_S - late_s, -scatter_s - 2 * ROUNDED_S - late_s):
        at = found.at._replace(delay=found.at.delay + later_s / begun.period_s)
        left = _left(begun._replace(timing=at), pieces)
        best, least = (replace(found, at=at), left) if left < least else (best, least)
    return best


def _left(setup: Setup, pieces: Sequence[slice]) -> float:
    """What fits of the pieces leave of chi-square, but for a factor; infinite where there is none."""
    assert isinstance(setup.vehicle, Resolved)
    try:
        samples = samples_of(setup)
    except InputError:
        return np.inf
    first = int(np.argmax(samples.executed.usable))
    fits = [(fitted(samples, slice(max(piece.start, first), piece.stop), None, setup.vehicle), piece) for piece in pieces]
    left = [(piece.stop - piece.start) * one.chi_square for one, piece in fits if one is not None]
    return sum(left) if left else np.inf
