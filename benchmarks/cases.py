"""Recordings as people have them: what is said of each kind, and what the values are worth.

    python benchmarks/cases.py
    python benchmarks/cases.py --kind clock-bursts --variants 20 --show

Each variant is a vehicle of its own (benchmarks/any_vehicle.py: its size, rate, axes and environment are drawn), flown without a fault.
A kind changes the log's columns, or the vehicle file, as a recorder or a person does, and the log is read and estimated as from a file.
"""

from __future__ import annotations

import argparse
import json
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import case_recorded
import case_timing
import numpy as np
from any_vehicle import scenario_of
from case_kind import Columns, Kind
from commit import commit
from fault_named import CAUSES

from massprop_cli import __version__, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.verdict import Estimate
from massprop_cli.inputs import telemetry
from massprop_cli.inputs.tablefile import columns_of
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import output, scenario, simulate

FAR = 4.0
"""Sigmas beyond which a value is wrong."""
KINDS: dict[str, Kind] = {**case_recorded.KINDS, **case_timing.KINDS}
SKETCH = """# Recordings that people have

What massprop {version} at commit {commit} says of recordings with a fault of the recorder or of the person who set it up.
`python benchmarks/cases.py` prints this table; a kind alone, log by log: `--kind NAME --show`.

- **named**: a warning or a refusal says what is wrong. Kinds without a fault must have none.
- **refused**: no estimate, but a remedy.
- **wrong**: values off by more than {far:g} of their own sigma; called converged or not.
- **other causes**: warnings that name another cause.
"""


class Flown(NamedTuple):
    """One vehicle's flight without a fault."""

    columns: Columns
    vehicle: Vehicle
    truth: tuple[Array, ...]
    """(10,) of each phase."""


@dataclass(frozen=True)
class Outcome:
    """What is said of one variant."""

    kind: str
    number: int
    what: str
    named: bool
    refused: str
    others: tuple[str, ...]
    """Codes that name another cause."""
    codes: tuple[str, ...]
    estimates: Mapping[str, tuple[str, float]]
    """Verdict, and error over sigma, of each value that is given."""
    seconds: float

    @property
    def wrong(self) -> list[str]:
        """Values that are off."""
        return [name for name, (_, off) in self.estimates.items() if abs(off) > FAR]

    def among(self, verdict: str) -> int:
        """How many values have it."""
        return sum(1 for found, _ in self.estimates.values() if found == verdict)


@lru_cache(64)
def flown(number: int) -> Flown | None:
    """A drawn vehicle's log by its columns; None where the vehicle can't fly its plan."""
    data, _ = scenario_of(number)
    plain = json.loads(json.dumps(data, default=np.ndarray.tolist))
    source = scenario.ScenarioSource(scenario.Scenario.model_validate(plain), str(data["name"]))
    try:
        flight = simulate.fly(source, [number])
        table = output.log_table(flight, 0, source.scenario)
    except InputError:
        return None
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    vehicle = Vehicle.model_validate(flight.vehicle.model_dump(by_alias=True, exclude_unset=True, exclude={"columns"}))
    return Flown(columns, vehicle, tuple(flight.truth[0]))


def log_of(columns: Columns, vehicle: Vehicle) -> telemetry.Log:
    """The log, read as from a file of these columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(columns)), sink)
    return telemetry.read(columns_of(Path("log.parquet"), sink.getvalue().to_pybytes()), vehicle)


def run(name: str, number: int) -> Outcome | None:
    """One variant; None where the vehicle can't have this kind."""
    one, kind = flown(number), KINDS[name]
    if one is None:
        return None
    knows = {"truth": one.truth[0]} if kind.knowing else {}
    made = kind.make(dict(one.columns), one.vehicle, np.random.default_rng([number, zlib.crc32(name.encode())]), **knows)
    if made is None:
        return None
    outcome = partial(Outcome, name, number, made.what)
    begin = time.process_time()
    try:
        with np.errstate(all="ignore"):
            found = flow.examine(log_of(made.columns, made.vehicle), VehicleSource(made.vehicle, "", ""))
    except InputError as error:
        said = str(error)
        return outcome(any(word in said for word in kind.refusals), said, (), (), {}, time.process_time() - begin)
    codes = tuple(dict.fromkeys(notice.code for notice in found.notices))
    named = bool(set(codes) & set(kind.codes)) if kind.codes else not set(codes) & CAUSES
    others = tuple(code for code in codes if code in CAUSES and code not in kind.codes)
    phases = zip(found.conclusions, one.truth, strict=False)
    values = {key: told for conclusion, truth in phases for key, told in _told(conclusion.estimates, truth)}
    return outcome(named, "", others, codes, values, time.process_time() - begin)


def _told(estimates: Mapping[str, Estimate], truth: Array) -> Iterator[tuple[str, tuple[str, float]]]:
    for (name, estimate), true in zip(estimates.items(), truth, strict=True):
        if estimate.value is not None and estimate.sigma:
            yield name, (estimate.verdict, float((estimate.value - true) / estimate.sigma))


def row(name: str, runs: Sequence[Outcome]) -> str:
    """Of the table."""
    values = sum(len(one.estimates) for one in runs)
    converged, wrong = sum(one.among("converged") for one in runs), sum(len(one.wrong) for one in runs)
    sure = sum(1 for one in runs for name in one.wrong if one.estimates[name][0] == "converged")
    others = ", ".join(sorted({code for one in runs for code in one.others})) or "none"
    counts = f"{sum(one.named for one in runs)} | {sum(bool(one.refused) for one in runs)} | {values} | {converged} | {wrong} ({sure})"
    return f"| {name}: {KINDS[name].what} | {len(runs)} | {counts} | {others} |"


def main() -> None:
    """The page, or some kinds of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--variants", type=int, default=12)
    parser.add_argument("--first", type=int, default=9000, help="number of the first vehicle")
    parser.add_argument("--jobs", type=int, default=None, help="processes")
    parser.add_argument("--show", action="store_true", help="each log by itself")
    asked = parser.parse_args()
    print(SKETCH.format(version=__version__, commit=commit(), far=FAR))
    print("| kind | logs | named | refused | values | converged | wrong (converged) | other causes |\n|---|--:|--:|--:|--:|--:|--:|---|")
    with ProcessPoolExecutor(asked.jobs) as pool:
        for name in asked.kind or KINDS:
            runs = _some(pool.map(partial(run, name), range(asked.first, asked.first + 2 * asked.variants)), asked.variants)
            print(row(name, runs), flush=True)
            if asked.show:
                for one in runs:
                    print("   ", _shown(one))


def _some(runs: Iterator[Outcome | None], count: int) -> list[Outcome]:
    return [one for one in runs if one is not None][:count]


def _shown(one: Outcome) -> str:
    off = " ".join(f"{name}:{verdict[:4]}{off:+.1f}" for name, (verdict, off) in one.estimates.items())
    flags = "" if one.named else "NOT NAMED "
    return f"{one.number} {one.what}: {flags}{', '.join(one.codes)} {one.refused[:300]} {off} ({one.seconds:.1f} s)"


if __name__ == "__main__":
    main()
