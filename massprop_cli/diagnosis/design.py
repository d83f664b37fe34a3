"""Regressor columns of a segment for its free coefficients.

What commands do is the same under every hypothesis about jets' places and strengths or the IMU, and so is gone through once for all.
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
from massprop_cli.diagnosis.verticals import by_log, verticals, verticals_by_errors
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
"""Cycles by which commands are moved to see what a delay would do."""
SWUNG = ("gyro_scale", "gyro_bias")
"""Errors of a gyro that the attitude is integrated from: each axis of each moves the vertical. A turned gyro needs no columns of its own:
with it the vertical is turned, and begins elsewhere."""
INTEGRATED = f"{SWUNG[0]} 0"
"""A column that is there where the gyro alone carries the attitude."""
COUPLING = 0.5
"""Noise in the rates that the products are made of moves the rate by so much of its square, times (rate × cycle)²: half of the moments of
inertia's differences over one of them, squared, as it is of a slab."""
RAMPS, SUPPLY = ("rising", "falling"), ("sagging", "ebbing")
"""Columns of thrust that rises, and that falls, more slowly; and that is less beside other jets. A short log does without."""
ENOUGH = 2
"""Cycles that there must be for each column."""
KEPT = 16
"""Timings of commands that are remembered."""


@dataclass(frozen=True)
class Design:
    """Columns of one stretch of a log. K cycles, p columns."""

    places: Mapping[str, slice]
    """Where each kind of column stands."""
    fired: IntArray
    """Indices of the channels that have a column."""
    growth: Array
    """(K − 1, p) what a unit acceleration by each column adds to the mean rate."""
    mean: Array
    """(K, p) mean over each cycle."""
    rate: Array
    """(K, 3) measured, rad/s."""
    force: Array
    """(K, 3) measured specific force, m/s²."""
    cycle_s: float
    """Mean length of a cycle."""
    level: Array
    """(3, 3) mean projector on the level plane, body axes."""
    used: BoolArray
    """(K, 2) whether gyro and accelerometer are."""
    clock_s: tuple[float, float]
    """From the log's beginning to the mean of the cycles' middles, and from the first of these to the last."""
    acted: tuple[Array, Array, Array]
    """(K, C) s each: what the channels that fired did under the rising half of each cycle's window, and under the falling one."""
    start_s: Array
    """(K,) of each cycle."""
    duration_s: Array
    nutation: float = 0.0
    """What stored momentum turns an error of the rate by, squared: (rad/s)²."""
    scatter: StatedScatter | None = None
    """What is stated beside the IMU's noise, where anything is."""

    @property
    def heard(self) -> Array:
        """(K,) by which the specific force is weighted: noise over what scatters beside it, one sigma."""
        return np.asarray(np.ones(len(self.mean)) if self.scatter is None else 1 / np.sqrt(1 + self.scatter.felt))

    @property
    def driven(self) -> Driven:
        """The rates, as they are made white."""
        coupling = COUPLING * (float((self.rate**2).sum(1).mean()) + self.nutation) * self.cycle_s**2
        steady = self.places["constant"].start if "constant" in self.places else None
        scattered, walking = (None, 0.0) if self.scatter is None else (self.scatter.turned, self.scatter.walking)
        return Driven(self.growth, self.rate, self.used[:, 0], coupling, False, steady, self.cycle_s, walking, scattered)


class _Window(NamedTuple):
    """What commands do under one timing: (K, 6) under the halves of the window, and in all."""

    rising: Array
    falling: Array
    whole: Array


class Designs:
    """Those of cases that differ by what is supposed."""

    def __init__(self) -> None:
        self._made: dict[tuple[object, ...], tuple[Array, Impulses]] = {}
        self._last: tuple[tuple[object, ...], Design] | None = None
        self._turned: dict[tuple[object, ...], list[tuple[str, Array]]] = {}

    def of(self, log: Log, vehicle: Resolved, timing: Timing, piece: slice, theta: Array | None = None) -> Design:
        """The columns of cycles ``piece``; with the motion within the cycles of a body ``theta`` (10,) where one is given.

        :class:`InputError` if they are too few.
        """
        asked = (log, vehicle, timing, piece, None if theta is None else theta.tobytes())
        if self._last is None or not all(a is b or (i > 1 and a == b) for i, (a, b) in enumerate(zip(self._last[0], asked, strict=True))):
            self._last = asked, self._design(log, vehicle, timing, piece, theta)
        return self._last[1]

    def _design(self, log: Log, vehicle: Resolved, timing: Timing, piece: slice, theta: Array | None) -> Design:
        lag_s = timing.lag_s(vehicle)
        samples = timing.of(log, vehicle, self._impulses(log, vehicle, timing.delay, lag_s))
        begun = max(int(np.argmax(samples.executed.usable)) + 1, 0 if samples.measured is None else samples.measured.settled)
        cycles = slice(max(piece.start, begun), min(piece.stop, len(samples) - 1))
        if cycles.stop - cycles.start < 2:
            raise InputError(
                f"{log.path}: {max(cycles.stop - cycles.start, 0)} cycles are too few to say how the motion follows the commands"
            )
        # what comes before it was commanded is no effect of a command that a controller made of the noise that is measured
        earliest = max(timing.delay - SHIFT, 0.0)
        moved = [self._window(log, vehicle, earliest + by, lag_s) for by in (0.0, SHIFT, 2 * SHIFT)]
        thrusts = [(name, self._window(log, other, timing.delay, lag_s), by) for name, other, by in _otherwise(log, vehicle, timing)]
        parts = list(_columns(samples, moved, (timing.delay - earliest) / SHIFT, thrusts, vehicle, cycles))
        parts += self._turned_columns(samples, vehicle, cycles) if vehicle.pivoted else []
        count, places = len(parts[0].mean), _places(parts)
        for further in (SUPPLY, RAMPS):
            if count < ENOUGH * _wide(places):
                parts = [part for part in parts if part.name not in further]
                places = _places(parts)
        if count < ENOUGH * _wide(places):
            raise InputError(f"{log.path}: {count} cycles are too few for {_wide(places)} free columns")
        acted = samples.executed.channels
        fired = np.flatnonzero(_acting(acted, cycles))
        growth, mean = (np.concatenate([part[i] for part in parts], 1) for i in (1, 2))
        rate = samples.rate_rad_s[cycles]
        if theta is not None:
            rate = rate - _by_body(samples.part(cycles), vehicle, theta, places, growth, mean)
        middle_s = samples.executed.start_s[cycles] + samples.executed.duration_s[cycles] / 2
        cycle_s, up = float(samples.executed.duration_s[cycles].mean()), samples.up_b[cycles]
        return Design(
            places,
            fired,
            growth,
            mean,
            rate,
            samples.specific_force_m_s2[cycles],
            cycle_s,
            np.eye(3) - up.T @ up / len(up),
            np.asarray(~samples.executed.ignored[cycles].reshape(-1, 2, 3).all(2)),
            (float(middle_s.mean()) - log.origin_s, float(np.ptp(middle_s))),
            (acted.rising[cycles][:, fired], acted.falling[cycles][:, fired], acted.whole[cycles][:, fired]),
            samples.executed.start_s[cycles],
            samples.executed.duration_s[cycles],
            nutation(samples.executed.stored, cycles, rate),
            scatter_of(samples.part(cycles), vehicle, places, growth, mean, rate),
        )

    def _window(self, log: Log, vehicle: Vehicle, delay: float, lag_s: float) -> _Window:
        wrench = channel_wrench(log, vehicle)
        made = self._impulses(log, vehicle, delay, lag_s)
        return _Window(*(net(part, wrench) for part in (made.rising, made.falling, made.whole)))

    def _turned_columns(self, samples: Samples, vehicle: Vehicle, cycles: slice) -> list[_Part]:
        """The world's X and Y, and by how much the vertical moves with what a gyro that carries it has wrong."""
        duration_s = samples.executed.duration_s[cycles]
        lasting = (duration_s[:-1] + duration_s[1:])[:, None] / 2
        found = self._verticals(samples, vehicle) if samples.measured is None else by_log(samples.measured.attitude_wxyz)
        return [_turning_with(name, turned, cycles, lasting) for name, turned in found]

    def _verticals(self, samples: Samples, vehicle: Vehicle) -> list[tuple[str, Array]]:
        """What a wrong gyro does to the vertical, as before where rates and the first vertical are the same."""
        told = (samples.rate_rad_s, samples.executed.duration_s, samples.up_b[0])
        key = (vehicle.imu.body_from_imu, *(part.tobytes() for part in told))
        if key not in self._turned:
            self._turned = dict([*self._turned.items()][-1:]) | {key: verticals_by_errors(samples, vehicle)}  # two, since they may be long
        return self._turned[key]

    def _impulses(self, log: Log, vehicle: Vehicle, delay: float, lag_s: float) -> Impulses:
        """What the commands do, as before where nothing differs that they go by."""
        times = tuple((jet.rise_s, jet.fall_s, jet.delay_s) for jet in vehicle.jets)
        thrust, imu = vehicle.thrust, vehicle.imu
        supply = thrust.droop, thrust.cycle_droop, thrust.failures, thrust.wrench_limits, thrust.least_on_s, thrust.dead_on_s
        others = tuple(one.model_dump_json() for _, own in vehicle.actuators for one in own)
        shown = log.sampled, imu.clock_drift_ppm, imu.gyro_filter, imu.accel_filter
        key = (id(log.command), delay, lag_s, vehicle.cycle.pulse_at, times, supply, shown, others)
        if key not in self._made:
            if len(self._made) == KEPT:
                del self._made[next(iter(self._made))]
            self._made[key] = log.command, impulses(log, vehicle, delay, lag_s)  # the array held, no other has its id
        return self._made[key][1]


class Case(NamedTuple):
    """A log as it is read."""

    log: Log
    vehicle: Resolved
    timing: Timing
    designs: Designs | None = None
    """Made of it so far, and of what is supposed of it; None: they are made anew."""
    whole: tuple[Log, slice] | None = None
    """The log that it is a part of, and the piece of that; None: it is no part."""

    @property
    def setup(self) -> Setup:
        """As the table of error parameters takes it."""
        return Setup(self.log, self.vehicle, self.timing)

    def design(self, piece: slice, theta: Array | None = None) -> Design:
        """Columns of cycles ``piece`` (:meth:`Designs.of`)."""
        return (self.designs or Designs()).of(self.log, self.vehicle, self.timing, piece, theta)


def _by_body(samples: Samples, vehicle: Vehicle, theta: Array, places: Mapping[str, slice], growth: Array, mean: Array) -> Array:
    """(K, 3) rate by the swing of a body's CG. Products of rates and the mean vertical are set to what they are in the motion that it has.

    The vertical within the cycles turns it by the body's weight, too, and is taken with θ: columns of a gyro's errors hold the vertical
    without it, and one that differs from their sum by the rate's noise alone would explain that noise.
    """
    phi_map = ResponseMap(plant_of(vehicle))
    step, whole, swung = integrals_about(samples, phi_map.reference(theta), vehicle)
    for name, column in (("products", phi_map.plant.channels - 6), ("up", 3), ("level", 6)):
        if name in places:
            own = places[name]
            here = slice(column, column + own.stop - own.start)
            if name == "up":
                swung = swung + (step[:, here] - growth[:, own]) @ phi_map.plant.response(theta)[:, here].T
            else:
                growth[:, own] = step[:, here]
            mean[:, own] = whole[:, here]
    if "level" in places:  # of the force that acts, as the channels' own columns have it, what is level stays
        force, duration_s = slice(3, 6), samples.executed.duration_s[:, None]
        growth[:, places["level"]] -= (samples.executed.rising[:-1] + samples.executed.falling[1:])[:, force]
        mean[:, places["level"]] -= samples.executed.whole[:, force] / duration_s
    if samples.executed.stored is not None:
        motion = intra_cycle_motion(samples, phi_map.reference(theta), phi_map).motion
        within = precessing_within(samples.executed.stored, motion, samples.executed.duration_s)
        for part, products_of in zip((growth, mean), within, strict=True):
            columns = np.arange(places["precession"].start, places["precession"].stop).reshape(-1, PER_AXIS)[:, :3]
            part[:, columns.ravel()] = products_of.reshape(len(part), -1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(swung, 0)])


def _otherwise(log: Log, vehicle: Vehicle, timing: Timing) -> Iterator[tuple[str, Vehicle, float]]:
    """Columns of jets that act otherwise: the vehicle that has them so, and by how many units."""
    if log.command_kind != "jets":
        return
    for column in (*RAMPS, *SUPPLY) if together(log) > 1 else RAMPS:
        (one,) = (BY_NAME[name] for name in BY_COLUMN[column])
        yield column, one.differing(Setup(log, vehicle, timing), one.difference).vehicle, one.difference


class _Part(NamedTuple):
    name: str
    growth: Array
    mean: Array


def _places(parts: Sequence[_Part]) -> dict[str, slice]:
    ends = np.cumsum([part.growth.shape[1] for part in parts]).tolist()
    return {part.name: slice(end - part.growth.shape[1], end) for part, end in zip(parts, ends, strict=True)}


def _wide(places: Mapping[str, slice]) -> int:
    return int(max(place.stop for place in places.values()))


def _columns(
    samples: Samples, moved: Sequence[_Window], at: float, thrusts: Sequence[tuple[str, _Window, float]], vehicle: Vehicle, cycles: slice
) -> list[_Part]:
    """Each kind: (K − 1, n) growth of the rate, (K, n) means.

    ``moved``: commands at three delays, ``SHIFT`` apart, of which the stated is ``at``; ``thrusts``: by jets that act otherwise by so many
    units.
    """
    executed = samples.executed
    duration = executed.duration_s[cycles, None]
    lasting = (duration[:-1] + duration[1:]) / 2
    rate, channels = samples.rate_rad_s[cycles], executed.channels
    fired = _acting(channels, cycles)
    middle, step = (rate[1:] + rate[:-1]) / 2, np.diff(rate, axis=0)
    # of a rate that grows linearly: its mean square under the triangular window, and over a cycle
    product = (products(middle) + products(step) / 6) * lasting
    inner = np.gradient(rate, axis=0)

    def by_window(one: _Window) -> tuple[Array, Array]:
        rising, falling, whole = (part[cycles] for part in one)
        return rising[:-1] + falling[1:], whole / duration

    wrench = by_window(_Window(*(net(part, channels.wrench) for part in channels.windows)))  # of the commands alone
    of_channels = by_window(_Window(*channels.windows))
    later, smeared = _parabola([by_window(one) for one in moved], at)
    middle_s = executed.start_s[cycles] + executed.duration_s[cycles] / 2
    clock = ((middle_s - middle_s.mean()) / np.ptp(middle_s))[:, None]
    clocks = (clock[1:] + clock[:-1]) / 2, clock
    # what a body does by itself comes first, so that what is supposed of that alone takes but the first columns
    parts = [
        _Part("channels", *(part[:, fired] for part in of_channels)),
        _Part("products", product, products(rate) + products(inner) / 12),
        _Part("constant", lasting, np.ones_like(duration)),
        *(_by_gravity(samples, cycles, lasting) if vehicle.pivoted else []),
        *([] if executed.stored is None else [_Part("precession", *precessing(executed.stored.part(cycles), rate, duration, lasting))]),
    ]
    if plant_of(vehicle).tilt_sigma > 0:
        turning = np.broadcast_to(samples.rate_rad_s, (2, *samples.rate_rad_s.shape))
        level = verticals(turning, samples.executed.duration_s, np.eye(3)[:2])
        parts += [_turning_with(f"slope {i}", edges, cycles, lasting) for i, edges in enumerate(level)]
    parts += [
        _Part("rates", middle * lasting, rate),
        _Part("later", *later),
        *_lagging(vehicle, *later),
        _Part("smeared", *smeared),
        _Part("drifting", *(c * x for c, x in zip(clocks, later, strict=True))),
        _Part("aging", *(c * x for c, x in zip(clocks, wrench, strict=True))),
    ]
    return parts + [_Part(name, *((b - a) / by for a, b in zip(wrench, by_window(own), strict=True))) for name, own, by in thrusts]


def _acting(channels: Channels, cycles: slice) -> BoolArray:
    """(C,) which channels have a column: those that acted, and all that store momentum, which turns with the body."""
    return np.asarray((channels.whole[cycles] != 0).any(0) | (np.arange(len(channels.wrench)) >= channels.thrusting))


def _parabola(moved: Sequence[tuple[Array, Array]], at: float) -> tuple[list[Array], list[Array]]:
    """Slope and curvature, by a cycle's delay, of what commands do at three delays ``SHIFT`` apart, where it is ``at`` one of them."""
    early, between, late = moved
    curvature: list[Array] = [(a - 2 * b + c) / SHIFT**2 for a, b, c in zip(early, between, late, strict=True)]
    return [(c - a) / (2 * SHIFT) + (at - 1) * SHIFT * bent for a, c, bent in zip(early, late, curvature, strict=True)], curvature


def _lagging(vehicle: Vehicle, growth: Array, mean: Array) -> list[_Part]:
    """What comes later as sensors see it that lag by so much already: ``d/dL 1 / (1 + sL)``, as a low-pass of what was undone has it."""
    imu, period = vehicle.imu, vehicle.cycle.period_s
    if imu.gyro_lag_s == 0 and imu.accel_lag_s == 0:
        return []
    seen = [recorded.applied(part, period, lag) for part, lag in ((growth, imu.gyro_lag_s), (mean, imu.accel_lag_s))]
    return [_Part("lagging", *seen)]


def _turning_with(name: str, vector: Array, cycles: slice, lasting: Array) -> _Part:
    """Of a vector (K + 1, 3) at the edges of all cycles."""
    edges = vector[cycles.start : cycles.stop + 1]
    bent = np.zeros_like(edges)
    bent[1:-1] = edges[2:] - 2 * edges[1:-1] + edges[:-2]
    return _Part(name, (edges + bent / 12)[1:-1] * lasting, (edges[1:] + edges[:-1]) / 2 - (bent[1:] + bent[:-1]) / 24)


def _by_gravity(samples: Samples, cycles: slice, lasting: Array) -> list[_Part]:
    """The vertical, and what of the force is level; each (K − 1, 3) under the triangular window, (K, 3) means."""
    executed = samples.executed
    duration = executed.duration_s[cycles, None]
    mean = (samples.up_b[:-1] + samples.up_b[1:]) / 2
    # what of the force acts along the vertical, under both halves of the window
    rising, falling, whole = (
        (-mean * (mean * part[:, 3:]).sum(1, keepdims=True))[cycles] for part in (executed.rising, executed.falling, executed.whole)
    )
    return [_turning_with("up", samples.up_b, cycles, lasting), _Part("level", rising[:-1] + falling[1:], whole / duration)]
