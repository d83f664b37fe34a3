"""What a supposition says, in words: its code, and what the log or the vehicle file would have to be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.diagnosis.contest import Fitted
from massprop_cli.diagnosis.cures import NEAR, Case

SENSORS = {"gyro": "gyro", "accel": "accelerometer"}
GROWN = 1.0
"""Percent by which mass or inertia may seem to grow by chance."""
TRIED = (
    "tried: sign, thrust, place and direction of each channel, groups of channels, jets swapped, delay, rise, lag, droop, clock drift, "
    "units, scales, biases, low-pass and mounting of gyro and accelerometer, IMU position, attitude at the start, steady and "
    "rate-proportional torque, fuel use, a change of the mass properties, a phase's borders, a jet that fails for a time, and pairs"
)
DEAD = "the gyro or the accelerometer reads 0 in every cycle: it is not recorded, or dead"
UNANSWERED = (
    "log and vehicle file don't fit, cause unknown: the motion is no noise, and hardly follows the commands; are they this recording's, on "
    f"its clock, and were they executed? {TRIED}"
)
IN_VEHICLE_FILE, IN_MAP = "under [columns]", "in the map (unit, scale, axes)"
"""Where the columns of a plain log are mended, and those of a recording."""


@dataclass(frozen=True)
class Said:
    """A supposition with its values, the channels' names, and the log as stated and as mended."""

    found: Fitted
    names: Sequence[str]
    stated: Case
    mended: Case

    @property
    def subject(self) -> tuple[str, ...]:
        """What it is about."""
        return self.found.supposed.subject

    @property
    def channel(self) -> int:
        """The one that it is about, among those that fired."""
        return list(self.names).index(self.subject[0])

    def sigma(self, name: str) -> float:
        """Of an entry in cycles."""
        return float(self.found.sigma(name)[0])

    def seconds(self, name: str) -> float:
        """An entry in cycles."""
        return float(self.found.value(name)[0]) * self.stated.vehicle.cycle.period_s

    def body(self, name: str, unit: float = 1.0) -> str:
        """An entry in body axes."""
        return _vector(self.found.value(name) * unit)

    def imu(self, name: str) -> str:
        """An entry in the IMU's own axes."""
        return _vector(self.found.model.mounting.T @ self.found.value(name))


def words_of(found: Fitted, names: Sequence[str], stated: Case, mended: Case) -> tuple[str, str]:
    """(code, words) that go on "the log fits if …"."""
    said = Said(found, names, stated, mended)
    code, words = _thrust(said) if found.supposed.code == "thrust-scale" else (found.supposed.code, _WORDS[found.supposed.code](said))
    return code, words if stated.log.made is None else words.replace(IN_VEHICLE_FILE, IN_MAP)


def alone(found: Fitted, name: str) -> Fitted:
    """Of a supposition about several channels, what it says of one."""
    return replace(found, supposed=replace(found.supposed, subject=(name,)))


def _thrust(said: Said) -> tuple[str, str]:
    factor, by_jets = float(said.found.value("thrust")[said.channel]), said.stated.log.command_kind == "jets"
    several = len(said.subject) > 1
    listed = ", ".join(said.subject)
    who = listed if not by_jets else f"jets {listed}" if several else f"jet {listed}"
    if abs(factor + 1) < NEAR and several and len(said.subject) == len(said.names):
        way = (
            "force_n is what pushes the vehicle, not the plume"
            if by_jets
            else "commands are what acts on the vehicle, not what it reacts to"
        )
        remedy = "mend the sign of every force_n" if by_jets else "mend their signs under [columns]"
        return "jet-sign" if by_jets else "command-sign", f"all {'jets push' if by_jets else 'commands act'} the other way: {way}; {remedy}"
    if abs(factor + 1) < NEAR:
        remedy = "mend force_n" if by_jets else "mend the sign under [columns]"
        return "jet-sign" if by_jets else "command-sign", f"{who} {'push' if several else 'pushes'} the other way than stated; {remedy}"
    if abs(factor) < NEAR:
        return "jet-dead", f"{who} {'do' if several else 'does'} not push at all; look at valves and wiring"
    mend = "mend the unit or scale of these, or of the others, under [columns]" if several else "mend the scale under [columns]"
    remedy = "mend force_n or calibrate" if by_jets else mend
    return "thrust-scale", f"{who} ({factor:+.4g}) {'give' if several else 'gives'} another part of the stated thrust than others; {remedy}"


def _position(said: Said) -> str:
    by = said.found.value("position").reshape(-1, 3)[said.channel]
    return f"jet {said.subject[0]} sits {_vector(1e3 * by)} mm away from its position_m; mend it"


def _direction(said: Said) -> str:
    stated, true = said.found.model.force[said.channel], said.found.model.wrench(said.found.x)[1][said.channel]
    cosine = stated @ true / np.linalg.norm(stated) / np.linalg.norm(true)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return f"jet {said.subject[0]} pushes {angle:.3g} degrees away from its force_n, with {_vector(true)} N; mend it"


def _delay(said: Said) -> str:
    shown = said.mended.timing.delay
    return (
        f"commands act later or earlier than cycle.command_delay_cycles = {said.stated.timing.delay:g}: the log shows {shown:.4g} ± "
        f'{said.sigma("delay"):.2g} cycles; mend it, or state "auto" to have it found'
    )


def _lag(said: Said) -> str:
    period = said.stated.vehicle.cycle.period_s
    lag, sigma = said.mended.timing.lag * period, said.sigma("lag") * period
    return f"thrust follows commands with a lag of {lag:.4g} ± {sigma:.2g} s; state thrust.lag_s"


def _rise(said: Said) -> str:
    rise, fall = 2e3 * said.seconds("rise"), 2e3 * said.seconds("fall")
    by = rise or fall
    longer = f"thrust takes {abs(by):.3g} ms {'longer' if by > 0 else 'less'}"
    if rise and fall:
        return f"{longer} to rise and to fall than rise_s and fall_s say; mend them"
    ramp, valve, gives = ("rise", "opens", by < 0) if rise else ("fall", "closes", by > 0)
    return (
        f"{longer} to {ramp} than {ramp}_s says, as of a valve that {valve} {abs(by) / 2:.3g} ms {'later' if by > 0 else 'earlier'}, "
        f"so each pulse gives {'more' if gives else 'less'}; mend it"
    )


def _droop(said: Said) -> str:
    key = "droop" if said.seconds("droop") else "cycle_droop"
    lost, sigma = 100 * getattr(said.mended.vehicle.thrust, key), 100 * said.sigma(key)
    beside = "while that is open" if key == "droop" else "that fires in its cycle"
    return (
        f"each jet loses {lost:.3g} ± {sigma:.2g} % of its thrust for each further one {beside}, as of a supply whose pressure sags; state "
        f"thrust.{key}"
    )


def _filter(sensor: str) -> Callable[[Said], str]:
    def words(said: Said) -> str:
        key, sigma = f"{sensor}_lag_s", said.sigma(f"{sensor}_lag") * said.stated.vehicle.cycle.period_s
        lag_s = getattr(said.mended.vehicle.imu, key)
        return (
            f"the {SENSORS[sensor]} is low-pass filtered with a time constant of {lag_s:.3g} ± {sigma:.2g} s; log what is before it, "
            f"or state imu.{key}"
        )

    return words


def _clock(said: Said) -> str:
    fast = said.mended.vehicle.imu.clock_drift_ppm
    return f"the IMU's clock runs {fast:.4g} ppm faster than that of the commands; use one clock, or state imu.clock_drift_ppm"


def _scale(sensor: str) -> Callable[[Said], str]:
    def words(said: Said) -> str:
        factors = np.exp(said.found.value(f"{sensor}_scale"))
        factor = float(factors[np.abs(np.log(factors)).argmax()])
        axis = f"'s {said.subject[0]} axis" if said.subject else ""
        remedy = f"calibrate it, or scale its columns under [columns] ({1 / factor:.6g})"
        return f"the {SENSORS[sensor]}{axis} shows {factor:.5g} of what is; {remedy}"

    return words


def _gyro_unit(said: Said) -> str:
    remedy = "mend the log, or scale its columns under [columns]"
    if said.subject[0] == "degrees":
        return f"its gyro columns are in degrees, not radians; {remedy} (0.0174533)"
    return f"its gyro columns were turned into radians twice; {remedy} (57.2958)"


def _mounting(said: Said) -> str:
    found, mounting = said.found, said.found.model.mounting
    alone = next((sensor for sensor in SENSORS.values() if sensor in said.subject), "")
    turned = [found.value(f"{name}_turn") for name in SENSORS if found.value(f"{name}_turn").any()]
    angle = f"{np.degrees(np.linalg.norm(turned[0])):.3g} degrees" if turned else ""
    if alone and turned:
        return f"the {alone}'s axes alone are tilted by {angle}; calibrate it"
    if alone:
        read = found.supposed.gyro if alone == "gyro" else found.supposed.accelerometer
        rows = _matrix(mounting.T @ read @ mounting)
        return f"the {alone}'s axes alone are {rows} of what they are taken for{_handed(read)}; mend them under [columns]"
    if np.linalg.det(found.supposed.gyro) < 0:
        rows = _matrix(found.supposed.gyro.T @ mounting)
        return f"the IMU's axes lie in the body's as {rows}{_handed(found.supposed.gyro)}; mend them under [columns]"
    words = f"{said.subject[0]}, " if said.subject else ""
    true = np.array(said.mended.vehicle.imu.body_from_imu)
    away = np.degrees(np.arccos(np.clip((np.trace(true.T @ mounting) - 1) / 2, -1, 1)))
    return f"imu.body_from_imu is {words}{_matrix(true)}, {away:.3g} degrees away from what is stated; look at the IMU's mounting"


def _handed(turn: Array) -> str:
    return ", left-handed" if np.linalg.det(turn) < 0 else ""


def _tilt(said: Said) -> str:
    angle = np.degrees(np.linalg.norm(said.found.value("tilt")))
    return f"the vehicle began tilted by {angle:.3g} degrees from environment.initial_attitude_wxyz; mend it, or level the table"


def _fuel(said: Said) -> str:
    mass, inertia = (100 * float(said.found.value(name)[0]) for name in ("mass_rate", "inertia_rate"))
    # no fuel is won
    falling = "rather, thrust falls, as the pressure of a tank that empties: regulate it, or use less of the log"
    cure = falling if max(mass, inertia) > GROWN else "state [drift]"
    return f"the mass changes by {mass:+.3g} % and the inertia by {inertia:+.3g} % from the first to the last cycle; {cure}"


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{float(value):.3g}" for value in values) + ")"


def _matrix(rows: Array) -> str:
    return str([[round(float(value), 4) + 0.0 for value in row] for row in rows])


_WORDS: dict[str, Callable[[Said], str]] = {
    "jet-position": _position,
    "jet-direction": _direction,
    "jets-swapped": lambda said: (
        f"jets {said.subject[0]} and {said.subject[1]} are swapped: each does what is stated of the other; swap wires, columns or entries"
    ),
    "delay-mismatch": _delay,
    "thrust-rise": _rise,
    "thrust-droop": _droop,
    "thrust-lag": _lag,
    "gyro-filter": _filter("gyro"),
    "accel-filter": _filter("accel"),
    "clock-drift": _clock,
    "gyro-scale": _scale("gyro"),
    "accel-scale": _scale("accel"),
    "gyro-units": _gyro_unit,
    "accel-units": lambda _: "its accelerometer columns are in g; mend the log, or scale its columns under [columns] (9.80665)",
    "gyro-bias": lambda said: f"the gyro has a bias of {said.imu('gyro_bias')} rad/s, IMU axes; state imu.gyro_bias_sigma_rad_s",
    "accel-bias": lambda said: f"the accelerometer has a bias of {said.imu('accel_bias')} m/s^2, IMU axes; state imu.accel_bias_sigma_m_s2",
    "imu-mounting": _mounting,
    "imu-position": lambda said: f"the IMU sits {said.body('imu', 1e3)} mm away from imu.position_m; mend it",
    "bearing-position": lambda said: (
        f"the bearing's centre is {said.body('bearing', 1e3)} mm away from environment.bearing_position_m; mend it"
    ),
    "attitude-start": _tilt,
    "steady-torque": lambda said: f"a steady torque of {said.body('torque')} N m acts beside the commands; find it, or state a disturbance",
    "rate-torque": lambda said: (
        f"a torque of {said.body('drag')} N m s times the rate acts beside the commands: drag, or a cable; "
        "state environment.damping_sigma_n_m_s"
    ),
    "fuel-use": _fuel,
}
