"""Thesis against default against truth on the sample logs that have one, as Markdown.

python benchmarks/compare_methods.py > docs/methods.md
"""

import json

import numpy as np
from script import SAMPLES

from massprop_cli import QUANTITIES, UNITS, job
from massprop_cli.flow import Analysis

HEAD = """# Thesis, default and truth on the sample logs

Made by `python benchmarks/compare_methods.py > docs/methods.md`. Inertia about the CG in body axes, products as the tensor's own
elements (ixy = −Σ m x y); CG from O in body axes; ± is one standard deviation (the thesis's is its “precision”, no error). The logs come
from an engine that shares no code with massprop (sample_logs/README.md). *Bound* is the Cramér–Rao bound of the log, *z* the
default's error in its own sigmas.
"""


def rows(default: Analysis, thesis: Analysis, truth: dict[str, list[dict[str, float]]]) -> list[str]:
    """Markdown tables, one per phase, and the root mean square errors of both methods."""
    lines = []
    for i, conclusion in enumerate(default.conclusions):
        lines += [
            f"\n### phase {conclusion.phase.name}\n",
            "| | truth | `--method thesis` | verdict | `--method default` | verdict | bound | z |",
            "|---|--:|--:|---|--:|---|--:|--:|",
        ]
        errors: dict[str, list[float]] = {"thesis": [], "default": []}
        for j, name in enumerate(QUANTITIES):
            true, ours, theirs = truth["phases"][i][name], conclusion.estimates[name], thesis.conclusions[i].estimates[name]
            size = default.histories[i].natural_sizes[j]
            cells = []
            for method, estimate in (("thesis", theirs), ("default", ours)):
                told = estimate.value is not None and estimate.sigma is not None
                cells += [f"{estimate.value:.6g} ± {estimate.sigma:.2g}" if told else "–", estimate.verdict]
                if told:
                    errors[method].append(((estimate.value or 0.0) - true) / size)
            z = ((ours.value or np.nan) - true) / (ours.sigma or np.nan)
            lines.append(f"| {name} [{UNITS[name]}] | {true:.6g} | {' | '.join(cells)} | {truth['bound'][i][name]:.2g} | {z:+.1f} |")
        rms = {method: float(np.sqrt(np.mean(np.square(found)))) for method, found in errors.items()}
        lines.append(
            "\nRoot mean square error, relative to trace, √(trace/mass) and mass: "
            f"thesis {rms['thesis']:.2g}, default {rms['default']:.2g} "
            f"({rms['thesis'] / rms['default']:.0f} times smaller)."
        )
    return lines


def main() -> None:
    """Print the document."""
    print(HEAD)
    for folder in sorted(path.parent for path in SAMPLES.glob("*/truth.json")):
        truth = json.loads((folder / "truth.json").read_text())
        found = [
            job.of_file(folder / "log.parquet", assignments=(f"estimator.method={method}",)).analysis for method in ("default", "thesis")
        ]
        print(f"## {folder.name}")
        print("\n".join(rows(found[0], found[1], truth)), end="\n\n")


if __name__ == "__main__":
    main()
