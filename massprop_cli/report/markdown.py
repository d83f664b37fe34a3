"""Results as Markdown, for job summaries and merge requests."""

from collections.abc import Callable, Iterable, Sequence

from massprop_cli.base.escape import markdown as shown
from massprop_cli.report import assumptions, timing, view, vocabulary
from massprop_cli.report.vocabulary import gaps
from massprop_cli.result.judge import contradiction, missed, parts
from massprop_cli.result.read import Recorded, labels
from massprop_cli.result.schema import DockedObject, EstimateItem, Mended, PhaseItem, Result

LARGEST = 200_000
"""Largest size of a text, bytes of UTF-8; CI services cut off longer summaries."""
OVERVIEW = 50_000
"""Largest size of the table of all results, bytes."""
_RESERVED = 500
"""Bytes for the sentence on omitted results."""
_WORDS = ("quantity", "unit", "verdict", "met")
_MET = {"✓": "✓ met", "✗": "✗ missed"}


def text(recorded: Sequence[Recorded]) -> str:
    """The document: an overview of several results, then the tables, remedies, warnings and conventions of each."""
    names = labels(recorded)
    head = ["# Mass properties", ""] + (_overview(recorded, names) if len(recorded) > 1 else [])
    free = LARGEST - _RESERVED - _size(head)
    lines, whole = [*head], 0
    for item, name in zip(recorded, names, strict=True):
        blocks = _sections(item.result, name)
        if sum(_size(block) for block in blocks) > free:
            lines += _beginning(blocks, free, name) if whole == 0 else []
            break
        lines += [line for block in blocks for line in block]
        free -= sum(_size(block) for block in blocks)
        whole += 1
    if whole < len(recorded):
        lines += [
            "",
            f"{len(recorded) - whole} of {len(recorded)} results are left out or shortened, to keep this page under 200 kB.",
            "",
        ]
    return "\n".join(lines).rstrip("\n") + "\n"


def stamped(text: str, recorded: Sequence[Recorded]) -> str:
    """The text with the SHA-256 digest of result.json, if there is one result."""
    digest = recorded[0].sha256 if len(recorded) == 1 else ""
    return f"{text}\nMade from result.json, SHA-256 `{digest}`.\n" if digest else text


def _size(lines: Iterable[str]) -> int:
    """Size of some lines, bytes of UTF-8."""
    return sum(len(line.encode()) + 1 for line in lines)


def _beginning(blocks: list[list[str]], free: int, name: str) -> list[str]:
    """As many whole sections of a result as ``free`` bytes allow."""
    lines: list[str] = []
    for block in blocks:
        if _size(lines) + _size(block) > free:
            break
        lines += block
    return lines or [f"## {shown(name)}", ""]


def _overview(recorded: Sequence[Recorded], names: Sequence[str]) -> list[str]:
    """The table of all results."""
    failed = sum(bool(missed(item.result)) for item in recorded)
    tested = sum(item.result.expectations is not None for item in recorded)
    phrase = f"{tested} tested against expectations, {failed} of them not as expected" if tested else "none tested against expectations"
    rows, free = [], OVERVIEW
    for item, name in zip(recorded, names, strict=True):
        line = row([shown(name), shown(item.result.log.path), shown(item.result.vehicle.name), *_summary(item.result)])
        free -= _size([line])
        if free < 0:
            break
        rows.append(line)
    more = len(recorded) - len(rows)
    cut = [f"{more} more of {len(recorded)} results are left out of this table.", ""] if more else []
    header = table(["result", "log", "vehicle", "converged", "as expected", "warnings"], "lllrrr")
    return [f"{len(recorded)} results, {phrase}.", "", *header, *rows, "", *cut]


def _summary(found: Result) -> list[str]:
    """Cells of a result in the table of all results: converged, as expected, warnings."""
    items = [item for _, body in parts(found) for item in body.estimates.values()]
    held = [item.expected for item in items if item.expected is not None]
    contradicted = sum(item.verdict == "contradicted" for item in items)
    converged = f"{sum(item.verdict == 'converged' for item in items)} of {len(items)}"
    converged += f", {vocabulary.SIGNS['contradicted']} {contradicted} contradicted" if contradicted else ""
    sign = "✓" if all(expected.met for expected in held) else "✗"
    met = f"{sign} {sum(expected.met for expected in held)} of {len(held)}" if held else "–"
    return [converged, met, str(len(found.warnings))]


def _sections(found: Result, name: str) -> list[list[str]]:
    """Sections of a result; a long result is cut between two of them."""
    return [
        [f"## {shown(name)}", "", *_alarm(found), _origin(found), "", *_verdict(found)],
        *(_part(part, body, found) for part, body in parts(found)),
        *(_mended(one) for one in found.mended),
        *([["### Assumptions", "", *(f"- {shown(assumptions.sentence(a))}" for a in found.assumptions), ""]] if found.assumptions else []),
        *(_sensitivity(one) for one in assumptions.sensitivities(found.assumptions)),
        _list("Conventions:", vocabulary.conventions(found)),
        _list(f"Not converged, and {'the remedy' if _alarms(found) else 'the motion that would show it'}:", gaps(found)),
        *_warnings(found),
    ]


def _alarms(found: Result) -> list[str]:
    """A sentence for each contradicted part."""
    return [f"Contradicted in {part}: {contradiction(body)}" for part, body in parts(found) if contradiction(body)]


def _alarm(found: Result) -> list[str]:
    if not _alarms(found):
        return []
    said = "The sigmas of contradicted values are not valid: do not use these values. Correct the cause; no motion helps."
    return [*(f"**{vocabulary.SIGNS['contradicted']} {shown(line)}**  " for line in _alarms(found)), said, ""]


def _origin(found: Result) -> str:
    log = found.log
    return (
        f"Log {shown(log.path)} ({log.duration_s:.6g} s, {log.cycles} cycles), vehicle {shown(found.vehicle.name)}, "
        f"method {shown(found.provenance.method)}, command delay {found.delay.cycles:.6g} cycles ({found.delay.source}), "
        f"thrust lag {found.lag.lag_s:.6g} s ({found.lag.source}), {''.join(f'{said} (detected), ' for said in timing.low_passes(found))}"
        f"massprop {shown(found.provenance.massprop)}."
    )


def _verdict(found: Result) -> list[str]:
    if found.expectations is None:
        return []
    wrong = missed(found)
    against = f"tested against {shown(found.expectations.path)}"
    if not wrong:
        return [f"**✓ All as expected** ({against}).", ""]
    return _list(f"**✗ {len(wrong)} not as expected** ({against}):", wrong)


def _part(part: str, body: PhaseItem | DockedObject, found: Result) -> list[str]:
    span = f", {body.start_s:.6g} to {body.end_s:.6g} s" if isinstance(body, PhaseItem) else ""
    about = body.about_pivot if isinstance(body, PhaseItem) else {}
    pivot = [f"{vocabulary.ABOUT_PIVOT.capitalize()}:", "", *_estimates(about, found), ""] if about else []
    note = [f"Physical consistency: {shown(body.physical.note)}.", ""] if isinstance(body, PhaseItem) and body.physical.note else []
    implied = assumptions.implied_thrust(body)
    note += [f"{shown(implied[0].upper() + implied[1:])}.", ""] if implied else []
    return [f"### {shown(part[0].upper() + part[1:])}{span}", "", *_estimates(body.estimates, found), "", *pivot, *note]


def _estimates(estimates: dict[str, EstimateItem], found: Result) -> list[str]:
    columns = view.texts(estimates, assumptions.sigma_heading(found))
    said: dict[str, Callable[[str], str]] = {"quantity": shown, "tolerance": shown, "verdict": _verdict_words, "met": _MET.__getitem__}
    cells = [[said[name](text) if text and name in said else text or "–" for text in texts] for name, texts in columns.items()]
    return [*table([*columns], "".join("l" if name in _WORDS else "r" for name in columns)), *map(row, zip(*cells, strict=True))]


def _mended(one: Mended) -> list[str]:
    found = [f"### {view.CORRECTED}", "", f"Not the result: {shown(one.message)} ({shown(one.code)})", ""]
    found += [*(f"    {option}" for option in view.corrections(one)), ""] if one.settings else []
    found += [view.beyond_options(one), ""] if not one.whole else []
    for phase in one.phases:
        still = view.still_contradicted(phase)
        found += [f"Phase {shown(phase.name)}{f': **{shown(still)}**' if still else ''}", ""]
        found += table(["quantity", "value", "± sigma", "unit", "verdict"], "lrrll")
        found += [row([shown(name), value, sigma, unit, _verdict_words(told)]) for name, value, sigma, unit, told in view.corrected(phase)]
        found.append("")
    return found


def _sensitivity(one: assumptions.Sensitivity) -> list[str]:
    columns = ["quantity", "unit", *(shown(f"{code}, {step}") for code, step in one.steps)]
    return [
        f"Change of the values for one step, phase {shown(one.phase)}:",
        "",
        *table(columns, "ll" + "r" * len(one.steps)),
        *(row([shown(name), unit, *changes]) for name, unit, changes in one.rows),
        row([assumptions.NOTICED, "", *one.noticed]),
        "",
    ]


def _verdict_words(verdict: str) -> str:
    return f"{vocabulary.SIGNS[verdict]} {verdict.replace('_', ' ')}"


def _warnings(found: Result) -> list[list[str]]:
    """A section for each warning; the first one contains the title."""
    return [
        [*(["Warnings:", ""] if number == 0 else []), f"- {shown(warning.message)} ({shown(warning.code)})"]
        + ([""] if number == len(found.warnings) - 1 else [])
        for number, warning in enumerate(found.warnings)
    ]


def _list(title: str, lines: Sequence[str]) -> list[str]:
    return [title, "", *(f"- {shown(line)}" for line in lines), ""] if lines else []


def table(columns: Sequence[str], alignment: str) -> list[str]:
    """Heading and rule of a table; ``alignment`` has "l" or "r" for each column."""
    return [row(columns), row(["--:" if side == "r" else "---" for side in alignment])]


def row(cells: Sequence[str]) -> str:
    """One row of a table."""
    return f"| {' | '.join(cells)} |"
