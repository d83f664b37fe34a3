"""Killed at any moment, a campaign goes on to the same bytes; a worker that dies takes one log with it."""

import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from massprop_cli.campaign import plan, work
from massprop_cli.campaign.runner import LocalExecutor, Task
from tests.campaigns import batch, command, contents, environment, simulate

pytestmark = pytest.mark.thorough


def survives(folder: Path, logs: int, kills: int) -> None:
    """Kill a campaign once some of its logs are done, how many is chosen at random, run it again, compare every byte."""
    simulate(folder / "logs", logs)
    assert batch(folder, "logs", "--out", "undisturbed", "-q").returncode == 0
    wanted = contents(folder / "undisturbed")
    moments = random.Random(1)
    left = []
    for kill in range(kills):
        out = folder / f"killed-{kill}"
        process = subprocess.Popen(command("logs", "--out", out, "-q"), cwd=folder, env=environment())
        enough = moments.randrange(logs // 2)
        while process.poll() is None and len(list(out.glob("results/*"))) < enough:
            time.sleep(0.01)
        time.sleep(moments.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.wait()
        left.append(len(list(out.glob("results/*"))))
        assert all((path / "result.json").exists() for path in out.glob("results/*")), "half a result is in place"
        done = batch(folder, "logs", "--out", out, "-q")
        assert done.returncode == 0, done.stderr
        assert contents(out) == wanted
    assert 0 < sum(left) < logs * kills, "no kill came while logs were worked"


def test_a_campaign_killed_at_two_moments_ends_in_the_same_bytes(tmp_path: Path) -> None:
    survives(tmp_path, 12, 2)


@pytest.mark.slow
def test_a_campaign_killed_at_twenty_moments_ends_in_the_same_bytes(tmp_path: Path) -> None:
    survives(tmp_path, 40, 20)


def test_a_campaign_that_is_interrupted_says_how_to_go_on(tmp_path: Path) -> None:
    simulate(tmp_path / "logs", 12)
    process = subprocess.Popen(command("logs"), cwd=tmp_path, env=environment(), stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    process.stderr.readline()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "massprop: interrupted; finished results are in massprop-out; run the same command to continue"
    assert [path.name for path in (tmp_path / "massprop-out").iterdir()] == ["results"]


def test_workers_end_when_the_batch_is_killed(tmp_path: Path) -> None:
    simulate(tmp_path / "logs", 12)
    process = subprocess.Popen(command("logs", "-q"), cwd=tmp_path, env=environment())
    deadline = time.monotonic() + 30
    while not (workers := children(process.pid)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert workers
    process.kill()
    process.wait()
    while any(Path(f"/proc/{pid}").exists() for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [pid for pid in workers if Path(f"/proc/{pid}").exists()]


def children(parent: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == parent:
            found.append(int(stat.parent.name))
    return found


@pytest.fixture
def tasks(tmp_path: Path) -> list[Task]:
    simulate(tmp_path / "logs", 4)
    logs = sorted((tmp_path / "logs").glob("*/log.parquet"))
    return [Task(job) for job in plan.jobs([plan.FoundLog(str(log), log.parts, 2) for log in logs])]


def killing(tasks: list[Task], times: int) -> Iterator[tuple[int, work.Produced | None]]:
    """Run one by one; whichever process works on the second log is killed so many times."""
    before = set(children(os.getpid()))
    killed: set[int] = set()
    executor = LocalExecutor(1)
    running = executor.run(tasks)
    yield next(running)
    for _ in range(times):
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            alive = set(children(os.getpid())) - before - killed
            if alive:
                for pid in alive:
                    os.kill(pid, signal.SIGKILL)
                killed |= alive
                break
            time.sleep(0.002)
    yield from running


def test_a_worker_that_is_killed_is_replaced_and_its_log_done_again(tasks: list[Task]) -> None:
    found = dict(killing(tasks, 1))
    assert sorted(found) == [0, 1, 2, 3]
    assert [one.outcome.exit_code for one in found.values() if one is not None] == [0, 0, 0, 0]


def test_a_log_that_kills_its_worker_twice_is_an_error_and_the_rest_goes_on(tasks: list[Task]) -> None:
    found = dict(LocalExecutor(1).run([tasks[0], Task(_lethal(tasks[1].job)), tasks[2]]))
    codes = {index: one.outcome.exit_code for index, one in found.items() if one is not None}
    assert codes == {0: 0, 1: 1, 2: 0}
    assert found[1] is not None
    assert "died twice (exit code 9)" in found[1].outcome.message
    assert found[1].outcome.fingerprint == ""


class Lethal(str):
    """A location that ends whoever unpickles it."""

    __slots__ = ()

    def __reduce__(self) -> tuple[object, tuple[int]]:
        return os._exit, (9,)


def _lethal(job: plan.Job) -> plan.Job:
    return plan.Job(job.name, Lethal(job.log), job.shown, job.settings, job.tags)
