"""Results as JUnit XML: a suite for each log, and a test case for each expected quantity, or for all ten without expectations.

A case fails if its value is not as expected, is contradicted (unless allowed), or is required and not converged. Without expectations,
a case that is not converged is skipped. A log that massprop cannot use is an error.
"""

from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET

from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.escape import line
from massprop_cli.report import digits, vocabulary
from massprop_cli.report.vocabulary import gap
from massprop_cli.result.judge import INFORMED, contradiction, items, parts, unpredicted, why
from massprop_cli.result.read import Recorded, labels
from massprop_cli.result.schema import EstimateItem, Result

_COUNTED = {"failures": "failure", "errors": "error", "skipped": "skipped"}


@dataclass(frozen=True)
class LogOutcome:
    """Outcome of one log: a result, or an error message."""

    name: str
    result: Result | None = None
    error: str | None = None
    kind: str = "unusable input"
    """Kind of error."""
    unmet: str | None = None
    """Message on required quantities that are not converged."""
    allow_contradicted: bool = False
    """Whether a contradicted quantity without an expectation is skipped and does not fail."""
    suite: ET.Element | None = None
    """Complete suite, in place of all other fields."""


def outcomes(recorded: Sequence[Recorded]) -> list[LogOutcome]:
    """Outcomes of results."""
    return [LogOutcome(name, item.result) for item, name in zip(recorded, labels(recorded), strict=True)]


def text(found: Iterable[LogOutcome], name: str = "massprop") -> str:
    """The XML document of all outcomes; equal outcomes give equal bytes."""
    totals = dict.fromkeys(("tests", "failures", "errors"), 0)
    suites = []
    # convert each suite to text at once: the elements of a thousand logs need hundreds of megabytes
    for outcome in found:
        element = _suite(outcome) if outcome.suite is None else outcome.suite
        totals = {key: count + int(element.get(key, "0")) for key, count in totals.items()}
        ET.indent(element, " ", level=1)
        suites.append(f" {ET.tostring(element, encoding='unicode')}\n")
    counts = " ".join(f'{key}="{count}"' for key, count in totals.items())
    inside = f">\n{''.join(suites)}</testsuites>" if suites else " />"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="{name}" {counts}{inside}\n'


def _suite(outcome: LogOutcome) -> ET.Element:
    """The suite of one log."""
    if outcome.result is None:
        unusable = said(case(outcome.name, "log", "usable"), "error", outcome.error or "no result", outcome.kind)
        return suite(outcome.name, [unusable])
    cases = _cases(outcome, outcome.result)
    cases += [said(case(outcome.name, "log", "required"), "failure", outcome.unmet, "not converged")] if outcome.unmet else []
    made = suite(outcome.name, cases)
    made.insert(0, _properties(outcome.result))
    if outcome.result.warnings:
        warnings = ET.SubElement(made, "system-err")
        warnings.text = "\n".join(f"warning: {line(warning.message)} [{line(warning.code)}]" for warning in outcome.result.warnings)
    return made


def suite(name: str, cases: Sequence[ET.Element]) -> ET.Element:
    """A suite with test cases and their counts."""
    counts = {key: str(sum(one.find(tag) is not None for one in cases)) for key, tag in _COUNTED.items()}
    made = ET.Element("testsuite", {"name": line(name), "tests": str(len(cases)), **counts})
    made.extend(cases)
    return made


def _properties(found: Result) -> ET.Element:
    stated = {
        "log": found.log.path,
        "vehicle": found.vehicle.name,
        "method": found.provenance.method,
        "massprop": found.provenance.massprop,
        "input_sha256": found.provenance.input_sha256,
        "conventions": " ".join(vocabulary.conventions(found)),
    }
    properties = ET.Element("properties")
    for name, value in stated.items():
        ET.SubElement(properties, "property", {"name": name, "value": line(value)})
    return properties


def _cases(outcome: LogOutcome, found: Result) -> list[ET.Element]:
    held = found.expectations is not None
    validated = [(case(outcome.name, f"phase {phase}", "cross_validation"), missed) for phase, missed in unpredicted(found).items()]
    return [
        _quantity(case(outcome.name, part, quantity), quantity, item, contradiction(body), outcome.allow_contradicted)
        for part, body in parts(found)
        for quantity, item in items(body).items()
        if not held or item.expected is not None or item.verdict == "contradicted"
    ] + [said(one, "failure", missed, "not as expected") if missed else one for one, missed in validated]


def case(log: str, part: str, name: str) -> ET.Element:
    """A test case of a log."""
    # readers of JUnit XML split class names at dots
    return ET.Element("testcase", {"classname": line(f"{log.replace('.', '_')}.{part.replace('.', '_')}"), "name": line(name)})


def _quantity(one: ET.Element, quantity: str, item: EstimateItem, contradicted: str, allowed: bool) -> ET.Element:
    if item.verdict == "contradicted" and not (allowed and item.expected is None):
        said(one, "failure", why(item, contradicted) or gap(quantity, item, contradicted), item.verdict)
    elif item.expected is not None:
        if not item.expected.met:
            said(one, "failure", why(item), "not as expected" if item.verdict in INFORMED else item.verdict)
    elif item.verdict != "converged":
        said(one, "skipped", gap(quantity, item, contradicted), item.verdict)
    told = digits.with_sigma(item.value, item.sigma, item.verdict)
    ET.SubElement(one, "system-out").text = f"{quantity} = {told} {vocabulary.unit(item.unit)}, {item.verdict}"
    return one


def said(one: ET.Element, tag: str, message: str, kind: str) -> ET.Element:
    """The test case with a message under ``tag``: failure, error or skipped."""
    ET.SubElement(one, tag, {"message": line(message), "type": kind}).text = line(message)
    return one
