"""Low-passes that a log shows stand wherever its delay does."""

import csv
import io

import pytest
from rich.console import Console

from massprop_cli.check import table
from massprop_cli.check.finding import Check
from massprop_cli.report import html, markdown, spreadsheet, terminal, timing
from tests import recorded
from tests.report.page import Page

GYRO = {"sensor": "gyro", "cutoff_hz": 38.04, "cutoff_sigma_hz": 2.1, "latency_s": None, "latency_sigma_s": None}
ACCELEROMETER = {"sensor": "accelerometer", "cutoff_hz": 41.0, "cutoff_sigma_hz": 0.5, "latency_s": 4.06e-3, "latency_sigma_s": 3e-4}
SAID = [
    "the gyro has a low-pass cutoff of 38.0 ± 2.1 Hz",
    "the accelerometer has a low-pass cutoff of 41.00 ± 0.50 Hz, 4.06 ± 0.30 ms late",
]
FOUND = recorded.result(
    low_passes=[GYRO, ACCELEROMETER],
    delay={"cycles": 2.0312, "source": "detected", "detected_cycles": 2.0312, "sigma_cycles": 0.004},
    lag={"lag_s": 0.0213, "source": "detected", "sigma_s": 0.0011},
)
TIMED = ["commands execute 2.031 ± 0.004 cycles after the start of their cycle", "thrust lags by 0.0213 ± 0.0011 s"]


def printed(show: object) -> str:
    out = io.StringIO()
    show(Console(file=out, width=400, no_color=True, highlight=False))  # type: ignore[operator]
    return out.getvalue()


def test_values_have_their_sigmas_and_a_reading_that_is_early_is_called_so() -> None:
    assert timing.low_passes(FOUND) == SAID
    early = recorded.result(low_passes=[ACCELEROMETER | {"cutoff_hz": None, "cutoff_sigma_hz": None, "latency_s": -1e-3}])
    assert timing.low_passes(early) == ["the accelerometer is 1.00 ± 0.30 ms early"]


@pytest.mark.usefixtures("blank_figures")
def test_a_report_has_them_beside_the_delay() -> None:
    said = Page(html.page([recorded.recorded(FOUND)])).said()
    assert "has a low-pass cutoff of 41.00 ± 0.50 Hz, 4.06 ± 0.30 ms late" in said
    assert f"{SAID[0]} (detected), {SAID[1]} (detected), massprop" in markdown.text([recorded.recorded(FOUND)])
    (row,) = csv.DictReader(io.StringIO(spreadsheet.text([recorded.recorded(FOUND)]), newline=""), strict=True)
    assert (float(row["gyro_cutoff_hz"]), float(row["gyro_cutoff_sigma_hz"]), row["gyro_latency_s"]) == (38.04, 2.1, "")
    assert (float(row["accelerometer_latency_s"]), float(row["accelerometer_latency_sigma_s"])) == (4.06e-3, 3e-4)


def test_the_terminal_says_what_was_left_to_the_log() -> None:
    assert f"\nEstimated from the log: {'; '.join(TIMED + SAID)}.\n" in printed(lambda out: terminal.show(FOUND, out))
    assert "Estimated from the log" not in printed(lambda out: terminal.show(recorded.result(), out))


def test_a_check_says_what_the_log_shows() -> None:
    told = Check(
        schema="massprop/check/1", massprop="0.1.0", log="log.csv", input_sha256="a" * 64, vehicle="tug", rows=9, usable=True, fit=True,
        findings=[], expected=[], delay=timing.detected_delay(FOUND.delay), low_passes=timing.low_passes(FOUND), exit_code=0,
    )  # fmt: skip
    assert f"Low-passes that the log shows: {'; '.join(SAID)}.\n" in printed(lambda out: table.show(told, out))
