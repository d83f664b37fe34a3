"""When within a record the torque on wheels or rotors, or a gimbal's rate, steps, of logs that have them at the records' ends alone.

A motor holds its torque until the next command acts, which is at no record's end where the delay is no whole number of records. The mean
speed over a record is then not that of its ends: by an eighth of the torque's change over a record, and the rate shows it. Free
coefficients (:mod:`massprop_cli.diagnosis.freeresponse`) tell from when on in a record the torque is another.
"""

from functools import cache, partial

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.freeresponse import NEAR, commanded, cost, line_minimum, motion_of, residuals
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.segment import bounded
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.timing import Timing

SMOOTH = "gimbal_smooth"
"""The key of angles that don't bend."""
LONGEST = 6000
"""Cycles that are looked at. A quiet bend of 2 ms records that moves values by 5 sigma in 40 s is not told by 1,200."""
PARTS = tuple(part / 10 for part in range(1, 10))
"""Of a record, at which the search begins; one that bends at its end explains less at the first and at the last of them."""


def with_steps(log: Log, vehicle: Vehicle, timing: Timing) -> tuple[Vehicle, list[Notice]]:
    """The vehicle with ``torque_steps_s`` of wheels or rotors, or how gimbals turn, as the log shows it, and what to tell of it.

    As stated where it is.
    """
    # a sample of the rate shows what speeds of wheels at the records' ends do, however they came there
    wheels = [f"wheels.{n}" for n, wheel in enumerate(vehicle.wheels) if wheel.column == "speed" and not log.sampled[0]]
    by_records = bool(wheels) or (log.records_per_cycle == 1 and not log.sampled[0])
    rotors = [f"rotors.{n}" for n, apart in enumerate(log.cycles_apart) if apart == 1 and log.command_s is None]
    gyros = [f"control_moment_gyros.{n}" for n in range(len(vehicle.control_moment_gyros)) if not (wheels or rotors or log.sampled[0])]
    own, setup = wheels or rotors or gyros, Setup(log, vehicle, timing)
    if not own or _stated(vehicle):
        return vehicle, []
    key = "torque_steps_s" if wheels or rotors else "gimbal_steps_s"
    log = bounded(log, vehicle, timing, [slice(0, log.cycles)], LONGEST)[0]
    record_s = (1 if wheels else log.records_per_cycle) * float(np.median(log.interval_s))
    motion = motion_of(timing.of(log, vehicle))

    def stated(key: str, part: float) -> Vehicle:
        keys = [f"{one}.{key}" for one in own]
        return stating(vehicle, {one: True if key == SMOOTH else setup.value(one)[0] + part * record_s for one in keys})

    @cache
    def left(key: str, part: float, summed: bool = False) -> float:
        try:
            rates, _ = residuals(motion, *commanded(log, stated(key, part), timing), summed)  # no force goes with it
        except (InputError, np.linalg.LinAlgError):
            return np.inf
        return cost(rates) * log.cycles / len(rates)  # by as many cycles, though the ends tell less by some

    # what thrust turns the vehicle by stays, and the rate shows it more sharply than its growth
    by_steps = partial(left, key, summed=not wheels)
    bends = by_records or not gyros
    if not gyros and not min(by_steps(PARTS[0]), by_steps(PARTS[-1])) < by_steps(0.0):
        return vehicle, []
    part = line_minimum(by_steps, PARTS, PARTS[0], NEAR / 16) if bends else 0.0
    older = line_minimum(partial(left, "speed_latency_s"), PARTS, PARTS[0], NEAR) if wheels else 0.0
    smooth = left(SMOOTH, 1.0, summed=True) if gyros else np.inf
    # a curve has no unknown, and where bends are has one
    if smooth < min(by_steps(0.0) - CLEAR, by_steps(part) + np.log(log.cycles)):
        said = "gimbal_smooth of control moment gyros is not stated; the log shows that their angles are smooth curves"
        return stated(SMOOTH, 1.0), [Notice("noise-estimated", said)]
    if not by_steps(part) < min(by_steps(0.0), left("speed_latency_s", older) if wheels else np.inf) - CLEAR:
        return vehicle, []  # as well they are older
    who = "wheels" if wheels else "rotors" if rotors else "control moment gyros"
    said = (
        f"{key} of {who} is not stated; {part * record_s:.3g} s after a {'cycle' if rotors else 'record'}'s end was estimated from the log"
    )
    return stated(key, part), [Notice("noise-estimated", said)]


def _stated(vehicle: Vehicle) -> bool:
    steps = *(wheel.torque_steps_s for wheel in vehicle.wheels), *(rotor.torque_steps_s for rotor in vehicle.rotors)
    gimbals = [gyro.gimbal_steps_s for gyro in vehicle.control_moment_gyros]
    return any(step is not None for step in (*steps, *gimbals)) or any(gyro.gimbal_smooth for gyro in vehicle.control_moment_gyros)
