"""How fast a campaign is on one and on two cores, and how much memory it takes.

    python benchmarks/campaign.py > docs/campaign.md

Flies 1,000 logs of 400 cycles on the testbed in software (another number: ``--logs 60``), runs ``massprop batch`` on them with one
process and with two, and watches the memory of all its processes. Exits with 1 beyond a limit.
"""

import os
import platform
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from script import counted, cpu_s

FASTER = 1.7
"""Two processes on two cores, over one."""
MEMORY_MB = 400.0
"""Of all processes together, whatever the number of logs."""
_STEP_S = 0.05


@dataclass(frozen=True)
class Run:
    """Time and memory of one campaign; memory in MB (1e6 bytes)."""

    seconds: float
    cpu_s: float
    """Of all its processes; far less than the processes could have used in that time: something else was running."""
    parent: float
    """Peak resident memory of the command itself."""
    worker: float
    """... of its largest worker."""
    together: float
    """Peak of the sum over the command and its workers; pages that they share count for each."""


def resident(pid: int) -> float:
    """Resident memory of a process, MB; 0 once it is gone."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def children(pid: int) -> list[int]:
    """Child processes of a process."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()] + [
            int(child)
            for task in Path(f"/proc/{pid}/task").iterdir()
            if task.name != str(pid)
            for child in (task / "children").read_text().split()
        ]
    except OSError:
        return []


def batch(logs: Path, out: Path, jobs: int) -> Run:
    """Run one campaign and watch it."""
    command = [sys.executable, "-m", "massprop_cli", "batch", str(logs), "--out", str(out), "--jobs", str(jobs), "-q"]
    peak = {"parent": 0.0, "worker": 0.0, "together": 0.0}
    start, before = time.perf_counter(), cpu_s()
    process = subprocess.Popen(command)
    over = threading.Event()

    def watch() -> None:
        while not over.wait(_STEP_S):
            parent, workers = resident(process.pid), [resident(pid) for pid in children(process.pid)]
            peak["parent"] = max(peak["parent"], parent)
            peak["worker"] = max([peak["worker"], *workers])
            peak["together"] = max(peak["together"], parent + sum(workers))

    watcher = threading.Thread(target=watch)
    watcher.start()
    code = process.wait()
    seconds = time.perf_counter() - start
    over.set()
    watcher.join()
    if code:
        raise SystemExit(f"massprop batch --jobs {jobs} ended with {code}")
    return Run(seconds, cpu_s() - before, **peak)


def main() -> None:
    """Fly, run, print, judge."""
    logs = counted(__doc__, logs=1000).parse_args().logs
    with tempfile.TemporaryDirectory() as aside:
        folder = Path(aside)
        fly = [sys.executable, "-m", "massprop_cli", "simulate", "refined", "--seeds", str(logs), "--out", str(folder / "logs"), "-q"]
        subprocess.run(fly, check=True)
        few = batch(folder / "logs" / "seed-000[1-9]", folder / "few", 2)
        runs = {jobs: batch(folder / "logs", folder / f"out{jobs}", jobs) for jobs in (1, 2)}
        again = batch(folder / "logs", folder / "out2", 2)
    print_report(logs, few, runs, again)
    ratio = runs[1].seconds / runs[2].seconds
    failed = [f"two processes are only {ratio:.2f} times as fast as one"] if ratio < FASTER else []
    failed += [f"{run.together:.0f} MB" for run in runs.values() if run.together > MEMORY_MB]
    if failed:
        raise SystemExit("; ".join(failed))


def print_report(logs: int, few: Run, runs: dict[int, Run], again: Run) -> None:
    """Print docs/campaign.md."""
    machine = f"{os.cpu_count()} cores ({platform.machine()}, Python {platform.python_version()})"
    print(f"# Speed and memory of `massprop batch`\n\nMade by `python benchmarks/campaign.py > docs/campaign.md` on {machine}:")
    print(f"{logs:,} simulated logs of 400 cycles (scenario refined). Memory is resident memory, the sum over all processes;")
    print("libraries that the processes share count for each of them.\n")
    print("| campaign | time | CPU | logs per second | parent | largest worker | all together |\n|---|--:|--:|--:|--:|--:|--:|")
    rows = [("9 logs, --jobs 2", 9, few), *((f"{logs:,} logs, --jobs {jobs}", logs, run) for jobs, run in runs.items())]
    for name, count, run in [*rows, ("the same again, nothing changed", logs, again)]:
        memory = f"{run.parent:.0f} MB | {run.worker:.0f} MB | {run.together:.0f} MB"
        print(f"| {name} | {run.seconds:.1f} s | {run.cpu_s:.1f} s | {count / run.seconds:.1f} | {memory} |")
    ratio = runs[1].seconds / runs[2].seconds
    print(f"\nTwo processes do {ratio:.2f} times as much as one (limit: {FASTER:g}); memory stays below {MEMORY_MB:.0f} MB.")


if __name__ == "__main__":
    main()
