"""One job of a campaign: what its messages say of places, and what its result depends on."""

from __future__ import annotations

import pytest

from massprop_cli.campaign import work
from massprop_cli.campaign.plan import Job


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
