"""What values are worth of logs whose fault nobody foresaw: coverage, use, and values that are wrong and called converged.

python benchmarks/unforeseen.py --seeds 3 > docs/unforeseen.md
python benchmarks/unforeseen.py --kind slosh --vehicle jets --show
"""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from massprop_cli.base import onethread

onethread.prefer()

from fault_commands import COMMANDS, commanded  # noqa: E402
from fault_kinds import FAULTS  # noqa: E402
from fault_runs import PART, SIGMAS  # noqa: E402
from fault_unforeseen import UNFORESEEN  # noqa: E402
from fault_vehicles import VEHICLES, Case, subject  # noqa: E402
from script import commit, counted  # noqa: E402

from massprop_cli import __version__, flow  # noqa: E402
from massprop_cli.base.arrays import Array, BoolArray  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402

USEFUL = 0.02
"""Of its natural size, a sigma that is of use."""
CHOSEN = ("jets", "bearing", "canted", "wrench")
"""Vehicles that the program's thresholds were looked at with; the others are the proof."""
SKETCH = """# Faults that nobody foresaw

What values are worth of logs with a fault that no [error parameter](error-parameters.md) describes, or not alone; of massprop {version},
commit {commit}. `python benchmarks/unforeseen.py --seeds {seeds} --first {first}` writes this page. How: [discrepancy](discrepancy.md).

- **covered**: values within 1.96 of their sigmas of the truth.
- **useful**: covered, with a sigma below {useful:.0%} of the natural size.
- **wrong**: off by more than {far:g} sigma and {part:.1%} of the natural size.
"""


@dataclass(frozen=True)
class Outcome:
    """What massprop reports on one phase of a log."""

    kind: str
    vehicle: str
    widened: bool
    """Whether sigmas include what the model does not explain."""
    named: bool
    sigmas: Array
    """(n,) over natural size."""
    off: Array
    """(n,) sigmas."""
    apart: Array
    """(n,) over natural size."""
    verdicts: tuple[str, ...]
    seconds: float

    @property
    def covered(self) -> BoolArray:
        """(n,) whether the 95 % interval of each value covers the truth."""
        return self.off < 1.96

    @property
    def wrong(self) -> BoolArray:
        """(n,) whether the error of each value is beyond both limits."""
        return (self.off > SIGMAS) & (self.apart > PART)


def made(kind: str, vehicle: str, seed: int) -> Case | None:
    """A log with the fault; None where the vehicle cannot have it."""
    flown = subject(vehicle, seed)
    rng = flown.drawing(kind)
    if kind == "clean":
        return flown.clean
    if kind in COMMANDS and not commanded(flown):
        return None
    if kind in UNFORESEEN:
        return UNFORESEEN[kind][1](flown, rng)
    drawn = FAULTS[kind].draw(flown, rng)
    return None if drawn is None else drawn.case


def run(kind: str, vehicle: str, seed: int) -> list[Outcome]:
    """The outcome of each phase of one log."""
    case = made(kind, vehicle, seed)
    if case is None:
        return []
    begin = time.process_time()
    with np.errstate(all="ignore"):
        found = flow.examine(case.log, VehicleSource(case.vehicle, vehicle, ""))
    seconds, runs = time.process_time() - begin, []
    for conclusion, settled, told in zip(found.conclusions, found.settled, found.discrepancies, strict=True):
        phase = conclusion.phase
        bodies = np.array([one.values for one in case.bodies if one.start_s < phase.end_s and one.end_s > phase.start_s])
        away = np.abs(bodies - conclusion.values)
        nearest = away[int(np.nansum((away / conclusion.sigmas) ** 2, 1).argmin())]
        given = np.isfinite(conclusion.sigmas)
        verdicts = tuple(one.verdict for one, is_given in zip(conclusion.estimates.values(), given, strict=True) if is_given)
        sizes, sigmas = settled.natural_sizes[given], conclusion.sigmas[given]
        values = sigmas / sizes, nearest[given] / sigmas, nearest[given] / sizes
        runs.append(Outcome(kind, vehicle, told is not None, bool(found.faults), *values, verdicts, seconds))
    return runs


def main() -> None:
    """Print the tables of all kinds on all vehicles."""
    parser = counted(__doc__, seeds=3)
    parser.add_argument("--first", type=int, default=3001, help="seed")
    parser.add_argument("--kind", action="append", help=f"clean, {', '.join((*UNFORESEEN, *FAULTS))}")
    parser.add_argument("--vehicle", action="append", choices=list(VEHICLES))
    parser.add_argument("--jobs", type=int, default=None, help="processes")
    parser.add_argument("--show", action="store_true", help="each log by itself")
    asked = parser.parse_args()
    kinds, vehicles = asked.kind or list(UNFORESEEN), asked.vehicle or list(VEHICLES)
    seeds = range(asked.first, asked.first + asked.seeds)
    tasks = [(kind, vehicle, seed) for vehicle in vehicles for seed in seeds for kind in kinds]
    with ProcessPoolExecutor(asked.jobs) as pool:
        runs = [one for found in pool.map(run, *zip(*tasks, strict=True), chunksize=len(kinds)) for one in found]
    if asked.show:
        for one in runs:
            print(
                one.kind, one.vehicle, "widened" if one.widened else "", np.round(one.off, 2), np.round(100 * one.sigmas, 3), one.verdicts
            )
        return
    print(SKETCH.format(version=__version__, commit=commit(), seeds=asked.seeds, first=asked.first, useful=USEFUL, far=SIGMAS, part=PART))
    print("\n".join(_table("vehicle", {name: [r for r in runs if r.vehicle == name] for name in vehicles}, runs)))
    print("\n" + "\n".join(_table("kind", {name: [r for r in runs if r.kind == name] for name in kinds}, runs)))
    proof = [r for r in runs if r.vehicle not in CHOSEN]
    print(f"\nThresholds were looked at with {', '.join(CHOSEN)}. Of the others alone: {_line(proof)}.")
    print(f"CPU time of a log: median {np.median([r.seconds for r in runs]):.2f} s, most {max(r.seconds for r in runs):.1f} s.")


def _table(title: str, by: dict[str, list[Outcome]], every: Sequence[Outcome]) -> Iterator[str]:
    yield f"| {title} | logs | sigmas widened | values | covered | useful | wrong | converged | of these wrong |"
    yield "|---|--:|--:|--:|--:|--:|--:|--:|--:|"
    for name, runs in {**by, "all": list(every)}.items():
        if runs:
            yield f"| {name}{f': {UNFORESEEN[name][0]}' if name in UNFORESEEN else ''} | {' | '.join(_cells(runs))} |"


def _cells(runs: Sequence[Outcome]) -> list[str]:
    covered, wrong, small = (np.concatenate(part) for part in zip(*((r.covered, r.wrong, r.sigmas < USEFUL) for r in runs), strict=True))
    converged = np.array([verdict == "converged" for r in runs for verdict in r.verdicts])
    share = [f"{100 * part.mean():.1f} %" for part in (covered, covered & small)]
    return [
        str(len(runs)),
        str(sum(r.widened for r in runs)),
        str(len(covered)),
        *share,
        str(int(wrong.sum())),
        str(int(converged.sum())),
        str(int((wrong & converged).sum())),
    ]


def _line(runs: Sequence[Outcome]) -> str:
    if not runs:
        return "none"
    _, widened, values, covered, useful, wrong, _, silent = _cells(runs)
    return (
        f"{values} values, {covered} covered, {useful} useful, {wrong} wrong, {silent} of them converged; sigmas widened in {widened} logs"
    )


if __name__ == "__main__":
    main()
