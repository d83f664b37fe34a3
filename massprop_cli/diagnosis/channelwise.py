"""Free response to each command channel, without assumptions on body, jets or IMU.

Growth of the mean rate and specific force are linear in columns that the log gives:

- the impulse of each channel, the stated wrench with other timing, and that wrench on a body that changes,
- rates, their products and a constant,
- on a bearing, the vertical.

Each column has six free coefficients, three for each sensor. Their square-root information is a triangle of constant size per sensor. A
hypothesis (:mod:`massprop_cli.diagnosis.coefficients`) states these coefficients, so testing it does not need the log again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import TINY, Array, IntArray, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import RESOLUTION
from massprop_cli.diagnosis.design import INTEGRATED, Case, Design
from massprop_cli.estimate.whitening import LEVELS, TORQUES, Disturbance, ReducedLeastSquares, reduced, whitened, whitened_fits

HALF_WAVES = 12
"""Half-waves over a segment in which the specific force may wander, if gyro noise is integrated to an attitude."""
LEVEL_FACTORS = tuple(10 ** (k / 4) for k in range(-4, 5) if k)
"""Factors on the level of a torque that was selected from levels a hundred times apart."""


@dataclass(frozen=True)
class FreeResponse:
    """Free response of a segment: p columns."""

    places: Mapping[str, slice]
    fired: IntArray
    level: Array
    """(3, 3) mean projector onto the horizontal plane, body axes."""
    signal: Array
    """(6,) root mean square of the measurements, over the axes of each sensor: rad/s, m/s²."""
    gyro: ReducedLeastSquares
    accelerometer: ReducedLeastSquares
    disturbances: tuple[Disturbance, ...]
    """Maximum likelihood disturbance; empty if the stated noise explains the rates."""
    clock_s: tuple[float, float]
    """Mean mid-cycle time since the start of the log, and length of the segment, s."""

    @cached_property
    def regressions(self) -> dict[tuple[object, ...], Array]:
        """(9, 3) each: cache of regressions for initial bodies (:mod:`massprop_cli.diagnosis.initialbody`)."""
        return {}

    @property
    def without_cache(self) -> FreeResponse:
        """The same with an empty cache, for channels that are exchanged."""
        return replace(self)

    @property
    def size(self) -> int:
        """Number of columns, p."""
        return int(self.gyro.triangle.shape[1])

    @property
    def dead_sensor(self) -> bool:
        """Whether a sensor reads 0 in every cycle."""
        return not self.signal.all()

    @property
    def command_significance(self) -> float:
        """Significance, in sigmas, with which rates and specific force follow the commands; infinite without commands.

        The squared coefficients of n pure-noise columns, over the pure error, have mean 1 ± √(2 / n).
        """
        channels = np.arange(self.size)[self.places["channels"]]
        if not len(channels):
            return np.inf
        order, squares = np.concatenate([np.setdiff1d(np.arange(self.size), channels), channels]), []
        for sensor in (self.gyro, self.accelerometer):
            triangle = triangle_of(np.hstack([sensor.triangle[:, order], sensor.measured]))
            coefficients = triangle[self.size - len(channels) : self.size, self.size :]
            squares += [coefficients**2 / np.maximum(sensor.left / sensor.spare, TINY)]
        ratios = np.concatenate(squares)
        return float((ratios.mean() - 1) / np.sqrt(2 / ratios.size))

    @property
    def pure_error(self) -> Array:
        """(6,) pure error: mean squared residual with free coefficients, (rad/s)² and (m/s²)²."""
        return np.concatenate([sensor.left / sensor.spare for sensor in (self.gyro, self.accelerometer)])

    @property
    def variance(self) -> Array:
        """(6,) pure error, at least that of the resolution."""
        return np.asarray(np.maximum(self.pure_error, (RESOLUTION * self.signal) ** 2))


def free_response(case: Case, piece: slice, likely: Sequence[Disturbance] = (), theta: Array | None = None) -> FreeResponse:
    """Free response of cycles ``piece``.

    If the stated noise does not explain the rates, they are whitened under the maximum likelihood disturbance, or the most likely of
    ``likely``. With ``theta`` (10,), the columns hold the intra-cycle motion of that body. Raise :class:`InputError` if there are too few
    cycles.
    """
    design = case.design(piece, theta)
    rates, disturbances = whitened(design.driven, case.vehicle.imu.gyro_noise_rad_s**2, likely)
    return _reduced(design, rates, disturbances)


def free_responses_by_torque(case: Case, piece: slice, theta: Array, near: Disturbance | None = None) -> list[FreeResponse]:
    """Free responses under each disturbance torque, white or random walk; with ``near``, under torques of levels near it."""
    if near is None:
        disturbances = TORQUES
    elif near.walk > 0:
        disturbances = [
            near._replace(walk=near.walk * by) for by in LEVEL_FACTORS if near.walk * by >= LEVELS[0]
        ]  # a lower level is a steady torque
    else:
        disturbances = [near._replace(white=near.white * by) for by in LEVEL_FACTORS]
    design = case.design(piece, theta)
    return [_reduced(design, each.fit, (each.disturbance,)) for each in whitened_fits(design.driven, disturbances)]


def _reduced(design: Design, rates: ReducedLeastSquares, disturbances: tuple[Disturbance, ...]) -> FreeResponse:
    count = len(design.mean)
    wander = cosines(count, HALF_WAVES if INTEGRATED in design.places else 0)
    weight = design.force_weight[design.used[:, 1], None]
    columns, force = (weight * part[design.used[:, 1]] for part in (np.hstack([wander, design.mean]), design.force))
    accelerometer = reduced(columns, force, wander.shape[1])._replace(volume=-6 * float(np.log(weight).sum()))
    signal = np.repeat([np.sqrt((part**2).mean()) for part in (design.rate, design.force)], 3)
    return FreeResponse(design.places, design.fired, design.level, signal, rates, accelerometer, disturbances, design.clock_s)


def cosines(count: int, most: int) -> Array:
    """(count, most) cosines with 1, 2, … half-waves."""
    return np.asarray(np.cos(np.pi * np.outer((np.arange(count) + 0.5) / count, np.arange(1, most + 1))))
