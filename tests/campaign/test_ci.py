"""Campaigns in CI: the ready-made jobs run as they stand, and GitHub is told within its limits."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from junitparser import JUnitXml
from markdown_it import MarkdownIt

from massprop_cli.campaign import markdown
from massprop_cli.campaign.outcome import CampaignRow, Outcome
from massprop_cli.campaign.summary import Baseline, Beyond, Summary, summary
from tests.campaign.test_pool import row
from tests.campaigns import batch, environment, simulate

pytestmark = pytest.mark.thorough

DOCS = Path(__file__).parents[2] / "docs" / "ci"


def failed(number: int, message: str = "log.csv: is empty; record it again", code: int = 3) -> CampaignRow:
    outcome = Outcome(schema="massprop/outcome/1", fingerprint="f", exit_code=code, message=message, input_sha256=None)
    return CampaignRow(name=f"bad-{number}", log=f"bad-{number}/log.csv", tags=[], outcome=outcome)


def scripts(file: Path) -> list[str]:
    """What a runner would give to the shell: each ``run:`` of a workflow, each line of a job's ``script:``."""
    found = []
    lines = iter(file.read_text(encoding="utf-8").splitlines())
    inside: int | None = None
    for line in lines:
        depth = len(line) - len(line.lstrip())
        if inside is not None and line.strip() and depth > inside:
            found.append(line.strip().removeprefix("- "))
            continue
        inside = None
        if re.fullmatch(r"\s*(run: \||script:)", line):
            inside = depth
        elif one := re.fullmatch(r"\s*(?:- )?run: (.+)", line):
            found.append(one[1])
    return found


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the wheel, made as the jobs say."""
    folder = tmp_path_factory.mktemp("wheels")
    made = ["pip", "wheel", "-q", "--disable-pip-version-check", "--no-deps", "--no-build-isolation", "-w"]
    subprocess.run([sys.executable, "-m", *made, str(folder), str(DOCS.parents[1])], check=True, capture_output=True)
    return folder


@pytest.mark.thorough
@pytest.mark.seeds
def test_the_ready_made_job_runs_as_it_stands(tmp_path: Path, wheels: Path) -> None:
    """GitHub's; GitLab's has the same lines."""
    lines = scripts(DOCS / "github-workflow.yml")
    assert lines == scripts(DOCS / "gitlab-ci.yml")
    assert lines[0].startswith("pip install ")
    (tmp_path / "wheels").symlink_to(wheels)
    simulate(tmp_path / "flights", 2)
    installed, tools = tmp_path / "installed", tmp_path / "tools"
    tools.mkdir()
    pip = f'"{sys.executable}" -m pip "$@" -q --no-deps --no-index --upgrade --target "{installed}"'
    for name, runs in (("pip", pip), ("massprop", f'"{sys.executable}" -m massprop_cli "$@"')):
        (tools / name).write_text(f"#!/bin/sh\nexec {runs}\n")
        (tools / name).chmod(0o755)
    path = {"PATH": f"{tools}:/usr/bin:/bin", "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"), "GITHUB_ACTIONS": "true"}
    path["PYTHONPATH"] = str(installed)

    def run(*lines: str) -> subprocess.CompletedProcess[str]:
        script = "\n".join(["set -eo pipefail", *lines])
        return subprocess.run(["bash", "-c", script], cwd=tmp_path, env=environment(**path), capture_output=True, text=True, check=False)

    done = run(*lines)
    assert done.returncode == 0, done.stderr
    assert (installed / "massprop_cli" / "job.py").is_file(), "what ran is what the job installed"
    assert JUnitXml.fromfile(str(tmp_path / "massprop.junit.xml")).tests == 20
    assert (tmp_path / "summary.md").read_text().startswith("## ✓ campaign: 2 logs\n")
    (tmp_path / "baseline").mkdir()
    shutil.copy(tmp_path / "massprop-out" / "campaign.json", tmp_path / "baseline")
    (tmp_path / "flights" / "seed-0002" / "log.parquet").write_bytes(b"")
    done = run(*lines[1:])
    assert done.returncode == 3
    assert "::error title=seed-0002::seed-0002/log.parquet%3A" not in done.stderr
    assert "::error title=seed-0002::seed-0002/log.parquet: the file is empty; record the log again" in done.stderr.splitlines()
    assert "::error title=beyond the baseline::seed-0002: has a result in the baseline, none here" in done.stderr


def test_annotations_are_ten_at_most_and_say_how_many_more(tmp_path: Path) -> None:
    found = markdown.commands(summary("c", [failed(n) for n in range(40)]))
    assert len(found) == 10
    assert found[0] == "::error title=bad-0::log.csv: is empty; record it again"
    assert found[9] == "::error title=c%3A 31 more::31 more are in the job's summary and in campaign.html"
    assert len(markdown.commands(summary("c", [failed(n) for n in range(10)]))) == 10
    assert markdown.commands(summary("c", [row(1, 22.0)])) == []
    assert tmp_path.exists()


def test_annotations_cannot_be_broken_out_of() -> None:
    evil = failed(1, "a%b\r\n::warning::x\x1b[31m,y: \u202ez").model_copy(update={"name": "n,a:m%e\n::error::"})
    (line,) = markdown.commands(summary("c", [evil]))
    assert line == "::error title=n%2Ca%3Am%25e %3A%3Aerror%3A%3A::a%25b ::warning::x\ufffd[31m,y: \ufffdz"


def test_a_summary_keeps_within_what_is_left_of_the_limit(tmp_path: Path) -> None:
    file = tmp_path / "summary.md"
    file.write_bytes(b"x" * 300_000)
    many = summary("c", [*(failed(n, "ö" * 3000) for n in range(400)), *(row(n, 22.0) for n in range(3))])
    markdown.append_summary(file, many)
    size = file.stat().st_size
    assert 900_000 < size <= markdown.MOST_BYTES
    assert "rows are left out here" in file.read_text()
    markdown.append_summary(file, many)
    assert file.stat().st_size <= markdown.MOST_BYTES
    file.write_bytes(b"x" * markdown.MOST_BYTES)
    markdown.append_summary(file, many)
    assert file.stat().st_size == markdown.MOST_BYTES


def test_a_summary_says_what_failed_what_is_pooled_and_all_logs(tmp_path: Path) -> None:
    beyond = Beyond(log="log-1", vehicle="tug", part=None, quantity=None, value=None, baseline_value=None, sigmas=None, message="off | far")
    held = Baseline(sha256="s", compared=2, new=[], beyond=[beyond])
    found: Summary = summary("night <b>", [row(1, 22.0), failed(7, "a | b\n# c"), row(2, 22.2)], held)
    markdown.append_summary(tmp_path / "s.md", found)
    text = (tmp_path / "s.md").read_text()
    html = MarkdownIt("commonmark").enable("table").render(text)
    assert "<h2>✗ night &lt;b&gt;: 3 logs</h2>" in html
    assert "<p>1 unusable, 2 done.</p>" in html
    assert "<td>a | b # c</td>" in html
    assert "<li>off | far</li>" in html
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", line) for line in re.findall(r"<tr>(.*?)</tr>", html, re.DOTALL)]
    assert ["Mass", "22.10", "0.18", "kg", "2", "0.57", "0.57", "–", "none"] in rows
    assert ["log-2", "tug", "done", "10 of 10", ""] in rows
    assert html.count("<table>") == 3


def test_outside_of_github_nothing_is_told(tmp_path: Path) -> None:
    simulate(tmp_path / "logs", 1)
    (tmp_path / "logs" / "bad.csv").write_text("")
    done = batch(tmp_path, "logs")
    assert done.returncode == 3
    assert "::error" not in done.stderr
    done = batch(tmp_path, "logs", "--json", settings={"GITHUB_ACTIONS": "true"})
    assert json.loads(done.stdout)["exit_code"] == 3
    assert "::error title=bad::bad.csv: the file is empty" in done.stderr
