"""A check as JUnit XML: a test case for each subject, which fails by its faults, and for each wanted quantity."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from massprop_cli.base.escape import line
from massprop_cli.check.finding import SUBJECTS, Check, Expected


def text(found: Check) -> str:
    """One document; same check, same bytes."""
    own = suite(found, found.log)
    suites = ET.Element("testsuites", {"name": "massprop check", **{key: own.get(key, "0") for key in ("tests", "failures", "errors")}})
    suites.append(own)
    ET.indent(suites, " ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def suite(found: Check, name: str) -> ET.Element:
    """The test suite of a check, by the name that its log goes by."""
    cases = [_subject(found, name, subject) for subject in SUBJECTS]
    cases += [_wanted(name, one) for one in found.expected if one.reached is not None]
    failed = sum(case.find("failure") is not None for case in cases)
    errors = sum(case.find("error") is not None for case in cases)
    counts = {"tests": str(len(cases)), "failures": str(failed), "errors": str(errors), "skipped": "0"}
    made = ET.Element("testsuite", {"name": line(name), **counts})
    made.extend(cases)
    return made


def _subject(found: Check, name: str, subject: str) -> ET.Element:
    case = _case(name, "check", subject)
    for one in found.findings:
        if one.subject != subject:
            continue
        said = line(f"{one.what}{f' ({one.where})' if one.where else ''}. {one.remedy}".strip())
        if one.grade == "note":
            ET.SubElement(case, "system-out").text = f"{said} [{one.code}]"
        else:
            ET.SubElement(case, "error" if one.grade == "unusable" else "failure", {"message": said, "type": one.code}).text = said
    return case


def _wanted(log: str, one: Expected) -> ET.Element:
    case = _case(log, "wanted", f"{one.phase}.{one.quantity}")
    if not one.reached:
        ET.SubElement(case, "failure", {"message": line(one.reason), "type": "not reached"}).text = line(one.reason)
    return case


def _case(log: str, part: str, name: str) -> ET.Element:
    return ET.Element("testcase", {"classname": line(f"{log.replace('.', '_')}.{part}"), "name": line(name)})
