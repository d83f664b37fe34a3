"""What a change of something that is taken for granted does to the measurements, and so to the estimate.

The filter is linear in what it is fed, so beside its mean it can carry what one unit of an assumption's change would have done to that
mean (one more column of the same recursion): the shift of the estimate for a delay a cycle longer, an IMU a metre further on. An
assumption that is uncertain by sigma then adds sigma² times the outer product of its shift to the covariance (a *consider* parameter:
S. F. Schmidt 1966), without being estimated from the log a second time. What is uncertain of the geometry is a column too, but an unknown
that the regression finds beside the mass properties: an error of it may show in the log long before the sigma that is stated of it.
"""

from __future__ import annotations

from dataclasses import field, replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import cross_matrix, rotation, times
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.geometry import Wrenches, uncertain_jets
from massprop_cli.model.lift import Lift
from massprop_cli.model.lifted import Lifted, cycles_of, lifted
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.within import Within
from massprop_cli.prepare.compensate import Source
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

TURN = float(np.radians(0.1))
"""rad; the difference behind the derivative with respect to the IMU's mounting."""
STEP = 0.02
"""Cycles; half the difference behind the derivative with respect to delay and lag."""


@dataclass(frozen=True)
class Side:
    """The log as it would have been read under another assumption."""

    samples: Source
    vehicle: Vehicle | None = None
    """None: the filter's own, so that only the samples differ."""


@dataclass(frozen=True)
class Variant:
    """An assumption changed to both sides; its derivative is the difference of the sides over their distance."""

    low: Side
    high: Side
    distance: float


@dataclass(frozen=True)
class Reading:
    """What the IMU reads turned into something else, where nothing more follows from it (:func:`reads_alone`)."""

    rate: Array
    """(3, 3) derivative of the rate by an assumption's unit, body axes."""
    force: Array
    """(3, 3) of the specific force."""


def reads_alone(vehicle: Vehicle) -> bool:
    """Whether an error of the rate that is read changes nothing else that is compared with the log.

    The response is linear about the rates that were read, ``f(r) + T (x − r)``, which at ``x = r`` changes with r to second order alone.
    Not so where the rates carry an attitude, or wheels turn against them.
    """
    return vehicle.environment.kind == "free" and not vehicle.spinning


def turned_reading(axis: int, by_rad: float = 1.0) -> Reading:
    """Of an IMU that is turned about a body axis: what it reads turns with it, θ × ω and θ × f."""
    turn = by_rad * cross_matrix(np.eye(3)[axis])
    return Reading(turn, turn)


@dataclass(frozen=True)
class ImuChange:
    """The IMU further along a body axis, or turned about it."""

    kind: str
    """imu-position or imu-mounting."""
    axis: int
    samples: Source
    """The log as it would have been read."""
    step: float
    """m or rad"""
    sigma: float

    def variant(self, samples: Source, vehicle: Vehicle) -> Variant | Reading:
        """Beside the log as it was read, by one sigma."""
        if self.kind == "imu-mounting" and reads_alone(vehicle):
            return turned_reading(self.axis, self.sigma)
        changed = (imu_moved if self.kind == "imu-position" else imu_turned)(vehicle, self.axis, self.step)
        return Variant(Side(samples), Side(self.samples, changed), self.step / self.sigma)


@dataclass(frozen=True)
class Consider:
    """Assumptions that are uncertain, and their covariance (e, e)."""

    variants: tuple[Variant | Reading, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    scales: bool = False
    """Whether the scale of each of the accelerometer's axes follows, and each command channel's own thrust, per unit of their relative
    change; they add nothing to the covariance."""
    imu: tuple[ImuChange, ...] = ()
    """What is uncertain of the IMU. Unknowns from here on, with a prior of one sigma."""
    jets: Wrenches = field(default_factory=Wrenches)

    def columns(self, channels: int) -> int:
        """e, of a log with so many command channels; without the unknowns."""
        return len(self.variants) + self.scales * (3 + channels)

    @property
    def kinds(self) -> tuple[str, ...]:
        """(u,) of each unknown."""
        return (*(change.kind for change in self.imu), *self.jets.kinds)

    def about(self, other: Consider) -> Consider:
        """Of the same unknowns, with the assumptions of another."""
        return replace(other, imu=self.imu, jets=self.jets)


def fed(
    here: Lifted, samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, consider: Consider, lift: Lift
) -> tuple[Array, Array]:
    """(K − 1, n, e + u) and (K, 6, e + u) derivatives of drive and measurements by each assumption, and by each unknown of the geometry.

    At the reference and the measured rates; ``here`` is the response of ``cycles`` by the coefficients of ``lift``.
    """
    part, state = samples.part(cycles), np.zeros((len(here.measured), here.transition.shape[1]))
    state[:, :3] = part.rate_rad_s - reference.gyro_bias
    driven, measured = list[Array](), list[Array]()
    # the log as it was read is at hand, and sides that several variants have in common are looked at once
    read = {(id(samples), id(vehicle)): _beyond(here, lift.coefficients(lift.theta(reference))[0], state)}
    shared = _Shared({}, {})

    def of(side: Side) -> tuple[Array, Array]:
        as_read = side.vehicle or vehicle
        if (own := (id(side.samples), id(as_read))) not in read:
            read[own] = _expected(side, state, cycles, reference, as_read, shared)
        return read[own]

    def add(variant: Variant | Reading) -> None:
        if isinstance(variant, Reading):
            driven.append(np.zeros(here.drive.shape[:2]))
            measured.append(np.hstack([times(variant.rate, part.rate_rad_s), times(variant.force, part.specific_force_m_s2)]))
            return
        low, high = of(variant.low), of(variant.high)
        driven.append((high[0] - low[0]) / variant.distance)
        measured.append((high[1] - low[1]) / variant.distance)

    def push(growth: Array, force: Array, seen_by_scale: Array | None = None) -> None:
        scales = 0 if seen_by_scale is None else 3
        drive, seen = np.zeros((len(growth), state.shape[1], scales + growth.shape[2])), np.zeros((len(force), 6, scales + force.shape[2]))
        drive[:, :3, scales:], seen[:, 3:, scales:] = growth, -force
        if seen_by_scale is not None:
            seen[:, 3:, :3] = seen_by_scale
        driven.extend(np.moveaxis(drive, -1, 0))
        measured.extend(np.moveaxis(seen, -1, 0))

    for variant in consider.variants:
        add(variant)
    if consider.scales:
        mounting = np.array(vehicle.imu.body_from_imu)
        whole, of_each = part.specific_force_m_s2 + vehicle.environment.steady_force_m_s2, part.executed.channels.wrench
        thrusts = Wrenches(np.arange(len(of_each)), of_each)
        push(*wrench_columns(samples, cycles, reference, vehicle, here, thrusts), mounting * (whole @ mounting)[:, None, :])
    for change in consider.imu:
        add(change.variant(samples, vehicle))
    if consider.jets.kinds:
        push(*wrench_columns(samples, cycles, reference, vehicle, here, consider.jets))
    return np.stack(driven, -1), np.stack(measured, -1)


def wrench_columns(
    samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle, here: Lifted, changes: Wrenches
) -> tuple[Array, Array]:
    """(K − 1, 3, g) growth of the rate and (K, 3, g) specific force by each change of a channel's wrench."""
    part = samples.part(cycles)
    channels, duration = part.executed.channels, part.executed.duration_s
    rising, whole = channels.rising[:, changes.channels], channels.whole[:, changes.channels]
    up = (part.up_b[:-1] + part.up_b[1:]) / 2
    moment, felt = plant_of(vehicle).pushed(reference, changes.wrench, up, np.array(vehicle.imu.position_m))
    begun, ended = (
        np.einsum("kij,kjg,kg->kig", here.moment_to_rate, *one) for one in ((moment[:-1], rising[:-1]), (moment[1:], (whole - rising)[1:]))
    )
    return begun + ended, felt * (whole / duration[:, None])[:, None, :]


def with_geometry(consider: Consider, log: Log, vehicle: Vehicle, samples: Stream) -> Consider:
    """With what the vehicle file says to be uncertain of jets and IMU."""
    stated, imu = vehicle.imu, []
    for axis in range(3):
        if stated.position_sigma_m > 0:
            imu.append(ImuChange("imu-position", axis, samples, stated.position_sigma_m, stated.position_sigma_m))
        if stated.mounting_sigma_rad > 0:
            turned = samples if reads_alone(vehicle) else samples.changed(imu_turned(vehicle, axis, TURN))
            imu.append(ImuChange("imu-mounting", axis, turned, TURN, stated.mounting_sigma_rad))
    jets = uncertain_jets(vehicle) if log.command_kind == "jets" else Wrenches()
    return replace(consider, imu=tuple(imu), jets=jets)


def imu_moved(vehicle: Vehicle, axis: int, by_m: float) -> Vehicle:
    """With the IMU further along a body axis."""
    place = tuple(float(x) + by_m * (i == axis) for i, x in enumerate(vehicle.imu.position_m))
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={"position_m": place})})


def imu_turned(vehicle: Vehicle, axis: int, by_rad: float) -> Vehicle:
    """With the IMU turned about a body axis."""
    mounted = rotation(by_rad * np.eye(3)[axis]) @ np.array(vehicle.imu.body_from_imu)
    rows = tuple(tuple(float(x) for x in row) for row in mounted)
    return vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={"body_from_imu": rows})})


class _Shared(NamedTuple):
    """What sides have in common."""

    bodies: dict[int, Array]
    """By environment: the reference's coefficients."""
    moved: dict[tuple[int, int], Within | Array]
    """By samples and environment: another place of the IMU alone leaves the motion."""


def _expected(side: Side, state: Array, cycles: slice, reference: Reference, vehicle: Vehicle, shared: _Shared) -> tuple[Array, Array]:
    """(K − 1, n) the state one step on, and (K, 6) what is measured beyond what the state (K, n) gives, as a side reads the log."""
    within, samples, lift = id(vehicle.environment), side.samples, Lift(plant_of(vehicle))
    if within not in shared.bodies:
        shared.bodies[within] = lift.coefficients(lift.theta(reference))[0]
    phi, same = shared.bodies[within], (id(samples), within)
    if same not in shared.moved:
        shared.moved[same] = cycles_of(samples, cycles, reference, vehicle)
    return _beyond(lifted(samples, cycles, reference, vehicle, phi[:, None], shared.moved[same]), np.ones(1), state)


def _beyond(free: Lifted, coefficients: Array, state: Array) -> tuple[Array, Array]:
    """(K − 1, n) the state one step on, and (K, 6) what is measured beyond what the state (K, n) gives, of ``coefficients``."""
    driven, measured = (part[..., 0] + part[..., 1:] @ coefficients for part in (free.drive, free.measured))
    return times(free.transition, state[:-1]) + driven, measured - times(free.observation, state)


def late(log: Log, vehicle: Vehicle, timing: Timing, name: str) -> Variant | None:
    """Delay or lag (``name``) changed, per control cycle; None where the log is too short for it."""
    low, high = timing.moved([name], [-STEP]), timing.moved([name], [STEP])
    try:
        sides = [Side(Stream.of(log, vehicle, side)) for side in (low, high)]
    except InputError:
        return None
    return Variant(sides[0], sides[1], sum(high) - sum(low))


def lowpassed(log: Log, vehicle: Vehicle, timing: Timing, sensor: str) -> Variant:
    """The low-pass within the gyro or the accelerometer ("accel") changed, per control cycle."""
    key, period = f"{sensor}_lag_s", vehicle.cycle.period_s
    lag = getattr(vehicle.imu, key) / period
    ends = max(lag - STEP, 0.0), lag + STEP
    changed = (vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={key: end * period})}) for end in ends)
    low, high = (Side(Stream.of(log, one, timing)) for one in changed)
    return Variant(low, high, ends[1] - ends[0])
