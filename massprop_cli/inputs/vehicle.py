"""The vehicle file: what is known of the vehicle, its jets, its IMU and the test environment.

The models below are the schema (``massprop schema vehicle``). Unknown keys are refused.
"""

from __future__ import annotations

import json
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, FiniteFloat, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns
from massprop_cli.inputs.rotor import Rotor
from massprop_cli.inputs.section import IDENTITY, ZERO, NonNegative, Place, Positive, Real, Section, Vector
from massprop_cli.inputs.wheel import Wheel

FASTEST_PPM = 1e5
Quantity = Literal["ixx", "ixy", "ixz", "iyy", "iyz", "izz", "cg_x", "cg_y", "cg_z", "mass"]
EnvironmentKind = Literal["free", "air_bearing", "planar"]
PRODUCTS = ("ixy", "ixz", "iyz")


class Cycle(Section):
    """Control cycle and the delay between command and execution."""

    period_s: Positive
    pwm_tick_s: Positive | None = Field(None, description="informative: on-times are not quantised again")
    command_delay_cycles: NonNegative | Literal["auto"] = Field(
        0.0, description="from the start of the cycle that issued a command to the start of its execution"
    )
    command_delay_sigma_cycles: NonNegative = Field(0.0, description="one sigma of a stated delay; goes into every sigma")


class Imu(Section):
    """Where the IMU sits and how it is turned; noise is one sigma of a cycle's mean."""

    clock_drift_ppm: Real = Field(
        0.0,
        ge=-FASTEST_PPM,
        le=FASTEST_PPM,
        description="by how much the IMU's clock runs faster than that of the commands; they agree where the log begins",
    )
    position_m: Place = Field(ZERO, description="from O, body axes")
    position_sigma_m: NonNegative = Field(0.0, le=1.0, description="uncertainty of position_m, along each axis")
    body_from_imu: tuple[Vector, Vector, Vector] = Field(IDENTITY, description="rotation matrix by rows")
    mounting_sigma_rad: NonNegative = Field(0.0, le=0.3, description="uncertainty of body_from_imu, about each axis")
    gyro_noise_rad_s: NonNegative | None = Field(None, description="absent: estimated from the log; 0: a floor is used")
    accel_noise_m_s2: NonNegative | None = Field(None, description="absent: estimated from the log; 0: a floor is used")
    gyro_bias_sigma_rad_s: NonNegative = 0.0
    accel_bias_sigma_m_s2: NonNegative = 0.0
    gyro_lag_s: NonNegative = Field(0.0, description="time constant of a first-order low-pass within the gyro; undone, record by record")
    accel_lag_s: NonNegative = Field(0.0, description="the same within the accelerometer; noise is what is before it")
    gyro_lag_sigma_s: NonNegative = Field(0.0, description="one sigma of gyro_lag_s; goes into every sigma")
    accel_lag_sigma_s: NonNegative = Field(0.0, description="one sigma of accel_lag_s; goes into every sigma")
    gyro_range_rad_s: Positive | None = None
    accel_range_m_s2: Positive | None = None
    gyro_outliers_s: tuple[FiniteFloat, ...] | None = Field(
        None, description="time_s of records whose gyro readings are not used; absent: found in the log"
    )
    accel_outliers_s: tuple[FiniteFloat, ...] | None = Field(
        None, description="time_s of records whose accelerometer readings are not used; absent: found in the log"
    )

    @field_validator("body_from_imu")
    @classmethod
    def _is_rotation(cls, rows: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
        matrix = np.array(rows)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0:
            raise ValueError("is not a rotation matrix; give orthonormal rows with determinant +1")
        return rows


class Environment(Section):
    """Free flight; a spherical air bearing on a base that slides on a horizontal plane; or a table on which the vehicle slides and yaws."""

    kind: EnvironmentKind = Field(
        "free", description="planar: a table with x, y and yaw; body Z points up from it, and the accelerometer feels gravity along Z"
    )
    gravity_m_s2: NonNegative = 9.80665
    bearing_position_m: Place = Field(ZERO, description="centre of rotation, from O")
    bearing_mass_kg: NonNegative = Field(0.0, description="translates with the vehicle, does not rotate")
    table_tilt_sigma_rad: NonNegative = Field(
        0.01, le=0.2, description="one sigma of each of a table's two tilts, which stand still in the world; 0: level"
    )
    initial_attitude_wxyz: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] = (1.0, 0.0, 0.0, 0.0)
    disturbance_torque_n_m: NonNegative = Field(0.0, description="one sigma per cycle, white, each axis")
    disturbance_walk_n_m: NonNegative = Field(0.0, description="a slowly varying torque on each axis: one sigma of its change per cycle")

    @field_validator("initial_attitude_wxyz")
    @classmethod
    def _is_unit(cls, quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        if abs(np.linalg.norm(quaternion) - 1) > 1e-6:
            raise ValueError("is not a unit quaternion; divide it by its norm")
        return quaternion

    @model_validator(mode="after")
    def _has_a_vertical(self) -> Environment:
        if self.kind == "air_bearing" and self.gravity_m_s2 == 0:
            raise ValueError('kind = "air_bearing" with gravity_m_s2 = 0: no bearing holds a vehicle then; state kind = "free", or gravity')
        return self

    @model_validator(mode="after")
    def _stands_on_its_table(self) -> Environment:
        if self.kind == "planar" and max(map(abs, self.initial_attitude_wxyz[1:3])) > 1e-6:
            raise ValueError("initial_attitude_wxyz turns the vehicle out of the table; give a turn about Z, or leave it out")
        return self

    @property
    def moving(self) -> Array:
        """(6,) which torques about, and forces along, the body axes move the vehicle (1): on a table what else there is it takes up (0)."""
        return np.array([0.0, 0.0, 1.0, 1.0, 1.0, 0.0]) if self.kind == "planar" else np.ones(6)

    @property
    def steady_force_m_s2(self) -> Array:
        """(3,) specific force that is the same in body axes however the vehicle moves: on a table, of what carries its weight."""
        return np.array([0.0, 0.0, self.gravity_m_s2 if self.kind == "planar" else 0.0])


class Thrust(Section):
    """Uncertainty and dynamics of the actuators."""

    scale_sigma: NonNegative = Field(0.0, description="common relative uncertainty of all forces and torques")
    pulse_sigma: NonNegative = Field(0.0, description="relative, independent per cycle's pulse")
    lag_s: NonNegative | Literal["auto"] = Field(0.0, description='first-order lag of thrust or wrench; "auto": estimated from the log')
    lag_sigma_s: NonNegative = Field(0.0, description="one sigma of a stated lag; goes into every sigma")
    lag_delay_correlation: FiniteFloat = Field(0.0, ge=-1, le=1, description="of the errors of lag and command delay")

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
    thrust_sigma: NonNegative = Field(0.0, le=0.3, description="relative uncertainty of its thrust, beside the one that all have in common")
    position_sigma_m: NonNegative = Field(0.0, le=1.0, description="uncertainty of its place, along each axis")
    direction_sigma_rad: NonNegative = Field(0.0, le=0.3, description="uncertainty of its direction, about each axis across it")


class Nominal(Section):
    """CAD values: shown beside the estimates, never pulling them."""

    poi_convention: Literal["tensor", "positive_integral"] | None = None
    ixx: Positive | None = None
    ixy: Real | None = None
    ixz: Real | None = None
    iyy: Positive | None = None
    iyz: Real | None = None
    izz: Positive | None = None
    cg_x: Real | None = None
    cg_y: Real | None = None
    cg_z: Real | None = None
    mass: Positive | None = None

    def value(self, name: str) -> float | None:
        """The nominal value of a quantity, products as the tensor's own elements."""
        stated: float | None = getattr(self, name)
        flip = stated is not None and name in PRODUCTS and self.poi_convention == "positive_integral"
        return -stated if flip and stated is not None else stated

    @model_validator(mode="after")
    def _states_convention(self) -> Nominal:
        if self.poi_convention is None and any(getattr(self, name) is not None for name in PRODUCTS):
            raise ValueError('a product of inertia needs poi_convention = "tensor" or "positive_integral" beside it')
        return self


class Known(Section):
    """A quantity measured elsewhere, which enters the estimate."""

    value: Real
    sigma: Positive


def _positive_known(known: dict[Quantity, Known]) -> dict[Quantity, Known]:
    for name, quantity in known.items():
        if quantity.value <= 0 and name in ("ixx", "iyy", "izz", "mass"):
            problem = f"value = {quantity.value}: must be greater than 0, as the {name} of any body is"
            raise PydanticCustomError("not_positive", "{problem}", {configfile.KEY: name, "problem": problem})
    return known


KnownTable = Annotated[dict[Quantity, Known], AfterValidator(_positive_known)]


class Phase(Section):
    """A stretch of the log, ``start_s < time_s <= end_s``, estimated on its own."""

    name: str = Field(min_length=1)
    start_s: FiniteFloat
    end_s: FiniteFloat
    known: KnownTable = Field({}, description="quantities of this phase that were measured elsewhere")

    @model_validator(mode="after")
    def _is_ordered(self) -> Phase:
        if self.end_s <= self.start_s:
            raise ValueError(f"phase {self.name!r} ends at {self.end_s} s, not after its start at {self.start_s} s")
        return self

    def overlaps(self, other: Phase) -> bool:
        """Whether a cycle may be of both."""
        return max(self.start_s, other.start_s) < min(self.end_s, other.end_s)


class Docking(Section):
    """Which phases are before and after docking."""

    before: str
    after: str
    known: KnownTable = Field({}, description="quantities of the docked object that were measured elsewhere")


class Column(Section):
    """Where a contract column is found in this log: ``value = scale * column``."""

    from_: str = Field(alias="from")
    scale: Real = 1.0

    @model_validator(mode="after")
    def _scales(self) -> Column:
        if self.scale == 0:
            raise ValueError("scale is zero")
        return self


class ThesisSettings(Section):
    """Hand-set matrices of the thesis (appendix B): diagonals, SI. First filter nine states, second filter mass."""

    p1: tuple[Positive, ...] = (10.0,) * 9
    q1: tuple[NonNegative, ...] = (5e-9, 1e-11, 1e-11, 5e-9, 1e-11, 5e-9, 1e-9, 1e-9, 1e-9)
    r1: Positive = 5e-2
    p2: Positive = 50.0
    q2: NonNegative = 1e-5
    r2: Positive = 5e-2
    p1_again: tuple[Positive, ...] | None = Field(None, description="p1 of every phase but the first; absent: p1")
    p2_again: Positive | None = Field(None, description="p2 of every phase but the first; absent: p2")
    initial: tuple[Real, ...] = Field((0.0,) * 10, description="the ten quantities at the start")

    @model_validator(mode="after")
    def _has_sizes(self) -> ThesisSettings:
        for key, size in (("p1", 9), ("q1", 9), ("p1_again", 9), ("initial", 10)):
            values = getattr(self, key)
            if values is not None and len(values) != size:
                raise ValueError(f"{key} has {len(values)} values; give {size}")
        return self


class EstimatorSettings(Section):
    """Settings of the estimators; the defaults serve every vehicle."""

    method: Literal["default", "thesis"] = "default"
    bins_per_cycle: int = Field(4, ge=2, le=200, description="resolution of motion within a control cycle")
    prior_scale: Positive = Field(100.0, le=1e6, description="prior sigma over the vehicle's natural size; larger pulls less")
    accel_noise_scale: tuple[Positive, Positive, Positive] | None = Field(
        None, description="factor on accel_noise per body axis; absent: from a first pass over the log"
    )
    adapt_noise: bool = Field(True, description="size disturbances from a first pass where the stated noise can't explain the log")
    split_on_change: bool = Field(False, description="where the mass properties change at once within a phase, begin a new phase there")
    refine: bool = Field(False, description="report the off-line maximum-likelihood fit of each phase instead of its last causal row")
    thesis: ThesisSettings = ThesisSettings()


class ConvergenceSettings(Section):
    """The sustained-convergence rule."""

    count: int = Field(100, ge=1, description="consecutive updates within tolerance")
    relative: bool | None = Field(None, description="tolerances relative to the natural size; absent: by method")
    inertia_tolerance: Positive | None = Field(None, description="default 0.01 of the trace; thesis 0.05 kg m^2")
    cg_tolerance: Positive | None = Field(None, description="default 0.01 of sqrt(trace/mass); thesis 0.05 m")
    mass_tolerance: Positive | None = Field(None, description="default 0.01 of the mass; thesis 0.1 kg")


class Drift(Section):
    """Random walk per quantity, one sigma per sqrt(s), in the quantity's unit."""

    ixx: NonNegative = 0.0
    ixy: NonNegative = 0.0
    ixz: NonNegative = 0.0
    iyy: NonNegative = 0.0
    iyz: NonNegative = 0.0
    izz: NonNegative = 0.0
    cg_x: NonNegative = 0.0
    cg_y: NonNegative = 0.0
    cg_z: NonNegative = 0.0
    mass: NonNegative = 0.0


class Vehicle(Section):
    """A whole vehicle file, checked."""

    schema_: Literal[1] = Field(alias="schema")
    name: str = "vehicle"
    cycle: Cycle
    imu: Imu = Imu()
    environment: Environment = Environment()
    thrust: Thrust = Thrust()
    jets: tuple[Jet, ...] = Field((), max_length=256)
    rotors: tuple[Rotor, ...] = Field((), max_length=64)
    wheels: tuple[Wheel, ...] = Field((), max_length=64)
    nominal: Nominal = Nominal()
    known: KnownTable = Field({}, description="quantities measured elsewhere, of the only phase; with several, state them under each")
    phases: tuple[Phase, ...] = Field((), max_length=64)
    docking: Docking | None = None
    drift: Drift = Drift()
    columns: dict[str, Column] = Field({}, description="this log's own name and scale of a contract column")
    estimator: EstimatorSettings = EstimatorSettings()
    convergence: ConvergenceSettings = ConvergenceSettings()

    @model_validator(mode="after")
    def _is_coherent(self) -> Vehicle:
        for kind, named in (("jet", self.jets), ("rotor", self.rotors), ("wheel", self.wheels), ("phase", self.phases)):
            twice = configfile.repeated(one.name for one in named)
            if twice is not None:
                raise ValueError(f"{kind} name {twice!r} is used twice; give each its own")
        if self.environment.kind == "planar" and self.estimator.method == "thesis":
            raise ValueError('estimator.method = "thesis" knows free flight and the air bearing only; leave it out on a table')
        if self.known and len(self.phases) > 1:
            raise ValueError(
                f"known.{next(iter(self.known))} does not say which of {len(self.phases)} phases it is of; state it under that phase "
                f"([[phases]] known = {{ ... }}), or under [docking] if it is the docked object's"
            )
        if self.docking is not None:
            if self.docking.before == self.docking.after:
                raise ValueError(f"docking.before and docking.after are both {self.docking.after!r}; name two phases")
            phases = {phase.name: phase for phase in self.phases}
            for name in (self.docking.before, self.docking.after):
                if name not in phases:
                    raise ValueError(f"docking names phase {name!r}, which [[phases]] does not have")
            before, after = phases[self.docking.before], phases[self.docking.after]
            if before.overlaps(after):
                raise ValueError(f"docking: phases {before.name!r} and {after.name!r} overlap; end one where the other starts")
        return self

    @field_validator("columns")
    @classmethod
    def _maps_known_columns(cls, mapping: dict[str, Column], info: ValidationInfo) -> dict[str, Column]:
        of = {
            "jets": (columns.jet,),
            "rotors": (columns.rotor_command, columns.rotor_speed),
            "wheels": (columns.wheel_speed, columns.wheel_torque),
        }
        known = [*columns.FIXED, *(column(one.name) for kind, some in of.items() for one in info.data.get(kind, ()) for column in some)]
        for name in mapping:
            if name not in known:
                hint = configfile.nearest(name, known, "the nearest is")
                raise PydanticCustomError(
                    "unknown_column", "{problem}", {configfile.KEY: name, "problem": f"maps unknown column {name!r}{hint}"}
                )
        return mapping

    def in_phase(self, phase: Phase) -> Vehicle:
        """The vehicle with what is known of it in that phase, and of no other."""
        return self.model_copy(update={"known": {**self.known, **phase.known}})

    @property
    def on_air_bearing(self) -> bool:
        """Whether the body turns on a bearing under gravity."""
        return self.environment.kind == "air_bearing"

    @property
    def uncertain_geometry(self) -> bool:
        """Whether anything is said to be uncertain of where jets and IMU sit and how single jets push."""
        jets = any(jet.thrust_sigma or jet.position_sigma_m or jet.direction_sigma_rad for jet in self.jets)
        return jets or self.imu.position_sigma_m > 0 or self.imu.mounting_sigma_rad > 0

    @property
    def bearing_mass_kg(self) -> float:
        """The part of the mass that translates with the vehicle but does not turn."""
        return self.environment.bearing_mass_kg if self.on_air_bearing else 0.0

    @cached_property
    def jet_wrench(self) -> Array:
        """Torque about O [N m] and force [N] of each jet at full thrust, body axes, shape (jets, 6)."""
        position = np.array([jet.position_m for jet in self.jets]).reshape(-1, 3)
        force = np.array([jet.force_n for jet in self.jets]).reshape(-1, 3)
        return np.hstack([np.cross(position, force), force])

    @cached_property
    def rotor_wrench(self) -> Array:
        """(rotors, 6) torque about O and force of one newton of each rotor's thrust, body axes."""
        return np.array([rotor.wrench for rotor in self.rotors]).reshape(-1, 6)

    @cached_property
    def spinning(self) -> tuple[Wheel, ...]:
        """All whose momentum counts: the wheels, and rotors that state their spin inertia."""
        return (*self.wheels, *(rotor.wheel for rotor in self.rotors if rotor.wheel is not None))

    @cached_property
    def wheel_wrench(self) -> Array:
        """(W, 6) torque and force on the body of 1 N m on each of :attr:`spinning`."""
        axis = np.array([wheel.direction for wheel in self.spinning]).reshape(-1, 3)
        return np.hstack([-axis, np.zeros_like(axis)])


def schema() -> dict[str, Any]:
    """JSON Schema of the vehicle file."""
    return Vehicle.model_json_schema(by_alias=True)


def flat(section: Section, prefix: str) -> dict[str, Any]:
    """A section as dotted keys and JSON values, so that each can be given back as ``KEY=VALUE``."""
    found: dict[str, Any] = {}
    for key, value in json.loads(section.model_dump_json(by_alias=True, exclude_none=True)).items():
        child = getattr(section, key)
        found |= flat(child, f"{prefix}.{key}") if isinstance(child, Section) else {f"{prefix}.{key}": value}
    return found
