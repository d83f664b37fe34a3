"""One job of a campaign: what its messages say of places, and what its result depends on."""

from __future__ import annotations

import pytest

from massprop_cli.campaign import work
from massprop_cli.campaign.plan import Job, Settings
from massprop_cli.campaign.work import Inputs


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
