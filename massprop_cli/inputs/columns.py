"""Names of a telemetry log's columns. Units are in the names; body axes for commands, IMU axes for the rest."""

from __future__ import annotations

AXES = ("x", "y", "z")
TIME = "time_s"
DELTA_THETA = tuple(f"delta_theta_{a}_rad" for a in AXES)
DELTA_V = tuple(f"delta_v_{a}_m_s" for a in AXES)
GYRO = tuple(f"gyro_{a}_rad_s" for a in AXES)
ACCEL = tuple(f"accel_{a}_m_s2" for a in AXES)
WRENCH = (*(f"cmd_torque_{a}_n_m" for a in AXES), *(f"cmd_force_{a}_n" for a in AXES))
QUATERNION = ("quat_w", "quat_x", "quat_y", "quat_z")
EVENT = "event"
SUPPLY = "supply_v"
FIXED = (TIME, *DELTA_THETA, *DELTA_V, *GYRO, *ACCEL, *WRENCH, *QUATERNION, EVENT, SUPPLY)


def jet(name: str) -> str:
    """The column of a jet's on-time."""
    return f"jet_{name}_s"


def wheel_speed(name: str) -> str:
    """The column of a wheel's speed."""
    return f"wheel_{name}_rad_s"


def wheel_torque(name: str) -> str:
    """The column of the torque on a wheel."""
    return f"wheel_{name}_n_m"


def rotor_command(name: str) -> str:
    """The column of what a rotor is told."""
    return f"rotor_{name}_command"


def rotor_speed(name: str) -> str:
    """The column of a rotor's speed."""
    return f"rotor_{name}_rad_s"


def rotor_of(column: str) -> str | None:
    """The rotor that a column is called after; None where it is no rotor's."""
    return _named(column, "rotor_", ("_rad_s", "_command"))


def wheel_of(column: str) -> str | None:
    """The wheel that a column is called after; None where it is no wheel's."""
    return _named(column, "wheel_", ("_rad_s", "_n_m"))


def _named(column: str, start: str, ends: tuple[str, str]) -> str | None:
    end = next((end for end in ends if column.startswith(start) and column.endswith(end)), None)
    return None if end is None else column.removeprefix(start).removesuffix(end)
