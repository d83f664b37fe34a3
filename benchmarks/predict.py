"""Whether ``massprop predict`` passes results of the same vehicle and fails results that are off.

    python benchmarks/predict.py --pairs 100

Each pair is two flights of a vehicle that nobody chose (benchmarks/any_vehicle.py), with other noise. The result of the first is tested
against the second as it is, then with its values moved: along a random direction by so many noise sigmas in the metric of the result's own
covariance without what all logs of a vehicle share, and by so many of its own sigmas in one value alone, the others as they are.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from any_vehicle import scenario_of, source_of
from script import counted

from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array, IntArray
from massprop_cli.base.errors import InputError
from massprop_cli.combine.phase import piece
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.predict.difference import compared
from massprop_cli.result import build
from massprop_cli.result.schema import PhaseItem, Result
from massprop_cli.testbed import simulate

LIMIT = 0.95
SIGMAS, BETWEEN = (4.0, 6.0, 8.0), (4.0, 12.0)
"""By which a result is moved: each, and drawn between the last two."""


class Pair(NamedTuple):
    """Results of two flights of one vehicle."""

    number: int
    first: Result
    second: Result


def pairs(count: int, first: int) -> Iterator[Pair]:
    """``count`` pairs, of the first vehicles from ``first`` on that can be flown."""
    number = first
    while count:
        try:
            flight = simulate.fly(source_of(scenario_of(number)[0]), [number, number + 500_000])
            both = [build.result(flow.examine(flight.log(i), VehicleSource(flight.vehicle, "", ""))) for i in range(2)]
        except InputError:
            both = []  # it turned over, or left the bearing's range
        if both and any(one.value is not None for one in both[0].phases[0].estimates.values()):
            yield Pair(number, *both)
            count -= 1
        number += 1


def noise(result: Result) -> tuple[IntArray, Array, Array]:
    """Which quantities have a value, these, and their covariance without the thrust's common error."""
    own = piece(result.vehicle, result.phases[0])
    at = np.flatnonzero(np.isfinite(own.values))
    scaled = own.by_scale(own.values)[at]
    left = 0.0 if own.known else own.scale_sigma
    return at, own.values[at], own.covariance[np.ix_(at, at)] - left**2 * np.outer(scaled, scaled)


def moved(result: Result, by: Array) -> PhaseItem:
    """The first phase with its values changed by (10,)."""
    phase = result.phases[0]
    items = {
        name: one if one.value is None else one.model_copy(update={"value": one.value + change})
        for (name, one), change in zip(phase.estimates.items(), by.tolist(), strict=True)
    }
    return phase.model_copy(update={"estimates": items})


def tested(pair: Pair, phase: PhaseItem) -> tuple[float, float, int]:
    """p, chi-square and its degrees of freedom."""
    found = compared((pair.first.vehicle, phase), (pair.second.vehicle, pair.second.phases[0]))
    return found.p, found.chi_square, found.freedom


def main() -> None:
    """Print the figures."""
    asked = counted(__doc__, pairs=100, first=0).parse_args()
    ways = ("along a random direction", "in one value")
    clean: list[float] = []
    failed: dict[tuple[str, float], list[bool]] = {(way, sigmas): [] for way in ways for sigmas in (*SIGMAS, 0.0)}
    for pair in pairs(asked.pairs, asked.first):
        draw = np.random.default_rng(pair.number)
        p, chi_square, freedom = tested(pair, pair.first.phases[0])
        clean.append(p)
        if p < 1e-3:
            print(f"vehicle {pair.number}: chi-square {chi_square:.4g} of {freedom}, p = {p:.2g}", flush=True)
        at, _, covariance = noise(pair.first)
        size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
        unit = draw.normal(size=len(at))
        chosen = np.zeros(len(at))
        chosen[draw.integers(len(at))] = draw.choice([-1.0, 1.0])
        steps = size * (vectors @ (np.sqrt(np.maximum(values, 0.0)) * unit / np.linalg.norm(unit))), size * chosen
        drawn = float(draw.uniform(*BETWEEN))
        for way, step in zip(ways, steps, strict=True):
            whole = np.zeros(len(QUANTITIES))
            whole[at] = step
            for sigmas in (*SIGMAS, 0.0):
                by = sigmas or drawn
                failed[way, sigmas].append(tested(pair, moved(pair.first, by * whole))[0] <= 1 - LIMIT)
    print(f"clean: {100 * np.mean(np.array(clean) > 1 - LIMIT):.0f} % of {len(clean)} pairs pass the {100 * LIMIT:.0f} % limit")
    for (way, sigmas), each in failed.items():
        length = f"{sigmas:g}" if sigmas else f"{BETWEEN[0]:g} to {BETWEEN[1]:g}"
        print(f"{length} sigma {way}: {100 * np.mean(each):.0f} % fail")


if __name__ == "__main__":
    main()
