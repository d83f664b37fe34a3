"""What `massprop check` says of the logs of the fault benchmark and of clean ones, beside what `massprop estimate` says, and its time.

    python benchmarks/check.py --clean 25 > docs/check.md
    python benchmarks/check.py --vehicle jets --vehicle bearing --clean 25 > docs/check.md

Faults are drawn as in benchmarks/faults.py, one seed of each kind on each vehicle.
"""

from __future__ import annotations

import argparse
import resource
import shlex
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from massprop_cli.base import onethread

onethread.prefer()

import numpy as np  # noqa: E402
from commit import commit  # noqa: E402
from correlated import deviate, rms  # noqa: E402
from fault_kinds import FAULTS  # noqa: E402
from fault_named import CAUSES  # noqa: E402
from fault_runs import warm_up  # noqa: E402
from fault_vehicles import VEHICLES, Case, subject  # noqa: E402

from massprop_cli import __version__, flow  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.base.errors import InputError  # noqa: E402
from massprop_cli.check.attitude import attitude  # noqa: E402
from massprop_cli.check.commands import commands  # noqa: E402
from massprop_cli.check.finding import Finding  # noqa: E402
from massprop_cli.check.flow import noticed  # noqa: E402
from massprop_cli.check.sampling import sampling  # noqa: E402
from massprop_cli.check.sensors import sensors  # noqa: E402
from massprop_cli.flow import Analysis  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402

SAMPLES = Path(__file__).parents[1] / "sample_logs"
LOGS = ("free-flyer", "air-bearing", "docking", "high-rate")
REPEATS = 5


@dataclass(frozen=True)
class Said:
    """What both say of one log."""

    estimate: frozenset[str]
    """Causes that are named."""
    check: tuple[Finding, ...]
    own: frozenset[str]
    """Codes of what the check finds by itself, without an estimate."""
    found: Analysis | None

    @property
    def missed(self) -> frozenset[str]:
        """Causes that estimate names and check doesn't."""
        return self.estimate - {one.code for one in self.check}


def said(case: Case, name: str) -> Said:
    """Both of one log."""
    looked = [*sampling(case.log.time_s, str), *sensors(case.log, case.vehicle, str)]
    looked += [*commands(case.log, case.vehicle, str), *attitude(case.log, case.vehicle)]
    own = frozenset(one.code for one in looked)
    try:
        with np.errstate(all="ignore"):
            found = flow.examine(case.log, VehicleSource(case.vehicle, name, ""))
    except InputError:
        return Said(frozenset(), tuple(looked), own, None)
    named = frozenset(notice.code for notice in found.notices) & CAUSES
    return Said(named, (*looked, *noticed(found, set(own))), own, found)


def faulty(fault: str, vehicle: str, seed: int) -> Said | None:
    """One fault as the fault benchmark draws it; None where the vehicle can't have it."""
    flown = subject(vehicle, seed)
    drawn = FAULTS[fault].draw(flown, np.random.default_rng([seed, zlib.crc32(f"{fault} {vehicle}".encode())]))
    return None if drawn is None else said(drawn.case, vehicle)


def deviates(found: Analysis, truth: Sequence[Array]) -> list[tuple[Array, float]]:
    """(10,) error of each quantity over its sigma, of each phase, and the variance of their mean square as they are correlated."""
    made = []
    for conclusion, true in zip(found.conclusions, truth, strict=True):
        made.append(deviate(conclusion.values - true, conclusion.covariance))
    return made


def times() -> list[str]:
    """CPU time of the two commands, from the shell to the end, on sample logs."""
    lines = ["| log | `estimate` [s of CPU] | `check` [s of CPU] | ratio |", "|---|--:|--:|--:|"]
    with tempfile.TemporaryDirectory() as out:
        for name in LOGS:
            log = str(SAMPLES / name / "log.parquet")
            # by turns, so that a busy machine is as busy for both
            spent = np.array([[cpu("estimate", log, "-q", "--out", out), cpu("check", log, "-q")] for _ in range(REPEATS)])
            estimate, check = np.median(spent, 0)
            lines.append(f"| {name} | {estimate:.2f} | {check:.2f} | {check / estimate:.2f} |")
    return lines


def cpu(*arguments: str) -> float:
    """Seconds that a command takes."""

    def spent() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    begin = spent()
    subprocess.run([sys.executable, "-m", "massprop_cli", *arguments], check=False, capture_output=True)
    return spent() - begin


def fault_table(runs: dict[tuple[str, str], Said]) -> list[str]:
    """A line for each kind of fault."""
    lines = ["| fault | logs | named by `estimate` | of these by `check` | seen by `check` without an estimate |", "|---|--:|--:|--:|---|"]
    for fault in dict.fromkeys(fault for fault, _ in runs):
        mine = [one for (kind, _), one in runs.items() if kind == fault]
        naming = [one for one in mine if one.estimate]
        own = sorted({code for one in mine for code in one.own})
        seen = ", ".join(f"{code} {sum(code in one.own for one in mine)}" for code in own)
        kept = sum(not one.missed for one in naming)
        lines.append(f"| {fault}: {FAULTS[fault].what} | {len(mine)} | {len(naming)} | {kept} | {seen} |")
    every = list(runs.values())
    naming = [one for one in every if one.estimate]
    kept, looked = sum(not one.missed for one in naming), sum(bool(one.own) for one in every)
    lines.append(f"| all | {len(every)} | {len(naming)} | {kept} | {looked} logs |")
    return lines


def clean_table(vehicles: Sequence[str], seeds: range) -> list[str]:
    """What is said of clean logs, and whether the sigmas that are told of them hold."""
    lines = ["| vehicle | clean logs | with a fault found | with a note | achieved / expected sigma |", "|---|--:|--:|--:|--:|"]
    for vehicle in vehicles:
        faults, notes, off = 0, 0, list[tuple[Array, float]]()
        for seed in seeds:
            case = subject(vehicle, seed).clean
            one = said(case, vehicle)
            codes = {finding.grade for finding in one.check if finding.code not in VEHICLES[vehicle].said}
            faults, notes = faults + bool(codes - {"note"}), notes + ("note" in codes)
            if one.found is not None:
                off += deviates(one.found, [body.values for body in case.bodies])
        lines.append(f"| {vehicle} | {len(seeds)} | {faults} | {notes} | {rms(off)} |")
    return lines


def main() -> None:
    """Faults, clean logs, time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", action="append", choices=list(VEHICLES), help="may be repeated")
    parser.add_argument("--fault", action="append", choices=list(FAULTS), help="may be repeated")
    parser.add_argument("--seed", type=int, default=1001, help="of the faults, and the first of the clean logs")
    parser.add_argument("--clean", type=int, default=25, help="clean logs of each vehicle")
    arguments = parser.parse_args()
    vehicles = arguments.vehicle or list(VEHICLES)
    warm_up()
    command = shlex.join(["python", "benchmarks/check.py", *sys.argv[1:]])
    print(HEAD.format(command=command, version=__version__, commit=commit(), seed=arguments.seed))
    runs = {}
    for vehicle in vehicles:
        for fault in arguments.fault or FAULTS:
            one = faulty(fault, vehicle, arguments.seed)
            if one is not None:
                runs[fault, vehicle] = one
        print(f"{vehicle} done", file=sys.stderr, flush=True)
    print("\n".join(fault_table(runs)), "\n")
    print("\n".join(clean_table(vehicles, range(arguments.seed, arguments.seed + arguments.clean))), "\n", flush=True)
    print(TIMES)
    print("\n".join(times()))


HEAD = """# What a check says

Made by `{command}` at commit {commit} (massprop {version}), seed {seed}. Faults are those of [faults.md](faults.md). What
`estimate` names is in every check; what stands in the last column is seen in the log itself, before any estimate.
"""
TIMES = """Achieved over expected sigma is the root mean square of all errors over the sigmas that go with them, and ± how far it scatters
by chance, as the errors of a log are correlated.

The whole command, from the shell on, the median of 5 runs by turns:
"""

if __name__ == "__main__":
    main()
