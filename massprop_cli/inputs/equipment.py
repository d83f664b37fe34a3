"""What a vehicle file states of cycle, IMU, environment, thrust and jets."""

import math
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, FiniteFloat, ValidationInfo, field_validator, model_validator

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.inputs import imufilters
from massprop_cli.inputs.section import IDENTITY, ZERO, NonNegative, Place, Positive, Real, Section, Vector

Limits = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
FASTEST_PPM = 1e5
OFF_UNIT = 1e-2
"""By which the norm of a quaternion, or a product of two rows of a rotation matrix, may be off: what rounding and averaging do."""
EXACT = 1e-12
"""Products of rows that are this near to those of a rotation are left as they are."""
EDGE = 1e-9
"""s, within which a pulse begins at a time."""


EnvironmentKind = Literal["free", "air_bearing", "pedestal", "planar"]


PIVOTED: tuple[EnvironmentKind, ...] = ("air_bearing", "pedestal")
"""Where a vehicle turns about a pivot under its weight."""


class Cycle(Section):
    """Control cycle and the delay between command and execution."""

    period_s: Positive
    pwm_tick_s: Positive | None = Field(None, description="informative: on-times are not quantised again")
    command_delay_cycles: NonNegative | Literal["auto"] = Field(
        0.0, description="from the start of the cycle that issued a command to the start of its execution"
    )
    command_delay_sigma_cycles: NonNegative = Field(0.0, description="one sigma of a stated delay; goes into every sigma")
    pulse_at: Literal["begin", "centre", "end"] = Field("begin", description="where in its cycle a jet's pulse lies, after the delay")


def _by_cutoff_or_preset(schema: dict[str, Any]) -> None:
    """A preset stands for the cutoff, which is filled in before it is asked for, and order 0 has none."""
    unfiltered = {"properties": {"order": {"const": 0}}, "required": ["order"]}
    schema["anyOf"] = [{"required": ["cutoff_hz"]}, {"required": ["preset"]}, unfiltered]


LATEST_S = 1.0
"""Most of a sensor's latency, either way."""


class LowPass(Section):
    """What a sensor's values went through before they were recorded: a Butterworth low-pass, and a dead time."""

    model_config = ConfigDict(json_schema_extra=_by_cutoff_or_preset)

    preset: str | None = Field(
        None, description="setting of a common IMU by name, whose keys hold where they are not stated here (docs/imu-filters.md)"
    )
    order: Literal[0, 1, 2] = Field(2, description="0: latency_s alone; 1: a first-order lag; 2: Butterworth of the second order")
    cutoff_hz: Positive | Literal["auto"] | None = Field(
        None, description='frequency at which it lets 0.707 through; "auto": estimated from the log; order 0 has none'
    )
    cutoff_sigma_hz: NonNegative = Field(0.0, description="one sigma of a stated cutoff; goes into every sigma")
    latency_s: Annotated[Real, Field(ge=-LATEST_S, le=LATEST_S)] | Literal["auto"] = Field(
        0.0, description='by which values are later than their time stamps beyond the low-pass; "auto": estimated from the log'
    )
    latency_sigma_s: NonNegative = Field(0.0, description="one sigma of latency_s; goes into every sigma")

    @model_validator(mode="after")
    def _has_what_its_order_asks_for(self) -> Self:
        if (self.order == 0) != (self.cutoff_hz is None):
            raise ValueError(f"order = {self.order} {'has no cutoff_hz' if self.order == 0 else 'needs cutoff_hz'}")
        if self.order == 0 and self.cutoff_sigma_hz > 0:
            raise ValueError("order = 0 has no cutoff_hz, and no cutoff_sigma_hz")
        return self

    @property
    def cutoff(self) -> float:
        """The cutoff as a number; ValueError where there is none, or it is still to be found."""
        if self.cutoff_hz is None or self.cutoff_hz == "auto":
            raise ValueError("the cutoff is not found yet")
        return self.cutoff_hz

    @property
    def latency(self) -> float:
        """The latency as a number; ValueError where it is still to be found."""
        if self.latency_s == "auto":
            raise ValueError("the latency is not found yet")
        return self.latency_s

    @property
    def open(self) -> bool:
        """Whether cutoff or latency is still to be found."""
        return "auto" in (self.cutoff_hz, self.latency_s)


class Imu(Section):
    """Where the IMU sits and how it is turned; noise is one sigma of a cycle's mean, or a group's (docs/log.md, two clocks)."""

    clock_drift_ppm: Real = Field(
        0.0,
        ge=-FASTEST_PPM,
        le=FASTEST_PPM,
        description="by how much the IMU's clock runs faster than that of the commands; they agree where the log begins",
    )
    clock_even: bool | None = Field(
        None,
        description="true: records come at even intervals and none is missing, whatever their stamps; false: stamps hold as they are; "
        "absent: where stamps are uneven the increments decide",
    )
    position_m: Place = Field(ZERO, description="from O, body axes")
    position_sigma_m: NonNegative = Field(0.0, le=1.0, description="uncertainty of position_m, along each axis")
    body_from_imu: tuple[Vector, Vector, Vector] = Field(IDENTITY, description="rotation matrix by rows")
    mounting_sigma_rad: NonNegative = Field(0.0, le=0.3, description="uncertainty of body_from_imu, about each axis")
    gyro_noise_rad_s: NonNegative | None = Field(None, description="absent: estimated from the log; 0: a floor is used")
    accel_noise_m_s2: NonNegative | None = Field(None, description="absent: estimated from the log; 0: a floor is used")
    attitude_sigma_rad: Positive | None = Field(
        None, description="on an air bearing, white noise of each logged attitude about each axis; absent: estimated from the log"
    )
    attitude_latency_s: NonNegative | Literal["auto"] = Field(
        0.0, description='time by which each logged attitude is older than its time_s; "auto": estimated from the log'
    )
    attitude_latency_sigma_s: NonNegative = Field(
        0.0,
        description="one sigma of attitude_latency_s; goes into every sigma. Where the log tells the latency to half of it, that is used",
    )
    attitude_misalignment_sigma_rad: NonNegative = Field(
        0.0, le=0.3, description="constant turn of the logged attitude's body axes from the vehicle's, about each axis; estimated"
    )
    gyro_bias_rad_s: Vector = Field(ZERO, description="known bias of the gyro, IMU axes; taken off what it shows")
    gyro_bias_walk_rad_s_sqrt_s: NonNegative = Field(
        0.0,
        description="random walk of the gyro's bias about each axis: one sigma of its change in one second, which is "
        "gyro_bias_sigma_rad_s where that is not stated",
    )
    gyro_bias_sigma_rad_s: NonNegative = Field(
        0.0, description="one sigma of what the bias may be beside that, about each axis; estimated", validate_default=True
    )
    accel_bias_sigma_m_s2: NonNegative = 0.0
    gyro_lag_s: NonNegative = Field(0.0, description="time constant of a first-order low-pass within the gyro; undone, record by record")
    accel_lag_s: NonNegative = Field(0.0, description="the same within the accelerometer; noise is what is before it")
    gyro_lag_sigma_s: NonNegative = Field(0.0, description="one sigma of gyro_lag_s; goes into every sigma")
    accel_lag_sigma_s: NonNegative = Field(0.0, description="one sigma of accel_lag_s; goes into every sigma")
    measures: Literal["increment", "mean", "sample"] = Field(
        "increment", description="what a record is: the motion over it, as its increment or its mean, or at its time"
    )
    gyro_filter: LowPass | None = None
    accel_filter: LowPass | None = None
    accel_axes: Literal["imu", "start"] = Field(
        "imu", description="axes of the velocity increments: the IMU's own as it turns, or those that it had when each record began"
    )
    filter_correlation: Annotated[tuple[FiniteFloat, ...], Field(min_length=5, max_length=14)] | None = Field(
        None,
        description="of the errors of time constants, 1 / (2 pi cutoff): gyro's and accelerometer's with the delay, the same with the lag, "
        "the two with each other; then of latencies: gyro's and accelerometer's with the delay, the same with the lag, both with the "
        "gyro's time constant, both with the accelerometer's, the two with each other",
    )
    gyro_range_rad_s: Positive | None = None
    accel_range_m_s2: Positive | None = None
    gyro_outliers_s: tuple[FiniteFloat, ...] | None = Field(
        None, description="time_s of records whose gyro readings are not used; absent: found in the log"
    )
    accel_outliers_s: tuple[FiniteFloat, ...] | None = Field(
        None, description="time_s of records whose accelerometer readings are not used; absent: found in the log"
    )

    @field_validator("gyro_bias_sigma_rad_s")
    @classmethod
    def _unknown_where_it_walks(cls, sigma: float, about: ValidationInfo) -> float:
        return sigma or float(about.data.get("gyro_bias_walk_rad_s_sqrt_s", 0.0))

    @property
    def attitude_latency(self) -> float:
        """attitude_latency_s as a number; 0 where it is still to be found."""
        return 0.0 if self.attitude_latency_s == "auto" else self.attitude_latency_s

    @field_validator("gyro_filter", "accel_filter", mode="before")
    @classmethod
    def _by_preset(cls, stated: Any, about: ValidationInfo) -> Any:
        preset = isinstance(stated, dict) and stated.get("preset") is not None
        return imufilters.resolved(str(about.field_name).removesuffix("_filter"), stated) if preset else stated

    @field_validator("body_from_imu")
    @classmethod
    def _is_rotation(cls, rows: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
        matrix = np.array(rows)
        off = np.abs(matrix @ matrix.T - np.eye(3)).max()
        if off > OFF_UNIT or np.linalg.det(matrix) < 0:
            raise ValueError("is not a rotation matrix; give orthonormal rows with determinant +1")
        if off < EXACT:
            return rows
        # the nearest rotation in the least-squares sense: the orthogonal factor of the polar decomposition
        left, _, right = np.linalg.svd(matrix)
        (a, b, c), (d, e, f), (g, h, i) = (left @ right).tolist()
        return (a, b, c), (d, e, f), (g, h, i)


class Environment(Section):
    """Free flight; a spherical air bearing, on a base that slides on a horizontal plane or on a fixed pedestal; or a table."""

    kind: EnvironmentKind = Field(
        "free",
        description="air_bearing: a spherical bearing on a base that slides; pedestal: a spherical bearing that is fixed to the ground; "
        "planar: a table with x, y and yaw; body Z points up from it, and the accelerometer feels gravity along Z",
    )
    gravity_m_s2: NonNegative = 9.80665
    bearing_position_m: Place = Field(ZERO, description="centre of rotation, from O")
    bearing_mass_kg: NonNegative = Field(0.0, description="translates with the vehicle, does not rotate")
    table_tilt_sigma_rad: NonNegative = Field(
        0.01, le=0.2, description="one sigma of each of a table's two tilts, which stand still in the world; 0: level"
    )
    initial_attitude_wxyz: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] = (1.0, 0.0, 0.0, 0.0)
    room_torque_n_m: Vector = Field(
        ZERO, description="a steady torque that stands still in the room, along its axes, on a bearing or a pedestal: of a cable, a draught"
    )
    disturbance_torque_n_m: NonNegative = Field(0.0, description="one sigma per cycle, white, each axis")
    disturbance_walk_n_m: NonNegative = Field(0.0, description="a slowly varying torque on each axis: one sigma of its change per cycle")

    damping_sigma_n_m_s: NonNegative = Field(
        0.0, description="one sigma of an unknown torque against the body rate about each axis, over that rate: drag; 0: none"
    )

    @field_validator("initial_attitude_wxyz")
    @classmethod
    def _is_unit(cls, quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        norm = math.hypot(*quaternion)
        if abs(norm - 1) > OFF_UNIT:
            raise ValueError(f"has norm {norm:.4g}, not 1; a quaternion is wxyz, world from body")
        w, x, y, z = (component / norm for component in quaternion)
        return w, x, y, z

    @model_validator(mode="after")
    def _is_coherent(self) -> Self:
        if self.kind in PIVOTED and self.gravity_m_s2 == 0:
            raise ValueError(f'kind = "{self.kind}" with gravity_m_s2 = 0: a bearing needs gravity; state kind = "free", or gravity')
        if self.kind == "pedestal" and self.bearing_mass_kg > 0:
            raise ValueError(
                f"bearing_mass_kg = {self.bearing_mass_kg:g} does not affect the motion on a fixed pedestal; leave it out, or "
                'state kind = "air_bearing" if the base slides'
            )
        if self.kind not in PIVOTED and any(self.room_torque_n_m):
            raise ValueError(
                f'room_torque_n_m needs the attitude, which kind = "{self.kind}" does not use; leave it out, or state a disturbance'
            )
        if self.kind == "planar" and max(map(abs, self.initial_attitude_wxyz[1:3])) > 1e-6:
            raise ValueError("initial_attitude_wxyz tilts the vehicle on the table; give a rotation about Z, or leave it out")
        return self

    @property
    def moving(self) -> Array:
        """(6,) which torques about, and forces along, the body axes move the vehicle (1): on a table what else there is it takes up (0)."""
        return np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0]) if self.kind == "planar" else np.ones(6)

    @property
    def steady_force_m_s2(self) -> Array:
        """(3,) specific force that is the same in body axes however the vehicle moves: on a table, of what carries its weight."""
        return np.array([0.0, 0.0, self.gravity_m_s2 if self.kind == "planar" else 0.0])


MOST_DROOP = 0.2
"""Part of its thrust that a jet may lose for each further one."""
Droop = Annotated[NonNegative, Field(le=MOST_DROOP)]


class Failure(Section):
    """A jet that for a time does not do what it is stated to."""

    jet: str
    thrust: FiniteFloat = Field(0.0, description="factor on its thrust: 0 dead, 0.8 weak, -1 mounted the wrong way")
    start_s: FiniteFloat | None = Field(
        None, description="of pulses that begin to act from then on, their delay included, by the log's clock; absent: from its start"
    )
    end_s: FiniteFloat | None = Field(None, description="... and before then; absent: to its end")

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(
                f"the failure of jet {self.jet!r} from {self.start_s:g} to {self.end_s:g} s has no duration; correct start_s or end_s"
            )
        return self

    def of(self, begin_s: Array) -> BoolArray:
        """Which of pulses that begin then are of it."""
        early = -np.inf if self.start_s is None else self.start_s
        late = np.inf if self.end_s is None else self.end_s
        return np.asarray((begin_s >= early - EDGE) & (begin_s < late - EDGE))


class Thrust(Section):
    """Uncertainty and dynamics of the actuators."""

    scale_sigma: NonNegative = Field(0.0, description="common relative uncertainty of all forces and torques")
    pulse_sigma: NonNegative = Field(0.0, description="relative, independent per cycle's pulse")
    lag_s: NonNegative | Literal["auto"] = Field(0.0, description='first-order lag of thrust or wrench; "auto": estimated from the log')
    lag_sigma_s: NonNegative = Field(0.0, description="one sigma of a stated lag; goes into every sigma")
    droop: Droop = Field(0.0, description="part of its thrust that a jet loses for each other jet that is open")
    cycle_droop: Droop = Field(0.0, description="the same for each other jet that fires in the cycle, for a supply slower than a pulse")
    least_on_s: NonNegative = Field(0.0, description="for which each pulse lasts at least, however short its command is")
    dead_on_s: NonNegative = Field(0.0, description="a pulse that is commanded for less does not open its valve")
    failures: tuple[Failure, ...] = Field((), max_length=64, description="of jets, each for a time")
    nominal_pa: Positive | None = Field(
        None, description="absolute supply pressure that jets' force_n holds for; thrust is in proportion to column supply_pa over this"
    )
    lag_delay_correlation: FiniteFloat = Field(0.0, ge=-1, le=1, description="of the errors of lag and command delay")
    wrench_point_m: Place = Field(ZERO, description="from O: the point about which commanded torques are")
    wrench_limits: Limits | None = Field(
        None, description="N m about and N along X, Y, Z: the most of a commanded wrench that acts; absent: all of it"
    )

    @property
    def stated_lag_s(self) -> float:
        """The lag as a number; ValueError where it is still to be found."""
        if self.lag_s == "auto":
            raise ValueError("the lag is not found yet")
        return self.lag_s


class Jet(Section):
    """One on/off jet: where it acts and the force on the vehicle at full thrust."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$")
    position_m: Place
    force_n: Vector
    rise_s: NonNegative = Field(0.0, description="linear rise to full thrust")
    fall_s: NonNegative = Field(0.0, description="linear fall from full thrust")
    delay_s: NonNegative = Field(0.0, le=1.0, description="by which its pulses begin later than cycle.command_delay_cycles says")
    thrust_sigma: NonNegative = Field(0.0, le=0.3, description="relative uncertainty of its thrust, beside the one that all have in common")
    position_sigma_m: NonNegative = Field(0.0, le=1.0, description="uncertainty of its place, along each axis")
    direction_sigma_rad: NonNegative = Field(0.0, le=0.3, description="uncertainty of its direction, about each axis across it")
