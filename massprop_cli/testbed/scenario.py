"""Scenario files: a vehicle, its true mass properties, true sensors and actuators, and a mission plan.

The models define the schema (``massprop schema scenario``). Unknown keys are errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.equipment import Failure
from massprop_cli.inputs.section import Positive
from massprop_cli.inputs.vehicle import Docking, Phase, Vehicle
from massprop_cli.testbed import exchange
from massprop_cli.testbed.conditions import Body, Control, Fuel, Initial, Sensors, TrueActuators, TrueDisturbance, rotor_problem
from massprop_cli.testbed.timeline import LONGEST, TURNS, WHOLE, Event, Segment, Timed

MOST_NUMBERS = 400_000_000
"""Maximum number of values in memory for one log."""
SHORTEST_RECORD_S = 1e-6
"""Minimum length of a record, s."""
SLOWEST_LAG = 1000.0
"""Maximum thrust lag, cycles."""


class Scenario(Timed):
    """A whole scenario file, checked."""

    schema_: Literal[1] = Field(alias="schema")
    name: str = Field("scenario", pattern=r"^[\w\-][\w.\-]*$")
    description: str = ""
    duration_cycles: Annotated[int, Field(gt=0, le=LONGEST)] | None = None
    duration_s: Positive | None = None
    seed: int = Field(1, ge=0, description="--seed overrides it")
    vehicle: Vehicle = Field(description="the vehicle file's content, or in a scenario file its path")
    truth: Body
    docked: Body | None = Field(None, description="the object that docks, its CG from O once docked")
    initial: Initial = Initial()
    sensors: Sensors = Sensors()
    actuators: TrueActuators = TrueActuators()
    disturbance: TrueDisturbance = TrueDisturbance()
    fuel: Fuel | None = None
    control: Control | None = None
    plan: tuple[Segment, ...] = ()
    events: tuple[Event, ...] = ()

    @field_validator("plan")
    @classmethod
    def _does_not_overlap(cls, plan: tuple[Segment, ...], info: ValidationInfo) -> tuple[Segment, ...]:
        if "vehicle" not in info.data:
            return plan
        period = info.data["vehicle"].cycle.period_s
        claims: dict[str, list[tuple[int, int, int]]] = {}
        for number, segment in enumerate(plan, 1):
            try:
                start, end = segment.cycles(period)
            except ValueError as error:
                raise ValueError(f"segment {number} {error}") from None
            for axis in segment.driven:
                for other_start, other_end, other in claims.setdefault(axis, []):
                    if start < other_end and other_start < end:
                        raise ValueError(
                            f"segments {other} (cycles {other_start} to {other_end}) and {number} ({start} to {end}) overlap on {axis}"
                        )
                claims[axis].append((start, end, number))
        return plan

    @model_validator(mode="after")
    def _is_coherent(self) -> Self:
        jets = [jet.name for jet in self.vehicle.jets]
        named = [("failures", failure.jet) for failure in self.actuators.failures or ()]
        for key, jet in [*named, *(("jet_delays_s", jet) for jet in self.actuators.jet_delays_s)]:
            if jet not in jets:
                raise ValueError(f"actuators.{key} names unknown jet {jet!r}{configfile.nearest(jet, jets, 'the nearest is')}")
        self._check_sizes()
        self._check_times()
        self._check_phases()
        self._check_plan()
        bearing = self.vehicle.bearing_mass_kg
        if self.truth.mass <= bearing:
            raise ValueError(f"truth.mass = {self.truth.mass:g} kg includes the bearing's {bearing:g} kg: it must be larger")
        return self

    def _check_sizes(self) -> None:
        period, records = self.vehicle.cycle.period_s, self.sensors.records_per_cycle
        if (self.duration_cycles is None) == (self.duration_s is None):
            raise ValueError("give either duration_cycles or duration_s")
        if period / records < SHORTEST_RECORD_S:
            raise ValueError(f"a record of {period / records:.3g} s is too short to simulate; is cycle.period_s in seconds?")
        if (
            self.cycles * (10 * records + 4 * (max(len(self.vehicle.jets), len(self.vehicle.rotors), 6) + len(self.vehicle.spinning)))
            > MOST_NUMBERS
        ):
            raise ValueError(f"{self.cycles} cycles of {records} records are too long for one log; shorten it")
        for name, lag in (("thrust.lag_s", self.vehicle.thrust.lag_s), ("actuators.lag_s", self.actuators.lag_s)):
            if isinstance(lag, float) and lag > SLOWEST_LAG * period:
                raise ValueError(f"{name} = {lag:g} s is more than {SLOWEST_LAG:g} cycles; is it in seconds?")
        for failure in self.failures:
            begun, ended = failure.start_s or 0.0, np.inf if failure.end_s is None else failure.end_s
            if begun >= self.cycles * period or ended <= 0:
                raise ValueError(
                    f"the failure of jet {failure.jet!r} from {begun:g} to {ended:g} s never happens; correct start_s or end_s"
                )
        if self.vehicle.jets and (self.actuators.max_torque_n_m or self.actuators.max_force_n):
            raise ValueError("actuators.max_torque_n_m and max_force_n are for vehicles without jets; drop them")
        if self.actuators.supply_pa is not None and self.vehicle.thrust.nominal_pa is None:
            raise ValueError("actuators.supply_pa needs vehicle.thrust.nominal_pa, the pressure that the jets' force_n holds for; state it")
        if self.actuators.supply_v is not None and not any(rotor.nominal_v for rotor in self.vehicle.rotors):
            raise ValueError("actuators.supply_v needs nominal_v of [[vehicle.rotors]], the voltage that thrust_n holds for; state it")
        if not self.vehicle.jets and (self.actuators.pwm_tick_s or self.actuators.minimum_pulse_s):
            raise ValueError("actuators.pwm_tick_s and minimum_pulse_s need jets; drop them")

    def _check_phases(self) -> None:
        period = self.vehicle.cycle.period_s
        if self.vehicle.phases and any(event.phase for event in self.events):
            raise ValueError("the vehicle states its own phases: drop phase from [[events]], or [[vehicle.phases]]")
        configfile.check_once((phase.name for phase in self.phases), "phase", "give each event another phase")
        for phase in self.phases:
            whole = min(self.cycles, phase.end_s / period) - max(self.delay_cycles, phase.start_s / period)
            if whole < 2 - WHOLE:
                raise ValueError(
                    f"phase {phase.name!r} ({phase.start_s:g} to {phase.end_s:g} s) holds fewer than two cycles whose commands are known; "
                    f"the log runs from 0 to {self.cycles * period:g} s, commands come {self.delay_cycles:g} cycles late"
                )

    def _check_times(self) -> None:
        period, tick = self.vehicle.cycle.period_s, self.tick_s
        if tick is not None and tick > period * (1 + 1e-9):
            raise ValueError(f"pwm_tick_s = {tick:g} s is longer than the control cycle of {period:g} s")
        for jet in self.vehicle.jets:
            if max(jet.rise_s, jet.fall_s) > period:
                raise ValueError(f"jet {jet.name!r}: a rise or fall longer than the control cycle of {period:g} s cannot be simulated")
        if self.vehicle.imu.clock_drift_ppm != 0:
            raise ValueError("imu.clock_drift_ppm: one clock only can be simulated; leave it out")
        for name in ("gyro_filter", "accel_filter"):
            low_pass = getattr(self.vehicle.imu, name)
            if low_pass is not None and (low_pass.open or low_pass.order == 0 or low_pass.latency_s != 0):
                raise ValueError(f"imu.{name}: give the true cutoff_hz, and no latency_s, which cannot be simulated")
        if self.vehicle.cycle.command_delay_cycles == "auto" and self.actuators.delay_cycles is None:
            raise ValueError('cycle.command_delay_cycles is "auto": give the true delay as actuators.delay_cycles')
        if self.vehicle.thrust.lag_s == "auto" and self.actuators.lag_s is None:
            raise ValueError('thrust.lag_s is "auto": give the true lag as actuators.lag_s')
        for event in self.events:
            if event.at(period) >= self.cycles:
                raise ValueError(f"event {event.kind!r} at cycle {event.at(period)} comes after the end at cycle {self.cycles}")
        for segment in self.plan:
            if segment.cycles(period)[0] >= self.cycles:
                raise ValueError(f"a segment starts at cycle {segment.cycles(period)[0]}, after the end at cycle {self.cycles}")
        docks = sum(event.kind == "dock" for event in self.events)
        if docks > 1 or (docks == 1) != (self.docked is not None):
            raise ValueError('an object docks once: [docked] and one event of kind "dock" go together')
        if len({event.at(period) for event in self.events}) < len(self.events):
            raise ValueError("two events in one cycle; a dock may name the phase that begins with it")

    def _check_plan(self) -> None:
        if self.fuel is not None and not self.vehicle.jets:
            raise ValueError("[fuel] needs jets that burn it")
        kind = self.vehicle.environment.kind
        if kind != "free" and any(e.kind == "dock" and e.motion == "momentum_conserved" for e in self.events):
            where = {"air_bearing": "an air bearing", "pedestal": "a pedestal"}.get(kind, "a table")
            raise ValueError(f'docking on {where} is simulated with motion = "rates_kept" only')
        if kind == "planar" and any(self.initial.rate_rad_s[:2]):
            raise ValueError("initial.rate_rad_s: a vehicle on a table turns about Z alone; make the others 0")
        if self.control is None and any(s.motion == "hold" or s.closed_loop for s in self.plan):
            raise ValueError("the plan holds the attitude: add [control] with rate_gain_n_m_s and attitude_gain_n_m")
        self._check_model()
        self._check_devices()
        if not self.vehicle.jets and not self.vehicle.rotors:
            needs = {axis for s in self.plan if s.motion != "coast" and not self.turned_by_wheels(s) for axis in s.driven}
            torque, force = self.actuators.max_torque_n_m, self.actuators.max_force_n
            if (torque is None and needs & set(TURNS)) or (force is None and needs - set(TURNS)):
                raise ValueError("the vehicle has no jets: give actuators.max_torque_n_m and max_force_n for the axes that the plan drives")

    def _check_model(self) -> None:
        if self.modelled is None:
            return
        if self.vehicle.environment.kind != "free":
            raise ValueError(
                "control.model is for free flight, where the vehicle turns about its CG; state rate_gain_n_m_s and attitude_gain_n_m"
            )
        missing = [f"vehicle.nominal.{name}" for name in ("ixx", "iyy", "izz") if self.vehicle.nominal.value(name) is None]
        if missing and self.modelled != "truth":
            raise ValueError(f'control.model = "{self.modelled}" begins with the nominal body: give {", ".join(missing)}')

    def _check_devices(self) -> None:
        turned_by = any(self.turned_by_wheels(s) for s in self.plan)
        problem = exchange.problem(self.vehicle, self.actuators, self.truth.inertia, turned_by)
        lag_s = self.vehicle.thrust.lag_s if self.actuators.lag_s is None else self.actuators.lag_s
        problem = problem or rotor_problem(self.vehicle, self.actuators, lag_s == 0)
        if problem:
            raise ValueError(problem)
        if turned_by and not exchange.channels(self.vehicle):
            raise ValueError("the plan turns by wheels (by_wheels), and the vehicle has nothing that stores momentum")

    def turned_by_wheels(self, segment: Segment) -> bool:
        """Whether momentum devices drive a segment: it states by_wheels, or nothing else can turn the vehicle."""
        alone = turned_by_wheels_alone(self.vehicle, self.actuators)
        return segment.motion != "coast" and (segment.by_wheels or (alone and set(segment.driven) <= set(TURNS)))

    @property
    def cycles(self) -> int:
        """Length in control cycles."""
        return self._cycles(self.duration_cycles, self.duration_s, self.vehicle.cycle.period_s, "the end")

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Phases of the vehicle file, or those that events define.

        An event ends a phase. A reset starts one; a dock starts one if it names it or no reset follows. Without events: one phase, "all".
        """
        if self.vehicle.phases:
            return self.vehicle.phases
        period = self.vehicle.cycle.period_s
        events = sorted(self.events, key=lambda event: event.at(period))
        docks = any(event.kind == "dock" for event in events)
        found: list[Phase] = []
        name: str | None = ("single" if docks else "phase-1") if events else "all"
        start, docked = 0.0, False
        for i, event in enumerate(events):
            at = round(event.at(period) * period, 9)
            if name is not None:
                found.append(Phase(name=name, start_s=start, end_s=at))
            docked |= event.kind == "dock"
            taken = {phase.name for phase in found}
            fallback = "combined" if docked and "combined" not in taken else f"phase-{len(found) + 1}"
            begins = event.kind == "reset" or event.phase or not any(later.kind == "reset" for later in events[i + 1 :])
            name, start = (event.phase or fallback) if begins else None, at
        if name is not None:
            found.append(Phase(name=name, start_s=start, end_s=round(self.cycles * period, 9)))
        return tuple(found)

    @property
    def logged(self) -> Vehicle:
        """Vehicle file of the log, with the phases that events define and the phases before and after a docking."""
        if not self.events:
            return self.vehicle
        return self.vehicle.model_copy(update={"phases": self.phases, "docking": self.vehicle.docking or self._docking()})

    def _docking(self) -> Docking | None:
        """Last phase that ends by the docking and first phase that starts with or after it; None without both."""
        period = self.vehicle.cycle.period_s
        docks = [event.at(period) * period for event in self.events if event.kind == "dock"]
        before = [phase for phase in self.phases for at in docks if phase.end_s <= at + period / 2]
        after = [phase for phase in self.phases for at in docks if phase.start_s >= at - period / 2]
        if not before or not after:
            return None
        return Docking(before=max(before, key=lambda phase: phase.end_s).name, after=min(after, key=lambda phase: phase.start_s).name)

    @property
    def modelled(self) -> Literal["nominal", "estimate", "truth"] | None:
        """Source of the body from which the control computes its gains; None with stated gains."""
        return None if self.control is None else self.control.model

    @property
    def room_torque(self) -> Array:
        """(3,) true torque fixed in the room, world axes, N m."""
        real = self.disturbance.room_n_m
        return np.array(self.vehicle.environment.room_torque_n_m if real is None else real)

    @property
    def tick_s(self) -> float | None:
        """Resolution of on-times, s; None without rounding."""
        return self.actuators.pwm_tick_s or self.vehicle.cycle.pwm_tick_s

    @property
    def delay_cycles(self) -> float:
        """True delay from the start of the cycle that issues a command to the start of its execution, cycles."""
        stated = self.vehicle.cycle.command_delay_cycles
        return self.actuators.delay_cycles if self.actuators.delay_cycles is not None else float(stated)

    @property
    def failures(self) -> tuple[Failure, ...]:
        """True failures of jets."""
        return self.vehicle.thrust.failures if self.actuators.failures is None else self.actuators.failures

    def supply_pa(self, time_s: Array) -> Array | None:
        """Supply pressure of the jets, Pa; None if the vehicle file states no nominal pressure."""
        nominal_pa = self.vehicle.thrust.nominal_pa
        if nominal_pa is None:
            return None
        ends = self.actuators.supply_pa or (nominal_pa, nominal_pa)
        return self._falling(time_s, ends)

    def supply_v(self, time_s: Array) -> Array:
        """Supply voltage of the rotors, V."""
        nominal_v = next((rotor.nominal_v for rotor in self.vehicle.rotors if rotor.nominal_v), 1.0)
        return self._falling(time_s, self.actuators.supply_v or (nominal_v, nominal_v))

    def _falling(self, time_s: Array, ends: tuple[float, float]) -> Array:
        return np.interp(time_s, [0.0, self.cycles * self.vehicle.cycle.period_s], ends)


def turned_by_wheels_alone(vehicle: Vehicle, real: TrueActuators) -> bool:
    """Whether only momentum devices can turn the vehicle."""
    return bool(vehicle.spinning) and not vehicle.jets and not vehicle.rotors and real.max_torque_n_m is None


@dataclass(frozen=True)
class ScenarioSource:
    """A scenario and its origin."""

    scenario: Scenario
    source: str
    """File or packaged name, for messages."""


def packaged() -> list[str]:
    """Names of the packaged scenarios."""
    folder = resources.files("massprop_cli.testbed") / "scenarios"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load(name: str, assignments: Sequence[str] = ()) -> ScenarioSource:
    """Read a scenario file, or a packaged scenario by its name. Raises :class:`InputError` with file, line and key."""
    path = Path(name)
    if path.suffix == ".toml" or _is_file(path):
        return parse(configfile.read_text(path, "scenario file"), str(path), assignments, path.parent)
    if name not in packaged():
        hint = configfile.nearest(name, packaged(), "the nearest packaged scenario is")
        raise InputError(f"{name}: neither a scenario file nor a packaged scenario{hint}; massprop simulate --list names them")
    text = (resources.files("massprop_cli.testbed") / "scenarios" / f"{name}.toml").read_text("utf-8")
    return parse(text, f"scenario {name}", assignments)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def parse(text: str, source: str, assignments: Sequence[str] = (), folder: Path | None = None) -> ScenarioSource:
    """Validate the text of a scenario with ``KEY=VALUE`` assignments; ``vehicle`` may be a path of a vehicle file from ``folder``."""
    named = [assignment for assignment in assignments if assignment.partition("=")[0].strip() == "vehicle"]
    data = configfile.override(configfile.parse_toml(text, source), named)
    if isinstance(data.get("vehicle"), str):
        path = (folder or Path()) / data["vehicle"]
        vehicle_text = configfile.read_text(path, "vehicle file")
        vehiclefile.parse(vehicle_text, str(path))
        data["vehicle"] = configfile.parse_toml(vehicle_text, str(path))
    data = configfile.override(data, [assignment for assignment in assignments if assignment not in named])
    return ScenarioSource(configfile.validate(Scenario, data, source, text, assignments), source)
