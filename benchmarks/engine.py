"""How long an estimate takes and how much memory, against the length of its log, clean and imperfect.

    python benchmarks/engine.py > docs/engine.md
    python benchmarks/engine.py --longest 720000 > docs/engine.md     # ten hours at 20 Hz; flying them takes an hour

The free-flyer scenario, its plan flown again and again. Times are the command's own wall time over that of ``import pandas`` in the same
run, the least of several, since machines differ and are shared; memory is the largest resident set of the process. Python keeps what it
has compiled, as of an installed package.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from script import KEPT, commit, counted

from massprop_cli import __version__
from massprop_cli.testbed import output, scenario, simulate

LENGTHS = (400, 1200, 4800, 12000, 24000, 72000, 720000)
KINDS = {
    "clean": (),
    "recorded at 400 Hz": ("sensors.records_per_cycle=20",),
    "a jet's sign flipped": ('actuators.failures=[{jet="yaw_p1", thrust=-1.0}]',),
    "a torque that nobody stated": ("disturbance.torque_n_m=0.01",),
}
RUNS = 3
LAUNCH = (
    "import resource, subprocess, sys, time\n"
    "began = time.perf_counter()\n"
    "subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)\n"
    "print(time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)"
)
"""Runs a command from a small process: Linux counts the memory of the one that starts it as the command's own, and this one flies logs."""


def flown(cycles: int, changes: tuple[str, ...], folder: Path) -> Path:
    """The path of a log with this number of cycles."""
    source = scenario.load("free-flyer", changes)
    one = source.scenario
    plan = [
        segment.model_copy(update={"start_cycle": start + again, "end_cycle": min(end + again, cycles), "start_s": None, "end_s": None})
        for again in range(0, cycles, one.cycles)
        for segment in one.plan
        for start, end in [segment.cycles(one.vehicle.cycle.period_s)]
        if start + again < cycles
    ]
    longer = one.model_copy(update={"plan": tuple(plan), "duration_s": None, "duration_cycles": cycles})
    output.write(simulate.fly(scenario.ScenarioSource(longer, source.source), [1]), 0, longer, folder)
    return folder / "log.parquet"


def run(command: list[str]) -> tuple[float, float]:
    """Wall time in s and largest resident set in MB of one run."""
    launched = [sys.executable, "-S", "-c", LAUNCH, *command]
    seconds, memory = subprocess.run(launched, capture_output=True, text=True, check=True, env=KEPT).stdout.split()
    return float(seconds), float(memory)


def least(command: list[str]) -> tuple[float, float]:
    """The shortest of several runs."""
    return min(run(command) for _ in range(RUNS))


def main() -> None:
    """Print one row for each length and kind of log."""
    parser = counted(__doc__)
    parser.add_argument("--longest", type=int, default=12000, help="cycles")
    longest = parser.parse_args().longest
    print("# The estimator's time and memory\n")
    print(
        f"Made by `python benchmarks/engine.py > docs/engine.md` at commit {commit()} (massprop {__version__}): `massprop estimate` on the"
    )
    print(f"free-flyer scenario flown again and again, least of {RUNS} runs, over `import pandas` in the same run.\n")
    print("| cycles | log | time / import pandas | time / clean log | memory, MB |\n|--:|---|--:|--:|--:|")
    with tempfile.TemporaryDirectory() as place:
        pandas, _ = least([sys.executable, "-c", "import pandas"])
        for cycles in (length for length in LENGTHS if length <= longest):
            clean = None
            for kind, changes in KINDS.items():
                log = flown(cycles, changes, Path(place) / f"{cycles}-{len(kind)}")
                command = [sys.executable, "-m", "massprop_cli", "estimate", str(log), "--out", str(log.parent / "out"), "-q"]
                seconds, memory = least(command)
                clean = clean or seconds
                print(f"| {cycles} | {kind} | {seconds / pandas:.1f} | {seconds / clean:.1f} | {memory:.0f} |", flush=True)


if __name__ == "__main__":
    main()
