"""A campaign as JUnit XML: a suite per log; an error without a result, failures for unmet requirements and failed checks."""

from collections.abc import Iterator

from massprop_cli.base import exits
from massprop_cli.campaign.outcome import CHECKED
from massprop_cli.campaign.place import RESULTS, Place
from massprop_cli.campaign.summary import Summary
from massprop_cli.check import junit as checked
from massprop_cli.check.finding import Check
from massprop_cli.report import junit
from massprop_cli.result.schema import Result


def text(place: Place, summary: Summary) -> str:
    """The XML text. The function reads one result at a time; each difference from the baseline is a suite."""
    return junit.text(_outcomes(place, summary))


def _outcomes(place: Place, summary: Summary) -> Iterator[junit.LogOutcome]:
    for row in (*summary.logs, *summary.combined):
        if row.outcome is None:
            yield junit.LogOutcome(row.name, error="not tried, after --fail-fast", kind="not tried")
        elif "result.json" in row.outcome.files:
            content = place.read(f"{RESULTS}/{row.name}/result.json")
            unmet = row.outcome.message if row.outcome.exit_code == exits.NOT_CONVERGED else None
            allowed = row.outcome.exit_code != exits.CONTRADICTED
            yield junit.LogOutcome(row.name, Result.model_validate_json(content), unmet=unmet, allow_contradicted=allowed)
        elif CHECKED in row.outcome.files:
            check = Check.model_validate_json(place.read(f"{RESULTS}/{row.name}/{CHECKED}"))
            yield junit.LogOutcome(row.name, suite=checked.suite(check, row.name))
        else:
            kind = "internal error" if row.outcome.exit_code == exits.BUG else "unusable input"
            yield junit.LogOutcome(row.name, error=row.outcome.message, kind=kind)
    if summary.baseline is not None and summary.baseline.beyond:
        for number, item in enumerate(summary.baseline.beyond, 1):
            yield junit.LogOutcome(f"baseline {number}", error=item.message, kind="beyond the baseline")
