"""Combination of Gaussian results of one body by their information, and the docked object of two combined results.

A log's response is nearly linear in θ = (J, c, 1/m), J = I⁻¹, so a result is Gaussian in θ even with large sigmas. Known values and the
common thrust uncertainty are removed from each result, and included once in the sum of the information matrices Λ_i:

    Λ = Σ Λ_i,  θ = Λ⁻¹ Σ Λ_i θ_i .

On an air bearing the response is nearly linear in the inertia and the first moment m_r s about the bearing
(:mod:`massprop_cli.model.plant.bearing`). A log informs that a thousand times better than m_r or s, so a linearisation in (s, m) would fail
within a sigma.
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


@dataclass(frozen=True)
class Piece:
    """One result of one body."""

    values: Array
    """(10,) quantities; NaN without an estimate."""
    covariance: Array
    """(10, 10) covariance with known values and the common thrust uncertainty; NaN without an estimate."""
    known: Mapping[str, tuple[float, float]]
    """Known values that the result includes: value and sigma."""
    scale_sigma: float = 0.0
    """Relative sigma of the common thrust scale in ``covariance``."""
    bearing: BearingBody | None = None
    """Air bearing that carried the body."""
    about_pivot: bool = False
    """Whether the values are inertia and first moment about a fixed pivot; the mass is NaN."""
    alike: Array = field(default_factory=lambda: np.zeros(10))
    """(10,) sigmas of the errors that all results may share, apart from thrust scale and known values."""

    def by_scale(self, values: Array) -> Array:
        """(10,) derivative of the ten quantities ``values`` (10,) with respect to the thrust scale; 0 without a value."""
        if self.about_pivot:
            return np.nan_to_num(values)
        mass, at = (self.bearing.bearing_mass, self.bearing.bearing) if self.bearing else (0.0, np.zeros(3))
        return np.nan_to_num(by_scale_beside(values, mass, at))


def scale_sigma(vehicle: VehicleInfo, phase: PhaseItem) -> float:
    """Relative sigma of the common thrust scale: the stated one and that of the phase's model discrepancy."""
    return float(np.hypot(vehicle.thrust_scale_sigma, phase.discrepancy.thrust_scale_sigma if phase.discrepancy else 0.0))


@dataclass(frozen=True)
class Joint:
    """Combined result of all pieces."""

    values: Array
    covariance: Array
    bare: tuple[Array, Array]
    """Both from the logs alone, without known values and with exact thrust."""
    chi_square: float
    """Chi-square of the pieces about the combined result."""
    freedom: int
    """Its degrees of freedom."""
    deviates: tuple[Array, ...]
    """(10,) normal deviates of each piece from all others together, in θ; NaN without a value."""
    pulls: tuple[Array, ...]
    """(10,) distance of the combined values from each piece, in θ and in the piece's sigmas; NaN without a value. Usually below 1, as
    var(θ − θ_i) = Λ_i⁻¹ − Λ⁻¹. A contradicted quantity also pulls those that are correlated with it."""
    own_fits: tuple[tuple[float, int], ...] = ()
    """For each jointly fitted log: decrease of its chi-square with a body of its own, and number of directions."""
    unexplained: tuple[bool, ...] = ()
    """For each jointly fitted log: whether its stated noise does not explain it with any body."""
    alike: Array = field(default_factory=lambda: np.zeros(10))
    """(10,) sigmas of the errors that all pieces may share, apart from thrust scale and known values."""
    scatter: tuple[tuple[float, int], ...] = ()
    """For each quantity alone: chi-square of the pieces about their weighted mean, and its degrees of freedom."""


def joint(pieces: Sequence[Piece], wide: bool = False) -> Joint:
    """Combine results of one body; NaN where no piece has a value.

    ``wide``: the errors of the inertia are not Gaussian in J = I⁻¹, so the combination is linear in I.
    """
    curved = not wide and all(is_body(piece.values) for piece in pieces)
    bare_pieces = [_bare(piece) for piece in pieces]
    bearing = pieces[0].bearing if curved and all(np.isfinite(values).all() for values, _ in bare_pieces) else None
    linear = [_to_linear(*piece, curved, bearing) for piece in bare_pieces]
    informed = [_information(values, covariance) for values, covariance in linear]
    values, covariance = _solved([information for information, _ in informed], [vector for _, vector in informed])
    chi_square, ranks = 0.0, 0
    for (theta, _), (information, _) in zip(linear, informed, strict=True):
        at = np.isfinite(theta)
        residual = (theta - values)[at]
        chi_square += float(residual @ information[np.ix_(at, at)] @ residual)
        ranks += int(at.sum())
    deviates = tuple(_deviates(number, linear, informed) for number in range(len(pieces)))
    bare = _back(bearing, values, covariance) if bearing else _to_linear(values, covariance, curved)
    mean = _weighted_mean(bare_pieces, [piece.alike for piece in pieces])
    bare = bare[0], _widened(bare[1], mean.added)
    combined_values, combined_covariance = with_shared(*bare, pieces)
    pulls = tuple((values - theta) / np.sqrt(np.diag(spread)) for theta, spread in linear)
    freedom = ranks - int(np.isfinite(values).sum())
    return Joint(combined_values, combined_covariance, bare, chi_square, freedom, deviates, pulls, alike=mean.alike, scatter=mean.scatter)


class _WeightedMean(NamedTuple):
    """Shared errors and scatter of each quantity, with the pieces weighted by their variances."""

    alike: Array
    """(10,) sigma of the mean's shared error, ..."""
    added: Array
    """... and (10,) the variance by which it exceeds that of independent pieces."""
    scatter: tuple[tuple[float, int], ...]
    """As in :class:`Joint`."""


def _weighted_mean(bare: Sequence[tuple[Array, Array]], alike: Sequence[Array]) -> _WeightedMean:
    """Shared parts g_i of the sigmas, with weights w_i of sum 1, add (Σ w_i g_i)² − Σ (w_i g_i)² to the variance of the mean."""
    values = np.array([value for value, _ in bare])
    sigmas = np.array([np.sqrt(np.diag(spread)) for _, spread in bare])
    finite = np.isfinite(values) & (sigmas > 0)
    weight = np.where(finite, 1 / np.where(finite, sigmas, 1.0) ** 2, 0.0)
    weight /= np.maximum(weight.sum(0), np.finfo(float).tiny)
    shared = weight * np.where(finite, np.minimum(alike, sigmas), 0.0)
    mean = (weight * np.where(finite, values, 0.0)).sum(0)
    chi_square = (np.where(finite, (values - mean) / np.where(finite, sigmas, 1.0), 0.0) ** 2).sum(0)
    freedom = np.maximum(finite.sum(0) - 1, 0)
    scatter = tuple((float(one), int(free)) for one, free in zip(chi_square, freedom, strict=True))
    return _WeightedMean(shared.sum(0), shared.sum(0) ** 2 - (shared**2).sum(0), scatter)


def _widened(covariance: Array, added: Array) -> Array:
    """The covariance with the ``added`` variances (10,) and the same correlations."""
    variance = np.diag(covariance)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.sqrt(1 + np.where(added > 0, added / variance, 0.0))
    return np.asarray(covariance * factor[:, None] * factor)


def is_body(values: Array) -> bool:
    """Whether the inertia of the ten quantities (10,) is positive definite, or has no value at all."""
    inertia = values[:6]
    finite = np.isfinite(inertia)
    return bool(np.linalg.eigvalsh(tensor(inertia))[0] > 0) if finite.all() else not finite.any()


def _bare(piece: Piece) -> tuple[Array, Array]:
    """Values and covariance from the log alone, without known values and with exact thrust."""
    values, covariance = piece.values.copy(), piece.covariance.copy()
    finite = np.isfinite(values) & np.isfinite(np.diag(covariance))
    values[~finite] = np.nan
    # reverse order of the estimator, which conditions on the CG last
    for group in (CG, [name for name in QUANTITIES if name not in CG]):
        without = _without(values, covariance, {name: one for name, one in piece.known.items() if name in group})
        values, covariance = _by_first_moment(group[0], piece, values, *without)
    slope = piece.by_scale(values)
    covariance = covariance - piece.scale_sigma**2 * np.outer(slope, slope)
    return values, covariance


def _without(values: Array, covariance: Array, known: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """A Gaussian (10,), (10, 10) without the information of known values; NaN where no other information exists."""
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
    informed = np.diag(information) > ROUNDING * before
    values[at[~informed]] = np.nan
    at, information, vector = at[informed], information[np.ix_(informed, informed)], vector[informed]
    spread = np.linalg.inv(information)
    values[at], covariance[np.ix_(at, at)] = spread @ vector, spread
    return values, covariance


def linear(values: Array, curved: bool, bearing: BearingBody | None = None) -> tuple[Array, Array]:
    """Parameters θ (10,) of the ten quantities (10,), NaN where these are, and the (10, 10) derivative.

    ``curved``: whether θ has J = I⁻¹ instead of I. ``bearing``: the air bearing, if all ten have values.
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
    """θ and its covariance from the ten quantities; without a bearing also the inverse, as I = J⁻¹ and m = 1/(1/m)."""
    theta, slope = linear(values, curved, bearing)
    at = np.isfinite(values)
    transformed_covariance = np.full((10, 10), np.nan)
    transformed_covariance[np.ix_(at, at)] = (slope[np.ix_(at, at)] @ covariance[np.ix_(at, at)]) @ slope[np.ix_(at, at)].T
    return theta, transformed_covariance


def _back(bearing: BearingBody, theta: Array, covariance: Array) -> tuple[Array, Array]:
    """Ten quantities and their covariance from θ on a bearing."""
    slope, values = _slope_about(bearing, theta), bearing.parameters(theta)
    values[9] = 1 / theta[9]
    return values, slope @ covariance @ slope.T


def _slope_about(bearing: BearingBody, theta: Array) -> Array:
    """(10, 10) derivative of the ten quantities with respect to θ on a bearing."""
    slope = bearing.slopes(theta)
    slope[9] /= -(theta[9] ** 2)
    return slope


def _information(values: Array, covariance: Array) -> tuple[Array, Array]:
    """(10, 10) information matrix and (10,) information vector; zero without a value."""
    at = np.flatnonzero(np.isfinite(values))
    information, vector = np.zeros((10, 10)), np.zeros(10)
    if len(at):
        size = np.sqrt(np.diag(covariance)[at])
        scaled = np.linalg.inv(covariance[np.ix_(at, at)] / np.outer(size, size)) / np.outer(size, size)
        information[np.ix_(at, at)] = scaled
        vector[at] = scaled @ values[at]
    return information, vector


def _solved(information: Sequence[Array], vectors: Sequence[Array]) -> tuple[Array, Array]:
    """Values and covariance by the sum of information matrices and vectors; NaN without information."""
    total, vector = sum(information, np.zeros((10, 10))), sum(vectors, np.zeros(10))
    at = np.flatnonzero(np.diag(total) > 0)
    values, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
    if len(at):
        size = 1 / np.sqrt(np.diag(total)[at])
        spread = np.linalg.inv(total[np.ix_(at, at)] * np.outer(size, size)) * np.outer(size, size)
        values[at], covariance[np.ix_(at, at)] = spread @ vector[at], spread
    return values, covariance


def _deviates(number: int, linear: Sequence[tuple[Array, Array]], informed: Sequence[tuple[Array, Array]]) -> Array:
    """(10,) normal deviates of one piece from all others together."""
    rest = [one for i, one in enumerate(informed) if i != number]
    others, spread = _solved([information for information, _ in rest], [vector for _, vector in rest])
    values, covariance = linear[number]
    with np.errstate(invalid="ignore"):
        return np.asarray((values - others) / np.sqrt(np.diag(covariance) + np.diag(spread)))


def with_shared(values: Array, covariance: Array, pieces: Sequence[Piece]) -> tuple[Array, Array]:
    """Values and covariance with the common thrust uncertainty, and with each known value once."""
    slope = pieces[0].by_scale(values)
    # all logs have the same thrust, so the largest sigma applies
    covariance = covariance + max(piece.scale_sigma for piece in pieces) ** 2 * np.outer(slope, slope)
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
    """Values and covariance after conditioning; on a bearing the step is linear in the first moment."""
    if piece.bearing is None:
        return after, covariance
    values, slope = by_first_moment(name, before[None], after[None], piece.bearing.bearing_mass)
    return values[0], transformed(covariance[None], slope)[0]


def docked_object(vehicles: tuple[VehicleInfo, VehicleInfo], single: PhaseItem, combined: PhaseItem) -> DockedObject:
    """Docked object: the combined body minus the vehicle alone, with a common thrust scale and without the bearings' masses."""
    bearings = [vehicle.bearing_mass_kg for vehicle in vehicles]
    scale = vehicles[0].thrust_scale_sigma
    values, joint_covariance = np.empty(20), np.zeros((20, 20))
    for half, phase in enumerate((single, combined)):
        part = slice(10 * half, 10 * half + 10)
        values[part] = [np.nan if item.value is None else item.value for item in phase.estimates.values()]
        joint_covariance[part, part] = np.array(phase.covariance, dtype=float)
    if not single.known and not combined.known:
        # known values calibrate the scale of each side separately
        alone, both = (
            by_scale_beside(half, vehicle.bearing_mass_kg, np.array(vehicle.bearing_position_m))
            for half, vehicle in zip(values.reshape(2, 10), vehicles, strict=True)
        )
        joint_covariance[:10, 10:] = scale**2 * np.outer(alone, both)
        joint_covariance[10:, :10] = joint_covariance[:10, 10:].T
    unused = docking.without_effect(vehicles[0].environment)
    both_sides = np.tile(unused, 2)  # the others do not depend on these
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
    estimates = estimate_items(docking.docked_estimates(found, covariance, verdict, reason, unused))
    covariance[unused], covariance[:, unused] = np.nan, np.nan
    return DockedObject(
        before=single.name, after=combined.name, estimates=estimates, covariance=matrix(covariance), contradiction="; ".join(contradictions)
    )


def known_object(
    single: PhaseItem, combined: PhaseItem, found: tuple[Array, Array], known: Mapping[str, tuple[float, float]]
) -> DockedObject:
    """Docked object from a stated one; ``found`` (10,), (10, 10) is its estimate with the logs."""
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
    """Warning of a negative mass of the docked object."""
    mass = None if docked is None else docked.estimates["mass"]
    if mass is None or mass.value is None or mass.reason_code != "docked-lighter":
        return []
    return [WarningItem(code="docked-mass", message=str(_swapped(mass.value)))]


def _swapped(mass: float) -> Reason:
    return docking.negative_mass(mass, "the vehicle of --after", "the vehicle of --before", "check whether the two are swapped")
