"""Formulas in Markdown as MathML, which browsers show by themselves: ``$`…`$`` in a line, a ``math`` block on its own."""

from __future__ import annotations

from typing import Any

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor

BEFORE_CODE = 195
"""Priority of the pattern: that of `code` in Python-Markdown is 190."""


def block(source: str, *_: Any, **__: Any) -> str:
    """A fenced ``math`` block, a formula a line."""
    return "".join(f'<p class="formula">{convert(line, display="block")}</p>' for line in source.splitlines() if line.strip())


class _Inline(InlineProcessor):
    def handleMatch(self, m: Any, data: str) -> tuple[str, int, int]:  # noqa: N802, ARG002
        return self.md.htmlStash.store(convert(m[1])), m.start(0), m.end(0)


class _Formulas(Extension):
    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802
        md.inlinePatterns.register(_Inline(r"\$`([^`]+)`\$", md), "formula", BEFORE_CODE)


def makeExtension(**_: Any) -> Extension:  # noqa: N802
    """Python-Markdown asks for this name."""
    return _Formulas()
