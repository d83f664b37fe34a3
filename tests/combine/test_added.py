"""A known object between two logs as the scale of all values, against bodies and motion that are made apart from massprop."""

import dataclasses
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massprop_cli import ABOUT_PIVOT, CG, flow, job
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.combine import added
from massprop_cli.combine.flow import together, together_docked
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import build, schema, store
from massprop_cli.result.read import Recorded
from massprop_cli.testbed import bound, output, scenario
from tests import anypedestal
from tests.commandline import massprop, succeeded

BODY = scenario.load("free-flyer").scenario.truth.values


def point_masses(ten: Array) -> tuple[Array, Array]:
    """Places (7, 3) and masses (7,) of points that have these ten quantities: six on the principal axes, one at the CG."""
    moments, axes = np.linalg.eigh(np.array([ten[[0, 1, 2]], ten[[1, 3, 4]], ten[[2, 4, 5]]]))
    share = ten[9] / 8
    second = moments.sum() / 2 - moments  # sum of m x² along each axis
    arms = (axes * np.sqrt(second / (2 * share))).T
    return ten[6:9] + np.concatenate([arms, -arms, np.zeros((1, 3))]), np.array([*6 * [share], 2 * share])


def of_points(places: Array, masses: Array) -> Array:
    """(10,) of points."""
    cg = masses @ places / masses.sum()
    away = places - cg
    inertia = np.einsum("n,nij->ij", masses, (away**2).sum(1)[:, None, None] * np.eye(3) - away[:, :, None] * away[:, None, :])
    return np.array([*inertia[np.triu_indices(3)], *cg, masses.sum()])


def side(name: str, values: Array, spread: Array, about_pivot: bool = False) -> added.Side:
    return added.Side(name, values, spread, np.zeros(3), 0.0, about_pivot, {})


def drawn(seed: int, mass: float, sigma: float, scale: float) -> tuple[Array, Array, added.Calibrated]:
    """Truths of both sides, and what Gaussian logs of them and a weight of 3 cm come to, thrust being ``scale`` of what is stated."""
    rng = np.random.default_rng(seed)
    place = np.array([0.25, -0.1, 0.2])
    weight = point_masses(np.array([*(4e-4 * mass * np.eye(3))[np.triu_indices(3)], *place, mass]))
    alone = point_masses(BODY)
    both = of_points(*(np.concatenate(pair) for pair in zip(alone, weight, strict=True)))
    assert of_points(*alone) == pytest.approx(BODY, rel=1e-9)
    size, sides = 3e-4 * bound.natural_sizes(BODY), []
    for name, true in (("empty", BODY), ("loaded", both)):
        root = rng.normal(size=(10, 14)) * size[:, None] / 14**0.5
        seen = np.concatenate([true[:6] / scale, true[6:9], true[9:] / scale])
        sides.append(side(name, seen + root @ rng.normal(size=14), root @ root.T))
    said = {"mass": (mass + sigma * rng.normal(), sigma)}
    said |= {name: (where + 1e-3 * rng.normal(), 1e-3) for name, where in zip(CG, place, strict=True)}
    return BODY, both, added.calibrated((sides[0], sides[1]), said, 0.0)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(
    ("mass", "sigma", "draws"),
    [(2.0, 2e-3, 50), *(pytest.param(*one, 200, marks=[pytest.mark.thorough, pytest.mark.seeds]) for one in ((2.0, 2e-3), (0.5, 2e-2)))],
)
def test_over_many_draws_values_and_scale_lie_within_their_sigmas(mass: float, sigma: float, draws: int) -> None:
    """Body and weight are point masses; each draw has logs of its own precision. Bounds are 2.4 sigma and more of what chance leaves."""
    deviations, scales, chi_squares = [], [], []
    for seed in range(draws):
        *truths, found = drawn(seed, mass, sigma, 0.85)
        scales.append(((found.scale[0] - 0.85) / found.scale[1], found.scale[1] / 0.85))
        chi_squares.append(found.chi_square / found.freedom)
        for true, (values, covariance) in zip(truths, found.sides, strict=True):
            deviations.append((values - true) / np.sqrt(np.diag(covariance)))
        assert found.added[0][9] == pytest.approx(mass, abs=5 * sigma)
    z = np.array(deviations)
    chance = np.sqrt(200 / draws)
    assert abs((np.abs(z) < 1.96).mean() - 0.95) < 0.03 * chance
    assert abs(np.sqrt((np.array(scales)[:, 0] ** 2).mean()) - 1) < 0.12 * chance
    assert abs(np.mean(chi_squares) - 1) < 0.25 * chance
    # at best as well as the weight is known; at worst as the logs tell its mass
    logs = 3e-4 * 2**0.5 * BODY[9] / mass
    assert sigma / mass < np.median(np.array(scales)[:, 1]) < np.hypot(sigma / mass, logs) * 1.05


def test_a_known_mass_and_the_object_are_scales_together_or_contradict_each_other() -> None:
    """Oracle: both scales alone are independent; of two that agree the inverse variances add up."""
    scale, mass = 0.9, BODY[9]
    weight = np.concatenate([np.zeros(6), [0.2, 0.0, 0.0], [1.0]])
    both = of_points(*(np.concatenate(pair) for pair in zip(point_masses(BODY), (weight[None, 6:9], weight[9:]), strict=True)))
    spread = np.diag(1e-4 * bound.natural_sizes(BODY)) ** 2

    def found(known: float) -> added.Calibrated:
        seen = [np.concatenate([true[:6] / scale, true[6:9], true[9:] / scale]) for true in (BODY, both)]
        sides = [dataclasses.replace(side(name, one, spread), known={}) for name, one in zip(("a", "b"), seen, strict=True)]
        sides[0] = dataclasses.replace(sides[0], known={"mass": (known * mass, 2e-3 * mass)} if known else {})
        said = {"mass": (1.0, 2e-3)} | {name: (float(at), 0.0) for name, at in zip(CG, weight[6:9], strict=True)}
        return added.calibrated((sides[0], sides[1]), said, 0.0)

    alone, together_with = found(0.0).scale[1], found(1.0)
    assert together_with.scale[0] == pytest.approx(scale, rel=1e-6)
    assert together_with.scale[1] == pytest.approx((alone**-2 + (2e-3 * scale) ** -2) ** -0.5, rel=0.02)
    with pytest.raises(InputError, match=r"a: known.mass = .* and --added contradict each other by .* check both"):
        found(1.05)


def recorded(name: str, answer: flow.Analysis) -> Recorded:
    made = build.result(answer)
    found = made.model_copy(update={"provenance": made.provenance.model_copy(update={"input_sha256": name})})
    return Recorded(Path(name) / "result.json", schema.Result.model_validate(found.model_dump(by_alias=True)), {}, name)


def stated_wrong(vehicle: dict[str, Any], scale: float) -> dict[str, Any]:
    """The vehicle file with forces and wheel inertias of which the true ones are ``scale``."""
    for jet in vehicle.get("jets", ()):
        jet["force_n"] = [one / scale for one in jet["force_n"]]
    for wheel in vehicle.get("wheels", ()):
        wheel["spin_inertia_kg_m2"] /= scale
    return vehicle


def loaded(own: anypedestal.Tables, mass: Array, place: Array) -> anypedestal.Tables:
    """The tables with point masses (V,) at places (V, 3)."""
    both = [
        of_points(*(np.concatenate(pair) for pair in zip(point_masses(ten), (at[None], [one]), strict=True)))
        for ten, at, one in zip(own.ten, place, mass, strict=True)
    ]
    inertia = np.array([[[b[0], b[1], b[2]], [b[1], b[3], b[4]], [b[2], b[4], b[5]]] for b in both])
    return dataclasses.replace(own, inertia=inertia, mass=np.array(both)[:, 9], cg=np.array(both)[:, 6:9])


def on_pedestals(
    seed: int, kind: anypedestal.Kind, count: int, scale: float, logs: int = 1, sides: int = 2
) -> tuple[anypedestal.Tables, list[tuple[list[Recorded], list[Recorded], str]]]:
    """Results of logs of tables without and with a weight of 2 g per kg, whose mass is known to 0.2 % and its place to 0.1 mm.

    With one of the ``sides`` those without it alone.
    """
    rng = np.random.default_rng(seed)
    own = anypedestal.tables(rng, count)
    mass = 2e-3 * own.mass
    place = own.pivot + 0.13 * own.mass[:, None] ** (1 / 3) * np.array([0.5, -0.3, -0.6])
    found: list[tuple[list[Recorded], list[Recorded]]] = [([], []) for _ in range(count)]
    for half, bodies in enumerate((own, loaded(own, mass, place))[:sides]):
        for number in range(logs):
            flown = anypedestal.fly(rng, bodies, kind, 0.05, 30.0)
            for body in range(count):
                true = anypedestal.vehicle_of(bodies, body, flown)
                used = type(true).model_validate(stated_wrong(true.model_dump(by_alias=True, exclude_unset=True, mode="json"), scale))
                log = anypedestal.log_of(rng, bodies, body, flown, used)
                found[body][half].append(recorded(f"{half}-{body}-{number}", flow.examine(log, VehicleSource(used, "", ""))))
    said = []
    for weighed, where in zip(mass * (1 + 2e-3 * rng.normal(size=count)), place + 1e-4 * rng.normal(size=(count, 3)), strict=True):
        said.append(f"mass={float(weighed)!r}+-{2e-3 * weighed:g} position={','.join(map(repr, where.tolist()))}+-1e-4")
    return own, [(*sides, text) for sides, text in zip(found, said, strict=True)]


def nine_of(phase: schema.PhaseItem) -> tuple[Array, Array]:
    """(9,) values and sigmas about the pivot."""
    items = [phase.about_pivot[name] for name in ABOUT_PIVOT]
    return np.array([item.value for item in items], dtype=float), np.array([item.sigma for item in items], dtype=float)


@pytest.mark.thorough
def test_logs_of_a_table_on_a_pedestal_add_up_about_its_pivot() -> None:
    own, ((before, _, _),) = on_pedestals(1, "jets", 1, 1.0, logs=2, sides=1)
    (phase,) = together(before).phases
    values, sigmas = nine_of(phase)
    single = [np.array(one.result.phases[0].about_pivot_covariance, dtype=float) for one in before]
    linear = np.linalg.inv(np.linalg.inv(single[0]) + np.linalg.inv(single[1]))
    np.testing.assert_allclose(sigmas, np.sqrt(np.diag(linear)), rtol=0.01)
    assert np.abs((values - own.nine[0]) / sigmas).max() < 4
    assert {item.verdict for item in phase.about_pivot.values()} == {"converged"}
    assert {item.reason_code for item in phase.estimates.values()} == {"unweighed-pedestal"}


@pytest.mark.parametrize(
    ("kind", "count"),
    [("jets", 1), *(pytest.param(kind, 6, marks=[pytest.mark.thorough, pytest.mark.seeds]) for kind in ("jets", "wheels"))],
)
def test_a_weight_on_a_pedestal_is_the_scale(kind: anypedestal.Kind, count: int) -> None:
    """Thrust and wheels give 0.9 of what is stated; motion is integrated apart (tests/anypedestal.py)."""
    own, logs = on_pedestals(5, kind, count, 0.9)
    deviations, scales = [], []
    for true, (before, after, text) in zip(own.nine, logs, strict=True):
        found = together_docked(before, after, added=text)
        values, sigmas = nine_of(found.phases[0])
        deviations.append((values - true) / sigmas)
        implied = found.phases[0].implied_thrust_scale
        assert implied is not None
        scales.append(((implied.value - 0.9) / implied.sigma, implied.sigma))
        assert found.phases[0].contradiction == ""
        assert "contradicted" not in {item.verdict for item in found.phases[1].about_pivot.values()}
    z, (apart, sigma) = np.array(deviations), np.array(scales).T
    assert np.abs(z).max() < 4.5
    assert np.abs(apart).max() < 4
    assert np.median(sigma) < 0.01
    if count > 1:
        assert abs((np.abs(z) < 1.96).mean() - 0.95) < 2.5 * np.sqrt(0.95 * 0.05 / (z.size / 3))


def estimated(folder: Path, name: str, scale: float, *settings: str) -> None:
    """A packaged scenario's log, estimated with forces of which the true ones are ``scale``."""
    with np.errstate(all="ignore"):
        output.simulate(scenario.load(name, settings), folder / f"{name}-log", 1, 1)
    log = next((folder / f"{name}-log").rglob("log.parquet"))
    jets = stated_wrong(tomllib.loads(log.with_name("vehicle.toml").read_text()), scale)["jets"]
    found = job.of_file(log, assignments=(f"jets={json.dumps(jets)}".replace('": ', '" = '),))
    store.write(folder / name, found.analysis, escape.document(found.result))


CUBE = "mass=12+-0.006 position=0.8,0,0+-1e-4 inertia=0.5,0,0,0.5,0,0.5+-5e-3"


@pytest.fixture(scope="module")
def bearings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a vehicle on a sliding bearing, and with a cube of 12 kg on another, by jets that give 0.94 of what is stated."""
    found = tmp_path_factory.mktemp("bearings")
    for name in ("testbed", "testbed-joined"):
        estimated(found, name, 0.94)
    return found


def test_a_docked_object_that_is_known_calibrates_vehicle_and_both_together(bearings: Path) -> None:
    done = succeeded(bearings, "combine", "--before", "testbed", "--after", "testbed-joined", "--added", CUBE, "--out", "known", "--json")
    found = schema.Result.model_validate_json(done.stdout)
    for phase, name, at in zip(found.phases, ("testbed", "testbed-joined"), np.array([[0.0, 0, 0], [0.3, 0, 0]]), strict=True):
        truth = scenario.load(name).scenario.truth.values
        z = [(item.value - true) / item.sigma for item, true in zip(phase.estimates.values(), truth, strict=True)]
        assert np.abs(z).max() < 4
        arm = truth[6:9] - at
        about = of_points(*point_masses(np.array([*truth[:6], *truth[6:9], truth[9] - 5.0])))
        turning = about[9] * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))[np.triu_indices(3)] + about[:6]
        values, sigmas = nine_of(phase)
        assert np.abs((values - np.concatenate([turning, about[9] * arm])) / sigmas).max() < 4
        implied = phase.implied_thrust_scale
        assert implied is not None
        assert abs(implied.value - 0.94) < 4 * implied.sigma < 0.005
    assert found.docked_object is not None
    assert found.docked_object.known["mass"] == (12.0, 0.006)
    assert massprop(bearings, "report", "known", "--format", "md", "--out", "page").returncode == 0
    assert "The added object implies 0.94" in (bearings / "page" / "report.md").read_text()


def test_a_log_of_a_sliding_bearing_tells_the_first_moment_about_it_better_than_the_cg(bearings: Path) -> None:
    """By jets at 0.94 of what is stated inertia and first moment come out as 1/0.94 of the true ones, mass without the bearing's."""
    phase = schema.Result.model_validate_json((bearings / "testbed" / "result.json").read_text()).phases[0]
    truth = scenario.load("testbed").scenario.truth.values
    values, sigmas = nine_of(phase)
    moment = truth[6:9] * (truth[9] - 5.0) / 0.94
    assert np.abs((values[6:] - moment) / sigmas[6:]).max() < 4
    assert (sigmas[6:] < 2e-3 * np.abs(moment)).all()
    assert {item.verdict for item in phase.about_pivot.values()} == {"converged"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mass=12", "position of the object is missing"),
        ("mass=12kg position=0,0,0", "expected 1 finite number and"),
        ("mass=12 position=0.8,0", "expected 3 finite numbers"),
        ("mass=12 weight=3 position=0.8,0,0", "'weight=3': state mass, position and inertia"),
        ("mass=-12 position=0.8,0,0", "mass = -12 kg must be above 0"),
        ("mass=12+--1 position=0.8,0,0", "a sigma of at least 0"),
    ],
)
def test_a_text_that_states_no_object_is_refused_with_a_remedy(text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        added.stated(text)


def test_swapped_sides_a_place_in_other_axes_and_a_lone_log_are_refused_or_contradicted(bearings: Path) -> None:
    swapped = massprop(bearings, "combine", "--before", "testbed-joined", "--after", "testbed", "--added", CUBE, "--out", "swapped")
    assert (swapped.returncode, swapped.stderr.count("\n")) == (3, 1)
    assert "whether --before and --after are swapped" in swapped.stderr
    elsewhere = CUBE.replace("0.8,0,0+", "0.8,0.01,0+")
    wrong = massprop(bearings, "combine", "--before", "testbed", "--after", "testbed-joined", "--added", elsewhere, "--out", "wrong", "-q")
    assert wrong.returncode == 6
    assert "check its mass, its position from O in body axes" in wrong.stderr
    lone = massprop(bearings, "combine", "testbed", "testbed-joined", "--added", CUBE, "--out", "lone")
    assert lone.returncode == 2
    assert "--before" in lone.stderr
