"""A campaign on a real dask scheduler with two worker processes, one of which is killed."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import cluster, discover
from massprop_cli.campaign import run as flow
from massprop_cli.campaign.cluster import ClusterExecutor
from massprop_cli.campaign.place import LocalPlace
from massprop_cli.campaign.plan import Settings
from massprop_cli.campaign.run import LogDone
from tests import campaigns
from tests.extras import needed

pytestmark = pytest.mark.thorough

distributed = needed("distributed")
LOGS = 8


@contextmanager
def process(*arguments: str, said: str, **more: str) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A dask command and the line with ``said`` on its stderr, once there is one; gone afterwards."""
    with (
        tempfile.NamedTemporaryFile() as told,
        subprocess.Popen([sys.executable, "-m", *arguments], stderr=told, env=campaigns.environment(**more)) as running,
    ):
        try:
            until = time.monotonic() + 30
            while not (lines := [line for line in Path(told.name).read_text(encoding="utf-8").splitlines() if said in line]):
                assert running.poll() is None, Path(told.name).read_text(encoding="utf-8")
                assert time.monotonic() < until, Path(told.name).read_text(encoding="utf-8")
                time.sleep(0.05)
            yield running, lines[0]
        finally:
            running.kill()


@contextmanager
def scheduler(**more: str) -> Iterator[str]:
    """A scheduler's address."""
    arguments = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")
    with process("distributed.cli.dask_scheduler", *arguments, said="Scheduler at:", **more) as (_, line):
        address = re.search(r"tcp://127\.0\.0\.1:\d+", line)
        assert address, line
        yield address[0]


@contextmanager
def worker(address: str, scratch: Path, *more: str) -> Iterator[subprocess.Popen[bytes]]:
    """A worker process with one thread, without the nanny that would start it again."""
    arguments = ("--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(scratch), *more)
    with process("distributed.cli.dask_worker", address, *arguments, said="Registered to:", OMP_NUM_THREADS="1") as (running, _):
        yield running


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = campaigns.simulate(tmp_path_factory.mktemp("campaign") / "logs", LOGS)
    sorted(folder.glob("*/log.parquet"))[2].write_bytes(b"no parquet at all")
    return folder


@pytest.fixture(scope="module")
def local(logs: Path) -> dict[str, bytes]:
    """What one machine makes of them."""
    campaigns.batch(logs.parent, "logs", "--out", "local", first=None)
    return campaigns.contents(logs.parent / "local")


@pytest.fixture
def two_workers(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    with ExitStack() as stack:
        address = stack.enter_context(scheduler())
        yield address, [stack.enter_context(worker(address, tmp_path / f"scratch-{n}")) for n in range(2)]


def run(logs: Path, out: Path, address: str, told: Any = None) -> None:
    name, jobs = discover.plan([str(logs)], Settings())
    place = LocalPlace(out)
    with place.lock():
        flow.campaign(name, jobs, place, ClusterExecutor(address), told=told)


def test_a_worker_killed_midway_costs_nothing_but_time(
    logs: Path, local: dict[str, bytes], two_workers: tuple[str, list[subprocess.Popen[bytes]]], tmp_path: Path
) -> None:
    address, workers = two_workers
    killed: list[tuple[str, ...]] = []

    def kill(_: LogDone) -> None:
        """Upon the first result: a worker that has work."""
        if not killed:
            with distributed.Client(address, set_as_default=False) as client:
                at_work = client.processing()
                pids = client.run(os.getpid)
                busy = max(at_work, key=lambda name: len(at_work[name]))
                assert at_work[busy]
                killed.append(at_work[busy])
                os.kill(pids[busy], signal.SIGKILL)

    run(logs, tmp_path / "out", address, kill)
    assert killed
    assert sorted(running.poll() is None for running in workers) == [False, True]
    assert campaigns.contents(tmp_path / "out") == local


@pytest.mark.seeds
def test_the_command_line_runs_on_a_cluster_and_keeps_what_is_unchanged(
    logs: Path, local: dict[str, bytes], two_workers: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, _ = two_workers
    first = campaigns.batch(logs.parent, "logs", "--out", "there", "--cluster", address, first=None)
    assert first.returncode == 3, first.stderr
    assert campaigns.contents(logs.parent / "there") == local
    again = campaigns.batch(logs.parent, "logs", "--out", "there", "--cluster", address, first=None)
    assert again.stderr.count(", unchanged") == LOGS, again.stderr
    assert campaigns.contents(logs.parent / "there") == local


@pytest.mark.seeds
def test_a_log_that_takes_its_workers_along_is_a_row_and_the_rest_goes_on(logs: Path, local: dict[str, bytes], tmp_path: Path) -> None:
    name = sorted(path.name for path in logs.iterdir() if path.is_dir())[1]
    preload = tmp_path / "deadly.py"
    # dask loads it twice
    preload.write_text(
        "import os, signal\n"
        "from massprop_cli.campaign.runner import Worker\n"
        "work = getattr(Worker, 'harmless', Worker.work)\n"
        "Worker.harmless = work\n"
        "def deadly(self, task):\n"
        f"    if task.job.name == {name!r}: os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return work(self, task)\n"
        "Worker.work = deadly\n",
        encoding="utf-8",
    )
    steps: list[LogDone] = []
    with ExitStack() as stack:
        address = stack.enter_context(scheduler(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0"))
        for n in range(2):
            stack.enter_context(worker(address, tmp_path / f"scratch-{n}", "--preload", str(preload)))
        run(logs, tmp_path / "out", address, steps.append)
    lost = [step.outcome for step in steps if step.outcome.exit_code == 1]
    assert f"{name}/log.parquet: each worker that tried it was lost" in " ".join(outcome.message for outcome in lost)
    assert len(steps) == LOGS
    assert len(lost) <= 3, "those that waited on the same worker at most"
    campaigns.batch(logs.parent, "logs", "--out", tmp_path / "out", first=None)
    assert campaigns.contents(tmp_path / "out") == local, "such rows are tried again by the next run"


def test_what_is_wrong_with_a_cluster_is_one_line_with_a_remedy(logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    monkeypatch.setattr(cluster, "FIRST_WORKER_S", 1.0)
    with pytest.raises(InputError, match=r"cluster tcp://127\.0\.0\.1:9: no scheduler answers .*correct the address"):
        run(logs, tmp_path / "a", "tcp://127.0.0.1:9")
    with pytest.raises(InputError, match="cluster nonsense://x:1: no scheduler answers"):
        run(logs, tmp_path / "b", "nonsense://x:1")
    with scheduler() as address, pytest.raises(InputError, match=f"the scheduler has no workers; start one: dask worker {address}"):
        run(logs, tmp_path / "c", address)


def test_workers_with_other_versions_are_refused(logs: Path, tmp_path: Path) -> None:
    preload = tmp_path / "older.py"
    preload.write_text("from massprop_cli.campaign import work\nwork.__version__ = '0.0.1'\n", encoding="utf-8")
    with (
        scheduler() as address,
        worker(address, tmp_path / "scratch", "--preload", str(preload)),
        pytest.raises(InputError, match=r"has massprop 0\.0\.1 \(here .*install the same versions there"),
    ):
        run(logs, tmp_path / "out", address)


def test_a_scheduler_that_is_lost_stops_the_batch_and_keeps_what_is_done(logs: Path, tmp_path: Path) -> None:
    with ExitStack() as stack:
        running, line = stack.enter_context(
            process("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", said="Scheduler at:")
        )
        address = line.split()[-1]
        stack.enter_context(worker(address, tmp_path / "scratch"))
        begun = time.monotonic()
        with pytest.raises(InputError, match="the scheduler is lost"):
            run(logs, tmp_path / "out", address, lambda _: running.kill())
    assert time.monotonic() - begun < 30
    assert list((tmp_path / "out" / "results").iterdir())
