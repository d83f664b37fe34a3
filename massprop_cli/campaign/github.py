"""A campaign in GitHub Actions: a summary of the job and annotations, within what GitHub takes.

Limits: 1 MiB of summary for each step, and ten annotations of each kind for each step (docs.github.com, Workflow commands for GitHub
Actions, "Step isolation and limits"; Annotations).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from massprop_cli.base.escape import line
from massprop_cli.campaign import markdown
from massprop_cli.campaign.summary import Summary

SUMMARY = 1024 * 1024
"""Bytes of UTF-8 of a step's summary."""
ANNOTATIONS = 10


def append_summary(file: Path, found: Summary) -> None:
    """Add the campaign to a step's summary, in the room that is left there."""
    used = file.stat().st_size if file.exists() else 0
    text = markdown.text(found, SUMMARY - used)
    with file.open("a", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


def commands(found: Summary) -> list[str]:
    """Workflow commands, ten at most: one for each log that isn't done, then for what is beyond the baseline."""
    said = list(_said(found))
    if len(said) > ANNOTATIONS:
        more = len(said) - ANNOTATIONS + 1
        said = [*said[: ANNOTATIONS - 1], (f"{found.name}: {more} more", f"{more} more are in the job's summary and in campaign.html")]
    return [f"::error title={_property(title)}::{_data(message)}" for title, message in said]


def _said(found: Summary) -> Iterator[tuple[str, str]]:
    for row in found.logs:
        if row.outcome is not None and row.outcome.exit_code:
            yield row.name, row.outcome.message
    for item in found.baseline.beyond if found.baseline else ():
        yield "beyond the baseline", item.message


def _data(text: str) -> str:
    """A message as the runner reads it back (actions/toolkit, command.ts)."""
    return line(text).replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
