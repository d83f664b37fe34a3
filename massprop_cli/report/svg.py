"""Parts of a page: drawings with unique ids and the page's font and colours, and scripts with their digests."""

import base64
import hashlib
import html
import re
from importlib import resources
from typing import Any

from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.escape import line
from massprop_cli.base.lazy import markupsafe
from massprop_cli.report.figures import palette

_UNUSED = re.compile(r' id="(?:figure|patch|line2d|text|xtick|ytick|matplotlib\.axis|legend|LineCollection|FillBetweenPolyCollection)_\d+"')
_COLOUR = re.compile("|".join(palette.NAMES))
_STYLE = re.compile(r'(?<= style=")[^"]*')


def inline(svg: bytes, prefix: str, alt_text: str) -> str:
    """The ``<svg>`` element of a drawing; ``prefix`` makes its ids unique in the page, and ``alt_text`` is the alternative text."""
    text = svg.decode()
    text = text[text.index("<svg") :]
    box = re.search(r'viewBox="[^"]*"', text)
    body = text[text.index(">") + 1 :].replace("</svg>", "").strip()
    body = re.sub(r"<title>.*?</title>", "", body, count=1, flags=re.DOTALL)
    body = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", body, count=1, flags=re.DOTALL)
    body = re.sub(r' transform="rotate\(-0 [^"]*"', "", _UNUSED.sub("", body))
    body = body.replace("xlink:href=", "href=")
    body = re.sub(r' id="([^"]*)"', rf' id="{prefix}-\1"', body)
    body = body.replace('href="#', f'href="#{prefix}-').replace("url(#", f"url(#{prefix}-")
    body = _STYLE.sub(lambda style: _themed(style[0]), body)
    body = _flat(re.sub(r">\s+<", "><", body).strip())
    label = html.escape(line(alt_text))
    return f'<svg {box[0] if box else ""} role="img" aria-label="{label}"><title>{label}</title>{body}</svg>'


def _flat(body: str) -> str:
    """The drawing without ``<g>`` elements that have no attributes."""
    body, changes = body.replace("<g/>", ""), 1
    while changes:
        body, changes = re.subn(r"<g>((?:(?!<g[ >]|</g>).)*)</g>", r"\1", body, flags=re.DOTALL)
    return body


def quoted(text: str) -> str:
    """The text as a CSS string, with special characters escaped."""
    return '"{}"'.format("".join(c if c.isascii() and (c.isalnum() or c in " ,.-_") else f"\\{ord(c):x} " for c in line(text, 80)))


def gathered(page: str) -> str:
    """The page with inline styles replaced by classes, whose rules replace ``/* drawings */`` in the style sheet."""
    rules: dict[str, str] = {}

    def named(found: re.Match[str]) -> str:
        return f'{found[1]} class="{rules.setdefault(found[2], f"d{len(rules)}")}"'

    page = re.sub(r'(<[a-z]+(?: [^<>]*?)?) style="([^"]*)"', named, page)
    return page.replace("/* drawings */", "\n".join(f".{name} {{ {style} }}" for style, name in rules.items()), 1)


def _themed(style: str) -> str:
    """A style with the page's font and colours as CSS variables."""
    style = re.sub(r"font-family: [^;]*;?\s*", "", style)
    style = re.sub(r"(font: [^;']*)'[^;]*", r"\1var(--font)", style)
    return _COLOUR.sub(lambda colour: f"var(--{palette.NAMES[colour[0]]})", style)


@dataclass(frozen=True)
class Script:
    """Script or style sheet of a page."""

    text: Any
    """Content of the element, as markup."""
    digest: str
    """SHA-256 digest in base64, for the Content-Security-Policy."""


def script(name: str) -> Script:
    """A script or style sheet of the package, by file name."""
    text = resources.files("massprop_cli.report").joinpath(f"templates/{name}").read_text(encoding="utf-8")
    return Script(markupsafe.Markup(text), base64.b64encode(hashlib.sha256(text.encode()).digest()).decode())
