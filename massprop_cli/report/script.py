"""Scripts that stand in a page itself, each with the digest by which the page's policy allows it and nothing else."""

from __future__ import annotations

import base64
import hashlib
from importlib import resources
from typing import TYPE_CHECKING

from massprop_cli.base.dataclass import dataclass

if TYPE_CHECKING:
    from markupsafe import Markup


@dataclass(frozen=True)
class Script:
    """Text as it stands between its tags."""

    text: Markup
    digest: str
    """SHA-256 in base64, as a Content-Security-Policy wants it."""


def script(name: str) -> Script:
    """One of the package's own scripts or style sheets."""
    from markupsafe import Markup

    text = resources.files("massprop_cli.report").joinpath(f"templates/{name}").read_text(encoding="utf-8")
    return Script(Markup(text), base64.b64encode(hashlib.sha256(text.encode()).digest()).decode())
