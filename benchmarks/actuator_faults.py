"""What is said of vehicles whose wheels, control moment gyros or rotors are not as stated: each fault on random vehicles.

    python benchmarks/actuator_faults.py --count 5 --jobs 2
    python benchmarks/actuator_faults.py --platform rotors --fault swapped --show

The motion is flown by simulators that share no code with the estimator (tests/anypedestal.py, tests/anyrotors.py); log or vehicle file has
the fault. Columns: logs whose fault is named, with another beside it or none; logs of which another cause is named; that say that the cause
is unknown or leave a discrepancy; logs of which nothing is said; values that are converged beyond 4 sigma.
"""

import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from script import counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli.base import onethread

onethread.prefer()

from massprop_cli.base.errors import InputError  # noqa: E402
from tests.faultyactuators import FAULTS, TABLES, Fault, Subject, examination, flights  # noqa: E402

WRONG = 4.0
"""Sigmas beyond which a converged value is wrong."""
UNKNOWN = ("cause-unknown", "model-discrepancy", "contradicted")
SAID = ("disturbance-torque", "gyro-misfit", "accelerometer-misfit", "model-misfit")
"""Codes that name no cause."""


class Told(NamedTuple):
    """What massprop reports on one log."""

    status: str
    codes: tuple[str, ...]
    wrong: int
    worst: float
    given: int
    messages: tuple[str, ...]
    cpu_s: float


def told(platform: str, name: str, seed: int, count: int) -> list[Told]:
    """What massprop reports on each of ``count`` random vehicles with this fault."""
    fault = FAULTS[name]
    found = []
    for i, begun in enumerate(flights(platform, seed, count, fault)):
        of = begun if fault.state is None else fault.state(begun, np.random.default_rng([seed, i, 7]))
        found.append(_said(fault, of, np.random.default_rng([seed, i, 3])))
    return found


def _said(fault: Fault, of: Subject, draw: np.random.Generator) -> Told:
    start = time.process_time()
    try:
        answer = examination(of, draw)
    except InputError as error:
        return Told("refused", (), 0, 0.0, 0, (str(error),), 0.0)
    spent, conclusion = time.process_time() - start, answer.conclusions[0]
    items = conclusion.about_pivot if answer.vehicle.on_pedestal else conclusion.estimates
    told_of = {key: one for key, one in items.items() if one.verdict == "converged" and one.value is not None and one.sigma}
    z = [abs(((one.value or 0.0) - of.truth[key]) / (one.sigma or 1.0)) for key, one in told_of.items()]
    codes = tuple(dict.fromkeys(notice.code for notice in answer.notices))
    named = any(code in fault.codes for code in codes)
    other = [code for code in codes if code not in (*fault.codes, *UNKNOWN, *SAID) and not code.startswith(("noise-", "initial-"))]
    status = "named" if named else "other" if other else "unknown" if any(code in UNKNOWN for code in codes) else "nothing"
    messages = tuple(f"{notice.code}: {notice.message}" for notice in answer.notices)
    return Told(status, codes, sum(value > WRONG for value in z), max(z, default=0.0), len(z), messages, spent)


def main() -> None:
    """Print the table."""
    parser = counted(__doc__, count=5, seed=0, jobs=1)
    parser.add_argument("--platform", action="append", choices=list(TABLES))
    parser.add_argument("--fault", action="append", choices=list(FAULTS))
    parser.add_argument("--show", action="store_true", help="what is said of each")
    asked = parser.parse_args()
    tasks = [
        (platform, name) for platform in asked.platform or TABLES for name in asked.fault or FAULTS if platform in FAULTS[name].platforms
    ]
    print("| platform | fault | named | other | unknown | nothing | refused | wrong | of converged | worst | CPU s | codes |")
    print("|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|")
    with ProcessPoolExecutor(asked.jobs) as pool:
        running = [pool.submit(told, *task, asked.seed, asked.count) for task in tasks]
        for task, one in zip(tasks, running, strict=True):
            print(_row(task, one.result()), flush=True)
            for said in one.result() if asked.show else ():
                print(f"- {said.status}, {said.wrong} of {said.given} wrong, worst {said.worst:.1f}, {said.cpu_s:.1f} s")
                print(*(f"    {text[:500]}" for text in said.messages), sep="\n")


def _row(what: tuple[str, str], group: list[Told]) -> str:
    counts = Counter(one.status for one in group)
    numbers = [counts[status] for status in ("named", "other", "unknown", "nothing", "refused")]
    codes = Counter(code for one in group for code in one.codes)
    cells = [*what[:1], FAULTS[what[1]].what, *numbers, sum(one.wrong for one in group), sum(one.given for one in group)]
    cells += [
        f"{max(one.worst for one in group):.1f}",
        f"{np.mean([one.cpu_s for one in group]):.1f}",
        ", ".join(f"{c} {n}" for c, n in codes.items()),
    ]
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main()
