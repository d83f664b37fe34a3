"""When within a record the torque on wheels steps, of logs that have their speeds at the records' ends alone.

A motor holds its torque until the next command acts, which is at no record's end where the delay is no whole number of records. The mean
speed over a record is then not that of its ends: by an eighth of the torque's change over a record, and the rate shows it. Free
coefficients (:func:`massprop_cli.diagnosis.freeresponse.unexplained_by`) tell from when on in a record the torque is another.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.freeresponse import motion_of, unexplained_by
from massprop_cli.diagnosis.linesearch import NEAR, line_minimum
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.segment import bounded
from massprop_cli.errorparameters.setup import stating
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.timing import Timing

LONGEST = 1200
"""Cycles that are looked at."""
PARTS = tuple(part / 10 for part in range(1, 10))
"""Of a record, at which the search begins; one that bends at its end explains less at the first and at the last of them."""


def with_steps(log: Log, vehicle: Vehicle, timing: Timing) -> tuple[Vehicle, list[Notice]]:
    """The vehicle with ``torque_steps_s`` of wheels as the log shows it where it is not stated, and what to tell of it."""
    own = [n for n, wheel in enumerate(vehicle.wheels) if wheel.column == "speed"]
    known = any(vehicle.wheels[n].torque_steps_s is not None for n in own)
    # a sample of the rate shows what speeds at the records' ends do, however they came there
    if not own or known or log.sampled[0] or log.records_per_cycle > 1:
        return vehicle, []
    log, record_s = bounded(log, vehicle, timing, [slice(0, log.cycles)], LONGEST)[0], float(np.median(log.interval_s))
    motion = motion_of(timing.of(log, vehicle))

    def stated(key: str, part: float) -> Vehicle:
        older_s = [getattr(vehicle.wheels[n], key) or 0.0 for n in own]
        return stating(vehicle, {f"wheels.{n}.{key}": stated_s + part * record_s for n, stated_s in zip(own, older_s, strict=True)})

    @cache
    def left(key: str, part: float) -> float:
        try:
            return unexplained_by(log, stated(key, part), timing, motion=motion)[0]  # no force goes with it
        except (InputError, np.linalg.LinAlgError):
            return np.inf

    by_steps = partial(left, "torque_steps_s")
    if not min(by_steps(PARTS[0]), by_steps(PARTS[-1])) < by_steps(0.0):
        return vehicle, []
    part = line_minimum(by_steps, PARTS, PARTS[0], NEAR / 16)
    older = line_minimum(partial(left, "speed_latency_s"), PARTS, PARTS[0], NEAR)
    if not by_steps(part) < min(by_steps(0.0), left("speed_latency_s", older)) - CLEAR:
        return vehicle, []  # as well they are older
    said = f"torque_steps_s of wheels is not stated; {part * record_s:.3g} s after a record's end was estimated from the log"
    return stated("torque_steps_s", part), [Notice("noise-estimated", said)]
