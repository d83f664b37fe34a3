"""Time of the records: duplicates, steps back, gaps, jitter. All that there are, where reading a log stops at the first."""

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.check.finding import Finding, finding, rows
from massprop_cli.inputs.formats.clocks import outlying
from massprop_cli.inputs.logtable import GAP, LONG
from massprop_cli.inputs.tablefile import Place
from massprop_cli.inputs.telemetry import JITTER, jitter


def sampling(time_s: Array, place: Place) -> list[Finding]:
    """Findings of the time column; ``place`` names a row."""
    bad = ~np.isfinite(time_s)
    if len(time_s) < 2 or bad.any() or outlying(time_s)[0].any():
        return []  # reading the log says so
    steps = np.concatenate([[np.nan], np.diff(time_s)])
    forward = steps[1:][steps[1:] > 0]
    if not len(forward):
        return []
    usual = median(forward)
    found = []
    for code, which, what, remedy in (
        ("duplicate-time", steps == 0, "records with the time of the one before", "drop the copies, or let the recorder write finer times"),
        ("time-back", steps < 0, "steps of the clock back", "sort the log, or cut it where the clock was set"),
        ("gap", steps > GAP * usual, f"gaps of more than {GAP:g} usual intervals", "split the log there, a file each"),
    ):
        if which.any():
            worst = float(np.max(np.abs(steps[which])))
            size = "" if code == "duplicate-time" else f", the largest of {worst:.6g} s"
            said = f"{what}: {int(which.sum())} (usual interval {usual:.6g} s{size})"
            found.append(finding("sampling", code, "unusable", said, remedy, rows(which, place)))
    if found:
        return found
    scatter = jitter(steps[1:])
    if scatter > JITTER:
        off = np.abs(steps - usual) > 3 * scatter * usual
        remedy = "stamp records by the IMU's own clock, not at arrival, or state even = true under their clock in a map file"
        said = f"intervals scatter by {100 * scatter:.2g} % of {usual:.6g} s"
        found.append(finding("sampling", "jitter", "fault", said, remedy, rows(off, place)))
    short = steps < usual / LONG
    if short.any() and scatter <= JITTER:
        said = f"{int(short.sum())} intervals shorter than {1 / LONG:.2g} of the usual {usual:.6g} s"
        remedy = "see that the recorder dropped and made up nothing"
        found.append(finding("sampling", "short-interval", "note", said, remedy, rows(short, place)))
    return found
