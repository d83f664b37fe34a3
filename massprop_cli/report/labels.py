"""What to call results among each other."""

from __future__ import annotations

from collections.abc import Sequence

from massprop_cli.result.read import Recorded


def labels(recorded: Sequence[Recorded]) -> list[str]:
    """The folder of each, with as many of its parents as tell all apart: "log", or "monday/log" and "friday/log"."""
    folders = [item.path.resolve().parent.parts for item in recorded]
    depth = 1
    while len({folder[-depth:] for folder in folders}) < len(set(folders)):
        depth += 1
    return ["/".join(part.strip("/") for part in folder[-depth:]) or "/" for folder in folders]
