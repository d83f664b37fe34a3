"""Files of a simulated flight: log.parquet or log.csv, vehicle.toml, truth.json."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from massprop_cli import ABOUT_PIVOT, QUANTITIES
from massprop_cli.base import arrow, configfile, escape, files, foldername
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import elements, parallel_axis
from massprop_cli.inputs import columns
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.testbed import mission
from massprop_cli.testbed.onboard import RunningOf
from massprop_cli.testbed.scenario import Scenario, ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight, fly
from massprop_cli.testbed.timeline import AXES

Kind = Literal["parquet", "csv"]
MEMORY = 4_000_000
"""Approximate number of logged numbers per batch of a campaign; limits memory."""


def simulate(
    source: ScenarioSource,
    folder: Path,
    first_seed: int,
    seeds: int | None,
    kind: Kind = "parquet",
    progress: Callable[[str, float], None] | None = None,
    running: RunningOf | None = None,
) -> str:
    """Simulate one seed into ``folder``, or ``seeds`` seeds into its subfolders seed-N; return a description of the files written.

    ``running`` as in :func:`massprop_cli.testbed.simulate.fly`. Raises :class:`InputError` if the folder holds other files.
    """
    with files.writing(folder):
        if seeds is None:
            files.check_own(folder, (f"log.{kind}", "vehicle.toml"), "truth.json")
            flight = fly(source, [first_seed], progress=partial(_tell, progress, 0.0, 1.0), running=running)
            write(flight, 0, source.scenario, folder, kind)
            return f"log.{kind}, vehicle.toml and truth.json"
        return _campaign(source, folder, range(first_seed, first_seed + seeds), kind, progress, running)


def _campaign(
    source: ScenarioSource, folder: Path, seeds: range, kind: Kind, progress: Callable[[str, float], None] | None, running: RunningOf | None
) -> str:
    """Write all seeds or none: into a temporary folder, then move them into place after the last."""
    names = [f"seed-{seed:0{max(4, len(str(seeds[-1])))}d}" for seed in seeds]
    strangers = sorted({path.name for path in folder.iterdir()} - set(names)) if folder.is_dir() else []
    if strangers:
        raise InputError(
            f"{folder}: already holds {strangers[0]!r}, which is no part of this campaign; choose another folder", option="out"
        )
    batch = max(1, min(200, MEMORY // (source.scenario.cycles * (6 * source.scenario.sensors.records_per_cycle + 20))))
    with _aside(folder) as aside:
        for start in range(0, len(seeds), batch):
            chosen = seeds[start : start + batch]
            share = len(chosen) / len(seeds)
            before = start / len(seeds)
            flight = fly(source, chosen, progress=partial(_tell, progress, before, share), running=running)
            for member in range(len(chosen)):
                write(flight, member, source.scenario, aside / names[start + member], kind)
        _move(aside, folder, names)
    return f"{len(names)} folders, {names[0]} to {names[-1]},"


@contextmanager
def _aside(folder: Path) -> Iterator[Path]:
    """Temporary folder next to ``folder``, locked; its name is fixed, so that the next run deletes the remains of a killed one."""
    mark = f".massprop-{foldername.digest(folder.name)}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    with files.lock(folder.parent / f"{mark}.lock", folder, 0.0):
        aside = folder.parent / f"{mark}.partial"
        shutil.rmtree(aside, ignore_errors=True)
        try:
            aside.mkdir()
            yield aside
        finally:
            shutil.rmtree(aside, ignore_errors=True)


def _move(aside: Path, folder: Path, names: Sequence[str]) -> None:
    """Move the seeds into place, each atomically; all together if ``folder`` is new."""
    if not folder.exists():
        aside.replace(folder)
        return
    for name in names:
        if (folder / name).exists():
            (folder / name).replace(aside / f"old-{name}")
        (aside / name).replace(folder / name)


def _tell(progress: Callable[[str, float], None] | None, before: float, share: float, done: float) -> None:
    if progress is not None:
        progress("simulating", before + share * done)


def warnings(source: ScenarioSource) -> list[Notice]:
    """Warnings about a scenario that can be simulated but is probably not intended."""
    scenario = source.scenario
    at = source.source
    notices = [
        Notice("unphysical-inertia", f"{at}: [{name}] breaks the triangle inequality of principal moments, which no real body does")
        for name, body in (("truth", scenario.truth), ("docked", scenario.docked))
        if body is not None and body.breaks_triangle
    ]
    period_s = scenario.vehicle.cycle.period_s
    docks = [event.at(period_s) * period_s for event in scenario.events if event.kind == "dock"]
    notices += [
        Notice("phase-over-docking", f"{at}: phase {phase.name!r} includes the docking at {dock_s:g} s; its truth is that of its end")
        for phase in scenario.phases
        for dock_s in docks
        if phase.start_s < dock_s < phase.end_s
    ]
    allocated = mission.allocation(source)
    for number, segment in enumerate(scenario.plan, 1):
        demand = segment.torque_n_m or segment.force_n or 0.0
        by_wheels = scenario.turned_by_wheels(segment)
        available = min((min(allocated.largest(AXES.index(axis), by_wheels)) for axis in segment.driven), default=demand)
        if demand > available * (1 + 1e-9):
            unit = "N m" if segment.torque_n_m else "N"
            message = f"{source.source}, plan segment {number}: asks for {demand:g} {unit}, the vehicle gives {available:.4g} at most"
            notices.append(Notice("plan-saturates", message))
    return notices


def write(flight: SimulatedFlight, member: int, scenario: Scenario, folder: Path, kind: Kind = "parquet") -> None:
    """Write the files of one member, truth.json last. Raises :class:`InputError` if the folder has a log of the other kind."""
    other = folder / f"log.{'csv' if kind == 'parquet' else 'parquet'}"
    if other.exists():
        raise InputError(f"{other}: another log is in the way; move it, or choose another folder", option="out")
    with files.staged(folder) as stage:
        _save(stage, flight, member, scenario, kind)
        stage.place()


def _save(stage: files.Staged, flight: SimulatedFlight, member: int, scenario: Scenario, kind: Kind) -> None:
    import pyarrow.csv
    import pyarrow.parquet as pq

    vehicle = vehicle_toml(flight.vehicle)
    table = log_table(flight, member, scenario)
    if kind == "parquet":
        table = table.replace_schema_metadata({"massprop.vehicle": vehicle})
        stage.save("log.parquet", lambda path: pq.write_table(table, path, compression="zstd"))
    else:
        stage.save("log.csv", lambda path: pyarrow.csv.write_csv(table, path, pyarrow.csv.WriteOptions(quoting_style="needed")))
    stage.save("vehicle.toml", vehicle)
    truth = escape.json(json.dumps(truth_of(flight, member, scenario), indent=1, allow_nan=False, ensure_ascii=False))
    stage.save("truth.json", truth + "\n")


def vehicle_toml(vehicle: Vehicle) -> str:
    """Text of the vehicle file: keys that the scenario sets, without [columns], because the log has the standard column names."""
    return configfile.toml(vehicle.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True, exclude={"columns"}))


def log_table(flight: SimulatedFlight, member: int, scenario: Scenario) -> Any:
    """Log as an Arrow table, with commands in the first record of their cycle."""
    import pyarrow as pa

    records, rates = scenario.sensors.records_per_cycle, scenario.vehicle.imu.measures != "increment"
    interval_s = scenario.vehicle.cycle.period_s / records if rates else 1.0
    commanded = flight.commanded(member)
    in_first_record = np.full((len(commanded) * records, commanded.shape[1]), np.nan)
    in_first_record[::records] = np.round(commanded, 12)  # removes rounding errors of multiples of a tick
    names = [columns.jet(jet.name) for jet in scenario.vehicle.jets] or list(columns.WRENCH)[: commanded.shape[1]]
    blocks = [
        ([columns.TIME], flight.time_s[:, None]),
        _logged((columns.DELTA_THETA, columns.GYRO)[rates], flight.delta_theta_rad[member] / interval_s, flight.axes[:3]),
        _logged((columns.DELTA_V, columns.ACCEL)[rates], flight.delta_v_m_s[member] / interval_s, flight.axes[3:]),
        (names, in_first_record),
        *(([name], values[member][:, None]) for name, values in flight.columns.items()),
    ]
    if flight.logged_wxyz is not None:
        blocks.append((list(columns.QUATERNION), flight.logged_wxyz[member]))
    table = {
        name: arrow.numbers(np.ascontiguousarray(column)) for names, block in blocks for name, column in zip(names, block.T, strict=True)
    }
    if flight.events:
        by_row = {cycle * records: kind for cycle, kind in flight.events}
        table[columns.EVENT] = arrow.text([by_row.get(row) for row in range(len(flight.time_s))])
    return pa.table(table)


def _logged(names: Sequence[str], increments: Any, axes: Sequence[bool]) -> tuple[list[str], Any]:
    return [name for name, logged in zip(names, axes, strict=True) if logged], increments[:, np.array(axes)]


def truth_of(flight: SimulatedFlight, member: int, scenario: Scenario) -> dict[str, Any]:
    """Content of truth.json: the ten quantities at the end of each phase, and those of a docked object."""
    content: dict[str, Any] = {
        "schema": "massprop/truth/1",
        "scenario": scenario.name,
        "seed": flight.seeds[member],
        "env": scenario.vehicle.environment.kind,
        "delay_cycles": scenario.delay_cycles,
        "poi_convention": "tensor",
        "phases": [
            {"name": phase.name, **_named(values), **_about_pivot(values, scenario)}
            for phase, values in zip(flight.phases, flight.truth[member], strict=True)
        ],
    }
    return content | ({} if flight.docked is None else {"docked": _named(flight.docked)})


def _about_pivot(values: Any, scenario: Scenario) -> dict[str, dict[str, float]]:
    """Nine quantities of the rotating body about the pivot; empty without a pivot."""
    if not scenario.vehicle.pivoted:
        return {}
    mass, arm = float(values[9]) - scenario.vehicle.bearing_mass_kg, np.array(values[6:9]) - scenario.vehicle.environment.bearing_position_m
    inertia = np.array(values[:6]) + elements(parallel_axis(mass, arm))
    return {"about_pivot": dict(zip(ABOUT_PIVOT, [*inertia.tolist(), *(mass * arm).tolist()], strict=True))}


def _named(values: Any) -> dict[str, float]:
    return {name: float(value) for name, value in zip(QUANTITIES, values, strict=True)}
