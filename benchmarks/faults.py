"""How often a fault is named by a warning that points at it, whether any wrong value looks good, and how often a clean log raises any.

    python benchmarks/faults.py > docs/faults.md

Every fault is flown in the free-flyer scenario, seed by seed (the jet at fault changes with the seed); clean logs are those of all packaged
scenarios with noise.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from commit import commit

from massprop_cli import QUANTITIES, __version__, analysis
from massprop_cli.telemetry import Log
from massprop_cli.testbed import scenario, simulate
from massprop_cli.vehicle import Vehicle, VehicleSource

SCENARIO = "free-flyer"
CLEAN = ("refined", "docking", "testbed", "free-flyer")
SIGMAS, PART = 4.0, 0.005
"""A converged value is wrong if it is off by more than this many sigmas and this part of its size."""
UNPHYSICAL = "unphysical-inertia"
"""The thesis's own vehicle breaks the triangle inequality, and so says its truth."""
Mistake = Callable[[Log, Vehicle], tuple[Log, Vehicle]]


@dataclass(frozen=True)
class Fault:
    """How it comes about, and what must be said of it."""

    what: str
    code: str
    keys: Callable[[int], list[str]] = lambda _: []
    """Of the scenario, for a seed."""
    mistake: Mistake = lambda log, vehicle: (log, vehicle)
    names: Callable[[int], str] = lambda _: ""
    """What the message must hold, for a seed."""


def jet(seed: int) -> str:
    """Another jet for every seed."""
    jets = scenario.load(SCENARIO).scenario.vehicle.jets
    return jets[seed % len(jets)].name


def axis(seed: int) -> str:
    """Another axis for every seed."""
    return "xyz"[seed % 3]


def failure(names: list[str], thrust: float) -> list[str]:
    """Jets that give this part of their thrust."""
    return ["actuators.failures=[" + ", ".join(f'{{jet="{name}", thrust={thrust}}}' for name in names) + "]"]


def degrees(log: Log, vehicle: Vehicle) -> tuple[Log, Vehicle]:
    """Gyro columns in degrees."""
    return replace(log, delta_theta_imu_rad=np.degrees(log.delta_theta_imu_rad)), vehicle


def transposed(log: Log, vehicle: Vehicle) -> tuple[Log, Vehicle]:
    """The vehicle file has imu_from_body where body_from_imu belongs."""
    rows = tuple(tuple(float(x) for x in row) for row in np.array(vehicle.imu.body_from_imu).T)
    return log, vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={"body_from_imu": rows})})


FAULTS = (
    Fault("one jet's sign flipped", "jet-sign", lambda seed: failure([jet(seed)], -1.0), names=jet),
    Fault("degrees for radians", "gyro-units", mistake=degrees, names=lambda _: "degrees"),
    Fault("IMU mounting transposed", "imu-mounting", mistake=transposed, names=lambda _: "the transpose"),
    Fault("delay off by two cycles", "delay-mismatch", lambda _: ["actuators.delay_cycles=4.0"], names=lambda _: "shows 4"),
    Fault(
        "divert thrust 20 % low on one axis",
        "thrust-scale",
        lambda seed: failure([f"divert_{axis(seed)}p", f"divert_{axis(seed)}n"], 0.8),
        names=lambda seed: f"divert_{axis(seed)}p",
    ),
    Fault("gyro saturated, its range stated", "gyro-saturated", lambda _: ["vehicle.imu.gyro_range_rad_s=0.25"]),
)


@dataclass(frozen=True)
class Flown:
    """What one run said."""

    named: bool
    beside: tuple[str, ...]
    """Other warnings."""
    good: tuple[str, ...]
    """Quantities that are called converged, and are wrong."""
    mended: bool
    """Whether the mended answer is there and right."""


def flown(fault: Fault, seed: int) -> Flown:
    """One log with the fault."""
    flight = simulate.fly(scenario.load(SCENARIO, fault.keys(seed)), [seed])
    log, vehicle = fault.mistake(flight.log(0), flight.vehicle)
    with np.errstate(all="ignore"):  # as the command does
        found = analysis.examine(log, VehicleSource(vehicle, SCENARIO, ""))
    due = [n for n in found.notices if n.code == fault.code and fault.names(seed) in n.message]
    truth, sizes = flight.truth[0, 0], found.histories[0].natural_sizes.copy()
    own = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz", "mass")]
    sizes[own] = np.minimum(sizes[own], truth[own])
    estimates = [found.conclusions[0].estimates[name] for name in QUANTITIES]
    good = tuple(
        name
        for name, e, true, size in zip(QUANTITIES, estimates, truth, sizes, strict=True)
        if e.verdict == "converged" and abs((e.value or 0) - true) > max(SIGMAS * (e.sigma or 0), PART * size)
    )
    answers = [[c.estimates[name] for name in QUANTITIES] for answer in found.mended for c in answer.conclusions[:1]]
    right = [all(abs((e.value or 0) - true) <= SIGMAS * (e.sigma or 0) for e, true in zip(a, truth, strict=True)) for a in answers]
    return Flown(bool(due), tuple(sorted({n.code for n in found.notices} - {fault.code})), good, any(right))


def clean(name: str, seed: int) -> tuple[str, ...]:
    """The warnings of a log without fault."""
    flight = simulate.fly(scenario.load(name), [seed])
    notices = analysis.examine(flight.log(0), VehicleSource(flight.vehicle, name, "")).notices
    return tuple(sorted({notice.code for notice in notices} - {UNPHYSICAL}))


def main() -> None:
    """Faults first, then clean logs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="of each fault")
    parser.add_argument("--clean", type=int, default=250, help="seeds of each clean scenario")
    parser.add_argument("--first", type=int, default=1001)
    parser.add_argument("--fault", type=int, action="append", help="by number, from 0")
    arguments = parser.parse_args()
    print(HEAD.format(version=__version__, commit=commit(), first=arguments.first))
    with ProcessPoolExecutor() as pool:
        seeds = range(arguments.first, arguments.first + arguments.seeds)
        for number in arguments.fault if arguments.fault is not None else range(len(FAULTS)):
            fault = FAULTS[number]
            found = list(pool.map(partial(_by_number, number), seeds))
            missed = [seed for seed, one in zip(seeds, found, strict=True) if not one.named]
            beside = Counter(code for one in found for code in one.beside)
            others = ", ".join(f"{code} {n}" for code, n in beside.most_common()) or "none"
            good, mended = sum(bool(one.good) for one in found), sum(one.mended for one in found)
            print(
                f"| {fault.what} | {fault.code} | {len(seeds) - len(missed)} of {len(seeds)} | {good} | {mended} | {others} |", flush=True
            )
            if missed:
                print(f"<!-- missed in seeds {missed} -->", flush=True)
        print(CLEAN_HEAD)
        total = 0
        for name in CLEAN:
            seeds = range(arguments.first, arguments.first + arguments.clean)
            raised = Counter(code for codes in pool.map(partial(clean, name), seeds) for code in codes)
            total += sum(raised.values())
            said = ", ".join(f"{code} {n}" for code, n in raised.most_common()) or "none"
            print(f"| {name} | {len(seeds)} | {said} |", flush=True)
        print(f"\n{total} warnings in {len(CLEAN) * arguments.clean} clean logs.")


def _by_number(number: int, seed: int) -> Flown:
    return flown(FAULTS[number], seed)


HEAD = """# Faults named, and false alarms

Made by `python benchmarks/faults.py > docs/faults.md` at commit {commit} (massprop {version}), seeds from {first} on. A fault
counts as named if the warning points at it: the code, and the jet, axis, delay or unit in its text. "Looks good" counts the logs in which
any value is called converged and is more than 4 sigma and 0.5 % of its size off; "mended right" those whose mended answer holds the truth
within 4 sigma in all ten quantities.

| fault | warning due | named | looks good | mended right | other warnings |
|---|---|--:|--:|--:|---|"""
CLEAN_HEAD = """
A scale common to all thrust can't be seen in a log (mass and inertia are proportional to it); every report says so.

| clean scenario | logs | warnings |
|---|--:|---|"""

if __name__ == "__main__":
    main()
