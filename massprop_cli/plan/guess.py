"""Guess of a vehicle before its test: ten quantities with their spread, and properties of actuators and sensors."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from massprop_cli import QUANTITIES
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import elements, tensor
from massprop_cli.inputs.section import NonNegative, Section
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed.bound import natural_sizes
from massprop_cli.testbed.conditions import Body, Sensors, TrueActuators

SPREAD = 0.2
"""Default relative spread of inertia and mass, and of the CG's distance from a bearing."""
CG_SPREAD = 0.05
"""Default spread of a free vehicle's CG, relative to sqrt(trace/mass)."""
DRAWN = 4
"""Number of bodies in addition to the guess; with 4, no plan suits the guess alone (tests/plan/test_plan.py)."""
FLAT = 1.01
"""Ratio of ixx + iyy to izz in a planar guess that states only izz; above 1 to keep the triangle inequality."""
NEEDED = ("ixx", "iyy", "izz", "mass")
"""Quantities that a guess must contain."""


class GuessFile(Section):
    """A guess file."""

    schema_: Literal["massprop/guess/1"] = Field("massprop/guess/1", alias="schema")
    body: Body = Field(description="what the vehicle is guessed to be")
    spread: NonNegative = Field(SPREAD, lt=0.9, description="inertia and mass may be off by this part, one way or the other")
    cg_spread_m: NonNegative | None = Field(None, description="the CG may be off by so much; absent: 5 % of the size, or 20 % on a bearing")
    sensors: Sensors = Field(Sensors(), description="as in a scenario file")
    actuators: TrueActuators = Field(
        TrueActuators(), description="as in a scenario file; a vehicle without jets needs its full torque and force"
    )


@dataclass(frozen=True)
class Guess:
    """A guess, with other bodies within its spread."""

    file: GuessFile
    source: str
    """Path of the file that states it."""
    bodies: Array
    """(G, 10) quantities, SI: the guess, then the other bodies, the heaviest first, since it has the largest sigmas."""


def load(path: Path | None, vehicle: VehicleSource) -> Guess:
    """Read a guess file; without one, use [nominal] and [known] of the vehicle file. Raise :class:`InputError` if a value is missing."""
    if path is None:
        file, source = _of_vehicle(vehicle), vehicle.source
    else:
        text = configfile.read_text(path, "guess file")
        file, source = configfile.validate(GuessFile, configfile.parse_toml(text, str(path)), str(path), text), str(path)
    return Guess(file, source, _bodies(file, vehicle))


def _of_vehicle(vehicle: VehicleSource) -> GuessFile:
    """The guess from a vehicle file's nominal and known values; a known value takes precedence."""
    stated = vehicle.vehicle
    values = {name: stated.nominal.value(name) for name in QUANTITIES}
    values |= {name: known.value for name, known in stated.known.items()}
    if stated.environment.kind == "planar" and values["izz"] is not None:
        # ixx and iyy do not affect planar motion; use values that a real body can have
        values |= {name: values["izz"] / 2 * FLAT for name in ("ixx", "iyy") if values[name] is None}
    missing = [name for name in NEEDED if values[name] is None]
    if missing:
        needed = f"does not state {', '.join(missing)}; a plan needs a rough guess (20 % error is enough): state [nominal], or name a file "
        raise input_error(vehicle, [needed + "with --guess", *unstated(stated, Sensors(), TrueActuators())])
    body = {name: value for name, value in values.items() if value is not None}
    return configfile.validate(GuessFile, {"body": body}, f"{vehicle.source}: [nominal] and [known] as a guess")


def unstated(vehicle: Vehicle, sensors: Sensors, actuators: TrueActuators) -> list[str]:
    """Problems for a plan without a log: noise levels, delay and lag that neither file states, and an estimate would take from the log."""
    levels = {}
    for key, logged in (("gyro_noise_rad_s", sensors.gyro_axes), ("accel_noise_m_s2", sensors.accel_axes)):
        true_level = getattr(sensors, key)
        if logged:
            levels[f"imu.{key}"] = getattr(vehicle.imu, key) if true_level is None else true_level
    problems = []
    for unusable, description in ((None, "not stated"), (0.0, "0")):
        keys = [key for key, level in levels.items() if level == unusable]
        if keys:
            subject = f"{' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} {description}"
            problems.append(f"{subject}; a plan needs the noise: state one sigma of the mean over a cycle")
    if vehicle.cycle.command_delay_cycles == "auto" and actuators.delay_cycles is None:
        problems.append('cycle.command_delay_cycles is "auto"; state a number, or actuators.delay_cycles in a guess file')
    if vehicle.thrust.lag_s == "auto" and actuators.lag_s is None:
        problems.append('thrust.lag_s is "auto"; state a number, or actuators.lag_s in a guess file')
    return problems


def input_error(vehicle: VehicleSource, problems: Sequence[str]) -> InputError:
    """One error for all problems of a vehicle file."""
    return InputError(f"{vehicle.source}: {'. Also: '.join(problems)}")


def _bodies(file: GuessFile, vehicle: VehicleSource) -> Array:
    """(G, 10) the guess and random bodies within its spread, SI.

    A random symmetric matrix A deforms the body: its second moments J = tr(I)/2 − I become ``A J Aᵀ``. The result keeps the triangle
    inequality of principal moments.
    """
    body, rng = file.body.values, np.random.default_rng(1)
    drawn = []
    for draw in range(DRAWN):
        deformation = rng.uniform(-1, 1, (3, 3)) / 2
        # alternate between a larger and a smaller body, so that the bodies cover the spread
        scale = 1 + (file.spread / 2 if draw % 2 else -file.spread / 2)
        deformation = (deformation + deformation.T) / 2 * file.spread + np.eye(3) * scale
        second = np.trace(tensor(body[:6])) / 2 * np.eye(3) - tensor(body[:6])
        second = deformation @ second @ deformation.T
        inertia = np.trace(second) * np.eye(3) - second
        if np.linalg.eigvalsh(inertia)[0] <= 0:  # the guess breaks the triangle inequality
            inertia = tensor(body[:6]) * np.trace(deformation) / 3
        mass = body[9] * (1 + file.spread * rng.uniform(-1, 1))
        drawn.append(np.concatenate([elements(inertia), body[6:9] + rng.uniform(-1, 1, 3) * _cg_spread(file, vehicle), [mass]]))
    bodies = np.array([body, *sorted(drawn, key=lambda values: -values[9])])
    bearing = vehicle.vehicle.bearing_mass_kg
    bodies[:, 9] = np.maximum(bodies[:, 9], bearing + (body[9] - bearing) / 2)
    return bodies


def _cg_spread(file: GuessFile, vehicle: VehicleSource) -> float:
    """Largest deviation of a CG coordinate from the guess, m."""
    if file.cg_spread_m is not None:
        return file.cg_spread_m
    body = file.body.values
    if not vehicle.vehicle.pivoted:
        return float(CG_SPREAD * natural_sizes(body)[6])
    return float(SPREAD * np.linalg.norm(body[6:9] - vehicle.vehicle.environment.bearing_position_m))
