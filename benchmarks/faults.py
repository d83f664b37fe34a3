"""How faults of logs and vehicle files are named: each kind on each vehicle, seed by seed, and what is said of logs without any.

    python benchmarks/faults.py --seeds 10 > docs/faults.md
    python benchmarks/faults.py --seeds 0 --clean 125
    python benchmarks/faults.py --fault jet-dead --vehicle bearing --first 1003 --seeds 1 --show

Jet, axis, sign, size and time are drawn from kind, vehicle and seed.
"""

import argparse
import statistics
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor

from massprop_cli.base import onethread

onethread.prefer()

from fault_kinds import FAULTS  # noqa: E402
from fault_named import CAUSES  # noqa: E402
from fault_runs import LONG, TIMES, WRONG, Clean, Run, Status, clean, overhead, run, warm_up  # noqa: E402
from fault_vehicles import VEHICLES  # noqa: E402
from script import commit, counted  # noqa: E402

from massprop_cli import __version__  # noqa: E402

MARKS: dict[Status, str] = {
    "right": "✓",
    "half": "½",
    "wrong": "✗",
    "unknown": "?",
    "silent": "–",
    "harmless": "○",
    "hidden": "∅",
    "refused": "refused",
    "crash": "crash",
}
SLOWEST = 3.0
"""Times its clean twin's CPU time that a log may take."""


def main() -> None:
    """Print the tables of faults, then of clean logs."""
    arguments = _arguments()
    vehicles = arguments.vehicle or list(VEHICLES)
    faults = _chosen(arguments.fault)
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    tasks = [(fault, vehicle, seed) for vehicle in vehicles for seed in seeds for fault in faults]
    if not arguments.show:
        told: dict[str, object] = {"version": __version__, "commit": commit(), "long": LONG, "more": 1 + TIMES}
        told |= {"plain": overhead(()), "faulty": overhead(WRONG)}  # before the pool, whose processes know it then
        print(HEAD.format(**told, first=arguments.first, last=seeds[-1] if seeds else "none"))
    with ProcessPoolExecutor(arguments.jobs, initializer=warm_up) as pool:
        if arguments.show:
            for found in pool.map(run, *zip(*tasks, strict=True)):
                if found is not None:
                    print(_shown(found), flush=True)
            return
        runs = []
        # the faults of one vehicle and seed are one piece of work: they share its clean flight
        for done, found in enumerate(pool.map(run, *zip(*tasks, strict=True), chunksize=max(len(faults), 1)), 1):
            runs += [] if found is None else [found]
            if done % len(faults) == 0:
                print(f"{done} of {len(tasks)}", file=sys.stderr, flush=True)
        if runs:
            print(_matrix(runs, faults, vehicles))
            print(_totals(runs, vehicles))
            print(_misses(runs))
        if arguments.clean:
            logs = [(vehicle, seed) for vehicle in vehicles for seed in range(arguments.first, arguments.first + arguments.clean)]
            print(_clean_table(logs, list(pool.map(clean, *zip(*logs, strict=True), chunksize=8))))


def _arguments() -> argparse.Namespace:
    parser = counted(__doc__)
    parser.add_argument("--seeds", type=int, default=10, help="of each fault on each vehicle")
    parser.add_argument("--first", type=int, default=1001, help="seed")
    parser.add_argument("--clean", type=int, default=0, metavar="N", help="seeds of each vehicle without fault")
    parser.add_argument("--fault", action="append", help=f"by name, may be repeated: {', '.join(FAULTS)}")
    parser.add_argument("--vehicle", action="append", choices=list(VEHICLES), help="may be repeated")
    parser.add_argument("--jobs", type=int, default=None, help="processes")
    parser.add_argument("--show", action="store_true", help="what was said of each run, and its values in sigmas")
    return parser.parse_args()


def _chosen(asked: Sequence[str] | None) -> list[str]:
    """Names of the chosen kinds of fault."""
    if not asked:
        return list(FAULTS)
    unknown = sorted(set(asked) - set(FAULTS))
    if unknown:
        sys.exit(f"--fault {unknown[0]}: not one of {', '.join(FAULTS)}")
    return [name for name in FAULTS if name in asked]


def _shown(found: Run) -> str:
    lines = [f"{found.fault} on {found.vehicle}, seed {found.seed}: {found.status}; {found.what}"]
    lines += [f"  said      {notice.code}: {notice.message}" for notice in found.notices]
    lines += [
        f"  {v.phase:9} {v.name:5} {v.value:12.6g} ± {v.sigma:<10.3g} truth {v.true:12.6g} {abs(v.off):9.1f} sigma  {v.verdict}"
        + " !" * v.good
        for v in found.values
    ]
    times = f"{found.ratio:.1f} times the clean twin's, {found.command_ratio:.1f} times as a whole command"
    lines.append(f"  corrected right: {found.mended}; {found.seconds:.2f} s of CPU, {times}")
    return "\n".join(lines)


def _matrix(runs: Sequence[Run], faults: Sequence[str], vehicles: Sequence[str]) -> str:
    lines = [f"| fault | {' | '.join(vehicles)} | corrected right | time | command |", "|---|" + "---|" * len(vehicles) + "--:|--:|--:|"]
    for fault in faults:
        own = [r for r in runs if r.fault == fault]
        if own:
            cells = [_cell([r for r in own if r.vehicle == vehicle]) for vehicle in vehicles]
            mended = f"{sum(r.mended for r in own if r.status == 'right')} of {sum(r.status == 'right' for r in own)}"
            slow = f"{_spread([r.ratio for r in own])} | {_spread([r.command_ratio for r in own])}"
            lines.append(f"| {fault}: {FAULTS[fault].what} | {' | '.join(cells)} | {mended} | {slow} |")
    return "\n".join(lines) + "\n"


def _cell(runs: Sequence[Run]) -> str:
    if not runs:
        return ""
    counted = Counter(r.status for r in runs)
    parts = [f"{counted[status]}{mark}" for status, mark in MARKS.items() if counted[status]]
    good = sum(bool(r.good) for r in runs)
    return " ".join(parts) + (f" **{good}!**" if good else "")


def _totals(runs: Sequence[Run], vehicles: Sequence[str]) -> str:
    lines = [TOTALS_HEAD]
    for name in (*vehicles, "all"):
        own = [r for r in runs if name in (r.vehicle, "all")]
        if own:
            lines.append(f"| {name} | {_total(own)} |")
    return "\n".join(lines) + "\n"


def _total(runs: Sequence[Run]) -> str:
    answered = [r for r in runs if r.status not in ("refused", "crash")]
    telling = [r for r in answered if r.harm and r.status != "hidden" and r.fault != "all-scale"]
    right, wrong = sum(r.status == "right" for r in telling), sum(r.status == "wrong" for r in runs)
    named = [r for r in answered if r.status == "right"]
    ratios, whole = [r.ratio for r in answered] or [float("nan")], [r.command_ratio for r in answered] or [float("nan")]
    return " | ".join(
        (
            str(len(runs)),
            f"{right} of {len(telling)}{_percent(right, len(telling))}",
            f"{wrong}{_percent(wrong, len(runs))}",
            str(sum(bool(r.good) for r in runs)),
            f"{sum(r.mended for r in named)} of {len(named)}",
            f"{_spread(ratios)}; {sum(r > SLOWEST for r in ratios)}",
            f"{_spread(whole)}; {sum(r > SLOWEST for r in whole)}",
            str(sum(r.status in ("refused", "crash") for r in runs)),
        )
    )


def _spread(ratios: Sequence[float]) -> str:
    return f"{statistics.median(ratios):.1f}, {max(ratios):.1f}"


def _percent(part: int, whole: int) -> str:
    return f" ({100 * part / whole:.1f} %)" if whole else ""


def _misses(runs: Iterable[Run]) -> str:
    """What to look at with ``--show``, in comments."""
    lines = []
    for r in runs:
        if r.status not in ("right", "harmless", "hidden") or r.good:
            causes = sorted({n.code for n in r.notices if n.code in CAUSES})
            good = f"; looks good: {' '.join(sorted(set(r.good)))}" if r.good else ""
            lines.append(f"{r.fault} {r.vehicle} {r.seed} {r.status}: {r.what}; named {' '.join(causes) or 'nothing'}{good}")
    return "<!--\n" + "\n".join(lines) + "\n-->\n"


def _clean_table(logs: Sequence[tuple[str, int]], found: Sequence[Clean]) -> str:
    lines = [CLEAN_HEAD]
    for vehicle in dict.fromkeys(name for name, _ in logs):
        own = [(seed, one) for (name, seed), one in zip(logs, found, strict=True) if name == vehicle]
        counted = Counter(code for _, one in own for code in one.codes)
        said = ", ".join(f"{code} {n}" for code, n in counted.most_common()) or "none"
        converged, told, wrong = (sum(getattr(one, name) for _, one in own) for name in ("converged", "told", "wrong"))
        at = [str(seed) for seed, one in own if one.codes or one.wrong]
        row = f"| {vehicle} | {len(own)} | {said} | {converged} of {told} | {wrong} |"
        lines.append(row + (f" <!-- {' '.join(at)} -->" if at else ""))
    lines.append(f"\n{sum(bool(one.codes) for one in found)} of {len(found)} clean logs have a cause named.")
    return "\n".join(lines)


HEAD = """# Faults named, and false alarms

Made by `python benchmarks/faults.py` at commit {commit} (massprop {version}), seeds {first} to {last}. Each kind of fault is flown on each
vehicle, once per seed; jet, axis, sign, size and time change with the seed. A cell counts runs:

| | |
|---|---|
| ✓ | massprop names the right cause (its code, and the jet, axis, delay or unit in its text) and no other; ½ one of two causes at once |
| ✗ | massprop names a wrong cause |
| ? | massprop reports a misfit without a cause |
| – | a value is more than 4 sigma off, without a warning (it may be not_converged) |
| ○ | no value is more than 4 sigma off, and massprop names no cause, as it should |
| ∅ | a value is more than 4 sigma off, but the log does not show the fault: its chi-square in the off-line fit is below 25 |
| **n!** | runs with a converged value that is more than 4 sigma and 0.5 % of its size off |

Where the mass properties change, the error of a value is that from the nearest true value at any time. Time is CPU time over that of the
same log without the fault (the clean log), median and maximum: first of the estimate alone, then of the whole `massprop estimate`. Times of
clean logs, and of commands of more than {long:g} times the clean one, are the least of {more} runs. Start and output take {plain:.2f} s of
CPU, {faulty:.2f} s for a log with a fault.
"""
TOTALS_HEAD = """Goals: 95 % right (80 % on noisy and disturbed), at most 1 % wrong, no converged value that is wrong, no time over 3.

| vehicle | runs | right, of visible harm | wrong cause | converged, wrong | corrected right | time; over 3 | command; over 3 | refused |
|---|--:|--:|--:|--:|--:|--:|--:|--:|"""
CLEAN_HEAD = """
| without fault | logs | causes named | values called converged | and wrong |
|---|--:|---|--:|--:|"""

if __name__ == "__main__":
    main()
