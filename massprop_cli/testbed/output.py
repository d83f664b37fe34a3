"""What a flight leaves behind: log.parquet or log.csv, vehicle.toml, truth.json."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w

from massprop_cli import QUANTITIES, arrow, columns, files
from massprop_cli.errors import InputError
from massprop_cli.telemetry import Notice
from massprop_cli.testbed.scenario import Scenario, ScenarioSource
from massprop_cli.testbed.simulate import Flight, fly
from massprop_cli.vehicle import Vehicle

_LIST = re.compile(r"\[\n((?:\s+[-+.\w]+,\n)+)\s*\]")
"""A list of numbers over several lines, which a person reads better on one."""
Kind = Literal["parquet", "csv"]
MEMORY = 4_000_000
"""Numbers logged at once: a campaign is flown in batches that hold about so many."""


def simulate(
    source: ScenarioSource,
    folder: Path,
    first_seed: int,
    seeds: int | None,
    kind: Kind = "parquet",
    progress: Callable[[str, float], None] | None = None,
) -> str:
    """Fly one seed into ``folder``, or ``seeds`` of them into folders seed-N below it; says what was written."""
    try:
        if seeds is None:
            flight = fly(source, [first_seed], progress=progress and (lambda done: progress("simulating", done)))
            write(flight, 0, source.scenario, folder, kind)
            return f"log.{kind}, vehicle.toml and truth.json"
        batch = max(1, min(200, MEMORY // (source.scenario.cycles * (6 * source.scenario.sensors.records_per_cycle + 20))))
        digits = len(str(first_seed + seeds - 1))
        for start in range(0, seeds, batch):
            chosen = range(first_seed + start, first_seed + min(start + batch, seeds))
            flight = fly(
                source, chosen, progress=progress and (lambda done, start=start: progress("simulating", (start + done * batch) / seeds))
            )
            for member, seed in enumerate(chosen):
                write(flight, member, source.scenario, folder / f"seed-{seed:0{digits}d}", kind)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); choose another folder with --out") from None
    return f"{seeds} folders, seed-{first_seed:0{digits}d} to seed-{first_seed + seeds - 1}"


def warnings(source: ScenarioSource) -> list[Notice]:
    """What can be flown but is no real body."""
    bodies = {"truth": source.scenario.truth, "docked": source.scenario.docked}
    return [
        Notice(
            "unphysical-inertia", f"{source.source}: [{name}] breaks the triangle inequality of principal moments, which no real body does"
        )
        for name, body in bodies.items()
        if body is not None and body.breaks_triangle
    ]


def write(flight: Flight, member: int, scenario: Scenario, folder: Path, kind: Kind = "parquet") -> None:
    """Write one member's files; truth.json comes last."""
    import pyarrow.csv
    import pyarrow.parquet as pq

    folder.mkdir(parents=True, exist_ok=True)
    vehicle = vehicle_toml(flight.vehicle)
    table = log_table(flight, member, scenario)
    if kind == "parquet":
        table = table.replace_schema_metadata({"massprop.vehicle": vehicle})
        files.whole(folder / "log.parquet", lambda path: pq.write_table(table, path, compression="zstd"))
    else:
        files.whole(folder / "log.csv", lambda path: pyarrow.csv.write_csv(table, path, pyarrow.csv.WriteOptions(quoting_style="needed")))
    files.text(folder / "vehicle.toml", vehicle)
    truth = json.dumps(truth_of(flight, member, scenario), indent=1, allow_nan=False, ensure_ascii=False)
    files.text(folder / "truth.json", truth + "\n")


def vehicle_toml(vehicle: Vehicle) -> str:
    """The vehicle file's text: what the scenario sets, defaults left out."""
    text = tomli_w.dumps(vehicle.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True))
    return _LIST.sub(lambda found: "[" + ", ".join(found.group(1).replace(",", " ").split()) + "]", text)


def log_table(flight: Flight, member: int, scenario: Scenario) -> Any:
    """The log as an Arrow table, commands in the first record of their cycle."""
    import pyarrow as pa

    records = scenario.sensors.records_per_cycle
    names = [columns.jet(jet.name) for jet in scenario.vehicle.jets] or list(columns.WRENCH)
    blocks = [
        ([columns.TIME], flight.time_s[:, None]),
        (list(columns.DELTA_THETA), flight.delta_theta_rad[member]),
        (list(columns.DELTA_V), flight.delta_v_m_s[member]),
        (names, _in_first_record(flight.issued[member], records)),
    ]
    if scenario.sensors.log_attitude:
        blocks.append((list(columns.QUATERNION), flight.attitude_wxyz[member, 1:]))
    found = {
        name: arrow.numbers(np.ascontiguousarray(column)) for names, block in blocks for name, column in zip(names, block.T, strict=True)
    }
    if flight.events:
        happened = {cycle * records: kind for cycle, kind in flight.events}
        found[columns.EVENT] = arrow.text([happened.get(row) for row in range(len(flight.time_s))])
    return pa.table(found)


def _in_first_record(issued: Any, records: int) -> Any:
    rows = np.full((len(issued) * records, issued.shape[1]), np.nan)
    rows[::records] = np.round(issued, 12)  # ticks without the noise of their multiplication
    return rows


def truth_of(flight: Flight, member: int, scenario: Scenario) -> dict[str, Any]:
    """truth.json: the ten quantities at the end of each phase, and those of a docked object."""
    found: dict[str, Any] = {
        "schema": "massprop/truth/1",
        "scenario": scenario.name,
        "seed": flight.seeds[member],
        "env": scenario.vehicle.environment.kind,
        "delay_cycles": scenario.delay_cycles,
        "poi_convention": "tensor",
        "phases": [{"name": phase.name, **_named(values)} for phase, values in zip(flight.phases, flight.truth[member], strict=True)],
    }
    return found | ({} if flight.docked is None else {"docked": _named(flight.docked)})


def _named(values: Any) -> dict[str, float]:
    return {name: float(value) for name, value in zip(QUANTITIES, values, strict=True)}
