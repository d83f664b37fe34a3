"""A log as it would have been read with other ``[columns]`` of its vehicle file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Column


def reread(log: Log, before: Mapping[str, Column], after: Mapping[str, Column]) -> Log:
    """The log, read with the columns ``before``, as those ``after`` give it.

    :class:`InputError` where the two differ in anything but the source and scale of the IMU's and the commanded wrench's columns.
    """
    turns = {names: _turn(names, before, after) for names in (log.rate_columns, log.force_columns, WRENCH)}
    others = {name for name in {**before, **after} if not any(name in names for names in turns)}
    changed = sorted(name for name in others if _column(before, name) != _column(after, name))
    if changed:
        raise InputError(f"columns.{changed[0]}: only columns of the IMU and of a commanded wrench can be uncertain; leave it out")

    def turned(values: Array, names: Sequence[str]) -> Array:
        turn = turns[tuple(names)]
        return values if (turn == np.eye(len(names))).all() else values @ turn.T

    return replace(
        log,
        delta_theta_imu_rad=turned(log.delta_theta_imu_rad, log.rate_columns),
        delta_v_imu_m_s=turned(log.delta_v_imu_m_s, log.force_columns),
        command=turned(log.command, WRENCH) if log.command_kind == "wrench" else log.command,
    )


def _column(columns: Mapping[str, Column], name: str) -> Column:
    return columns.get(name) or Column.model_validate({"from": name})


def _turn(names: Sequence[str], before: Mapping[str, Column], after: Mapping[str, Column]) -> Array:
    """(n, n) from what was read of these columns to what is read."""
    old, new = ([_column(columns, name) for name in names] for columns in (before, after))
    turn = np.array([[to.scale / was.scale * (to.from_ == was.from_) for was in old] for to in new])
    lost = next((name for name, row in zip(names, turn, strict=True) if not row.any()), None)
    if lost is not None:
        raise InputError(f"columns.{lost}: a column that the log was not read from can't be uncertain; name one of the same sensor")
    return turn
