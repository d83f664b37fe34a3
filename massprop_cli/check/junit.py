"""A check as JUnit XML: a test case for each subject, which fails by its faults, and for each wanted quantity."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from massprop_cli.base.escape import line
from massprop_cli.check.finding import SUBJECTS, Check


def text(found: Check) -> str:
    """One document; same check, same bytes."""
    cases = [_subject(found, subject) for subject in SUBJECTS]
    cases += [_wanted(found, f"{one.phase}.{one.quantity}", one.reached, one.reason) for one in found.expected if one.reached is not None]
    failed = sum(case.find("failure") is not None for case in cases)
    errors = sum(case.find("error") is not None for case in cases)
    counts = {"tests": str(len(cases)), "failures": str(failed), "errors": str(errors)}
    suites = ET.Element("testsuites", {"name": "massprop check", **counts})
    suite = ET.SubElement(suites, "testsuite", {"name": line(found.log), **counts})
    suite.extend(cases)
    ET.indent(suites, " ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def _subject(found: Check, subject: str) -> ET.Element:
    case = _case(found, "check", subject)
    for one in found.findings:
        if one.subject != subject:
            continue
        said = line(f"{one.what}{f' ({one.where})' if one.where else ''}. {one.remedy}".strip())
        if one.grade == "note":
            ET.SubElement(case, "system-out").text = f"{said} [{one.code}]"
        else:
            ET.SubElement(case, "error" if one.grade == "unusable" else "failure", {"message": said, "type": one.code}).text = said
    return case


def _wanted(found: Check, name: str, reached: bool, reason: str) -> ET.Element:
    case = _case(found, "wanted", name)
    if not reached:
        ET.SubElement(case, "failure", {"message": line(reason), "type": "not reached"}).text = line(reason)
    return case


def _case(found: Check, part: str, name: str) -> ET.Element:
    return ET.Element("testcase", {"classname": line(f"{found.log.replace('.', '_')}.{part}"), "name": line(name)})
