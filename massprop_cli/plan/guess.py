"""What a vehicle is guessed to be before its test: ten quantities, how far off they may be, and what its actuators and sensors do."""

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
CG_SPREAD = 0.05
"""Of a free vehicle's CG, as part of sqrt(trace/mass); on a bearing it was balanced, and is off by :data:`SPREAD` of what it is."""
DRAWN = 4
"""Bodies beside the one that is guessed: enough that no plan suits it alone (tests/plan/test_plan.py)."""
FLAT = 1.01
"""By how much a flat body's moments of inertia are above what they are at least."""
NEEDED = ("ixx", "iyy", "izz", "mass")


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
    """A guess, and what else the vehicle may be."""

    file: GuessFile
    source: str
    bodies: Array
    """(G, 10) the guess itself, then others within its spread, the heaviest first: it is the hardest to tell."""


def load(path: Path | None, vehicle: VehicleSource) -> Guess:
    """From a guess file; else from what the vehicle file has under [nominal] and [known]. :class:`InputError` where neither tells."""
    if path is None:
        file, source = _of_vehicle(vehicle), vehicle.source
    else:
        text = configfile.read_text(path, "guess file")
        file, source = configfile.validate(GuessFile, configfile.parse_toml(text, str(path)), str(path), text), str(path)
    return Guess(file, source, _spread(file, vehicle))


def _of_vehicle(vehicle: VehicleSource) -> GuessFile:
    stated = vehicle.vehicle
    values = {name: stated.nominal.value(name) for name in QUANTITIES}
    values |= {name: known.value for name, known in stated.known.items()}
    if stated.environment.kind == "planar" and values["izz"] is not None:
        # they have no part in the motion; any that a body has will do
        values |= {name: values["izz"] / 2 * FLAT for name in ("ixx", "iyy") if values[name] is None}
    missing = [name for name in NEEDED if values[name] is None]
    if missing:
        said = f"does not state {', '.join(missing)}; a plan needs a rough guess (20 % error is enough): state [nominal], or name a file "
        raise refused(vehicle, [said + "with --guess", *unstated(stated, Sensors(), TrueActuators())])
    body = {name: value for name, value in values.items() if value is not None}
    return configfile.validate(GuessFile, {"body": body}, f"{vehicle.source}: [nominal] and [known] as a guess")


def unstated(vehicle: Vehicle, sensors: Sensors, actuators: TrueActuators) -> list[str]:
    """What neither the vehicle file nor the guess states, and an estimate would find in the log that a plan does not have yet."""
    levels = {}
    for key, logged in (("gyro_noise_rad_s", sensors.gyro_axes), ("accel_noise_m_s2", sensors.accel_axes)):
        own = getattr(sensors, key)
        if logged:
            levels[f"imu.{key}"] = getattr(vehicle.imu, key) if own is None else own
    found = []
    for level, said in ((None, "not stated"), (0.0, "0")):
        keys = [key for key, its in levels.items() if its == level]
        if keys:
            are = f"{' and '.join(keys)} {'is' if len(keys) == 1 else 'are'} {said}"
            found.append(f"{are}; a plan needs the noise: state one sigma of the mean over a cycle")
    if vehicle.cycle.command_delay_cycles == "auto" and actuators.delay_cycles is None:
        found.append('cycle.command_delay_cycles is "auto"; state a number, or actuators.delay_cycles in a guess file')
    if vehicle.thrust.lag_s == "auto" and actuators.lag_s is None:
        found.append('thrust.lag_s is "auto"; state a number, or actuators.lag_s in a guess file')
    return found


def refused(vehicle: VehicleSource, problems: Sequence[str]) -> InputError:
    """All of them in one line."""
    return InputError(f"{vehicle.source}: {'. Also: '.join(problems)}")


def _spread(file: GuessFile, vehicle: VehicleSource) -> Array:
    """Bodies stretched along axes of their own: ``J' = A J Aᵀ`` for the second moments J = tr(I)/2 − I, which keeps a body a body."""
    body, rng = file.body.values, np.random.default_rng(1)
    found = [body]
    for draw in range(DRAWN):
        stretch = rng.uniform(-1, 1, (3, 3)) / 2
        # two of the four at the ends of what is stated, as the middle says little of what may happen
        stretch = (stretch + stretch.T) / 2 * file.spread + np.eye(3) * (1 + (file.spread / 2 if draw % 2 else -file.spread / 2))
        second = np.trace(tensor(body[:6])) / 2 * np.eye(3) - tensor(body[:6])
        second = stretch @ second @ stretch.T
        inertia = np.trace(second) * np.eye(3) - second
        if np.linalg.eigvalsh(inertia)[0] <= 0:  # of a guess that no body has
            inertia = tensor(body[:6]) * np.trace(stretch) / 3
        mass = body[9] * (1 + file.spread * rng.uniform(-1, 1))
        found.append(np.concatenate([elements(inertia), body[6:9] + rng.uniform(-1, 1, 3) * _cg_spread(file, vehicle), [mass]]))
    bodies = np.array([body, *sorted(found[1:], key=lambda values: -values[9])])
    bearing = vehicle.vehicle.bearing_mass_kg
    bodies[:, 9] = np.maximum(bodies[:, 9], bearing + (body[9] - bearing) / 2)
    return bodies


def _cg_spread(file: GuessFile, vehicle: VehicleSource) -> float:
    if file.cg_spread_m is not None:
        return file.cg_spread_m
    body = file.body.values
    if not vehicle.vehicle.pivoted:
        return float(CG_SPREAD * natural_sizes(body)[6])
    return float(SPREAD * np.linalg.norm(body[6:9] - vehicle.vehicle.environment.bearing_position_m))
