"""What the numbers rest on and the log can't tell, or not well, and what an error of it would do to each value.

Each assumption is varied by one step (a percent, a millimetre, a degree) and carried through the filter beside the estimate
(:mod:`massprop_cli.model.sensitivity`). What of the change no mass properties absorb stays in the innovations: so many sigmas would the log
itself misfit, which says whether it would notice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.estimate.engine import respond
from massprop_cli.estimate.history import History
from massprop_cli.estimate.rows import Response
from massprop_cli.inputs.rotor import Rotor
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.wheel import Wheel
from massprop_cli.model.linearise import MU
from massprop_cli.model.sensitivity import Consider, Side, Variant, late
from massprop_cli.prepare.actuators import channel_names
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

DEGREE = float(np.pi / 180)
UNSEEN = 5.0
"""Sigmas of misfit that a log does not show."""
SHOWN = 0.01
"""A change below this part of a sigma is none."""
AXES = "XYZ"
Spinner = TypeVar("Spinner", Wheel, Rotor)


@dataclass(frozen=True)
class Effect:
    """Of one step on one phase."""

    phase: str
    change: dict[str, float]
    """Of each value that it moves, in its unit."""
    seen_sigma: float | None
    """How far the log would misfit, in sigmas; None where it can't."""


@dataclass(frozen=True)
class Assumption:
    """Something taken for granted."""

    code: str
    message: str
    step: str
    stated: bool
    """Whether the vehicle file states it; else it is a default."""
    effects: tuple[Effect, ...]


@dataclass(frozen=True)
class Taken:
    """An assumption, and how it is varied: ``size`` units make one step."""

    code: str
    message: str
    step: str
    stated: bool
    variant: Variant | None
    """None: one of the columns that follow all variants."""
    size: float
    sigma: float = 0.0
    """One sigma, units, by which it is stated to be uncertain."""


class Later(NamedTuple):
    """What the log says of the stated delay."""

    cycles: float
    """By which commands come later than they were read."""
    sigma: float
    """Of that, by the noise levels in use."""
    before: float
    """Chi-square of what is left as it was read, over all channels and cycles."""
    after: float
    """The same so much later."""


@dataclass(frozen=True)
class Examined:
    """What is taken for granted, and what each of it does to each phase."""

    taken: tuple[Taken, ...]
    responses: tuple[Response | None, ...]
    """To one unit of each variant, then of the scale of each of the accelerometer's axes, then of each channel's thrust; None of a phase
    without a reference."""
    count: int
    """How many innovations there are in all."""
    noise: tuple[Array, ...]
    """(4,) of each phase: sum of squared innovations, normalised, of the gyro and along each of the accelerometer's axes."""

    @property
    def scatter(self) -> float:
        """Mean square of what is left of all phases, normalised."""
        return float(np.sum([part.sum() for part in self.noise]) / max(self.count, 1))

    @property
    def varied(self) -> list[Taken]:
        """Those that have a variant."""
        return [t for t in self.taken if t.variant is not None]

    def step(self, taken: Taken, columns: int) -> Array:
        """(e,) units of each column that make one step."""
        found, first = np.zeros(columns), len(self.varied)
        at = next((i for i, t in enumerate(self.varied) if t is taken), None)
        found[slice(first, first + 3) if at is None else at] = taken.size
        return found

    def delay(self) -> Later | None:
        """None where nothing tells."""
        at = next((i for i, t in enumerate(self.varied) if t.code == "command-delay"), None)
        grams = [response.gram[np.ix_([0, at + 1], [0, at + 1])] for response in self.responses if response is not None and at is not None]
        if not grams or not sum(gram[1, 1] for gram in grams) > 0:
            return None
        (before, cross), (_, own) = np.sum(grams, 0)
        return Later(float(-cross / own), float(own**-0.5), float(before), float(before - cross**2 / own))


def examined(
    log: Log,
    vehicle: Vehicle,
    timing: Timing,
    samples: Stream,
    settled: Sequence[History],
    consider: Consider = Consider(),  # noqa: B008
) -> Examined:
    """One pass through each phase about its off-line fit; noise levels must be set in ``vehicle``.

    The geometry that is uncertain in ``consider`` is unknown beside what is varied.
    """
    taken = tuple(_taken(log, vehicle, timing, samples))
    consider = consider.about(Consider(tuple(t.variant for t in taken if t.variant is not None), scales=True))
    responses = [
        None if history.reference is None else respond(samples, history.cycles, history.reference, vehicle, consider) for history in settled
    ]
    innovations = [history.normalised[np.isfinite(history.normalised).all(1)] for history in settled]
    along = [part[:, 3:] @ np.array(vehicle.imu.body_from_imu) for part in innovations]
    noise = [np.array([(part[:, :3] ** 2).sum(), *(own**2).sum(0)]) for part, own in zip(innovations, along, strict=True)]
    return Examined(taken, tuple(responses), sum(part.size for part in innovations), tuple(noise))


def assumptions(
    found: Examined, log: Log, vehicle: Vehicle, settled: Sequence[History], conclusions: Sequence[Conclusion]
) -> tuple[Assumption, ...]:
    """All of a log. Without a reference in any phase only what needs none."""
    listed = _thrust_scale(vehicle, conclusions) if not vehicle.spinning else []
    effects: list[list[Effect]] = [[] for _ in found.taken]
    for history, conclusion, response in zip(settled, conclusions, found.responses, strict=True):
        if response is None:
            continue
        for of_one, t in zip(effects, found.taken, strict=True):
            of_one.append(_effect(history, conclusion, vehicle, response, found.step(t, response.shift.shape[1])))
        listed += _mass_thrust(log, vehicle, history, conclusion, response, len(found.varied) + 3)
        listed += _beside(history, conclusion, response)
    told = zip(found.taken, effects, strict=True)
    return (*listed, *(Assumption(t.code, t.message, t.step, t.stated, tuple(e)) for t, e in told if e))


def _thrust_scale(vehicle: Vehicle, conclusions: Sequence[Conclusion]) -> list[Assumption]:
    """The scale common to all thrust: mass and inertia are proportional to it, and nothing in a log depends on it."""
    effects = []
    for conclusion in conclusions:
        known = vehicle.in_phase(conclusion.phase).known
        if any(name not in CG for name in known):
            continue
        values = conclusion.estimates.items()
        change = {name: 0.01 * e.value for name, e in values if e.value is not None and name not in CG}
        effects.append(Effect(conclusion.phase.name, change, None))
    if not effects:
        return []
    sigma = vehicle.thrust.scale_sigma
    message = "mass and inertia are proportional to the thrust that the vehicle file states; a scale common to all thrust can't be seen"
    said = f"; its stated uncertainty, {100 * sigma:g} %, is in every sigma" if sigma else "; no uncertainty of it is stated"
    return [Assumption("thrust-scale", message + said, "1 %", sigma > 0, tuple(effects))]


def _mass_thrust(log: Log, vehicle: Vehicle, history: History, conclusion: Conclusion, response: Response, first: int) -> list[Assumption]:
    """The command channels (columns from ``first`` on) on which the mass rests alone, with what one percent of their thrust does."""
    fired = np.diag(response.misfit)[first:] > 0  # what never acted leaves nothing
    fired[len(fired) - len(vehicle.spinning) :] = False  # and wheels don't push
    chosen = np.zeros(len(fired), dtype=bool)
    chosen[fired] = _alone(response.misfit[first:, first:][np.ix_(fired, fired)], response.shift[:, first:][:, fired], conclusion)
    if conclusion.estimates["mass"].value is None or not chosen.any() or (chosen == fired).all():
        return []
    names = channel_names(log, vehicle)
    listed = ", ".join(name for name, is_one in zip(names, chosen, strict=True) if is_one)
    step = 0.01 * np.concatenate([np.zeros(first), chosen])
    several = f" of phase {history.phase.name}" if len(vehicle.phases) > 1 else ""
    message = f"the mass{several} rests on the thrust of {listed} alone; an error common to these can't be seen"
    return [Assumption("mass-thrust", message, "1 %", True, (_effect(history, conclusion, vehicle, response, step),))]


BESIDE = {
    "jet-thrust": ("each jet's own thrust is as uncertain as jets.thrust_sigma says", "jets.thrust_sigma"),
    "jet-position": ("jets sit where they are stated to within jets.position_sigma_m", "jets.position_sigma_m"),
    "jet-direction": ("jets point where they are stated to within jets.direction_sigma_rad", "jets.direction_sigma_rad"),
    "imu-position": ("the IMU sits where it is stated to within imu.position_sigma_m", "imu.position_sigma_m"),
    "imu-mounting": ("the IMU is turned as it is stated to within imu.mounting_sigma_rad", "imu.mounting_sigma_rad"),
    "damping": ("the log was asked for a torque against the rate, {damping} N m s times it", "environment.damping_sigma_n_m_s"),
}
"""What is unknown beside the mass properties and found with them, and the key that says by how much."""


def _beside(history: History, conclusion: Conclusion, response: Response) -> list[Assumption]:
    """What the stated uncertainty of jets and IMU, and damping, add to each sigma, squares added; it is in every sigma."""
    found = []
    damping = ", ".join(f"{axis}: {value:.4g} ± {sigma:.2g}" for axis, (value, sigma) in zip(AXES, response.damping, strict=False))
    for kind, variance in response.added.items():
        part = np.sqrt(np.maximum(variance, 0.0))
        part[MU] = part[MU] / history.reference.mu**2 if history.reference is not None else np.nan
        change = {
            name: float(size)
            for name, size in zip(QUANTITIES, part, strict=True)
            if (sigma := conclusion.estimates[name].sigma) is not None and size > SHOWN * sigma
        }
        message, key = BESIDE[kind]
        said = f"{message.format(damping=damping)}; that is in every sigma, and so much of it"
        found.append(Assumption(f"uncertain-{kind}", said, f"its {key}", True, (Effect(history.phase.name, change, None),)))
    return found


def _alone(misfit: Array, shift: Array, conclusion: Conclusion) -> BoolArray:
    """(C,) which channels' thrust the mass takes its scale from, if it is not the one that the inertia takes its own from.

    Among changes of the channels' thrust that a percent of would not show in the log, that one is sought which moves the mass and leaves
    the inertia's trace: it is one for the channels that count and zero for the others. ``misfit`` (C, C), ``shift`` (10, C) per unit.
    """
    values = conclusion.bare[0]
    sizes, axes = np.linalg.eigh(misfit)
    weak = axes[:, 1e-4 * sizes < UNSEEN**2]
    by_mass, by_trace = -shift[MU] * values[9], shift[[0, 3, 5]].sum(0) / values[[0, 3, 5]].sum()
    targets = np.stack([by_mass, by_trace]) @ weak
    if not np.isfinite(targets).all() or np.linalg.matrix_rank(targets, tol=1e-3) < 2:
        return np.zeros(len(misfit), dtype=bool)
    found = weak @ np.linalg.pinv(targets) @ np.array([1.0, 0.0])
    alone: BoolArray = found > 0.5
    return alone if np.abs(found - alone).max() < 0.5 else np.zeros(len(misfit), dtype=bool)


def _effect(history: History, conclusion: Conclusion, vehicle: Vehicle, response: Response, step: Array) -> Effect:
    """Of ``step`` (e,) units of each column of the response."""
    moved = response.shift @ step
    reference = history.reference
    moved[MU] = -moved[MU] / reference.mu**2 if reference is not None else np.nan
    known = vehicle.in_phase(history.phase).known
    change = {}
    for name, value, size in zip(QUANTITIES, moved, history.natural_sizes, strict=True):
        estimate = conclusion.estimates[name]
        least = max(SHOWN * (estimate.sigma or 0.0), 1e-9 * size)
        if estimate.value is not None and name not in known and abs(value) > least:
            change[name] = float(value)
    return Effect(history.phase.name, change, float(np.sqrt(max(float(step @ response.misfit @ step), 0.0))))


def _taken(log: Log, vehicle: Vehicle, timing: Timing, samples: Stream) -> Iterator[Taken]:
    """What is varied, each about the log as it was read."""
    here = Side(samples)
    imu, stated = vehicle.imu, vehicle.imu.model_fields_set
    words = f"imu.position_m is {'stated as' if 'position_m' in stated else 'not stated and taken as'} {_vector(imu.position_m)} m"
    for i, axis in enumerate(AXES):
        further = _with(vehicle, "imu", "position_m", _moved(imu.position_m, i, 1e-3))
        variant = Variant(here, Side(here.samples, further), 1e-3)
        yield Taken("imu-position", f"{words}; further along {axis}", "1 mm", "position_m" in stated, variant, 1e-3)
    words = "as stated" if "body_from_imu" in stated else "not stated: the IMU's axes are taken as the body's"
    for i, axis in enumerate(AXES):
        mounted = _rotation(i, 0.1 * DEGREE) @ np.array(imu.body_from_imu)
        used = _with(vehicle, "imu", "body_from_imu", tuple(tuple(float(x) for x in row) for row in mounted))
        variant = Variant(here, Side(samples.changed(used), used), 0.1 * DEGREE)
        message = f"imu.body_from_imu is {words}; turned about {axis}"
        yield Taken("imu-mounting", message, "1 degree", "body_from_imu" in stated, variant, DEGREE)
    later = late(log, vehicle, timing, "delay")
    if later is not None:
        sigma = vehicle.cycle.command_delay_sigma_cycles
        words = "its uncertainty is in every sigma" if sigma > 0 else "taken as exact (cycle.command_delay_sigma_cycles is not stated)"
        yield Taken("command-delay", f"the command delay is {timing.delay:.6g} cycles; {words}", "0.1 cycles", True, later, 0.1, sigma)
    scaled = Variant(here, Side(samples.changed(gyro=1.01)), 0.01)
    yield Taken("gyro-scale", "the gyro's scale is taken as exact", "1 %", False, scaled, 0.01)
    yield Taken("accelerometer-scale", "the accelerometer's scale is taken as exact", "1 %", False, None, 0.01)
    if vehicle.spinning:
        yield _wheel_inertia(log, vehicle, timing, here)
    if vehicle.on_air_bearing:
        yield from _on_bearing(vehicle, here, samples)


def _wheel_inertia(log: Log, vehicle: Vehicle, timing: Timing, here: Side) -> Taken:
    used = vehicle.model_copy(update={"wheels": tuple(map(_heavier, vehicle.wheels)), "rotors": tuple(map(_heavier, vehicle.rotors))})
    uncertain = any(wheel.spin_inertia_sigma_kg_m2 > 0 for wheel in vehicle.spinning)
    words = "its uncertainty is in every sigma" if uncertain else "no uncertainty of it is stated (spin_inertia_sigma_kg_m2)"
    message = f"inertia rests on the spin inertia that the vehicle file states of its wheels; {words}"
    return Taken("wheel-inertia", message, "1 %", True, Variant(here, Side(Stream.of(log, used, timing), used), 0.01), 0.01)


def _heavier(one: Spinner) -> Spinner:
    return one if one.spin_inertia_kg_m2 is None else one.model_copy(update={"spin_inertia_kg_m2": 1.01 * one.spin_inertia_kg_m2})


def _on_bearing(vehicle: Vehicle, here: Side, samples: Stream) -> Iterator[Taken]:
    environment, stated = vehicle.environment, vehicle.environment.model_fields_set
    for code, key, unit in (("bearing-mass", "bearing_mass_kg", "kg"), ("gravity", "gravity_m_s2", "m/s^2")):
        value = getattr(environment, key)
        if value > 0:
            changed = _with(vehicle, "environment", key, 1.01 * value)
            message = f"environment.{key} is {'stated' if key in stated else 'not stated and taken'} as {value:g} {unit}"
            yield Taken(code, message, "1 %", key in stated, Variant(here, Side(here.samples, changed), 0.01), 0.01)
    place = environment.bearing_position_m
    for i, axis in enumerate(AXES):
        changed = _with(vehicle, "environment", "bearing_position_m", _moved(place, i, 1e-4))
        message = f"environment.bearing_position_m is {_vector(place)} m; further along {axis}"
        variant = Variant(here, Side(here.samples, changed), 1e-4)
        yield Taken("bearing-position", message, "1 mm", "bearing_position_m" in stated, variant, 1e-3)
    for i, axis in enumerate("" if samples.attitude_logged else "XY"):
        variant = Variant(here, _tilted(samples, vehicle, i, 0.1 * DEGREE), 0.1 * DEGREE)
        message = f"environment.initial_attitude_wxyz is {_vector(environment.initial_attitude_wxyz)}; tilted about the world's {axis}"
        yield Taken("initial-attitude", message, "1 degree", "initial_attitude_wxyz" in stated, variant, DEGREE)


def _vector(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _moved(place: Sequence[float], axis: int, by: float) -> tuple[float, ...]:
    return tuple(float(x) + by * (i == axis) for i, x in enumerate(place))


def _with(vehicle: Vehicle, section: str, key: str, value: object) -> Vehicle:
    return vehicle.model_copy(update={section: getattr(vehicle, section).model_copy(update={key: value})})


def _tilted(samples: Stream, vehicle: Vehicle, axis: int, angle: float) -> Side:
    w, x, y, z = vehicle.environment.initial_attitude_wxyz
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    about_x = (c * w - s * x, c * x + s * w, c * y - s * z, c * z + s * y)
    about_y = (c * w - s * y, c * x + s * z, c * y + s * w, c * z - s * x)
    used = _with(vehicle, "environment", "initial_attitude_wxyz", tuple(float(v) for v in (about_x, about_y)[axis]))
    return Side(samples.changed(used), used)


def _rotation(axis: int, angle: float) -> Array:
    """(3, 3) by ``angle`` about a body axis."""
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
    return turn
