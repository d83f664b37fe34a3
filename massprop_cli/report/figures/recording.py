"""The columns of history.parquet that figures need."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError, UsageError
from massprop_cli.report.figures import axis
from massprop_cli.report.figures.panel import Axes
from massprop_cli.report.figures.series import AxisRange, parts_of, thinning_note
from massprop_cli.result.historyfile import SIGNALS
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import AXES, PhaseItem

Columns = dict[str, Array]
Covered = tuple[int, PhaseItem, Columns]
"""Number of a phase from 1, the phase, and its columns."""
_INNOVATIONS = [f"innovation_{kind}_{letter}" for kind in ("torque", "force") for letter in AXES]
COLUMNS = (
    *(f"{name}{part}" for name in (*QUANTITIES, *_INNOVATIONS) for part in ("", "_sigma")),
    *(f"{kind}_{letter}_{unit}" for kind, unit in SIGNALS.items() for letter in AXES),
)
"""Columns of history.parquet that most figures need."""


def covered(recorded: Recorded, needed: Sequence[str] = COLUMNS) -> list[Covered]:
    """Every phase with rows in the history; raise :class:`InputError` without history or without a needed column."""
    phases = recorded.result.phases
    numbered = [(number, phase, recorded.history.get(phase.name, {})) for number, phase in enumerate(phases, 1)]
    found = [part for part in numbered if len(part[2].get("time_s", ()))]
    if not found:
        if recorded.joint:
            raise InputError(
                f"{recorded.path}: combines several logs and has no history; draw figures against time from the results of each log"
            )
        missing = recorded.path.with_name("history.parquet")
        raise InputError(f"{missing}: missing; figures against time need it. Make the result again with massprop estimate")
    for _, phase, columns in found:
        absent = [name for name in needed if name not in columns]
        if absent:
            raise InputError(f"{recorded.path.with_name('history.parquet')}: phase {phase.name} lacks {absent[0]}; make the result again")
    return found


def sensed(parts: Sequence[Covered], kind: str) -> list[str]:
    """The body axes for which the log has a signal, such as "rate"; empty without its sensor."""
    unit = {"specific_force": "m_s2", **SIGNALS}[kind]
    return [letter for letter in AXES if any(np.isfinite(columns[f"{kind}_{letter}_{unit}"]).any() for *_, columns in parts)]


def only(recorded: Recorded, phase: str) -> Recorded:
    """The result with one phase; raise :class:`UsageError` if it has no such phase."""
    found = [item for item in recorded.result.phases if item.name == phase]
    if not found:
        known = ", ".join(item.name for item in recorded.result.phases)
        raise UsageError(f"no phase {phase!r} in {recorded.path}; there are {known}")
    return replace(recorded, result=recorded.result.model_copy(update={"phases": found, "docked_object": None}))


def thinned(parts: Sequence[Covered], each: int = 1) -> str:
    """Sentence of a caption on the reduction, for 1/``each`` of the usual number of intervals."""
    return thinning_note([len(columns["time_s"]) for *_, columns in parts], parts_of(len(parts)) // each)


def over_time(axes: Axes, parts: list[Covered], limits: AxisRange, heading: str, unit: str, power: int | None = None) -> None:
    """Set both axes of a panel over all phases, and mark the phases."""
    axis.time(axes, *extent(parts))
    axis.values(axes, limits, heading, unit, power)
    axis.phases(axes, [phase for _, phase, _ in parts])


def extent(parts: list[Covered]) -> tuple[float, float]:
    """First and last time of all phases, s."""
    start = min(axis.beginning(phase, columns["time_s"]) for _, phase, columns in parts)
    return start, max(float(columns["time_s"][-1]) for *_, columns in parts)
