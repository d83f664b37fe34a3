"""What a change of something that is taken for granted does to the measurements, and so to the estimate.

The filter is linear in what it is fed, so beside its mean it can carry what one unit of an assumption's change would have done to that
mean (one more column of the same recursion): the shift of the estimate for a delay a cycle longer, an IMU a metre further on. An
assumption that is uncertain by sigma then adds sigma² times the outer product of its shift to the covariance (a *consider* parameter:
S. F. Schmidt 1966), without being estimated from the log a second time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.errors import InputError
from massprop_cli.linearise import PARAMETERS, RATE, Linear, linearise, parameters
from massprop_cli.plant import Reference
from massprop_cli.telemetry import Log
from massprop_cli.timing import Timing
from massprop_cli.vehicle import Vehicle

STEP = 0.02
"""Cycles; half the difference behind the derivative with respect to delay and lag."""


@dataclass(frozen=True)
class Side:
    """The log as it would have been read under another assumption."""

    samples: Samples
    vehicle: Vehicle | None = None
    """None: the filter's own, so that only the samples differ."""


@dataclass(frozen=True)
class Variant:
    """An assumption changed to both sides; its derivative is the difference of the sides over their distance."""

    low: Side
    high: Side
    distance: float


@dataclass(frozen=True)
class Consider:
    """Assumptions that are uncertain, and their covariance (e, e)."""

    variants: tuple[Variant, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))


def fed(
    system: Linear, samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle, variants: Sequence[Variant]
) -> tuple[Array, Array]:
    """(K − 1, n, 1 + e) drive and (K, 6, 1 + e) measurements: the log's own, then their derivatives by each variant.

    The derivatives are taken at the reference and the measured rates.
    """
    state = np.zeros((len(system.measured), system.drive.shape[1]))
    state[:, PARAMETERS] = parameters(reference)
    state[:, RATE] = samples.rate_rad_s[cycles] - reference.gyro_bias
    drives, measurements = [system.drive], [system.measured]
    read: dict[int, Linear] = {}  # sides that several variants have in common are linearised once
    for variant in variants:
        for side in (variant.low, variant.high):
            read[id(side)] = read.get(id(side)) or linearise(side.samples, cycles, reference, side.vehicle or vehicle)
        sides = [read[id(variant.low)], read[id(variant.high)]]
        expected = [np.einsum("kij,kj->ki", side.transition, state[:-1]) + side.drive for side in sides]
        drives.append((expected[1] - expected[0]) / variant.distance)
        left = [side.measured - np.einsum("kij,kj->ki", side.observation, state) for side in sides]
        measurements.append((left[1] - left[0]) / variant.distance)
    return np.stack(drives, -1), np.stack(measurements, -1)


def late(log: Log, vehicle: Vehicle, timing: Timing, name: str) -> Variant | None:
    """Delay or lag (``name``) changed, per control cycle; None where the log is too short for it."""
    low, high = timing.moved([name], [-STEP]), timing.moved([name], [STEP])
    try:
        sides = [Side(side.of(log, vehicle)) for side in (low, high)]
    except InputError:
        return None
    return Variant(sides[0], sides[1], sum(high) - sum(low))
