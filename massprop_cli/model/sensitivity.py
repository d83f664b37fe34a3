"""Assumed values that may be otherwise, and how the log would read then.

The filter is linear in the measurements. It can carry the derivative of its mean with respect to an assumption as one more column: the
shift of the estimate for a delay one cycle longer, or an IMU one metre further on. An assumption with uncertainty sigma adds sigma² times
the outer product of its shift to the covariance, and is not estimated (a *consider* parameter: S. F. Schmidt 1966). Uncertain geometry is a
column too, but the regression estimates it: the log may determine it to much better than its stated sigma.
"""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import times
from massprop_cli.errorparameters.parameter import ErrorParameter
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import BY_NAME
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.geometry import WrenchChanges, uncertain_jets
from massprop_cli.model.regressors import to_measured_axes
from massprop_cli.prepare.compensate import Samples, Source
from massprop_cli.prepare.stream import Stream

RESTATED = "restated"
"""Kind of an unknown that the vehicle file restates as ``uncertain``."""


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
    def movable(self) -> bool:
        """Whether it varies to both sides: one at a bound of its key, or that is no number, varies by a whole sigma to one side."""
        return self.distance < 1

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
