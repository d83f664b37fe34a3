"""Which result.json a page was made from, by its SHA-256: a reader can check whether the one beside it is still that one."""

from __future__ import annotations

import html
from collections.abc import Sequence

from massprop_cli.report.labels import labels
from massprop_cli.result.read import Recorded


def page(text: str, recorded: Sequence[Recorded]) -> str:
    """The page with the digests at its end; as it is where a result was not read from a file."""
    several = [f"{html.escape(name)}/" if len(recorded) > 1 else "" for name in labels(recorded)]
    said = [f"{name}result.json, SHA-256 <code>{one.sha256}</code>" for name, one in zip(several, recorded, strict=True) if one.sha256]
    before, mark, after = text.rpartition("</footer>")
    return f"{before} Made from {'; '.join(said)}.{mark}{after}" if said and mark else text


def markdown(text: str, recorded: Sequence[Recorded]) -> str:
    """The same of Markdown that tells of one result; that of several has no room for it."""
    digest = recorded[0].sha256 if len(recorded) == 1 else ""
    return f"{text}\nMade from result.json, SHA-256 `{digest}`.\n" if digest else text
