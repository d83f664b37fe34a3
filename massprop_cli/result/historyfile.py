"""history.parquet: estimates, measurements and innovations, one row per cycle."""

import io
from pathlib import Path
from typing import BinaryIO

import numpy as np

from massprop_cli import ABOUT_PIVOT, QUANTITIES
from massprop_cli.base import arrow
from massprop_cli.base.arrays import Array
from massprop_cli.base.lazy import pa, pq
from massprop_cli.estimate.history import History
from massprop_cli.flow import Analysis
from massprop_cli.prepare.compensate import acceleration
from massprop_cli.result.schema import AXES

ROWS = 4096
"""Rows of history.parquet written at once."""
SIGNALS = {"torque": "n_m", "force": "n", "rate": "rad_s", "acceleration": "m_s2"}
"""Columns of commands and motion, with units."""
PREDICTED = {"rate": "rad_s", "specific_force": "m_s2"}
"""Columns of predicted measurements, with units."""
PIVOT = "pivot_"
"""Prefix of quantities about a fixed pivot."""
EXECUTED = "executed_"
"""Prefix of a jet's executed on-time in a cycle, seconds at full thrust."""


def write_history(analysis: Analysis, path: Path | BinaryIO) -> None:
    """Write history.parquet: one row per cycle and phase, body axes; null without an estimate, and for an axis that the log lacks.

    Columns: estimates and innovations; executed torque about O and force, rate, acceleration of O (or the bearing), specific force;
    prediction by the final values and sigma of the residual; whitened innovations; executed on-time of each jet.
    """
    schema = pa.schema([("phase", pa.string()), *((name, pa.float64()) for name in _columns(analysis))])
    # the numbers hardly repeat, so dictionary encoding would make the file larger
    with pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=["phase"]) as writer:
        for history, settled in zip(analysis.histories, analysis.settled, strict=True):
            for first in range(0, len(history.time_s), ROWS):
                rows = _rows(analysis, history, settled, slice(first, min(first + ROWS, len(history.time_s))))
                columns = [arrow.text([history.phase.name] * len(rows)), *(arrow.numbers(column) for column in rows.T)]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def content(analysis: Analysis) -> bytes:
    """Bytes of history.parquet."""
    out = io.BytesIO()
    write_history(analysis, out)
    return out.getvalue()


def _jets(analysis: Analysis) -> list[str]:
    return [jet.name for jet in analysis.vehicle.jets] if analysis.log.command_kind == "jets" else []


def _columns(analysis: Analysis) -> list[str]:
    def axes(kind: str, *parts: str) -> list[str]:
        return ["_".join((kind, axis, *parts)) for axis in AXES]

    innovations = [name for kind in ("torque", "force") for name in axes(f"innovation_{kind}")]
    predicted = [name for parts in ((), ("sigma",)) for kind, unit in PREDICTED.items() for name in axes(f"predicted_{kind}", *parts, unit)]
    return [
        *("time_s", *QUANTITIES, *(f"{name}_sigma" for name in QUANTITIES), *innovations, *(f"{name}_sigma" for name in innovations)),
        *(name for kind, unit in SIGNALS.items() for name in axes(kind, unit)),
        *(*axes("specific_force", "m_s2"), *predicted, *(name for kind in PREDICTED for name in axes(f"whitened_{kind}"))),
        *(f"{EXECUTED}{jet}_s" for jet in _jets(analysis)),
        *(f"{PIVOT}{name}{part}" for part in ("", "_sigma") for name in ABOUT_PIVOT if analysis.vehicle.on_pedestal),
    ]


def _rows(analysis: Analysis, history: History, settled: History, part: slice) -> Array:
    """(K, columns) rows of a part of a phase."""
    samples = analysis.samples.part(slice(history.cycles.start + part.start, history.cycles.start + part.stop))
    wrench = samples.executed.whole / samples.executed.duration_s[:, None]
    measured = np.where(samples.unread, np.nan, np.hstack([samples.rate_rad_s, samples.specific_force_m_s2]))
    accelerations = np.where(samples.unread[3:], np.nan, acceleration(samples, analysis.vehicle))
    whitened = np.where(samples.unread, np.nan, settled.normalised[part])
    residual, sigma = np.full((2, *measured.shape), np.nan)
    if settled.residual is not None:
        residual, sigma = (values[part] for values in settled.residual)
    executed = samples.executed.channels.whole[:, : len(_jets(analysis))]  # wheels and rotors have no on-time
    values, sigmas, pivot = _estimates(analysis, history, part)
    return np.hstack(
        [
            *(history.time_s[part, None], values, sigmas, history.innovation[part], history.innovation_sigma[part]),
            *(wrench, measured[:, :3], accelerations),
            *(measured[:, 3:], measured - residual, sigma, whitened, executed, pivot),
        ]
    )


def _estimates(analysis: Analysis, history: History, part: slice) -> tuple[Array, Array, Array]:
    """(K, 10) ten quantities, (K, 10) their sigmas, (K, 18 or 0) both about a fixed pivot; the ten are NaN on a pedestal without a mass."""
    values, sigmas = history.values[part], history.sigmas[part]
    if history.pivot is None:
        return values, sigmas, np.zeros((len(values), 0))
    if "mass" not in analysis.vehicle.in_phase(history.phase).known:
        values, sigmas = np.full((2, *values.shape), np.nan)
    return values, sigmas, history.pivot[part]
