"""Plans for the packaged vehicles, tested against their own logs over many seeds.

    python benchmarks/plan.py --seeds 50

For each: how long the plan is beside what the packaged timeline needs for the same precision; the sigma that logs of the plan achieve, and
their root mean square error, over the sigma that was predicted; and whether every seed keeps the limits.
"""

import tempfile
from pathlib import Path

from massprop_cli.base import onethread

onethread.prefer()

import numpy as np  # noqa: E402
from scipy.stats import chi2  # noqa: E402
from scores import deviate, rms  # noqa: E402
from script import counted  # noqa: E402

from massprop_cli import QUANTITIES  # noqa: E402
from massprop_cli import flow as analysis  # noqa: E402
from massprop_cli.base import configfile  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.inputs.require import precise  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402
from massprop_cli.plan import flow, limits  # noqa: E402
from massprop_cli.plan.choose import PlanGoal  # noqa: E402
from massprop_cli.testbed import bound, output, scenario, simulate  # noqa: E402
from massprop_cli.testbed.scenario import ScenarioSource  # noqa: E402

PLANS: dict[str, tuple[str, dict[str, float]]] = {
    "free-flyer": ("all<1%, cg_x<0.05 mm, cg_y<0.05 mm, cg_z<0.05 mm, mass<1.2%", {"rate_rad_s": 0.5, "travel_m": 2.0}),
    "testbed": ("ixx<0.5%, iyy<0.5%, izz<0.5%, cg_x<0.01 mm, cg_y<0.01 mm, cg_z<0.01 mm, mass<1%", {"rate_rad_s": 0.5}),
    "refined": ("ixx<0.5%, iyy<0.5%, izz<0.5%, mass<1%", {"rate_rad_s": 0.5}),
    "wheels": ("ixx<0.1%, iyy<0.1%, izz<0.1%", {"rate_rad_s": 0.5}),
    "control-moment-gyros": ("ixx<0.1%, iyy<0.1%, izz<0.1%", {"rate_rad_s": 0.5}),
    "pedestal": ("ixx<0.1%, iyy<0.1%, izz<0.1%", {"rate_rad_s": 0.5}),
}
"""What is wanted, and the fastest rate and farthest travel that are allowed."""
COLUMNS = (
    *("vehicle", "plan, and what the packaged timeline needs", "sigma of the logs / predicted: mean", "of a single log"),
    *("rms error / predicted", "of all quantities", "limits kept"),
)


def made_for(name: str) -> flow.WrittenPlan:
    """The plan for a packaged vehicle, with the true vehicle as the guess."""
    packaged = scenario.load(name).scenario
    want, allowed = PLANS[name]
    asked = flow.PlanRequest(precise(want), packaged.cycles * packaged.vehicle.cycle.period_s, "worst", allowed)
    with tempfile.TemporaryDirectory() as folder:
        vehicle, guess = Path(folder) / "vehicle.toml", Path(folder) / "guess.toml"
        vehicle.write_text(output.vehicle_toml(packaged.vehicle), encoding="utf-8")
        body = dict(zip(QUANTITIES, packaged.truth.values.tolist(), strict=True))
        full = {key: value for key, value in packaged.actuators.model_dump().items() if key.startswith("max_") and value is not None}
        guess.write_text(configfile.toml({"body": body, "actuators": full}), encoding="utf-8")
        return flow.make(vehicle, guess, asked, lambda *_: None)


def needed(name: str) -> float:
    """Seconds after which the packaged timeline has reached what is wanted, by the same bound; infinite where it doesn't."""
    source = scenario.load(name)
    flight = simulate.fly(source, [1])
    body = flight.truth[0]
    told = bound.information(source, flight.issued, body)
    told[:, : int(float(flight.vehicle.cycle.command_delay_cycles))] = 0.0
    wanted = PlanGoal(precise(PLANS[name][0]), body, flight.vehicle)
    worst = wanted.ratios(np.swapaxes(np.cumsum(told, 1), 0, 1)).max((1, 2))
    reached = np.flatnonzero(worst <= 1)
    return float((reached[0] + 1) * flight.vehicle.cycle.period_s) if len(reached) else np.inf


def flown(source: ScenarioSource, made: flow.WrittenPlan, seed: int) -> tuple[Array, Array, bool]:
    """(10, 10) covariance and (10,) error of one log of the plan, and whether it keeps the limits."""
    flight = simulate.fly(source, [seed])
    found = analysis.examine(flight.log(0), VehicleSource(flight.vehicle, "plan", "")).conclusions[0]
    used = limits.used(simulate.fly(bound.noise_free(source), [seed]))
    allowed = {key: item.allowed for key, item in made.plan.limits.items() if item.allowed is not None}
    return found.covariance, found.values - flight.truth[0, 0], not limits.exceeded(used, allowed)


def report(name: str, seeds: int) -> str:
    """One row of the table."""
    made = made_for(name)
    source = scenario.parse(made.scenario, "scenario.toml")
    at = [i for i, item in enumerate(made.plan.quantities.values()) if item.told == "well"]
    predicted = np.array([item.sigma for item in made.plan.quantities.values()])[at]
    found = [flown(source, made, seed) for seed in range(1, seeds + 1)]
    covariances, errors, kept = zip(*((spread[np.ix_(at, at)], off[at], keeps) for spread, off, keeps in found), strict=True)
    told = np.sqrt([np.diag(covariance) for covariance in covariances]) / predicted
    off, mean = np.sqrt(((np.array(errors) / predicted) ** 2).mean(0)), told.mean(0)
    # as correlated as the logs say, as large as the plan does
    pooled = [deviate(error, covariance / np.outer(one, one)) for error, covariance, one in zip(errors, covariances, told, strict=True)]
    cells = [name, f"{made.plan.duration_s:g} s{'' if made.plan.reached else ' (not reached)'}, {needed(name):g} s"]
    cells += [f"{mean.min():.3f} to {mean.max():.3f}", f"{told.min():.2f} to {told.max():.2f}"]
    cells += [f"{off.min():.2f} to {off.max():.2f}", rms(pooled), f"{sum(kept)} of {seeds}"]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """All vehicles."""
    parser = counted(__doc__, seeds=50)
    parser.add_argument("--scenario", action="append", choices=list(PLANS))
    arguments = parser.parse_args()
    seeds = arguments.seeds
    print(f"| {' | '.join(COLUMNS)} |\n|---|---{'|--:' * 5}|")
    for name in arguments.scenario or PLANS:
        print(report(name, seeds), flush=True)
    low, high = np.sqrt(chi2.ppf([0.025, 0.975], seeds) / seeds)
    print(f"\nThe rms error of one quantity over {seeds} logs is within {low:.2f} to {high:.2f} in 95 % of all cases, by chance. ±: one")
    print("standard error of what is pooled, as the quantities of a log are correlated.")


if __name__ == "__main__":
    main()
