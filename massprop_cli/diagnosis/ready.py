"""A log made ready to be estimated: its timing, its samples in phases, and without the readings that are none of the motion."""

from __future__ import annotations

from typing import NamedTuple

from massprop_cli.diagnosis import outliers
from massprop_cli.diagnosis.delay import Found
from massprop_cli.diagnosis.resolve import found_timing, stated_timing, uncertain_timing, with_timing
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs.telemetry import Log, Notice
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.sensitivity import Consider, with_geometry
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing


class Ready(NamedTuple):
    """What an estimator starts from."""

    log: Log
    """Without outliers."""
    stated: Vehicle
    """With its timing resolved."""
    samples: Stream
    phases: list[tuple[Phase, slice]]
    timing: Timing
    """Delay and lag as used, cycles."""
    detected: Found | None
    """What the log says of them, where the vehicle file leaves them to it."""
    consider: Consider
    """Delay, lag and geometry where they are uncertain."""
    notices: list[Notice]


def ready(log: Log, source: VehicleSource, say: Progress) -> Ready:
    """:class:`massprop_cli.base.errors.InputError` where a phase holds too little, or timing can't be told."""
    detected = found_timing(log, source, say)
    timing = stated_timing(source.vehicle) if detected is None else detected.at
    stated = with_timing(source.vehicle, detected)
    samples = Stream.of(log, stated, timing)
    phases = phases_of(log, stated, samples)
    read, told = log, list[Notice]()
    if stated.estimator.method == "default":
        stated, told = outliers.screened(log, stated, samples, [cycles for _, cycles in phases])
        log = outliers.without(log, stated)
    if log is not read:
        samples = Stream.of(log, stated, timing)
    consider = with_geometry(uncertain_timing(log, stated, timing), log, stated, samples)
    return Ready(log, stated, samples, phases, timing, detected, consider, told)
