"""Maximum likelihood levels of an unstated disturbance torque, white or random walk, or of the gyro noise.

The rates are whitened under a torque of some level (:mod:`massprop_cli.estimate.whitening`). The response to commands and motion is free,
so no mass properties need be known. −2 log of a level's restricted likelihood (Patterson & Thompson 1971) is the sum of three terms:
squared residuals over the stated noise, log determinant of the whitened covariance, log determinant of the coefficients' information. If
the gyro noise exceeds the stated one, the residuals give its level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.levels import LONG
from massprop_cli.estimate.initial import early_reference
from massprop_cli.estimate.whitening import Disturbance, Driven, independent, whitened_fits
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.regressors import integrals_about
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.prepare.compensate import Source

LEVELS = (0.0, *(10.0**k for k in range(-3, 4)))
"""Levels in the first search, for both kinds of torque; at 1, a cycle's impulse changes the rate by one sigma of the gyro noise."""
FINER = (3.0, 1.7, 1.3, 1.1)
"""Factors by which the most likely levels are then varied, one after the other."""


class _Piece(NamedTuple):
    """The rates of a phase's first cycles."""

    driven: Driven
    weights: Array
    """(3,) variance that a unit of torque adds to the rate about each axis in a cycle, over the gyro noise variance."""
    noise: float
    """One sigma of the gyro noise, rad/s."""


class Levels(NamedTuple):
    """Levels of disturbance and noise, the same for all axes."""

    white: float
    """One sigma of a white torque per cycle, N m."""
    walk: float
    """One sigma of the change of a random-walk torque per cycle, N m."""
    gyro: float
    """Factor on the stated gyro noise, 1 or more."""


def likeliest_levels(samples: Source, cycles: Sequence[slice], noisier: bool = False) -> Callable[[Resolved], Levels]:
    """:func:`torque_levels` as a function of the vehicle, computed once for each gyro noise, on which alone it depends."""
    known: dict[float, Levels] = {}

    def of(vehicle: Resolved) -> Levels:
        noise = vehicle.imu.gyro_noise_rad_s
        if noise not in known:
            known[noise] = torque_levels(samples, cycles, vehicle, noisier)
        return known[noise]

    return of


def torque_levels(samples: Source, cycles: Sequence[slice], vehicle: Resolved, noisier: bool = False) -> Levels:
    """Maximum likelihood levels over the first cycles of each phase; with ``noisier`` the gyro noise may exceed the stated one instead."""
    pieces = [piece for part in cycles if (piece := _piece(samples, part, vehicle)) is not None]
    if not pieces:
        return Levels(0.0, 0.0, 1.0)
    unit = float(np.mean([piece.weights.mean() for piece in pieces])) ** -0.5
    best = _likeliest(pieces, [(unit * a, unit * b) for a, b in product(LEVELS, LEVELS)])
    for by in FINER:
        white, walk = best
        best = _likeliest(pieces, [(white * a, walk * b) for a, b in product((1 / by, 1.0, by), repeat=2)])
    gyro = _noise_factor(pieces, best) if noisier else 1.0
    return Levels(*best, gyro) if gyro == 1 else Levels(0.0, 0.0, gyro)


def _likeliest(pieces: Sequence[_Piece], levels: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The pair of levels with the greatest restricted likelihood, less the penalty."""
    levels = list(dict.fromkeys(levels))
    squares, determinants, _ = np.sum([_likelihood_terms(piece, levels) for piece in pieces], 0)
    penalties = [_penalty(pieces) * sum(level > 0 for level in one) for one in levels]
    return levels[int(np.argmin(squares + determinants + penalties))]


def _noise_factor(pieces: Sequence[_Piece], torque: tuple[float, float]) -> float:
    """Factor on the stated gyro noise, if more noise alone is more likely than a torque with the stated noise; else 1.

    Both at once are not compared: free noise would absorb what neither explains, such as the motion of another body.
    """
    squares, determinants, freedom = np.sum([_likelihood_terms(piece, [(0.0, 0.0), torque]) for piece in pieces], 0)
    variance = max(float(squares[0] / freedom[0]), 1.0)
    noise_alone = freedom[0] * np.log(variance) + squares[0] / variance + determinants[0] + _penalty(pieces)
    with_torque = squares[1] + determinants[1] + _penalty(pieces) * sum(level > 0 for level in torque)
    return variance**0.5 if noise_alone < with_torque else 1.0


def _penalty(pieces: Sequence[_Piece]) -> float:
    """Penalty of one level, from the Bayesian information criterion (Schwarz 1978)."""
    return float(3 * np.log(sum(int(piece.driven.used.sum()) for piece in pieces)))


def _likelihood_terms(piece: _Piece, levels: Sequence[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """(L,) squared residuals over the stated noise, (L,) log determinants, and (L,) degrees of freedom, for each pair of levels."""
    rates, weights = piece.driven, piece.weights
    fits = whitened_fits(rates, [Disturbance(w * white**2, w * walk**2) for white, walk in levels for w in weights])
    # three disturbances for each pair, one for each axis; of a fit, only that axis counts
    squares = np.array([one.fit.left[i % 3] for i, one in enumerate(fits)]) / piece.noise**2
    determinants = np.array([one.fit.volume / 3 + one.log_information for one in fits])
    freedom = np.array([float(one.fit.spare) for one in fits])
    return squares.reshape(-1, 3).sum(1), determinants.reshape(-1, 3).sum(1), freedom.reshape(-1, 3).sum(1)


def _piece(samples: Source, cycles: slice, vehicle: Resolved) -> _Piece | None:
    """A phase's first cycles; None if they give no reference, or are too few."""
    part = slice(cycles.start, min(cycles.start + LONG, cycles.stop))
    reference = early_reference(samples, part, vehicle)
    phi_map = ResponseMap(plant_of(vehicle))
    if reference is None or part.stop - part.start < 3 * phi_map.plant.channels:
        return None
    here = samples.part(part)
    step, _, known = integrals_about(here, reference, vehicle)
    rate = here.rate_rad_s - np.concatenate([np.zeros((1, 3)), np.cumsum(known, 0)])
    noise = vehicle.imu.gyro_noise_rad_s
    used: BoolArray = np.asarray((~here.executed.ignored[:, :3]).any(1))
    # dependent columns are removed here: what rounding leaves of them differs between CPUs
    driven = independent(Driven(step, rate, used, 0.0, held=True))
    weights = _weights(reference, median(here.executed.duration_s), noise)
    weights[vehicle.held_axes] = 0.0
    return _Piece(driven, weights, noise)


def _weights(reference: Reference, cycle_s: float, noise: float) -> Array:
    """(3,) variance that a unit of torque adds to the rate about each axis in a cycle, over the gyro noise variance."""
    inverse = np.linalg.inv(reference.inertia)
    return np.asarray(np.einsum("ij,ij->i", inverse, inverse) * (cycle_s / noise) ** 2)
