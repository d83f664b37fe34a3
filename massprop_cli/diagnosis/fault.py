"""Result of a diagnosis: named faults, or what was tried without success."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from massprop_cli.base.dataclass import dataclass
from massprop_cli.diagnosis.delay import FoundTiming
from massprop_cli.inputs.notice import Notice

if TYPE_CHECKING:
    from massprop_cli.diagnosis.corrections import Correction


@dataclass(frozen=True)
class Fault:
    """A named error of the log or the vehicle file."""

    notice: Notice
    cure: Correction | None
    """Correction; None if neither keys of the vehicle file nor factors on columns correct it."""
    change_s: float | None = None
    """Time of a change of the mass properties, s; None without one."""
    around: tuple[Correction, ...] = ()
    """The correction with each unknown one sigma further, and with skewed gyro axes where these cannot be ruled out."""
    rivals: tuple[Correction, ...] = ()
    """Corrections of causes that cannot be ruled out."""


@dataclass(frozen=True)
class Diagnosis:
    """Faults of a log, all present together."""

    faults: tuple[Fault, ...] = ()
    detected: FoundTiming | None = None
    """Command delay estimated from the log, if the delay is the cause."""
    unknown: str = ""
    """If log and vehicle file do not fit and no cause was found: what was tried."""
    score: float = -np.inf
    """−2 log likelihood of the named causes plus the penalty for their unknowns."""
