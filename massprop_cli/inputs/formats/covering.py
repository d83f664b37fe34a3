"""Increments beside a stream of the time that each covers (PX4: ``delta_angle[0]``, ``delta_angle_dt``): whether any are left out."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import RecordedStream

_LENGTH = re.compile(r"[_.]?(integral_?)?dt(_(s|ms|us|ns))?(\s*[\[(].*)?", re.IGNORECASE)
_NEAR = 0.05
"""Part by which what increments cover may differ from their stamps' intervals: that much clocks drift and scatter, and the least that a
logger leaves out is every twentieth."""


def lengths(streams: Mapping[str, RecordedStream], paths: Sequence[str]) -> RecordedStream | None:
    """The stream that says how long each increment of these covers; None where none is called so."""
    same = [len(set(letters)) == 1 for letters in zip(*paths, strict=False)]
    stem = paths[0][: [*same, False].index(False)].rstrip("_.[( ")
    rows = streams[paths[0]].rows
    called = [one for path, one in streams.items() if path.startswith(stem) and _LENGTH.fullmatch(path, len(stem))]
    return next((one for one in called if stem and one.rows == rows), None)


def usual(length: RecordedStream) -> float:
    """What an increment covers, as recorded."""
    values = np.asarray(length.values, np.float64)
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else np.nan


def whole(length: RecordedStream, step_s: Sequence[float]) -> bool:
    """Whether increments cover their interval, for any of these; their lengths' unit is seldom recorded, and any is taken."""
    recorded = units.factor(length.unit, units.TIME)
    factors = [recorded] if recorded is not None else list(units.TIME.values())
    return any(abs(usual(length) * factor / step - 1) < _NEAR for factor in factors for step in step_s if step > 0)
