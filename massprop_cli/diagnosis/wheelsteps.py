"""When within a record the torque on wheels or rotors steps, of logs that have their speeds at the records' ends alone.

A motor holds its torque until the next command acts, which is at no record's end where the delay is no whole number of records. The mean
speed over a record is then not that of its ends: by an eighth of the torque's change over a record, and the rate shows it. Free
coefficients (:mod:`massprop_cli.diagnosis.freeresponse`) tell from when on in a record the torque is another.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np

from massprop_cli.base.arrays import TINY
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.freeresponse import commanded, motion_of, residuals
from massprop_cli.diagnosis.linesearch import NEAR, line_minimum
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.segment import bounded
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.timing import Timing

LONGEST = 1200
"""Cycles that are looked at."""
PARTS = tuple(part / 10 for part in range(1, 10))
"""Of a record, at which the search begins; one that bends at its end explains less at the first and at the last of them."""


def with_steps(log: Log, vehicle: Vehicle, timing: Timing) -> tuple[Vehicle, list[Notice]]:
    """The vehicle with ``torque_steps_s`` of wheels or rotors as the log shows it where it is not stated, and what to tell of it."""
    # a sample of the rate shows what speeds of wheels at the records' ends do, however they came there
    by_records = log.records_per_cycle == 1 and not log.sampled[0]
    wheels = [f"wheels.{n}" for n, wheel in enumerate(vehicle.wheels) if wheel.column == "speed" and by_records]
    rotors = [f"rotors.{n}" for n, apart in enumerate(log.cycles_apart) if apart == 1 and log.command_s is None]
    own, setup = wheels or rotors, Setup(log, vehicle, timing)
    if not own or _stated(vehicle):
        return vehicle, []
    log = bounded(log, vehicle, timing, [slice(0, log.cycles)], LONGEST)[0]
    record_s = log.records_per_cycle * float(np.median(log.interval_s))
    motion = motion_of(timing.of(log, vehicle))

    def stated(key: str, part: float) -> Vehicle:
        return stating(vehicle, {f"{one}.{key}": setup.value(f"{one}.{key}")[0] + part * record_s for one in own})

    @cache
    def left(key: str, part: float, summed: bool = False) -> float:
        try:
            rates, _ = residuals(motion, *commanded(log, stated(key, part), timing), summed)  # no force goes with it
        except (InputError, np.linalg.LinAlgError):
            return np.inf
        return len(rates) * float(np.log((rates**2).mean(0) + TINY).sum())

    by_steps = partial(left, "torque_steps_s")
    if not min(by_steps(PARTS[0]), by_steps(PARTS[-1])) < by_steps(0.0):
        return vehicle, []
    # what thrust turns the vehicle by stays, and the rate shows it more sharply than its growth
    by_steps = partial(by_steps, summed=not wheels)
    part = line_minimum(by_steps, PARTS, PARTS[0], NEAR / 16)
    older = line_minimum(partial(left, "speed_latency_s"), PARTS, PARTS[0], NEAR) if wheels else 0.0
    if not by_steps(part) < min(by_steps(0.0), left("speed_latency_s", older) if wheels else np.inf) - CLEAR:
        return vehicle, []  # as well they are older
    said = (
        f"torque_steps_s of {'wheels' if wheels else 'rotors'} is not stated; {part * record_s:.3g} s after a "
        f"{'record' if wheels else 'cycle'}'s end was estimated from the log"
    )
    return stated("torque_steps_s", part), [Notice("noise-estimated", said)]


def _stated(vehicle: Vehicle) -> bool:
    steps = *(wheel.torque_steps_s for wheel in vehicle.wheels), *(rotor.torque_steps_s for rotor in vehicle.rotors)
    return any(step is not None for step in steps)
