"""C tables of a flight's constants, as hexadecimal numbers that every compiler reads without rounding."""

from collections.abc import Iterator, Sequence
from textwrap import indent

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.export.resolve import FlightConstants, PhaseConstants
from massprop_cli.kernel import LAGS
from massprop_cli.model.kernelargs import KINDS
from massprop_cli.model.momentum import scale_sigmas

SLIDES = KINDS.index("air_bearing")
"""Kernel's number of an air bearing."""
SENSORS = 3
"""Number of sensor entries in mp_commands."""
ROWS = {"body_from_imu": 3, "weight": 2, "lag_s": 2}
"""Row lengths of matrix members."""

VEHICLE = (
    *(("bearing", 0), ("gyro_bias", 0), ("accel_bias", 0), ("slow_torque", 0), ("tilt", 0), ("bins", 0), ("pulses", 0)),
    *(("imu", 3), ("gyro_noise", 1), ("accel_noise", 3), ("gyro_bias_sigma", 1), ("accel_bias_sigma", 1)),
    *(("torque_noise", 1), ("torque_walk", 1), ("gyro_bias_walk", 1), ("prior_scale", 1), ("reach", 1), ("known_mass", 1), ("centre", 3)),
    *(
        ("bearing_mass", 1),
        ("gravity", 1),
        ("filtered", 0),
        ("curvature", 1),
        ("later", 1),
        ("smearing", 1),
        ("thrust_sigma", 1),
        ("wheels", 0),
    ),
)
"""Members of mp_vehicle before those of the wheels, in the order of the kernel arguments, with lengths; 0: one integer."""
WHEEL = (("axis", slice(0, 3)), ("spin_sigma", slice(3, 4)), ("spin_inertia", slice(4, 5)), ("free_inertia", slice(5, 6)))
"""Members of each wheel, with their positions in the wheel's six kernel arguments."""
COMMANDS = (
    *(("jets", 0), ("commands", 0), ("records", 0), ("waits", 0), ("period_s", 1), ("delay_s", 1), ("memory_s", 1), ("late", 1)),
    *(("pulse_sigma", 1), ("body_from_imu", 9), ("attitude_wxyz", 4)),
)
"""Members of mp_commands before those of sensors and channels, with lengths."""
SENSOR = (("instant", 0), ("lags", 0), ("latency_s", 1), ("weight", 2 * LAGS), ("lag_s", 2 * LAGS))
"""Members of each sensor, with lengths."""
RULE = (("thrust_sigma", 1), ("count", 0), ("relative", 0), ("tolerance", 3), ("beyond", 6), ("gate", 1), ("known", 0))
"""Members of mp_rule before those of known values, with lengths."""


def limits(constants: FlightConstants) -> str:
    """Compiler flags with the array sizes that this vehicle needs."""
    phases = [dict(_members(phase.vehicle, VEHICLE)) for phase in constants.phases]
    blocks = max(3 * (1 + sum(int(phase[name][0]) for name in ("gyro_bias", "accel_bias", "slow_torque", "tilt"))) for phase in phases)
    wheels = int(phases[0]["wheels"][0])
    scales = len(scale_sigmas(constants.phases[0].resolved))
    sizes = {
        "BINS": max(int(phase["bins"][0]) for phase in phases),
        "CHANNELS": 15 if phases[0]["bearing"][0] == SLIDES else 12,
        "PIVOTED": int(phases[0]["bearing"][0] > 0),
        "WHEELS": wheels,
        "BEGINNINGS": blocks + scales,
        "COMMANDS": max(int(constants.commands[1]), 1),
    }
    return " ".join(f"-DMP_{name}={value}" for name, value in sizes.items())


def header(constants: FlightConstants) -> str:
    """Text of table.h."""
    return f"""/* {_comment(constants.vehicle.name)}: made by massprop export-flight. */
#ifndef MASSPROP_TABLE_H
#define MASSPROP_TABLE_H

#include "flight.h"

#define MP_PHASES {len(constants.phases)}

extern const mp_commands mp_commands_table;
extern const mp_vehicle mp_vehicle_table[MP_PHASES];
extern const mp_rule mp_rule_table[MP_PHASES];

#endif
"""


def source(constants: FlightConstants) -> str:
    """Text of table.c."""
    vehicles = ",\n".join(
        f"    {{ /* phase {_comment(phase.name)} */\n{_body(phase.vehicle, VEHICLE)}{_wheels(phase.vehicle)}    }}"
        for phase in constants.phases
    )
    rules = ",\n".join(f"    {{\n{_rule(phase)}    }}" for phase in constants.phases)
    return f"""#include "table.h"

#define R(x) ((mp_real)(x))

const mp_commands mp_commands_table = {{
{_commands(constants.commands)}}};

const mp_vehicle mp_vehicle_table[MP_PHASES] = {{
{vehicles}
}};

const mp_rule mp_rule_table[MP_PHASES] = {{
{rules}
}};
"""


def _length(members: Sequence[tuple[str, int]]) -> int:
    """Number of kernel arguments of some members."""
    return sum(max(count, 1) for _, count in members)


def _members(arguments: Array, members: Sequence[tuple[str, int]]) -> Iterator[tuple[str, Array]]:
    """Each member's name with its kernel arguments."""
    start = 0
    for name, count in members:
        yield name, arguments[start : start + max(count, 1)]
        start += max(count, 1)


def _body(arguments: Array, members: Sequence[tuple[str, int]]) -> str:
    """C initialisers of some members."""
    text = ""
    integers = {name for name, count in members if count == 0}
    for name, numbers in _members(arguments, members):
        if name in integers:
            value = str(int(numbers[0]))
        elif name in ROWS:
            value = "{" + ", ".join(_list(row) for row in numbers.reshape(-1, ROWS[name])) + "}"
        else:
            value = _list(numbers) if len(numbers) > 1 else _number(numbers[0])
        text += f"        .{name} = {value},\n"
    return text


def _wheels(arguments: Array) -> str:
    """C initialisers of the wheels' members of mp_vehicle; empty without wheels."""
    wheels = arguments[_length(VEHICLE) :].reshape(-1, 6)
    if not len(wheels):
        return ""
    members = ((name, ", ".join(_list(row[at]) if name == "axis" else _number(row[at][0]) for row in wheels)) for name, at in WHEEL)
    return "".join(f"        .{name} = {{{numbers}}},\n" for name, numbers in members)


def _commands(arguments: Array) -> str:
    """C initialisers of mp_commands."""
    sensors, channels = np.split(arguments[_length(COMMANDS) :], [SENSORS * _length(SENSOR)])
    body = _body(arguments, COMMANDS) + "".join(
        f"        .sensor[{i}] = {{\n{indent(_body(sensor, SENSOR), '    ')}        }},\n"
        for i, sensor in enumerate(sensors.reshape(SENSORS, -1))
    )
    channels = channels.reshape(-1, 9)
    if not len(channels):
        return body
    wrench = ",\n".join(f"            {_list(row[:6])}" for row in channels)
    rise_s, fall_s, delay_s = (_list(channels[:, column]) for column in (6, 7, 8))
    return (
        body
        + f"        .wrench = {{\n{wrench}\n        }},\n        .rise_s = {rise_s},\n        .fall_s = {fall_s},\n"
        + f"        .own_delay_s = {delay_s},\n"
    )


def _rule(phase: PhaseConstants) -> str:
    """C initialisers of mp_rule."""
    known = phase.rule[_length(RULE) :].reshape(-1, 3)
    text = _body(phase.rule, RULE)
    if len(known):
        index = ", ".join(str(int(i)) for i in known[:, 0])
        text += f"        .known_index = {{{index}}},\n        .known_value = {_list(known[:, 1])},\n"
        text += f"        .known_sigma = {_list(known[:, 2])},\n"
    return text


def _list(numbers: Array) -> str:
    return "{" + ", ".join(map(_number, np.atleast_1d(numbers))) + "}"


def _number(value: float) -> str:
    return f"R({float(value).hex()})"


def _comment(text: str) -> str:
    """The text with "_" in place of characters that may not be in a C comment."""
    return "".join(letter if letter.isprintable() and letter.isascii() and letter not in "*/\\" else "_" for letter in text)
