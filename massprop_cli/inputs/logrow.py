"""JSON Schema of a log's row."""

from typing import Any

from massprop_cli.inputs import columns as names
from massprop_cli.inputs.vehicle import ACTUATORS


def schema() -> dict[str, Any]:
    """One row of a log. Command columns may be null in all rows of a control cycle but the first."""
    number = {"type": "number"}
    command = {"type": ["number", "null"]}

    def columns(names: tuple[str, ...], kind: dict[str, Any], description: str) -> dict[str, Any]:
        return {name: {**kind, "description": description} for name in names}

    properties = {
        "time_s": {**number, "description": "end of the record's interval, strictly increasing, s"},
        **columns(names.DELTA_THETA, number, "gyro angle increment over the record, IMU axes, rad"),
        **columns(names.DELTA_V, number, "accelerometer increment (specific force) over the record, IMU axes, m/s"),
        **columns(names.GYRO, number, "mean rate over the record, alternative to the angle increment, rad/s"),
        **columns(names.ACCEL, number, "mean specific force over the record, alternative to the velocity increment, m/s^2"),
        **columns(names.WRENCH[:3], command, "mean commanded torque about O over the control cycle, body axes, N m"),
        **columns(names.WRENCH[3:], command, "mean commanded force over the control cycle, body axes, N"),
        **columns(names.QUATERNION, command, "quaternion wxyz at time_s, world from body; all four null in records without one"),
        names.SUPPLY: {**number, "description": "supply voltage over the record, for rotors that state nominal_v, V"},
        names.PRESSURE: {**number, "description": "absolute supply pressure over the record, for thrust.nominal_pa, Pa"},
        names.PULSE_JET: {"type": ["string", "null"], "description": "jet of a pulse; any row may hold one pulse"},
        names.PULSE_START: {**command, "description": "commanded start of the pulse on the commands' clock, s"},
        names.PULSE_DURATION: {**command, "minimum": 0, "description": "commanded duration of the pulse, s"},
        "event": {"type": ["string", "null"], "description": 'text, e.g. "dock"'},
    }

    return {
        "title": "Log row",
        "description": schema.__doc__,
        "type": "object",
        "properties": properties,
        "patternProperties": {
            "^jet_.+_s$": {**command, "minimum": 0, "description": "commanded on-time in this control cycle, s"},
            **{
                f"^{column.start}.+{column.end}$": {**(command if column.nullable else number), "description": column.description}
                for kind in ACTUATORS.values()
                for column in kind.COLUMNS
            },
        },
        "required": ["time_s"],
        # a planar table needs one gyro axis; that other environments need three is known only from the vehicle file
        "anyOf": [{"required": [name]} for name in (*names.DELTA_THETA, *names.GYRO)],
    }
