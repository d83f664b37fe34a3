"""Every block of the documentation runs, page by page, in a folder of its own; every command that is mentioned has the options it is given.

A block of ``toml`` with a title is the file of that name. ``<!-- before: … -->`` is run first; ``<!-- not run: … -->`` says why the next
isn't.
"""

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import tomli_w
import typer

from massprop_cli.cli import app
from massprop_cli.inputs import vehiclefile
from tests import commandline
from website import commands, python
from website.stage import ROOT

QUICK = ("README.md", "docs/log.md", "docs/vehicle.md", "docs/contributing.md")
"""Pages that take a few seconds; the others are run by name."""
LONG = ("commands", "docs/plan.md", "docs/reports.md", "docs/campaigns.md", "docs/balance.md", "docs/predict.md", "docs/simulate.md")
"""Every command with every option, and pages that take many seconds: before a release."""
PARTS = re.compile(
    r"<!-- (?P<note>before|not run): (?P<said>.*?) -->|^```(?P<language>\w+)(?: title=\"(?P<title>[^\"]+)\")?\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
WHOLE = ("smallest.toml", "vehicle.toml", "flight.vehicle.toml")
"""Blocks that are whole vehicle files."""
SAMPLE = "cp sample_logs/free-flyer/* ."
BALLAST = "".join(
    f'[[ballast]]\\nname = "{name}"\\nmass_kg = 0.3\\nmass_sigma_kg = 0.0003\\naxis = {axis}\\n'
    "position_m = [0.0, 0.0, 0.0]\\ntravel_m = [-0.1, 0.1]\\n"
    for name, axis in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1]))
)
BODY = {
    "ixx": 0.617954444,
    "ixy": 0.0514666667,
    "ixz": -0.0711466667,
    "iyy": 2.72468889,
    "iyz": 0.102322222,
    "izz": 2.40734556,
    "cg_x": -0.0173333333,
    "cg_y": 0.0244444444,
    "cg_z": 0.0142222222,
    "mass": 22.5,
}
"""The free flyer with 0.5 kg more at (0.1, 0, 0.2) m."""
LOADED = " ".join(f"--set truth.{name}={value}" for name, value in BODY.items())
TABLE = (
    "massprop simulate pedestal -q --set duration_s=12.0 --set "
    '\'plan=[{motion="random",axes=["roll","pitch","yaw"],every_cycles=6,max_cycles=4,closed_loop=true,start_s=0.0,end_s=12.0}]\''
)
SHORT = """-q --set duration_s=12.0 --set 'plan=[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=12.0}]'"""
RECORDS = """--csv -q --set duration_s=6.0 --set 'plan=[{motion="random",axes=["yaw","x"],start_s=0.0,end_s=6.0}]'"""
COMMANDS_BEFORE = f"""
{SAMPLE}
printf 'spread = 0.2\\n[body]\\nixx = 0.6\\niyy = 2.7\\nizz = 2.4\\nmass = 22.0\\n' > guess.toml
massprop simulate free-flyer --seeds 2 {SHORT} --out flights
massprop simulate free-flyer {RECORDS} --out records && cp records/log.csv .
for n in 1 2; do massprop estimate flights/seed-000$n/log.parquet -q --out run-$n; done
massprop estimate log.parquet -q --out baseline/log
mkdir massprop-out && cp -r run-1 massprop-out/monday
cp -r flights/seed-0002 friday && cp friday/log.parquet friday.parquet
{TABLE} --out table && massprop estimate table/log.parquet -q --out before
{TABLE} --seed 2 --set truth.cg_x=0.0 --set truth.cg_y=0.0 --out moved
massprop estimate moved/log.parquet -q --out after
printf '{BALLAST}' > ballast.toml
massprop simulate free-flyer {SHORT} --seed 2 {LOADED} --out flown-loaded
massprop estimate flown-loaded/log.parquet -q --out loaded
cp -r run-1 empty && cp -r run-1 alone && cp -r loaded docked
"""


@dataclass(frozen=True)
class Block:
    """One thing to do."""

    language: str
    text: str
    title: str = ""


def pages() -> dict[str, str]:
    """Written pages and those made from the code, by name."""
    written = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    made = {"commands": f"<!-- before: {COMMANDS_BEFORE} -->\n{commands.page()}", "python": python.page()}
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in written} | made


PAGES = pages()


def blocks(text: str) -> Iterator[Block]:
    """In their order, those left out that are not to be run."""
    skip = False
    for part in PARTS.finditer(text):
        if part["note"] == "before":
            yield Block("bash", part["said"])
        elif part["note"]:
            skip = True
        elif skip:
            skip = False
        else:
            yield Block(part["language"], part["text"], part["title"] or "")


RUN = [name for name, text in PAGES.items() if any(block.language in ("bash", "python") for block in blocks(text))]


@pytest.mark.parametrize(
    "page", [pytest.param(name, marks=[pytest.mark.thorough] * (name not in QUICK) + [pytest.mark.seeds] * (name in LONG)) for name in RUN]
)
def test_the_blocks_of_a_page_run_as_they_stand(page: str, tmp_path: Path) -> None:
    tools, folder = tmp_path / "tools", tmp_path / "clone"
    tools.mkdir()
    folder.mkdir()
    (folder / "sample_logs").symlink_to(ROOT / "sample_logs")
    kept = {key: value for key, value in os.environ.items() if not key.startswith("MASSPROP_")}
    settings = kept | {"PATH": f"{tools}:{kept['PATH']}", "PYTHONPATH": str(ROOT), "BROWSER": "true", "NO_COLOR": "1"}
    with commandline.tool(tools):
        run(page, folder, settings)


def run(page: str, folder: Path, settings: dict[str, str]) -> None:
    for block in blocks(PAGES[page]):
        if block.title:
            (folder / block.title).write_text(block.text, encoding="utf-8")
            continue
        if block.language not in ("bash", "python"):
            continue
        command = ["bash", "-eo", "pipefail", "-c", block.text] if block.language == "bash" else [sys.executable, "-c", block.text]
        done = subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True, check=False, timeout=900)
        assert done.returncode == 0, f"{block.text}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
        assert "internal error" not in done.stderr


@pytest.mark.parametrize("page", PAGES)
def test_a_block_has_a_language_that_is_run_or_read(page: str) -> None:
    assert PAGES[page].count("\n```") % 2 == 0
    assert {block.language for block in blocks(PAGES[page])} <= {"bash", "python", "toml", "text", "math"}
    for block in blocks(PAGES[page]):
        if block.language == "toml":
            tomllib.loads(block.text)


VEHICLE = {"schema": 1, "cycle": {"period_s": 0.05, "command_delay_cycles": 2.0}}
PHASES = [{"name": name, "start_s": start, "end_s": start + 1.0} for start, name in enumerate(("single", "combined"))]


@pytest.mark.parametrize("page", [name for name in PAGES if name.startswith(("docs/warnings/", "docs/verdicts/"))])
def test_what_a_page_says_to_state_is_a_vehicle_file(page: str) -> None:
    for block in blocks(PAGES[page]):
        if block.language == "toml":
            stated = tomllib.loads(block.text)
            phases = {"phases": PHASES} if "docking" in stated else {}
            vehiclefile.parse(tomli_w.dumps({**VEHICLE, **phases, **stated}), page)


def test_vehicle_files_that_are_shown_whole_are_vehicle_files() -> None:
    shown = [(page, block) for page, text in PAGES.items() for block in blocks(text) if block.title in WHOLE]
    assert {block.title for _, block in shown} == set(WHOLE)
    for page, block in shown:
        vehiclefile.parse(block.text, f"{page}: {block.title}")


def test_what_is_not_run_says_why() -> None:
    reasons = [part["said"] for text in PAGES.values() for part in PARTS.finditer(text) if part["note"] == "not run"]
    assert len(reasons) <= 2
    assert all("tests/" in reason for reason in reasons), "each names the test that runs the same"


@cache
def options() -> dict[str, set[str]]:
    group: Any = typer.main.get_command(app)
    own = {"--help", "-h"}
    return {name: own | {text for one in command.params for text in one.opts} for name, command in group.commands.items()}


@pytest.mark.parametrize("page", PAGES)
def test_a_command_that_is_mentioned_has_the_options_it_is_given(page: str) -> None:
    known = options()
    spoken = re.findall(r"`massprop ([^`]*)`", PAGES[page])
    scripts = "\n".join(block.text for block in blocks(PAGES[page]) if block.language == "bash")
    written = re.findall(r"\bmassprop ([^\n#;|&)]*)", scripts)
    for line in [*spoken, *written]:
        words = line.split()
        if not words or words[0].startswith(("-", "COMMAND", "…")) or words[0].endswith(":"):
            continue
        assert words[0] in known, line
        given = {word.partition("=")[0] for word in words[1:] if re.fullmatch(r"--?[a-z-]+(=.*)?", word)}
        assert given <= known[words[0]], line
