"""A check as JUnit XML: a test case for each subject, which fails by its faults, and for each wanted quantity."""

from xml.etree import ElementTree as ET

from massprop_cli.base.escape import line
from massprop_cli.check.finding import SUBJECTS, Check
from massprop_cli.report import junit


def text(found: Check) -> str:
    """One document; same check, same bytes."""
    return junit.text([junit.LogOutcome(found.log, suite=suite(found, found.log))], "massprop check")


def suite(found: Check, name: str) -> ET.Element:
    """The test suite of a check, by the name that its log goes by."""
    cases = [_subject(found, name, subject) for subject in SUBJECTS]
    for one in found.expected:
        if one.reached is not None:
            case = junit.case(name, "wanted", f"{one.phase}.{one.quantity}")
            cases.append(case if one.reached else junit.said(case, "failure", one.reason, "not reached"))
    return junit.suite(name, cases)


def _subject(found: Check, name: str, subject: str) -> ET.Element:
    case = junit.case(name, "check", subject)
    for one in found.findings:
        if one.subject != subject:
            continue
        said = f"{one.what}{f' ({one.where})' if one.where else ''}. {one.remedy}".strip()
        if one.grade == "note":
            ET.SubElement(case, "system-out").text = f"{line(said)} [{one.code}]"
        else:
            junit.said(case, "error" if one.grade == "unusable" else "failure", said, one.code)
    return case
