"""history.parquet: every estimate and what it was made of, cycle by cycle."""

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
"""Rows of history.parquet that are written at once."""
SIGNALS = {"torque": "n_m", "force": "n", "rate": "rad_s", "acceleration": "m_s2"}
"""What the vehicle was told and felt: kinds of columns of history.parquet, with their units."""
PREDICTED = {"rate": "rad_s", "specific_force": "m_s2"}
"""What was measured and predicted."""
PIVOT = "pivot_"
"""Before what is about a fixed pivot."""
EXECUTED = "executed_"
"""Before a jet's name: seconds at full thrust that it executed in a cycle."""


def write_history(analysis: Analysis, path: Path | BinaryIO) -> None:
    """history.parquet: a row per cycle and phase, body axes; null where nothing can be said, and of an axis that the log lacks.

    Estimates and innovations; executed torque about O and force, rate, acceleration of O (or the bearing), specific force; what the final
    values predict, with the sigma of measured less predicted; whitened innovations; what each jet executed.
    """
    schema = pa.schema([("phase", pa.string()), *((name, pa.float64()) for name in _columns(analysis))])
    # numbers hardly repeat: a dictionary of them would take more room than they do, and as long to make
    with pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=["phase"]) as writer:
        for history, settled in zip(analysis.histories, analysis.settled, strict=True):
            for first in range(0, len(history.time_s), ROWS):
                rows = _rows(analysis, history, settled, slice(first, min(first + ROWS, len(history.time_s))))
                columns = [arrow.text([history.phase.name] * len(rows)), *(arrow.numbers(column) for column in rows.T)]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def content(analysis: Analysis) -> bytes:
    """The bytes that :func:`write_history` writes."""
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
    """(K, columns) of part of a phase."""
    samples = analysis.samples.part(slice(history.cycles.start + part.start, history.cycles.start + part.stop))
    wrench = samples.executed.whole / samples.executed.duration_s[:, None]
    measured = np.where(samples.unread, np.nan, np.hstack([samples.rate_rad_s, samples.specific_force_m_s2]))
    moved = np.where(samples.unread[3:], np.nan, acceleration(samples, analysis.vehicle))
    whitened = np.where(samples.unread, np.nan, settled.normalised[part])
    left, sigma = np.full((2, *measured.shape), np.nan)
    if settled.residual is not None:
        left, sigma = (values[part] for values in settled.residual)
    executed = samples.executed.channels.whole[:, : len(_jets(analysis))]  # of wheels and rotors there is no on-time
    values, sigmas, pivot = _estimates(analysis, history, part)
    return np.hstack(
        [
            *(history.time_s[part, None], values, sigmas, history.innovation[part], history.innovation_sigma[part]),
            *(wrench, measured[:, :3], moved),
            *(measured[:, 3:], measured - left, sigma, whitened, executed, pivot),
        ]
    )


def _estimates(analysis: Analysis, history: History, part: slice) -> tuple[Array, Array, Array]:
    """(K, 10) the ten quantities and (K, 10) their sigmas, and (K, 18 or 0) both about a fixed pivot: with no mass that is all there is."""
    values, sigmas = history.values[part], history.sigmas[part]
    if history.pivot is None:
        return values, sigmas, np.zeros((len(values), 0))
    if "mass" not in analysis.vehicle.in_phase(history.phase).known:
        values, sigmas = np.full((2, *values.shape), np.nan)
    return values, sigmas, history.pivot[part]
