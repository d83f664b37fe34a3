"""Escaping of text from outside (names, messages that quote them) for terminal, page, table and JSON."""

from __future__ import annotations

import json as jsons
import re
import sys
import unicodedata
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import BaseModel

LONGEST = 2000
"""Largest length of a text, characters."""
_MESSAGE, _END = 8000, 1000
"""Largest length of a message, and the length kept at its end, which states the remedy, characters."""
_HIDDEN = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories that are replaced: control, format (direction overrides), surrogates, unassigned, line ends."""
_FORMULA = ("=", "+", "-", "@")
_MARKDOWN = re.compile(r"([\\`*\[\]#|~$@]|(?<![^\W_])_|_(?![^\W_])|:(?=//)|(?<=www)\.|^[-+=])")
"""Markdown characters: special anywhere, at the beginning of a line, or in a link."""
_NUMBERED = re.compile(r"^(\d+)([.)])(?=\s|$)")
"""Beginning of a numbered list item."""
_ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})


def visible(text: str) -> str:
    """The text with the replacement character for hidden characters; valid in XML, JSON and UTF-8."""
    return "".join("\ufffd" if not c.isprintable() and unicodedata.category(c) in _HIDDEN and c not in "\t\n" else c for c in text)


def line(text: str, longest: int = LONGEST) -> str:
    """The text on one line, at most ``longest`` characters."""
    shown = visible(" ".join(text.split()))
    return shown if len(shown) <= longest else f"{shown[: longest - 1]}…"


def name(text: str) -> str:
    """A path or a name on one line, with its blanks."""
    return visible(text).replace("\t", "\ufffd").replace("\n", "\ufffd")


def message(text: str) -> str:
    """The text on one line of a terminal; a long text loses its middle, because the remedy is at the end."""
    shown = line(text, sys.maxsize)
    return shown if len(shown) <= _MESSAGE else f"{shown[: _MESSAGE - _END]} … {shown[-_END:]}"


def rich(text: str) -> str:
    """The text on one line, with rich's markup escaped."""
    from rich.markup import escape

    return escape(line(text))


def document(found: BaseModel, end: str = "\n") -> str:
    """A model as canonical JSON without NaN and infinity: the same content gives the same bytes."""
    return json(jsons.dumps(found.model_dump(by_alias=True, mode="json"), indent=1, allow_nan=False, ensure_ascii=False)) + end


def json(text: str) -> str:
    r"""JSON text with hidden characters as escapes (``\u202e``), safe for a terminal; its content is the same."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(_escaped(c) if not c.isprintable() and unicodedata.category(c) in _HIDDEN and c != "\n" else c for c in text)


def _escaped(character: str) -> str:
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))


def markdown(text: str) -> str:
    """The text escaped for a Markdown paragraph, heading or table cell."""
    return _NUMBERED.sub(r"\1\\\2", _MARKDOWN.sub(r"\\\1", line(text).translate(_ENTITIES)))


def cell(text: str) -> str:
    """The text escaped for a spreadsheet cell: an apostrophe precedes a formula."""
    shown = line(text)
    # spreadsheets also accept full-width signs
    return f"'{shown}" if unicodedata.normalize("NFKC", shown[:1]).startswith(_FORMULA) else shown
