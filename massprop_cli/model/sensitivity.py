"""What a change of something that is taken for granted does to the measurements, and so to the estimate.

The filter is linear in what it is fed, so beside its mean it can carry what one unit of an assumption's change would have done to that
mean (one more column of the same recursion): the shift of the estimate for a delay a cycle longer, an IMU a metre further on. An
assumption that is uncertain by sigma then adds sigma² times the outer product of its shift to the covariance (a *consider* parameter:
S. F. Schmidt 1966), without being estimated from the log a second time. What is uncertain of the geometry is a column too, but an unknown
that the regression finds beside the mass properties: an error of it may show in the log long before the sigma that is stated of it.
"""

from __future__ import annotations

from dataclasses import field, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray
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
from massprop_cli.model.regressors import Regressors, as_read, expected
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare.compensate import Samples, Source
from massprop_cli.prepare.stream import Stream

STATES = (
    *("imu.gyro_bias_sigma_rad_s", "imu.accel_bias_sigma_m_s2"),
    *("environment.disturbance_walk_n_m", "environment.damping_sigma_n_m_s"),
)
"""Keys that say which states are estimated."""
FOLLOWED = 0.1
"""Part of what a rate was read otherwise than expected, by which the next is expected otherwise."""


@dataclass(frozen=True)
class OtherReading:
    """The log as it would have been read under another assumption."""

    samples: Source
    vehicle: Vehicle | None = None
    """None: the filter's own, so that only the samples differ."""


@dataclass(frozen=True)
class Variant:
    """An assumption changed to both sides; its derivative is the difference of the sides over their distance."""

    low: OtherReading
    high: OtherReading
    distance: float
    read: Reading | None = None
    """What it turns the readings into, of which the noise is left out."""


@dataclass(frozen=True)
class Reading:
    """What the IMU reads turned into something else, where nothing more follows from it (:func:`reads_alone`)."""

    rate: Array
    """(3, 3) derivative of the rate by an assumption's unit, body axes."""
    force: Array
    """(3, 3) of the specific force."""
    of_motion: bool = False
    """Whether it is the motion that is turned into something else, without its noise: of that an innovation is proof of nothing."""

    def shown(self, read: Samples, motion: tuple[Array, Array]) -> Array:
        """(K, 6) of a motion, rates (K, 3) and specific force (K, 3)."""
        return as_read(np.hstack([times(part, of) for part, of in zip((self.rate, self.force), motion, strict=True)]), read)


def reads_alone(vehicle: Vehicle) -> bool:
    """Whether an error of the rate that is read changes nothing else that is compared with the log.

    The response is linear about the rates that were read, ``f(r) + T (x − r)``, which at ``x = r`` changes with r to second order alone.
    Not so where the rates carry an attitude, or wheels turn against them.
    """
    return vehicle.environment.kind == "free" and not vehicle.spinning


def reading(parameter: ErrorParameter, vehicle: Vehicle, axis: int, by: float = 1.0) -> Reading:
    """The derivative of what the IMU reads by ``by`` units of one component of a parameter that says what its sensor shows."""
    assert parameter.shown is not None
    step, mounting = parameter.difference, np.array(vehicle.imu.body_from_imu)
    high, low = (parameter.shown(parameter.error(end, axis), mounting) for end in (step, -step))
    slope = by * mounting @ (high - low) @ mounting.T / (2 * step)
    rate, force = (slope * (parameter.sensor in ("", sensor)) for sensor in ("gyro", "accel"))
    return Reading(rate, force)


def of_motion(changed: Variant | Reading, parameter: ErrorParameter, vehicle: Vehicle, axis: int) -> Variant | Reading:
    """The same of the motion without its noise, of which an innovation is proof of nothing."""
    if isinstance(changed, Reading):
        return replace(changed, of_motion=True)
    return replace(changed, read=reading(parameter, vehicle, axis)) if parameter.shown is not None else changed


def variant(parameter: ErrorParameter, setup: Setup, samples: Stream, axis: int = 0) -> Variant | Reading | None:
    """One component of a parameter changed, per its unit, beside the log as it was read; None where the log is too short for it."""
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
    """The IMU further along a body axis, or turned about it."""

    parameter: ErrorParameter
    axis: int
    samples: Stream
    """The log as it would have been read."""
    sigma: float

    def variant(self, samples: Source, vehicle: Vehicle) -> Variant | Reading:
        """Beside the log as it was read, by one sigma."""
        one = self.parameter
        if one.shown is not None and reads_alone(vehicle):
            return reading(one, vehicle, self.axis, self.sigma)
        changed = one.differing(Setup(self.samples.log, vehicle, self.samples.alignment.timing), one.difference, self.axis).vehicle
        return Variant(OtherReading(samples), OtherReading(self.samples, changed), one.difference / self.sigma)


@dataclass(frozen=True)
class Restated:
    """The log read with another vehicle file, one sigma of something uncertain away."""

    samples: Source
    vehicle: Vehicle

    def variant(self, samples: Source) -> Variant:
        """Beside the log as it was read."""
        return Variant(OtherReading(samples), OtherReading(self.samples, self.vehicle), 1.0)


@dataclass(frozen=True)
class Consider:
    """Assumptions that are uncertain, and their covariance (e, e)."""

    variants: tuple[Variant | Reading | Restated, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    scales: bool = False
    """Whether the scale of each of the accelerometer's axes follows, and each command channel's own thrust, per unit of their relative
    change; they add nothing to the covariance."""
    pushes: WrenchChanges = field(default_factory=WrenchChanges)
    """Changes of the channels' wrenches that follow these; they add nothing, either."""
    aging: bool = False
    """Whether all thrust's growing from half less to half more over the log follows; as the last two."""
    begun: frozenset[int] = frozenset()
    """Cycles from which on rates are followed anew, whose errors :attr:`Reading.of_motion` are."""
    imu: tuple[ImuChange, ...] = ()
    """What is uncertain of the IMU. Unknowns from here on, with a prior of one sigma."""
    jets: WrenchChanges = field(default_factory=WrenchChanges)

    def columns(self, channels: int) -> int:
        """e, of a log with so many command channels; without the unknowns."""
        return len(self.variants) + self.scales * (3 + channels) + len(self.pushes.channels) + self.aging

    @property
    def kinds(self) -> tuple[str, ...]:
        """(u,) of each unknown."""
        return (*(change.parameter.uncertain[0] for change in self.imu), *self.jets.kinds)

    def about(self, other: Consider) -> Consider:
        """Of the same unknowns, with the assumptions of another."""
        return replace(other, imu=self.imu, jets=self.jets)


def fed(
    here: Regressors, samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, consider: Consider, phi_map: ResponseMap
) -> tuple[Array, Array]:
    """(K − 1, n, e + u) and (K, m, e + u) derivatives of drive and measurements by assumptions, and by unknowns of the geometry.

    At the reference and the measured rates; ``here`` is the response of ``cycles`` by the coefficients of ``phi_map``.
    """
    part, state = samples.part(cycles), np.zeros((len(here.measured), here.transition.shape[1]))
    state[:, :3] = part.rate_rad_s - reference.gyro_bias
    driven, measured, rows = list[Array](), list[Array](), 9 if samples.attitude_logged else 6
    # the log as it was read is at hand; sides that variants have in common are looked at once, and stay: ids are theirs
    at_hand = here.beyond(phi_map.coefficients(phi_map.plant.theta(reference))[0], state)
    sides = _Sides(state, cycles, reference, vehicle, {})
    sides.add((id(samples), id(vehicle)), samples, vehicle, at_hand)
    begun = np.isin(np.arange(cycles.start + 1, cycles.stop), [*consider.begun])
    expected_motion = cache(partial(_expected_motion, part, at_hand, state, begun))

    def add(variant: Variant | Reading) -> None:
        if isinstance(variant, Reading):
            shown = variant.shown(part, expected_motion() if variant.of_motion else (part.rate_rad_s, part.specific_force_m_s2))
            change = np.zeros(here.drive.shape[:2]), np.pad(shown, ((0, 0), (0, rows - 6)))
        else:
            low, high = sides.of(variant.low), sides.of(variant.high)
            change = (high[0] - low[0]) / variant.distance, (high[1] - low[1]) / variant.distance
            if variant.read is not None:
                noise = variant.read.shown(part, expected_motion()) - variant.read.shown(part, (part.rate_rad_s, part.specific_force_m_s2))
                change[1][:, :6] += noise
        driven.append(change[0])
        measured.append(change[1])

    def push(growth: Array, force: Array, seen_by_scale: Array | None = None) -> None:
        drive, seen = _pushed(growth, force, seen_by_scale, state.shape[1])
        driven.extend(np.moveaxis(drive, -1, 0))
        measured.extend(np.pad(each, ((0, 0), (0, rows - 6))) for each in np.moveaxis(as_read(seen, part), -1, 0))

    for variant in consider.variants:
        add(variant.variant(samples) if isinstance(variant, Restated) else variant)
    if consider.scales:
        mounting, whole = np.array(vehicle.imu.body_from_imu), part.specific_force_m_s2 + vehicle.environment.steady_force_m_s2
        seen_by_scale = mounting * (whole @ mounting * part.executed.axes[3:])[:, None, :]
        push(*wrench_columns(samples, cycles, reference, vehicle, here, _all(part)), seen_by_scale)
    if len(consider.pushes.channels):
        push(*wrench_columns(samples, cycles, reference, vehicle, here, consider.pushes))
    if consider.aging:
        push(*_aging(samples, cycles, reference, vehicle, here))
    for change in consider.imu:
        add(change.variant(samples, vehicle))
    if consider.jets.kinds:
        push(*wrench_columns(samples, cycles, reference, vehicle, here, consider.jets))
    return np.stack(driven, -1), np.stack(measured, -1)


def _expected_motion(part: Samples, at_hand: tuple[Array, Array], state: Array, begun: BoolArray) -> tuple[Array, Array]:
    """Rates (K, 3) and specific force (K, 3) that were read, without the noise that they were read with in each cycle.

    Forces are what the model expects, and rates what it expects from those before: ω⁻[k+1] = ω⁻[k] + growth[k] + g (ω[k] − ω⁻[k]); from
    the rate that was read, ω[k], where ``begun`` (K − 1,) is.
    """
    rate, growth = part.rate_rad_s.copy(), at_hand[0][:, :3] - state[:-1, :3]
    for k, step in enumerate(growth):
        before = part.rate_rad_s[k] if begun[k] else rate[k]
        rate[k + 1] = before + step + FOLLOWED * (part.rate_rad_s[k] - before)
    return rate, part.specific_force_m_s2 - at_hand[1][:, 3:6]


def _pushed(growth: Array, force: Array, seen_by_scale: Array | None, states: int) -> tuple[Array, Array]:
    """(K − 1, n, g) and (K, 6, g) derivatives of drive and measurements by what makes the rate grow and is felt, after those of scales."""
    scales = 0 if seen_by_scale is None else 3
    drive, seen = np.zeros((len(growth), states, scales + growth.shape[2])), np.zeros((len(force), 6, scales + force.shape[2]))
    drive[:, :3, scales:], seen[:, 3:, scales:] = growth, -force
    if seen_by_scale is not None:
        seen[:, 3:, :3] = seen_by_scale
    return drive, seen


def _all(part: Samples) -> WrenchChanges:
    """Each channel by all that it gives."""
    every = part.executed.channels.wrench
    return WrenchChanges(np.arange(len(every)), every)


def _aging(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, here: Regressors) -> tuple[Array, Array]:
    """(K − 1, 3, 1) growth of the rate and (K, 3, 1) specific force by thrust that grows by all of itself over the log."""
    part, whole_s = samples.part(cycles), samples.end_s[[0, -1]]
    grown, felt = wrench_columns(samples, cycles, reference, vehicle, here, _all(part))
    clock = ((part.executed.end_s - whole_s.mean()) / np.ptp(whole_s))[:, None, None]
    return clock[1:] * grown.sum(-1, keepdims=True), clock * felt.sum(-1, keepdims=True)


def wrench_columns(
    samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, here: Regressors, changes: WrenchChanges
) -> tuple[Array, Array]:
    """(K − 1, 3, g) growth of the rate and (K, 3, g) specific force by each change of a channel's wrench."""
    part = samples.part(cycles)
    channels, duration = part.executed.channels, part.executed.duration_s
    rising, falling, whole = (part[:, changes.channels] for part in channels.windows)
    up = (part.up_b[:-1] + part.up_b[1:]) / 2
    moment, felt = plant_of(vehicle).wrench_response(reference, changes.wrench, up, np.array(vehicle.imu.position_m))
    begun, ended = (
        np.einsum("kij,kjg,kg->kig", here.moment_to_rate, *one) for one in ((moment[:-1], rising[:-1]), (moment[1:], falling[1:]))
    )
    return begun + ended, felt * (whole / duration[:, None])[:, None, :]


def with_geometry(consider: Consider, setup: Setup, samples: Stream) -> Consider:
    """With what the vehicle file says to be uncertain of jets and IMU."""
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


class _Sides(NamedTuple):
    """What the same cycles look like on each side that was asked for."""

    state: Array
    cycles: slice
    reference: Reference
    own: Vehicle
    """The filter's."""
    read: dict[tuple[int, int], tuple[Vehicle, tuple[Array, Array]]]
    """By samples and vehicle, which it holds, as the id is the vehicle's."""

    def of(self, side: OtherReading) -> tuple[Array, Array]:
        """(K − 1, n) the state one step on, and (K, m) what is measured beyond what the state gives."""
        told = side.vehicle or self.own
        if (key := (id(side.samples), id(told))) not in self.read:
            vehicle = self._as_estimated(side.samples, told)
            found = expected(side.samples, self.cycles, self.reference, vehicle, self.state)
            self.add(key, side.samples, told, found)
        return self.read[key][1]

    def add(self, key: tuple[int, int], samples: Source, vehicle: Vehicle, found: tuple[Array, Array]) -> None:
        """What was found of a side, with what logged attitudes measure beyond what the state gives, where there are any."""
        logged = attitude.attitude_measurements(samples.part(self.cycles), Layout.of(samples, self.own), self.reference)
        if logged is not None:
            found = found[0], np.hstack([found[1], logged.offset - times(logged.observation, self.state)])
        self.read[key] = vehicle, found

    def _as_estimated(self, samples: Source, vehicle: Vehicle) -> Vehicle:
        """With the filter's own states: noise and disturbances are sized after it was stated what is uncertain."""
        alike = Layout.of(samples, vehicle) == Layout.of(samples, self.own)
        return vehicle if alike else stating_as(vehicle, self.own, STATES)
