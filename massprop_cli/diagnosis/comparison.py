"""Comparison of hypotheses on one reduction of a log, each with its best body and nuisance parameters.

Many hypotheses are fitted at once by a few damped Gauss–Newton steps on triangles of constant size, with difference quotients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, IntArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CHANCE, ITERATIONS
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis.channelwise import FreeResponse
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.initialbody import initial_bodies
from massprop_cli.diagnosis.kernelfits import Fits, PackedTriangles
from massprop_cli.errorparameters.parameter import FittedHypothesis
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import ENTRIES
from massprop_cli.estimate.triangle import HEAVIER
from massprop_cli.estimate.whitening import ReducedLeastSquares
from massprop_cli.kernel import kernel
from massprop_cli.model.plant.plant import MOMENT, MU, J

PULL = 0.01
"""Prior information of a body's entries: inverse sigma about the initial regression, over the natural size."""
STILL, ROUGHLY = 1e-3, 0.1
"""Change of −2 log likelihood that ends a fit; and that for a ranking."""
ACTS_ON = {"gyro_bias": slice(0, 3), "drag": slice(0, 3), "accel_bias": slice(3, 6), "slope": slice(3, 5), "tilt": slice(3, 5)}
"""Channels that each nuisance parameter acts on."""
HALF_STEP = 1e-6
"""Step of a derivative, in prior sigmas."""


@dataclass(frozen=True)
class Fitted:
    """A hypothesis with its best values."""

    hypothesis: Hypothesis
    model: Model
    x: Array
    chi_square: Array
    """(6,) chi-square beyond free coefficients, for each sensor axis."""
    spread: Array
    """(d,) sigma of each unknown of the hypothesis, in prior sigmas."""

    def value(self, name: str) -> Array:
        """Value of a parameter in x."""
        return self.x[self.model.place(name)]

    def error(self, name: str) -> Array:
        """Value of a parameter less its stated value."""
        return self.value(name) - self.model.stated[self.model.place(name)]

    @cached_property
    def parts(self) -> list[Fitted]:
        """Both parts of a pair; otherwise the fit itself."""
        if not self.hypothesis.parts:
            return [self]
        parts = self.hypothesis.parts
        spreads = np.split(self.spread, np.cumsum([part.directions.shape[1] for part in parts])[:-1])
        return [replace(self, hypothesis=part, spread=own) for part, own in zip(parts, spreads, strict=True)]

    @property
    def unknowns(self) -> int:
        """Number of unknowns, d."""
        return int(self.hypothesis.directions.shape[1])

    @property
    def factors(self) -> Array:
        """Thrust over stated thrust of the channels that the hypothesis is about."""
        own = np.flatnonzero(self.hypothesis.directions[self.model.place("thrust")].any(1))
        return self.value("thrust")[own]

    def sigma(self, name: str) -> Array:
        """Sigma of a parameter by the hypothesis's own unknowns."""
        return np.asarray(np.sqrt(((self.hypothesis.directions[self.model.place(name)] * self.spread) ** 2).sum(1)))

    def finding(self, names: Sequence[str], stated: Setup, corrected: Setup) -> FittedHypothesis:
        """The fit as the error parameters take it; ``names`` of the channels that act."""
        errors, sigmas = ({name: of(name) for name in ENTRIES} for of in (self.error, self.sigma))
        turns, force = (self.hypothesis.gyro, self.hypothesis.accelerometer), (self.model.force, self.model.wrench(self.x)[1])
        about = (self.hypothesis.subject, tuple(names), errors, sigmas, stated, corrected)
        does = {names[i]: names[other] for i, other in enumerate(self.hypothesis.wiring) if names and i != other}
        return FittedHypothesis(*about, self.model.mounting, turns, force, float(self.x[MU]), self.model.cg(self.x), does)

    @cached_property
    def scaled(self) -> Array:
        """(d,) unknowns in prior sigmas."""
        return np.asarray(np.linalg.lstsq(self.hypothesis.directions[10:], (self.x - self.model.stated)[10:], rcond=None)[0])

    def extrapolated(self, part: float) -> Array:
        """(nx,) x with the errors scaled by ``part``."""
        x = self.x.copy()
        x[10:] = self.model.stated[10:] + part * (x - self.model.stated)[10:]
        return x

    @property
    def prior_chi_square(self) -> float:
        """Prior chi-square: sum of squared unknowns over their prior variances."""
        return float((self.scaled**2).sum()) if self.unknowns else 0.0


def compared(model: Model, free: FreeResponse, variance: Array, hypotheses: Sequence[Hypothesis]) -> Array:
    """(H, 6) chi-square of each hypothesis with an initial body, before any fit."""
    rows = _LeastSquares.of_all(model, free, variance, hypotheses)
    x, _ = rows.initial(hypotheses)
    return np.asarray((rows.residuals(x) ** 2).sum(1) + rows.unexplained)


def fitted(
    model: Model,
    free: FreeResponse,
    variance: Array,
    hypotheses: Sequence[Hypothesis],
    theta: Array | None = None,
    tolerance: float = STILL,
    start_at_theta: bool = False,
) -> list[Fitted]:
    """Fit the body and the unknowns of each hypothesis; ``variance`` (6,) of the noise.

    A fit starts from the body of a plain regression, or from ``theta`` (10,) if that has less chi-square or if ``start_at_theta``.
    Hypotheses with the same columns are fitted together.
    """
    systems = [(model.columns(one.varied), one.wiring, one.reversed_rotors) for one in hypotheses]
    fits: dict[int, Fitted] = {}
    for key in dict.fromkeys(systems):
        which = [i for i, own in enumerate(systems) if own == key]
        used = (model.wired(*key[1:]), free.without_cache) if any(key[1:]) else (model, free)
        fits |= zip(which, _fitted_together(*used, variance, [hypotheses[i] for i in which], theta, tolerance, start_at_theta), strict=True)
    return [fits[i] for i in range(len(hypotheses))]


def _fitted_together(
    model: Model,
    free: FreeResponse,
    variance: Array,
    hypotheses: Sequence[Hypothesis],
    theta: Array | None,
    tolerance: float,
    start_at_theta: bool,
) -> list[Fitted]:
    most_unknowns = max(s.directions.shape[1] for s in hypotheses)
    rows = _LeastSquares.of_all(model, free, variance, hypotheses)
    x, sizes = _initial(rows, hypotheses, theta, start_at_theta)
    uncertain = model.uncertain
    first_own = 10 + uncertain.shape[1]
    directions = np.zeros((len(hypotheses), x.shape[1], first_own + most_unknowns))
    nuisances = uncertain * ~np.array([one.varied for one in hypotheses])[..., None]
    directions[:, :, 10:first_own] = nuisances
    directions[:, range(10), range(10)] = sizes * model.plant.observable  # unobservable entries stay
    for i, one in enumerate(hypotheses):
        directions[i, :, first_own : first_own + one.directions.shape[1]] = one.directions
    prior_root = np.concatenate([np.full(10, PULL), np.ones(first_own + most_unknowns - 10)])
    result = (
        rows.packed.fitted(x, directions, prior_root, (tolerance, rows.degrees_of_freedom, ITERATIONS))
        if compiled()
        else _gauss_newton(rows, directions, prior_root, x, tolerance)
    )
    spread, chi_square = result.spread[:, first_own:], (result.residuals**2).sum(1) + rows.unexplained
    # nuisance parameters are no part of the hypothesis
    is_nuisance = nuisances.any(2)
    chi_square = chi_square + _nuisance_penalty(model, np.where(is_nuisance, result.x - x, 0.0))
    x_fitted = np.where(is_nuisance, x, result.x)
    return [Fitted(one, model, x_fitted[i], chi_square[i], spread[i, : one.directions.shape[1]]) for i, one in enumerate(hypotheses)]


def _nuisance_penalty(model: Model, moved: Array) -> Array:
    """(H, 6) penalty of nuisance parameters that the fits moved by ``moved`` (H, nx)."""
    penalty = np.zeros((len(moved), 6))
    for name, sigma in model.nuisances.items():
        penalty[:, ACTS_ON[name]] += np.maximum((moved[:, model.place(name)] / sigma) ** 2 - CHANCE**2, 0.0)
    return penalty


def compiled() -> bool:
    """Whether the compiled kernel is available."""
    return kernel().library is not None


def _gauss_newton(rows: _LeastSquares, directions: Array, prior_root: Array, x: Array, tolerance: float) -> Fits:
    descent = _Descent(rows, directions, prior_root, x.copy())
    active = np.arange(len(x))
    for _ in range(ITERATIONS):
        gained = descent.step(active)
        # the change in the likelihood with free noise levels
        active = active[gained > tolerance * (1 + descent.cost[active] / rows.degrees_of_freedom)]
        if not len(active):
            break
    return Fits(descent.x, descent.left, descent.spread())


def _initial(rows: _LeastSquares, hypotheses: Sequence[Hypothesis], theta: Array | None, start_at_theta: bool) -> tuple[Array, Array]:
    """(H, nx) initial x, and (H, 10) sizes of θ."""
    x, sizes = rows.initial(hypotheses)
    if rows.model.released is not None:
        x[:, :10] = rows.model.released if theta is None else theta
        inverse, mu = tensor(rows.model.released[J]), rows.model.released[MU]
        size = np.sqrt(np.trace(np.linalg.inv(inverse)) / mu)
        return x, np.repeat(np.repeat([np.trace(inverse), size, mu], [6, 3, 1])[None], len(x), 0)
    if theta is not None and start_at_theta:
        x[:, :10] = theta
        return x, sizes
    centred = x.copy()  # with little force or weight, regression may place the CG anywhere
    centred[:, MOMENT] = 0.0
    x = _better(rows, x, centred)
    with_suspects = np.array([i for i, one in enumerate(hypotheses) if one.suspects], int)
    if len(with_suspects):  # regression with all channels, and without the suspected ones
        subset = rows.of(with_suspects)
        others, _ = subset.initial([hypotheses[i] for i in with_suspects], trusting=True)
        x[with_suspects] = _better(subset, x[with_suspects], others)
    if theta is not None:
        others = x.copy()
        others[:, :10] = theta
        x = _better(rows, x, others)
    return x, sizes


def _better(rows: _LeastSquares, x: Array, alternative: Array) -> Array:
    """(H, nx) the better of two initial x."""
    better = (rows.residuals(alternative) ** 2).sum((1, 2)) < (rows.residuals(x) ** 2).sum((1, 2))
    return np.where(better[:, None], alternative, x)


class _Descent:
    """Damped Gauss–Newton steps (Levenberg 1944) of H fits; each unknown has a prior about its initial value."""

    def __init__(self, rows: _LeastSquares, directions: Array, prior_root: Array, x: Array) -> None:
        self.rows, self.moves, self.pulled, self.x = rows, directions, prior_root, x
        count, size = len(x), directions.shape[2]
        self.offset, self.damping = np.zeros((count, size)), np.full(count, 1e-6)
        self.left = rows.residuals(x)
        self.cost = (self.left**2).sum((-2, -1))
        self.slopes = np.empty((count, *self.left.shape[1:], size))
        self.due = np.ones(count, dtype=bool)

    def step(self, which: IntArray) -> Array:
        """One step of some fits; decrease of each cost, infinite if the step failed."""
        self._renew(which)
        slopes, left, offset = self.slopes[which], self.left[which], self.offset[which]
        flat = slopes.reshape(len(which), -1, slopes.shape[-1])
        normal = np.swapaxes(flat, 1, 2) @ flat + np.diag(self.pulled**2)
        gradient = (np.swapaxes(flat, 1, 2) @ left.reshape(len(which), -1, 1))[..., 0] + self.pulled**2 * offset
        diagonal = np.einsum("hii->hi", normal)
        damped = normal + self.damping[which, None, None] * (diagonal[:, :, None] * np.eye(len(self.pulled)))
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        x_next = self.x[which] + np.einsum("hxi,hi->hx", self.moves[which], step)
        # an unobservable mass must not delay what is observable
        x_next[:, MU] = np.maximum(x_next[:, MU], self.x[which][:, MU] / HEAVIER)
        unphysical = ~is_body(x_next[:, :10])
        x_next[unphysical] = self.x[which][unphysical]
        with np.errstate(over="ignore", invalid="ignore"):  # an overflowing step fails
            left = self.rows.of(which).residuals(x_next)
            cost = (left**2).sum((-2, -1)) + ((self.pulled * (offset + step)) ** 2).sum(-1)
        before = self.cost[which]
        better = (cost < before) & ~unphysical
        gained = np.where(better, before - cost, np.where(unphysical | ~(cost <= before * (1 + 1e-9)), np.inf, 0.0))
        moved = which[better]
        self.x[moved], self.left[moved], self.cost[moved] = x_next[better], left[better], cost[better]
        self.offset[moved] += step[better]
        self.damping[which] = np.where(better, self.damping[which] / 10, self.damping[which] * 10 + 1e-4)
        self.due[moved] = True
        return gained

    def _renew(self, which: IntArray) -> None:
        """Compute outdated derivatives."""
        due = which[self.due[which]]
        if len(due):
            self.slopes[due] = self.rows.of(due).slopes(self.x[due], self.moves[due], self.left[due])
            self.due[due] = False

    def spread(self) -> Array:
        """(H, n) sigma of each unknown, from the derivatives of the last step."""
        flat = self.slopes.reshape(len(self.x), -1, self.slopes.shape[-1])
        covariance = np.linalg.inv(np.swapaxes(flat, 1, 2) @ flat + np.diag(self.pulled**2))
        return np.asarray(np.sqrt(np.maximum(np.einsum("hii->hi", covariance), 0.0)))


def is_body(theta: Array) -> BoolArray:
    """(H,) whether θ (H, 10) is physical."""
    good = np.isfinite(theta).all(-1)
    principal = np.linalg.eigvalsh(tensor(np.nan_to_num(theta[:, J])))
    return np.asarray(good & (principal[:, 0] > 1e-4 * np.abs(principal[:, 2])) & (theta[:, MU] > 0))


@dataclass(frozen=True)
class _LeastSquares:
    """Whitened least-squares systems of H hypotheses, with the columns that they need."""

    model: Model
    systems: tuple[ReducedLeastSquares, ReducedLeastSquares]
    """Of gyro and accelerometer."""
    variance: Array
    gyro: Array
    accelerometer: Array
    unexplained: Array
    """(6,) chi-square that these columns cannot explain."""
    degrees_of_freedom: int
    """Degrees of freedom."""
    regressions: dict[tuple[object, ...], Array]
    """Cache of regressions (:class:`FreeResponse`)."""
    free_directions: tuple[Array, Array] | None = None
    """(p, H) for each sensor: unit vector along the free channel, projected out of the residuals; None without any."""

    @staticmethod
    def of_all(model: Model, free: FreeResponse, variance: Array, hypotheses: Sequence[Hypothesis]) -> _LeastSquares:
        """Systems with all columns that the hypotheses need."""
        count = max(model.columns(one.varied) for one in hypotheses)
        model = replace(model, places={name: place for name, place in model.places.items() if place.stop <= count})
        each = (free.gyro, free.accelerometer)
        # the residual by the first columns of a triangle is in its first rows
        sensors = [one._replace(triangle=one.triangle[:count, :count], measured=one.measured[:count]) for one in each]
        unexplained = np.concatenate([(one.measured[count:] ** 2).sum(0) for one in each]) / variance
        gyro, accelerometer = (np.stack(turns) for turns in ([s.gyro for s in hypotheses], [s.accelerometer for s in hypotheses]))
        spare = 3 * sum(one.spare for one in each)
        rows = _LeastSquares(model, (sensors[0], sensors[1]), variance, gyro, accelerometer, unexplained, spare, free.regressions)
        if all(one.free_channel is None for one in hypotheses):
            return rows
        which = [model.places["channels"].start + (one.free_channel or 0) for one in hypotheses]
        along = [one.triangle[:, which] * [one.free_channel is not None for one in hypotheses] for one in sensors]
        return replace(rows, free_directions=tuple(part / np.maximum(np.linalg.norm(part, axis=0), TINY) for part in along))

    def of(self, which: IntArray) -> _LeastSquares:
        """Systems of some fits."""
        freed = self.free_directions and (self.free_directions[0][:, which], self.free_directions[1][:, which])
        return replace(self, gyro=self.gyro[which], accelerometer=self.accelerometer[which], free_directions=freed)

    @cached_property
    def packed(self) -> PackedTriangles:
        """Systems packed for the kernel."""
        return PackedTriangles(self.model, self.systems, self.variance, self.gyro, self.accelerometer, self.free_directions)

    def initial(self, hypotheses: Sequence[Hypothesis], trusting: bool = False) -> tuple[Array, Array]:
        """(H, nx) initial x, and (H, 10) sizes of θ; if ``trusting``, suspected channels take part in the regression."""
        return initial_bodies(self.model, self.systems, self.regressions, self.packed if compiled() else None, hypotheses, trusting)

    def residuals(self, x: Array) -> Array:
        """(H, p, 6) residuals for x (H, nx), over the noise."""
        if compiled():
            return self.packed.residuals(x)
        return self._whitened(self.model.coefficients(x, self.gyro, self.accelerometer))

    def slopes(self, x: Array, directions: Array, left: Array) -> Array:
        """(H, p, 6, n) derivative of the residuals along the columns of ``directions`` (H, nx, n)."""
        moved = x[:, None, :] + HALF_STEP * np.swapaxes(directions, 1, 2)
        residuals_moved = self._whitened(self.model.coefficients(moved, self.gyro[:, None], self.accelerometer[:, None]))
        return np.moveaxis((residuals_moved - left[:, None]) / HALF_STEP, 1, -1)

    def _whitened(self, coefficients: Array) -> Array:
        root = np.sqrt(self.variance)
        whitened = np.zeros(coefficients.shape)
        for sensor, axes, free_direction in zip(
            self.systems, (slice(0, 3), slice(3, 6)), self.free_directions or (None, None), strict=True
        ):
            rows = len(sensor.triangle)
            # one product of two matrices takes a fraction of the time of many small ones
            of_axes = np.moveaxis(coefficients[..., axes], -2, 0)
            left = (
                np.moveaxis((sensor.triangle @ of_axes.reshape(len(of_axes), -1)).reshape(rows, *of_axes.shape[1:]), 0, -2)
                - sensor.measured
            )
            if free_direction is not None:
                along = free_direction.T.reshape(-1, *[1] * (left.ndim - 3), rows, 1)
                left -= along * (along * left).sum(-2, keepdims=True)
            whitened[..., :rows, axes] = left / root[axes]
        return whitened
