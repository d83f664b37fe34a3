"""Text from outside (names of files, vehicles, phases; messages that quote them) made safe for each format."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 2000
"""Characters of a text that are shown."""
_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn")
"""Unicode categories that are not shown as they are: control, format (direction overrides), surrogates, unassigned."""
_FORMULA = ("=", "+", "-", "@")
_MARKDOWN = re.compile(r"([\\`*\[\]#|~$@]|(?<![^\W_])_|_(?![^\W_])|:(?=//)|(?<=www)\.|^[-+=])")
"""What means something anywhere, or at the beginning of a line, or makes a link."""
_NUMBERED = re.compile(r"^(\d+)([.)])(?=\s|$)")
"""What makes an item of a numbered list."""
_ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})


def line(text: str) -> str:
    """The text on one line, what can't be shown as the replacement character; no format of XML, JSON or UTF-8 objects to it."""
    shown = "".join("\ufffd" if unicodedata.category(c) in _HIDDEN else c for c in " ".join(text.split()))
    return shown if len(shown) <= LONGEST else f"{shown[:LONGEST]}…"


def markdown(text: str) -> str:
    """The text as it stands, in a Markdown paragraph, heading or table cell."""
    return _NUMBERED.sub(r"\1\\\2", _MARKDOWN.sub(r"\\\1", line(text).translate(_ENTITIES)))


def cell(text: str) -> str:
    """The text for a spreadsheet: an apostrophe goes before what it would take for a formula."""
    shown = line(text)
    return f"'{shown}" if shown.startswith(_FORMULA) else shown
