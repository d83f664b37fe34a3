"""Vehicle file models: control cycle, IMU, environment, thrust and jets."""

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
"""Largest deviation from 1 of a quaternion's norm or of products of a rotation matrix's rows, from rounding and averaging."""
EXACT = 1e-12
"""Largest deviation of the products of rows for which a rotation matrix stays as stated."""
EDGE = 1e-9
"""Tolerance of a pulse's start at a limit, s."""


EnvironmentKind = Literal["free", "air_bearing", "pedestal", "planar"]


PIVOTED: tuple[EnvironmentKind, ...] = ("air_bearing", "pedestal")
"""Environments in which the vehicle rotates about a pivot under gravity."""


class Cycle(Section):
    """Control cycle, and delay between command and execution."""

    period_s: Positive
    pwm_tick_s: Positive | None = Field(None, description="resolution of on-times; informative: massprop does not quantise on-times again")
    command_delay_cycles: NonNegative | Literal["auto"] = Field(
        0.0, description="delay from the start of the cycle that issues a command to the start of its execution"
    )
    command_delay_sigma_cycles: NonNegative = Field(0.0, description="one sigma of a stated delay; included in every sigma")
    pulse_at: Literal["begin", "centre", "end"] = Field("begin", description="position of a jet's pulse in its cycle, after the delay")


def _require_cutoff_or_preset(schema: dict[str, Any]) -> None:
    """Require a cutoff, a preset (which gives the cutoff) or order 0 (which has none)."""
    unfiltered = {"properties": {"order": {"const": 0}}, "required": ["order"]}
    schema["anyOf"] = [{"required": ["cutoff_hz"]}, {"required": ["preset"]}, unfiltered]


LATEST_S = 1.0
"""Largest latency of a sensor, positive or negative, s."""


class LowPass(Section):
    """Filter of a sensor before the recording: Butterworth low-pass and latency."""

    model_config = ConfigDict(json_schema_extra=_require_cutoff_or_preset)

    preset: str | None = Field(
        None, description="name of an IMU filter preset; its keys apply if they are not stated here (docs/imu-filters.md)"
    )
    order: Literal[0, 1, 2] = Field(2, description="0: only latency_s; 1: first-order lag; 2: second-order Butterworth low-pass")
    cutoff_hz: Positive | Literal["auto"] | None = Field(
        None, description='cutoff frequency (gain 0.707); "auto": estimated from the log; not for order 0'
    )
    cutoff_sigma_hz: NonNegative = Field(0.0, description="one sigma of a stated cutoff; included in every sigma")
    latency_s: Annotated[Real, Field(ge=-LATEST_S, le=LATEST_S)] | Literal["auto"] = Field(
        0.0, description='delay of values after their time stamps beyond that of the low-pass; "auto": estimated from the log'
    )
    latency_sigma_s: NonNegative = Field(0.0, description="one sigma of latency_s; included in every sigma")

    @model_validator(mode="after")
    def _fits_order(self) -> Self:
        if (self.order == 0) != (self.cutoff_hz is None):
            raise ValueError(f"order = {self.order} {'has no cutoff_hz' if self.order == 0 else 'needs cutoff_hz'}")
        if self.order == 0 and self.cutoff_sigma_hz > 0:
            raise ValueError("order = 0 has no cutoff_hz, and no cutoff_sigma_hz")
        return self

    @property
    def cutoff(self) -> float:
        """Cutoff, Hz. Raises ValueError if it is not stated or not estimated yet."""
        if self.cutoff_hz is None or self.cutoff_hz == "auto":
            raise ValueError("the cutoff is not found yet")
        return self.cutoff_hz

    @property
    def latency(self) -> float:
        """Latency, s. Raises ValueError if it is not estimated yet."""
        if self.latency_s == "auto":
            raise ValueError("the latency is not found yet")
        return self.latency_s

    @property
    def open(self) -> bool:
        """Whether cutoff or latency must be estimated from the log."""
        return "auto" in (self.cutoff_hz, self.latency_s)


_NOISE = "white noise, one sigma; absent: estimated from the log; 0: replaced by a noise floor"


class Imu(Section):
    """Position, mounting and errors of the IMU. Noise is one sigma of the mean over a cycle, or over a group (docs/log.md, two clocks)."""

    clock_drift_ppm: Real = Field(
        0.0,
        ge=-FASTEST_PPM,
        le=FASTEST_PPM,
        description="relative rate of the IMU's clock to the commands' clock, less 1; both agree at the start of the log",
    )
    clock_even: bool | None = Field(
        None,
        description=(
            "true: records are evenly spaced and complete, whatever their time stamps; false: time stamps are right; "
            "absent: the increments decide if time stamps are uneven"
        ),
    )
    position_m: Place = Field(ZERO, description="position from O, body axes")
    position_sigma_m: NonNegative = Field(0.0, le=1.0, description="one sigma of position_m along each axis")
    body_from_imu: tuple[Vector, Vector, Vector] = Field(IDENTITY, description="rotation matrix from IMU to body axes, by rows")
    mounting_sigma_rad: NonNegative = Field(0.0, le=0.3, description="one sigma of body_from_imu about each axis")
    gyro_noise_rad_s: NonNegative | None = Field(None, description=_NOISE)
    accel_noise_m_s2: NonNegative | None = Field(None, description=_NOISE)
    attitude_sigma_rad: Positive | None = Field(
        None,
        description="white noise of each logged attitude about each axis, one sigma, on an air bearing; absent: estimated from the log",
    )
    attitude_latency_s: NonNegative | Literal["auto"] = Field(
        0.0, description='age of each logged attitude at its time_s; "auto": estimated from the log'
    )
    attitude_latency_sigma_s: NonNegative = Field(
        0.0,
        description=(
            "one sigma of attitude_latency_s; included in every sigma; if the log determines the latency to half of this, "
            "the estimate is used"
        ),
    )
    attitude_misalignment_sigma_rad: NonNegative = Field(
        0.0,
        le=0.3,
        description="constant rotation between the logged attitude's body axes and the vehicle's, one sigma about each axis; estimated",
    )
    gyro_bias_rad_s: Vector = Field(ZERO, description="known gyro bias, IMU axes; subtracted from the readings")
    gyro_bias_walk_rad_s_sqrt_s: NonNegative = Field(
        0.0,
        description=(
            "random walk of the gyro bias about each axis: one sigma of the change in one second; also the default of gyro_bias_sigma_rad_s"
        ),
    )
    gyro_bias_sigma_rad_s: NonNegative = Field(
        0.0, description="one sigma of the remaining gyro bias about each axis; estimated", validate_default=True
    )
    accel_bias_sigma_m_s2: NonNegative = 0.0
    gyro_lag_s: NonNegative = Field(0.0, description="time constant of a first-order low-pass in the gyro; inverted record by record")
    accel_lag_s: NonNegative = Field(
        0.0, description="time constant of a first-order low-pass in the accelerometer; noise enters before it"
    )
    gyro_lag_sigma_s: NonNegative = Field(0.0, description="one sigma of gyro_lag_s; included in every sigma")
    accel_lag_sigma_s: NonNegative = Field(0.0, description="one sigma of accel_lag_s; included in every sigma")
    measures: Literal["increment", "mean", "sample"] = Field(
        "increment", description="meaning of a record: increment or mean over its interval, or sample at its time"
    )
    gyro_filter: LowPass | None = None
    accel_filter: LowPass | None = None
    accel_axes: Literal["imu", "start"] = Field(
        "imu", description="axes of the velocity increments: current IMU axes, or IMU axes at the start of each record"
    )
    filter_correlation: Annotated[tuple[FiniteFloat, ...], Field(min_length=5, max_length=14)] | None = Field(
        None,
        description=(
            "correlations of errors. Time constants 1 / (2 pi cutoff): gyro and accelerometer with the delay, both with the"
            " lag, with each other. Then latencies: gyro and accelerometer with the delay, both with the lag, both with the"
            " gyro's time constant, both with the accelerometer's, with each other"
        ),
    )
    gyro_range_rad_s: Positive | None = None
    accel_range_m_s2: Positive | None = None
    gyro_outliers_s: tuple[FiniteFloat, ...] | None = Field(
        None, description="time_s of records whose gyro readings are ignored; absent: estimated from the log"
    )
    accel_outliers_s: tuple[FiniteFloat, ...] | None = Field(
        None, description="time_s of records whose accelerometer readings are ignored; absent: estimated from the log"
    )

    @field_validator("gyro_bias_sigma_rad_s")
    @classmethod
    def _at_least_walk(cls, sigma: float, about: ValidationInfo) -> float:
        return sigma or float(about.data.get("gyro_bias_walk_rad_s_sqrt_s", 0.0))

    @property
    def attitude_latency(self) -> float:
        """Attitude latency, s; 0 if it is not estimated yet."""
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
        deviation = np.abs(matrix @ matrix.T - np.eye(3)).max()
        if deviation > OFF_UNIT or np.linalg.det(matrix) < 0:
            raise ValueError("is not a rotation matrix; give orthonormal rows with determinant +1")
        if deviation < EXACT:
            return rows
        # nearest rotation in the least-squares sense: orthogonal factor of the polar decomposition
        left, _, right = np.linalg.svd(matrix)
        (a, b, c), (d, e, f), (g, h, i) = (left @ right).tolist()
        return (a, b, c), (d, e, f), (g, h, i)


class Environment(Section):
    """Environment of the test: free flight, spherical air bearing (sliding base or fixed pedestal), or planar table."""

    kind: EnvironmentKind = Field(
        "free",
        description=(
            "air_bearing: spherical bearing on a sliding base; pedestal: spherical bearing fixed to the ground; planar: "
            "table with x, y and yaw, body Z up, and gravity along accelerometer Z"
        ),
    )
    gravity_m_s2: NonNegative = 9.80665
    bearing_position_m: Place = Field(ZERO, description="centre of rotation, from O")
    bearing_mass_kg: NonNegative = Field(0.0, description="mass that translates with the vehicle but does not rotate")
    table_tilt_sigma_rad: NonNegative = Field(0.01, le=0.2, description="one sigma of each of the table's two constant tilts; 0: level")
    initial_attitude_wxyz: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] = (1.0, 0.0, 0.0, 0.0)
    room_torque_n_m: Vector = Field(
        ZERO, description="constant torque along the room's axes on an air bearing or pedestal, for example from a cable or draught"
    )
    disturbance_torque_n_m: NonNegative = Field(0.0, description="white torque on each axis, one sigma per cycle")
    disturbance_walk_n_m: NonNegative = Field(0.0, description="random walk of the torque on each axis: one sigma of the change per cycle")

    damping_sigma_n_m_s: NonNegative = Field(
        0.0, description="one sigma of an unknown damping coefficient (torque over body rate) about each axis; 0: no damping"
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
        """(6,) 1 for torques about and forces along body axes that move the vehicle; 0 for those that the table reacts."""
        return np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0]) if self.kind == "planar" else np.ones(6)

    @property
    def steady_force_m_s2(self) -> Array:
        """(3,) constant specific force in body axes, m/s²: the reaction of a table to gravity."""
        return np.array([0.0, 0.0, self.gravity_m_s2 if self.kind == "planar" else 0.0])


MOST_DROOP = 0.2
"""Largest fraction of its thrust that a jet may lose per other jet."""
Droop = Annotated[NonNegative, Field(le=MOST_DROOP)]


class Failure(Section):
    """Failure of a jet for a time."""

    jet: str
    thrust: FiniteFloat = Field(0.0, description="factor of its thrust: 0 dead, 0.8 weak, -1 reversed")
    start_s: FiniteFloat | None = Field(
        None, description="start, for pulses that begin to act from then on (after their delay), log time; absent: start of the log"
    )
    end_s: FiniteFloat | None = Field(None, description="end, for pulses that begin to act before then; absent: end of the log")

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise ValueError(
                f"the failure of jet {self.jet!r} from {self.start_s:g} to {self.end_s:g} s has no duration; correct start_s or end_s"
            )
        return self

    def of(self, begin_s: Array) -> BoolArray:
        """Whether pulses that begin at ``begin_s`` are affected."""
        early = -np.inf if self.start_s is None else self.start_s
        late = np.inf if self.end_s is None else self.end_s
        return np.asarray((begin_s >= early - EDGE) & (begin_s < late - EDGE))


class Thrust(Section):
    """Uncertainty and dynamics of the actuators."""

    scale_sigma: NonNegative = Field(0.0, description="relative uncertainty common to all forces and torques")
    pulse_sigma: NonNegative = Field(0.0, description="relative uncertainty of each cycle's pulse, independent")
    lag_s: NonNegative | Literal["auto"] = Field(0.0, description='first-order lag of thrust or wrench; "auto": estimated from the log')
    lag_sigma_s: NonNegative = Field(0.0, description="one sigma of a stated lag; included in every sigma")
    droop: Droop = Field(0.0, description="fraction of its thrust that a jet loses for each other open jet")
    cycle_droop: Droop = Field(
        0.0, description="the same for each other jet that fires in the cycle, for a supply that is slower than a pulse"
    )
    least_on_s: NonNegative = Field(0.0, description="minimum duration of each pulse, whatever its command")
    dead_on_s: NonNegative = Field(0.0, description="minimum commanded on-time that opens a valve")
    failures: tuple[Failure, ...] = Field((), max_length=64, description="failures of jets, each for a time")
    nominal_pa: Positive | None = Field(
        None, description="absolute supply pressure at which force_n of the jets holds; thrust is proportional to column supply_pa"
    )
    lag_delay_correlation: FiniteFloat = Field(0.0, ge=-1, le=1, description="correlation of the errors of lag and command delay")
    wrench_point_m: Place = Field(ZERO, description="point about which commanded torques act, from O")
    wrench_limits: Limits | None = Field(None, description="saturation of a commanded wrench: N m about and N along X, Y, Z; absent: none")

    @property
    def stated_lag_s(self) -> float:
        """Lag, s. Raises ValueError if it is not estimated yet."""
        if self.lag_s == "auto":
            raise ValueError("the lag is not found yet")
        return self.lag_s


class Jet(Section):
    """On/off jet: position, and force on the vehicle at full thrust."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$")
    position_m: Place
    force_n: Vector
    rise_s: NonNegative = Field(0.0, description="duration of the linear rise to full thrust")
    fall_s: NonNegative = Field(0.0, description="duration of the linear fall from full thrust")
    delay_s: NonNegative = Field(0.0, le=1.0, description="delay of its pulses in addition to cycle.command_delay_cycles")
    thrust_sigma: NonNegative = Field(
        0.0, le=0.3, description="relative uncertainty of its thrust, in addition to the common thrust.scale_sigma"
    )
    position_sigma_m: NonNegative = Field(0.0, le=1.0, description="one sigma of its position along each axis")
    direction_sigma_rad: NonNegative = Field(0.0, le=0.3, description="one sigma of its direction about each axis across it")
