"""Faults of the body and its surroundings, and two faults at once."""

from dataclasses import replace
from functools import partial

import numpy as np
from fault_imu import in_degrees, mounted, right_angle, rotation
from fault_named import Drawn, Due, Fault, Number, due
from fault_thrust import Random, failing, on_a_jet, stated_forces, unit
from fault_vehicles import INCREMENTS, Body, Case, Subject

from massprop_cli.base.arrays import Array
from massprop_cli.testbed.truth import STANDARD_GRAVITY

BURNT = 0.05
"""Part of the mass that is burnt."""
PIECES = 40
"""Bodies that a vehicle which burns fuel is taken to be, one after another."""
NEAR = 10
"""Cycles that a time may be off: nothing tells a change while nothing is commanded."""


def _docking(s: Subject) -> int:
    return next(k for k, kind in s.flight.events if kind == "dock")


def _joined(s: Subject, rng: Random) -> Drawn:
    """An object docks, and the vehicle file states no phases."""
    if s.vehicle.phases:
        at = _docking(s)
        wrong = s.clean
    else:
        at = int(rng.uniform(0.35, 0.65) * s.cycles)
        body, part = s.source.scenario.truth, rng.uniform(0.1, 0.25)
        arm = np.sqrt(body.izz / body.mass) * unit(rng)
        if s.vehicle.on_air_bearing:
            arm = 0.01 * arm  # it stays balanced
        found = {name: part * getattr(body, name) for name in ("ixx", "iyy", "izz", "mass")}
        found |= {f"cg_{axis}": float(x) for axis, x in zip("xyz", arm, strict=True)}
        docked = "{" + ", ".join(f"{name} = {value}" for name, value in found.items()) + "}"
        wrong = s.flown(f"docked={docked}", f'events=[{{kind = "dock", cycle = {at}, motion = "rates_kept"}}]')
    time = at * s.period_s
    unaware = replace(wrong, vehicle=wrong.vehicle.model_copy(update={"phases": (), "docking": None}))
    return Drawn(unaware, due("mass-change", Number(time, NEAR * s.period_s)), f"an object docks at {time:g} s, unstated")


def _dock_off(s: Subject, rng: Random) -> Drawn | None:
    """The vehicle file states the docking too early or too late."""
    if not s.vehicle.phases:
        return None
    time = _docking(s) * s.period_s
    off = float(rng.choice([-1, 1])) * rng.uniform(4, 40) * s.period_s
    wrong = s.clean.stating(f"phases.0.end_s={time + off}", f"phases.1.start_s={time + off}")
    what = f"docks at {time:g} s, stated {time + off:.4g}"
    return Drawn(wrong, due("phase-border", Number(time, NEAR * s.period_s)), what)


def _glued(s: Subject, rng: Random) -> Drawn | None:
    """Logs of two bodies, one after the other."""
    if s.vehicle.phases or s.vehicle.on_air_bearing:
        return None  # phases are stated; the second log's attitude would be another fault
    at = int(rng.uniform(0.4, 0.6) * s.cycles)
    body, factor = s.source.scenario.truth, rng.uniform(1.15, 1.4)
    second = s.flown(*(f"truth.{name}={factor * getattr(body, name)}" for name in ("ixx", "iyy", "izz", "mass")))
    first, time, row = s.clean, at * s.period_s, at * s.clean.log.records_per_cycle
    joints = {**dict.fromkeys(INCREMENTS.values(), (row, first.log.rows - row)), "command": (at, s.cycles - at)}
    glued = first.logging(
        **{name: np.concatenate([getattr(first.log, name)[:n], getattr(second.log, name)[:m]]) for name, (n, m) in joints.items()}
    )
    bodies = (Body(0.0, time, first.bodies[0].values), Body(time, np.inf, second.bodies[0].values))
    wrong = replace(glued, bodies=bodies)
    # where the second motion doesn't go on from the first, the cycles between them are of neither body
    border = Due(("mass-change", "phase-border"), (Number(time, NEAR * s.period_s),))
    return Drawn(wrong, (border,), f"another body's log from {time:g} s on")


def _fuel(s: Subject, _: Random) -> Drawn | None:
    if not s.vehicle.jets:
        return None
    force = np.linalg.norm(s.vehicle.jet_wrench[:, 3:], axis=1)
    impulse = float((s.flight.issued[0] @ force).sum())
    specific = impulse / (BURNT * s.source.scenario.truth.mass * STANDARD_GRAVITY)
    flight = s.again(f"fuel.specific_impulse_s={specific}")
    burnt = np.cumsum(flight.issued[0] @ force) / (specific * STANDARD_GRAVITY)
    bodies = []
    for phase, end in zip(flight.phases, flight.truth[0], strict=True):
        edges = np.linspace(phase.start_s, phase.end_s, PIECES + 1)
        at = np.interp(edges, s.period_s * np.arange(1, s.cycles + 1), burnt)
        masses = end[9] + at[-1] - at
        bodies += [Body(a, b, _of_mass(end, mass)) for a, b, mass in zip(edges, edges[1:], masses[1:], strict=False)]
    wrong = Case(flight.log(0), s.vehicle, tuple(bodies))
    return Drawn(wrong, due("fuel-use"), f"{burnt[-1]:.3g} kg of fuel burnt, unstated")


def _of_mass(values: Array, mass: float) -> Array:
    changed = values.copy()
    changed[9] = mass
    return changed


def _steady(s: Subject, rng: Random) -> Drawn:
    torque = rng.uniform(0.01, 0.03) * s.full_torque.min() * unit(rng)
    return Drawn(s.flown(f"disturbance.constant_n_m={torque.tolist()}"), due("steady-torque"), f"steady torque {torque.tolist()} N m")


def _room(s: Subject, rng: Random) -> Drawn | None:
    if not s.vehicle.pivoted:
        return None
    full = float(s.full_torque.min()) or s.source.scenario.actuators.max_wheel_torque_n_m or 0.0
    torque = rng.uniform(0.002, 0.03) * full * unit(rng)
    what = f"torque {torque.tolist()} N m, fixed in the room"
    return Drawn(s.flown(f"disturbance.room_n_m={torque.tolist()}"), due("room-torque"), what)


def _walk(s: Subject, _: Random, part: float) -> Drawn | None:
    size = part * float(s.full_torque.min())
    if s.source.scenario.disturbance.walk_n_m is not None:
        return None  # it has one already
    return Drawn(s.flown(f"disturbance.walk_n_m={size}"), due("disturbance-torque"), f"torque walks {size:.3g} N m per cycle")


def _periodic(s: Subject, rng: Random) -> Drawn:
    torque = rng.uniform(0.02, 0.05) * s.full_torque.min() * unit(rng)
    period = s.cycles * s.period_s / rng.uniform(5, 15)
    keys = f"disturbance.periodic_n_m={torque.tolist()}", f"disturbance.periodic_s={period}"
    return Drawn(s.flown(*keys), due("periodic-torque"), f"torque {torque.tolist()} N m, period {period:.3g} s")


def _friction(s: Subject, rng: Random) -> Drawn:
    body, lasts = s.source.scenario.truth, rng.uniform(0.3, 1.0) * s.cycles * s.period_s
    drag = [getattr(body, name) / lasts for name in ("ixx", "iyy", "izz")]
    return Drawn(s.flown(f"disturbance.rate_n_m_s={drag}"), due("rate-torque"), f"rates decay within {lasts:.3g} s")


def _attitude(s: Subject, rng: Random) -> Drawn | None:
    if not s.vehicle.on_air_bearing:
        return None
    half = np.radians(rng.uniform(1.0, 2.0)) / 2
    heading = rng.uniform(0, 2 * np.pi)
    start = [float(np.cos(half)), float(np.sin(half) * np.cos(heading)), float(np.sin(half) * np.sin(heading)), 0.0]
    wrong = s.clean.stating(f"environment.initial_attitude_wxyz={start}")
    return Drawn(wrong, due("attitude-start"), f"stated attitude at the start {np.degrees(2 * half):.2f} degrees off level")


def _bearing(s: Subject, rng: Random) -> Drawn | None:
    if not s.vehicle.on_air_bearing:
        return None
    stated = np.array(s.vehicle.environment.bearing_position_m) + 0.001 * unit(rng)
    return Drawn(s.clean.stating(f"environment.bearing_position_m={stated.tolist()}"), due("bearing-position"), "bearing 1 mm out of place")


@on_a_jet
def _sign_in_degrees(s: Subject, _: Random, jet: str) -> Drawn:
    wrong = in_degrees(stated_forces(s, s.clean, {jet: -1.0}))
    return Drawn(wrong, (*due("jet-sign", channels=[jet]), *due("gyro-units", "degrees")), f"{jet} reversed, gyro in degrees")


@on_a_jet
def _dead_and_turned(s: Subject, rng: Random, jet: str) -> Drawn:
    wrong = mounted(s, s.flown(failing([jet])), right_angle(rng))
    return Drawn(wrong, (*due("jet-dead", channels=[jet]), Due(("imu-mounting",))), f"{jet} dead, IMU turned by right angles")


@on_a_jet
def _weak_and_tilted(s: Subject, rng: Random, jet: str) -> Drawn:
    wrong = mounted(s, stated_forces(s, s.clean, {jet: 1 / 0.8}), rotation(unit(rng), 10.0))
    dues = (*due("thrust-scale", channels=[jet]), *due("imu-mounting", Number(10.0, 1.5)))
    return Drawn(wrong, dues, f"{jet} gives 80 %, IMU tilted by 10 degrees")


BODY = (
    Fault("docked", "an object docks, unstated", _joined),
    Fault("dock-off", "docking stated 4 to 40 cycles early or late", _dock_off),
    Fault("glued", "two logs glued together", _glued),
    Fault("fuel", "5 % of the mass burnt, unstated", _fuel),
    Fault("steady-torque", "steady torque of 1 to 3 % of full", _steady),
    Fault("room-torque", "torque of 0.2 to 3 % of full, fixed in the room", _room),
    Fault("walk-small", "torque walks 0.02 % of full per cycle", partial(_walk, part=2e-4)),
    Fault("walk-large", "torque walks 0.2 % of full per cycle", partial(_walk, part=2e-3)),
    Fault("periodic", "periodic torque of 2 to 5 % of full", _periodic),
    Fault("friction", "torque against the rate", _friction),
    Fault("attitude-start", "attitude at the start 1 to 2° wrong", _attitude),
    Fault("bearing-1mm", "bearing 1 mm out of place", _bearing),
    Fault("sign-degrees", "one jet reversed, gyro in degrees", _sign_in_degrees),
    Fault("dead-turned", "one jet dead, IMU turned by right angles", _dead_and_turned),
    Fault("weak-tilted", "one jet at 80 %, IMU tilted by 10°", _weak_and_tilted),
)
