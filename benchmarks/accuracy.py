"""Errors and sigmas of every method over many seeds of the packaged scenarios, against the Cramér–Rao bound.

    python benchmarks/accuracy.py > docs/accuracy.md

The bound is each log's own, from the simulator's sensitivities (tests/cramerrao.py).
"""

import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from massprop_cli.base import onethread

onethread.prefer()

import numpy as np  # noqa: E402
from scores import columns  # noqa: E402
from script import commit, counted  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli import QUANTITIES, UNITS, __version__, flow  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.conclude import docking  # noqa: E402
from massprop_cli.conclude.verdict import conclude  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402
from massprop_cli.testbed import bound, scenario, simulate  # noqa: E402
from tests import cramerrao  # noqa: E402

SCENARIOS = ("preliminary", "refined", "docking", "testbed", "free-flyer")
METHODS = ("thesis", "default", "refine")
NOISE_FREE = "preliminary"


@dataclass(frozen=True)
class Run:
    """One seed of one scenario: error, sigma and bound of each body (phases, then the docked object), (bodies, 10)."""

    true: Array
    bound: Array
    error: dict[str, Array]
    sigma: dict[str, Array]
    warnings: dict[str, tuple[str, ...]]


def one(name: str, seed: int) -> Run:
    """Fly one seed, compute its bound, and estimate it by every method."""
    source = scenario.load(name)
    flown = simulate.fly(source, [seed])
    true = np.array([*flown.truth[0], *([flown.docked] if flown.docked is not None else [])])
    limits = np.full(true.shape, np.nan)
    if name != NOISE_FREE:
        covariances = cramerrao.cramer_rao(source, flown, 0)
        limits[: len(covariances)] = [np.sqrt(np.diag(c)) for c in covariances]
        if flown.docked is not None:
            limits[-1] = docked_bound(flown.truth[0], covariances)
    error, sigma, warnings = {}, {}, {}
    for method in ("thesis", "default"):
        estimator = flown.vehicle.estimator.model_copy(update={"method": method})
        vehicle = flown.vehicle.model_copy(update={"estimator": estimator})
        found = flow.examine(flown.log(0), VehicleSource(vehicle, name, ""))
        ends = {method: found.conclusions}
        if method == "default":  # --refine reports the fits by which the default is judged
            ends["refine"] = tuple(conclude(history, found.vehicle) for history in found.settled)
        for label, conclusions in ends.items():
            values = [conclusion.values for conclusion in conclusions]
            sigmas = [np.sqrt(np.diag(conclusion.covariance)) for conclusion in conclusions]
            if flown.docked is not None:
                values.append(docking.difference(values[0], values[1]))
                joined = docking.docked_object(conclusions, found.vehicle)
                sigmas.append(np.full(10, np.nan) if joined is None else np.sqrt(np.diag(joined.covariance)))
            error[label], sigma[label] = np.array(values) - true, np.array(sigmas)
            warnings[label] = tuple(sorted({notice.code for notice in found.notices}))
    return Run(true, limits, error, sigma, warnings)


def docked_bound(truth: Array, covariances: Sequence[Array]) -> Array:
    """(10,) bound of the docked object from those of both phases."""
    slopes = []
    for i in range(20):
        step = 1e-6 * np.concatenate([bound.natural_sizes(values) for values in truth])[i]
        both = [np.concatenate(truth) + sign * step * np.eye(20)[i] for sign in (1, -1)]
        up, down = (docking.difference(v[:10], v[10:]) for v in both)
        slopes.append((up - down) / (2 * step))
    joint = np.zeros((20, 20))
    joint[:10, :10], joint[10:, 10:] = covariances
    slope = np.array(slopes).T
    limits: Array = np.sqrt(np.diag(slope @ joint @ slope.T))
    return limits


def report(name: str, runs: Sequence[Run]) -> str:
    """One scenario as Markdown."""
    lines = [f"## {name}", ""]
    labels = {1: ["all"], 3: ["alone", "combined", "docked object"]}[len(runs[0].true)]
    for body, label in enumerate(labels):
        lines += [f"### {label}", ""] if len(labels) > 1 else []
        headings = "bias | rms error | rms / bound | sigma / bound | z rms | 95 % covers |"
        lines += ["| | true | bound |" + "".join(f" {method}: {headings}" for method in METHODS)]
        lines += ["|---|--:|--:|" + "--:|" * 6 * len(METHODS)]
        for i, quantity in enumerate(QUANTITIES):
            methods = [_columns(runs, method, body, i) for method in METHODS]
            cells = [f"{quantity} [{UNITS[quantity]}]", f"{runs[0].true[body][i] + 0.0:.6g}", methods[0][0]]
            cells += [cell for own in methods for cell in own[1:]]
            lines.append("| " + " | ".join(cells).replace("nan %", "–").replace("nan", "–") + " |")
        lines.append("")
    for method in METHODS:
        counts = Counter(code for run in runs for code in run.warnings[method])
        found = ", ".join(f"{code} {100 * n / len(runs):.1f} %" for code, n in sorted(counts.items())) or "none"
        lines.append(f"Warnings, {method}: {found}.\n")
    return "\n".join(lines)


def _columns(runs: Sequence[Run], method: str, body: int, i: int) -> list[str]:
    each = ((run.error[method], run.sigma[method], run.bound) for run in runs)
    return columns(*np.array([[of[body, i] for of in one] for one in each]).T)


def main() -> None:
    """All scenarios, all seeds."""
    parser = counted(__doc__, seeds=200)
    parser.add_argument("--scenario", action="append", choices=SCENARIOS)
    arguments = parser.parse_args()
    print(HEAD.format(seeds=arguments.seeds, version=__version__, commit=commit()))
    with ProcessPoolExecutor() as pool:
        for name in arguments.scenario or SCENARIOS:
            seeds = range(1, (3 if name == NOISE_FREE else arguments.seeds) + 1)
            print(report(name, list(pool.map(partial(one, name), seeds))), flush=True)


HEAD = """# Accuracy over {seeds} seeds

Made by `python benchmarks/accuracy.py > docs/accuracy.md` at commit {commit} (massprop {version}). Bias is the mean error; rms / bound the
root mean square error over that of the logs' own Cramér–Rao bounds (from the simulator's sensitivities, initial rates unknown, IMU
noise alone); sigma / bound the median claim over it; z error over claimed sigma (1 is honest); the last column how many of the 95
% intervals hold the truth (95 % is honest; 3 standard deviations of that share over 200 seeds are 4.6 %). Inertia about the CG in
body axes, products as tensor elements; CG from O. The thesis's sigma is its "precision", no error. The preliminary scenario has
no noise, hence no bound, and three seeds.
"""

if __name__ == "__main__":
    main()
