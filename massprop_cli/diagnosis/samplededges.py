"""Estimation of a command delay near which a sample's thrust steps.

A sample shows the thrust at its time. If commands act or end at sample times, on one clock, the sample is a step function of the delay. An
error of a microsecond changes half of a pulse's samples, and derivatives do not show it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import median
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CERTAIN
from massprop_cli.diagnosis.delay import FoundTiming, fit_near, samples_of
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.actuators import pulse_parts
from massprop_cli.prepare.clock import by_commands_clock
from massprop_cli.prepare.sensor import ROUNDED_S
from massprop_cli.prepare.timing import Timing

SAME, MANY = 0.01, 0.1
"""Distance of a thrust step from a sample, in records, at which they coincide; part of the steps that must. A fiftieth does by chance."""


def steps_at_samples(log: Log, vehicle: Vehicle, timing: Timing) -> tuple[float, float] | None:
    """Mean delay of thrust steps after the accelerometer's samples, and its range, s, if many coincide.

    None if the accelerometer's data have no such steps: no samples, a low-pass or a lag, or separate clocks.
    """
    low_pass = vehicle.imu.accel_filter
    if not log.sampled[1] or log.command_kind == "rotors" or timing.lag or (low_pass is not None and (low_pass.order or low_pass.open)):
        return None
    sampled_s = by_commands_clock(log, vehicle, log.time_s) - (0.0 if low_pass is None else low_pass.latency)
    acting_s = log.command_start_s + timing.delay * vehicle.cycle.period_s
    if log.command_kind == "jets":
        _, begin_s, lasts_s = pulse_parts(acting_s, log.command.T, vehicle)[0]
        acting_s = np.concatenate([edge_s[lasts_s > 0] for edge_s in (begin_s, begin_s + lasts_s)])
    acting_s = acting_s[(acting_s > sampled_s[0]) & (acting_s < sampled_s[-1])]
    place = np.searchsorted(sampled_s, acting_s)
    before, after = acting_s - sampled_s[place - 1], acting_s - sampled_s[place]
    offset = np.where(before < -after, before, after)
    offset = offset[np.abs(offset) < SAME * median(log.interval_s)]
    return (float(np.median(offset)), float(np.ptp(offset))) if offset.size > MANY * acting_s.size else None


def near_samples(setup: Setup, pieces: Sequence[slice], found: FoundTiming, late_s: float, scatter_s: float) -> FoundTiming:
    """Timing as found, or with all commands just before or just after nearby samples, whichever has the least chi-square.

    ``late_s`` and ``scatter_s``: from :func:`steps_at_samples`.
    """
    if abs(late_s) > CERTAIN * found.sigma.delay * setup.period_s:
        return found
    best, least = found, np.inf
    for shift_s in (0.0, scatter_s + 2 * ROUNDED_S - late_s, -scatter_s - 2 * ROUNDED_S - late_s):
        at = found.at._replace(delay=found.at.delay + shift_s / setup.period_s)
        chi_square = _chi_square(setup._replace(timing=at), pieces)
        best, least = (replace(found, at=at), chi_square) if chi_square < least else (best, least)
    return best


def _chi_square(setup: Setup, pieces: Sequence[slice]) -> float:
    """Chi-square of fits over the pieces, up to a factor; infinite without a fit."""
    assert isinstance(setup.vehicle, Resolved)
    try:
        samples = samples_of(setup)
    except InputError:
        return np.inf
    first_usable = int(np.argmax(samples.executed.usable))
    fits = [(fit_near(samples, slice(max(piece.start, first_usable), piece.stop), None, setup.vehicle), piece) for piece in pieces]
    chi_squares = [(piece.stop - piece.start) * one.chi_square for one, piece in fits if one is not None]
    return sum(chi_squares) if chi_squares else np.inf
