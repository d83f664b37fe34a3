"""True conditions of a scenario: body, sensors, actuators, disturbances and control; thrust of rotors."""

from typing import Literal, Self

import numpy as np
from pydantic import Field, FiniteFloat, model_validator

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.inputs.actuators.rotor import Rotor
from massprop_cli.inputs.equipment import Droop, Failure
from massprop_cli.inputs.section import ZERO, NonNegative, Positive, Section, Vector
from massprop_cli.inputs.vehicle import PRODUCTS, Vehicle


class Body(Section):
    """True mass properties of a body: inertia about its CG, CG from O, body axes."""

    ixx: Positive
    ixy: FiniteFloat = 0.0
    ixz: FiniteFloat = 0.0
    iyy: Positive
    iyz: FiniteFloat = 0.0
    izz: Positive
    poi_convention: Literal["tensor", "positive_integral"] = Field(
        "tensor", description="sign of the products: ixy = -Σ m x y, or +Σ m x y"
    )
    cg_x: FiniteFloat = 0.0
    cg_y: FiniteFloat = 0.0
    cg_z: FiniteFloat = 0.0
    mass: Positive = Field(description="on an air bearing with the bearing's")

    @model_validator(mode="after")
    def _is_body(self) -> Self:
        moments = np.linalg.eigvalsh(self.inertia)
        if moments[0] <= 1e-9 * moments[-1]:
            raise ValueError(f"the inertia is singular or not positive definite (least principal moment {moments[0]:.4g} kg m^2)")
        return self

    @property
    def values(self) -> Array:
        """(10,) quantities in the order of :data:`massprop_cli.QUANTITIES`; products are the tensor's elements."""
        flip = -1.0 if self.poi_convention == "positive_integral" else 1.0
        return np.array([getattr(self, name) * (flip if name in PRODUCTS else 1.0) for name in QUANTITIES])

    @property
    def inertia(self) -> Array:
        """(3, 3) inertia about the CG, kg m²."""
        return tensor(self.values[:6])

    @property
    def breaks_triangle(self) -> bool:
        """Whether the principal moments violate the triangle inequality."""
        low, middle, high = np.linalg.eigvalsh(self.inertia)
        return bool(low + middle < high * (1 - 1e-9))


class Sensors(Section):
    """The IMU as it really is; noise is one sigma of a cycle's mean, absent: as the vehicle file states (none there: none)."""

    records_per_cycle: int = Field(1, ge=1, le=200, description="IMU records logged in each control cycle")
    gyro_noise_rad_s: NonNegative | None = None
    accel_noise_m_s2: NonNegative | None = None
    gyro_bias_rad_s: Vector = Field(ZERO, description="IMU axes")
    gyro_bias_walk_rad_s_sqrt_s: NonNegative | None = Field(
        None, description="random walk of that about each axis; absent: imu.gyro_bias_walk_rad_s_sqrt_s"
    )
    accel_bias_m_s2: Vector = Field(ZERO, description="IMU axes")
    gyro_quantum_rad: NonNegative = Field(0.0, description="smallest angle increment; what is left over goes into the next record")
    accel_quantum_m_s: NonNegative = Field(0.0, description="smallest velocity increment")
    gyro_axes: tuple[Literal["x", "y", "z"], ...] = Field(("x", "y", "z"), description="IMU axes that are logged")
    accel_axes: tuple[Literal["x", "y", "z"], ...] = Field(("x", "y", "z"), description="IMU axes that are logged; [] for no accelerometer")
    log_attitude: bool = Field(False, description="write quat_w … quat_z")
    attitude_noise_rad: NonNegative | None = Field(
        None, description="one sigma of each logged attitude about each axis; absent: imu.attitude_sigma_rad, or none"
    )
    attitude_latency_s: NonNegative | None = Field(
        None, description="time by which each is older than its record's end; absent: imu.attitude_latency_s"
    )
    attitude_misalignment_rad: Vector = Field(ZERO, description="turn from the body's axes to those that are logged")
    attitude_every_records: int = Field(1, ge=1, description="one of so many records has an attitude; the cells of the others are empty")

    @property
    def axes(self) -> tuple[bool, ...]:
        """Which of gyro x y z and accelerometer x y z are logged."""
        return tuple(axis in logged for logged in (self.gyro_axes, self.accel_axes) for axis in "xyz")


class TrueActuators(Section):
    """Jets, wrench or rotors as they really are; absent: as the vehicle file states."""

    pwm_tick_s: Positive | None = Field(None, description="on-times are rounded to this; absent: cycle.pwm_tick_s, or not rounded")
    minimum_pulse_s: NonNegative = Field(0.0, description="shorter pulses are not fired")
    delay_cycles: NonNegative | None = Field(None, description="true delay, may be fractional")
    lag_s: NonNegative | None = Field(None, description="true first-order lag")
    pulse_at: Literal["begin", "centre", "end"] | None = Field(None, description="where in its cycle a jet's pulse lies in truth")
    jet_delays_s: dict[str, NonNegative] = Field(
        default_factory=dict, description="by jet, true delay of its pulses beyond that of all; absent: as the vehicle file states"
    )
    scale: Positive = Field(1.0, description="true thrust over the vehicle file's")
    droop: Droop | None = Field(None, description="part of its thrust that a jet loses for each other jet that is open")
    cycle_droop: Droop | None = Field(None, description="the same for each other jet that fires in the cycle")
    pulse_sigma: NonNegative | None = Field(None, description="relative error of each pulse")
    max_torque_n_m: Vector | None = Field(None, description="full command about each axis of a vehicle without jets")
    max_force_n: Vector | None = Field(None, description="full command along each axis of a vehicle without jets")
    max_rotor_command: Positive | None = Field(None, description="most x of thrust_n that a rotor is commanded; its least is 0")
    hover_force_n: Vector | None = Field(None, description="force of all rotors, without torque about O, about which the plan's pulses go")
    supply_v: tuple[Positive, Positive] | None = Field(
        None, description="voltage of the rotors' supply as the log begins and ends, in between it falls evenly; absent: nominal_v"
    )
    max_wheel_torque_n_m: Positive | None = Field(None, description="full torque on each of the vehicle's wheels")
    wheel_scale: Positive = Field(1.0, description="true spin inertia of wheels, and momentum of gyros, over the vehicle file's")
    max_gimbal_rate_rad_s: Positive | None = Field(None, description="of each control moment gyro")
    gyro_run_down_s: Positive | None = Field(
        None, description="time constant with which the rotors of control moment gyros run down; absent: they keep their speeds"
    )
    failures: tuple[Failure, ...] | None = Field(None, description="of jets; absent: as the vehicle file states")
    supply_pa: tuple[Positive, Positive] | None = Field(
        None, description="absolute supply pressure as the log begins and ends, in between it falls evenly; absent: thrust.nominal_pa"
    )


class TrueDisturbance(Section):
    """What nobody commanded: a torque; a table's slope."""

    torque_n_m: NonNegative | None = Field(None, description="one sigma per cycle, white, each axis; absent: as the vehicle file states")
    walk_n_m: NonNegative | None = Field(
        None, description="one sigma of a slow torque's change per cycle; absent: as the vehicle file states"
    )
    constant_n_m: Vector = ZERO
    room_n_m: Vector | None = Field(
        None, description="a steady torque that stands still in the room, along its axes; absent: as the vehicle file states"
    )
    periodic_n_m: Vector = Field(ZERO, description="amplitude of a sine that begins with the log")
    periodic_s: Positive = Field(10.0, description="its period")
    rate_n_m_s: Vector = Field(ZERO, description="friction or drag: torque against the body rate about each axis, over it")
    table_tilt_rad: tuple[FiniteFloat, FiniteFloat] = Field((0.0, 0.0), description="by which a table is turned about the world's X and Y")
    table_hold: float = Field(
        0.0, ge=0, le=1, description="part of the weight's pull along a tilted table that something holds, and the accelerometer feels"
    )


class Fuel(Section):
    """Fuel burnt by the jets: mass falls with the impulse given, CG and inertia too where the tank's place is known."""

    specific_impulse_s: Positive
    tank_position_m: Vector | None = Field(None, description="from O; the fuel counts as a point there")


class Control(Section):
    """Attitude hold: ``τ = ω × Î ω − D ω − K q_vec`` per axis, from the gyro's rates and the attitude integrated from them.

    Gains stand here, or are made of a body by ``natural_frequency_rad_s`` and ``damping``; then its CG's offset torque is fed forward.
    """

    inertia_kg_m2: Vector = Field(ZERO, description="diagonal of the controller's own inertia Î")
    rate_gain_n_m_s: Vector | None = None
    attitude_gain_n_m: Vector | None = None
    model: Literal["nominal", "estimate", "truth"] | None = Field(
        None,
        description="the body that gains are made of: the vehicle's [nominal], that until the running estimate has converged, or the truth",
    )
    natural_frequency_rad_s: Positive | None = Field(None, description="of each axis, with a model")
    damping: Positive | None = Field(None, description="of each axis over critical, with a model")

    @model_validator(mode="after")
    def _has_gains(self) -> Self:
        given = {name for name in self.model_fields_set if getattr(self, name) is not None}
        stated, made = {"rate_gain_n_m_s", "attitude_gain_n_m"}, {"natural_frequency_rad_s", "damping"}
        wanted, unwanted = (stated, made) if self.model is None else (made, stated | {"inertia_kg_m2"})
        if wanted - given:
            why = "without a model gains are stated" if self.model is None else f'model = "{self.model}" makes gains of these'
            raise ValueError(f"{why}: give {' and '.join(sorted(wanted - given))}")
        if unwanted & given:
            why = "belongs to a model" if self.model is None else f'has no meaning beside model = "{self.model}"'
            raise ValueError(f"{', '.join(sorted(unwanted & given))} {why}; drop it{', or give model' if self.model is None else ''}")
        return self


class Initial(Section):
    """Motion at the start of the log; the attitude is the vehicle file's."""

    rate_rad_s: Vector = ZERO


CURVE = 2001
"""Number of values of x in the table that inverts thrust."""


def thrust(rotor: Rotor, x: Array) -> Array:
    """Thrust of a rotor at ``x``, N."""
    return np.polynomial.Polynomial(rotor.thrust_n)(x)


def curve(rotor: Rotor, real: TrueActuators) -> tuple[Array, Array]:
    """(n,) values of x up to ``max_rotor_command``, and (n,) thrust at these, N."""
    x = np.linspace(0.0, real.max_rotor_command or 0.0, CURVE)
    return x, thrust(rotor, x)


def full_thrust(vehicle: Vehicle, real: TrueActuators) -> Array:
    """(2, R) smallest and largest thrust of each rotor, N."""
    return np.array([curve(rotor, real)[1][[0, -1]] for rotor in vehicle.rotors]).T


def rotor_problem(vehicle: Vehicle, real: TrueActuators, at_once: bool) -> str:
    """Reason why the rotors cannot be simulated; empty if they can. ``at_once``: without thrust lag."""
    if not vehicle.rotors:
        return (
            "" if real.max_rotor_command is None and real.hover_force_n is None else "max_rotor_command and hover_force_n need [[rotors]]"
        )
    if vehicle.jets or real.max_torque_n_m or real.max_force_n:
        return "a log has commands of rotors, or of jets or a wrench: drop one kind"
    if real.max_rotor_command is None or real.hover_force_n is None:
        return "give actuators.max_rotor_command, and actuators.hover_force_n, the force of all rotors about which the plan's pulses go"
    unsteady = next((one.name for one in vehicle.rotors if (np.diff(curve(one, real)[1]) <= 0).any()), None)
    if unsteady is not None:
        return f"thrust_n of rotor {unsteady!r} does not rise all the way to actuators.max_rotor_command = {real.max_rotor_command:g}"
    jumping = next((one.name for one in vehicle.rotors if one.column == "speed" and at_once), None)
    return "" if jumping is None else f"rotor {jumping!r} logs its speed: give actuators.lag_s, with which it follows commands"
