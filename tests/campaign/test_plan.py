"""Which logs are found, what they are called, and what a campaign file says of them."""

import time
from pathlib import Path

import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.campaign import discover
from massprop_cli.campaign.discover import matching
from massprop_cli.campaign.plan import FoundLog, Job, Settings, names
from massprop_cli.inputs.require import Requirement

NOTHING = Settings()


def touch(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def plan(*named: Path | str, over: Settings = NOTHING) -> list[Job]:
    return discover.plan([str(name) for name in named], over)[1]


def found(path: str, below: int) -> FoundLog:
    parts = ("/", *path.split("/"))
    return FoundLog(path, parts, below)


def test_a_folder_is_searched_with_all_below_in_the_order_a_person_would_give(tmp_path: Path) -> None:
    touch(
        *(
            tmp_path / name
            for name in ("run-10.csv", "run-2.csv", "b/log.parquet", "a/deep/LOG.PARQUET", ".hidden/x.csv", ".x.csv", "r.toml")
        )
    )
    assert [(job.name, job.shown) for job in plan(tmp_path)] == [
        ("a-deep", "a/deep/LOG.PARQUET"), ("b", "b/log.parquet"), ("run-2", "run-2.csv"), ("run-10", "run-10.csv"),
    ]  # fmt: skip


def test_what_massprop_wrote_is_no_log(tmp_path: Path) -> None:
    touch(tmp_path / "log.csv", tmp_path / "result.json", tmp_path / "history.parquet", tmp_path / "report.csv")
    touch(tmp_path / "out" / "campaign.json", tmp_path / "out" / "campaign.parquet", tmp_path / "other" / "history.parquet")
    assert [job.shown for job in plan(tmp_path)] == ["log.csv", "other/history.parquet"]


def test_globs_files_and_folders_name_a_log_once(tmp_path: Path) -> None:
    touch(tmp_path / "a" / "1.csv", tmp_path / "a" / "2.csv", tmp_path / "b" / "1.parquet", tmp_path / "b" / "note.txt")
    jobs = plan(tmp_path / "*" / "1.*", tmp_path / "a", tmp_path / "b" / ".." / "a" / "1.csv")
    assert [Path(job.log).relative_to(tmp_path) for job in jobs] == [Path("b/../a/1.csv"), Path("b/1.parquet"), Path("a/2.csv")]
    assert [job.shown for job in plan(tmp_path / "**" / "1.*")] == ["a/1.csv", "b/1.parquet"]


def test_links_that_loop_are_gone_through_once(tmp_path: Path) -> None:
    touch(tmp_path / "a" / "b" / "1.csv", tmp_path / "c" / "2.csv")
    for link, to in (("a/up", ".."), ("a/b/here", "."), ("a/b/top", "../.."), ("x", "x"), ("d", "c")):
        (tmp_path / link).symlink_to(to)
    began = time.monotonic()
    for stars in ("**", "/".join(40 * ["**"]), "**/*/**"):
        assert [job.shown for job in plan(f"{tmp_path}/{stars}/*.csv")] in (["a/b/1.csv", "c/2.csv"], ["b/1.csv", "c/2.csv"])
    assert time.monotonic() - began < 5


@pytest.mark.parametrize(
    ("pattern", "wanted"),
    [
        ("**", ["1.csv", "a/1.csv", "a/b/1.csv", "a/b/c/2.csv"]),
        ("**/1.csv", ["1.csv", "a/1.csv", "a/b/1.csv"]),
        ("a/**/1.csv", ["a/1.csv", "a/b/1.csv"]),
        ("a/b", ["a/b/1.csv", "a/b/c/2.csv"]),
        ("**/b/**", ["a/b/1.csv", "a/b/c/2.csv"]),
        ("*/1.csv", ["a/1.csv"]),
        ("x/**", []),
        ("**/" * 60 + "2.csv", ["a/b/c/2.csv"]),
        ("**/a/" * 30 + "2.csv", []),
    ],
)
def test_a_pattern_fits_as_in_a_shell_in_a_time_that_grows_as_path_times_pattern(pattern: str, wanted: list[str]) -> None:
    assert matching(["1.csv", "a/1.csv", "a/b/1.csv", "a/b/c/2.csv"], pattern) == wanted
    assert not matching(["/".join(40 * "z")], "**/z/" * 30 + "y")


@pytest.mark.parametrize(
    ("logs", "called"),
    [
        ([("r/seed-1/log.parquet", 2), ("r/seed-2/log.csv", 2)], ["seed-1", "seed-2"]),
        ([("r/log.parquet", 1)], ["r"]),
        ([("c1/seed-1/log.csv", 2), ("c2/seed-1/log.csv", 2), ("c2/x.csv", 1)], ["c1-seed-1", "c2-seed-1", "x"]),
        ([("d/x.csv", 1), ("d/x.parquet", 1)], ["x-csv", "x-parquet"]),
        ([("d/A.csv", 1), ("d/a.parquet", 1)], ["A-csv", "a-parquet"]),
        ([("d/log.csv", 1), ("d/log.parquet", 1), ("e/log.csv", 1)], ["d-csv", "d-parquet", "e"]),
        ([("c1/x.csv", 1), ("c1/x.csv.gz", 1), ("c2/x.csv", 1)], ["x-csv", "x-csv-gz", "x"]),
        ([("d/..hid\nden.csv", 1), ("d/a:b?.csv", 1), ("d/µ é.csv", 1)], ["_.hid_den", "a_b_", "µ é"]),
    ],
)
def test_names_are_short_safe_and_tell_logs_apart(logs: list[tuple[str, int]], called: list[str]) -> None:
    got = names([found(path if path.startswith("r/") else f"r/{path}", below) for path, below in logs])
    assert got == called


def test_names_of_any_script_fit_a_file_system_and_differ_there() -> None:
    ring, angstrom = "\u00c5", "\u212b"  # one and the same to some file systems
    logs = [found(f"a/{ring}.csv", 1), found(f"b/{angstrom}.csv", 1), found(f"{'山' * 80}/{'川' * 80}.csv", 2)]
    called = names(logs)
    assert called[0].startswith("a-")
    assert called[1].startswith("b-")
    assert len(called[2].encode()) < 140


def test_names_of_many_equal_logs_still_differ() -> None:
    logs = [found("r/a-b/c.csv", 2), found("r/a/b-c.csv", 2), found("r/" + "x" * 300 + ".csv", 1), found("r/" + "x" * 299 + "y.csv", 1)]
    got = names(logs)
    assert len({name.casefold() for name in got}) == 4
    assert all(len(name) < 160 for name in got)


def test_a_campaign_file_says_which_logs_and_what_of_which(tmp_path: Path) -> None:
    touch(*(tmp_path / name for name in ("flights/f1.csv", "flights/f2.csv", "bench/b1.csv")))
    (tmp_path / "c.toml").write_text(
        'schema = 1\nname = "acceptance"\nlogs = ["flights", "bench/*.csv"]\nvehicle = "v.toml"\nmethod = "default"\n'
        'tags = ["may"]\nset = ["convergence.count=50"]\nrequire = ["Mass"]\n'
        '[[match]]\nlogs = ["bench/*"]\nvehicle = "bench.toml"\ndelay = "auto"\ntags = ["bench"]\nexpect = "e.toml"\nrequire = "All"\n'
    )
    name, jobs = discover.plan([str(tmp_path / "c.toml")], Settings(assignments=("imu.gyro_noise_rad_s=1",)))
    assert name == "acceptance"
    assert [job.name for job in jobs] == ["f1", "f2", "b1"]
    flight, bench = jobs[0], jobs[2]
    said = ("convergence.count=50", 'estimator.method="default"')
    assert flight.settings == Settings(str(tmp_path / "v.toml"), (*said, "imu.gyro_noise_rad_s=1"), None, (Requirement("mass"),))
    assert bench.settings.vehicle == str(tmp_path / "bench.toml")
    assert bench.settings.assignments == (*said, 'cycle.command_delay_cycles="auto"', "imu.gyro_noise_rad_s=1")
    assert (len(bench.settings.require), bench.settings.expect) == (10, str(tmp_path / "e.toml"))
    assert (flight.tags, bench.tags) == (("may",), ("may", "bench"))
    over = Settings(vehicle="mine.toml", expect="mine.json", require=(Requirement("ixx"),))
    assert {(job.settings.vehicle, job.settings.expect, job.settings.require) for job in plan(tmp_path / "c.toml", over=over)} == {
        ("mine.toml", "mine.json", (Requirement("ixx"),))
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("logs = []", "logs"),
        ('logs = ["a.csv"]\nvehicel = "v"', "unknown key 'vehicel'; the nearest known key is 'vehicle'"),
        ('logs = ["b.csv"]', "b.csv: no such file or folder"),
        ('logs = ["a.csv"]\n[[match]]\nlogs = ["x*"]', "match.0.logs = ['x*']: matches none of the 1 logs"),
        ('logs = ["a.csv"]\nrequire = ["weight"]', "weight"),
        (
            'logs = ["a.csv"]\nrequire = "mass<2 m"',
            "line 2: require = 'mass<2 m': mass<2 m: 'm' is not a unit of mass; give it in % or kg or g",
        ),
        ('logs = ["a.csv"', "not valid TOML"),
    ],
)
def test_a_campaign_file_that_makes_no_sense_is_refused(tmp_path: Path, text: str, said: str) -> None:
    touch(tmp_path / "a.csv")
    (tmp_path / "c.toml").write_text(text)
    with pytest.raises(InputError) as refused:
        plan(tmp_path / "c.toml")
    assert said in str(refused.value)
