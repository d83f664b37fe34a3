"""Recordings as people have them: what is said of each kind, and what the values are worth.

    python benchmarks/cases.py
    python benchmarks/cases.py --kind clock-bursts --variants 20 --show
    python benchmarks/cases.py --pairs 200 --show

Each variant is a vehicle of its own (benchmarks/any_vehicle.py: its size, rate, axes and environment are drawn), flown without a fault.
A kind changes the log's columns, or the vehicle file, as a recorder or a person does, and the log is read and estimated as from a file.
``--pairs``: two kinds at once, drawn at random by the vehicle's number from all of these and from the faults of benchmarks/faults.py.
"""

import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial

import case_fault
import case_lost
import case_recorded
import case_timing
import numpy as np
from any_vehicle import scenario_of, source_of
from case_fault import log_of
from case_kind import Flown, Kind, Made
from fault_named import CAUSES, SIZED, Due
from fault_runs import PART, SIGMAS, Value, against
from script import commit, counted

from massprop_cli import __version__, flow
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import output, simulate

KINDS: dict[str, Kind] = {**case_recorded.KINDS, **case_timing.KINDS, **case_lost.KINDS, **case_fault.ACTUATED}
PAIRED: dict[str, Kind] = {
    name: kind for name, kind in {**KINDS, **case_fault.KINDS}.items() if kind.codes or kind.refusals or kind.knowing
}
"""Without those that have no fault."""
SKETCH = """# Recordings that people have

What massprop {version} at commit {commit} says of recordings with a fault of the recorder or of the person who set it up.
`python benchmarks/cases.py --variants {variants}` prints this page: of each kind so many logs, each of another vehicle drawn at random,
from number {first} on. Two faults at once: `--pairs 100`. A kind alone, log by log: `--kind NAME --show`.

- **named**: a warning or a refusal says what is wrong. Kinds without a fault must have none.
- **refused**: no estimate, but a remedy.
- **wrong**: values off by more than {far:g} of their own sigma and {part:.1%} of their natural size; called converged or not.
- **other causes**: warnings that name another cause.
"""
HEAD = """| kind | logs | named | refused | values | converged | wrong (converged) | other causes |
|---|--:|--:|--:|--:|--:|--:|---|"""


@dataclass(frozen=True)
class Outcome:
    """What massprop reports on one variant."""

    kinds: tuple[str, ...]
    number: int
    what: str
    named: tuple[bool, ...]
    """Of each kind."""
    refused: str
    others: tuple[Notice, ...]
    """Those that name another cause."""
    codes: tuple[str, ...]
    values: tuple[Value, ...]
    seconds: float

    def among(self, verdict: str) -> int:
        """The number of values with this verdict."""
        return sum(value.verdict == verdict for value in self.values)

    @property
    def sure(self) -> list[Value]:
        """Values that are wrong and called converged."""
        return [value for value in self.values if value.good]


@lru_cache(64)
def flown(number: int) -> Flown | None:
    """A drawn vehicle's log by its columns; None where the vehicle can't fly its plan."""
    source = source_of(scenario_of(number)[0])
    try:
        flight = simulate.fly(source, [number])
        table = output.log_table(flight, 0, source.scenario)
    except InputError:
        return None
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    vehicle = Vehicle.model_validate(flight.vehicle.model_dump(by_alias=True, exclude_unset=True, exclude={"columns"}))
    return Flown(columns, vehicle, tuple(flight.truth[0]), flight, source)


def run(names: Sequence[str], number: int) -> Outcome | None:
    """One variant, with these kinds one after the other; None where the vehicle can't have them."""
    one = flown(number)
    if one is None:
        return None
    made, what, dues = Made(dict(one.columns), one.vehicle, "", (), one.truth), list[str](), list[tuple[Due, ...]]()
    for name in names:
        kind, rng = PAIRED.get(name) or KINDS[name], np.random.default_rng([number, zlib.crc32(name.encode())])
        try:
            changed = kind.make(made.columns, made.vehicle, rng, **({"flown": one} if kind.knowing else {}))
        except InputError:
            return None
        except KeyError as missing:
            if missing.args[0] in one.columns:
                return None  # another kind has renamed it
            raise
        if changed is None:
            return None
        made = changed if changed.truth else changed._replace(truth=made.truth)
        what.append(made.what)
        dues.append(made.dues or ((Due(kind.codes),) if kind.codes else ()))
    outcome, begin = partial(Outcome, tuple(names), number, "; ".join(what)), time.process_time()
    try:
        with np.errstate(all="ignore"):
            found = flow.examine(log_of(made.columns, made.vehicle), VehicleSource(made.vehicle, "", ""))
    except InputError as error:
        named = tuple(any(word in str(error) for word in (PAIRED.get(name) or KINDS[name]).refusals) for name in names)
        return outcome(named, str(error), (), (), (), time.process_time() - begin)
    channels = [jet.name for jet in made.vehicle.jets] or list(WRENCH)
    guilty = frozenset(name for own in dues for due in own for name in due.channels)
    met = [[any(due.met_by(notice, channels, guilty) for due in own) for notice in found.notices] for own in dues]
    others = tuple(notice for i, notice in enumerate(found.notices) if notice.code in CAUSES - SIZED and not any(own[i] for own in met))
    codes = tuple(dict.fromkeys(notice.code for notice in found.notices))
    named = tuple(any(own) if due else not set(codes) & CAUSES for own, due in zip(met, dues, strict=True))
    sizes = [settled.natural_sizes for settled in found.settled]
    every = (against(conclusion, np.array(made.truth), own) for conclusion, own in zip(found.conclusions, sizes, strict=True))
    values = tuple(value for own in every for value in own if value.sigma)
    return outcome(named, "", others, codes, values, time.process_time() - begin)


def pair(number: int) -> Outcome | None:
    """Two kinds, drawn by the vehicle's number; faults of the flight come first."""
    drawn = np.random.default_rng([number, 2]).choice(list(PAIRED), 2, replace=False).tolist()
    return run(sorted(drawn, key=lambda name: name not in case_fault.KINDS), number)


def row(name: str, runs: Sequence[Outcome]) -> str:
    """A row of the table."""
    values, converged = sum(len(one.values) for one in runs), sum(one.among("converged") for one in runs)
    wrong, sure = sum(value.wrong for one in runs for value in one.values), sum(len(one.sure) for one in runs)
    others = ", ".join(sorted({notice.code for one in runs for notice in one.others})) or "none"
    counts = f"{sum(all(one.named) for one in runs)} | {sum(bool(one.refused) for one in runs)} | {values} | {converged} | {wrong} ({sure})"
    return f"| {name}: {KINDS[name].what} | {len(runs)} | {counts} | {others} |"


def main() -> None:
    """Print the page, or some of its kinds."""
    parser = counted(__doc__, variants=12)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--pairs", type=int, default=0, metavar="N", help="pairs of kinds, instead of kinds")
    parser.add_argument("--first", type=int, default=9000, help="number of the first vehicle")
    parser.add_argument("--jobs", type=int, default=None, help="processes")
    parser.add_argument("--show", action="store_true", help="each log by itself")
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.jobs) as pool:
        if asked.pairs:
            _pairs(list(_some(pool, pair, asked.first, asked.pairs, asked.show)))
            return
        print(SKETCH.format(version=__version__, commit=commit(), far=SIGMAS, part=PART, variants=asked.variants, first=asked.first))
        print(HEAD)
        for name in asked.kind or KINDS:
            runs = list(_some(pool, partial(run, (name,)), asked.first, asked.variants, asked.show))
            print(row(name, runs), flush=True)


def _some(pool: Executor, one_of: Callable[[int], Outcome | None], first: int, count: int, show: bool) -> Iterator[Outcome]:
    """``count`` outcomes, of the first vehicles that can have the kind."""
    last = first + 6 * count
    while count and first < last:
        for one in pool.map(one_of, range(first, first + count)):
            first += 1
            if one is not None:
                count -= 1
                if show:
                    print("   ", _shown(one), flush=True)
                yield one


def _pairs(runs: Sequence[Outcome]) -> None:
    """Print the totals of pairs."""
    named = [sum(one.named) for one in runs]
    print(f"{len(runs)} logs with two faults: both named in {named.count(2)}, one in {named.count(1)}, none in {named.count(0)};")
    print(f"refused {sum(bool(one.refused) for one in runs)}; another cause is named in {sum(bool(one.others) for one in runs)};")
    print(
        f"of {sum(one.among('converged') for one in runs)} values that are called converged {sum(len(one.sure) for one in runs)} are wrong"
    )
    print(f"in {sum(bool(one.sure) for one in runs)} logs; {sum(one.seconds for one in runs):.0f} s of CPU")


def _shown(one: Outcome) -> str:
    off = " ".join(f"{value.name}:{value.verdict[:4]}{value.off:+.1f}" for value in one.values)
    flags = "".join(f"NOT NAMED {name} " for name, named in zip(one.kinds, one.named, strict=True) if not named)
    flags += "".join(f"\n      WRONG {notice.code}: {notice.message}\n      " for notice in one.others)
    flags += "".join(f"CONVERGED {value.name} {value.off:+.1f} sigma, {100 * value.apart:.1f} % " for value in one.sure)
    return (
        f"{one.number} {' and '.join(one.kinds)}: {one.what}: {flags}{', '.join(one.codes)} {one.refused[:300]} {off} ({one.seconds:.1f} s)"
    )


if __name__ == "__main__":
    main()
