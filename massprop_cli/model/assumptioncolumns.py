"""Columns of the system for assumed values: derivatives of one-step predictions and measurement residuals.

An unknown that is a combination of the mass properties must have a column that is exactly the same combination of theirs: else a long log
seems to inform it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import times
from massprop_cli.errorparameters.setup import stating_as
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model import attitude
from massprop_cli.model.geometry import WrenchChanges
from massprop_cli.model.layout import Layout
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import Regressors, one_step, to_measured_axes
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider, OtherReading, Reading, Variant
from massprop_cli.prepare.compensate import Samples, Source

STATES = (
    *("imu.gyro_bias_sigma_rad_s", "imu.accel_bias_sigma_m_s2"),
    *("environment.disturbance_walk_n_m", "environment.damping_sigma_n_m_s"),
)
"""Keys of a vehicle file that determine which states are estimated."""
STEP = 1e-4
"""Change of the mass properties for a derivative, relative to their natural sizes."""
GAIN = 0.1
"""Gain of the filter that predicts the noise-free rate: part of a rate's innovation that moves the next prediction."""


def assumption_columns(
    here: Regressors, samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, consider: Consider, phi_map: ResponseMap
) -> tuple[Array, Array]:
    """(K − 1, n, 1 + e + u) and (K, m, 1 + e + u) drive and measurements: an offset, and derivatives by assumptions and unknown geometry.

    They are taken at the reference and the measured rates; ``here`` is the response of ``cycles`` with the coefficients of ``phi_map``. The
    offset is −Σ value × derivative over the ``uncertain`` values about whose estimates the log is read: a value counts from the stated one.
    """
    there = _Derivatives(here, samples, cycles, reference, vehicle, phi_map, consider.restarts)
    part, rows = there.part, 9 if samples.attitude_logged else 6
    offset = [np.zeros_like(one) for one in there.side(there.as_read)]
    driven, measured = list[Array](), list[Array]()

    def add(variant: Variant | Reading, change: tuple[Array, Array]) -> None:
        driven.append(change[0])
        measured.append(change[1] + np.pad(there.without_noise(variant), ((0, 0), (0, rows - 6))))

    def add_wrenches(growth: Array, force: Array, by_scale: Array | None = None) -> None:
        drive, change = _wrench_columns_of_state(growth, force, by_scale, there.state.shape[1])
        driven.extend(np.moveaxis(drive, -1, 0))
        measured.extend(np.pad(each, ((0, 0), (0, rows - 6))) for each in np.moveaxis(to_measured_axes(change, part), -1, 0))

    for variant in consider.variants:
        add(variant, there.derivative(variant))
    if consider.scales:
        mounting, whole = np.array(vehicle.imu.body_from_imu), part.specific_force_m_s2 + vehicle.environment.steady_force_m_s2
        by_scale = mounting * (whole @ mounting * part.executed.axes[3:])[:, None, :]
        add_wrenches(*wrench_columns(samples, cycles, reference, vehicle, here, _full_wrenches(part)), by_scale)
    if len(consider.pushes.channels):
        add_wrenches(*wrench_columns(samples, cycles, reference, vehicle, here, consider.pushes))
    if consider.aging:
        add_wrenches(*_aging(samples, cycles, reference, vehicle, here))
    for moved in consider.imu:
        variant = moved.variant(samples, vehicle)
        add(variant, there.derivative(variant))
    for value in consider.restated:
        change = there.like_mass_properties(there.derivative(value.variant))
        offset = [one - value.about * by for one, by in zip(offset, change, strict=True)]
        add(value.variant, change)
    if consider.jets.kinds:
        add_wrenches(*wrench_columns(samples, cycles, reference, vehicle, here, consider.jets))
    return np.stack([offset[0], *driven], -1), np.stack([offset[1], *measured], -1)


class _Derivatives:
    """One-step predictions and measurement residuals of the same cycles, and their derivatives, by assumption."""

    def __init__(
        self,
        here: Regressors,
        samples: Source,
        cycles: slice,
        reference: Reference,
        vehicle: Vehicle,
        phi_map: ResponseMap,
        restarts: frozenset[int],
    ) -> None:
        self.response, self.cycles, self.reference, self.vehicle, self.phi_map = here, cycles, reference, vehicle, phi_map
        self.as_read, self.part = OtherReading(samples), samples.part(cycles)
        self.state = np.zeros((len(here.measured), here.transition.shape[1]))
        self.state[:, :3] = self.part.rate_rad_s - reference.gyro_bias
        self._one_step = here.one_step(phi_map.coefficients(phi_map.plant.theta(reference))[0], self.state)
        self._restarts = np.isin(np.arange(cycles.start + 1, cycles.stop), [*restarts])
        self._sides: dict[tuple[int, int], tuple[Vehicle, tuple[Array, Array]]] = {}
        """By the ids of samples and vehicle; holds the vehicle, so that its id stays unique."""
        self._add((id(samples), id(vehicle)), samples, vehicle, self._one_step)

    def side(self, side: OtherReading) -> tuple[Array, Array]:
        """(K − 1, n) one-step prediction of the state, and (K, m) measurement residuals; computed once."""
        stated = side.vehicle or self.vehicle
        if (key := (id(side.samples), id(stated))) not in self._sides:
            vehicle = self._with_states(side.samples, stated)
            self._add(key, side.samples, stated, one_step(side.samples, self.cycles, self.reference, vehicle, self.state))
        return self._sides[key][1]

    def _add(self, key: tuple[int, int], samples: Source, vehicle: Vehicle, result: tuple[Array, Array]) -> None:
        """Store the result of a side, with the residuals of logged attitudes if there are any."""
        logged = attitude.attitude_measurements(samples.part(self.cycles), Layout.of(samples, self.vehicle), self.reference)
        if logged is not None:
            result = result[0], np.hstack([result[1], logged.offset - times(logged.observation, self.state)])
        self._sides[key] = vehicle, result

    def _with_states(self, samples: Source, vehicle: Vehicle) -> Vehicle:
        """The vehicle with the filter's states: noise and disturbances may have been estimated after the variants were made."""
        alike = Layout.of(samples, vehicle) == Layout.of(samples, self.vehicle)
        return vehicle if alike else stating_as(vehicle, self.vehicle, STATES)

    def derivative(self, variant: Variant | Reading) -> tuple[Array, Array]:
        """(K − 1, n) and (K, m) derivatives of the one-step prediction and of the measurement residuals."""
        if isinstance(variant, Reading):
            drive, residual = (np.zeros_like(one) for one in self.side(self.as_read))
            residual[:, :6] = variant.shown(self.part, self._predicted_motion if variant.of_motion else self._measured_motion)
            return drive, residual
        low, high = self.side(variant.low), self.side(variant.high)
        return (high[0] - low[0]) / variant.distance, (high[1] - low[1]) / variant.distance

    def without_noise(self, variant: Variant | Reading) -> Array:
        """(K, 6) minus the effect on the noise of a change that applies to the predicted, noise-free readings; zero for other variants."""
        if isinstance(variant, Reading) or variant.read is None:
            return np.zeros((len(self.state), 6))
        return variant.read.shown(self.part, self._predicted_motion) - variant.read.shown(self.part, self._measured_motion)

    def like_mass_properties(self, change: tuple[Array, Array]) -> tuple[Array, Array]:
        """An unknown's derivative with terms of second order as in the columns of the mass properties: those of the reference.

        Along the mass properties that are most like the unknown, their columns replace the whole derivative. An unknown like them, as all
        thrust, is then exactly a combination of their columns, so that no log informs it.
        """
        plant, reference = self.phi_map.plant, self.reference
        theta = plant.theta(reference)
        sizes = self.phi_map.sizes(theta)
        columns = [part[..., 1:] @ (self.phi_map.coefficients(theta)[1] * sizes) for part in (self.response.drive, self.response.measured)]
        wanted = np.concatenate([change[0].ravel(), change[1][:, :6].ravel()])
        rows = np.vstack([one.reshape(-1, 10) for one in columns])
        if not (np.isfinite(rows).all() and np.isfinite(wanted).all()):  # the fit has diverged
            return change
        along = np.linalg.lstsq(rows, wanted, rcond=STEP)[0]
        if not (size := float(np.abs(along).max())):
            return change
        ends = []
        for step in (STEP / size, -STEP / size):
            moved = self.phi_map.reference(theta + step * sizes * along)
            moved = replace(reference, inertia=moved.inertia, cg=moved.cg, mu=moved.mu)
            ends.append(one_step(self.as_read.samples, self.cycles, moved, self.vehicle, self.state))
        drive, residual = ((high - low) * size / (2 * STEP) - one @ along for high, low, one in zip(*ends, columns, strict=True))
        return change[0] - drive, change[1] - np.pad(residual, ((0, 0), (0, change[1].shape[1] - 6)))

    @property
    def _measured_motion(self) -> tuple[Array, Array]:
        """(K, 3) measured rates and specific force."""
        return self.part.rate_rad_s, self.part.specific_force_m_s2

    @cached_property
    def _predicted_motion(self) -> tuple[Array, Array]:
        """(K, 3) rates and (K, 3) specific force without the noise of the readings.

        The specific force is the model's prediction. The rate is that of a filter with fixed gain,
        ω⁻[k+1] = ω⁻[k] + growth[k] + g (ω[k] − ω⁻[k]); at a restart, ω⁻[k] is the measured rate ω[k].
        """
        read, rate = self.part.rate_rad_s, self.part.rate_rad_s.copy()
        for k, step in enumerate(self._one_step[0][:, :3] - self.state[:-1, :3]):
            before = read[k] if self._restarts[k] else rate[k]
            rate[k + 1] = before + step + GAIN * (read[k] - before)
        return rate, self.part.specific_force_m_s2 - self._one_step[1][:, 3:6]


def _wrench_columns_of_state(growth: Array, force: Array, by_scale: Array | None, states: int) -> tuple[Array, Array]:
    """(K − 1, n, g) and (K, 6, g) derivatives of drive and measurements, from those of rate growth and specific force.

    The derivatives with respect to the accelerometer scales, ``by_scale``, come first.
    """
    scales = 0 if by_scale is None else 3
    drive, change = np.zeros((len(growth), states, scales + growth.shape[2])), np.zeros((len(force), 6, scales + force.shape[2]))
    drive[:, :3, scales:], change[:, 3:, scales:] = growth, -force
    if by_scale is not None:
        change[:, 3:, :3] = by_scale
    return drive, change


def _full_wrenches(part: Samples) -> WrenchChanges:
    """The whole wrench of each channel at full thrust, as its change."""
    every = part.executed.channels.wrench
    return WrenchChanges(np.arange(len(every)), every)


def _aging(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, here: Regressors) -> tuple[Array, Array]:
    """(K − 1, 3, 1) growth of the rate and (K, 3, 1) specific force by thrust that grows by its own size over the log."""
    part, whole_s = samples.part(cycles), samples.end_s[[0, -1]]
    growth, force = wrench_columns(samples, cycles, reference, vehicle, here, _full_wrenches(part))
    clock = ((part.executed.end_s - whole_s.mean()) / np.ptp(whole_s))[:, None, None]
    return clock[1:] * growth.sum(-1, keepdims=True), clock * force.sum(-1, keepdims=True)


def wrench_columns(
    samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, here: Regressors, changes: WrenchChanges
) -> tuple[Array, Array]:
    """(K − 1, 3, g) growth of the rate and (K, 3, g) specific force by each change of a channel's wrench."""
    part = samples.part(cycles)
    channels, duration = part.executed.channels, part.executed.duration_s
    rising, falling, whole = (part[:, changes.channels] for part in channels.windows)
    up = (part.up_b[:-1] + part.up_b[1:]) / 2
    moment, force = plant_of(vehicle).wrench_response(reference, changes.wrench, up, np.array(vehicle.imu.position_m))
    left, entered = (
        np.einsum("kij,kjg,kg->kig", here.moment_to_rate, *one) for one in ((moment[:-1], rising[:-1]), (moment[1:], falling[1:]))
    )
    return left + entered, force * (whole / duration[:, None])[:, None, :]
