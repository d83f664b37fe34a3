"""Regressor columns of a segment for its free coefficients.

Hypotheses about jets' places and thrust or about the IMU do not change these columns. So they are computed once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.precession import PER_AXIS, nutation, precessing, precessing_within
from massprop_cli.diagnosis.scatter import StatedScatter, scatter_of
from massprop_cli.diagnosis.verticals import logged_axes, verticals, verticals_by_errors
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import BY_COLUMN, BY_NAME
from massprop_cli.estimate.whitening import Driven
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.intracycle import intra_cycle_motion
from massprop_cli.model.plant import plant_of
from massprop_cli.model.regressors import integrals_about
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare import recorded
from massprop_cli.prepare.actuators import channel_wrench, together
from massprop_cli.prepare.align import Channels, Impulses, impulses
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.sums import net
from massprop_cli.prepare.timing import Timing

SHIFT = 0.25
"""Cycles by which commands are shifted for the derivatives by the delay."""
GYRO_ERRORS = ("gyro_scale", "gyro_bias")
"""Gyro errors that tilt the integrated vertical: a column for each axis of each. A turned gyro needs none, since it turns the initial
vertical."""
INTEGRATED = f"{GYRO_ERRORS[0]} 0"
"""A column that exists only if the attitude is integrated from the gyro."""
COUPLING = 0.5
"""Variance that rate noise in the products adds to a rate step, over noise variance × (rate × cycle)²: half the square of the ratio (I_a −
I_b) / I_c of moments of inertia, which is 1 for a plate."""
RAMPS, SUPPLY = ("rising", "falling"), ("sagging", "ebbing")
"""Columns of thrust that rises or falls more slowly, and of thrust that is lower while other jets fire. A short log does without."""
CYCLES_PER_COLUMN = 2
"""Least number of cycles per column."""
CACHED_TIMINGS = 16
"""Number of command timings whose impulses are cached."""


@dataclass(frozen=True)
class Design:
    """Regressor columns of one segment: K cycles, p columns, C channels that act."""

    places: Mapping[str, slice]
    """Column range of each kind of column."""
    fired: IntArray
    """Indices of the channels that have a column."""
    growth: Array
    """(K − 1, p) growth of the mean rate from cycle to cycle by a unit coefficient of each column."""
    mean: Array
    """(K, p) mean of each column over each cycle."""
    rate: Array
    """(K, 3) measured rate, rad/s."""
    force: Array
    """(K, 3) measured specific force, m/s²."""
    cycle_s: float
    """Mean cycle length, s."""
    level: Array
    """(3, 3) mean projector onto the horizontal plane, body axes."""
    used: BoolArray
    """(K, 2) whether the gyro's and the accelerometer's reading is used."""
    clock_s: tuple[float, float]
    """Mean mid-cycle time since the start of the log, and time between the first and the last mid-cycle, s."""
    impulses: tuple[Array, Array, Array]
    """(K, C) impulses of the channels under the rising and the falling half of each cycle's window, and in the whole cycle."""
    start_s: Array
    """(K,) start of each cycle, s."""
    duration_s: Array
    nutation: float = 0.0
    """Square of the nutation frequency by stored momentum, (rad/s)²."""
    scatter: StatedScatter | None = None
    """Stated noise other than the IMU's; None without any."""

    @property
    def force_weight(self) -> Array:
        """(K,) weight of the specific force: IMU noise over total stated noise."""
        return np.asarray(np.ones(len(self.mean)) if self.scatter is None else 1 / np.sqrt(1 + self.scatter.force))

    @property
    def driven(self) -> Driven:
        """Rates and their columns, for whitening."""
        coupling = COUPLING * (float((self.rate**2).sum(1).mean()) + self.nutation) * self.cycle_s**2
        steady = self.places["constant"].start if "constant" in self.places else None
        rate_step, random_walk = (None, 0.0) if self.scatter is None else (self.scatter.rate_step, self.scatter.random_walk)
        return Driven(self.growth, self.rate, self.used[:, 0], coupling, False, steady, self.cycle_s, random_walk, rate_step)


class _Windows(NamedTuple):
    """(K, 6) wrench impulses of the commands under one timing: under the halves of the window, and in the whole cycle."""

    rising: Array
    falling: Array
    whole: Array


class Designs:
    """Designs of related cases, with a cache of what they share."""

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], tuple[Array, Impulses]] = {}
        self._last: tuple[tuple[object, ...], Design] | None = None
        self._turned: dict[tuple[object, ...], list[tuple[str, Array]]] = {}

    def of(self, log: Log, vehicle: Resolved, timing: Timing, piece: slice, theta: Array | None = None) -> Design:
        """Columns of cycles ``piece``; with ``theta`` (10,), with the intra-cycle motion of that body.

        Raise :class:`InputError` if there are too few cycles.
        """
        key = (log, vehicle, timing, piece, None if theta is None else theta.tobytes())
        if self._last is None or not all(a is b or (i > 1 and a == b) for i, (a, b) in enumerate(zip(self._last[0], key, strict=True))):
            self._last = key, self._design(log, vehicle, timing, piece, theta)
        return self._last[1]

    def _design(self, log: Log, vehicle: Resolved, timing: Timing, piece: slice, theta: Array | None) -> Design:
        lag_s = timing.lag_s(vehicle)
        samples = timing.of(log, vehicle, self._impulses(log, vehicle, timing.delay, lag_s))
        first_usable = max(int(np.argmax(samples.executed.usable)) + 1, 0 if samples.measured is None else samples.measured.settled)
        cycles = slice(max(piece.start, first_usable), min(piece.stop, len(samples) - 1))
        if cycles.stop - cycles.start < 2:
            raise InputError(
                f"{log.path}: {max(cycles.stop - cycles.start, 0)} cycles are too few to estimate how the motion follows the commands; "
                "record longer"
            )
        # no column for effects before the command: a controller computes commands from measured noise
        earliest = max(timing.delay - SHIFT, 0.0)
        shifted = [self._window(log, vehicle, earliest + by, lag_s) for by in (0.0, SHIFT, 2 * SHIFT)]
        thrust_variants = [
            (name, self._window(log, other, timing.delay, lag_s), by) for name, other, by in _thrust_variants(log, vehicle, timing)
        ]
        parts = list(_columns(samples, shifted, (timing.delay - earliest) / SHIFT, thrust_variants, vehicle, cycles))
        parts += self._turned_columns(samples, vehicle, cycles) if vehicle.pivoted else []
        count, places = len(parts[0].mean), _places(parts)
        for optional in (SUPPLY, RAMPS):
            if count < CYCLES_PER_COLUMN * _column_count(places):
                parts = [part for part in parts if part.name not in optional]
                places = _places(parts)
        if count < CYCLES_PER_COLUMN * _column_count(places):
            raise InputError(f"{log.path}: {count} cycles are too few for {_column_count(places)} free columns")
        channels = samples.executed.channels
        fired = np.flatnonzero(_active_channels(channels, cycles))
        growth, mean = (np.concatenate([part[i] for part in parts], 1) for i in (1, 2))
        rate = samples.rate_rad_s[cycles]
        if theta is not None:
            rate = rate - _cg_motion(samples.part(cycles), vehicle, theta, places, growth, mean)
        middle_s = samples.executed.start_s[cycles] + samples.executed.duration_s[cycles] / 2
        cycle_s, up_b = float(samples.executed.duration_s[cycles].mean()), samples.up_b[cycles]
        return Design(
            places,
            fired,
            growth,
            mean,
            rate,
            samples.specific_force_m_s2[cycles],
            cycle_s,
            np.eye(3) - up_b.T @ up_b / len(up_b),
            np.asarray(~samples.executed.ignored[cycles].reshape(-1, 2, 3).all(2)),
            (float(middle_s.mean()) - log.origin_s, float(np.ptp(middle_s))),
            (channels.rising[cycles][:, fired], channels.falling[cycles][:, fired], channels.whole[cycles][:, fired]),
            samples.executed.start_s[cycles],
            samples.executed.duration_s[cycles],
            nutation(samples.executed.stored, cycles, rate),
            scatter_of(samples.part(cycles), vehicle, places, growth, mean, rate),
        )

    def _window(self, log: Log, vehicle: Vehicle, delay: float, lag_s: float) -> _Windows:
        wrench = channel_wrench(log, vehicle)
        impulses_of = self._impulses(log, vehicle, delay, lag_s)
        return _Windows(*(net(part, wrench) for part in (impulses_of.rising, impulses_of.falling, impulses_of.whole)))

    def _turned_columns(self, samples: Samples, vehicle: Vehicle, cycles: slice) -> list[_Block]:
        """Columns of the world's X and Y, and of the vertical's change by each gyro error that it is integrated with."""
        duration_s = samples.executed.duration_s[cycles]
        lasting = (duration_s[:-1] + duration_s[1:])[:, None] / 2
        vectors = self._verticals(samples, vehicle) if samples.measured is None else logged_axes(samples.measured.attitude_wxyz)
        return [_vector_columns(name, vector, cycles, lasting) for name, vector in vectors]

    def _verticals(self, samples: Samples, vehicle: Vehicle) -> list[tuple[str, Array]]:
        """Change of the vertical by each gyro error, cached by rates and initial vertical."""
        inputs = (samples.rate_rad_s, samples.executed.duration_s, samples.up_b[0])
        key = (vehicle.imu.body_from_imu, *(part.tobytes() for part in inputs))
        if key not in self._turned:
            self._turned = dict([*self._turned.items()][-1:]) | {key: verticals_by_errors(samples, vehicle)}
        return self._turned[key]

    def _impulses(self, log: Log, vehicle: Vehicle, delay: float, lag_s: float) -> Impulses:
        """Impulses of the commands, cached by everything in the vehicle file on which they depend."""
        times = tuple((jet.rise_s, jet.fall_s, jet.delay_s) for jet in vehicle.jets)
        thrust, imu = vehicle.thrust, vehicle.imu
        supply = thrust.droop, thrust.cycle_droop, thrust.failures, thrust.wrench_limits, thrust.least_on_s, thrust.dead_on_s
        actuators = tuple(one.model_dump_json() for _, table in vehicle.actuators for one in table)
        sensors = log.sampled, imu.clock_drift_ppm, imu.gyro_filter, imu.accel_filter
        key = (id(log.command), delay, lag_s, vehicle.cycle.pulse_at, times, supply, sensors, actuators)
        if key not in self._made:
            if len(self._made) == CACHED_TIMINGS:
                del self._made[next(iter(self._made))]
            self._made[key] = log.command, impulses(log, vehicle, delay, lag_s)  # keeps the array, so that its id stays unique
        return self._made[key][1]


class Case(NamedTuple):
    """A log, the vehicle file and the timing under which it is read."""

    log: Log
    vehicle: Resolved
    timing: Timing
    designs: Designs | None = None
    """Cache of designs; None: no cache."""
    whole: tuple[Log, slice] | None = None
    """The log that this one is a part of, and the cycles of the phase in it; None: not a part."""

    @property
    def setup(self) -> Setup:
        """The case as the error parameters take it."""
        return Setup(self.log, self.vehicle, self.timing)

    def design(self, piece: slice, theta: Array | None = None) -> Design:
        """Columns of cycles ``piece`` (:meth:`Designs.of`)."""
        return (self.designs or Designs()).of(self.log, self.vehicle, self.timing, piece, theta)


def _cg_motion(samples: Samples, vehicle: Vehicle, theta: Array, places: Mapping[str, slice], growth: Array, mean: Array) -> Array:
    """(K, 3) rate by the motion of the CG within the cycles. Also set products and mean vertical to the intra-cycle motion, in place.

    The change of the vertical within the cycles, by the weight's torque, is taken with θ. A separate column would differ from those of the
    gyro errors by rate noise alone, and explain that noise.
    """
    phi_map = ResponseMap(plant_of(vehicle))
    step, whole, cg_rate = integrals_about(samples, phi_map.reference(theta), vehicle)
    for name, column in (("products", phi_map.plant.channels - 6), ("up", 3), ("level", 6)):
        if name in places:
            place = places[name]
            columns = slice(column, column + place.stop - place.start)
            if name == "up":
                cg_rate = cg_rate + (step[:, columns] - growth[:, place]) @ phi_map.plant.response(theta)[:, columns].T
            else:
                growth[:, place] = step[:, columns]
            mean[:, place] = whole[:, columns]
    if "level" in places:  # columns of channels hold the whole force; this one takes only its horizontal part
        force, duration_s = slice(3, 6), samples.executed.duration_s[:, None]
        growth[:, places["level"]] -= (samples.executed.rising[:-1] + samples.executed.falling[1:])[:, force]
        mean[:, places["level"]] -= samples.executed.whole[:, force] / duration_s
    if samples.executed.stored is not None:
        motion = intra_cycle_motion(samples, phi_map.reference(theta), phi_map).motion
        precession = precessing_within(samples.executed.stored, motion, samples.executed.duration_s)
        for part, products_of in zip((growth, mean), precession, strict=True):
            axes = np.arange(places["precession"].start, places["precession"].stop).reshape(-1, PER_AXIS)[:, :3]
            part[:, axes.ravel()] = products_of.reshape(len(part), -1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(cg_rate, 0)])


def _thrust_variants(log: Log, vehicle: Vehicle, timing: Timing) -> Iterator[tuple[str, Vehicle, float]]:
    """Columns of jets with changed thrust: name, vehicle with the change, and size of the change."""
    if log.command_kind != "jets":
        return
    for column in (*RAMPS, *SUPPLY) if together(log) > 1 else RAMPS:
        (parameter,) = (BY_NAME[name] for name in BY_COLUMN[column])
        yield column, parameter.differing(Setup(log, vehicle, timing), parameter.difference).vehicle, parameter.difference


class _Block(NamedTuple):
    name: str
    growth: Array
    mean: Array


def _places(parts: Sequence[_Block]) -> dict[str, slice]:
    ends = np.cumsum([part.growth.shape[1] for part in parts]).tolist()
    return {part.name: slice(end - part.growth.shape[1], end) for part, end in zip(parts, ends, strict=True)}


def _column_count(places: Mapping[str, slice]) -> int:
    return int(max(place.stop for place in places.values()))


def _columns(
    samples: Samples, moved: Sequence[_Windows], at: float, thrusts: Sequence[tuple[str, _Windows, float]], vehicle: Vehicle, cycles: slice
) -> list[_Block]:
    """Column blocks in their order.

    ``moved``: wrench at three delays, :data:`SHIFT` apart, of which the stated one is number ``at``. ``thrusts``: name, wrench and size of
    each change of thrust.
    """
    executed = samples.executed
    duration = executed.duration_s[cycles, None]
    window_s = (duration[:-1] + duration[1:]) / 2
    rate, channels = samples.rate_rad_s[cycles], executed.channels
    active = _active_channels(channels, cycles)
    middle, step = (rate[1:] + rate[:-1]) / 2, np.diff(rate, axis=0)
    # mean product of a linear rate under the triangular window, and over a cycle
    product = (products(middle) + products(step) / 6) * window_s
    inner = np.gradient(rate, axis=0)

    def by_window(one: _Windows) -> tuple[Array, Array]:
        rising, falling, whole = (part[cycles] for part in one)
        return rising[:-1] + falling[1:], whole / duration

    wrench = by_window(_Windows(*(net(part, channels.wrench) for part in channels.windows)))  # without stored momentum
    of_channels = by_window(_Windows(*channels.windows))
    later, smeared = _delay_derivatives([by_window(one) for one in moved], at)
    middle_s = executed.start_s[cycles] + executed.duration_s[cycles] / 2
    clock = ((middle_s - middle_s.mean()) / np.ptp(middle_s))[:, None]
    clocks = (clock[1:] + clock[:-1]) / 2, clock
    # columns that every hypothesis needs come first, so that most hypotheses use only those
    parts = [
        _Block("channels", *(part[:, active] for part in of_channels)),
        _Block("products", product, products(rate) + products(inner) / 12),
        _Block("constant", window_s, np.ones_like(duration)),
        *(_gravity_columns(samples, cycles, window_s) if vehicle.pivoted else []),
        *([] if executed.stored is None else [_Block("precession", *precessing(executed.stored.part(cycles), rate, duration, window_s))]),
    ]
    if plant_of(vehicle).tilt_sigma > 0:
        turning = np.broadcast_to(samples.rate_rad_s, (2, *samples.rate_rad_s.shape))
        level = verticals(turning, samples.executed.duration_s, np.eye(3)[:2])
        parts += [_vector_columns(f"slope {i}", edges, cycles, window_s) for i, edges in enumerate(level)]
    parts += [
        _Block("rates", middle * window_s, rate),
        _Block("later", *later),
        *_lag_columns(vehicle, *later),
        _Block("smeared", *smeared),
        _Block("drifting", *(c * x for c, x in zip(clocks, later, strict=True))),
        _Block("aging", *(c * x for c, x in zip(clocks, wrench, strict=True))),
    ]
    return parts + [_Block(name, *((b - a) / by for a, b in zip(wrench, by_window(variant), strict=True))) for name, variant, by in thrusts]


def _active_channels(channels: Channels, cycles: slice) -> BoolArray:
    """(C,) channels that have a column: those that fired, and all that store momentum, which precesses with the body."""
    return np.asarray((channels.whole[cycles] != 0).any(0) | (np.arange(len(channels.wrench)) >= channels.thrusting))


def _delay_derivatives(moved: Sequence[tuple[Array, Array]], at: float) -> tuple[list[Array], list[Array]]:
    """First and second derivative by the delay, at position ``at``, of columns at three delays :data:`SHIFT` apart."""
    early, between, late = moved
    curvature: list[Array] = [(a - 2 * b + c) / SHIFT**2 for a, b, c in zip(early, between, late, strict=True)]
    return [(c - a) / (2 * SHIFT) + (at - 1) * SHIFT * second for a, c, second in zip(early, late, curvature, strict=True)], curvature


def _lag_columns(vehicle: Vehicle, growth: Array, mean: Array) -> list[_Block]:
    """Delay columns as seen by sensors with a stated lag L: the derivative d/dL 1 / (1 + sL)."""
    imu, period = vehicle.imu, vehicle.cycle.period_s
    if imu.gyro_lag_s == 0 and imu.accel_lag_s == 0:
        return []
    lagged = [recorded.low_pass_response(part, period, lag) for part, lag in ((growth, imu.gyro_lag_s), (mean, imu.accel_lag_s))]
    return [_Block("lagging", *lagged)]


def _vector_columns(name: str, vector: Array, cycles: slice, window_s: Array) -> _Block:
    """Columns of a body-axes vector (K + 1, 3) given at the edges of all cycles."""
    edges = vector[cycles.start : cycles.stop + 1]
    curvature = np.zeros_like(edges)
    curvature[1:-1] = edges[2:] - 2 * edges[1:-1] + edges[:-2]
    return _Block(name, (edges + curvature / 12)[1:-1] * window_s, (edges[1:] + edges[:-1]) / 2 - (curvature[1:] + curvature[:-1]) / 24)


def _gravity_columns(samples: Samples, cycles: slice, window_s: Array) -> list[_Block]:
    """Columns of the vertical, and of the horizontal part of the force: (K − 1, 3) under the triangular window, (K, 3) means."""
    executed = samples.executed
    duration = executed.duration_s[cycles, None]
    mean = (samples.up_b[:-1] + samples.up_b[1:]) / 2
    # minus the vertical part of the force, under both halves of the window
    rising, falling, whole = (
        (-mean * (mean * part[:, 3:]).sum(1, keepdims=True))[cycles] for part in (executed.rising, executed.falling, executed.whole)
    )
    return [_vector_columns("up", samples.up_b, cycles, window_s), _Block("level", rising[:-1] + falling[1:], whole / duration)]
