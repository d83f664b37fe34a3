"""Causal pass over a recorded log by the same kernel calls that run in flight.

The kernel does alignment and mounting here, so a replay equals the flight to the last bit. Both agree with :mod:`massprop_cli.prepare` to
rounding.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import BLOCK
from massprop_cli.base.rigidbody import elements
from massprop_cli.estimate import compiled
from massprop_cli.estimate.compiled import ROW_SIZE
from massprop_cli.estimate.quantities import mass_first
from massprop_cli.estimate.rows import Rows
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import COMMANDS, LAGS, PENDING, Kernel, kernel, pointer
from massprop_cli.model.kernelargs import check_status
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.actuators import LATE
from massprop_cli.prepare.align import lost_commands, shown_by_s
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.compensate import Source, biased_attitude
from massprop_cli.prepare.sensor import Recorder, SensorKernel, body_kernel, sensors
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.sums import of_records
from massprop_cli.prepare.timing import Timing

VALUES = 30
"""Size of a report: value, sigma and verdict of each of the ten quantities."""
VERDICTS = ("untold", "not_excited", "not_converged", "converged", "contradicted")
"""Verdicts, in the order of the kernel's numbers."""
NO_TOLERANCE = (0.0, 0.0, 0.0)


def unsupported(log: Recorder, vehicle: Vehicle, timing: Timing, shortest_s: float) -> str:
    """Why the kernel does not support the timing of commands or the IMU; empty if it does."""
    gyro, accelerometer = sensors(log, vehicle)
    kernels = (body_kernel(gyro), gyro, accelerometer)
    if vehicle.wheels and not all(each.plain for each in kernels):
        return 'imu.measures is "sample" or a filter of the IMU is stated with [[wheels]], but the kernel then assumes plain increments'
    if _least_delay_s(log, vehicle, timing) < 0:
        return "a latency of the IMU is below 0, so the kernel would need commands that do not exist yet"
    if vehicle.imu.clock_drift_ppm != 0:
        return "imu.clock_drift_ppm is not 0, but the kernel supports one clock"
    if any(vehicle.imu.gyro_bias_rad_s):
        return "imu.gyro_bias_rad_s is not 0, but the kernel does not correct a gyro bias"
    if vehicle.imu.gyro_lag_s != 0 or vehicle.imu.accel_lag_s != 0:
        return "imu.gyro_lag_s or imu.accel_lag_s is not 0, but the kernel does not undo a low-pass"
    if vehicle.imu.accel_axes != "imu":
        return 'imu.accel_axes is "start", but the kernel assumes increments in the IMU\'s own axes'
    if any(vehicle.thrust.wrench_point_m):
        return "thrust.wrench_point_m is not O, but the kernel assumes torques about O"
    if vehicle.thrust.wrench_limits is not None:
        return "thrust.wrench_limits are stated, but the kernel assumes the commanded wrench"
    if vehicle.thrust.droop != 0 or vehicle.thrust.cycle_droop != 0:
        return "thrust.droop or thrust.cycle_droop is not 0, but the kernel assumes that jets do not affect each other"
    if vehicle.thrust.least_on_s or vehicle.thrust.dead_on_s:
        return "thrust.least_on_s or thrust.dead_on_s is not 0, but the kernel assumes the commanded duration of pulses"
    if vehicle.thrust.failures:
        return "thrust.failures is not empty, but the kernel assumes constant thrust of each jet"
    if vehicle.thrust.nominal_pa is not None:
        return "thrust.nominal_pa is stated, but the kernel assumes the same thrust at any pressure"
    if any(wheel.speed_latency_s or wheel.speed_window_s or wheel.torque_steps_s for wheel in vehicle.wheels):
        keys = "speed_latency_s, speed_window_s or torque_steps_s"
        return f"{keys} of a wheel is not 0, but the kernel assumes speeds at the end of each cycle, linear in between"
    if vehicle.rotors:
        return "[[rotors]] are stated, but the kernel supports only commands of jets or a wrench"
    if len(vehicle.jets) > COMMANDS:
        return f"{len(vehicle.jets)} jets, but the limit of the kernel is {COMMANDS}"
    longest_s = max((jet.rise_s + jet.fall_s + jet.delay_s for jet in vehicle.jets), default=0.0) + max(each.latency_s for each in kernels)
    if (timing.delay * vehicle.cycle.period_s + longest_s) / shortest_s + 4 >= PENDING:
        return f"a delay of {timing.delay:g} cycles, but the limit of the kernel is {PENDING - 5}, including rise, fall and latencies"
    return ""


def _least_delay_s(log: Recorder, vehicle: Vehicle, timing: Timing) -> float:
    """Least time from the start of a cycle to an effect of its command, s."""
    gyro, accelerometer = sensors(log, vehicle)
    least_s = min((jet.delay_s for jet in vehicle.jets), default=0.0) + min(gyro.latency_s, accelerometer.latency_s)
    return timing.delay * vehicle.cycle.period_s + least_s


def supports(samples: Source) -> bool:
    """Whether the kernel can align the commands of these samples, which must be as read from the log.

    It cannot with momentum devices, whose log may have more records, nor where a gyro bias drives the attitude error, which the flight's
    estimate corrects.
    """
    if not isinstance(samples, Stream) or samples.gyro != 1.0 or samples.log.spinning:
        return False
    if biased_attitude(samples.attitude_logged, samples.vehicle):
        return False
    log = samples.log
    if log.command_s is not None or lost_commands(log) or not all(sensor.plain for sensor in sensors(log, samples.vehicle)):
        return False
    shortest = float(log.interval_s.reshape(-1, log.records_per_cycle).sum(1).min())
    return not unsupported(log, samples.vehicle, samples.alignment.timing, shortest)


class Reported(NamedTuple):
    """Report after each of K cycles."""

    rows: Rows
    values: Array
    """(K, 10) SI units."""
    sigmas: Array
    """(K, 10) one sigma of each."""
    verdicts: Array
    """(K, 10) indices in :data:`VERDICTS`."""


class Flight:
    """The kernel's state of a flight, from its first cycle."""

    def __init__(self, commands: Array, vehicle: Array, rule: Array, by: Kernel | None = None) -> None:
        library = (by or kernel()).compiled
        self.library = library
        self._memory = np.empty(library.mp_host_flight_size(), np.uint8)
        self.memory = pointer(self._memory)
        check_status(library.mp_host_fly(self.memory, pointer(commands), pointer(vehicle), pointer(rule)))

    def phase(self, vehicle: Array, rule: Array) -> None:
        """Start a new phase with the next cycle; executing commands and attitude continue."""
        check_status(self.library.mp_host_phase(self.memory, pointer(vehicle), pointer(rule)))

    def step(self, cycles: Array, last: bool = False) -> Reported:
        """Process the next cycles (:func:`cycles_of`); ``last``: no more follow."""
        rows, values, status = np.empty((len(cycles) + 1, ROW_SIZE)), np.empty((len(cycles) + 1, VALUES)), ctypes.c_int()
        count, stride = (ctypes.c_long(n) for n in cycles.shape)
        arguments = (count, stride, pointer(cycles), ctypes.c_int(last), pointer(rows), pointer(values), ctypes.byref(status))
        reported = self.library.mp_host_flown(self.memory, *arguments)
        check_status(status.value)
        values = values[:reported]
        return Reported(compiled.rows_of(rows[:reported]), values[:, :10], values[:, 10:20], values[:, 20:])

    def last(self) -> Reported:
        """Process the cycle that waits for the next one's commands, when no more follow."""
        return self.step(np.empty((0, 1)), last=True)

    def reference(self, vehicle: Vehicle) -> Reference | None:
        """The estimate at the end; None if there is none."""
        return compiled.reference_of(self.library, ctypes.c_void_p(self.library.mp_host_pass(self.memory)), vehicle)


def replayed(
    samples: Stream, cycles: slice, vehicle: Resolved, progress: Callable[[float], None] | None
) -> tuple[Iterator[Rows], Callable[[], Reference | None]]:
    """Estimates after each of ``cycles``, chunk by chunk, and a function that returns the final estimate."""
    log = samples.log
    commands = commands_of(log, log.command_kind == "jets", vehicle, samples.alignment.timing, log.records_per_cycle)
    flight = Flight(commands, compiled.vehicle_numbers(samples, vehicle), rule_of(vehicle, NO_TOLERANCE))

    def rows() -> Iterator[Rows]:
        # a pulse may continue into the cycle after the last one
        end = min(cycles.stop + 1, log.cycles)
        for begin in range(0, end, BLOCK):
            if progress is not None:
                progress(begin / end)
            part = slice(begin, min(begin + BLOCK, end))
            yield flight.step(cycles_of(log, part, cycles), part.stop == end).rows

    return rows(), lambda: flight.reference(vehicle)


RECORDS, WAITS, DELAY_S, MEMORY_S = 2, 3, 5, 6
"""Indices in :func:`commands_of`: records per cycle; whether the estimate of a cycle waits for the next one's commands; the commands'
delay, s; time after a command until no sensor shows an earlier one, s."""


def commands_of(log: Recorder, jets: bool, vehicle: Vehicle, timing: Timing, records: int) -> Array:
    """(n,) constants of commands and IMU, in the order of ``mp_host_fly``; ``records`` per cycle."""
    count, period_s = len(vehicle.jets) if jets else 6, vehicle.cycle.period_s
    delay_s, lag_s = timing.delay * period_s, timing.lag * period_s
    each = np.zeros((count, 9))
    if jets:
        each[:, :6] = vehicle.jet_wrench
        each[:, 6:] = np.reshape([(jet.rise_s, jet.fall_s, jet.delay_s) for jet in vehicle.jets], (-1, 3))
    unlagged, lagging = sensors(log, vehicle), sensors(log, vehicle, lag_s)
    sensor_numbers = [number for one in (body_kernel(unlagged[0], lag_s), *lagging) for number in _sensor_numbers(one)]
    early_s = period_s / records / 2 if unlagged[0].instant else 0.0
    waits = _least_delay_s(log, vehicle, timing) - early_s < period_s
    times = period_s, delay_s, shown_by_s(log, vehicle, delay_s, lag_s), LATE[vehicle.cycle.pulse_at], vehicle.thrust.pulse_sigma
    mounting = (*np.array(vehicle.imu.body_from_imu).ravel(), *vehicle.environment.initial_attitude_wxyz)
    return np.array([jets, count, records, waits, *times, *mounting, *sensor_numbers, *each.ravel()], dtype=float)


def _sensor_numbers(sensor: SensorKernel) -> Iterator[float]:
    """Numbers of a sensor kernel, in the order of ``mp_sensor``."""
    padding = np.zeros(LAGS - len(sensor.lags_s), dtype=complex)
    yield from (sensor.instant, len(sensor.lags_s), sensor.latency_s)
    for each in (sensor.weights, sensor.lags_s):
        yield from np.concatenate([each, padding]).view(float).tolist()


def rule_of(vehicle: Vehicle, tolerances: tuple[float, float, float], relative: bool = True, gate: float = 0.0) -> Array:
    """(n,) known values, gate, and convergence criterion, in the order of ``mp_host_fly``.

    ``gate``: number of sigmas of a sensor's innovation above which the reading is not used; 0: all readings are used.
    """
    known = [number for name, k in mass_first(vehicle.known) for number in (QUANTITIES.index(name), k.value, k.sigma)]
    rule = (vehicle.thrust.scale_sigma, vehicle.convergence.count, relative, *tolerances)
    beyond_reported: Array = sum((elements(device.beyond_reported) for device in vehicle.spinning), np.zeros(6))
    return np.array([*rule, *beyond_reported, gate, len(vehicle.known), *known], dtype=float)


def cycles_of(log: Log, part: slice, used: slice) -> Array:
    """(K, …) cycles of a log, in the kernel's order; those outside ``used`` are aligned, but their readings are not used."""
    records = log.records_per_cycle
    each = slice(part.start * records, part.stop * records)

    count = part.stop - part.start
    ignored = np.tile([not any(log.axes[:3]), not any(log.axes[3:])], (count, 1))
    ignored = ignored if log.ignored is None else ignored | log.ignored[part]
    cycle = np.arange(part.start, part.stop)
    unused = (cycle < used.start) | (cycle >= used.stop)
    delta_theta, delta_v = (of_records(one[each], records) for one in (log.delta_theta_imu_rad, log.delta_v_imu_m_s))
    parts = (log.cycle_end_s[part], cycle_edges(log, part)[1], delta_theta, delta_v, ignored, unused)
    speeds = [
        wheel.speed_rad_s[records - 1 :: records][part]
        for wheel in log.spinning
        if isinstance(wheel, WheelLog) and wheel.speed_rad_s is not None
    ]
    return np.concatenate([one.reshape(count, -1) for one in (*parts, log.command[part], *speeds)], 1, dtype=float)
