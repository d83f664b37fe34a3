"""Time within a record at which a motor torque, or a gimbal's rate, steps, for logs with values at record ends only.

A motor holds its torque until the next command acts, which is at no record end if the delay is no whole number of records. The mean speed
over a record then differs from that of its ends by an eighth of the torque's change. The time of the step is that of least free-response
cost (:mod:`massprop_cli.diagnosis.freeresponse`).
"""

from functools import cache, partial

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CLEAR, LONG
from massprop_cli.diagnosis.freeresponse import NEAR, cost, known_impulses, line_minimum, motion_of, residuals
from massprop_cli.diagnosis.segment import bounded
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.timing import Timing

SMOOTH = "gimbal_smooth"
"""Key of gimbal angles that are smooth."""
PARTS = tuple(part / 10 for part in range(1, 10))
"""Initial times over a record. A step at the record's end explains less at the first and at the last of them."""


def with_steps(log: Log, vehicle: Vehicle, timing: Timing) -> tuple[Vehicle, list[Notice]]:
    """Vehicle with the step times, or with smooth gimbals, as the log shows, and notices; unchanged if they are stated."""
    # a sample of the rate depends on speeds at record ends only
    wheels = [f"wheels.{n}" for n, wheel in enumerate(vehicle.wheels) if wheel.column == "speed" and not log.sampled[0]]
    by_records = bool(wheels) or (log.records_per_cycle == 1 and not log.sampled[0])
    rotors = [f"rotors.{n}" for n, apart in enumerate(log.cycles_apart) if apart == 1 and log.command_s is None]
    gyros = [f"control_moment_gyros.{n}" for n in range(len(vehicle.control_moment_gyros)) if not (wheels or rotors or log.sampled[0])]
    devices, setup = wheels or rotors or gyros, Setup(log, vehicle, timing)
    if not devices or _steps_stated(vehicle):
        return vehicle, []
    key = "torque_steps_s" if wheels or rotors else "gimbal_steps_s"
    log = bounded(log, vehicle, timing, [slice(0, log.cycles)], LONG)[0]
    record_s = (1 if wheels else log.records_per_cycle) * float(np.median(log.interval_s))
    motion = motion_of(timing.of(log, vehicle))

    def stated(key: str, part: float) -> Vehicle:
        keys = [f"{one}.{key}" for one in devices]
        return stating(vehicle, {one: True if key == SMOOTH else setup.value(one)[0] + part * record_s for one in keys})

    @cache
    def cost_with(key: str, part: float, summed: bool = False) -> float:
        try:
            rates, _ = residuals(motion, *known_impulses(log, stated(key, part), timing), summed)  # without a force
        except (InputError, np.linalg.LinAlgError):
            return np.inf
        return cost(rates) * log.cycles / len(rates)  # scaled to equal cycles

    # thrust changes the rate permanently, which the rate shows better than its growth
    by_steps = partial(cost_with, key, summed=not wheels)
    has_steps = by_records or not gyros
    if not gyros and not min(by_steps(PARTS[0]), by_steps(PARTS[-1])) < by_steps(0.0):
        return vehicle, []
    part = line_minimum(by_steps, PARTS, PARTS[0], NEAR / 16) if has_steps else 0.0
    latency = line_minimum(partial(cost_with, "speed_latency_s"), PARTS, PARTS[0], NEAR) if wheels else 0.0
    smooth = cost_with(SMOOTH, 1.0, summed=True) if gyros else np.inf
    # a smooth curve has no unknown, a step time has one
    if smooth < min(by_steps(0.0) - CLEAR, by_steps(part) + np.log(log.cycles)):
        text = "gimbal_smooth of control moment gyros is not stated; massprop assumed smooth angle curves, which fit the log best"
        return stated(SMOOTH, 1.0), [Notice("noise-estimated", text)]
    if not by_steps(part) < min(by_steps(0.0), cost_with("speed_latency_s", latency) if wheels else np.inf) - CLEAR:
        return vehicle, []  # a latency explains as much
    who = "wheels" if wheels else "rotors" if rotors else "control moment gyros"
    text = (
        f"{key} of {who} is not stated; massprop estimated {part * record_s:.3g} s after the end of each {'cycle' if rotors else 'record'}"
    )
    return stated(key, part), [Notice("noise-estimated", text)]


def _steps_stated(vehicle: Vehicle) -> bool:
    steps = *(wheel.torque_steps_s for wheel in vehicle.wheels), *(rotor.torque_steps_s for rotor in vehicle.rotors)
    gimbals = [gyro.gimbal_steps_s for gyro in vehicle.control_moment_gyros]
    return any(step is not None for step in (*steps, *gimbals)) or any(gyro.gimbal_smooth for gyro in vehicle.control_moment_gyros)
