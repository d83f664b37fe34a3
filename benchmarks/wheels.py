"""Errors and sigmas of vehicles with reaction wheels over many seeds, against the Cramér–Rao bound.

    python benchmarks/wheels.py > docs/wheels.md

All seeds are flown at once; each has a plan of its own, and so a bound of its own.
"""

import sys
from pathlib import Path

import numpy as np
from scores import columns, covered
from script import commit, counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli import QUANTITIES, UNITS, __version__, flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate
from tests import cramerrao

CASES = {
    "wheels": ("three wheels alone, by their speeds", ()),
    "wheels-and-jets": ("jets and three wheels, by the torque on them; thrust known to 5 %", ()),
    "wheels-and-jets, thrust 4 % weak": ("the same, thrust 4 % weaker than the vehicle file states", ("actuators.scale=0.96",)),
}
TOGETHER = 5
"""Seeds whose bounds are found side by side: what memory bears."""


def case(name: str, settings: tuple[str, ...], seeds: int) -> str:
    """The table of one case."""
    source = scenario.load(name, settings)
    flown = simulate.fly(source, range(1, seeds + 1))
    truth = flown.truth[0, 0]
    parts = [cramerrao.of_members(source, flown, slice(first, first + TOGETHER))[:, 0] for first in range(0, seeds, TOGETHER)]
    limits = np.sqrt(np.diagonal(np.concatenate(parts), axis1=1, axis2=2))
    error, sigma = np.empty((seeds, 10)), np.empty((seeds, 10))
    verdicts: set[tuple[str, ...]] = set()
    warned = 0
    for member in range(seeds):
        found = flow.examine(flown.log(member), VehicleSource(flown.vehicle, name, ""))
        conclusion = found.conclusions[0]
        error[member], sigma[member] = conclusion.values - truth, np.sqrt(np.diag(conclusion.covariance))
        verdicts.add(tuple(estimate.verdict for estimate in conclusion.estimates.values()))
        warned += bool(found.notices)
        print(f"{name} {member + 1}/{seeds}", end="\r", file=sys.stderr)
    return _table(error, sigma, limits, truth, sorted(verdicts), warned)


def _table(error: Array, sigma: Array, limits: Array, truth: Array, verdicts: list[tuple[str, ...]], warned: int) -> str:
    z = error / sigma
    told = np.flatnonzero(np.isfinite(z).all(0))
    lines = ["| | true | bound | bias | rms / bound | sigma / bound | z rms | 95 % covers |", "|---|--:|--:|--:|--:|--:|--:|--:|"]
    for i, name in enumerate(QUANTITIES):
        cells = [f"{name} [{UNITS[name]}]", f"{truth[i]:.6g}"]
        if i in told:
            bound, bias, _, *ratios, _ = columns(error[:, i], sigma[:, i], limits[:, i])
            cells += [bound, bias, *ratios, f"{100 * (np.abs(z[:, i]) < 1.96).mean():.0f} %"]
        else:
            cells += ["–", *["not told"] * 5]
        lines.append(f"| {' | '.join(cells)} |")
    over, share = np.sqrt(((error[:, told] / limits[:, told]) ** 2).mean()), covered(z[:, told])
    lines += [
        "",
        f"Pooled: root mean square error {over:.2f} × the bound, 95 % intervals cover {share}. Logs with a warning: {warned}.",
    ]
    said = "; ".join(", ".join(f"{name} {verdict}" for name, verdict in zip(QUANTITIES, one, strict=True)) for one in verdicts)
    return "\n".join([*lines, f"Verdicts: {said}."])


def main() -> None:
    """Print the tables of all cases."""
    parser = counted(__doc__, seeds=100)
    parser.add_argument("--case", action="append", choices=list(CASES))
    arguments = parser.parse_args()
    print(HEAD.format(seeds=arguments.seeds, version=__version__, commit=commit()))
    for title in arguments.case or CASES:
        words, settings = CASES[title]
        print(f"## {title}\n\n{words[0].upper()}{words[1:]}.\n", flush=True)
        print(case(title.split(",")[0], settings, arguments.seeds) + "\n", flush=True)


HEAD = """# Reaction wheels over {seeds} seeds

Made by `python benchmarks/wheels.py > docs/wheels.md` at commit {commit} (massprop {version}), from the packaged scenarios `wheels` and
`wheels-and-jets`: 60 s at 20 Hz, three wheels of 0.002 kg m² of which one is askew, each of them turning at the start. The bound is each
log's own Cramér–Rao bound by gyro and accelerometer noise (wheels known; the scale of the thrust unknown, as the vehicle file says), root
mean square over the seeds; other columns as in accuracy.md.
"""

if __name__ == "__main__":
    main()
