"""Delay, lag and low-passes in words: the values used and those estimated from the log."""

from massprop_cli.report import digits
from massprop_cli.result.schema import Delay, DetectedLowPass, Lag, Result

SOURCES = {
    "vehicle": "stated by the vehicle file",
    "option": "stated by an option",
    "detected": "detected from the log",
    "default": "default, not stated",
}


def delay(found: Delay) -> list[tuple[str, str]]:
    """The delay used, the estimated delay, and their difference, as rows of a table."""
    rows = [("used", f"{found.cycles:.6g} cycles, {SOURCES[found.source]}")]
    if found.detected_cycles is None:
        return [*rows, ("detected in the log", "not estimated, or not observable")]
    spread = "" if found.sigma_cycles is None else f" ± {found.sigma_cycles:.2g}"
    rows.append(("detected in the log", f"{found.detected_cycles:.6g}{spread} cycles"))
    if found.source != "detected" and found.sigma_cycles:
        sigmas = (found.detected_cycles - found.cycles) / found.sigma_cycles
        rows.append(("detected less used", f"{found.detected_cycles - found.cycles:+.2g} cycles, {sigmas:+.1f} sigma".replace("-", "−")))
    return rows


def lag(found: Lag) -> tuple[str, str]:
    """The lag used, as a row of a table."""
    spread = "" if found.sigma_s is None else f" ± {found.sigma_s:.2g}"
    return "lag of the thrust", f"{found.lag_s:.6g}{spread} s, {SOURCES[found.source]}"


def rows(found: Result) -> list[tuple[str, str]]:
    """Delay, lag and low-passes as rows of a table."""
    return [*delay(found.delay), lag(found.lag), *((one.sensor, _low_pass(one)) for one in found.low_passes)]


def low_passes(found: Result) -> list[str]:
    """A phrase for each sensor with an estimated cutoff or latency."""
    return [f"the {one.sensor} {_low_pass(one)}" for one in found.low_passes]


def detected_delay(found: Delay) -> str:
    """The estimated delay in words; empty without one."""
    if found.detected_cycles is None or found.sigma_cycles is None:
        return ""
    shown = f"commands execute {found.detected_cycles:.4g} ± {found.sigma_cycles:.2g} cycles after the start of their cycle"
    return shown if found.source == "detected" else f"{shown} (used: {found.cycles:g})"


def automatic(found: Result) -> list[str]:
    """The timing that massprop estimated because the vehicle file does not state it, in words."""
    delay_text = detected_delay(found.delay) if found.delay.source == "detected" else ""
    lag_text = f"thrust lags by {digits.with_sigma(found.lag.lag_s, found.lag.sigma_s)} s"
    has_lag = found.lag.source == "detected" and bool(found.lag.sigma_s)
    return [*filter(None, (delay_text, lag_text * has_lag)), *low_passes(found)]


def _low_pass(found: DetectedLowPass) -> str:
    """Cutoff and latency of a sensor, in words."""
    phrases = []
    if found.cutoff_hz is not None and found.cutoff_sigma_hz is not None:
        phrases.append(f"has a low-pass cutoff of {digits.with_sigma(found.cutoff_hz, found.cutoff_sigma_hz)} Hz")
    if found.latency_s is not None and found.latency_sigma_s is not None:
        late = digits.with_sigma(1e3 * abs(found.latency_s), 1e3 * found.latency_sigma_s)
        phrases.append(f"{'' if phrases else 'is '}{late} ms {'early' if found.latency_s < 0 else 'late'}")
    return ", ".join(phrases)
