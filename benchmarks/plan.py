"""Plans for the packaged vehicles, held against their own logs over many seeds.

    python benchmarks/plan.py --seeds 50

For each: how long the plan is beside the packaged timeline and what both reach, achieved over predicted sigma, root mean square error over
predicted sigma, and whether every seed keeps the limits.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli import flow as analysis
from massprop_cli.inputs.require import precise
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.plan import flow, limits
from massprop_cli.testbed import bound, output, scenario, simulate

PLANS: dict[str, tuple[str, tuple[float, float | None]]] = {
    "free-flyer": ("all<1%, cg_x<0.05 mm, cg_y<0.05 mm, cg_z<0.05 mm, mass<1.2%", (0.5, 2.0)),
    "testbed": ("ixx<0.5%, iyy<0.5%, izz<0.5%, cg_x<0.01 mm, cg_y<0.01 mm, cg_z<0.01 mm, mass<1%", (0.5, None)),
    "refined": ("ixx<0.5%, iyy<0.5%, izz<0.5%, mass<1%", (0.5, None)),
}
"""What is wanted, and the fastest rate [rad/s] and farthest travel [m] that are allowed."""


def report(name: str, seeds: int) -> str:
    """One vehicle as a line of Markdown."""
    packaged = scenario.load(name).scenario
    timeline = packaged.cycles * packaged.vehicle.cycle.period_s
    want, (rate, travel) = PLANS[name]
    asked = flow.Asked(precise(want), timeline, rate_rad_s=rate, travel_m=travel)
    with tempfile.TemporaryDirectory() as folder:
        vehicle, guess = Path(folder) / "vehicle.toml", Path(folder) / "guess.toml"
        vehicle.write_text(output.vehicle_toml(packaged.vehicle), encoding="utf-8")
        values = "\n".join(f"{key} = {value!r}" for key, value in zip(QUANTITIES, packaged.truth.values.tolist(), strict=True))
        guess.write_text(f"[body]\n{values}\n", encoding="utf-8")
        made = flow.make(vehicle, guess, asked, lambda *_: None)
    source = scenario.parse(made.scenario, "scenario.toml")
    predicted = np.array([item.sigma for item in made.plan.quantities.values()])
    sigmas, errors, kept = [], [], 0
    for seed in range(1, seeds + 1):
        flight = simulate.fly(source, [seed])
        found = analysis.examine(flight.log(0), VehicleSource(flight.vehicle, name, "")).conclusions[0]
        sigmas.append(np.sqrt(np.diag(found.covariance)) / predicted)
        errors.append((found.values - flight.truth[0, 0]) / predicted)
        used = limits.used(simulate.fly(bound.noise_free(source), [seed])).most()
        allowed = {key: item.allowed for key, item in made.plan.limits.items() if item.allowed is not None}
        kept += not limits.exceeded(used, allowed)
    told, rms = np.array(sigmas), np.sqrt((np.array(errors) ** 2).mean(0))
    share = f"{100 * made.plan.duration_s / timeline:.0f} %"
    cells = [name, f"{made.plan.duration_s:g} s of {timeline:g} s ({share})", "yes" if made.plan.reached else "no"]
    cells += [f"{told.min():.2f} to {told.max():.2f}", f"{rms.min():.2f} to {rms.max():.2f}", f"{kept} of {seeds}"]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """All vehicles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--scenario", action="append", choices=list(PLANS))
    arguments = parser.parse_args()
    print("| vehicle | plan | reached | achieved / predicted sigma | rms error / predicted sigma | limits kept |")
    print("|---|---|---|--:|--:|--:|")
    for name in arguments.scenario or PLANS:
        print(report(name, arguments.seeds), flush=True)


if __name__ == "__main__":
    main()
