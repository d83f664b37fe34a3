"""What is called converged on board while something is wrong that the vehicle file doesn't say.

    python benchmarks/aboard.py > docs/aboard.md

The faulty and the clean logs of benchmarks/faults.py, cycle by cycle through what `massprop live` and the flown code call. On board no
cause is looked for and nothing is sized: a value is contradicted while the latest cycles leave more than the stated noise.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from fault_kinds import FAULTS
from fault_runs import PART, SIGMAS
from fault_vehicles import Body, Case, subject
from script import commit, counted

from massprop_cli import __version__
from massprop_cli.base import onethread
from massprop_cli.base.arrays import BoolArray
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.verdict import POSITIVE
from massprop_cli.estimate.kernelflight import VERDICTS, cycles_of
from massprop_cli.export import resolve
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.live.cycles import RecordedCycle
from massprop_cli.live.estimator import CycleEstimate, FlightEstimator
from massprop_cli.model.kernelargs import StatusError

VEHICLES = ("jets", "wrench", "bearing", "docking", "noisy", "canted")
"""Not the heavy one, whose jets' lag the kernel doesn't hold, nor the disturbed one, whose torque isn't stated."""
CONVERGED, CONTRADICTED = (VERDICTS.index(verdict) for verdict in ("converged", "contradicted"))

PAGE = """# What is called converged on board

Made by `{command} > docs/aboard.md` at commit {commit} (massprop {version}): the faulty and clean logs of [faults](faults.md), cycle by
cycle through what [`massprop live` and the flown code](kernel.md) call. There no cause is looked for and no noise is sized; all values are
`contradicted` while the running mean square of a sensor's normalised innovations is above 1.5 ([kernel](kernel.md)). What hides below
that, and a fault that no log can tell (all thrust off by the same part), stays: `massprop estimate` on the recording tests each assumption
by itself. The vehicles: {vehicles}. A value is wrong if it is more than 4 sigma and half a percent of its size off.

Of {clean} clean logs {end} have values contradicted in the end, {ever} had at any cycle ({where}), and {wrong} had a wrong value called
converged at any cycle. A body that is sought from few cycles on may be far off at first, and its innovations then count in the running
mean for some hundred cycles.
"""


@dataclass(frozen=True)
class Told:
    """The outcome of one log on board."""

    fault: str
    vehicle: str
    wrong: bool
    """Whether in the end any value that is told is off by more than 4 sigma and half a percent, ..."""
    converged: bool
    """... and is called converged, ..."""
    contradicted: bool
    """... or values are contradicted then."""
    ever: bool
    """... or were at any cycle."""
    wrong_cycles: float
    """Part of the cycles at which a value was called converged and was wrong."""


def told(fault: str, vehicle: str, seed: int) -> Told | None:
    """None where the vehicle can't have the fault, or the kernel doesn't take its cycles."""
    flown = subject(vehicle, seed)
    case: Case | None = flown.clean
    if fault:
        drawn = FAULTS[fault].draw(flown, flown.drawing(fault))
        case = None if drawn is None else drawn.case
    if case is None:
        return None
    try:
        each = [_of_one(done, case) for done in _flown(case, vehicle)]
    except (InputError, StatusError):
        return None
    off, converged, contradicted = (np.stack(part) for part in zip(*each, strict=True))
    silent, judged = (np.atleast_1d(one.any(1)) for one in (off & converged, contradicted))
    return Told(fault, vehicle, bool(off[-1:].any()), bool(silent[-1]), bool(judged[-1]), bool(judged.any()), float(silent.mean()))


def _flown(case: Case, name: str) -> Iterator[CycleEstimate]:
    log = case.log
    estimator = FlightEstimator(resolve.stated(VehicleSource(case.vehicle, name, ""), log.command_kind == "jets"))
    whole = slice(0, log.cycles)
    for end_s, numbers in zip(log.cycle_end_s, cycles_of(log, whole, whole), strict=True):
        yield from estimator.add(RecordedCycle(float(end_s), numbers.copy()))
    yield from estimator.last()


def _of_one(done: CycleEstimate, case: Case) -> tuple[BoolArray, BoolArray, BoolArray]:
    """(10,) whether each value is wrong, is called converged, and is contradicted after a cycle."""
    values, sigmas, verdicts = done.reported.values[-1], done.reported.sigmas[-1], done.reported.verdicts[-1]
    true = np.array([body.values for body in _now(case, done.end_s)])
    trace = np.abs(true[:, [0, 3, 5]]).sum(1).min()
    sizes = np.repeat([trace, np.sqrt(trace / np.abs(true[:, 9]).max()), np.abs(true[:, 9]).min()], [6, 3, 1])
    sizes[POSITIVE] = np.minimum(sizes, np.abs(true).min(0))[POSITIVE]
    off: BoolArray = np.abs(true - values).min(0) > np.maximum(SIGMAS * sigmas, PART * sizes)
    return off & (verdicts != VERDICTS.index("untold")), verdicts == CONVERGED, verdicts == CONTRADICTED


def _now(case: Case, end_s: float) -> list[Body]:
    """The true bodies during the last two cycles."""
    since = end_s - 2 * case.vehicle.cycle.period_s
    return [body for body in case.bodies if body.start_s < end_s and body.end_s >= since] or list(case.bodies)


def main() -> None:
    """Print the page: one row for each fault."""
    parser = counted(__doc__, seeds=3)
    parser.add_argument("--first", type=int, default=1071, help="seed")
    parser.add_argument("--clean", type=int, default=60, help="logs without fault of each vehicle, from seed 3001 on")
    options = parser.parse_args()
    onethread.prefer()
    seeds = range(options.first, options.first + options.seeds)
    tasks = [("", vehicle, seed) for vehicle in VEHICLES for seed in range(3001, 3001 + options.clean)]
    tasks += [(fault, vehicle, seed) for vehicle in VEHICLES for seed in seeds for fault in FAULTS]
    with ProcessPoolExecutor() as pool:
        found = [one for one in pool.map(told, *zip(*tasks, strict=True), chunksize=20) if one is not None]
    print_page(found, sys.argv[1:])


def print_page(found: list[Told], options: list[str]) -> None:
    """Print docs/aboard.md."""
    clean, faulty = [one for one in found if not one.fault], [one for one in found if one.fault]
    print(
        PAGE.format(
            command=" ".join(["python benchmarks/aboard.py", *options]),
            commit=commit(),
            version=__version__,
            vehicles=", ".join(VEHICLES),
            clean=len(clean),
            end=sum(one.contradicted for one in clean),
            ever=sum(one.ever for one in clean),
            where=", ".join(f"{n} of {name}" for name, n in Counter(one.vehicle for one in clean if one.ever).items()) or "none",
            wrong=sum(one.wrong_cycles > 0 for one in clean),
        )
    )
    print("| fault | logs | a value wrong in the end | contradicted | called converged | cycles with a wrong value called converged |")
    print("|---|--:|--:|--:|--:|--:|")
    names = [*dict.fromkeys(one.fault for one in faulty)]
    for name, some in [*((name, [one for one in faulty if one.fault == name]) for name in names), ("all", faulty)]:
        count = Counter(("contradicted" if one.contradicted else "converged" if one.converged else "") for one in some if one.wrong)
        part = 100 * np.mean([one.wrong_cycles for one in some])
        harmed = sum(one.wrong for one in some)
        print(f"| {name} | {len(some)} | {harmed} | {count['contradicted']} | {count['converged']} | {part:.1f} % |")


if __name__ == "__main__":
    main()
