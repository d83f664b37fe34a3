"""Faults that a diagnosis names, and what it says where it names none."""

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
    """Something with a name that is wrong with the log or the vehicle file."""

    notice: Notice
    cure: Correction | None
    """None where neither the vehicle file's keys nor factors on the log's columns correct it."""
    change_s: float | None = None
    """When the mass properties changed, if they did."""
    around: tuple[Correction, ...] = ()
    """The remedy with each of its unknowns one sigma further on, and with the gyro's axes out of square where they may be."""
    rivals: tuple[Correction, ...] = ()
    """Of causes that can't be ruled out."""


@dataclass(frozen=True)
class Diagnosis:
    """What was found: several faults are there together."""

    faults: tuple[Fault, ...] = ()
    detected: FoundTiming | None = None
    """What the log says of the command delay, if that is the cause."""
    unknown: str = ""
    """Where log and vehicle file don't fit and nothing explains it: what was tried."""
    score: float = -np.inf
    """Of what is named: −2 log likelihood, with its price."""
