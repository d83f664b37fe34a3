"""Text from outside (names, messages that quote them) made safe for terminal, page, table and file name: the one place for it."""

from __future__ import annotations

import json as jsons
import re
import sys
import unicodedata
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import BaseModel

LONGEST = 2000
"""Characters of a text that are shown."""
_MESSAGE, _END = 8000, 1000
"""Characters of a message, and of them those at its end, where the remedy stands."""
_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories that are not shown as they are: control, format (direction overrides), surrogates, unassigned, line ends."""
_FORMULA = ("=", "+", "-", "@")
_MARKDOWN = re.compile(r"([\\`*\[\]#|~$@]|(?<![^\W_])_|_(?![^\W_])|:(?=//)|(?<=www)\.|^[-+=])")
"""What means something anywhere, or at the beginning of a line, or makes a link."""
_NUMBERED = re.compile(r"^(\d+)([.)])(?=\s|$)")
"""What makes an item of a numbered list."""
_ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})


def visible(text: str) -> str:
    """The text with the replacement character for what can't be shown; no format of XML, JSON or UTF-8 objects to it."""
    return "".join("\ufffd" if not c.isprintable() and unicodedata.category(c) in _HIDDEN and c not in "\t\n" else c for c in text)


def line(text: str, longest: int = LONGEST) -> str:
    """The text on one line."""
    shown = visible(" ".join(text.split()))
    return shown if len(shown) <= longest else f"{shown[: longest - 1]}…"


def name(text: str) -> str:
    """A path or a name as it is spelt, blanks included, on one line."""
    return visible(text).replace("\t", "\ufffd").replace("\n", "\ufffd")


def message(text: str) -> str:
    """The text for one line of a terminal; a longer text loses its middle, since the remedy is at the end."""
    shown = line(text, sys.maxsize)
    return shown if len(shown) <= _MESSAGE else f"{shown[: _MESSAGE - _END]} … {shown[-_END:]}"


def rich(text: str) -> str:
    """The text on one line for rich, with rich's own marks escaped."""
    from rich.markup import escape

    return escape(line(text))


def document(found: BaseModel, end: str = "\n") -> str:
    """A model as canonical JSON: same content, same bytes. NaN and infinity can't appear."""
    return json(jsons.dumps(found.model_dump(by_alias=True, mode="json"), indent=1, allow_nan=False, ensure_ascii=False)) + end


def json(text: str) -> str:
    r"""JSON text with what can't be shown as its escape (``\u202e``): it reads back the same, and may stand on a terminal."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(_escaped(c) if not c.isprintable() and unicodedata.category(c) in _HIDDEN and c != "\n" else c for c in text)


def _escaped(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))


def markdown(text: str) -> str:
    """The text as it stands, in a Markdown paragraph, heading or table cell."""
    return _NUMBERED.sub(r"\1\\\2", _MARKDOWN.sub(r"\\\1", line(text).translate(_ENTITIES)))


def cell(text: str) -> str:
    """The text for a spreadsheet: an apostrophe goes before what it would take for a formula."""
    shown = line(text)
    # a spreadsheet takes full-width signs for signs too
    return f"'{shown}" if unicodedata.normalize("NFKC", shown[:1]).startswith(_FORMULA) else shown
