"""Causal pass of :mod:`massprop_cli.estimate.engine` by the compiled kernel (:mod:`massprop_cli.kernel`)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import BLOCK
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

ROW_SIZE = 131
"""Numbers that the kernel returns for each cycle."""


def supports(samples: Source, vehicle: Vehicle, consider: Consider) -> bool:
    """Whether the compiled kernel is available and supports this log and vehicle; each sensor must have all its axes or none."""
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
    """Causal pass through one phase, by the kernel."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved) -> None:
        library = kernel().compiled
        self.library, self.samples, self.cycles, self.vehicle = library, samples, cycles, vehicle
        self._memory = np.empty(library.mp_host_size(), np.uint8)
        self.memory = pointer(self._memory)
        kernelargs.check_status(library.mp_host_begin(self.memory, pointer(vehicle_numbers(samples, vehicle))))
        attitude_error = np.ascontiguousarray(samples.part(slice(cycles.start, cycles.start + 1)).attitude_error_rad, dtype=float)
        library.mp_host_attitude_error(self.memory, pointer(attitude_error))

    def rows(self, progress: Callable[[float], None] | None) -> Iterator[Rows]:
        """Estimates after each cycle, chunk by chunk."""
        first, end = self.cycles.start, self.cycles.stop
        for begin in range(first, end, BLOCK):
            if progress is not None:
                progress((begin - first) / (end - first))
            yield self.step(kernelargs.cycle_numbers(self.samples.part(slice(begin, min(begin + BLOCK, end)))))

    def step(self, cycles: Array) -> Rows:
        """Estimates after each of the next cycles (:func:`massprop_cli.model.kernelargs.cycle_numbers`)."""
        rows = np.empty((len(cycles), ROW_SIZE))
        count, stride = (ctypes.c_long(n) for n in cycles.shape)
        kernelargs.check_status(self.library.mp_host_run(self.memory, count, stride, pointer(cycles), pointer(rows)))
        return rows_of(rows)

    def reference(self) -> Reference | None:
        """The estimate at the end; None if there is none."""
        return reference_of(self.library, self.memory, self.vehicle)


def vehicle_numbers(samples: Mounted, vehicle: Resolved) -> Array:
    """(n,) constants of vehicle and log, in the order of ``mp_host_begin``."""
    return kernelargs.vehicle_numbers(samples, vehicle, [vehicle.imu.gyro_noise_rad_s, *vehicle.noise[3:].tolist()], reach(vehicle))


def rows_of(numbers: Array) -> Rows:
    """Rows from the kernel's numbers, (K, ROW_SIZE)."""
    parameters = Parameters(numbers[:, :10], numbers[:, 10:110].reshape(-1, 10, 10), numbers[:, 110:113])
    return Rows(parameters, numbers[:, 113:119], numbers[:, 119:125], numbers[:, 125:])


def reference_of(library: ctypes.CDLL, memory: object, vehicle: Vehicle) -> Reference | None:
    """The present estimate; None if there is none."""
    response = slice(19, 19 + 3 * plant_of(vehicle).channels)
    numbers = np.empty(response.stop + len(scale_sigmas(vehicle)))
    if not library.mp_host_reference(memory, pointer(numbers)):
        return None
    return Reference(
        numbers[:9].reshape(3, 3),
        numbers[9:12],
        float(numbers[12]),
        numbers[13:16],
        numbers[response.stop :],
        acceleration=numbers[16:19],
        response=numbers[response].reshape(3, -1),
    )
