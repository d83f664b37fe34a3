"""One job of a campaign: what its messages say of places, and what its result depends on."""

from pathlib import Path
from typing import Any

import pytest

from massprop_cli.campaign import work
from massprop_cli.campaign.plan import Job, Settings
from massprop_cli.campaign.work import Inputs
from massprop_cli.inputs.formats import isolated, recording


def message(log: str, shown: str, said: str) -> str:
    return work.failed(Job("name", log, shown), 3, said).outcome.message


@pytest.mark.parametrize(
    ("log", "shown", "said", "told"),
    [
        ("e/t.csv", "x/t.csv", "date/t.csv and e/t.csv: bad", "date/t.csv and x/t.csv: bad"),
        ("t.csv", "t.csv", "start.csv, t.csv", "start.csv, t.csv"),
        ("te.csv", "a/te.csv", "date.csv, te.csv.bak, (te.csv).", "date.csv, te.csv.bak, (a/te.csv)."),
        ("e/t.csv", "t.csv", "e/date.toml, late/date.toml, /e/date.toml", "date.toml, late/date.toml, /e/date.toml"),
        ("/tmp/q/t.csv", "t.csv", "/tmp/q/t.csv, line 3: no 'e'; /mnt/tmp/q/t.csv", "t.csv, line 3: no 'e'; /mnt/tmp/q/t.csv"),
        ("/tmp/q/t.csv", "q/t.csv", "'/tmp/q/v.toml': key; --set x=/tmp/q/v.toml", "'q/v.toml': key; --set x=q/v.toml"),
        ("s3://b/c/t.csv", "c/t.csv", "s3://b/c/t.csv (embedded vehicle)", "c/t.csv (embedded vehicle)"),
        ("a/[1]\\d.csv", "a/[1]\\d.csv", "a/[1]\\d.csv: \\1", "a/[1]\\d.csv: \\1"),
    ],
)
def test_a_message_names_places_as_the_campaign_does_and_leaves_other_words_alone(log: str, shown: str, said: str, told: str) -> None:
    assert message(log, shown, said) == told


@pytest.mark.parametrize(
    ("setting", "said"), [({"MASSPROP_MAX_LOG_BYTES": "10"}, "the limit is 10"), ({"MASSPROP_MAX_NUMBERS": "no"}, "not a limit")]
)
def test_what_the_machine_does_not_take_is_no_fault_of_the_log_and_is_tried_again(
    setting: dict[str, str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had been kept, and told again where the limit was long raised."""
    (tmp_path / "log.csv").write_text("time_s\n" + "1\n" * 20)
    (tmp_path / "vehicle.toml").write_text('schema = 1\nname = "v"\n')
    place = str(tmp_path / "log.csv")
    for name, value in setting.items():
        monkeypatch.setenv(name, value)
    produced = work.process(Job("log", place, "log.csv"))
    assert produced is not None
    assert (produced.outcome.exit_code, produced.outcome.fingerprint) == (3, "")
    assert said in produced.outcome.message
    for name in setting:
        monkeypatch.delenv(name)
    again = work.process(Job("log", place, "log.csv"))
    assert again is not None
    assert again.outcome.exit_code == 3
    assert len(again.outcome.fingerprint) == 64


def test_a_package_that_is_not_there_is_no_fault_of_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor is what the process that reads a recording refuses by a limit."""
    (tmp_path / "log.mf4").write_bytes(b"MDF     4.10    " + bytes(200))
    (tmp_path / "vehicle.toml").write_text('schema = 1\nname = "v"\n')

    def refusing(told: dict[str, Any]) -> str:
        def read(path: Path, *_: Any) -> Any:
            return isolated._read(path, next(iter(recording.KINDS.values())), told, tmp_path)

        monkeypatch.setattr(isolated, "read", read)
        produced = work.process(Job("log", str(tmp_path / "log.mf4"), "log.mf4"))
        assert produced is not None
        assert produced.outcome.exit_code == 3
        return produced.outcome.fingerprint

    assert refusing({"missing": "asammdf"}) == ""
    assert refusing({"refused": "too large", "by_machine": True}) == ""
    assert len(refusing({"refused": "no numbers", "by_machine": False})) == 64


def mark(report: bool) -> str:
    return work.fingerprint(Job("name", "t.csv", "t.csv", Settings(report=report)), Inputs(b"log", None, None))


@pytest.mark.parametrize("library", ["matplotlib", "jinja2"])
def test_a_page_made_by_another_version_of_what_draws_it_is_made_again(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plain, page = mark(False), mark(True)
    theirs = work.versions(True) | {library: "0.0"}
    own = work.versions(False)
    monkeypatch.setattr(work, "versions", lambda report=False: theirs if report else own)
    assert (mark(False), mark(True) == page) == (plain, False)


def test_the_versions_that_a_page_depends_on_count_where_one_is_made_alone() -> None:
    assert list(work.versions(False)) == ["massprop", "kernel", "python", "numpy", "pyarrow"]
    assert set(work.versions(True)) - set(work.versions(False)) == {"matplotlib", "jinja2"}
