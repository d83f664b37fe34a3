"""The causal pass of :mod:`massprop_cli.estimate.engine` on the compiled kernel (:mod:`massprop_cli.kernel`)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.estimate.initial import reach
from massprop_cli.estimate.rows import Rows
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import BINS, kernel
from massprop_cli.model.linearise import RATE, Layout
from massprop_cli.model.plant import Reference
from massprop_cli.model.sensitivity import Consider
from massprop_cli.model.system import drift, prior
from massprop_cli.prepare.compensate import Mounted, Samples, Source

CHUNK = 512
"""Cycles handed over at a time."""
TOLD = 128
"""Numbers that come back of each."""
KINDS = ("free", "air_bearing")
"""Environments that the kernel knows."""


def holds(vehicle: Vehicle, consider: Consider) -> bool:
    """Whether the compiled kernel is there and knows all that this vehicle asks for."""
    return kernel().library is not None and not consider.variants and not consider.thrust and not unknown(vehicle)


def unknown(vehicle: Vehicle) -> str:
    """What of a vehicle the kernel doesn't know; empty where it knows all."""
    if vehicle.environment.kind not in KINDS:
        return f"environment.kind is {vehicle.environment.kind!r}, and the kernel knows {' and '.join(map(repr, KINDS))}"
    if vehicle.estimator.method != "default":
        return f"estimator.method is {vehicle.estimator.method!r}, and the kernel is the default one"
    if vehicle.estimator.bins_per_cycle > BINS:
        return f"estimator.bins_per_cycle is {vehicle.estimator.bins_per_cycle}, and the kernel holds {BINS}"
    if drift(vehicle).any():
        return "[drift] is stated, and the kernel knows none"
    return ""


class Pass:
    """The causal pass through one phase."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Vehicle) -> None:
        library = kernel().library
        if library is None:
            raise RuntimeError("there is no compiled kernel")
        self.library, self.samples, self.cycles, self.vehicle = library, samples, cycles, vehicle
        self.memory = ctypes.create_string_buffer(library.mp_host_size())
        checked(library.mp_host_begin(self.memory, pointer(table(samples, vehicle))))

    def rows(self, progress: Callable[[float], None] | None) -> Iterator[Rows]:
        """Estimates after each cycle, part by part."""
        first, end = self.cycles.start, self.cycles.stop
        for begin in range(first, end, CHUNK):
            if progress is not None:
                progress((begin - first) / (end - first))
            yield self.step(packed(self.samples.part(slice(begin, min(begin + CHUNK, end))), self.vehicle))

    def step(self, fed: Array) -> Rows:
        """Estimates after each of the next cycles, as :func:`packed` has them."""
        told = np.empty((len(fed), TOLD))
        count, stride = (ctypes.c_long(n) for n in fed.shape)
        checked(self.library.mp_host_run(self.memory, count, stride, pointer(fed), pointer(told)))
        return rows_of(told)

    def reference(self) -> Reference | None:
        """The estimate at the end; None where there is none."""
        return reference_of(self.library, self.memory, 15 if self.vehicle.on_air_bearing else 12)


def table(samples: Mounted, vehicle: Vehicle) -> Array:
    """All that is constant, in the order of ``mp_host_begin``."""
    imu, environment, thrust = vehicle.imu, vehicle.environment, vehicle.thrust
    layout, sigma = Layout.of(samples, vehicle), prior(samples, vehicle)
    states = (layout.gyro_bias, layout.accel_bias, layout.torque, layout.tilt)
    torque = sigma[layout.torque.start - RATE.start] if layout.torque.stop > layout.torque.start else 0.0
    known = vehicle.known.get("mass")
    scale = np.array(vehicle.estimator.accel_noise_scale or (1.0, 1.0, 1.0))
    return np.array(
        [
            vehicle.on_air_bearing,
            *(block.stop > block.start for block in states),
            vehicle.estimator.bins_per_cycle,
            thrust.pulse_sigma > 0,
            *imu.position_m,
            imu.gyro_noise_rad_s,
            *(scale * (imu.accel_noise_m_s2 or 0.0)),
            imu.gyro_bias_sigma_rad_s,
            imu.accel_bias_sigma_m_s2,
            torque,
            environment.disturbance_torque_n_m,
            environment.disturbance_walk_n_m,
            vehicle.estimator.prior_scale,
            reach(vehicle),
            known.value if known else 0.0,
            *environment.bearing_position_m,
            environment.bearing_mass_kg,
            environment.gravity_m_s2,
        ],
        dtype=float,
    )


def packed(samples: Samples, vehicle: Vehicle) -> Array:
    """(K, …) each cycle's numbers, in the order of ``mp_host_run``."""
    executed, count = samples.executed, len(samples)
    pulses = [] if vehicle.thrust.pulse_sigma == 0 or executed.pulse_covariance is None else [executed.pulse_covariance]
    parts = (
        *(samples.end_s[:, None], executed.duration_s[:, None], samples.rate_rad_s, samples.rate_step_rad_s),
        *(samples.specific_force_m_s2, samples.up_b[:-1], samples.up_b[1:], executed.rising, executed.falling),
        *(executed.ignored, executed.impulse_bins, executed.skew_bins, *pulses),
    )
    return np.concatenate([part.reshape(count, -1) for part in parts], 1, dtype=float)


def rows_of(told: Array) -> Rows:
    """(K, TOLD) numbers of the kernel's rows."""
    return Rows(told[:, :10], told[:, 10:110].reshape(-1, 10, 10), told[:, 110:116], told[:, 116:122], told[:, 122:])


def reference_of(library: ctypes.CDLL, memory: object, channels: int) -> Reference | None:
    """The present estimate; None where there is none."""
    found = np.empty(16 + 3 * channels)
    if not library.mp_host_reference(memory, pointer(found)):
        return None
    return Reference(found[:9].reshape(3, 3), found[9:12], float(found[12]), found[13:16], found[16:].reshape(3, -1))


def checked(status: int) -> None:
    """Raise RuntimeError on any status but 0."""
    if status:
        raise RuntimeError(f"the compiled kernel ended with status {status}")


def pointer(array: Array) -> ctypes.c_void_p:
    """Where its numbers stand; the array must outlive the call."""
    return ctypes.c_void_p(array.ctypes.data)
