"""history.parquet: every estimate and what it was made of, cycle by cycle."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base import arrow
from massprop_cli.flow import Analysis
from massprop_cli.prepare.compensate import acceleration
from massprop_cli.result.schema import AXES

ROWS = 8192
"""Rows of history.parquet that are written at once."""
SIGNALS = {"torque": "n_m", "force": "n", "rate": "rad_s", "acceleration": "m_s2"}
"""What the vehicle was told and felt: kinds of columns of history.parquet, with their units."""


def write_history(analysis: Analysis, path: Path | BinaryIO) -> None:
    """history.parquet: one row per cycle and phase, null where nothing can be said.

    Beside the estimates stand the executed mean torque about O and force, the mean rate, and the acceleration of O (of the bearing, on
    one) with lever arm and gravity taken out, all in body axes.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    innovations = [f"innovation_{kind}_{axis}" for kind in ("torque", "force") for axis in AXES]
    signals = [f"{kind}_{axis}_{unit}" for kind, unit in SIGNALS.items() for axis in AXES]
    names = ("time_s", *QUANTITIES, *(f"{name}_sigma" for name in QUANTITIES), *innovations, *(f"{name}_sigma" for name in innovations))
    schema = pa.schema([("phase", pa.string()), *((name, pa.float64()) for name in (*names, *signals))])
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for history in analysis.histories:
            for first in range(0, len(history.time_s), ROWS):
                part = slice(first, min(first + ROWS, len(history.time_s)))
                samples = analysis.samples.part(slice(history.cycles.start + part.start, history.cycles.start + part.stop))
                wrench = samples.executed.impulse / samples.executed.duration_s[:, None]
                felt = wrench, samples.rate_rad_s, acceleration(samples, analysis.vehicle)
                told = history.values, history.sigmas, history.innovation, history.innovation_sigma
                rows = np.hstack([history.time_s[part, None], *(values[part] for values in told), *felt])
                columns = [arrow.text([history.phase.name] * len(rows)), *(arrow.numbers(column) for column in rows.T)]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))
