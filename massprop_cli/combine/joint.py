"""Gaussian results of one body added up.

Each is taken to the parameters θ = (J, c, 1/m), J = I⁻¹, in which a log's response is nearly linear, so that a wide result is still
Gaussian there; what was known from elsewhere and the thrust's common uncertainty are taken out of each and put in once:

    Λ = Σ Λ_i,  θ = Λ⁻¹ Σ Λ_i θ_i .

On an air bearing it is nearly linear in the inertia and the first moment m_r s about the bearing (:mod:`massprop_cli.model.plant.bearing`):
a log tells that a thousand times better than mass or s, and a straight line through (s, m) leaves the valley within a sigma.

And the object that docked, from what was found of the vehicle alone and with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import NamedTuple

import numpy as np

from massprop_cli import CG, QUANTITIES
from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import elements, tensor
from massprop_cli.conclude import docking
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.estimate.quantities import by_first_moment, by_scale_beside, transformed
from massprop_cli.model.plant import BearingBody, Reference
from massprop_cli.result.build import estimate_items, matrix
from massprop_cli.result.schema import DockedObject, PhaseItem, VehicleInfo, WarningItem

BEYOND = 4.0
"""Sigmas by which a result may differ from all others together, as everywhere."""


@dataclass(frozen=True)
class Piece:
    """One result of one body."""

    values: Array
    """(10,) NaN where nothing can be said."""
    covariance: Array
    """(10, 10) with what is known and the common uncertainty of the thrust; NaN likewise."""
    known: Mapping[str, tuple[float, float]]
    """Value and sigma of what entered."""
    scale_sigma: float = 0.0
    """Relative, of the thrust's common error, as it is in ``covariance``."""
    bearing: BearingBody | None = None
    """On which it turned."""
    about_pivot: bool = False
    """Whether the values are inertia and first moment about a fixed pivot, and no mass (NaN)."""
    alike: Array = field(default_factory=lambda: np.zeros(10))
    """(10,) of its sigmas, what all pieces may have in common beside the scale and what is known."""

    def by_scale(self, values: Array) -> Array:
        """(10,) derivative by the thrust's scale of these ten quantities of the body; 0 where nothing can be said."""
        if self.about_pivot:
            return np.nan_to_num(values)
        mass, at = (self.bearing.bearing_mass, self.bearing.bearing) if self.bearing else (0.0, np.zeros(3))
        return np.nan_to_num(by_scale_beside(values, mass, at))


def scale_sigma(vehicle: VehicleInfo, phase: PhaseItem) -> float:
    """Relative, of the thrust's common error: as stated, and as far as a log makes it doubtful that does not fit."""
    return float(np.hypot(vehicle.thrust_scale_sigma, phase.discrepancy.thrust_scale_sigma if phase.discrepancy else 0.0))


@dataclass(frozen=True)
class Joint:
    """What all pieces say together."""

    values: Array
    covariance: Array
    bare: tuple[Array, Array]
    """Both by the logs alone: without what is known, and with the thrust taken as exact."""
    chi_square: float
    freedom: int
    """Equations beyond the unknowns."""
    apart: tuple[Array, ...]
    """(10,) of each piece: its deviate from all others together; NaN where either says nothing."""
    pulled: tuple[Array, ...]
    """(10,) of each piece: how far what all say together lies from its own value, in sigmas of its own; NaN likewise. Below 1 in the mean
    (var(θ − θ_i) = Λ_i⁻¹ − Λ⁻¹); where a quantity contradicts, those that are correlated with it are pulled along."""
    alone: tuple[tuple[float, int], ...] = ()
    """Of each log that was fitted with the others: how much less chi-square it has with a body of its own, and of how many directions."""
    strange: tuple[bool, ...] = ()
    """Of the same: whether its stated noise doesn't explain it, whatever the body."""
    alike: Array = field(default_factory=lambda: np.zeros(10))
    """(10,) of the sigmas, what all pieces may have in common beside the scale and what is known."""
    scatter: tuple[tuple[float, int], ...] = ()
    """Of each quantity by itself: chi-square of the pieces' own values about their weighted mean, and its degrees of freedom."""


def joint(pieces: Sequence[Piece], wide: bool = False) -> Joint:
    """Add up; values are NaN where no piece says anything. ``wide``: sigmas of inertia are of errors that are not Gaussian in θ either."""
    curved = not wide and all(is_body(piece.values) for piece in pieces)
    alone = [_bare(piece) for piece in pieces]
    bearing = pieces[0].bearing if curved and all(np.isfinite(values).all() for values, _ in alone) else None
    linear = [_to_linear(*piece, curved, bearing) for piece in alone]
    told = [_information(values, covariance) for values, covariance in linear]
    values, covariance = _solved([information for information, _ in told], [vector for _, vector in told])
    chi_square, ranks = 0.0, 0
    for (theta, _), (information, _) in zip(linear, told, strict=True):
        at = np.isfinite(theta)
        left = (theta - values)[at]
        chi_square += float(left @ information[np.ix_(at, at)] @ left)
        ranks += int(at.sum())
    apart = tuple(_apart(number, linear, told) for number in range(len(pieces)))
    bare = _back(bearing, values, covariance) if bearing else _to_linear(values, covariance, curved)
    together = _together(alone, [piece.alike for piece in pieces])
    bare = bare[0], _widened(bare[1], together.added)
    back, spread = with_shared(*bare, pieces)
    pulled = tuple((values - theta) / np.sqrt(np.diag(own)) for theta, own in linear)
    freedom = ranks - int(np.isfinite(values).sum())
    return Joint(back, spread, bare, chi_square, freedom, apart, pulled, alike=together.alike, scatter=together.scatter)


class _Together(NamedTuple):
    """Pieces quantity by quantity, each weighted by its own variance."""

    alike: Array
    """(10,) sigma of the mean that does not become smaller, ..."""
    added: Array
    """... and (10,) the variance that this adds to what independent pieces have."""
    scatter: tuple[tuple[float, int], ...]


def _together(alone: Sequence[tuple[Array, Array]], alike: Sequence[Array]) -> _Together:
    """Parts g_i of the sigmas u_i that may be common to all, with weights w_i of sum 1 add (Σ w_i g_i)² − Σ (w_i g_i)² to the variance."""
    values = np.array([value for value, _ in alone])
    own = np.array([np.sqrt(np.diag(spread)) for _, spread in alone])
    told = np.isfinite(values) & (own > 0)
    weight = np.where(told, 1 / np.where(told, own, 1.0) ** 2, 0.0)
    weight /= np.maximum(weight.sum(0), np.finfo(float).tiny)
    part = weight * np.where(told, np.minimum(alike, own), 0.0)
    mean = (weight * np.where(told, values, 0.0)).sum(0)
    chi_square = (np.where(told, (values - mean) / np.where(told, own, 1.0), 0.0) ** 2).sum(0)
    freedom = np.maximum(told.sum(0) - 1, 0)
    scatter = tuple((float(one), int(free)) for one, free in zip(chi_square, freedom, strict=True))
    return _Together(part.sum(0), part.sum(0) ** 2 - (part**2).sum(0), scatter)


def _widened(covariance: Array, added: Array) -> Array:
    """With so much more variance (10,), correlations as they are."""
    variance = np.diag(covariance)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.sqrt(1 + np.where(added > 0, added / variance, 0.0))
    return np.asarray(covariance * factor[:, None] * factor)


def is_body(values: Array) -> bool:
    """Whether the inertia of the ten quantities (10,) is positive definite, or not told at all."""
    inertia = values[:6]
    told = np.isfinite(inertia)
    return bool(np.linalg.eigvalsh(tensor(inertia))[0] > 0) if told.all() else not told.any()


def _bare(piece: Piece) -> tuple[Array, Array]:
    """By the log alone: without what is known, and with the thrust taken as exact."""
    values, covariance = piece.values.copy(), piece.covariance.copy()
    told = np.isfinite(values) & np.isfinite(np.diag(covariance))
    values[~told] = np.nan
    # a mass, and what else is no CG, was taken in first
    for group in (CG, [name for name in QUANTITIES if name not in CG]):
        without = _without(values, covariance, {name: one for name, one in piece.known.items() if name in group})
        values, covariance = _by_first_moment(group[0], piece, values, *without)
    scaled = piece.by_scale(values)
    covariance = covariance - piece.scale_sigma**2 * np.outer(scaled, scaled)
    return values, covariance


def _without(values: Array, covariance: Array, known: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """Of a Gaussian (10,), (10, 10) what was known is taken out; NaN where nothing is left."""
    if not known:
        return values, covariance
    values, covariance = values.copy(), covariance.copy()
    at = np.flatnonzero(np.isfinite(values))
    information = np.linalg.inv(covariance[np.ix_(at, at)])
    vector = information @ values[at]
    before = np.diag(information).copy()
    for name, (value, sigma) in known.items():
        row = np.flatnonzero(at == QUANTITIES.index(name))
        information[row, row] -= 1 / sigma**2
        vector[row] -= value / sigma**2
    left = np.diag(information) > ROUNDING * before
    values[at[~left]] = np.nan
    at, information, vector = at[left], information[np.ix_(left, left)], vector[left]
    spread = np.linalg.inv(information)
    values[at], covariance[np.ix_(at, at)] = spread @ vector, spread
    return values, covariance


def linear(values: Array, curved: bool, bearing: BearingBody | None = None) -> tuple[Array, Array]:
    """(10,) θ of the ten quantities (10,), NaN where these are, and its (10, 10) derivative by them.

    ``curved``: the inertia is a body's, or not told; ``bearing``: on which it turned, where all ten are known.
    """
    if bearing is not None:
        theta = bearing.theta(Reference(tensor(values[:6]), values[6:9], 1 / values[9]))
        return theta, np.linalg.inv(_slope_about(bearing, theta))
    theta, slope = values.copy(), np.eye(10)
    if curved and np.isfinite(values[:6]).all():
        inverse = np.linalg.inv(tensor(values[:6]))
        theta[:6] = elements(inverse)
        # d(I⁻¹) = −I⁻¹ dI I⁻¹
        slope[:6, :6] = np.array([elements(-inverse @ tensor(unit) @ inverse) for unit in np.eye(6)]).T
    theta[9] = 1 / values[9]
    slope[9, 9] = -1 / values[9] ** 2
    slope[9, 9] = slope[9, 9] if np.isfinite(slope[9, 9]) else 1.0
    return theta, slope


def _to_linear(values: Array, covariance: Array, curved: bool, bearing: BearingBody | None = None) -> tuple[Array, Array]:
    """θ and its covariance from the ten quantities; without a bearing the same way leads back: I = J⁻¹ and m = 1/(1/m)."""
    theta, slope = linear(values, curved, bearing)
    at = np.isfinite(values)
    found = np.full((10, 10), np.nan)
    found[np.ix_(at, at)] = (slope[np.ix_(at, at)] @ covariance[np.ix_(at, at)]) @ slope[np.ix_(at, at)].T
    return theta, found


def _back(bearing: BearingBody, theta: Array, covariance: Array) -> tuple[Array, Array]:
    """The ten quantities from θ of a bearing."""
    slope, values = _slope_about(bearing, theta), bearing.parameters(theta)
    values[9] = 1 / theta[9]
    return values, slope @ covariance @ slope.T


def _slope_about(bearing: BearingBody, theta: Array) -> Array:
    """(10, 10) derivative of the ten quantities."""
    slope = bearing.slopes(theta)
    slope[9] /= -(theta[9] ** 2)
    return slope


def _information(values: Array, covariance: Array) -> tuple[Array, Array]:
    """(10, 10) and (10,) information and its product with the values; zero of what is not told."""
    at = np.flatnonzero(np.isfinite(values))
    information, vector = np.zeros((10, 10)), np.zeros(10)
    if len(at):
        size = np.sqrt(np.diag(covariance)[at])
        scaled = np.linalg.inv(covariance[np.ix_(at, at)] / np.outer(size, size)) / np.outer(size, size)
        information[np.ix_(at, at)] = scaled
        vector[at] = scaled @ values[at]
    return information, vector


def _solved(information: Sequence[Array], vectors: Sequence[Array]) -> tuple[Array, Array]:
    total, vector = sum(information, np.zeros((10, 10))), sum(vectors, np.zeros(10))
    at = np.flatnonzero(np.diag(total) > 0)
    values, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
    if len(at):
        size = 1 / np.sqrt(np.diag(total)[at])
        spread = np.linalg.inv(total[np.ix_(at, at)] * np.outer(size, size)) * np.outer(size, size)
        values[at], covariance[np.ix_(at, at)] = spread @ vector[at], spread
    return values, covariance


def _apart(number: int, linear: Sequence[tuple[Array, Array]], told: Sequence[tuple[Array, Array]]) -> Array:
    rest = [one for i, one in enumerate(told) if i != number]
    others, spread = _solved([information for information, _ in rest], [vector for _, vector in rest])
    values, covariance = linear[number]
    with np.errstate(invalid="ignore"):
        return np.asarray((values - others) / np.sqrt(np.diag(covariance) + np.diag(spread)))


def with_shared(values: Array, covariance: Array, pieces: Sequence[Piece]) -> tuple[Array, Array]:
    """With the thrust's common uncertainty, and each thing that is known, once."""
    scaled = pieces[0].by_scale(values)
    # what makes one log doubt the thrust holds for all of them: it is the same
    covariance = covariance + max(piece.scale_sigma for piece in pieces) ** 2 * np.outer(scaled, scaled)
    shared = dict.fromkeys((name, value, sigma) for piece in pieces for name, (value, sigma) in piece.known.items())
    for name, value, sigma in sorted(shared, key=lambda one: one[0] != "mass"):  # as mass_first
        i = QUANTITIES.index(name)
        if not np.isfinite(values[i]):
            covariance[i] = covariance[:, i] = 0.0
            values[i], covariance[i, i] = value, sigma**2
            continue
        before, gain = values, np.nan_to_num(covariance[:, i]) / (covariance[i, i] + sigma**2)
        values, covariance = values + gain * (value - values[i]), covariance - np.outer(gain, np.nan_to_num(covariance[i]))
        values, covariance = _by_first_moment(name, pieces[0], before, values, covariance)
    return values, covariance


def _by_first_moment(name: str, piece: Piece, before: Array, after: Array, covariance: Array) -> tuple[Array, Array]:
    """A step of values, on a bearing straight in the first moment about it."""
    if piece.bearing is None:
        return after, covariance
    values, slope = by_first_moment(name, before[None], after[None], piece.bearing.bearing_mass)
    return values[0], transformed(covariance[None], slope)[0]


def docked_object(vehicles: tuple[VehicleInfo, VehicleInfo], single: PhaseItem, combined: PhaseItem) -> DockedObject:
    """Combined less alone, with one thrust scale for both; each rotating mass is without its bearing's."""
    bearings = [vehicle.bearing_mass_kg for vehicle in vehicles]
    scale = vehicles[0].thrust_scale_sigma
    values, joint_covariance = np.empty(20), np.zeros((20, 20))
    for half, phase in enumerate((single, combined)):
        part = slice(10 * half, 10 * half + 10)
        values[part] = [np.nan if item.value is None else item.value for item in phase.estimates.values()]
        joint_covariance[part, part] = np.array(phase.covariance, dtype=float)
    if not single.known and not combined.known:
        # known values calibrate each side's scale for itself; without, it is common
        alone, both = (
            by_scale_beside(half, vehicle.bearing_mass_kg, np.array(vehicle.bearing_position_m))
            for half, vehicle in zip(values.reshape(2, 10), vehicles, strict=True)
        )
        joint_covariance[:10, 10:] = scale**2 * np.outer(alone, both)
        joint_covariance[10:, :10] = joint_covariance[:10, 10:].T
    apart = docking.without_effect(vehicles[0].environment)
    both_sides = np.tile(apart, 2)  # nothing else depends on these
    values[both_sides], joint_covariance[both_sides], joint_covariance[:, both_sides] = 0.0, 0.0, 0.0
    values[[9, 19]] -= bearings
    found = docking.difference(values[:10], values[10:])
    slope = docking.difference_slope(values[:10], values[10:])
    covariance = slope @ joint_covariance @ slope.T
    verdict, reason = _of_sides(single, combined)
    contradictions = _contradictions(single, combined)
    if docking.has_negative_mass(float(found[9]), covariance):
        verdict, reason = "contradicted", _swapped(float(found[9]))
        contradictions.append(str(reason))
    estimates = estimate_items(docking.docked_estimates(found, covariance, verdict, reason, apart))
    covariance[apart], covariance[:, apart] = np.nan, np.nan
    return DockedObject(
        before=single.name, after=combined.name, estimates=estimates, covariance=matrix(covariance), contradiction="; ".join(contradictions)
    )


def known_object(
    single: PhaseItem, combined: PhaseItem, found: tuple[Array, Array], known: Mapping[str, tuple[float, float]]
) -> DockedObject:
    """An object that is known, with what logs without it and with it add: (10,) and (10, 10)."""
    return DockedObject(
        before=single.name,
        after=combined.name,
        estimates=estimate_items(docking.docked_estimates(*found, *_of_sides(single, combined), np.zeros(10, dtype=bool))),
        covariance=matrix(found[1]),
        contradiction="; ".join(_contradictions(single, combined)),
        known=dict(known),
    )


def _of_sides(single: PhaseItem, combined: PhaseItem) -> tuple[Verdict, Reason]:
    verdicts = {
        item.verdict
        for phase in (single, combined)
        for item in (phase.estimates | phase.about_pivot).values()
        if item.verdict != "unobservable"
    }
    if "contradicted" in verdicts:
        return "contradicted", Reason("sides-contradicted")
    return ("converged", Reason("sides-converged")) if verdicts == {"converged"} else ("not_converged", Reason("sides-not-converged"))


def _contradictions(single: PhaseItem, combined: PhaseItem) -> list[str]:
    return [docking.in_phase(phase.name, phase.contradiction) for phase in (single, combined) if phase.contradiction]


def negative_mass_warnings(docked: DockedObject | None) -> list[WarningItem]:
    """That the object has less than no mass."""
    mass = None if docked is None else docked.estimates["mass"]
    if mass is None or mass.value is None or mass.reason_code != "docked-lighter":
        return []
    return [WarningItem(code="docked-mass", message=str(_swapped(mass.value)))]


def _swapped(mass: float) -> Reason:
    return docking.negative_mass(mass, "what --after names", "what --before names", "were the two swapped?")
