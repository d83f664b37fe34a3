"""Faults of benchmarks/faults.py and benchmarks/unforeseen.py on vehicles that nobody chose, as kinds of recordings."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from case_kind import Columns, Flown, Kind, Made
from fault_commands import clock, throttled
from fault_imu import Sensor, with_columns
from fault_imu import columns as increments
from fault_kinds import FAULTS
from fault_named import Drawn, Due, Fault
from fault_unforeseen import UNFORESEEN
from fault_vehicles import Body, Case, Subject

from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns as named
from massprop_cli.inputs import telemetry
from massprop_cli.inputs.tablefile import columns_of
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight

Draw = Callable[[Subject, np.random.Generator], Drawn | None]


class UnreachableError(Exception):
    """A fault that needs another flight, asked of a log that has a fault already."""


@dataclass(frozen=True)
class AnyVehicle(Subject):
    """A random vehicle's log, which may have a fault already."""

    found: Case
    untouched: bool
    """Whether it is as flown."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle file at hand."""
        return self.found.vehicle

    @property
    def clean(self) -> Case:
        """The log at hand."""
        return self.found

    def again(self, *keys: str) -> SimulatedFlight:
        """The same seed flown with other keys of the scenario."""
        if not self.untouched:
            raise UnreachableError
        data = json.loads(self.source.scenario.model_dump_json(by_alias=True, exclude_unset=True))
        changed = scenario.Scenario.model_validate(configfile.override(data, keys))
        return simulate.fly(scenario.ScenarioSource(changed, self.source.source), [self.seed])


def log_of(columns: Columns, vehicle: Vehicle) -> telemetry.Log:
    """The log as read from a Parquet file of these columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(columns)), sink)
    return telemetry.read(columns_of(Path("log.parquet"), sink.getvalue().to_pybytes()), vehicle)


def _made(columns: Columns, vehicle: Vehicle, rng: np.random.Generator, flown: Flown, draw: Draw) -> Made | None:
    untouched = vehicle is flown.vehicle and all(values is flown.columns[name] for name, values in columns.items())
    bodies = tuple(Body(0.0, float("inf"), values) for values in flown.truth)
    case = Case(log_of(columns, vehicle), vehicle, bodies)
    subject = AnyVehicle(flown.vehicle.name, int(flown.flight.seeds[0]), flown.source, flown.flight, case, untouched)
    try:
        drawn = draw(subject, rng)
    except UnreachableError:
        return None
    if drawn is None:
        return None
    # a size or a time is as near as the other fault lets it be
    dues = tuple(replace(due, words=tuple(word for word in due.words if isinstance(word, str))) for due in drawn.dues)
    truth = tuple(body.values for body in drawn.case.bodies)
    return Made(_columns(columns, case, drawn.case), drawn.case.vehicle, drawn.what, dues, truth)


def _columns(columns: Columns, before: Case, after: Case) -> Columns:
    """The columns of the log, with those that the fault changed."""
    log, rows = after.log, after.log.rows
    blocks: list[tuple[tuple[str, ...], Array]] = [(named.DELTA_THETA, log.delta_theta_imu_rad), (named.DELTA_V, log.delta_v_imu_m_s)]
    if log.attitude_wxyz is not None:
        blocks.append((named.QUATERNION, log.attitude_wxyz[:rows]))
    if log.command is not before.log.command:
        in_first = np.full((rows, log.command.shape[1]), np.nan)
        in_first[:: log.records_per_cycle] = log.command
        names = [named.jet(jet.name) for jet in after.vehicle.jets] or list(named.WRENCH)
        blocks.append((tuple(names), in_first))
    found = {name: values[:rows] for name, values in columns.items()}
    changed: Mapping[str, Array] = {name: column for names, block in blocks for name, column in zip(names, block.T, strict=True)}
    return found | {name: column for name, column in changed.items() if name in columns}


def _of_fault(fault: Fault) -> Kind:
    return Kind(fault.what, partial(_made, draw=fault.draw), knowing=True)


def _changed(what: str, maker: Callable[[Subject, np.random.Generator], Case | None], *codes: str) -> Kind:
    """A kind of recording by a case; any of these codes names it."""

    def draw(subject: Subject, rng: np.random.Generator) -> Drawn | None:
        case = maker(subject, rng)
        return None if case is None else Drawn(case, (Due(codes),), "")

    return Kind(what, partial(_made, draw=draw), codes, knowing=True)


def _falling(subject: Subject, rng: np.random.Generator) -> Case:
    """All thrust falls steadily by 15 to 30 %."""
    return throttled(subject, 1 - float(rng.uniform(0.15, 0.3)) * clock(subject))


def _sparse(subject: Subject, rng: np.random.Generator) -> Case:
    """Only the first of every few commands is logged and repeated."""
    command, every = subject.clean.log.command, int(rng.choice([2, 3, 5, 10]))
    return subject.clean.logging(command=command[np.arange(len(command)) // every * every])


def _later(subject: Subject, rng: np.random.Generator, sensor: Sensor) -> Case:
    """One sensor is late by 1 to 3 records; its first reading is repeated."""
    readings, by = increments(subject.clean, sensor), int(rng.integers(1, 4))
    return with_columns(subject.clean, sensor, np.concatenate([np.repeat(readings[:1], by, 0), readings[:-by]]))


UNKNOWN = ("model-discrepancy", "cause-unknown", "contradicted")
"""That is right of what has no name."""
ACTUATED: dict[str, Kind] = {
    "thrust-falls": _changed("thrust that falls by 15 to 30 % over the log", _falling, "fuel-use", *UNKNOWN),
    "one-late": _changed("one channel a cycle later than the others", UNFORESEEN["one-late"][1], "jet-late", *UNKNOWN),
    "leak": _changed("a jet that leaks 2 % of its thrust", UNFORESEEN["leak"][1], "steady-torque", *UNKNOWN),
    "commands-sparse": _changed("every second to tenth command is logged", _sparse, *UNKNOWN),
    "gyro-late": _changed("gyro 1 to 3 records later than the accelerometer", partial(_later, sensor="gyro"), "imu-kernel", *UNKNOWN),
    "accel-late": _changed("accelerometer 1 to 3 records later than the gyro", partial(_later, sensor="accel"), "imu-kernel", *UNKNOWN),
}
UNTOLD = ("all-scale",)
"""Of the faults, what no log can tell."""
KINDS = {f"fault-{name}": _of_fault(fault) for name, fault in FAULTS.items() if name not in UNTOLD}
