"""Errors and sigmas on a table that is out of level, over many seeds, against the Cramér–Rao bound.

    python benchmarks/planar.py > docs/planar-accuracy.md

The packaged scenario "planar", with as much of the weight's pull along the slope held, and so felt, as each case says.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from commit import commit

from massprop_cli import QUANTITIES, UNITS, __version__, flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import bound, scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource

CASES = {
    "the vehicle slides freely": (0.0, 0.01),
    "all of the weight's pull is held": (1.0, 0.01),
    "all of it is held, and the table is taken as level (environment.table_tilt_sigma_rad = 0)": (1.0, 0.0),
}
"""``disturbance.table_hold`` of the scenario, and the vehicle file's sigma of a tilt, rad."""
TOLD = [QUANTITIES.index(name) for name in ("izz", "cg_x", "cg_y", "mass")]


@dataclass(frozen=True)
class Run:
    """Error, sigma and bound of one seed in one case, (4,) each."""

    error: Array
    sigma: Array
    bound: Array
    verdicts: tuple[str, ...]


def one(seed: int) -> list[Run]:
    """Fly and estimate every case; the bound is the same for all."""
    runs: list[Run] = []
    for case, (hold, tilt_sigma_rad) in CASES.items():
        source = on_table(hold, tilt_sigma_rad)
        flown = simulate.fly(source, [seed])
        limit = runs[0].bound if runs else np.sqrt(np.diag(bound.cramer_rao(source, flown, 0)[0]))[TOLD]
        found = flow.examine(flown.log(0), VehicleSource(flown.vehicle, case, "")).conclusions[0]
        error = found.values - flown.truth[0][0]
        verdicts = tuple(found.estimates[QUANTITIES[i]].verdict for i in TOLD)
        runs.append(Run(error[TOLD], np.sqrt(np.diag(found.covariance))[TOLD], limit, verdicts))
    return runs


def on_table(hold: float, tilt_sigma_rad: float) -> ScenarioSource:
    """The packaged scenario with another hold."""
    source = scenario.load("planar")
    environment = source.scenario.vehicle.environment.model_copy(update={"table_tilt_sigma_rad": tilt_sigma_rad})
    changes = {
        "disturbance": source.scenario.disturbance.model_copy(update={"table_hold": hold}),
        "vehicle": source.scenario.vehicle.model_copy(update={"environment": environment}),
    }
    return ScenarioSource(source.scenario.model_copy(update=changes), source.source)


def report(case: str, runs: Sequence[Run]) -> str:
    """One case as Markdown."""
    error, sigma, limit = (np.array([getattr(run, name) for run in runs]) for name in ("error", "sigma", "bound"))
    z, ceiling = error / sigma, np.sqrt((limit**2).mean(0))
    lines = [f"## {case[0].upper()}{case[1:]}", ""]
    lines.append("| | bound | bias | rms error | rms / bound | sigma / bound | z rms | 95 % covers | verdicts |")
    lines.append("|---|--:|--:|--:|--:|--:|--:|--:|---|")
    for j, i in enumerate(TOLD):
        rms = np.sqrt((error[:, j] ** 2).mean())
        counts = Counter(run.verdicts[j] for run in runs)
        cells = [f"{QUANTITIES[i]} [{UNITS[QUANTITIES[i]]}]", f"{ceiling[j]:.2g}", f"{error[:, j].mean():.2g}", f"{rms:.2g}"]
        cells += [f"{rms / ceiling[j]:.2f}", f"{np.median(sigma[:, j] / limit[:, j]):.2f}", f"{np.sqrt((z[:, j] ** 2).mean()):.2f}"]
        cells += [f"{100 * (np.abs(z[:, j]) <= 1.96).mean():.1f} %", ", ".join(f"{v} {n}" for v, n in sorted(counts.items()))]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", f"Over the four together the 95 % intervals cover {100 * (np.abs(z) <= 1.96).mean():.1f} %.", ""]
    return "\n".join(lines)


def main() -> None:
    """All cases, all seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--workers", type=int)
    arguments = parser.parse_args()
    print(HEAD.format(seeds=arguments.seeds, version=__version__, commit=commit()))
    with ProcessPoolExecutor(arguments.workers) as pool:
        runs = list(pool.map(one, range(1, arguments.seeds + 1)))
    for i, case in enumerate(CASES):
        print(report(case, [run[i] for run in runs]))


HEAD = """# On a table that is out of level, over {seeds} seeds

Made by `python benchmarks/planar.py > docs/planar-accuracy.md` at commit {commit} (massprop {version}). A floating platform on a table
that is turned by 0.21 degrees about X and about Y, 0.3 degrees together. The bound is each log's own Cramér–Rao bound (initial rate
unknown, IMU noise alone, the slope known); rms / bound the root mean square error over it, sigma / bound the median claim over it, z the
error over the claimed sigma (1 is honest); of 100 intervals of 95 %, 88 to 100 hold the truth by chance (three standard deviations). What
the environment is and what its keys mean: [planar.md](planar.md).
"""

if __name__ == "__main__":
    main()
