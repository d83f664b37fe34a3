import ast
import json
import re
import subprocess
import sys
import tomllib
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.source import nodes

ROOT = Path(__file__).parents[1]


@pytest.mark.thorough
def test_the_wheel_alone_estimates_a_sample_log(tmp_path: Path) -> None:
    """Build the wheel, install it beside this environment's libraries, run it in an empty folder."""
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check", "--no-deps", "--no-build-isolation", str(ROOT)]
    subprocess.run([*build, "-w", str(tmp_path)], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("massprop-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert not [name for name in names if not name.startswith(("massprop_cli/", "massprop-"))]
    venv.create(tmp_path / "env", system_site_packages=False, with_pip=False)
    python = tmp_path / "env" / "bin" / "python"
    site = next((tmp_path / "env" / "lib").glob("python3*")) / "site-packages"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site / "libraries.pth").write_text("\n".join(libraries) + "\n")
    code = "import massprop_cli, sys; from massprop_cli.cli import main; print(massprop_cli.__file__, file=sys.stderr); main()"
    arguments = ["estimate", str(ROOT / "sample_logs" / "high-rate" / "log.parquet"), "--json"]
    run = subprocess.run([str(python), "-c", code, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert str(site) in run.stderr
    assert json.loads(run.stdout)["phases"][0]["estimates"]["mass"]["verdict"] == "converged"
    assert (tmp_path / "massprop-out" / "log" / "result.json").exists()
    run = subprocess.run([str(python), "-c", code, "simulate", "refined", "-q"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "massprop-out" / "refined-seed-1" / "log.parquet").exists()


def test_every_dependency_is_used_and_everything_used_is_a_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [
        name
        for extra, names in project["optional-dependencies"].items()
        if extra not in ("dev", "dev-all", "docs", "fuzz")
        for name in names
    ]
    declared = {re.split(r"[\[<>=;]", name)[0] for name in (*project["dependencies"], *extras)} - {"massprop"}
    imported = {name for file in (ROOT / "massprop_cli").rglob("*.py") for name in _imported(file)} - {
        *sys.stdlib_module_names,
        "massprop_cli",
    }
    called = {"mat-io": "matio", "tomli-w": "tomli_w"}
    # fsspec finds s3fs by itself; the other two come with those that are built on them
    assert {called.get(name, name) for name in declared} == (imported | {"s3fs"}) - {"markupsafe", "pydantic_core"}


def _imported(file: Path) -> Iterator[str]:
    for node in nodes(file):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "_Lazy":
            yield ast.literal_eval(node.args[0]).partition(".")[0]
