"""Errors and sigmas of every method over many seeds of the packaged scenarios, against the Cramér–Rao bound.

    python benchmarks/accuracy.py > docs/accuracy.md

The bound is each log's own, from the simulator's sensitivities (massprop_cli/testbed/bound.py).
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from massprop_cli import QUANTITIES, analysis, docking
from massprop_cli.arrays import Array
from massprop_cli.testbed import bound, scenario, simulate
from massprop_cli.vehicle import VehicleSource

SCENARIOS = ("preliminary", "refined", "docking", "testbed", "free-flyer")
METHODS = ("thesis", "default")
NOISE_FREE = "preliminary"
FLOORS = {"inertia": 5e-5, "cg": 2e-5, "mass": 0.0}
"""Errors below this part of the trace, or this many metres, count as none."""


@dataclass(frozen=True)
class Run:
    """One seed of one scenario: error, sigma and bound of each body (phases, then the docked object), (bodies, 10)."""

    true: Array
    bound: Array
    error: dict[str, Array]
    sigma: dict[str, Array]
    warnings: dict[str, tuple[str, ...]]


def one(name: str, seed: int) -> Run:
    """Fly, bound, estimate by every method."""
    source = scenario.load(name)
    flown = simulate.fly(source, [seed])
    true = np.array([*flown.truth[0], *([flown.docked] if flown.docked is not None else [])])
    limits = np.full(true.shape, np.nan)
    if name != NOISE_FREE:
        covariances = bound.cramer_rao(source, flown, 0)
        limits[: len(covariances)] = [np.sqrt(np.diag(c)) for c in covariances]
        if flown.docked is not None:
            limits[-1] = docked_bound(flown.truth[0], covariances)
    error, sigma, warnings = {}, {}, {}
    for method in METHODS:
        vehicle = flown.vehicle.model_copy(update={"estimator": flown.vehicle.estimator.model_copy(update={"method": method})})
        found = analysis.examine(flown.log(0), VehicleSource(vehicle, name, ""))
        values = [conclusion.values for conclusion in found.conclusions]
        sigmas = [np.sqrt(np.diag(conclusion.covariance)) for conclusion in found.conclusions]
        if flown.docked is not None:
            values.append(docking.difference(values[0], values[1]))
            sigmas.append(np.full(10, np.nan) if found.docked is None else np.sqrt(np.diag(found.docked.covariance)))
        error[method], sigma[method] = np.array(values) - true, np.array(sigmas)
        warnings[method] = tuple(sorted({notice.code for notice in found.notices}))
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
        true = runs[0].true[body]
        lines += [
            f"### {label}" if len(labels) > 1 else "",
            "",
            "| | true | bound | "
            + " | ".join(f"{method}: bias | rms error | rms / bound | sigma / bound | z rms | 95 % covers" for method in METHODS)
            + " |",
            "|---|--:|--:|" + "--:|" * 6 * len(METHODS),
        ]
        for i, quantity in enumerate(QUANTITIES):
            limit = float(np.sqrt(np.mean([run.bound[body, i] ** 2 for run in runs])))
            cells = [quantity, f"{true[i]:.6g}", f"{limit:.2g}"]
            for method in METHODS:
                error = np.array([run.error[method][body, i] for run in runs])
                sigma = np.array([run.sigma[method][body, i] for run in runs])
                z = error / sigma
                rms = float(np.sqrt(np.mean(error**2)))
                over = np.array([run.sigma[method][body, i] / run.bound[body, i] for run in runs])
                cells += [f"{error.mean():.2g}", f"{rms:.2g}", f"{rms / limit:.2f}", f"{np.median(over):.2f}"]
                cells += [f"{np.sqrt(np.mean(z**2)):.2f}", f"{100 * np.mean(np.abs(z) <= 1.96):.1f} %"]
            lines.append("| " + " | ".join(cells).replace("nan %", "–").replace("nan", "–") + " |")
        lines.append("")
    for method in METHODS:
        counts = Counter(code for run in runs for code in run.warnings[method])
        lines.append(
            f"Warnings, {method}: "
            + (", ".join(f"{code} {100 * n / len(runs):.1f} %" for code, n in sorted(counts.items())) or "none")
            + "."
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """All scenarios, all seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--scenario", action="append", choices=SCENARIOS)
    arguments = parser.parse_args()
    print(HEAD.format(seeds=arguments.seeds))
    with ProcessPoolExecutor() as pool:
        for name in arguments.scenario or SCENARIOS:
            seeds = range(1, (3 if name == NOISE_FREE else arguments.seeds) + 1)
            print(report(name, list(pool.map(partial(one, name), seeds))), flush=True)


HEAD = """# Accuracy over {seeds} seeds
"""

if __name__ == "__main__":
    main()
