"""The causal pass of :mod:`massprop_cli.estimate.engine` on the compiled kernel (:mod:`massprop_cli.kernel`)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.estimate.initial import reach
from massprop_cli.estimate.rows import Parameters, Rows
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import kernel, pointer
from massprop_cli.model import kernelargs
from massprop_cli.model.momentum import scale_sigmas
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Mounted, Source

CHUNK = 512
"""Cycles handed over at a time."""
TOLD = 131
"""Numbers that come back of each."""


def holds(samples: Source, vehicle: Vehicle, consider: Consider) -> bool:
    """Whether the compiled kernel is there and knows all that this log and vehicle ask for: of a log, sensors that are whole or absent."""
    return (
        kernel().library is not None
        and not samples.attitude_logged
        and all(sensor.all() or not sensor.any() for sensor in np.split(samples.unread, 2))
        and not consider.variants
        and not consider.scales
        and not consider.kinds
        and not kernelargs.unsupported(vehicle)
    )


class Pass:
    """The causal pass through one phase."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved) -> None:
        library = kernel().compiled
        self.library, self.samples, self.cycles, self.vehicle = library, samples, cycles, vehicle
        self._room = np.empty(library.mp_host_size(), np.uint8)
        self.memory = pointer(self._room)
        kernelargs.check_status(library.mp_host_begin(self.memory, pointer(table(samples, vehicle))))
        attitude_error = np.ascontiguousarray(samples.part(slice(cycles.start, cycles.start + 1)).attitude_error_rad, dtype=float)
        library.mp_host_attitude_error(self.memory, pointer(attitude_error))

    def rows(self, progress: Callable[[float], None] | None) -> Iterator[Rows]:
        """Estimates after each cycle, part by part."""
        first, end = self.cycles.start, self.cycles.stop
        for begin in range(first, end, CHUNK):
            if progress is not None:
                progress((begin - first) / (end - first))
            yield self.step(kernelargs.cycle_numbers(self.samples.part(slice(begin, min(begin + CHUNK, end)))))

    def step(self, fed: Array) -> Rows:
        """Estimates after each of the next cycles, as :func:`packed` has them."""
        told = np.empty((len(fed), TOLD))
        count, stride = (ctypes.c_long(n) for n in fed.shape)
        kernelargs.check_status(self.library.mp_host_run(self.memory, count, stride, pointer(fed), pointer(told)))
        return rows_of(told)

    def reference(self) -> Reference | None:
        """The estimate at the end; None where there is none."""
        return reference_of(self.library, self.memory, self.vehicle)


def table(samples: Mounted, vehicle: Resolved) -> Array:
    """All that is constant, in the order of ``mp_host_begin``."""
    return kernelargs.vehicle_numbers(samples, vehicle, [vehicle.imu.gyro_noise_rad_s, *vehicle.noise[3:].tolist()], reach(vehicle))


def rows_of(told: Array) -> Rows:
    """(K, TOLD) numbers of the kernel's rows."""
    found = Parameters(told[:, :10], told[:, 10:110].reshape(-1, 10, 10), told[:, 110:113])
    return Rows(found, told[:, 113:119], told[:, 119:125], told[:, 125:])


def reference_of(library: ctypes.CDLL, memory: object, vehicle: Vehicle) -> Reference | None:
    """The present estimate; None where there is none."""
    response = slice(19, 19 + 3 * plant_of(vehicle).channels)
    found = np.empty(response.stop + len(scale_sigmas(vehicle)))
    if not library.mp_host_reference(memory, pointer(found)):
        return None
    return Reference(
        found[:9].reshape(3, 3),
        found[9:12],
        float(found[12]),
        found[13:16],
        found[response.stop :],
        acceleration=found[16:19],
        response=found[response].reshape(3, -1),
    )
