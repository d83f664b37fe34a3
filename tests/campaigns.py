"""Campaigns small enough to be run many times: free flights of 120 cycles from the testbed in software."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from massprop_cli.campaign import runner, work
from massprop_cli.campaign.runner import Task
from massprop_cli.campaign.work import Produced
from massprop_cli.report.figures import canvas
from massprop_cli.report.figures.panel import Panel
from massprop_cli.testbed import output, scenario
from tests.commandline import ended

PLAN = 'plan=[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=5.0},{motion="hold",start_s=5.0,end_s=6.0}]'
TRUTH = dict(zip(("ixx", "mass"), (0.62, 22.0), strict=True))


def simulate(folder: Path, seeds: int, *settings: str, first: int = 1) -> Path:
    """``seeds`` logs in ``folder``/seed-N/log.parquet."""
    with np.errstate(all="ignore"):
        output.simulate(scenario.load("free-flyer", ["duration_s=6.0", PLAN, *settings]), folder, first, seeds)
    return folder


class Here:
    """An executor that works logs in the process itself, one after the other: a worker process imports the package anew."""

    def __init__(self, jobs: int | None = None) -> None:
        """In one process, whatever the number of ``jobs``."""

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        for index, task in enumerate(tasks):
            yield index, work.process(task.job, task.known, task.sent)


def without_drawing(panels: Sequence[Panel], kind: canvas.Kind, columns: int = 1, title: str = "") -> bytes:
    """In the place of :func:`massprop_cli.report.figures.canvas.render`: each panel of a page is an empty SVG."""
    assert (kind, columns, title, len(panels)) == ("svg", 1, "", 1)
    return b'<svg viewBox="0 0 288 151"><g id="nothing"></g></svg>'


def worked_here() -> None:
    """To be done first in a process whose logs are to be worked in it, and whose pages are to be without figures: drawing takes longer."""
    runner.LocalExecutor = Here  # type: ignore[assignment,misc]
    canvas.render = without_drawing


def batch(
    folder: Path, *arguments: str | Path, first: Callable[[], None] | None = worked_here, settings: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """``massprop batch`` in a process of its own, run in ``folder``; ``settings`` are environment variables.

    It works the logs itself and draws nothing; with None done ``first`` it starts worker processes and draws, as users' do.
    """
    done = ended(folder, ("batch", *arguments), settings, first)
    assert "Traceback" not in done.stderr, done.stderr
    return done


def command(*arguments: str | Path) -> list[str]:
    """Of a new interpreter, for tests that end processes."""
    return [sys.executable, "-m", "massprop_cli", "batch", *map(str, arguments)]


def environment(**more: str) -> dict[str, str]:
    """Without settings of whoever runs the tests, or of the CI that does."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("MASSPROP_", "GITHUB_"))}
    return kept | {"COLUMNS": "200", "NO_COLOR": "1", "PYTHONUTF8": "1"} | more


def corrupt(logs: list[Path]) -> dict[str, str]:
    """Five logs made unusable in five ways; what a message about each must say, by the log's name."""
    logs[0].write_bytes(b"")
    logs[1].write_bytes(logs[1].read_bytes()[:2000])
    logs[2].write_bytes(b"no parquet at all")
    shutil.copy(Path(__file__), logs[3])
    logs[4].unlink()
    logs[4].mkdir()
    (logs[4] / "log.csv").write_text("time_s,mass\n0.05,1\n0.10,2\n0.15,nan\n", encoding="utf-8")
    said = ["is empty", "not a readable Parquet file", "not a readable Parquet file", "not a readable Parquet file", "no vehicle file"]
    return dict(zip((log.parent.name for log in logs), said, strict=True))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
