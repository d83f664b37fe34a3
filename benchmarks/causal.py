"""Whether values hold from the moment they are given: all values at all cycles against the truth, in their own sigmas.

    python benchmarks/causal.py > docs/causal.md

Packaged scenarios, seed by seed, through the estimator alone with the noise that the scenario states.
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from massprop_cli.base import onethread

onethread.prefer()

import numpy as np  # noqa: E402
from script import commit, counted  # noqa: E402

from massprop_cli import __version__  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.estimate import engine, noiselevels  # noqa: E402
from massprop_cli.estimate.history import phase_cycles  # noqa: E402
from massprop_cli.inputs.vehicle import Phase  # noqa: E402
from massprop_cli.prepare.timing import Timing  # noqa: E402
from massprop_cli.testbed import scenario, simulate  # noqa: E402

SCENARIOS = ("preliminary", "refined", "free-flyer", "testbed", "docking")


@dataclass(frozen=True)
class Errors:
    """Counts of errors over sigmas of one log."""

    given: int
    possible: int
    beyond: int
    covered: int
    worst: float
    end: Array
    """(P, 10) at the end of each phase."""


def errors(name: str, seed: int) -> Errors:
    """Errors over sigmas of one seed at all cycles."""
    flown = simulate.fly(scenario.load(name), [seed])
    log, used = flown.log(0), flown.vehicle
    samples = Timing(float(used.cycle.command_delay_cycles), 0.0).of(log, used)
    executed = samples.executed
    phases = used.phases or (Phase(name="all", start_s=0.0, end_s=float(executed.end_s[-1])),)
    pieces = [phase_cycles(phase, executed.end_s, executed.usable) for phase in phases]
    levelled, _ = noiselevels.with_noise_levels(samples, pieces, used)
    z = []
    for phase, cycles, truth in zip(phases, pieces, flown.truth[0], strict=True):
        history = engine.replay(samples, cycles, phase, levelled.in_phase(phase))
        z.append((history.values - truth) / history.sigmas)
    whole = np.abs(np.concatenate([one.ravel() for one in z]))
    told = whole[np.isfinite(whole)]
    end = np.stack([one[-1] for one in z])
    return Errors(told.size, whole.size, int((told > 4).sum()), int((told < 1.959964).sum()), float(told.max(initial=0.0)), end)


def main() -> None:
    """Print one row for each scenario."""
    arguments = counted(__doc__, seeds=50, first=1).parse_args()
    print(HEAD.format(version=__version__, commit=commit(), seeds=arguments.seeds, first=arguments.first))
    found: list[Errors] = []
    with ProcessPoolExecutor() as pool:
        for name in SCENARIOS:
            logs = list(pool.map(partial(errors, name), range(arguments.first, arguments.first + arguments.seeds)))
            print(row(name, logs), flush=True)
            found += logs
    print(row("all", found))


def row(name: str, logs: list[Errors]) -> str:
    """A row of the table."""
    given, beyond = sum(one.given for one in logs), sum(one.beyond for one in logs)
    end = np.concatenate([one.end for one in logs])
    spread = float(np.sqrt(np.nanmean(end**2)))
    cells = (
        f"{given / sum(one.possible for one in logs):.1%}",
        f"{sum(one.covered for one in logs) / given:.2%}",
        f"{beyond / given:.4%}",
        f"{max(one.worst for one in logs):.1f}",
        f"{spread:.2f}",
    )
    return f"| {name} | " + " | ".join(cells) + " |"


HEAD = """# Values on the way

Made by `python benchmarks/causal.py > docs/causal.md` at commit {commit} (massprop {version}): {seeds} seeds of each scenario from {first}
on, all ten quantities at all cycles of all phases. "Given" is the share of them that the history holds; the others are empty until the log
has said enough. At most 0.05 % should be more than 4 of their own sigmas off, and none more than 8.

| scenario | given | within 1.96 sigma | beyond 4 sigma | farthest, sigma | end, root mean square |
|---|--:|--:|--:|--:|--:|"""

if __name__ == "__main__":
    main()
