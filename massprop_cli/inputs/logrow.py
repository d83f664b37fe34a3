"""What a log's columns are, as a JSON Schema of one of its rows."""

from __future__ import annotations

from typing import Any

from massprop_cli.inputs import columns as names


def schema() -> dict[str, Any]:
    """One row of a log; command columns may be null in all but the first row of their control cycle."""
    number = {"type": "number"}
    command = {"type": ["number", "null"]}

    def columns(names: tuple[str, ...], kind: dict[str, Any], description: str) -> dict[str, Any]:
        return {name: {**kind, "description": description} for name in names}

    properties = {
        "time_s": {**number, "description": "end of the record's interval, strictly increasing, s"},
        **columns(names.DELTA_THETA, number, "gyro angle increment over the record, IMU axes, rad"),
        **columns(names.DELTA_V, number, "accelerometer increment (specific force) over the record, IMU axes, m/s"),
        **columns(names.GYRO, number, "mean rate over the record, may stand in for the angle increment, rad/s"),
        **columns(names.ACCEL, number, "mean specific force over the record, may stand in for the velocity increment, m/s^2"),
        **columns(names.WRENCH[:3], command, "mean commanded torque about O over the control cycle, body axes, N m"),
        **columns(names.WRENCH[3:], command, "mean commanded force over the control cycle, body axes, N"),
        **columns(names.QUATERNION, number, "attitude at time_s, world from body"),
        names.SUPPLY: {**number, "description": "supply voltage over the record, for rotors that state nominal_v, V"},
        "event": {"type": ["string", "null"], "description": 'text, e.g. "dock"'},
    }

    def either(increments: tuple[str, ...], rates: tuple[str, ...]) -> dict[str, Any]:
        return {"anyOf": [{"required": list(increments)}, {"required": list(rates)}]}

    return {
        "title": "Log row",
        "description": schema.__doc__,
        "type": "object",
        "properties": properties,
        "patternProperties": {
            "^jet_.+_s$": {**command, "minimum": 0, "description": "commanded on-time in this control cycle, s"},
            "^rotor_.+_command$": {**command, "description": "what a rotor is told in this control cycle, as its thrust_n takes it"},
            "^rotor_.+_rad_s$": {**number, "description": "a rotor's speed at time_s, rad/s"},
            "^wheel_.+_rad_s$": {**command, "description": "a wheel's speed relative to the body at time_s, rad/s"},
            "^wheel_.+_n_m$": {**command, "description": "torque on a wheel over this control cycle, N m; the body feels the opposite"},
        },
        "required": ["time_s"],
        "allOf": [either(names.DELTA_THETA, names.GYRO), either(names.DELTA_V, names.ACCEL)],
    }
