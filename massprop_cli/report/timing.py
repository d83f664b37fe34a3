"""Delay, lag and low-passes in words: what was used, and what the log shows of them."""

from massprop_cli.report import digits
from massprop_cli.result.schema import Delay, DetectedLowPass, Lag, Result

SOURCES = {
    "vehicle": "stated by the vehicle file",
    "option": "stated by an option",
    "detected": "detected from the log",
    "default": "default, not stated",
}


def delay(found: Delay) -> list[tuple[str, str]]:
    """The delay used, the delay that the log shows, and their difference."""
    rows = [("used", f"{found.cycles:.6g} cycles, {SOURCES[found.source]}")]
    if found.detected_cycles is None:
        return [*rows, ("detected in the log", "not estimated, or not observable")]
    spread = "" if found.sigma_cycles is None else f" ± {found.sigma_cycles:.2g}"
    rows.append(("detected in the log", f"{found.detected_cycles:.6g}{spread} cycles"))
    if found.source != "detected" and found.sigma_cycles:
        off = (found.detected_cycles - found.cycles) / found.sigma_cycles
        rows.append(("detected less used", f"{found.detected_cycles - found.cycles:+.2g} cycles, {off:+.1f} sigma".replace("-", "−")))
    return rows


def lag(found: Lag) -> tuple[str, str]:
    """The lag that was used."""
    spread = "" if found.sigma_s is None else f" ± {found.sigma_s:.2g}"
    return "lag of the thrust", f"{found.lag_s:.6g}{spread} s, {SOURCES[found.source]}"


def rows(found: Result) -> list[tuple[str, str]]:
    """Delay, lag and low-passes as rows of a table."""
    return [*delay(found.delay), lag(found.lag), *((one.sensor, _low_pass(one)) for one in found.low_passes)]


def low_passes(found: Result) -> list[str]:
    """A sentence on each sensor whose cutoff or latency the log shows."""
    return [f"the {one.sensor} {_low_pass(one)}" for one in found.low_passes]


def detected_delay(found: Delay) -> str:
    """The delay that the log shows, in words; empty where it shows none."""
    if found.detected_cycles is None or found.sigma_cycles is None:
        return ""
    shown = f"commands execute {found.detected_cycles:.4g} ± {found.sigma_cycles:.2g} cycles after the start of their cycle"
    return shown if found.source == "detected" else f"{shown} (used: {found.cycles:g})"


def automatic(found: Result) -> list[str]:
    """The timing that the vehicle file leaves to the log, as the log shows it."""
    late = detected_delay(found.delay) if found.delay.source == "detected" else ""
    lagging = f"thrust lags by {digits.with_sigma(found.lag.lag_s, found.lag.sigma_s)} s"
    told = found.lag.source == "detected" and bool(found.lag.sigma_s)
    return [*filter(None, (late, lagging * told)), *low_passes(found)]


def _low_pass(found: DetectedLowPass) -> str:
    said = []
    if found.cutoff_hz is not None and found.cutoff_sigma_hz is not None:
        said.append(f"has a low-pass cutoff of {digits.with_sigma(found.cutoff_hz, found.cutoff_sigma_hz)} Hz")
    if found.latency_s is not None and found.latency_sigma_s is not None:
        late = digits.with_sigma(1e3 * abs(found.latency_s), 1e3 * found.latency_sigma_s)
        said.append(f"{'' if said else 'is '}{late} ms {'early' if found.latency_s < 0 else 'late'}")
    return ", ".join(said)
