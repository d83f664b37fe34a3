"""What `massprop check` says of the logs of the fault benchmark and of clean ones, beside what `massprop estimate` says, and its time.

    python benchmarks/check.py --clean 0 > docs/check.md
    python benchmarks/check.py --fault none --clean 100 >> docs/check.md
    python benchmarks/check.py --vehicle jets --fault lag --clean 25

Faults are drawn as in benchmarks/faults.py, one seed of each kind on each vehicle. With clean logs the commands are timed.
"""

import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass

from massprop_cli.base import onethread

onethread.prefer()

import numpy as np  # noqa: E402
from fault_kinds import FAULTS  # noqa: E402
from fault_named import CAUSES  # noqa: E402
from fault_runs import WRONG, warm_up  # noqa: E402
from fault_vehicles import VEHICLES, Case, subject  # noqa: E402
from scipy.stats import chi2  # noqa: E402
from scores import deviate, rms  # noqa: E402
from script import SAMPLES, commit, counted, cpu_s  # noqa: E402

from massprop_cli import QUANTITIES, __version__, flow  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.base.errors import InputError  # noqa: E402
from massprop_cli.check.finding import Finding  # noqa: E402
from massprop_cli.check.flow import seen, with_estimate  # noqa: E402
from massprop_cli.check.signals import sampling  # noqa: E402
from massprop_cli.flow import Analysis  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402
from massprop_cli.result import build  # noqa: E402

LOGS: dict[str, tuple[str, ...]] = {
    **{name: (str(SAMPLES / name / "log.parquet"),) for name in ("free-flyer", "air-bearing", "docking", "high-rate")},
    "free-flyer, its delay misstated": (str(SAMPLES / "free-flyer" / "log.parquet"), *WRONG),
}
LONG_S = 600
"""Of one more, a free flyer's."""
REPEATS = 5
TOLD = ("converged", "not_converged")
"""Verdicts of quantities that the motion tells."""
AGREES = 0.15
"""Of achieved and expected sigma."""


@dataclass(frozen=True)
class Said:
    """What ``estimate`` and ``check`` report on one log."""

    estimate: frozenset[str]
    """Causes that are named."""
    check: tuple[Finding, ...]
    own: frozenset[str]
    """Codes of what the check finds by itself, without an estimate."""
    found: Analysis | None

    @property
    def missed(self) -> frozenset[str]:
        """Causes that ``estimate`` names and ``check`` does not grade as faults."""
        return self.estimate - {one.code for one in self.check if one.grade == "fault"}

    @property
    def grades(self) -> set[str]:
        """Grades of all findings."""
        return {one.grade for one in self.check}


def said(case: Case, name: str) -> Said:
    """Run both on one log."""
    looked = [*sampling(case.log.time_s, str), *seen(case.log, case.vehicle, str)]
    own = frozenset(one.code for one in looked)
    try:
        with np.errstate(all="ignore"):
            found = flow.examine(case.log, VehicleSource(case.vehicle, name, ""))
            every = with_estimate(looked, found, build.result(found), case.vehicle)
    except InputError:
        return Said(frozenset(), tuple(looked), own, None)
    return Said(frozenset(notice.code for notice in found.notices) & CAUSES, tuple(every), own, found)


def faulty(fault: str, vehicle: str, seed: int) -> Said | None:
    """One fault as the fault benchmark draws it; None where the vehicle can't have it."""
    flown = subject(vehicle, seed)
    drawn = FAULTS[fault].draw(flown, flown.drawing(fault))
    return None if drawn is None else said(drawn.case, vehicle)


def times() -> list[str]:
    """CPU time of the two commands, each as a whole process."""
    lines = ["| log | `estimate` [s of CPU] | `check` [s of CPU] | ratio |", "|---|--:|--:|--:|"]
    with tempfile.TemporaryDirectory() as out:
        cpu("simulate", "free-flyer", "--set", f"duration_s={LONG_S}", "-q", "--out", f"{out}/long")
        for name, log in {**LOGS, f"free-flyer of {LONG_S} s": (f"{out}/long/log.parquet",)}.items():
            # by turns, so that a busy machine is as busy for both
            spent = np.array([[cpu("estimate", *log, "-q", "--out", f"{out}/result"), cpu("check", *log, "-q")] for _ in range(REPEATS)])
            estimate, check = np.median(spent, 0)
            lines.append(f"| {name} | {estimate:.2f} | {check:.2f} | {np.median(spent[:, 1] / spent[:, 0]):.2f} |")
    return lines


def cpu(*arguments: str) -> float:
    """CPU time of a command, s."""
    begin = cpu_s()
    subprocess.run([sys.executable, "-m", "massprop_cli", *arguments], check=False, capture_output=True)
    return cpu_s() - begin


def fault_table(runs: dict[tuple[str, str], Said]) -> list[str]:
    """One row for each kind of fault."""
    lines = [
        "| fault | logs | named by `estimate` | of these by `check` | with any fault by `check` | seen by `check` without an estimate |",
        "|---|--:|--:|--:|--:|---|",
    ]
    for fault in dict.fromkeys(fault for fault, _ in runs):
        mine = [one for (kind, _), one in runs.items() if kind == fault]
        own = sorted({code for one in mine for code in one.own})
        cells = [
            f"{fault}: {FAULTS[fault].what}",
            *_counts(mine),
            ", ".join(f"{code} {sum(code in one.own for one in mine)}" for code in own),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    every = list(runs.values())
    lines.append(f"| {' | '.join(['all', *_counts(every), f'{sum(bool(one.own) for one in every)} logs'])} |")
    return lines


def _counts(runs: Sequence[Said]) -> list[str]:
    naming = [one for one in runs if one.estimate]
    return [str(n) for n in (len(runs), len(naming), sum(not one.missed for one in naming), sum("fault" in one.grades for one in runs))]


@dataclass(frozen=True)
class Clean:
    """What ``check`` reports on the clean logs of one vehicle."""

    logs: int
    faults: int
    notes: int
    deviates: dict[str, list[tuple[Array, float]]]
    """Of each phase: for every log its (10,) errors over sigmas, NaN where none is told, and how their mean square scatters."""

    @property
    def all(self) -> list[tuple[Array, float]]:
        """Deviates of all phases."""
        return [one for phase in self.deviates.values() for one in phase]


def clean(vehicle: str, seeds: range) -> Clean:
    """Check the clean logs of one vehicle."""
    faults, notes, off = 0, 0, dict[str, list[tuple[Array, float]]]()
    for seed in seeds:
        case = subject(vehicle, seed).clean
        one = said(case, vehicle)
        codes = {finding.grade for finding in one.check if finding.code not in VEHICLES[vehicle].said}
        faults, notes = faults + bool(codes - {"note"}), notes + ("note" in codes)
        for conclusion, body in zip(one.found.conclusions if one.found else (), case.bodies, strict=bool(one.found)):
            told = np.array([conclusion.estimates[name].verdict in TOLD for name in QUANTITIES])
            error, scatter = deviate((conclusion.values - body.values)[told], conclusion.covariance[np.ix_(told, told)])
            every = np.full(10, np.nan)
            every[told] = error
            off.setdefault(conclusion.phase.name, []).append((every, scatter))
    return Clean(len(seeds), faults, notes, off)


def clean_table(found: dict[str, Clean]) -> list[str]:
    """One row for the clean logs of each vehicle."""
    lines = [
        "| vehicle | clean logs | with a fault found | with a note | achieved / expected sigma, all quantities |",
        "|---|--:|--:|--:|--:|",
    ]
    for vehicle, one in found.items():
        pooled = [(error[np.isfinite(error)], scatter) for error, scatter in one.all if np.isfinite(error).any()]
        lines.append(f"| {vehicle} | {one.logs} | {one.faults} | {one.notes} | {rms(pooled)} |")
    return lines


def sigma_table(found: dict[str, Clean]) -> list[str]:
    """Achieved over expected sigma of each quantity, by vehicle and phase."""
    columns = {
        (vehicle if len(one.deviates) == 1 else f"{vehicle}, {phase}"): np.array([error for error, _ in logs])
        for vehicle, one in found.items()
        for phase, logs in one.deviates.items()
    }
    lines = [f"| quantity | {' | '.join(columns)} |", f"|---|{'--:|' * len(columns)}"]
    for i, name in enumerate(QUANTITIES):
        lines.append(f"| {name} | {' | '.join(_achieved(deviates[:, i]) for deviates in columns.values())} |")
    return lines


def _achieved(deviates: Array) -> str:
    told = deviates[np.isfinite(deviates)]
    if not len(told):
        return "not told"
    achieved = float(np.sqrt((told**2).mean()))
    cell = f"{achieved:.2f}" + (f" of {len(told)}" if len(told) < len(deviates) else "")
    return f"**{cell}**" if abs(achieved - 1) > AGREES else cell


def main() -> None:
    """Print the tables of faults, clean logs and times."""
    parser = counted(__doc__)
    parser.add_argument("--vehicle", action="append", choices=list(VEHICLES), help="may be repeated")
    parser.add_argument("--fault", action="append", choices=[*FAULTS, "none"], help="may be repeated")
    parser.add_argument("--seed", type=int, default=1001, help="of the faults, and the first of the clean logs")
    parser.add_argument("--clean", type=int, default=25, help="clean logs of each vehicle")
    arguments = parser.parse_args()
    vehicles = arguments.vehicle or list(VEHICLES)
    faults = [fault for fault in arguments.fault or FAULTS if fault != "none"]
    warm_up()
    made = f"Made by `{shlex.join(['python', 'benchmarks/check.py', *sys.argv[1:]])}` at commit {commit()} (massprop {__version__}), seed"
    if faults:
        print(HEAD.format(made=f"{made} {arguments.seed}."), "\n".join(fault_table(_drawn(faults, vehicles, arguments.seed))), sep="\n")
    if arguments.clean:
        last = arguments.seed + arguments.clean - 1
        found = _flown_clean(vehicles, range(arguments.seed, last + 1))
        low, high = np.sqrt(chi2.ppf([0.025, 0.975], arguments.clean) / arguments.clean)
        print(CLEAN.format(made=f"{made}s {arguments.seed} to {last}."), "\n".join(clean_table(found)), sep="\n")
        print(SIGMAS.format(low=low, high=high), "\n".join(sigma_table(found)), sep="\n", flush=True)
        print(TIMES.format(repeats=REPEATS), "\n".join(times()), sep="\n")


def _drawn(faults: Sequence[str], vehicles: Sequence[str], seed: int) -> dict[tuple[str, str], Said]:
    runs: dict[tuple[str, str], Said] = {}
    for vehicle in vehicles:
        drawn = {fault: faulty(fault, vehicle, seed) for fault in faults}
        runs |= {(fault, vehicle): one for fault, one in drawn.items() if one is not None}
        print(f"{vehicle} done", file=sys.stderr, flush=True)
    return runs


def _flown_clean(vehicles: Sequence[str], seeds: range) -> dict[str, Clean]:
    found = {}
    for vehicle in vehicles:
        found[vehicle] = clean(vehicle, seeds)
        print("\n".join(sigma_table({vehicle: found[vehicle]})), file=sys.stderr, flush=True)
    return found


HEAD = """# Results of massprop check

## Faults

{made}
Faults are those of [faults.md](faults.md), one log of each on each vehicle that can have it. A finding is a fault where values or
sigmas may be wrong. The check detects faults in the last column in the log itself, before any estimate. No file states the slow torque of
the disturbed vehicle; the check names it in every log.
"""
CLEAN = """
## Clean logs

{made}
The inertia of the docking vehicle, from the thesis, violates the triangle inequality; the note on each of its logs reports this.
"""
SIGMAS = """
Achieved over expected sigma is the root mean square of errors over sigmas, for quantities that the check reports as excited. ± is its
scatter by chance; errors of one log are correlated. By chance the value of one quantity is within {low:.2f} to {high:.2f} in 95 % of
cells. Bold: off by more than 15 %.
"""
TIMES = """
## Time

Whole commands, from the shell, median of {repeats} alternating runs:
"""

if __name__ == "__main__":
    main()
