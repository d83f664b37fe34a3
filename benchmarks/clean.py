"""What estimates of clean logs are worth on every platform: random vehicles, flown by simulators that share no code with the estimator.

    python benchmarks/clean.py --count 40 --jobs 2
    python benchmarks/clean.py --count 4 --platform bearing --twins

Each log is wholly explained by its vehicle file, so whatever is named, contradicted or refused is a false alarm. The same motions are
estimated without and with biases of gyro and accelerometer (1e-3 rad/s and 0.01 m/s², one sigma, stated), and with the delay stated or
"auto". ``--twins`` logs them without noise, the vehicle file unchanged: there every deviation is the estimator's own error.

Columns: values within 1.96 sigma, rms and largest deviation in sigmas; values that are converged beyond 4.5 sigma; logs of which a cause
is named, that are contradicted, or refused; values of these environments that are not converged. Not among the platforms: docking, jets
beside wheels.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scores import covered, rms_of
from script import counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli import ABOUT_PIVOT, QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anyimu, anypedestal, anyrotors

BATCH, PERIOD_S, DELAY = 4, 0.05, 2.0
BIAS = anypedestal.BIAS
BEYOND = 4.5
"""Sigmas beyond which a converged value is wrong."""
SAID = ("noise-", "initial-")
"""How codes of notices begin that name no cause."""


class Case(NamedTuple):
    """One way to estimate a motion."""

    platform: str
    biases: bool
    auto: bool

    def __str__(self) -> str:
        return f"{self.platform} | {'yes' if self.biases else 'no'} | {'auto' if self.auto else 'stated'}"


class Told(NamedTuple):
    """What massprop reports on one log."""

    case: Case
    seed: int
    deviations: Array
    """(n,) in sigmas, of all values given."""
    converged: Array
    """(n,) whether each is called so."""
    not_given: int
    contradicted: bool
    codes: tuple[str, ...]
    refused: str


class Motion(NamedTuple):
    """A batch that was flown: what makes log and vehicle file of one of its bodies, and the true values of each."""

    logged: Callable[[int, Case, np.random.Generator, float], tuple[Log, Vehicle]]
    names: tuple[str, ...]
    truth: Array
    """(BATCH, names)"""
    delayed: bool
    """Whether commands act after a delay."""


def by_jets(rng: np.random.Generator, bearing: bool, planar: bool = False) -> Motion:
    """Free flyers, sliding bearings, or tables (flyers that no jet pushes or turns out of the plane)."""
    own = anyimu.bodies(rng, BATCH, bearing)
    if planar:
        own = _flat(own)
    imu = anyimu.Imu(measures="increment", gyro_noise=float(10 ** rng.uniform(-4, -3)), accel_noise=float(10 ** rng.uniform(-2.3, -1.5)))
    flown = anyimu.fly(rng, own, imu, PERIOD_S, 30.0, DELAY * PERIOD_S, noise=0.0)
    if planar:
        flown = replace(flown, accel=flown.accel + anyimu.GRAVITY / imu.rate_hz * np.array([0.0, 0.0, 1.0]))

    def logged(body: int, case: Case, draw: np.random.Generator, noise: float) -> tuple[Log, Vehicle]:
        used = anyimu.vehicle_of(own, body, flown, imu, PERIOD_S, DELAY * PERIOD_S, stated=True)
        noisy = []
        for sensor, sigma, bias in ((flown.gyro, imu.gyro_noise, BIAS[0]), (flown.accel, imu.accel_noise, BIAS[1])):
            constant = bias * draw.normal(size=3) * case.biases
            noisy.append(sensor + (constant + noise * sigma * draw.normal(size=sensor.shape)) / imu.rate_hz)
        environment: dict[str, Any] = {"environment": {"kind": "planar", "table_tilt_sigma_rad": 0.0}} if planar else {}
        used = _stated(used, case, environment)
        return anyimu.log_of(replace(flown, gyro=noisy[0], accel=noisy[1]), body, imu, used), used

    return Motion(logged, QUANTITIES, np.array([anyimu.truth_of(own, body) for body in range(BATCH)]), True)


def _flat(own: anyimu.Bodies) -> anyimu.Bodies:
    inertia, flat = own.inertia.copy(), np.array([1.0, 1.0, 0.0])
    inertia[:, 2, :2] = inertia[:, :2, 2] = 0.0
    return replace(
        own, inertia=inertia, cg=own.cg * flat, jet_position=own.jet_position * flat, jet_force=own.jet_force * flat, planar=True
    )


def about_a_point(rng: np.random.Generator, kind: anypedestal.Kind, free: bool = False, whole_rpm: bool = False) -> Motion:
    """Tables on a fixed pedestal, or free bodies that wheels turn about their CG; the speeds of these as they are, or in whole rpm."""
    own = anypedestal.tables(rng, BATCH)
    own = replace(own, pivot=own.cg) if free else own
    flown = anypedestal.fly(rng, own, kind, PERIOD_S, 60.0 if kind == "swing" else 30.0, 0.0 if free else anypedestal.GRAVITY)

    def logged(body: int, case: Case, draw: np.random.Generator, noise: float) -> tuple[Log, Vehicle]:
        known = {}
        size = 0.01 * float(np.trace(own.inertia[body])) / 3
        if kind == "swing":
            pairs = zip(QUANTITIES[:6], own.about_pivot[body][np.triu_indices(3)], strict=True)
            known = {name: {"value": float(value + noise * size * draw.normal()), "sigma": size} for name, value in pairs}
        more: dict[str, Any] = {"environment": {"kind": "free"}} if free else {}
        used = _stated(anypedestal.vehicle_of(own, body, flown, case.biases, **known), case, more)
        log = anypedestal.log_of(draw, own, body, flown, used, noise, case.biases)
        return anypedestal.in_whole_rpm(log) if whole_rpm else log, used

    return Motion(logged, QUANTITIES if free else ABOUT_PIVOT, own.ten if free else own.nine, kind == "jets")


def by_rotors(rng: np.random.Generator) -> Motion:
    """Multicopters whose log begins in flight."""
    own = anyrotors.multicopters(rng, BATCH)
    flown = anyrotors.fly(rng, own, PERIOD_S / 4, 1600)

    def logged(body: int, case: Case, draw: np.random.Generator, noise: float) -> tuple[Log, Vehicle]:
        used = _stated(anyrotors.vehicle_of(own, body, flown), case, {})
        return anypedestal.log_of(draw, own, body, flown, used, noise, case.biases), used

    return Motion(logged, QUANTITIES, own.ten, True)


def _stated(used: Vehicle, case: Case, more: dict[str, Any]) -> Vehicle:
    """The vehicle file with the biases and the delay of a case."""
    data = used.model_dump(by_alias=True, exclude_unset=True, mode="json") | more
    if case.biases:
        data["imu"] |= {"gyro_bias_sigma_rad_s": BIAS[0], "accel_bias_sigma_m_s2": BIAS[1]}
    if case.auto:
        data["cycle"] |= {"command_delay_cycles": "auto"}
    return Vehicle.model_validate(data)


PLATFORMS: dict[str, Callable[[np.random.Generator], Motion]] = {
    "free": partial(by_jets, bearing=False),
    "bearing": partial(by_jets, bearing=True),
    "planar": partial(by_jets, bearing=False, planar=True),
    "wheels": partial(about_a_point, kind="wheels", free=True),
    "wheels in whole rpm": partial(about_a_point, kind="wheels", free=True, whole_rpm=True),
    "rotors": by_rotors,
    "pedestal, jets": partial(about_a_point, kind="jets"),
    "pedestal, wheels": partial(about_a_point, kind="wheels"),
    "pedestal, wheels in whole rpm": partial(about_a_point, kind="wheels", whole_rpm=True),
    "pedestal, swing": partial(about_a_point, kind="swing"),
}


def estimated(platform: str, seed: int, count: int, noise: float) -> list[Told]:
    """The outcome of ``count`` bodies of one batch in every case."""
    number = list(PLATFORMS).index(platform)
    motion, found = PLATFORMS[platform](np.random.default_rng([seed, number])), []
    for body in range(count):
        truth = dict(zip(motion.names, motion.truth[body].tolist(), strict=True))
        for case in (Case(platform, biases, auto) for biases in (False, True) for auto in (False, True)[: 1 + motion.delayed]):
            log, used = motion.logged(body, case, np.random.default_rng([seed, body, case.biases, number]), noise)
            found.append(_told(case, BATCH * seed + body, log, used, truth))
    return found


def _told(case: Case, seed: int, log: Log, used: Vehicle, truth: dict[str, float]) -> Told:
    none = np.zeros(0)
    try:
        with np.errstate(all="ignore"):
            answer = flow.examine(log, VehicleSource(used, "clean", ""))
    except InputError as error:
        return Told(case, seed, none, none, len(truth), False, (), str(error))
    except Exception as error:  # a defect, and a row of the table like any other
        return Told(case, seed, none, none, len(truth), False, (), f"crashed: {error!r}")
    (conclusion,) = answer.conclusions
    items = conclusion.about_pivot if used.on_pedestal else conclusion.estimates
    wanted = {name: one for name, one in items.items() if one.verdict != "unobservable"}
    given = {name: one for name, one in wanted.items() if one.value is not None and one.sigma}
    deviations = np.array([((one.value or 0.0) - truth[name]) / (one.sigma or 1.0) for name, one in given.items()])
    return Told(
        case,
        seed,
        deviations,
        np.array([one.verdict == "converged" for one in given.values()]),
        sum(one.verdict in ("not_excited", "not_converged") for one in wanted.values()),
        any(one.verdict == "contradicted" for one in items.values()),
        tuple(notice.code for notice in answer.notices if not notice.code.startswith(SAID)),
        "",
    )


def row(case: Case, found: list[Told]) -> str:
    """A row of the table."""
    z, converged = (np.concatenate([getattr(one, key) for one in found]) for key in ("deviations", "converged"))
    wrong = int((converged.astype(bool) & (np.abs(z) > BEYOND)).sum())
    named = sum(bool(one.codes) for one in found)
    numbers = f"{covered(z)} | {rms_of(z)} | {np.abs(z).max(initial=0):.1f}" if len(z) else "- | - | -"
    counts = (
        wrong,
        named,
        sum(one.contradicted for one in found),
        sum(bool(one.refused) for one in found),
        sum(one.not_given for one in found),
    )
    return f"| {case} | {len(found)} | {numbers} | {' | '.join(map(str, counts))} |"


def flights(platforms: list[str], first: int, count: int) -> Iterator[tuple[str, int, int]]:
    """Platform, seed and number of bodies of each batch."""
    for platform in platforms:
        for number in range(0, count, BATCH):
            yield platform, first + number // BATCH, min(BATCH, count - number)


def main() -> None:
    """Print the table, then each log with a false alarm."""
    parser = counted(__doc__, seed=0, jobs=1)
    parser.add_argument("--count", type=int, default=40, help="vehicles of each platform")
    parser.add_argument("--platform", action="append", choices=list(PLATFORMS))
    parser.add_argument("--twins", action="store_true", help="without noise")
    asked = parser.parse_args()
    found: list[Told] = []
    with ProcessPoolExecutor(asked.jobs) as pool:
        wanted = flights(asked.platform or list(PLATFORMS), asked.seed, asked.count)
        running = [pool.submit(estimated, *each, 0.0 if asked.twins else 1.0) for each in wanted]
        for batch in running:
            found += batch.result()
    print("| platform | biases | delay | logs | 95 % cover | rms z | worst | wrong | named | contradicted | refused | not given |")
    print("|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    for case in dict.fromkeys(one.case for one in found):
        print(row(case, [one for one in found if one.case == case]))
    print()
    for one in found:
        wrong = np.abs(one.deviations[one.converged.astype(bool)]).max(initial=0) > BEYOND
        if wrong or one.codes or one.contradicted or one.refused:
            worst = np.abs(one.deviations).max(initial=0)
            print(f"- {one.case}, vehicle {one.seed}: worst {worst:.1f} sigma, {', '.join(Counter(one.codes))} {one.refused}".rstrip(" ,"))


if __name__ == "__main__":
    main()
