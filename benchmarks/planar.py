"""Errors and sigmas on a table that is out of level, over many seeds, against the Cramér–Rao bound.

    python benchmarks/planar.py > docs/planar-accuracy.md

The packaged scenario "planar", with as much of the weight's pull along the slope held, and so felt, as each case says. All seeds of a case
are flown at once.
"""

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scores import columns, covered
from script import commit, counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli import QUANTITIES, UNITS, __version__, flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from tests import cramerrao

CASES = {
    "the vehicle slides freely": (0.0, 0.01),
    "all of the weight's pull is held": (1.0, 0.01),
    "all of it is held, and the table is taken as level (environment.table_tilt_sigma_rad = 0)": (1.0, 0.0),
}
"""``disturbance.table_hold`` of the scenario, and the vehicle file's sigma of a tilt, rad."""
TOLD = [QUANTITIES.index(name) for name in ("izz", "cg_x", "cg_y", "mass")]


TOGETHER = 10
"""Seeds whose bounds are found side by side: what memory bears."""


@dataclass(frozen=True)
class Run:
    """Error and sigma of one seed in one case, (4,) each."""

    error: Array
    sigma: Array
    verdicts: tuple[str, ...]


def bounds(seeds: int) -> Array:
    """(S, 4) each seed's Cramér–Rao bound: the same in every case, for the slope is known."""
    source = on_table(0.0, 0.0)
    flown = simulate.fly(source, range(1, seeds + 1))
    parts = [cramerrao.of_members(source, flown, slice(first, first + TOGETHER))[:, 0] for first in range(0, seeds, TOGETHER)]
    found: Array = np.sqrt(np.diagonal(np.concatenate(parts), axis1=1, axis2=2))[:, TOLD]
    return found


def runs_of(case: str, seeds: int) -> list[Run]:
    """Fly and estimate one case."""
    flown, runs = simulate.fly(on_table(*CASES[case]), range(1, seeds + 1)), []
    for member in range(seeds):
        found = flow.examine(flown.log(member), VehicleSource(flown.vehicle, case, "")).conclusions[0]
        verdicts = tuple(found.estimates[QUANTITIES[i]].verdict for i in TOLD)
        runs.append(Run((found.values - flown.truth[member, 0])[TOLD], np.sqrt(np.diag(found.covariance))[TOLD], verdicts))
        print(f"{case} {member + 1}/{seeds}", end="\r", file=sys.stderr)
    return runs


def on_table(hold: float, tilt_sigma_rad: float) -> ScenarioSource:
    """The packaged scenario with this hold and this stated sigma of the tilt."""
    source = scenario.load("planar")
    environment = source.scenario.vehicle.environment.model_copy(update={"table_tilt_sigma_rad": tilt_sigma_rad})
    changes = {
        "disturbance": source.scenario.disturbance.model_copy(update={"table_hold": hold}),
        "vehicle": source.scenario.vehicle.model_copy(update={"environment": environment}),
    }
    return ScenarioSource(source.scenario.model_copy(update=changes), source.source)


def report(case: str, runs: Sequence[Run], limit: Array) -> str:
    """One case as Markdown; ``limit`` (S, 4) are the bounds."""
    error, sigma = (np.array([getattr(run, name) for run in runs]) for name in ("error", "sigma"))
    lines = [f"## {case[0].upper()}{case[1:]}", ""]
    lines.append("| | bound | bias | rms error | rms / bound | sigma / bound | z rms | 95 % covers | verdicts |")
    lines.append("|---|--:|--:|--:|--:|--:|--:|--:|---|")
    for j, i in enumerate(TOLD):
        counts = Counter(run.verdicts[j] for run in runs)
        cells = [f"{QUANTITIES[i]} [{UNITS[QUANTITIES[i]]}]", *columns(error[:, j], sigma[:, j], limit[:, j])]
        lines.append(f"| {' | '.join(cells)} | {', '.join(f'{v} {n}' for v, n in sorted(counts.items()))} |")
    lines += ["", f"Over the four together the 95 % intervals cover {covered(error / sigma)}.", ""]
    return "\n".join(lines)


def main() -> None:
    """All cases, all seeds."""
    arguments = counted(__doc__, seeds=100).parse_args()
    print(HEAD.format(seeds=arguments.seeds, version=__version__, commit=commit()))
    limit = bounds(arguments.seeds)
    for case in CASES:
        print(report(case, runs_of(case, arguments.seeds), limit), flush=True)


HEAD = """# On a table that is out of level, over {seeds} seeds

Made by `python benchmarks/planar.py > docs/planar-accuracy.md` at commit {commit} (massprop {version}). A floating platform on a table
that is turned by 0.21 degrees about X and about Y, 0.3 degrees together. The bound is each log's own Cramér–Rao bound (initial rate
unknown, IMU noise alone, the slope known); rms / bound the root mean square error over it, sigma / bound the median claim over it, z the
error over the claimed sigma (1 is honest); of 100 intervals of 95 %, 88 to 100 hold the truth by chance (three standard deviations). What
the environment is and what its keys mean: [planar.md](planar.md).
"""

if __name__ == "__main__":
    main()
