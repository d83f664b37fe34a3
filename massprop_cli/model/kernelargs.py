"""Arguments of the compiled kernel (:mod:`massprop_cli.kernel`), and the vehicles that it does not support."""

import ctypes
from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.kernel import BINS, WHEELS, call, kernel
from massprop_cli.model.intracycle import response_of
from massprop_cli.model.layout import Layout
from massprop_cli.model.plant import Reference
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare.compensate import Mounted, Samples

KINDS = ("free", "air_bearing", "pedestal")
"""Environments that the kernel supports, in the order of its own numbers."""


def unsupported(vehicle: Vehicle) -> str:
    """Why the kernel's estimator does not support the vehicle; empty if it does."""
    if any(getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields):
        return "[drift] is stated, but the kernel does not support it"
    if vehicle.estimates_assumptions:
        return "uncertain values or sigmas of jets or IMU are stated, but the kernel assumes exact values"
    return unsupported_motion(vehicle)


def unsupported_motion(vehicle: Vehicle) -> str:
    """Why the kernel's equations of motion do not hold for the vehicle; empty if they do."""
    if vehicle.environment.kind not in KINDS:
        known = ", ".join(map(repr, KINDS))
        return f"environment.kind is {vehicle.environment.kind!r}, but the kernel supports {known}; use massprop estimate for such a log"
    if vehicle.estimator.method != "default":
        return f"estimator.method is {vehicle.estimator.method!r}, but the kernel supports only the default method"
    if vehicle.estimator.bins_per_cycle > BINS:
        return f"estimator.bins_per_cycle is {vehicle.estimator.bins_per_cycle}, but the limit of the kernel is {BINS}"
    if vehicle.environment.damping_sigma_n_m_s > 0:
        return "environment.damping_sigma_n_m_s is stated, but the kernel does not support damping"
    if any(vehicle.environment.room_torque_n_m):
        return "environment.room_torque_n_m is stated, but the kernel supports no torque in addition to the commands"
    if vehicle.imu.attitude_misalignment_sigma_rad > 0:
        return "imu.attitude_misalignment_sigma_rad is stated, but the kernel does not use a logged attitude"
    if any(wheel.axis_sigma_rad > 0 for wheel in vehicle.wheels):
        return "axis_sigma_rad of a wheel is stated, but the kernel assumes exact axes"
    if vehicle.swings:
        return "a known inertia is stated, but the kernel does not support a free swing on a pedestal"
    for kind, actuators in vehicle.actuators:
        if any(one.device is not None and not (isinstance(one, Wheel) and one.column == "speed") for one in actuators):
            return f"[[{kind.TABLE}]] store momentum, but the kernel supports only the momentum of wheels with a logged speed"
    return f"{len(vehicle.wheels)} wheels, but the limit of the kernel is {WHEELS}" if len(vehicle.wheels) > WHEELS else ""


def vehicle_numbers(samples: Mounted, vehicle: Vehicle, noise: Sequence[float] = (0.0,) * 4, reach_m: float = 0.0) -> Array:
    """(n,) constants of vehicle and log, in the order of ``mp_vehicle_of``.

    ``noise`` is one sigma of a cycle's mean rate [rad/s] and of specific force along each body axis [m/s²]. ``reach_m`` is the distance of
    the farthest jet. Only the estimator needs these two.
    """
    layout = Layout.of(samples, vehicle)
    states = [layout.has(block) for block in (layout.gyro_bias, layout.accel_bias, layout.torque, layout.tilt)]
    imu, environment = vehicle.imu, vehicle.environment
    known_mass = vehicle.known.get("mass")
    mass_kg = vehicle.pedestal_mass_kg if vehicle.on_pedestal else known_mass.value if known_mass else 0.0
    wheels = [
        (*wheel.direction, wheel.spin_inertia_sigma_kg_m2 / wheel.spin_inertia_kg_m2, wheel.spin_inertia_kg_m2, free)
        for wheel, free in zip(vehicle.wheels, samples.free_inertia, strict=True)
    ]
    numbers = (
        *(KINDS.index(environment.kind), *states, vehicle.estimator.bins_per_cycle, samples.pulsed),
        *(*imu.position_m, *noise),
        *(imu.gyro_bias_sigma_rad_s, imu.accel_bias_sigma_m_s2),
        *(environment.disturbance_torque_n_m, environment.disturbance_walk_n_m),
        *(imu.gyro_bias_walk_rad_s_sqrt_s, vehicle.estimator.prior_scale),
        *(reach_m, mass_kg),
        *(*environment.bearing_position_m, vehicle.bearing_mass_kg, environment.gravity_m_s2),
        *(samples.kernel_effect is not None, *(samples.kernel_effect or (0.0, 0.0, 0.0))),
        *(vehicle.thrust.scale_sigma, len(wheels), *(number for wheel in wheels for number in wheel)),
    )
    return np.array(numbers, dtype=float)


def reference_numbers(reference: Reference, phi_map: ResponseMap) -> Array:
    """(n,) numbers of the reference, in the order of ``reference_of`` (massprop_cli/kernel/blocks.c)."""
    theta = phi_map.plant.theta(reference)
    motion = (reference.gyro_bias, reference.acceleration, response_of(reference, phi_map, theta).ravel())
    scale = np.zeros(1 + WHEELS)
    scale[: len(reference.scale)] = reference.scale
    return np.concatenate([theta, reference.inertia.ravel(), reference.cg, [reference.mu], *motion, scale])


def cycle_numbers(samples: Samples) -> Array:
    """(K, …) numbers of each cycle, in the order of ``mp_cycle_of``."""
    executed, count = samples.executed, len(samples)
    pulses = [] if executed.pulse_covariance is None else [executed.pulse_covariance]
    stored = []
    if executed.stored is not None:
        stored = [np.stack([executed.stored.mean, executed.stored.skew], 2)]
        stored += [part[:, executed.channels.thrusting :] for part in executed.channels.windows]
    columns = (
        *(samples.end_s[:, None], executed.duration_s[:, None], samples.rate_rad_s, samples.rate_step_rad_s, samples.carried_rad_s),
        *(samples.specific_force_m_s2, samples.up_b[:-1], samples.up_b[1:], executed.rising, executed.falling),
        *(executed.whole, executed.ignored[:, ::3], executed.impulse_bins, executed.skew_bins, *pulses, *stored),
    )
    return np.concatenate([part.reshape(count, -1) for part in columns], 1, dtype=float)


def regressors(numbers: Array, about: Array, cycles: Array, states: int, combined: int, onto: Array | None) -> tuple[Array, ...]:
    """The arrays of :class:`massprop_cli.model.regressors.Regressors`, in its order, of ``cycles`` (:func:`cycle_numbers`).

    ``numbers`` are the vehicle's, ``about`` the reference's.
    """
    count, n = len(cycles), states
    transition, observation, to_rate = np.empty((count - 1, n, n)), np.empty((count, 6, n)), np.empty((count - 1, 3, 3))
    steps, drive, measured = np.empty((count - 1, 3)), np.empty((count - 1, n, 1 + combined)), np.empty((count, 6, 1 + combined))
    arrays = (transition, observation, to_rate, steps, drive, measured)
    out = (ctypes.c_void_p * 6)(*(part.ctypes.data for part in arrays))
    check_status(call(kernel().compiled.mp_host_regressors, numbers, about, *cycles.shape, cycles, onto, ctypes.c_int(combined), out))
    return arrays


def filtered(
    numbers: Array, about: Array, attitude_error: Array, cycles: Array, before: tuple[Array, ...], begun: bool
) -> tuple[Array, ...]:
    """Run the filter on the nuisance states through ``cycles`` (:func:`cycle_numbers`).

    ``before`` is the filter's state before them: mean (n, c), root of the covariance (n, n) and triangle (c, c) of the information. Returns
    these three after the cycles; then the whitened innovations (K, 6, c) and their roots (K, 6, 6). With ``begun``, the first of ``cycles``
    was processed before and only leads into the next; else it is the phase's first.
    """
    size, count = len(before[2]), len(cycles) - begun
    upper = np.triu_indices(size)
    mean, root, packed_triangle = np.array(before[0], order="C"), np.array(before[1], order="C"), before[2][upper]
    white, roots = np.empty((count, 6, size)), np.empty((count, 6, 6))
    given = numbers, about, attitude_error, ctypes.c_int(begun), *cycles.shape, cycles
    check_status(call(kernel().compiled.mp_host_taken, *given, mean, root, packed_triangle, white, roots))
    triangle = np.zeros((size, size))
    triangle[upper] = packed_triangle
    return mean, root, triangle, white, roots


def one_step(numbers: Array, about: Array, phi: Array, cycles: Array, rate: Array, states: int) -> tuple[Array, Array]:
    """(K − 1, n) one-step prediction of the state, and (K, 6) measurement residuals, at ``rate`` (K, 3) with coefficients ``phi`` (N,)."""
    results = np.empty((len(cycles) - 1, states)), np.empty((len(cycles), 6))
    check_status(call(kernel().compiled.mp_host_beyond, numbers, about, phi, *cycles.shape, cycles, rate, *results))
    return results


def integrals(numbers: Array, about: Array, cycles: Array, channels: int) -> tuple[Array, Array, Array]:
    """The arrays of :func:`massprop_cli.model.regressors.integrals_about`."""
    count = len(cycles)
    results = np.empty((count - 1, channels)), np.empty((count, channels)), np.empty((count - 1, 3))
    check_status(call(kernel().compiled.mp_host_integrals, numbers, about, *cycles.shape, cycles, *results))
    return results


class StatusError(RuntimeError):
    """The kernel refused a cycle, with a status of ``enum mp_status`` (massprop_cli/kernel/massprop.h)."""


def check_status(status: int) -> None:
    """Raise :class:`StatusError` on any status but 0."""
    if status:
        raise StatusError(f"the compiled kernel ended with status {status}")
