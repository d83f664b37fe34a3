"""Constants of a vehicle as C tables of hexadecimal numbers, which every compiler reads exactly."""

from collections.abc import Iterator, Sequence
from textwrap import indent

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.export.resolve import Constants, Leg
from massprop_cli.kernel import LAGS
from massprop_cli.model.kernelargs import KINDS
from massprop_cli.model.momentum import scale_sigmas

SLIDES, SENSORS = KINDS.index("air_bearing"), 3
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
"""Members of mp_vehicle in the order of its table, before those of the wheels, and their lengths; 0: one integer."""
OF_WHEEL = (("axis", slice(0, 3)), ("spin_sigma", slice(3, 4)), ("spin_inertia", slice(4, 5)), ("free_inertia", slice(5, 6)))
"""Members of each wheel, and their positions in its part of the table."""
COMMANDS = (
    *(("jets", 0), ("commands", 0), ("records", 0), ("waits", 0), ("period_s", 1), ("delay_s", 1), ("memory_s", 1), ("late", 1)),
    *(("pulse_sigma", 1), ("body_from_imu", 9), ("attitude_wxyz", 4)),
)
"""Members of mp_commands and their lengths, before those of sensors and channels."""
SENSOR = (("instant", 0), ("lags", 0), ("latency_s", 1), ("weight", 2 * LAGS), ("lag_s", 2 * LAGS))
"""Members of each sensor and their lengths."""
RULE = (("thrust_sigma", 1), ("count", 0), ("relative", 0), ("tolerance", 3), ("beyond", 6), ("gate", 1), ("known", 0))
"""Members of mp_rule and their lengths, before those of known values."""


def limits(resolved: Constants) -> str:
    """Compiler flags with the array sizes that this vehicle needs."""
    legs = [dict(_members(leg.vehicle, VEHICLE)) for leg in resolved.legs]
    blocks = max(3 * (1 + sum(int(leg[name][0]) for name in ("gyro_bias", "accel_bias", "slow_torque", "tilt"))) for leg in legs)
    wheels = int(legs[0]["wheels"][0])
    scales = len(scale_sigmas(resolved.legs[0].own))
    found = {
        "BINS": max(int(leg["bins"][0]) for leg in legs),
        "CHANNELS": 15 if legs[0]["bearing"][0] == SLIDES else 12,
        "PIVOTED": int(legs[0]["bearing"][0] > 0),
        "WHEELS": wheels,
        "BEGINNINGS": blocks + scales,
        "COMMANDS": max(int(resolved.commands[1]), 1),
    }
    return " ".join(f"-DMP_{name}={value}" for name, value in found.items())


def header(resolved: Constants) -> str:
    """Text of table.h."""
    return f"""/* {_comment(resolved.vehicle.name)}: made by massprop export-flight. */
#ifndef MASSPROP_TABLE_H
#define MASSPROP_TABLE_H

#include "flight.h"

#define MP_PHASES {len(resolved.legs)}

extern const mp_commands mp_commands_table;
extern const mp_vehicle mp_vehicle_table[MP_PHASES];
extern const mp_rule mp_rule_table[MP_PHASES];

#endif
"""


def source(resolved: Constants) -> str:
    """Text of table.c."""
    vehicles = ",\n".join(
        f"    {{ /* phase {_comment(leg.name)} */\n{_body(leg.vehicle, VEHICLE)}{_wheels(leg.vehicle)}    }}" for leg in resolved.legs
    )
    rules = ",\n".join(f"    {{\n{_rule(leg)}    }}" for leg in resolved.legs)
    return f"""#include "table.h"

#define R(x) ((mp_real)(x))

const mp_commands mp_commands_table = {{
{_commands(resolved.commands)}}};

const mp_vehicle mp_vehicle_table[MP_PHASES] = {{
{vehicles}
}};

const mp_rule mp_rule_table[MP_PHASES] = {{
{rules}
}};
"""


def _length(names: Sequence[tuple[str, int]]) -> int:
    return sum(max(count, 1) for _, count in names)


def _members(table: Array, names: Sequence[tuple[str, int]]) -> Iterator[tuple[str, Array]]:
    at = 0
    for name, count in names:
        yield name, table[at : at + max(count, 1)]
        at += max(count, 1)


def _body(table: Array, names: Sequence[tuple[str, int]]) -> str:
    text = ""
    whole = {name for name, count in names if count == 0}
    for name, numbers in _members(table, names):
        if name in whole:
            said = str(int(numbers[0]))
        elif name in ROWS:
            said = "{" + ", ".join(_list(row) for row in numbers.reshape(-1, ROWS[name])) + "}"
        else:
            said = _list(numbers) if len(numbers) > 1 else _number(numbers[0])
        text += f"        .{name} = {said},\n"
    return text


def _wheels(table: Array) -> str:
    each = table[_length(VEHICLE) :].reshape(-1, 6)
    if not len(each):
        return ""
    members = ((name, ", ".join(_list(row[own]) if name == "axis" else _number(row[own][0]) for row in each)) for name, own in OF_WHEEL)
    return "".join(f"        .{name} = {{{numbers}}},\n" for name, numbers in members)


def _commands(table: Array) -> str:
    sensors, each = np.split(table[_length(COMMANDS) :], [SENSORS * _length(SENSOR)])
    own = sensors.reshape(SENSORS, -1)
    body = _body(table, COMMANDS) + "".join(
        f"        .sensor[{i}] = {{\n{indent(_body(one, SENSOR), '    ')}        }},\n" for i, one in enumerate(own)
    )
    each = each.reshape(-1, 9)
    if not len(each):
        return body
    wrench = ",\n".join(f"            {_list(row[:6])}" for row in each)
    return (
        body
        + f"        .wrench = {{\n{wrench}\n        }},\n        .rise_s = {_list(each[:, 6])},\n        .fall_s = {_list(each[:, 7])},\n"
        + f"        .own_delay_s = {_list(each[:, 8])},\n"
    )


def _rule(leg: Leg) -> str:
    known = leg.rule[_length(RULE) :].reshape(-1, 3)
    text = _body(leg.rule, RULE)
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
    """The text with "_" for characters that a C comment cannot hold."""
    return "".join(letter if letter.isprintable() and letter.isascii() and letter not in "*/\\" else "_" for letter in text)
