"""JUnit XML of a check: one test case per subject, which fails if it has faults, and one per wanted quantity."""

from xml.etree import ElementTree as ET

from massprop_cli.base.escape import line
from massprop_cli.check.finding import SUBJECTS, Check
from massprop_cli.report import junit


def text(check: Check) -> str:
    """Return one JUnit document; equal checks give equal bytes."""
    return junit.text([junit.LogOutcome(check.log, suite=suite(check, check.log))], "massprop check")


def suite(check: Check, name: str) -> ET.Element:
    """Test suite of a check; ``name`` names the log."""
    cases = [_subject(check, name, subject) for subject in SUBJECTS]
    for one in check.expected:
        if one.reached is not None:
            case = junit.case(name, "wanted", f"{one.phase}.{one.quantity}")
            cases.append(case if one.reached else junit.said(case, "failure", one.reason, "not reached"))
    return junit.suite(name, cases)


def _subject(check: Check, name: str, subject: str) -> ET.Element:
    case = junit.case(name, "check", subject)
    for one in check.findings:
        if one.subject != subject:
            continue
        message = f"{one.what}{f' ({one.where})' if one.where else ''}. {one.remedy}".strip()
        if one.grade == "note":
            ET.SubElement(case, "system-out").text = f"{line(message)} [{one.code}]"
        else:
            junit.said(case, "error" if one.grade == "unusable" else "failure", message, one.code)
    return case
