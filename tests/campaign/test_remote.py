"""Campaigns whose logs and results are on a store, a real server of the S3 protocol on this machine."""

import hashlib
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from massprop_cli import api, run_campaign
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import discover, location, outcome, runner, urlplace, work
from massprop_cli.campaign.plan import Job, Settings
from massprop_cli.campaign.urlplace import UrlPlace
from massprop_cli.cli import app
from massprop_cli.report.figures import canvas
from tests import campaigns
from tests.campaigns import Here, without_drawing
from tests.extras import needed

fsspec = needed("fsspec")
needed("s3fs")
server = needed("moto.server")
LOGS = 6


@pytest.fixture(scope="module", autouse=True)
def endpoint() -> Iterator[dict[str, str]]:
    """Environment of an S3 server that runs until the tests end."""
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    settings = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "testing",
        "AWS_SECRET_ACCESS_KEY": "testing",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for key, value in settings.items():
            patch.setenv(key, value)
        patch.delenv("AWS_PROFILE", raising=False)
        yield settings
    running.stop()


@pytest.fixture(scope="module")
def s3(endpoint: dict[str, str]) -> Any:
    files = fsspec.filesystem("s3", endpoint_url=endpoint["AWS_ENDPOINT_URL"], use_listings_cache=False)
    files.mkdir("flights")
    return files


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory, s3: Any) -> Path:
    """Logs in a local folder, good and bad, and the same under s3://flights/logs."""
    folder = campaigns.simulate(tmp_path_factory.mktemp("campaign") / "logs", LOGS)
    seeds = sorted(path for path in folder.iterdir() if path.is_dir())
    (seeds[1] / "log.parquet").write_bytes(b"no parquet at all")
    (seeds[2] / "history.parquet").write_bytes(b"a table of ours")
    (seeds[2] / "result.json").write_text("{}", encoding="utf-8")
    (seeds[3] / "log.parquet").rename(seeds[3] / "no-vehicle.csv")
    (folder / ".hidden").mkdir()
    (folder / ".hidden" / "log.parquet").write_bytes(b"")
    (folder.parent / "campaign.toml").write_text(
        'schema = 1\nname = "flights"\nlogs = ["logs"]\n[[match]]\nlogs = ["logs/*-0005/*"]\nvehicle = "five.toml"\ntags = ["five"]\n',
        encoding="utf-8",
    )
    (folder.parent / "five.toml").write_bytes((seeds[4] / "vehicle.toml").read_bytes())
    for path in folder.parent.rglob("*"):
        if path.is_file():
            s3.pipe_file(f"flights/{path.relative_to(folder.parent)}", path.read_bytes())
    return folder


@pytest.fixture(scope="module")
def local(logs: Path) -> dict[str, bytes]:
    """What is made of them on this machine's own disk."""
    done = campaigns.batch(logs.parent, "campaign.toml", "--out", "local")
    assert done.returncode == 3, done.stderr
    return campaigns.contents(logs.parent / "local")


@pytest.fixture
def batch(logs: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """``massprop batch`` in the logs' folder, in this process, which has the store's library already."""
    monkeypatch.chdir(logs.parent)
    monkeypatch.setattr(runner, "LocalExecutor", Here)
    monkeypatch.setattr(canvas, "render", without_drawing)
    return lambda *arguments: CliRunner().invoke(app, ["batch", *arguments], env={"COLUMNS": "200", "NO_COLOR": "1"})


def stored(s3: Any, root: str) -> dict[str, bytes]:
    s3.invalidate_cache()
    return {path.removeprefix(f"{root}/"): s3.cat_file(path) for path in sorted(s3.find(root))}


@pytest.mark.thorough
def test_logs_and_results_on_s3_give_the_same_bytes_as_on_disk(batch: Callable[..., Any], local: dict[str, bytes], s3: Any) -> None:
    done = batch("s3://flights/campaign.toml", "--out", "s3://flights/out")
    assert done.exit_code == 3, done.stderr
    assert "not a readable Parquet file" in done.stderr
    assert done.stdout.splitlines()[-1] == "s3://flights/out/campaign.html"
    assert stored(s3, "flights/out") == local

    # what is missing, or was left half, is done again, and nothing else
    rows = json.loads(local["campaign.json"])["logs"]
    good = [row["name"] for row in rows if row["outcome"]["exit_code"] == 0]
    s3.rm_file(f"flights/out/results/{good[0]}/outcome.json")
    s3.pipe_file(f"flights/out/results/{good[0]}/result.json", b"half")
    s3.rm_file(f"flights/out/results/{good[1]}/history.parquet")
    written = {path: info["LastModified"] for path, info in s3.find("flights/out/results", detail=True).items()}
    again = batch("s3://flights/campaign.toml", "--out", "s3://flights/out")
    assert [row["name"] for row in rows if f"{row['name']}:" in again.stderr and f"{row['name']}, unchanged" not in again.stderr] == good[
        :2
    ]
    assert stored(s3, "flights/out") == local
    same = {path: info["LastModified"] for path, info in s3.find("flights/out/results", detail=True).items() if not _any(good[:2], path)}
    assert same == {path: when for path, when in written.items() if not _any(good[:2], path)}


@pytest.mark.seeds
@pytest.mark.thorough
def test_workers_read_a_store_by_themselves(logs: Path, local: dict[str, bytes], s3: Any, endpoint: dict[str, str]) -> None:
    done = campaigns.batch(logs.parent, "s3://flights/campaign.toml", "--out", "s3://flights/workers", first=None, settings=endpoint)
    assert done.returncode == 3, done.stderr
    made = stored(s3, "flights/workers")
    assert {path: made[path] for path in made if path != "campaign.html"} == {
        path: local[path] for path in local if path != "campaign.html"
    }


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_campaign_from_python_may_be_at_urls_and_be_held_against_one(
    local: dict[str, bytes], s3: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(api, "LocalExecutor", Here)
    monkeypatch.setattr(canvas, "render", without_drawing)
    made = run_campaign("s3://flights/campaign.toml", "s3://flights/python", jobs=2)
    assert stored(s3, "flights/python") == local
    rows = json.loads(local["campaign.json"])["logs"]
    assert made.table["name"].tolist() == [row["name"] for row in rows]
    held = run_campaign("s3://flights/campaign.toml", "s3://flights/again", jobs=2, baseline="s3://flights/python")
    assert held.summary.baseline is not None
    assert held.summary.baseline.compared == sum(bool(row["outcome"]["bodies"]) for row in rows)
    assert held.summary.baseline.sha256 == hashlib.sha256(local["campaign.json"]).hexdigest()
    with pytest.raises(InputError, match=r"s3://flights/nowhere\.json: no such campaign\.json"):
        run_campaign("s3://flights/campaign.toml", "s3://flights/again", baseline="s3://flights/nowhere.json")


def _any(names: list[str], path: str) -> bool:
    return any(f"/{name}/" in path for name in names)


@pytest.mark.parametrize("named", ["logs", "logs/", "logs/*/*.parquet", "logs/**/log.parquet", "logs/*-000[13]", "logs/*4/no-vehicle.csv"])
def test_a_url_names_the_same_logs_as_the_path(named: str, logs: Path) -> None:
    _, here = discover.plan([str(logs.parent / named)], Settings())
    _, there = discover.plan([f"s3://flights/{named}"], Settings())
    assert [(job.name, job.shown) for job in here] == [(job.name, job.shown) for job in there]
    assert all(job.log.startswith("s3://flights/logs/") for job in there)


def test_a_put_that_ends_midway_leaves_no_whole_result(s3: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    place = UrlPlace("s3://flights/halfway")
    place.put_folder("a", {"result.json": b"1", "old.html": b"1", outcome.FILE: b"1"})
    original = UrlPlace.put_file

    def fail(self: UrlPlace, path: str, content: Iterable[bytes]) -> None:
        if path.endswith("result.json"):
            raise InputError("the network is down")
        original(self, path, content)

    monkeypatch.setattr(UrlPlace, "put_file", fail)
    with pytest.raises(InputError):
        place.put_folder("a", {"result.json": b"2", "history.parquet": b"2", outcome.FILE: b"2"})
    assert outcome.FILE not in place.folders()["a"]
    monkeypatch.undo()
    place.put_folder("a", {"result.json": b"2", "history.parquet": b"2", outcome.FILE: b"2"})
    assert stored(s3, "flights/halfway") == {f"results/a/{name}": b"2" for name in ("history.parquet", outcome.FILE, "result.json")}


@pytest.mark.thorough
@pytest.mark.seeds
def test_one_batch_at_a_time_and_a_killed_ones_lock_is_taken_over(s3: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(urlplace, "RENEWED_S", 0.1)
    monkeypatch.setattr(urlplace, "SILENT_S", 3.0)
    place = UrlPlace("s3://flights/locked")
    with place.lock():
        with pytest.raises(InputError, match=rf"another batch is at work there \(process {os.getpid()} on "), UrlPlace(place.url).lock():
            pass
        assert s3.exists("flights/locked/.lock")
    assert not s3.exists("flights/locked/.lock")
    s3.pipe_file("flights/locked/.lock", b'{"token": "of one that was killed"}')
    with place.lock():
        place.put_file("mine", [b"1"])
        # and one that was cut off for too long stops as soon as it knows
        s3.pipe_file("flights/locked/.lock", b'{"token": "of another"}')
        with pytest.raises(InputError, match="another batch took over"):
            _keep_putting(place)
    assert s3.cat_file("flights/locked/mine") == b"1"
    assert s3.cat_file("flights/locked/.lock") == b'{"token": "of another"}', "a lock of others stays"


def _keep_putting(place: UrlPlace) -> None:
    until = time.monotonic() + 30
    while time.monotonic() < until:
        place.put_file("mine", [b"1"])
        time.sleep(0.05)


@pytest.mark.parametrize(
    ("named", "said"),
    {
        "s3://flights/nothing": "s3://flights/nothing: no such file or folder; check the URL",
        "s3://flights/none.toml": "s3://flights/none.toml: no such campaign file; check the URL",
        "s3://nobucket/logs": "s3://nobucket/logs: no such file or folder; check the URL",
        "s3://flights/logs/*.dat": "s3://flights/logs/*.dat: no log matches this pattern",
        "nonsense://x/y": "nonsense://x/y: Protocol not known: nonsense; check the URL's scheme",
        "gs://bucket/logs": "gs://bucket/logs: Please install gcsfs",
    }.items(),
)
def test_a_url_without_a_log_is_one_line_with_a_remedy(named: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        discover.plan([named], Settings())
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)


def test_what_else_is_missing_is_one_line_with_a_remedy(batch: Callable[..., Any]) -> None:
    for arguments, said in {
        ("logs", "--out", "s3://nobucket/out"): "s3://nobucket/out: no bucket 'nobucket' that these credentials may use",
        ("logs", "--vehicle", "s3://flights/none.toml"): "s3://flights/none.toml: no such vehicle file; check the URL",
    }.items():
        done = batch(*arguments)
        assert (done.exit_code, len(done.stderr.splitlines())) == (3, 1), done.stderr
        assert said in done.stderr


def test_a_log_that_vanishes_is_a_row() -> None:
    found = work.process(Job("a", "s3://flights/gone/log.csv", "gone/log.csv"))
    assert found is not None
    assert (found.outcome.exit_code, found.outcome.message) == (3, "gone/log.csv: no such log; check the URL")


def test_a_store_that_does_not_answer_or_refuses_is_one_line(logs: Path, endpoint: dict[str, str]) -> None:
    nowhere = endpoint | {"AWS_ENDPOINT_URL": "http://127.0.0.1:9", "AWS_MAX_ATTEMPTS": "1"}
    down = campaigns.batch(logs.parent, "s3://flights/logs", settings=nowhere)
    assert (down.returncode, len(down.stderr.splitlines())) == (3, 1), down.stderr
    assert "s3://flights/logs: " in down.stderr
    assert "check the network and the store's address" in down.stderr


def test_a_url_may_stand_for_any_place_of_a_path() -> None:
    assert location.join("s3://bucket/a", "../b/log.csv") == "s3://bucket/b/log.csv"
    assert location.join("zip://runs::s3://bucket/all.zip", "log.csv") == "zip://runs/log.csv::s3://bucket/all.zip"
    assert location.join("logs", "s3://bucket/log.csv") == "s3://bucket/log.csv"
    assert location.folder("s3://bucket/a/log.csv") == "s3://bucket/a"
    assert location.below("s3://bucket/a/b.csv", "s3://bucket") == "a/b.csv"
    assert location.below("s3://bucket/a/b.csv", "folder") == "s3://bucket/a/b.csv"
    assert not location.is_url("C:/logs")
    assert not location.is_url("./a://b")
