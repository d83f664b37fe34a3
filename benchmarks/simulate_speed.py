"""How long the simulator takes: a 20 s scenario for one seed, and per seed in a batch of 200.

    python benchmarks/simulate_speed.py > docs/simulate-speed.md

Times are of the simulation alone, without start-up and files; the least of several runs, on whatever machine this is.
"""

import os
import platform
import time

import numpy as np

from massprop_cli.testbed import scenario, simulate

LIMITS = {"one seed": 0.5, "per seed in a batch of 200": 0.020}
"""s; what the simulator is held to for a 20 s scenario."""


def least(source: scenario.ScenarioSource, seeds: range, runs: int) -> float:
    """The shortest of ``runs`` times, s."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        simulate.fly(source, seeds)
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Time every packaged scenario, the thesis's two of 20 s first."""
    machine = f"{os.cpu_count()} cores ({platform.machine()}, Python {platform.python_version()}, numpy {np.__version__})"
    print(f"# Speed of `massprop simulate`\n\nMade by `python benchmarks/simulate_speed.py > docs/simulate-speed.md` on {machine};")
    print("simulation alone, without start-up and files, least of several runs, in s.")
    print("\n| scenario | length | cycles | one seed | per seed in a batch of 200 |\n|---|--:|--:|--:|--:|")
    failed = []
    for name in ("preliminary", "refined", "testbed", "free-flyer", "docking"):
        source = scenario.load(name)
        length = source.scenario.cycles * source.scenario.vehicle.cycle.period_s
        found = {"one seed": least(source, range(1, 2), 5), "per seed in a batch of 200": least(source, range(1, 201), 1) / 200}
        print(f"| {name} | {length:g} s | {source.scenario.cycles} | " + " | ".join(f"{seconds:.4f}" for seconds in found.values()) + " |")
        if length <= 20:
            failed += [f"{name}, {what}: {found[what]:.3g} s, above {limit:g} s" for what, limit in LIMITS.items() if found[what] > limit]
    print("\nA 20 s scenario is held to " + " and ".join(f"{limit:g} s {what}" for what, limit in LIMITS.items()) + ".")
    if failed:
        raise SystemExit("; ".join(failed))


if __name__ == "__main__":
    main()
