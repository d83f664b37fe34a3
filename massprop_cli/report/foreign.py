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


def visible(text: str) -> str:
    """The text with the replacement character for what can't be shown; no format of XML, JSON or UTF-8 objects to it."""
    return "".join("\ufffd" if unicodedata.category(c) in _HIDDEN and c not in "\t\n" else c for c in text)


def line(text: str, longest: int = LONGEST) -> str:
    """The same on one line."""
    shown = visible(" ".join(text.split()))
    return shown if len(shown) <= longest else f"{shown[: longest - 1]}…"


def markdown(text: str) -> str:
    """The text as it stands, in a Markdown paragraph, heading or table cell."""
    return _NUMBERED.sub(r"\1\\\2", _MARKDOWN.sub(r"\\\1", line(text).translate(_ENTITIES)))


def cell(text: str) -> str:
    """The text for a spreadsheet: an apostrophe goes before what it would take for a formula."""
    shown = line(text)
    return f"'{shown}" if shown.startswith(_FORMULA) else shown
