"""The vehicles that faults are flown on, and one flight of one of them."""

import zlib
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Self

import numpy as np

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed import mission, scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight

OWN = Path(__file__).parent / "vehicles"
SELDOM = 5
"""A jet counts as fired if it is on for so many cycles at least."""


def _segment(motion: str, axes: str, start: int, end: int, more: str = "") -> str:
    named = "" if not axes else "axes = [" + ", ".join(f'"{axis}"' for axis in axes.split()) + "], "
    pulses = "every_cycles = 5, max_cycles = 4, " if motion == "random" else ""
    return f'{{motion = "{motion}", {named}{pulses}{more}start_cycle = {start}, end_cycle = {end}}}'


def _plan(*segments: str) -> str:
    return "plan = [" + ", ".join(segments) + "]"


EACH_THEN_ALL = _plan(
    *(_segment("random", axis, 60 * i, 60 * i + 60) for i, axis in enumerate(("roll", "pitch", "yaw"))),
    _segment("hold", "", 180, 370),
    *(_segment("random", axis, 220 + 50 * i, 270 + 50 * i) for i, axis in enumerate("xyz")),
    _segment("random", "roll pitch yaw", 370, 500, "closed_loop = true, "),
    _segment("random", "x y z", 370, 500),
)
"""Turn about each axis alone, rest, push along each, then all at once; 500 cycles."""
DOCKING = (
    "duration_cycles = 700",
    _plan(
        *(_segment("random", axis, 40 * i, 40 * i + 40) for i, axis in enumerate(("roll", "pitch", "yaw", "y"))),
        _segment("hold", "", 160, 240),
        *(_segment("random", axis, 240 + 80 * i, 320 + 80 * i) for i, axis in enumerate(("roll", "pitch", "yaw"))),
        _segment("random", "y", 480, 700),
    ),
    'events = [{kind = "dock", cycle = 180, motion = "rates_kept"}, {kind = "reset", cycle = 240, phase = "combined"}]',
)
SHORT = ("duration_s = 25.0", EACH_THEN_ALL)


@dataclass(frozen=True)
class Kind:
    """A vehicle of the fault benchmark."""

    scenario: str
    keys: tuple[str, ...] = ()
    noisy: bool = False
    """Where less is asked of naming."""
    said: frozenset[str] = frozenset()
    """Codes that are true of it without any fault."""


VEHICLES = {
    "jets": Kind("free-flyer", SHORT),
    "wrench": Kind(str(OWN / "wrench.toml"), (EACH_THEN_ALL,)),
    "bearing": Kind("testbed", ("vehicle.imu.body_from_imu = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]",)),
    "docking": Kind("docking", DOCKING),
    "noisy": Kind("free-flyer", (*SHORT, "vehicle.imu.gyro_noise_rad_s = 1e-3", "vehicle.imu.accel_noise_m_s2 = 0.2"), noisy=True),
    "disturbed": Kind("free-flyer", (*SHORT, "disturbance.walk_n_m = 3e-4"), noisy=True, said=frozenset({"disturbance-torque"})),
    "canted": Kind(str(OWN / "canted.toml"), (EACH_THEN_ALL,)),
    "planar": Kind("planar"),
    "pedestal": Kind("pedestal"),
    "heavy": Kind(str(OWN / "heavy.toml"), (EACH_THEN_ALL,)),
}
"""The disturbed one's slow torque isn't stated: it comes to 0.007 N m, jets give 0.33 to 0.57."""


@dataclass(frozen=True)
class Body:
    """The true body from one time to another."""

    start_s: float
    end_s: float
    values: Array
    """(10,)"""


INCREMENTS = {"gyro": "delta_theta_imu_rad", "accel": "delta_v_imu_m_s"}
"""What a log calls the increments of each sensor."""


@dataclass(frozen=True)
class Case:
    """A log, its vehicle file, and the truth."""

    log: Log
    vehicle: Vehicle
    bodies: tuple[Body, ...]

    def stating(self, *assignments: str) -> Self:
        """The case with other keys in the vehicle file."""
        return replace(self, vehicle=vehiclefile.changed(self.vehicle, assignments))

    def logging(self, **columns: Array) -> Self:
        """The case with other columns in the log."""
        return replace(self, log=replace(self.log, **{name: frozen(values) for name, values in columns.items()}))  # type: ignore[arg-type]

    def cut(self, cycles: int) -> Self:
        """The first cycles of the case."""
        rows = cycles * self.log.records_per_cycle
        begun = {name: getattr(self.log, name)[:rows] for name in ("time_s", "interval_s", *INCREMENTS.values())}
        return replace(self, log=replace(self.log, rows=rows, command=self.log.command[:cycles], **begun))


@dataclass(frozen=True)
class Subject:
    """The flight of one vehicle and seed without fault."""

    name: str
    seed: int
    source: ScenarioSource
    flight: SimulatedFlight

    @property
    def kind(self) -> Kind:
        """The kind of the vehicle."""
        return VEHICLES[self.name]

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle file."""
        return self.flight.vehicle

    @property
    def period_s(self) -> float:
        """Period of the control cycle, s."""
        return self.vehicle.cycle.period_s

    @property
    def cycles(self) -> int:
        """Number of cycles of the log."""
        return self.source.scenario.cycles

    @cached_property
    def fired(self) -> list[str]:
        """Names of the jets that fire."""
        used = (self.flight.issued[0] > 0).sum(0) >= SELDOM
        return [jet.name for jet, hit in zip(self.vehicle.jets, used, strict=False) if hit]

    @cached_property
    def driven(self) -> list[int]:
        """Components of the commanded wrench that are used."""
        return [] if self.vehicle.jets else [int(i) for i in np.flatnonzero((self.flight.issued[0][:, :6] != 0).sum(0) >= SELDOM)]

    @cached_property
    def full_torque(self) -> Array:
        """(3,) the largest torque about each axis, N m."""
        full: Array = mission.allocation(self.source).full[:3].min(1)
        return full

    @cached_property
    def clean(self) -> Case:
        """The case without fault."""
        return case(self.flight)

    def drawing(self, kind: str) -> np.random.Generator:
        """The random generator of a kind of fault, the same in every script."""
        return np.random.default_rng([self.seed, zlib.crc32(f"{kind} {self.name}".encode())])

    def again(self, *keys: str) -> SimulatedFlight:
        """The same seed flown with other keys of the scenario."""
        return _fly(self.name, self.seed, keys)

    def flown(self, *keys: str) -> Case:
        """The same; its vehicle file and the truth stay those of the clean flight, where the truth is what is looked for."""
        return replace(case(self.again(*keys)), vehicle=self.vehicle)


def _source(name: str, keys: tuple[str, ...] = ()) -> ScenarioSource:
    return scenario.load(VEHICLES[name].scenario, [*VEHICLES[name].keys, *keys])


def _fly(name: str, seed: int, keys: tuple[str, ...] = ()) -> SimulatedFlight:
    return simulate.fly(_source(name, keys), [seed])


@lru_cache(maxsize=2)
def subject(name: str, seed: int) -> Subject:
    """The flight of a vehicle and seed without fault."""
    return Subject(name, seed, _source(name), _fly(name, seed))


def case(flight: SimulatedFlight) -> Case:
    """The case of a flight; the truth of a phase holds until the next phase begins."""
    ends = [phase.start_s for phase in flight.phases[1:]] + [float("inf")]
    return Case(
        flight.log(0),
        flight.vehicle,
        tuple(Body(p.start_s, end, values) for p, end, values in zip(flight.phases, ends, flight.truth[0], strict=True)),
    )
