"""The two-body experiment over many seeds: the vehicle alone on its bearing, joined with an object on another, and the object from both.

    python benchmarks/two_body.py --seeds 50

For each quantity of the object: mean sigma, root mean square error in sigmas, and how often 95 % intervals hold the truth.
"""

import tempfile
from pathlib import Path

from massprop_cli.base import escape, onethread

onethread.prefer()

import numpy as np  # noqa: E402
from scores import covered, rms_of  # noqa: E402
from script import counted  # noqa: E402

from massprop_cli import QUANTITIES, UNITS, flow  # noqa: E402
from massprop_cli.base.arrays import Array  # noqa: E402
from massprop_cli.combine import flow as combined  # noqa: E402
from massprop_cli.inputs.vehiclefile import VehicleSource  # noqa: E402
from massprop_cli.result import build  # noqa: E402
from massprop_cli.result.read import read  # noqa: E402
from massprop_cli.testbed import scenario, simulate  # noqa: E402

OBJECT = np.array([0.5, 0.0, 0.0, 0.5, 0.0, 0.5, 0.8, 0.0, 0.0, 12.0])
"""A cube of 12 kg and 0.5 m, 0.8 m ahead (massprop_cli/testbed/scenarios/testbed-joined.toml)."""
BEYOND = 1000
"""Seeds of the second log less those of the first: their noise is not the same."""


def result(name: str, seed: int, folder: Path) -> Path:
    """The result of a packaged scenario's log."""
    flight = simulate.fly(scenario.load(name), [seed])
    found = flow.examine(flight.log(0), VehicleSource(flight.vehicle, name, f"{name} {seed}"))
    told = build.result(found)
    # a log at hand has no file to take a digest of
    told = told.model_copy(update={"provenance": told.provenance.model_copy(update={"input_sha256": f"{name} {seed}"})})
    folder.mkdir()
    (folder / "result.json").write_text(escape.document(told), encoding="utf-8")
    return folder


def docked(seed: int) -> tuple[Array, Array]:
    """(10,) values and (10, 10) covariance of the object."""
    with tempfile.TemporaryDirectory() as place:
        alone = result("testbed", seed, Path(place) / "alone")
        joined = result("testbed-joined", seed + BEYOND, Path(place) / "joined")
        found = combined.together_docked([read(alone)], [read(joined)]).docked_object
    assert found is not None
    return np.array([item.value for item in found.estimates.values()]), np.array(found.covariance)


def main() -> None:
    """Fly all seeds and print the table."""
    count = counted(__doc__, seeds=50).parse_args().seeds
    found = [docked(seed) for seed in range(1, count + 1)]
    error = np.array([values for values, _ in found]) - OBJECT
    sigma = np.array([np.sqrt(np.diag(covariance)) for _, covariance in found])
    rms, within = np.sqrt(((error / sigma) ** 2).mean(0)), (np.abs(error) < 1.96 * sigma).mean(0)
    print("| quantity | sigma | unit | rms error / sigma | 95 % intervals cover |")
    print("|---|--:|---|--:|--:|")
    for i, name in enumerate(QUANTITIES):
        print(f"| {name} | {sigma[:, i].mean():.2g} | {UNITS[name]} | {rms[i]:.2f} | {100 * within[i]:.0f} % |")
    print(f"| all | | | {rms_of(error / sigma)} | {covered(error / sigma)} |")


if __name__ == "__main__":
    main()
