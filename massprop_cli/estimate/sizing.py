"""Maximum likelihood levels of an unstated disturbance torque, white or wandering, or of the gyro's noise.

What the rates say is made white beside a torque of some level (:mod:`massprop_cli.estimate.whitening`), while the response to commands and
to the motion is left free, so that no mass properties need be known. What no coefficients explain, over the stated noise, with the log
determinants of what was whitened and of the coefficients' information, is −2 log of that level's restricted likelihood (Patterson &
Thompson 1971). Where the gyro's noise is larger than stated, what is left says by how much.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.estimate.initial import beginning
from massprop_cli.estimate.whitening import Disturbance, Driven, each, independent
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import integrals_about
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare.compensate import Source

LONGEST = 2048
"""Cycles of each phase that are looked at."""
LEVELS = (0.0, *(10.0**k for k in range(-3, 4)))
"""Each tried, of both kinds; 1 is a torque whose cycle's impulse moves the rate by as much as the gyro's noise."""
FINER = (3.0, 1.7, 1.3, 1.1)
"""Factors by which the most likely is then varied, one after the other."""


class _Piece(NamedTuple):
    driven: Driven
    weights: Array
    """(3,) variance, over the gyro's noise, of what a unit of torque adds to the rate about each axis in a cycle."""
    noise: float
    """One sigma, rad/s."""


class Levels(NamedTuple):
    """Of each axis alike."""

    white: float
    """N m, one sigma per cycle of a white torque."""
    walk: float
    """N m, one sigma of the change per cycle of a wandering one."""
    gyro: float
    """Times as noisy as stated, 1 or more."""


def likeliest_levels(samples: Source, cycles: Sequence[slice], noisier: bool = False) -> Callable[[Resolved], Levels]:
    """:func:`torque_levels` of vehicles, which are the same with one noise of the gyro whatever else of them was sized meanwhile."""
    known: dict[float, Levels] = {}

    def of(vehicle: Resolved) -> Levels:
        noise = vehicle.imu.gyro_noise_rad_s
        if noise not in known:
            known[noise] = torque_levels(samples, cycles, vehicle, noisier)
        return known[noise]

    return of


def torque_levels(samples: Source, cycles: Sequence[slice], vehicle: Resolved, noisier: bool = False) -> Levels:
    """The most likely over the first cycles of each phase, beside the stated noise; with ``noisier`` the gyro may be noisier than that."""
    pieces = [piece for part in cycles if (piece := _piece(samples, part, vehicle)) is not None]
    if not pieces:
        return Levels(0.0, 0.0, 1.0)
    unit = float(np.mean([piece.weights.mean() for piece in pieces])) ** -0.5
    best = _likeliest(pieces, [(unit * a, unit * b) for a, b in product(LEVELS, LEVELS)])
    for by in FINER:
        white, walk = best
        best = _likeliest(pieces, [(white * a, walk * b) for a, b in product((1 / by, 1.0, by), repeat=2)])
    gyro = _times_as_noisy(pieces, best) if noisier else 1.0
    return Levels(*best, gyro) if gyro == 1 else Levels(0.0, 0.0, gyro)


def _likeliest(pieces: Sequence[_Piece], levels: Sequence[tuple[float, float]]) -> tuple[float, float]:
    levels = list(dict.fromkeys(levels))
    left, volume, _ = np.sum([_left(piece, levels) for piece in pieces], 0)
    prices = [_price(pieces) * sum(level > 0 for level in one) for one in levels]
    return levels[int(np.argmin(left + volume + prices))]


def _times_as_noisy(pieces: Sequence[_Piece], torque: tuple[float, float]) -> float:
    """How noisy the gyro is over what is stated, if that alone is likelier than a torque beside what is stated; else 1.

    Beside a torque free noise would take what is neither's, such as another body's motion.
    """
    left, volume, spare = np.sum([_left(piece, [(0.0, 0.0), torque]) for piece in pieces], 0)
    variance = max(float(left[0] / spare[0]), 1.0)
    alone = spare[0] * np.log(variance) + left[0] / variance + volume[0] + _price(pieces)
    beside = left[1] + volume[1] + _price(pieces) * sum(level > 0 for level in torque)
    return variance**0.5 if alone < beside else 1.0


def _price(pieces: Sequence[_Piece]) -> float:
    """Of a level (Schwarz 1978)."""
    return float(3 * np.log(sum(int(piece.driven.used.sum()) for piece in pieces)))


def _left(piece: _Piece, levels: Sequence[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """(L,) what is left beside each over the stated noise, the log determinants, and how many squares of chance are expected of it."""
    rates, weights = piece.driven, piece.weights
    beside = [Disturbance(w * white**2, w * walk**2) for white, walk in levels for w in weights]
    tried = each(rates, beside)
    left = np.array([one.told.left[i % 3] for i, one in enumerate(tried)]) / piece.noise**2
    volume = np.array([one.told.volume / 3 + one.taken for one in tried])
    spare = np.array([float(one.told.spare) for one in tried])
    return left.reshape(-1, 3).sum(1), volume.reshape(-1, 3).sum(1), spare.reshape(-1, 3).sum(1)


def _piece(samples: Source, cycles: slice, vehicle: Resolved) -> _Piece | None:
    """A phase's first cycles; None where they tell of no body, or are too few."""
    part = slice(cycles.start, min(cycles.start + LONGEST, cycles.stop))
    reference = beginning(samples, part, vehicle)
    phi_map = ResponseMap(plant_of(vehicle))
    if reference is None or part.stop - part.start < 3 * phi_map.plant.channels:
        return None
    here = samples.part(part)
    step, _, known = integrals_about(here, reference, vehicle)
    rate = here.rate_rad_s - np.concatenate([np.zeros((1, 3)), np.cumsum(known, 0)])
    noise = vehicle.imu.gyro_noise_rad_s
    # of columns that are sums of others rounding leaves some, and of it other CPUs another; those that are left are none
    used: BoolArray = np.asarray((~here.executed.ignored[:, :3]).any(1))
    driven = independent(Driven(step, rate, used, 0.0, held=True))
    weights = _weights(reference, median(here.executed.duration_s), noise)
    weights[vehicle.held_axes] = 0.0
    return _Piece(driven, weights, noise)


def _weights(reference: Reference, cycle_s: float, noise: float) -> Array:
    inverse = np.linalg.inv(reference.inertia)
    return np.asarray(np.einsum("ij,ij->i", inverse, inverse) * (cycle_s / noise) ** 2)
