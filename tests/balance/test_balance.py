"""``massprop balance``: log, estimate, move, log again; what it refuses, and how it ends."""

import contextlib
import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner, Result

import massprop_cli
from massprop_cli import job, schemas
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.cli import app
from massprop_cli.result import build
from tests import anypedestal, balanced
from tests.commandline import massprop

SCENARIO = Path(massprop_cli.__file__).parent / "testbed" / "scenarios" / "pedestal.toml"
PIVOT, CG, MASS = np.array([0.0, 0.0, 0.02]), np.array([2e-4, -1e-4, 0.019]), 12.0
INERTIA = np.array([[0.32, 0.004, -0.003], [0.004, 0.36, 0.005], [-0.003, 0.005, 0.41]])
PLACES = np.array([[0.0, 0.15, 0.0], [0.15, 0.0, 0.0], [0.0, -0.15, 0.0]])
STATED, WEIGHS = np.array([0.3, 0.3, 0.5]), np.array([0.3, 0.3, 0.5]) * np.array([1.001, 0.9995, 1.0008])
SLIDES: list[dict[str, Any]] = [
    {"name": name, "mass_kg": float(mass), "mass_sigma_kg": 1e-3 * float(mass), "axis": axis, "position_m": place}
    | {"travel_m": [-0.04, 0.04]}
    for name, mass, axis, place in zip("xyz", STATED, np.eye(3).tolist(), PLACES.tolist(), strict=True)
]


def record(folder: Path, name: str, seed: int, cg: Array, inertia: Array) -> None:
    """A log of 20 s of the packaged table with other mass properties, and its result."""
    text = SCENARIO.read_text(encoding="utf-8").replace("_cycle = 1100", "_cycle = 350").replace("_cycle = 1200", "_cycle = 400")
    (folder / f"{name}.toml").write_text(text.replace("duration_s = 60.0", "duration_s = 20.0"), encoding="utf-8")
    truth = dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia[np.triu_indices(3)], strict=True))
    truth |= dict(zip(("cg_x", "cg_y", "cg_z"), cg, strict=True))
    settings = [word for key, value in truth.items() for word in ("--set", f"truth.{key}={float(value)!r}")]
    assert massprop(folder, "simulate", f"{name}.toml", "--seed", str(seed), "-q", "--out", f"{name}-log", *settings).returncode == 0
    assert massprop(folder, "estimate", f"{name}-log/log.parquet", "-q", "--out", name).returncode == 0


def moved(by: Array) -> tuple[Array, Array]:
    """True CG and inertia about it once the three weights, as they truly weigh, have slid by (3,) m: sums over points."""
    points = [*zip(-WEIGHS, PLACES, strict=True), *zip(WEIGHS, PLACES + np.diag(by), strict=True)]
    cg = CG + sum((mass * at for mass, at in points), np.zeros(3)) / MASS
    arms = [(MASS, CG - cg), *((mass, at - cg) for mass, at in points)]
    return cg, INERTIA + sum((mass * (r @ r * np.eye(3) - np.outer(r, r)) for mass, r in arms), np.zeros((3, 3)))


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ballast.toml and the result ``first``."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "ballast.toml").write_text(tomli_w.dumps({"ballast": SLIDES}), encoding="utf-8")
    record(folder, "first", 1, CG, INERTIA)
    return folder


@pytest.fixture(scope="module")
def plan(lab: Path) -> dict[str, Any]:
    """What it says to do first."""
    return told(ran(lab, "first", "--ballast", "ballast.toml", "--json"))


def ran(folder: Path, *arguments: str) -> Result:
    """``massprop balance`` in this process."""
    with contextlib.chdir(folder):
        return CliRunner().invoke(app, ["balance", *arguments])


def told(done: Result, code: int = 0) -> dict[str, Any]:
    assert done.exit_code == code, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    jsonschema.validate(found, schemas.schema("balance"))
    return found


def refused(folder: Path, *arguments: str, code: int = 3) -> str:
    done = ran(folder, *arguments)
    assert done.exit_code == code, done.stderr
    assert done.stderr.count("\n") == 1
    assert code != 3 or done.stdout == ""
    return done.stderr


def test_a_table_is_balanced_in_one_go_and_a_second_log_shows_it(lab: Path, plan: dict[str, Any]) -> None:
    by = np.array([one["by_mm"] for one in plan["plan"]["changes"]]) / 1000
    assert by == pytest.approx(-(MASS * (CG - PIVOT) - plan["plan"]["wanted"]["kg_m"]) / STATED, abs=2e-5)
    cg, inertia = moved(by)
    true, remainder = MASS * (cg - PIVOT), plan["plan"]["remainder"]
    z = (true - remainder["moment"]["kg_m"]) / remainder["moment"]["sigma_kg_m"]
    assert np.abs(z).max() < 1.96
    assert np.linalg.norm(true - plan["plan"]["wanted"]["kg_m"]) < 0.01 * MASS * np.linalg.norm(CG - PIVOT)
    assert remainder["period_s"][0] == pytest.approx(60.0, abs=0.5)
    assert remainder["tilt_rad"] < 1e-6
    record(lab, "second", 2, cg, inertia)
    after = ("first", "--after", "second", "--ballast", "ballast.toml")
    found = told(ran(lab, *after, "--json"))
    check = found["check"]
    assert check["source"] == "recommended"
    assert check["as_predicted"]
    assert np.abs(np.array(found["now"]["moment"]["kg_m"]) - true).max() < 4 * max(found["now"]["moment"]["sigma_kg_m"])
    for one, mass in zip(check["masses"], WEIGHS, strict=True):
        assert abs(one["refined_kg"] - mass) < 3 * one["refined_sigma_kg"]
        assert one["refined_sigma_kg"] < 0.5 * one["stated_sigma_kg"]
    assert [one["to_mm"] for one in found["plan"]["changes"]] == pytest.approx(1000 * by, abs=0.1)
    shown = ran(lab, *after).stdout
    assert "As predicted: chi-square" in shown
    assert "Mass of z: 0.5 ± 0.00050 kg stated; 0.500" in shown
    # had z been moved by a millimetre less than stated, both logs would say so
    wrong = [f"{name}={1000 * d + (name == 'z')}" for name, d in zip("xyz", by, strict=True)]
    done = ran(lab, *after, "--moved", ",".join(wrong), "--json")
    check = told(done, 5)["check"]
    assert "did not change as predicted" in done.stderr
    assert check["difference"]["g_cm"][2] == pytest.approx(-50.0, abs=2)
    assert check["p"] < 1e-3


def test_what_it_shows(lab: Path) -> None:
    done = ran(lab, "first", "--ballast", "ballast.toml")
    assert done.exit_code == 0
    assert re.search(r"move -(7\.99|8\.00)\d mm", done.stdout)
    assert re.search(r"-(239|240)\.\d+ │ +0 │ +0 │", done.stdout)
    for said in ("g cm", "N m", "kg m", "longer swing period is 60 s", "Small swings: now 1"):
        assert said in done.stdout
    assert ran(lab, "first", "--ballast", "ballast.toml", "-q").stdout == ""


def test_another_remainder_is_left_where_it_is_stated(lab: Path) -> None:
    found = told(ran(lab, "first", "--ballast", "ballast.toml", "--json", "--leave", "z = -0.2 N m, x=50 g*cm"))
    assert found["plan"]["wanted"]["kg_m"] == pytest.approx([5e-4, 0.0, -0.2 / 9.80665])
    assert found["plan"]["remainder"]["moment"]["n_m"] == pytest.approx([5e-4 * 9.80665, 0.0, -0.2], abs=1e-12)
    assert found["plan"]["wanted"]["default"] == ["y"]


def test_a_ballast_that_cannot_reach_goes_as_far_as_it_can(lab: Path) -> None:
    short = [SLIDES[0] | {"travel_m": [-0.005, 0.005]}, *SLIDES[1:]]
    (lab / "short.toml").write_text(tomli_w.dumps({"ballast": short}), encoding="utf-8")
    done = ran(lab, "first", "--ballast", "short.toml", "--json")
    found = told(done, 5)["plan"]
    assert found["changes"][0]["by_mm"] == pytest.approx(-5.0)
    assert found["changes"][0]["at_limit"]
    assert found["remainder"]["moment"]["g_cm"][0] == pytest.approx(240 - 150, abs=1)
    assert found["remainder"]["moment"]["g_cm"][1] == pytest.approx(0, abs=1e-3)
    assert re.search(r"x stays \+(89\.9|90)\S* g cm from the wanted value; at their limits: x\n", done.stderr)


def test_without_a_ballast_along_the_vertical_level_is_enough(lab: Path) -> None:
    """Where nobody states z, a table that hangs lower than by default is balanced; stated, it is not."""
    (lab / "level.toml").write_text(tomli_w.dumps({"ballast": SLIDES[:2]}), encoding="utf-8")
    found = told(ran(lab, "first", "--ballast", "level.toml", "--json"))["plan"]
    assert found["reached"]
    assert found["remainder"]["moment"]["g_cm"] == pytest.approx([0, 0, -1200], abs=1)
    said = refused(lab, "first", "--ballast", "level.toml", "-q", "--leave", "z=-500 g cm", code=5)
    assert re.search(r"z stays -(699|700)\S* g cm from the wanted value; no ballast acts in that direction\n", said)


def test_weight_is_added_where_nothing_slides(lab: Path) -> None:
    trays = [
        {"name": name, "position_m": place, "max_mass_kg": 0.1, "mass_sigma_kg": 1e-5}
        for name, place in (("-x", [-0.2, 0.0, 0.02]), ("+x", [0.2, 0.0, 0.02]), ("+y", [0.0, 0.2, 0.02]))
    ]
    (lab / "trays.toml").write_text(tomli_w.dumps({"ballast": trays}), encoding="utf-8")
    found = told(ran(lab, "first", "--ballast", "trays.toml", "--json"))["plan"]
    assert [one["add_kg"] for one in found["changes"]] == pytest.approx([0.012, 0.0, 0.006], abs=2e-5)
    assert re.search(r"add (11\.9|12\.0)\d+ g", ran(lab, "first", "--ballast", "trays.toml").stdout)


def test_the_vehicle_file_s_ballast_is_carried_by_the_result(lab: Path, plan: dict[str, Any]) -> None:
    vehicle = (lab / "first-log" / "vehicle.toml").read_text(encoding="utf-8")
    (lab / "with.toml").write_text(vehicle + tomli_w.dumps({"ballast": SLIDES}), encoding="utf-8")
    found = job.of_file(lab / "first-log" / "log.parquet", lab / "with.toml").analysis
    (lab / "carrying").mkdir()
    (lab / "carrying" / "result.json").write_text(escape.document(build.result(found)), encoding="utf-8")
    for arguments in (("carrying",), ("first", "--ballast", "with.toml")):
        assert told(ran(lab, *arguments, "--json"))["plan"] == plan["plan"]


REFUSED: dict[str, tuple[Any, tuple[str, ...]]] = {
    "an unknown key": ({"mas_kg": 0.3}, ("b.toml, line", "mas_kg", "'mass_kg'")),
    "no mass": ({"mass_kg": None}, ("b.toml", "ballast.0.mass_kg", "is missing", "max_mass_kg")),
    "a travel of no length": ({"travel_m": [0.04, -0.04]}, ("ballast.0.travel_m", "[0.04, -0.04]", "least travel")),
    "a place beyond its travel": ({"at_m": 0.05}, ("ballast.0.at_m", "0.05 m", "[-0.04, 0.04]")),
    "both kinds at once": ({"max_mass_kg": 0.1}, ("ballast.0.mass_kg", "state two")),
    "an axis of no length": ({"axis": [0, 0, 0]}, ("ballast.0.axis", "has length 0")),
    "a name that is used twice": ({"name": "y"}, ("'y' is used twice",)),
    "a place in millimetres": (
        {"mass_kg": 1.0, "position_m": [0.0, 0.0, -150.0], "axis": [0, 0, 1]},
        ("inertia that no real body has", "mass_kg", "--ballast"),
    ),
    "a sigma in grams": ({"mass_sigma_kg": 0.5}, ("ballast.0.mass_sigma_kg", "0.5 kg is more than mass_kg itself")),
    "a negative mass": ({"mass_kg": -0.3}, ("ballast.0.mass_kg = -0.3",)),
}


@pytest.mark.parametrize("mistake", REFUSED)
def test_a_bad_ballast_file_is_refused_with_its_key(mistake: str, lab: Path, tmp_path: Path) -> None:
    change, names = REFUSED[mistake]
    first = {key: value for key, value in (SLIDES[0] | change).items() if value is not None}
    (tmp_path / "b.toml").write_text(tomli_w.dumps({"ballast": [first, *SLIDES[1:]]}), encoding="utf-8")
    said = refused(tmp_path, str(lab / "first"), "--ballast", "b.toml")
    assert all(name in said for name in names), said


@pytest.mark.parametrize(
    ("arguments", "code", "names"),
    [
        ((), 3, ("carries no [[ballast]]", "--ballast")),
        (("--ballast", "none.toml"), 3, ("none.toml: no such ballast file",)),
        (("--ballast", "first-log/vehicle.toml"), 3, ("vehicle.toml: is a vehicle file without [[ballast]]",)),
        (("--ballast", "ballast.toml", "--leave", "z=-5 cm"), 3, ("--leave 'z=-5 cm'", "'cm' is not a unit", "g cm")),
        (("--ballast", "ballast.toml", "--leave", "down 5"), 3, ("--leave 'down 5'", "write for instance")),
        (("--ballast", "ballast.toml", "--leave", "z=1 g cm, z=2 g cm"), 3, ("state each component once",)),
        (("--ballast", "ballast.toml", "--moved", "x=1"), 2, ("--after",)),
        (("--ballast", "ballast.toml", "--after", "first"), 3, ("same log as",)),
        (("--ballast", "ballast.toml", "--phase", "second"), 3, ("has no phase 'second'", "it has all")),
        (("--ballast", "ballast.toml", "--after", "again", "--moved", "xx=1"), 3, ("--moved 'xx=1'", "no ballast 'xx'", "'x'")),
        (("--ballast", "ballast.toml", "--after", "again", "--moved", "x=50"), 3, ("--moved 'x=50'", "-40 to 40 mm", "travel_m")),
        (("--ballast", "ballast.toml", "--after", "again", "--moved", "x:50"), 3, ("not NAME=NUMBER",)),
    ],
)
def test_what_cannot_be_understood_is_refused_in_one_line(arguments: tuple[str, ...], code: int, names: tuple[str, ...], lab: Path) -> None:
    edited(lab, "again", lambda result: result["provenance"].update(input_sha256="another"))
    said = refused(lab, "first", *arguments, code=code)
    assert all(name in said for name in names), said


def edited(lab: Path, name: str, edit: Any) -> None:
    """A copy of the first result, changed."""
    (lab / name).mkdir(exist_ok=True)
    result = json.loads((lab / "first" / "result.json").read_text(encoding="utf-8"))
    edit(result)
    (lab / name / "result.json").write_text(json.dumps(result), encoding="utf-8")


def _free(result: dict[str, Any]) -> None:
    result["vehicle"]["environment"] = "free"
    del result["phases"][0]["about_pivot"], result["phases"][0]["about_pivot_covariance"]


def _untold(result: dict[str, Any]) -> None:
    result["phases"][0]["about_pivot"]["moment_x"] |= {"value": None, "sigma": None, "verdict": "unobservable", "reason": "a free swing"}


def _contradicted(result: dict[str, Any]) -> None:
    result["phases"][0]["about_pivot"]["moment_z"] |= {"verdict": "contradicted", "reason": "a jet is reversed"}


def _elsewhere(result: dict[str, Any]) -> None:
    result["provenance"]["input_sha256"], result["vehicle"]["bearing_position_m"] = "another", [0.0, 0.0, 0.03]


def _edited(result: dict[str, Any]) -> None:
    result["phases"][0]["about_pivot_covariance"][7][7] = -1e-6


def test_a_result_that_cannot_tell_says_which_log_would(lab: Path) -> None:
    edited(lab, "free", _free)
    said = refused(lab, "free", "--ballast", "ballast.toml")
    assert 'environment.kind = "free"' in said
    assert 'Estimate a log of a table on a fixed pedestal (environment.kind = "pedestal"' in said
    edited(lab, "untold", _untold)
    assert "moment_x is unobservable: a free swing" in refused(lab, "untold", "--ballast", "ballast.toml")
    edited(lab, "odd", _edited)
    assert "not of a real body: the file was edited" in refused(lab, "odd", "--ballast", "ballast.toml")
    edited(lab, "elsewhere", _elsewhere)
    said = refused(lab, "first", "--ballast", "ballast.toml", "--after", "elsewhere")
    assert "environment.bearing_position_m is [0.0, 0.0, 0.03]" in said


def test_a_contradicted_moment_exits_6_and_shows_what_it_would_be(lab: Path) -> None:
    edited(lab, "contradicted", _contradicted)
    said = refused(lab, "contradicted", "--ballast", "ballast.toml", code=6)
    assert "moment_z is contradicted: a jet is reversed" in said
    assert ran(lab, "contradicted", "--ballast", "ballast.toml", "--allow-contradicted").exit_code == 0


@pytest.mark.thorough
def test_random_tables_are_balanced_to_a_hundredth() -> None:
    """Motion that is integrated apart, ballasts that weigh and are set other than stated; fifty tables: benchmarks/balance.py."""
    rng = np.random.default_rng(11)
    own = anypedestal.tables(rng, 3, 1e-3)
    held = balanced.weights(rng, own)
    logs = balanced.results(rng, own, "wheels")
    found = balanced.balances(logs, held)
    new = balanced.put(rng, own, held, balanced.changes(found))
    true, (left, sigma) = balanced.moments(new), balanced.moment(found, "remainder")
    assert (np.abs(true - left) < 1.96 * sigma).mean() > 0.75
    assert np.abs((true - left) / sigma).max() < 4
    wanted = np.array([one.plan.wanted.kg_m for one in found])
    assert np.median(np.linalg.norm(true - wanted, axis=1) / np.linalg.norm(balanced.moments(own), axis=1)) < 0.01
    checked = balanced.balances(logs, held, balanced.results(rng, new, "wheels"))
    now, spread = balanced.moment(checked, "now")
    assert np.abs((now - true) / spread).max() < 4
    assert all(one.check is not None and one.check.as_predicted for one in checked)


@pytest.mark.thorough
def test_moves_of_known_weights_tell_the_scale_of_the_thrust() -> None:
    """Thrust that is a few per cent other than stated: scale, first moment and masses come out with sigmas that hold."""
    rng = np.random.default_rng(12)
    own, scale = anypedestal.tables(rng, 3, 1e-3), 1 + 0.03 * np.array([1.2, -0.8, 0.5])
    held = balanced.weights(rng, own)
    logs = balanced.results(rng, own, "jets", scale, 0.03)
    new = balanced.put(rng, own, held, balanced.changes(balanced.balances(logs, held)))
    checked = balanced.balances(logs, held, balanced.results(rng, new, "jets", scale, 0.03))
    now, spread = balanced.moment(checked, "now")
    assert np.abs((now - balanced.moments(new)) / spread).max() < 4
    for one, true in zip(checked, scale, strict=True):
        assert one.check is not None
        assert one.check.as_predicted
        assert abs(one.check.thrust_scale - true) < 3 * one.check.thrust_scale_sigma
        assert one.check.thrust_scale_sigma < 0.1 * 0.03
