"""Standard column names of a log, with units: commands in body axes, the rest in IMU axes. Actuator modules define their own columns."""

from typing import Self

from pydantic import Field, model_validator

from massprop_cli.inputs.section import Real, Section

AXES = ("x", "y", "z")
TIME = "time_s"
COMMAND_TIME = "command_time_s"
DELTA_THETA = tuple(f"delta_theta_{a}_rad" for a in AXES)
DELTA_V = tuple(f"delta_v_{a}_m_s" for a in AXES)
GYRO = tuple(f"gyro_{a}_rad_s" for a in AXES)
ACCEL = tuple(f"accel_{a}_m_s2" for a in AXES)
WRENCH = (*(f"cmd_torque_{a}_n_m" for a in AXES), *(f"cmd_force_{a}_n" for a in AXES))
QUATERNION = ("quat_w", "quat_x", "quat_y", "quat_z")
EVENT = "event"
SUPPLY = "supply_v"
PRESSURE = "supply_pa"
PULSE_JET, PULSE_START, PULSE_DURATION = PULSE = ("pulse_jet", "pulse_start_s", "pulse_duration_s")
FIXED = (TIME, COMMAND_TIME, *DELTA_THETA, *DELTA_V, *GYRO, *ACCEL, *WRENCH, *QUATERNION, EVENT, SUPPLY, PRESSURE, *PULSE)


def jet(name: str) -> str:
    """Column name of a jet's on-time."""
    return f"jet_{name}_s"


def is_jet(column: str) -> bool:
    """Whether a column is the on-time of a jet."""
    return column.startswith("jet_") and column.endswith("_s")


class Column(Section):
    """Source of a standard column in this log: ``value = scale * column``."""

    from_: str = Field(alias="from")
    scale: Real = 1.0

    @model_validator(mode="after")
    def _scales(self) -> Self:
        if self.scale == 0:
            raise ValueError("scale is zero")
        return self
