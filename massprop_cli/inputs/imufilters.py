"""Low-passes of common IMUs by name, from what their data sheets state (imufilters.toml, with the source of each).

A data sheet gives a bandwidth and often a delay, and not the filter. The order is the one whose own delay is nearer to the stated one:
1 / (2π f) of the first, √2 / (2π f) of the second. The rest is latency; where it would be negative it is 0, and its sigma includes the
difference. Data sheets give no tolerances, so sigmas are assumed.

A mean over N values that are T apart is late by (N − 1) T / 2, and its delay has the variance (N² − 1) T² / 12; those of several one after
the other add up. A first-order lag τ with a latency has both: τ² is the variance, and the latency is the rest.
"""

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from massprop_cli.base.configfile import nearest

BANDWIDTH = 0.1
"""Part of a stated bandwidth: one sigma of it."""
DELAY_S = 5e-4
"""s: one sigma of a stated delay."""
UNSTATED, UNSTATED_S = 0.25, 1e-3
"""Part of the filter's own delay, and s: one sigma of the latency where no delay is stated."""


@cache
def table() -> dict[str, dict[str, Any]]:
    """The data sheets' settings by name."""
    found: dict[str, dict[str, Any]] = tomllib.loads(resources.files(__package__).joinpath("imufilters.toml").read_text(encoding="utf-8"))
    return found


def resolved(sensor: str, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of a sensor's low-pass (``gyro``, ``accel``): its ``preset``'s, and over them the ``stated``. ValueError for no such preset."""
    name = stated["preset"]
    known = [one for one, own in table().items() if sensor in own]
    if name not in known:
        raise ValueError(f"preset {name!r} is none of this sensor{nearest(str(name), known, 'the nearest is')}")
    return {**_keys(**table()[name][sensor]), **stated}


def _keys(bandwidth_hz: float = 0.0, delay_ms: float | None = None, taps: Sequence[int] = (), rate_hz: float = 1.0) -> dict[str, Any]:
    if taps:  # means over so many values, one after the other
        count = np.array(taps)
        lag_s, late_s = float(np.sqrt((count**2 - 1).sum() / 12)) / rate_hz, float((count - 1).sum()) / 2 / rate_hz
        cutoff_hz = 1 / (2 * np.pi * lag_s)
        latency = {"latency_s": late_s - lag_s, "latency_sigma_s": DELAY_S}
        return {"order": 1, "cutoff_hz": cutoff_hz, "cutoff_sigma_hz": BANDWIDTH * cutoff_hz, **latency}
    lag_s = 1 / (2 * np.pi * bandwidth_hz)
    found = {"cutoff_hz": float(bandwidth_hz), "cutoff_sigma_hz": BANDWIDTH * bandwidth_hz}
    second_s = float(np.sqrt(2) * lag_s)
    if delay_ms is None:
        return found | {"order": 2, "latency_s": 0.0, "latency_sigma_s": float(np.hypot(UNSTATED_S, UNSTATED * second_s))}
    order, left_s = min(((2, 1e-3 * delay_ms - second_s), (1, 1e-3 * delay_ms - lag_s)), key=lambda one: abs(one[1]))
    return found | {"order": order, "latency_s": max(left_s, 0.0), "latency_sigma_s": float(np.hypot(DELAY_S, min(left_s, 0.0)))}
