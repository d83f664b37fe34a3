"""Derivatives of the measurements, and so of the estimate, with respect to assumed values.

The filter is linear in the measurements. It can carry the derivative of its mean with respect to an assumption as one more column: the
shift of the estimate for a delay one cycle longer, or an IMU one metre further on. An assumption with uncertainty sigma adds sigma² times
the outer product of its shift to the covariance, and is not estimated (a *consider* parameter: S. F. Schmidt 1966). Uncertain geometry is a
column too, but the regression estimates it: the log may determine it to much better than its stated sigma.
"""

from __future__ import annotations

from dataclasses import field, replace
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import times
from massprop_cli.errorparameters.parameter import ErrorParameter
from massprop_cli.errorparameters.setup import Setup, stating_as
from massprop_cli.errorparameters.table import BY_NAME
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model import attitude
from massprop_cli.model.geometry import WrenchChanges, uncertain_jets
from massprop_cli.model.layout import Layout
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import Regressors, one_step, to_measured_axes
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare.compensate import Samples, Source
from massprop_cli.prepare.stream import Stream

STATES = (
    *("imu.gyro_bias_sigma_rad_s", "imu.accel_bias_sigma_m_s2"),
    *("environment.disturbance_walk_n_m", "environment.damping_sigma_n_m_s"),
)
"""Keys of a vehicle file that determine which states are estimated."""
RESTATED = "restated"
"""Kind of an unknown that the vehicle file restates as ``uncertain``."""
STEP = 1e-4
"""Change of the mass properties for a derivative, relative to their natural sizes."""
GAIN = 0.1
"""Gain of the filter that predicts the noise-free rate: part of a rate's innovation that moves the next prediction."""


@dataclass(frozen=True)
class OtherReading:
    """The log as it would read under another assumption."""

    samples: Source
    vehicle: Vehicle | None = None
    """The vehicle file of that assumption; None: the filter's own."""


@dataclass(frozen=True)
class Variant:
    """An assumption changed to both sides; its derivative is the difference of the two sides over their distance."""

    low: OtherReading
    high: OtherReading
    distance: float
    read: Reading | None = None
    """The same change of the readings; if given, it applies to the predicted readings and not to the measured ones with their noise."""


@dataclass(frozen=True)
class Reading:
    """A linear change of the IMU readings that has no other consequence (:func:`reads_alone`)."""

    rate: Array
    """(3, 3) derivative of the rate with respect to the assumption, body axes."""
    force: Array
    """(3, 3) derivative of the specific force."""
    of_motion: bool = False
    """Whether the change applies to the predicted, noise-free readings: an innovation is then no evidence for it."""

    def shown(self, read: Samples, motion: tuple[Array, Array]) -> Array:
        """(K, 6) change of rate and specific force, along the measured axes, of ``motion``: rates (K, 3) and specific force (K, 3)."""
        return to_measured_axes(np.hstack([times(part, of) for part, of in zip((self.rate, self.force), motion, strict=True)]), read)


def reads_alone(vehicle: Vehicle) -> bool:
    """Whether an error of the measured rate changes no other quantity that is compared with the log.

    The response is linear about the measured rates r, ``f(r) + T (x − r)``, which at ``x = r`` depends on r to second order only. This does
    not hold where the rates propagate an attitude or turn momentum devices.
    """
    return vehicle.environment.kind == "free" and not vehicle.spinning


def reading(parameter: ErrorParameter, vehicle: Vehicle, axis: int, by: float = 1.0) -> Reading:
    """Derivative of the readings with respect to ``by`` units of one component of a sensor error ``parameter``."""
    assert parameter.shown is not None
    step, mounting = parameter.difference, np.array(vehicle.imu.body_from_imu)
    high, low = (parameter.shown(parameter.error(end, axis), mounting) for end in (step, -step))
    slope = by * mounting @ (high - low) @ mounting.T / (2 * step)
    rate, force = (slope * (parameter.sensor in ("", sensor)) for sensor in ("gyro", "accel"))
    return Reading(rate, force)


def of_motion(changed: Variant | Reading, parameter: ErrorParameter, vehicle: Vehicle, axis: int) -> Variant | Reading:
    """``changed``, applied to the predicted, noise-free readings: an innovation is then no evidence for it."""
    if isinstance(changed, Reading):
        return replace(changed, of_motion=True)
    return replace(changed, read=reading(parameter, vehicle, axis)) if parameter.shown is not None else changed


def variant(parameter: ErrorParameter, setup: Setup, samples: Stream, axis: int = 0) -> Variant | Reading | None:
    """Derivative with respect to one component of ``parameter``, per its unit; None if the log is too short for the change."""
    if parameter.shown is not None and (parameter.sensor == "accel" or reads_alone(setup.vehicle)):
        return reading(parameter, setup.vehicle, axis)
    low, high = parameter.ends(setup)
    try:
        sides = [OtherReading(samples) if not end else _side(parameter, setup, samples, axis, end) for end in (low, high)]
    except InputError:
        return None
    return Variant(sides[0], sides[1], high - low)


def _side(parameter: ErrorParameter, setup: Setup, samples: Stream, axis: int, by: float) -> OtherReading:
    if parameter.by_columns and parameter.shown is not None:
        shows = parameter.shown(parameter.error(by, axis), np.array(setup.vehicle.imu.body_from_imu))
        return OtherReading(samples.changed(gyro=np.diag(shows)).light())
    used = parameter.differing(setup, by, axis)
    if parameter.redone in ("commands", "all") or used.log is not setup.log:
        return OtherReading(Stream.of(*used[:3]).light(), used.vehicle if parameter.redone == "all" else None)
    return OtherReading(samples if parameter.redone == "body" else samples.changed(used.vehicle).light(), used.vehicle)


@dataclass(frozen=True)
class ImuChange:
    """The IMU moved along a body axis, or turned about it."""

    parameter: ErrorParameter
    axis: int
    samples: Stream
    """The log as it would read."""
    sigma: float
    """Prior sigma, in the parameter's unit."""

    def variant(self, samples: Source, vehicle: Vehicle) -> Variant | Reading:
        """Derivative with respect to the change, per sigma."""
        one = self.parameter
        if one.shown is not None and reads_alone(vehicle):
            return reading(one, vehicle, self.axis, self.sigma)
        changed = one.differing(Setup(self.samples.log, vehicle, self.samples.alignment.timing), one.difference, self.axis).vehicle
        return Variant(OtherReading(samples), OtherReading(self.samples, changed), one.difference / self.sigma)


@dataclass(frozen=True)
class Restated:
    """The log read with two vehicle files, in which an uncertain value differs by ``distance`` of its sigma."""

    low: OtherReading
    high: OtherReading
    distance: float
    read: Reading | None
    """Change of the readings by factors on the log, per sigma, if there are any."""
    about: float = 0.0
    """Value about which log and vehicle file are read, in sigmas from the stated one."""

    @property
    def variant(self) -> Variant:
        """Derivative with respect to the value, per sigma."""
        return Variant(self.low, self.high, self.distance, self.read)


@dataclass(frozen=True)
class Consider:
    """Uncertain assumptions: consider parameters first, then unknowns that are estimated (IMU, restated values, jets)."""

    variants: tuple[Variant | Reading, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(e, e) covariance of the variants."""
    scales: bool = False
    """Whether columns follow for the relative scale of each accelerometer axis and each channel's thrust; not in the covariance."""
    pushes: WrenchChanges = field(default_factory=WrenchChanges)
    """Changes of the channels' wrenches, the next columns; not in the covariance."""
    aging: bool = False
    """Whether a column follows for thrust that grows from half less to half more over the log; not in the covariance."""
    restarts: frozenset[int] = frozenset()
    """Cycles from which the prediction of the noise-free rate starts anew (:attr:`Reading.of_motion`)."""
    imu: tuple[ImuChange, ...] = ()
    """Uncertain IMU geometry. These and the jets are estimated, with a prior of one sigma each."""
    jets: WrenchChanges = field(default_factory=WrenchChanges)
    """Uncertain jets."""
    restated: tuple[Restated, ...] = ()
    """Values under ``uncertain`` of the vehicle file; estimated likewise."""

    def columns(self, channels: int) -> int:
        """e, the number of columns without the unknown geometry, for a log with ``channels`` command channels."""
        return len(self.variants) + self.scales * (3 + channels) + len(self.pushes.channels) + self.aging

    @property
    def kinds(self) -> tuple[str, ...]:
        """(u,) kind of each unknown of the geometry."""
        return (*(change.parameter.uncertain[0] for change in self.imu), *(RESTATED for _ in self.restated), *self.jets.kinds)

    def about(self, other: Consider) -> Consider:
        """The assumptions of ``other`` with the estimated unknowns of this one."""
        return replace(other, imu=self.imu, jets=self.jets, restated=self.restated)


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
        along = np.linalg.lstsq(np.vstack([one.reshape(-1, 10) for one in columns]), wanted, rcond=STEP)[0]
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


def with_geometry(consider: Consider, setup: Setup, samples: Stream) -> Consider:
    """``consider`` with the geometry of jets and IMU that the vehicle file states to be uncertain."""
    imu, vehicle = [], setup.vehicle
    for axis in range(3):
        for one in (BY_NAME["imu"], BY_NAME["mounting"]):
            if (sigma := one.sigma(vehicle)) > 0:
                read = samples
                if one.redone == "motion" and not reads_alone(vehicle):
                    read = samples.changed(one.differing(setup, one.difference, axis).vehicle)
                imu.append(ImuChange(one, axis, read, sigma))
    jets = uncertain_jets(vehicle) if setup.log.command_kind == "jets" else WrenchChanges()
    return replace(consider, imu=tuple(imu), jets=jets)
