"""Low-pass presets of common IMUs, from their data sheets (imufilters.toml, with sources).

A data sheet gives a bandwidth f and often a delay, but not the filter. massprop takes the order with the delay nearer to the stated one:
1 / (2π f) for the first, √2 / (2π f) for the second. The remaining delay is latency. A negative latency is set to 0 and added to its
sigma. Data sheets give no tolerances, so sigmas are assumed.

A moving mean over N values at spacing T has the delay (N − 1) T / 2, and its impulse response has the variance (N² − 1) T² / 12. Delays
and variances of filters in series add up. massprop models them as a first-order lag τ, τ² the variance, plus latency.
"""

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from massprop_cli.base.configfile import nearest

BANDWIDTH = 0.1
"""Assumed relative sigma of a stated bandwidth."""
DELAY_S = 5e-4
"""Assumed sigma of a stated delay, s."""
UNSTATED, UNSTATED_S = 0.25, 1e-3
"""Assumed sigmas of the latency if no delay is stated: as a fraction of the filter's delay, and in s; they add in quadrature."""


@cache
def table() -> dict[str, dict[str, Any]]:
    """Presets by name."""
    presets: dict[str, dict[str, Any]] = tomllib.loads(resources.files(__package__).joinpath("imufilters.toml").read_text(encoding="utf-8"))
    return presets


def resolved(sensor: str, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of the low-pass of ``sensor``: of its ``preset``, overridden by ``stated`` ones. Raises ValueError for an unknown preset."""
    name = stated["preset"]
    known = [preset for preset, sensors in table().items() if sensor in sensors]
    if name not in known:
        raise ValueError(f"preset {name!r} is none of this sensor{nearest(str(name), known, 'the nearest is')}")
    return {**_keys(**table()[name][sensor]), **stated}


def _keys(bandwidth_hz: float = 0.0, delay_ms: float | None = None, taps: Sequence[int] = (), rate_hz: float = 1.0) -> dict[str, Any]:
    if taps:  # moving means in series, with their numbers of values
        count = np.array(taps)
        lag_s, late_s = float(np.sqrt((count**2 - 1).sum() / 12)) / rate_hz, float((count - 1).sum()) / 2 / rate_hz
        cutoff_hz = 1 / (2 * np.pi * lag_s)
        latency = {"latency_s": late_s - lag_s, "latency_sigma_s": DELAY_S}
        return {"order": 1, "cutoff_hz": cutoff_hz, "cutoff_sigma_hz": BANDWIDTH * cutoff_hz, **latency}
    lag_s = 1 / (2 * np.pi * bandwidth_hz)
    cutoff = {"cutoff_hz": float(bandwidth_hz), "cutoff_sigma_hz": BANDWIDTH * bandwidth_hz}
    second_s = float(np.sqrt(2) * lag_s)
    if delay_ms is None:
        return cutoff | {"order": 2, "latency_s": 0.0, "latency_sigma_s": float(np.hypot(UNSTATED_S, UNSTATED * second_s))}
    order, latency_s = min(((2, 1e-3 * delay_ms - second_s), (1, 1e-3 * delay_ms - lag_s)), key=lambda one: abs(one[1]))
    return cutoff | {"order": order, "latency_s": max(latency_s, 0.0), "latency_sigma_s": float(np.hypot(DELAY_S, min(latency_s, 0.0)))}
