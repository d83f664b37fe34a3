"""Free response to each command channel, without assumptions on body, jets or IMU.

The growth of the mean rate and the specific force are linear in columns that the log alone gives: each channel's executed impulse, the
products of the measured rates, a constant, the rates themselves, the stated wrench as it would act later, smeared, with a drifting clock
or on a body that changes, and on a bearing the vertical. Each column has six free coefficients, three for the rate's growth and three for
the specific force. What the log says of them is a triangle of constant size for each kind of measurement. Every hypothesis about jets,
commands, IMU, timing or torques (:mod:`massprop_cli.diagnosis.coefficients`) only says what these coefficients are, so it is tested against
the triangles and the log is not gone through again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import TINY, Array, IntArray, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.diagnosis.design import INTEGRATED, Case, Design
from massprop_cli.estimate.whitening import LEVELS, TORQUES, Disturbance, ReducedLeastSquares, reduced, whitened, whitened_fits

SLOW = 12
"""Half-waves over a stretch in which the specific force may wander where gyro noise is integrated to an attitude."""
NEARER = tuple(10 ** (k / 4) for k in range(-4, 5) if k)
"""Times the level of a torque that was found among a few, a hundred times apart."""
RESOLUTION = 1e-4
"""Part of its signal below which a misfit is none: the motion within a cycle is taken as linear."""


@dataclass(frozen=True)
class Free:
    """All that a stretch of a log says."""

    places: Mapping[str, slice]
    fired: IntArray
    level: Array
    """(3, 3) mean projector on the level plane, body axes."""
    signal: Array
    """(6,) root mean square of what was measured, each sensor's axes alike: rad/s, m/s²."""
    gyro: ReducedLeastSquares
    accelerometer: ReducedLeastSquares
    beside: tuple[Disturbance, ...]
    """The most likely disturbance; none where the stated noise explains the rates."""
    clock_s: tuple[float, float]
    """From the log's beginning to the middle of the stretch, and how long that is."""

    @cached_property
    def regressed(self) -> dict[tuple[object, ...], Array]:
        """(9, 3) each: what plain regression has given of it so far, for fits to begin with (:mod:`massprop_cli.diagnosis.initialbody`)."""
        return {}

    @property
    def anew(self) -> Free:
        """The same that remembers no regression: of channels that are wired otherwise."""
        return replace(self)

    @property
    def size(self) -> int:
        """p, the number of columns."""
        return int(self.gyro.triangle.shape[1])

    @property
    def dead(self) -> bool:
        """Whether a sensor reads 0 in every cycle: neither motion nor noise."""
        return not self.signal.all()

    @property
    def answered(self) -> float:
        """Sigmas of chance by which rates and specific force follow the commands, in the mean, beside all that they follow otherwise.

        Infinite where nothing is commanded. Of coefficients that are noise the squares over the pure error are 1 in the mean, ± √(2 / their
        number).
        """
        own = np.arange(self.size)[self.places["channels"]]
        if not len(own):
            return np.inf
        order, squares = np.concatenate([np.setdiff1d(np.arange(self.size), own), own]), []
        for told in (self.gyro, self.accelerometer):
            triangle = triangle_of(np.hstack([told.triangle[:, order], told.measured]))
            told_of_them = triangle[self.size - len(own) : self.size, self.size :]
            squares += [told_of_them**2 / np.maximum(told.left / told.spare, TINY)]
        each = np.concatenate(squares)
        return float((each.mean() - 1) / np.sqrt(2 / each.size))

    @property
    def pure(self) -> Array:
        """(6,) pure error: mean square of what no coefficients explain, (rad/s)² and (m/s²)²."""
        return np.concatenate([told.left / told.spare for told in (self.gyro, self.accelerometer)])

    @property
    def variance(self) -> Array:
        """(6,) the same, not below what is lost within a cycle."""
        return np.asarray(np.maximum(self.pure, (RESOLUTION * self.signal) ** 2))


def free_response(case: Case, piece: slice, likely: Sequence[Disturbance] = (), theta: Array | None = None) -> Free:
    """What cycles ``piece`` say; :class:`InputError` if they are too few.

    Beside the most likely disturbance, where noise and torques as stated don't explain the rates; where some are ``likely``, one of
    these. With the motion within the cycles that a body ``theta`` of :mod:`massprop_cli.model.plant` has, if one is given.
    """
    design = case.design(piece, theta)
    turning, beside = whitened(design.driven, case.vehicle.imu.gyro_noise_rad_s**2, likely)
    return _free(design, turning, beside)


def beside_torques(case: Case, piece: slice, theta: Array, near: Disturbance | None = None) -> list[Free]:
    """The same beside each torque, wandering or white, that is ever tried; beside those of other levels ``near`` one."""
    if near is None:
        tried = TORQUES
    elif near.walk > 0:
        tried = [near._replace(walk=near.walk * by) for by in NEARER if near.walk * by >= LEVELS[0]]  # less is a steady torque
    else:
        tried = [near._replace(white=near.white * by) for by in NEARER]
    design = case.design(piece, theta)
    return [_free(design, one.fit, (one.disturbance,)) for one in whitened_fits(design.driven, tried)]


def _free(design: Design, turning: ReducedLeastSquares, beside: tuple[Disturbance, ...]) -> Free:
    count = len(design.mean)
    slow = waves(count, SLOW if INTEGRATED in design.places else 0)
    weight = design.heard[design.used[:, 1], None]
    columns, force = (weight * part[design.used[:, 1]] for part in (np.hstack([slow, design.mean]), design.force))
    felt = reduced(columns, force, slow.shape[1])._replace(volume=-6 * float(np.log(weight).sum()))
    signal = np.repeat([np.sqrt((part**2).mean()) for part in (design.rate, design.force)], 3)
    return Free(design.places, design.fired, design.level, signal, turning, felt, beside, design.clock_s)


def waves(count: int, most: int) -> Array:
    """(count, most) cosines of one and more half-waves."""
    return np.asarray(np.cos(np.pi * np.outer((np.arange(count) + 0.5) / count, np.arange(1, most + 1))))
