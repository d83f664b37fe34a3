"""Vehicle file (``massprop schema vehicle``): vehicle, actuators, IMU, test environment and settings. Refuses unknown keys."""

import math
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import AfterValidator, Field, FiniteFloat, ValidationInfo, field_validator, model_validator
from pydantic_core import to_jsonable_python

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators.actuator import Actuator, MomentumDevice
from massprop_cli.inputs.actuators.control_moment_gyro import ControlMomentGyro
from massprop_cli.inputs.actuators.rotor import Rotor
from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.inputs.ballast import Ballast
from massprop_cli.inputs.columns import Column
from massprop_cli.inputs.equipment import PIVOTED, Cycle, Environment, Imu, Jet, Thrust
from massprop_cli.inputs.estimatorsettings import ConvergenceSettings, Drift, EstimatorSettings
from massprop_cli.inputs.section import Positive, Real, Section

Quantity = Literal["ixx", "ixy", "ixz", "iyy", "iyz", "izz", "cg_x", "cg_y", "cg_z", "mass"]
ASSUMED_KG = 10.0
"""Assumed mass on a pedestal, kg, if none is stated; reported quantities do not depend on it, CG and mass are not reported."""
HEAVIER, HEAVIEST_KG = 1e3, 1e7
"""Largest mass of a sliding bearing base: as a multiple of the vehicle's mass, or in kg if that is not stated."""
PRODUCTS = ("ixy", "ixz", "iyz")


class Nominal(Section):
    """CAD values. Reports show them next to the estimates; the estimates do not depend on them."""

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
        """Nominal value of a quantity, products as tensor elements; None if not stated."""
        stated: float | None = getattr(self, name)
        flip = stated is not None and name in PRODUCTS and self.poi_convention == "positive_integral"
        return -stated if flip and stated is not None else stated

    @model_validator(mode="after")
    def _states_convention(self) -> Self:
        if self.poi_convention is None and any(getattr(self, name) is not None for name in PRODUCTS):
            raise ValueError('a product of inertia needs poi_convention = "tensor" or "positive_integral" beside it')
        return self


class Known(Section):
    """Quantity from another measurement, used in the estimate."""

    value: Real
    sigma: Positive


def _positive_known(known: dict[Quantity, Known]) -> dict[Quantity, Known]:
    for name, quantity in known.items():
        if quantity.value <= 0 and name in ("ixx", "iyy", "izz", "mass"):
            problem = f"value = {quantity.value}: must be greater than 0, as the {name} of any body is"
            raise configfile.at_key(name, problem)
    return known


KnownTable = Annotated[dict[Quantity, Known], AfterValidator(_positive_known)]


class Phase(Section):
    """Part of the log, ``start_s < time_s <= end_s``, with an estimate of its own."""

    name: str = Field(min_length=1)
    start_s: FiniteFloat
    end_s: FiniteFloat
    known: KnownTable = Field({}, description="quantities of this phase from other measurements")

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if self.end_s <= self.start_s:
            raise ValueError(f"phase {self.name!r} ends at {self.end_s} s, not after its start at {self.start_s} s")
        return self


class Docking(Section):
    """Phases before and after docking."""

    before: str
    after: str
    known: KnownTable = Field({}, description="quantities of the docked object from other measurements")


class Vehicle(Section):
    """Vehicle file."""

    schema_: Literal[1] = Field(alias="schema")
    name: str = "vehicle"
    cycle: Cycle
    imu: Imu = Imu.unset()
    environment: Environment = Environment.unset()
    thrust: Thrust = Thrust.unset()
    jets: tuple[Jet, ...] = Field((), max_length=256)
    rotors: tuple[Rotor, ...] = Field((), max_length=64)
    wheels: tuple[Wheel, ...] = Field((), max_length=64)
    control_moment_gyros: tuple[ControlMomentGyro, ...] = Field((), max_length=64)
    ballast: tuple[Ballast, ...] = Field((), max_length=64, description="ballast for massprop balance; not used in the estimate")
    nominal: Nominal = Nominal.unset()
    known: KnownTable = Field(
        {}, description="quantities of the only phase from other measurements; with several phases, state them under each phase"
    )
    phases: tuple[Phase, ...] = Field((), max_length=64)
    docking: Docking | None = None
    drift: Drift = Drift.unset()
    columns: dict[str, Column] = Field({}, description="name and scale in this log of a standard column")
    uncertain: tuple[dict[str, Any], ...] = Field(
        (),
        max_length=64,
        description=(
            "alternatives, each one sigma of an uncertain quantity from the stated values: dotted keys with other values, "
            "or factors of the readings: gyro_factors, accel_factors (3x3), command_factors (6). Included in every sigma"
        ),
    )
    estimator: EstimatorSettings = EstimatorSettings.unset()
    convergence: ConvergenceSettings = ConvergenceSettings.unset()

    @model_validator(mode="after")
    def _is_coherent(self) -> Self:
        for kind, named in (
            ("jet", self.jets),
            ("ballast", self.ballast),
            *((kind.NOUN, own) for kind, own in self.actuators),
            ("phase", self.phases),
        ):
            configfile.check_once((one.name for one in named), kind, "give each its own")
        jets = [jet.name for jet in self.jets]
        unknown = next((failure.jet for failure in self.thrust.failures if failure.jet not in jets), None)
        if unknown is not None:
            raise ValueError(f"thrust.failures names unknown jet {unknown!r}{configfile.nearest(unknown, jets, 'the nearest is')}")
        if self.thrust.nominal_pa is not None and not jets:
            raise ValueError("thrust.nominal_pa is the supply pressure of jets, but there are no [[jets]]; leave it out")
        for first, second in combinations(self.phases, 2):
            if max(first.start_s, second.start_s) < min(first.end_s, second.end_s):
                raise ValueError(
                    f"phases {first.name!r} ({first.start_s:g} to {first.end_s:g} s) and {second.name!r} ({second.start_s:g} to "
                    f"{second.end_s:g} s) overlap; end one where the other starts, or estimate each in a run of its own"
                )
        if self.environment.kind in ("planar", "pedestal") and self.estimator.method == "thesis":
            where = "table" if self.environment.kind == "planar" else "pedestal"
            raise ValueError(f'estimator.method = "thesis" supports only free flight and the air bearing; leave it out on a {where}')
        self._check_bearing()
        if self.known and len(self.phases) > 1:
            raise ValueError(
                f"known.{next(iter(self.known))} does not state its phase, and there are {len(self.phases)}; state it under that phase "
                f"([[phases]] known = {{ ... }}), or under [docking] if it is the docked object's"
            )
        if self.docking is not None:
            if self.docking.before == self.docking.after:
                raise ValueError(f"docking.before and docking.after are both {self.docking.after!r}; name two phases")
            phases = [phase.name for phase in self.phases]
            for name in (self.docking.before, self.docking.after):
                if name not in phases:
                    raise ValueError(f"docking names phase {name!r}, which [[phases]] does not have")
        return self

    def _check_bearing(self) -> None:
        """Raise ValueError for a bearing too heavy to slide: the CG estimate would scale with its mass without any warning."""
        bearing = self.bearing_mass_kg
        stated = [one.value for one in (self.known.get("mass"), *(phase.known.get("mass") for phase in self.phases)) if one is not None]
        whole = [*stated, self.nominal.mass] if self.nominal.mass is not None else stated
        # a total mass below the bearing's must be the vehicle alone
        alone = [mass - bearing if mass > bearing else mass for mass in whole]
        if bearing > HEAVIEST_KG or any(bearing > HEAVIER * mass for mass in alone):
            beside = f"the limit is {HEAVIER:g} times the vehicle's {min(alone):g} kg" if alone else f"the limit is {HEAVIEST_KG:g} kg"
            raise ValueError(
                f'environment.bearing_mass_kg = {bearing:g}: {beside}. If the bearing is fixed to the ground, state kind = "pedestal" and '
                "leave bearing_mass_kg out; if its base slides, state the mass that slides"
            )

    @field_validator("columns")
    @classmethod
    def _maps_known_columns(cls, mapping: dict[str, Column], info: ValidationInfo) -> dict[str, Column]:
        of = [column.of(one.name) for name, kind in ACTUATORS.items() for one in info.data.get(name, ()) for column in kind.COLUMNS]
        known = [*columns.FIXED, *(columns.jet(jet.name) for jet in info.data.get("jets", ())), *of]
        for name in mapping:
            if name not in known:
                hint = configfile.nearest(name, known, "the nearest is")
                raise configfile.at_key(name, f"maps unknown column {name!r}{hint}")
        return mapping

    def in_phase(self, phase: Phase) -> Self:
        """Vehicle in that phase: known values of the phase, with sigmas that grow by stated drift until its end."""
        known = {**self.known, **phase.known}
        drifted = {name: getattr(self.drift, name) * (phase.end_s - phase.start_s) ** 0.5 for name in known}
        grown = {name: Known(value=one.value, sigma=math.hypot(one.sigma, drifted[name])) for name, one in known.items()}
        return self.model_copy(update={"known": grown if any(drifted.values()) else known})

    @property
    def pivoted(self) -> bool:
        """Whether the body rotates about a pivot under gravity, so that the model needs its attitude."""
        return self.environment.kind in PIVOTED

    @property
    def on_air_bearing(self) -> bool:
        """Whether the pivot is a bearing on a sliding base."""
        return self.environment.kind == "air_bearing"

    @property
    def on_pedestal(self) -> bool:
        """Whether the pivot is fixed, so that the motion does not determine the mass."""
        return self.environment.kind == "pedestal"

    @property
    def pedestal_mass_kg(self) -> float:
        """Mass that converts a first moment on a pedestal to a CG, kg: known, else nominal, else assumed."""
        known = self.known.get("mass")
        return known.value if known is not None else self.nominal.mass or ASSUMED_KG

    @property
    def knows_inertia(self) -> bool:
        """Whether all three moments of inertia are known."""
        return all(name in self.known for name in ("ixx", "iyy", "izz"))

    @property
    def held_axes(self) -> list[int]:
        """Body axes without rotation: X and Y on a planar table."""
        return [0, 1] if self.environment.kind == "planar" else []

    @property
    def swings(self) -> bool:
        """Whether a log without commands is sufficient: on a pedestal with known inertia."""
        return self.on_pedestal and self.knows_inertia

    @property
    def estimates_assumptions(self) -> bool:
        """Whether errors of single jets, the IMU or ``uncertain`` values are estimated with the mass properties."""
        jets = any(jet.thrust_sigma or jet.position_sigma_m or jet.direction_sigma_rad for jet in self.jets)
        return jets or self.imu.position_sigma_m > 0 or self.imu.mounting_sigma_rad > 0 or bool(self.uncertain)

    @property
    def bearing_mass_kg(self) -> float:
        """Part of the mass that translates with the vehicle but does not rotate, kg."""
        return self.environment.bearing_mass_kg if self.on_air_bearing else 0.0

    @cached_property
    def jet_wrench(self) -> Array:
        """(jets, 6) torque about O [N m] and force [N] of each jet at full thrust, body axes."""
        position = np.array([jet.position_m for jet in self.jets]).reshape(-1, 3)
        force = np.array([jet.force_n for jet in self.jets]).reshape(-1, 3)
        return np.hstack([np.cross(position, force), force])

    @cached_property
    def unit_wrench(self) -> Array:
        """(6, 6) torque about O and force for a unit of each component of a commanded wrench, body axes."""
        about = np.cross(self.thrust.wrench_point_m, np.eye(3))
        return np.block([[np.eye(3), np.zeros((3, 3))], [about, np.eye(3)]])

    @cached_property
    def rotor_wrench(self) -> Array:
        """(rotors, 6) torque about O [N m] and force [N] for one newton of each rotor's thrust, body axes."""
        return np.array([rotor.wrench for rotor in self.rotors]).reshape(-1, 6)

    @property
    def actuators(self) -> list[tuple[type[Actuator], tuple[Any, ...]]]:
        """Actuators other than jets, by kind."""
        return [(kind, getattr(self, name)) for name, kind in ACTUATORS.items()]

    @cached_property
    def spinning(self) -> tuple[MomentumDevice, ...]:
        """Momentum devices: wheels, control moment gyros, and rotors with a stated spin inertia."""
        return tuple(device for _, own in self.actuators for one in own if (device := one.device) is not None)

    @cached_property
    def momentum_wrench(self) -> Array:
        """(A, 6) torque and force on the body for 1 N m along each axis of :attr:`spinning`."""
        axes = np.concatenate([np.zeros((0, 3)), *(device.axes for device in self.spinning)])
        return np.hstack([-axes, np.zeros_like(axes)])

    def with_acting(self, factors: Array) -> Self | None:
        """Vehicle whose momentum along each axis of :attr:`spinning` has the given factors (A,); None if no values of keys give that."""
        changed, at = {}, 0
        for kind, own in self.actuators:
            found = []
            for one in own:
                count = 0 if one.device is None else len(one.device.axes)
                mine, at = factors[at : at + count], at + count
                found.append(one if (mine == 1).all() else one.acting(mine))
            if None in found:
                return None
            changed[kind.TABLE] = tuple(found)
        return self.model_copy(update=changed)


ACTUATORS: dict[str, type[Actuator]] = {
    name: kind
    for name, field in Vehicle.model_fields.items()
    for kind in get_args(field.annotation)[:1]
    if isinstance(kind, type) and issubclass(kind, Actuator)
}
"""Actuator classes by table of the vehicle file."""


def flat(section: Section, prefix: str) -> dict[str, Any]:
    """Section as dotted keys with JSON values; each is valid as ``KEY=VALUE``."""
    found: dict[str, Any] = {}
    for name, stated in type(section).model_fields.items():
        key, value = f"{prefix}.{stated.alias or name}", getattr(section, name)
        if isinstance(value, Section):
            found |= flat(value, key)
        elif value is not None:
            found[key] = to_jsonable_python(value, by_alias=True, exclude_none=True)
    return found
