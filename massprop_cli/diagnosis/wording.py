"""Codes and sentences of hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.corrections import Case
from massprop_cli.errorparameters import table

ABSENT = "log and vehicle file don't fit; causes are looked for only in logs with all three axes of gyro and accelerometer"
DEAD = "the gyro or the accelerometer reads 0 in every cycle: it is not recorded, or dead"
UNANSWERED = (
    "log and vehicle file don't fit, cause unknown: the motion is no noise, and hardly follows the commands; are they this recording's, on "
    "its clock, and were they executed?"
)
LOGGED_AFTER = (
    "the motion follows commands that are logged {:g} control cycle(s) after they acted: no delay is below 0; log them as they are "
    "issued, or move their columns up by {} control cycle(s)"
)
IN_VEHICLE_FILE, IN_MAP = "under [columns]", "in the map (unit, scale, axes)"
"""Where the columns of a plain log are corrected, and those of a recording."""


def words_of(found: Fitted, names: Sequence[str], stated: Case, corrected: Case) -> tuple[str, str]:
    """(code, words) that go on "the log fits if …"."""
    code, words = table.words_of(found.hypothesis.code, found.finding(names, stated.setup, corrected.setup))
    return code, words if stated.log.made is None else words.replace(IN_VEHICLE_FILE, IN_MAP)


def alone(found: Fitted, name: str) -> Fitted:
    """Of a hypothesis about several channels, what it says of one."""
    return replace(found, hypothesis=replace(found.hypothesis, subject=(name,)))
