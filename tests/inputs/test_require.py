"""What is wanted of quantities: one reading of it for options, campaign files and expect files."""

from collections.abc import Callable
from pathlib import Path

import pytest

from massprop_cli import QUANTITIES, estimate_log, run_campaign
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.inputs import expect
from massprop_cli.inputs.require import precise, requirements
from massprop_cli.job import imprecise
from tests import recorded
from tests.campaigns import simulate
from tests.commandline import massprop


@pytest.mark.parametrize(
    ("stated", "value", "sigma"),
    [
        ("mass<2%", 22.0, 0.44),
        ("MASS <= 2 %", 22.0, 0.44),
        ("mass 250 g", 22.0, 0.25),
        ("mass<0.3kg", 22.0, 0.3),
        ("cg_z 0.5 mm", 0.012, 0.0005),
        ("cg_z ≤ 1e-3 m", 0.012, 0.001),
        ("Ixx<0.02 kg m²", 0.6, 0.02),
        ("ixy<10%", -0.07, 0.007),
        ("CG x < 0.5 mm", 0.012, 0.0005),
        ("cg Y 1e-3 m", 0.012, 0.001),
        ("about_pivot.ixx<2%", 0.6, 0.012),
        ("moment_z < 10 g cm", 0.012, 1e-4),
        ("About_pivot.Moment_x<1e-5 kg m", 0.012, 1e-5),
    ],
)
def test_a_precision_is_a_sigma_in_the_quantitys_unit_or_a_share_of_its_value(stated: str, value: float, sigma: float) -> None:
    (found,) = requirements(stated)
    assert found.precision is not None
    assert found.precision.sigma(value) == pytest.approx(sigma, rel=1e-12)
    assert requirements(str(found)) == (found,), "what is printed is read back"


def test_what_is_said_of_a_quantity_goes_before_what_is_said_of_all() -> None:
    found = {item.quantity: str(item) for item in requirements("all<5%, mass<1%, ixx")}
    assert list(found) == list(QUANTITIES)
    assert (found["mass"], found["ixx"], found["cg_x"]) == ("mass<1%", "ixx<5%", "cg_x<5%")
    assert [str(item) for item in requirements(["mass", "mass<1%"])] == ["mass<1%"]


@pytest.mark.parametrize(
    ("stated", "error", "said"),
    [
        ("mass<2", InputError, 'mass<2: the unit is missing; give it in % or kg or g, for instance "mass<200 g"'),
        ("cg_x<2 kg", InputError, "'kg' is not a unit of cg_x; give it in % or m or mm"),
        ("weight<2%", InputError, "weight<2%: no such quantity; choose from ixx,"),
        ("mass<0%", InputError, "finite and above 0"),
        ("mass<1e400 kg", InputError, "finite and above 0"),
        ("all<1 kg", InputError, "'kg' is not a unit of all; give it in %"),
        ("weight", UsageError, "weight: no such quantity"),
        ("moment_z<1 kg", InputError, "'kg' is not a unit of about_pivot.moment_z; give it in % or kg m or g cm or g mm"),
        ("mass<", UsageError, "'' is not a precision"),
        ("mass<abc", UsageError, "'abc' is not a precision"),
        ("mass<-1 kg", UsageError, "'-1 kg' is not a precision"),
        ("mass<1%,mass<2%", UsageError, "mass<1% is required as well; keep one of them"),
        ("ixx,", UsageError, "no such quantity"),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_remedy(stated: str, error: type[Exception], said: str) -> None:
    with pytest.raises(error) as refused:
        requirements(stated)
    assert str(refused.value).startswith("--require ")
    assert said in str(refused.value)


def test_a_plan_needs_precisions() -> None:
    with pytest.raises(InputError, match='--want ixx: states no precision; write for instance "ixx 2 %"'):
        precise("mass 2 %, ixx")
    with pytest.raises(UsageError):
        precise("")


def test_a_converged_quantity_must_have_the_sigma_that_is_wanted() -> None:
    found = recorded.result([recorded.phase("a"), recorded.phase("b", mass={"value": 20.0, "sigma": 0.5})])
    assert imprecise(found, requirements("mass<2.5%,ixx")) == []
    assert imprecise(found, requirements("mass<2%,ixx")) == ["mass in phase b has a sigma of 0.5 kg, and mass<2% requires 0.4 kg at most"]
    late = recorded.result([recorded.phase("b", mass={"value": 20.0, "sigma": 0.5, "verdict": "not_converged"})])
    assert imprecise(late, requirements("mass<2%")) == [], "it is estimated once, as not converged"


def from_command(log: Path, text: str, folder: Path) -> tuple[int, str]:
    done = massprop(folder, "estimate", log, "-q", "--out", "one", "--require", text)
    return done.returncode, done.stderr.removeprefix("massprop: ").rstrip("\n")


def from_expect_file(log: Path, text: str, folder: Path) -> tuple[int, str]:
    file = folder / "expect.toml"
    file.write_text(f'require = "{text}"\n', encoding="utf-8")
    found = estimate_log(log, expected=file)
    done = massprop(folder, "estimate", log, "-q", "--out", "one", "--expect", file)
    assert (done.returncode, done.stderr) == (found.exit_code, f"massprop: {found.message}\n" if found.message else "")
    rendered = massprop(folder, "report", "one", "--expect", file, "--format", "csv")
    assert rendered.returncode == found.exit_code
    return found.exit_code, found.message


def from_campaign_file(log: Path, text: str, folder: Path) -> tuple[int, str]:
    file = folder / "c.toml"
    file.write_text(f'schema = 1\nlogs = ["{log}"]\nrequire = ["{text}"]\n', encoding="utf-8")
    (outcome,) = run_campaign(file, folder / "many", jobs=1).outcomes.values()
    assert outcome is not None
    return outcome.exit_code, outcome.message


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("require") / "flights", 1) / "seed-0001" / "log.parquet"


@pytest.mark.usefixtures("worked_here")
@pytest.mark.parametrize("ask", [from_command, from_expect_file, from_campaign_file])
def test_a_precision_is_asked_alike_everywhere(ask: Callable[[Path, str, Path], tuple[int, str]], log: Path, tmp_path: Path) -> None:
    sigma = estimate_log(log).result.phases[0].estimates["ixx"].sigma
    assert sigma is not None
    assert ask(log, f"ixx<{1.01 * sigma} kg m^2", tmp_path) == (0, "")
    code, message = ask(log, f"ixx<{0.99 * sigma} kg m^2", tmp_path)
    assert code == 4
    assert message.startswith("required but not precise enough: ixx in phase all has a sigma of ")


def test_an_expect_file_names_line_and_remedy(tmp_path: Path) -> None:
    file = tmp_path / "expect.toml"
    file.write_text("[all]\nmass = 22.0\n")
    assert expect.load(file).required == ()
    file.write_text('require = ["mass<2"]\n')
    with pytest.raises(InputError, match=r"expect.toml, line 1: require = \['mass<2'\]: mass<2: the unit is missing"):
        expect.load(file)
