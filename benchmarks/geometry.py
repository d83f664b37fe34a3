"""Errors against sigmas where jets and IMU are not quite as the vehicle file states, but as uncertain as it says.

    python benchmarks/geometry.py > docs/geometry.md

Each seed flies a vehicle of its own, drawn from the stated uncertainty, by the commands of the stated one; it is estimated as stated.
"""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

from massprop_cli.base import onethread

onethread.prefer()

import numpy as np  # noqa: E402
from scores import covered, rms_of  # noqa: E402
from script import commit, counted  # noqa: E402

from massprop_cli import QUANTITIES, __version__, flow  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.base.rigidbody import rotation  # noqa: E402
from massprop_cli.inputs.equipment import Jet  # noqa: E402
from massprop_cli.inputs.vehicle import Vehicle  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402
from massprop_cli.testbed import scenario, simulate  # noqa: E402
from massprop_cli.testbed.scenario import ScenarioSource  # noqa: E402

CASES = {"free-flyer": 24.0, "planar": 24.0}
"""Scenarios, and how much of each is flown, s."""
THRUST, POSITION_M, DIRECTION_RAD, IMU_M, MOUNTING_RAD = 0.01, 0.001, 0.01, 0.002, 0.003
"""One sigma of each jet's thrust, place and direction, of the IMU's place and mounting."""


@dataclass(frozen=True)
class Run:
    """Of one seed: z (10,), NaN where nothing is told; sigmas over those of a vehicle that is just as stated; codes of warnings."""

    z: Array
    widened: Array
    warnings: tuple[str, ...]


def one(name: str, seed: int) -> Run:
    """Draw a vehicle, fly it, and estimate it as stated."""
    source = scenario.load(name)
    source = shortened(source, CASES[name])
    stated = uncertain(source.scenario.vehicle)
    exactly = simulate.fly(source, [seed])
    flown = simulate.fly(changed(source, drawn(stated, seed)), [seed], issued=exactly.issued)
    found = flow.examine(flown.log(0), VehicleSource(stated, name, ""))
    exact = flow.examine(exactly.log(0), VehicleSource(source.scenario.vehicle, name, ""))
    sigma, alone = (np.sqrt(np.diag(each.conclusions[0].covariance)) for each in (found, exact))
    codes = tuple(sorted({notice.code for notice in found.notices}))
    return Run((found.conclusions[0].values - flown.truth[0][0]) / sigma, sigma / alone, codes)


def shortened(source: ScenarioSource, duration_s: float) -> ScenarioSource:
    """Its beginning; the planned motions of the free flyer and the platform drive all axes at once from there on."""
    period = source.scenario.vehicle.cycle.period_s
    segments = [s for s in source.scenario.plan if s.cycles(period)[0] * period < duration_s]
    if source.scenario.vehicle.environment.kind != "air_bearing":
        axes = ("x", "y", "yaw") if source.scenario.vehicle.environment.kind == "planar" else ("roll", "pitch", "yaw", "x", "y", "z")
        last = source.scenario.plan[0].model_copy(update={"axes": axes, "start_s": 0.0, "end_s": duration_s})
        segments = [last.model_copy(update={"start_cycle": None, "end_cycle": None})]
    return ScenarioSource(source.scenario.model_copy(update={"duration_s": duration_s, "plan": tuple(segments)}), source.source)


def changed(source: ScenarioSource, vehicle: Vehicle) -> ScenarioSource:
    """The scenario with another vehicle."""
    return ScenarioSource(source.scenario.model_copy(update={"vehicle": vehicle}), source.source)


def uncertain(vehicle: Vehicle) -> Vehicle:
    """The vehicle with stated uncertainties."""
    sigmas = {"thrust_sigma": THRUST, "position_sigma_m": POSITION_M, "direction_sigma_rad": DIRECTION_RAD}
    imu = vehicle.imu.model_copy(update={"position_sigma_m": IMU_M, "mounting_sigma_rad": MOUNTING_RAD})
    return _new(vehicle, [jet.model_copy(update=sigmas) for jet in vehicle.jets], imu)


def drawn(vehicle: Vehicle, seed: int) -> Vehicle:
    """A random vehicle within these uncertainties."""
    rng, imu = np.random.default_rng([seed, 1]), vehicle.imu
    place = np.array(imu.position_m) + imu.position_sigma_m * rng.standard_normal(3)
    mounting = rotation(imu.mounting_sigma_rad * rng.standard_normal(3)) @ np.array(imu.body_from_imu)
    changes = {"position_m": tuple(place.tolist()), "body_from_imu": tuple(map(tuple, mounting.tolist()))}
    return _new(vehicle, [_jet(jet, rng) for jet in vehicle.jets], imu.model_copy(update=changes))


def _jet(jet: Jet, rng: np.random.Generator) -> Jet:
    place = np.array(jet.position_m) + jet.position_sigma_m * rng.standard_normal(3)
    turned = rotation(jet.direction_sigma_rad * rng.standard_normal(3)) @ np.array(jet.force_n)
    force = (1 + jet.thrust_sigma * rng.standard_normal()) * turned
    return jet.model_copy(update={"position_m": tuple(place.tolist()), "force_n": tuple(force.tolist())})


def _new(vehicle: Vehicle, jets: Sequence[Jet], imu: object) -> Vehicle:
    """A copy without cached properties."""
    changes = vehicle.model_copy(update={"jets": tuple(jets), "imu": imu})
    return Vehicle.model_validate(changes.model_dump(by_alias=True))


def report(name: str, runs: Sequence[Run]) -> str:
    """One scenario as Markdown."""
    z, widened = np.array([run.z for run in runs]), np.array([run.widened for run in runs])
    lines = [f"## {name}", "", "| | z rms | 95 % covers | sigma over that of a vehicle that is as stated |", "|---|--:|--:|--:|"]
    for i, quantity in enumerate(QUANTITIES):
        told = z[np.isfinite(z[:, i]), i]
        if len(told):
            lines.append(f"| {quantity} | {rms_of(told)} | {covered(told)} | {np.nanmedian(widened[:, i]):.3g} |")
    told = z[np.isfinite(z)]
    counts = Counter(code for run in runs for code in run.warnings)
    warned = ", ".join(f"{code} {n}" for code, n in sorted(counts.items())) or "none"
    lines += ["", f"Together: z rms {rms_of(told)}, the intervals cover {covered(told)}."]
    return "\n".join([*lines, f"Warnings: {warned}.", ""])


def main() -> None:
    """All scenarios, all seeds."""
    parser = counted(__doc__, seeds=100, workers=None)
    parser.add_argument("--scenario", action="append", choices=list(CASES))
    arguments = parser.parse_args()
    print(HEAD.format(seeds=arguments.seeds, version=__version__, commit=commit()))
    with ProcessPoolExecutor(arguments.workers) as pool:
        for name in arguments.scenario or CASES:
            print(report(name, list(pool.map(partial(one, name), range(1, arguments.seeds + 1)))), flush=True)


HEAD = """# Uncertain geometry, over {seeds} vehicles each

Made by `python benchmarks/geometry.py > docs/geometry.md` at commit {commit} (massprop {version}). Each flight of 24 s is that of a
vehicle of its own: every jet's thrust off by 1 %, its place by 1 mm along each axis, its direction by 0.6 degrees about each axis; the IMU
by 2 mm and 0.17 degrees (one sigma each, all independent), and the vehicle file says so (`thrust_sigma`, `position_sigma_m`,
`direction_sigma_rad` under `[[jets]]`, `position_sigma_m` and `mounting_sigma_rad` under `[imu]`). z is the error over the claimed sigma (1
is honest). What the keys do: [uncertain-geometry.md](uncertain-geometry.md).
"""

if __name__ == "__main__":
    main()
