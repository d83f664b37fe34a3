"""``python -m website.pictures [NAME...]``: the example pictures of docs/warnings and docs/verdicts.

Each is the warning as a report has it, above the panels of the report's own figure that show it.
"""

from __future__ import annotations

import re
import sys
import textwrap
from xml.sax.saxutils import escape

from massprop_cli.report import figures
from massprop_cli.report.figures import canvas, palette
from massprop_cli.report.svg import gathered
from website.examples import VERDICTS, WARNINGS, Example, Told
from website.stage import ROOT

WIDTH = 864
"""Points: three panels."""
LINE, LETTERS = 17, 118
"""Points from line to line, and letters of one."""


def picture(name: str, example: Example, verdict: bool) -> str:
    """SVG; ValueError where the example doesn't say what it is there for."""
    told = example.made()
    if name not in told.said:
        raise ValueError(f"{name} is not said: {told.said}")
    heading = f"Verdict: {name.replace('_', ' ')}" if verdict else "⚠ Warning"
    message = told.said[name] if verdict else f"{told.said[name]} [{name}]"
    lines = textwrap.wrap(message, LETTERS)
    red = name == "contradicted" or any(code == "contradicted" for code in told.said)
    height = LINE * (len(lines) + 1) + 14
    drawing, below = _panels(example, told, height + 8)
    box = _box(heading, lines, palette.RED if red else palette.ORANGE, height)
    return gathered(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height + 8 + below:.0f}" font-family="sans-serif">\n'
        f"<title>{escape(message)}</title>\n<style>/* drawings */</style>\n{box}\n{drawing}</svg>\n"
    )


def _box(heading: str, lines: list[str], colour: str, height: int) -> str:
    """As a report's own."""
    texts = [f'<text x="22" y="{LINE + 6}" font-size="14" font-weight="bold" fill="{palette.INK}">{escape(heading)}</text>']
    texts += [
        f'<text x="22" y="{LINE * n + 6}" font-size="13" fill="{palette.INK}">{escape(line)}</text>' for n, line in enumerate(lines, 2)
    ]
    return (
        f'<rect width="{WIDTH}" height="100%" fill="{palette.PAPER}"/>\n'
        f'<rect x="1" y="1" width="{WIDTH - 2}" height="{height}" rx="4" fill="{palette.SHADE}" stroke="{colour}"/>'
        f'<rect x="1" y="1" width="7" height="{height}" fill="{colour}"/>\n' + "\n".join(texts)
    )


def _panels(example: Example, told: Told, top: int) -> tuple[str, float]:
    """The figure's panels side by side, and how high they are; nothing where a command says it."""
    if told.recorded is None:
        return "", 0.0
    every = figures.picture(example.figure, told.recorded).panels
    chosen = [every[n] for n in example.panels]
    svg = canvas.render(chosen, "svg", 3).decode()
    wide, high = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg).groups())  # type: ignore[union-attr]
    body = re.sub(r"<title>.*?</title>", "", svg[svg.index("<svg") :], count=1, flags=re.DOTALL)
    placed = re.sub(r'width="[^"]*" height="[^"]*"', f'y="{top}" width="{wide:g}" height="{high:g}"', body, count=1)
    return re.sub(r">\s+<", "><", placed), high


def main(names: list[str]) -> None:
    """All, or those that are named."""
    for examples, folder in ((WARNINGS, "warnings"), (VERDICTS, "verdicts")):
        for name in [name for name in examples if not names or f"{folder}/{name}" in names]:
            made = picture(name, examples[name], folder == "verdicts")
            (ROOT / "docs" / folder / f"{name}.svg").write_text(made, encoding="utf-8")
            print(f"{folder}/{name}: {len(made)} bytes", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
