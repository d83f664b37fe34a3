"""Contradictions between log and vehicle file, and the quantities that each affects.

- A named fault (unit, jet, delay, saturated sensor) affects every quantity. Excepted are quantities with the same value and sigma in the
  corrected log, if that has no contradiction and is about as informative.
- A contradicted known value affects quantities that are proportional to the thrust (inertia, mass). A known CG, or a pivot, affects all,
  because the first moment has the scale of the inertia.
- A misfit without a named cause affects quantities whose possible error exceeds their sigma by far. It is a correlation of the residuals
  with commands or motion (:mod:`massprop_cli.diagnosis.lackoffit`), or a disturbance larger than the commands.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CERTAIN, CHANCE, GROSS
from massprop_cli.conclude.physical import breach
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import POSITIVE, Conclusion, Estimate
from massprop_cli.diagnosis.fault import Fault
from massprop_cli.diagnosis.lackoffit import correlation, hidden_error, innovation_test
from massprop_cli.estimate.disturbances import BEYOND, UNEXPLAINED, beyond_commands
from massprop_cli.estimate.history import History
from massprop_cli.estimate.phases import deviation
from massprop_cli.estimate.quantities import by_scale, in_common
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source

TOO_SMALL = 1.5
"""Largest error, sigmas, by sigmas that the innovation test shows to be too small."""
MATTERS = 1e-3
"""Least error of a quantity, relative to its size."""
AGREES, ALIKE = 1.0, 1.5
"""Largest difference of a corrected value, sigmas, and largest ratio of the sigmas, of an unaffected quantity."""
STRAINED = 3.0
"""Largest median ratio of corrected to stated sigmas of an effective correction."""
INFORMED = ("converged", "not_converged")
PROPORTIONAL = (*INERTIA, "mass")


@dataclass(frozen=True)
class Contradiction:
    """Contradiction between log and vehicle file in one phase."""

    causes: tuple[Reason, ...]
    affected: BoolArray
    """(10,) contradicted quantities."""


def fault_contradiction(
    conclusion: Conclusion, faults: Sequence[Fault], corrected: Sequence[Conclusion | None], rivals: Sequence[Array] = ()
) -> Contradiction | None:
    """Contradiction by named faults; None without one.

    ``corrected`` holds the phase's conclusion with each fault corrected, None without a correction. ``rivals`` are the values (10,) of
    off-line fits with other possible causes corrected.
    """
    if not faults:
        return None
    affected = np.ones(10, dtype=bool)
    differs = np.zeros(10, dtype=bool)
    for values in rivals:
        differs |= ~(np.abs(values - conclusion.values) <= AGREES * conclusion.sigmas)
    for one in corrected:
        if one is not None and all(fault.cure is not None for fault in faults) and _is_effective(conclusion, one, differs):
            affected &= [not _same(conclusion.estimates[name], one.estimates[name]) for name in QUANTITIES]
    affected |= differs
    return Contradiction(tuple(dict.fromkeys(Reason.of("named-fault", message=fault.notice.message) for fault in faults)), affected)


def _is_effective(stated: Conclusion, corrected: Conclusion, differs: BoolArray) -> bool:
    """Whether the corrected log has no contradiction and is about as informative, except on quantities where a rival ``differs``.

    Otherwise there is another fault, or an estimated disturbance replaces it.
    """
    if corrected.contradiction:
        return False
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (corrected.sigmas / stated.sigmas)[~differs]
    ratio = ratio[np.isfinite(ratio)]
    return not ratio.size or median(ratio) < STRAINED


def _same(stated: Estimate, corrected: Estimate) -> bool:
    """Whether two estimates agree in value, sigma and verdict."""
    if stated.value is None or corrected.value is None or not stated.sigma or not corrected.sigma or corrected.verdict not in INFORMED:
        return False
    sigma = min(stated.sigma, corrected.sigma)
    if stated.verdict == "converged" != corrected.verdict:
        return False  # a doubt about the corrected estimate also applies to the stated one
    return abs(stated.value - corrected.value) <= AGREES * sigma and max(stated.sigma, corrected.sigma) <= ALIKE * sigma


def known_value_contradiction(history: History, vehicle: Vehicle) -> Contradiction | None:
    """Contradiction of known values by the log; None without one."""
    if not history.contradicted:
        return None
    every = vehicle.pivoted or any(name in CG for name in history.contradicted)  # gravity gives mass × offset
    with np.errstate(invalid="ignore"):
        moved = np.abs(history.values[-1] - history.bare[0]) > history.sigmas[-1]
    affected = moved | np.array([every or name in PROPORTIONAL for name in QUANTITIES])
    return Contradiction(tuple(Reason.of("known-mismatch", message=message) for message in history.contradicted.values()), affected)


def disturbance_contradiction(conclusion: Conclusion, used: Vehicle, stated: Vehicle, samples: Source) -> Contradiction | None:
    """Contradiction by an estimated disturbance larger than the effect of the commands; None without one."""
    beyond = beyond_commands(used, stated, samples)
    if beyond is None:
        return None
    reported = np.array([one.value is not None for one in conclusion.estimates.values()])
    message = UNEXPLAINED + BEYOND.format(torque=beyond[0], commanded=beyond[1])
    return Contradiction((Reason.of("beyond-commands", message=message),), reported)


def misfit_contradiction(
    conclusion: Conclusion, settled: History, samples: Source, vehicle: Resolved, stated: Vehicle
) -> tuple[Contradiction | None, Array]:
    """Contradiction by a misfit without a named cause, or None; (6,) factors by which the sigmas from each channel are too small.

    The factors are those of :func:`massprop_cli.diagnosis.lackoffit.innovation_test`.
    """
    spread = correlation(stated)
    factors = innovation_test(settled, samples, spread)
    if settled.reference is None:
        return None, factors
    hidden = hidden_error(settled, samples, vehicle, spread)
    total = settled.information_share.sum(1)
    share = settled.information_share / np.where(total > 0, total, 1.0)[:, None]
    inflation = np.sqrt(np.maximum(share @ factors**2 - 1, 0.0) * _noise_variance(conclusion, vehicle))
    sizes = settled.natural_sizes.copy()
    values = conclusion.values
    sizes[POSITIVE] = np.fmin(sizes[POSITIVE], np.abs(values[POSITIVE]))
    sigma = conclusion.sigmas
    error = np.maximum(hidden / CERTAIN, inflation / TOO_SMALL)  # over the largest allowed number of sigmas
    informed = np.array([e.verdict in INFORMED for e in conclusion.estimates.values()])
    with np.errstate(invalid="ignore"):
        affected = informed & (error > sigma) & (np.maximum(hidden, inflation) > MATTERS * sizes)
    variance = float(settled.moments().variance.max())
    if variance > GROSS and informed.any():
        return Contradiction((Reason.of("innovations-too-large", ratio=variance**0.5),), informed), factors
    if not affected.any():
        return None, factors
    names = ", ".join(name for name, hit in zip(QUANTITIES, affected, strict=True) if hit)
    worst = int(np.nanargmax(np.where(affected, error / sigma, np.nan)))
    error_sigmas = float(max(hidden[worst], inflation[worst]) / sigma[worst])
    return Contradiction(
        (Reason.of("residuals-follow", quantities=names, worst=QUANTITIES[worst], sigmas=error_sigmas),), affected
    ), factors


def unknown_cause(conclusion: Conclusion, vehicle: Vehicle) -> dict[str, Reason]:
    """Reasons, by quantity, against the verdict "converged" if the cause of a misfit is unknown: the sigma omits its effect.

    This also applies if all likely causes give the same value, because the true cause may be another. Quantities whose sigma comes mostly
    from the stated thrust uncertainty or known values keep their verdict.
    """
    by_noise = _noise_variance(conclusion, vehicle) > conclusion.sigmas**2 / 2
    return {name: Reason("cause-unknown") for name, hit in zip(QUANTITIES, by_noise, strict=True) if hit}


def _noise_variance(conclusion: Conclusion, vehicle: Vehicle) -> Array:
    """(10,) variance of each value without the parts of the stated thrust scale and of known values."""
    known: dict[str, float] = {name: one.sigma for name, one in vehicle.in_phase(conclusion.phase).known.items()}
    common = in_common(by_scale(conclusion.values, vehicle), conclusion.covariance, known, vehicle)
    return np.asarray(np.maximum(conclusion.sigmas**2 - common**2, 0.0))


def divergence_contradiction(causal: History, settled: History) -> Contradiction | None:
    """Contradiction by a causal estimate that diverged from the off-line fit, or that has no fit to be tested against; None without one."""
    if np.isnan(settled.bare[0]).all():
        estimated = np.isfinite(causal.bare[0])
        return Contradiction((Reason.of("fit-lost"),), estimated) if estimated.any() else None
    distance = deviation(causal, settled)
    affected = distance > CHANCE
    if not affected.any():
        return None
    worst = int(np.nanargmax(np.where(affected, distance, np.nan)))
    return Contradiction((Reason.of("causal-estimate-lost", worst=QUANTITIES[worst], sigmas=float(distance[worst])),), affected)


def unphysical_contradiction(conclusion: Conclusion) -> Contradiction | None:
    """Contradiction by an impossible body: inertia not positive definite beyond its sigmas, or denser than any matter; None without one."""
    found = breach(conclusion)
    if found is None or not found.certain:
        return None
    if not found.too_dense and not (found.of_inertia and conclusion.principal_moments[0] <= 0):
        return None
    affected = PROPORTIONAL if found.too_dense else INERTIA
    return Contradiction((Reason.of("no-body", breach=found.message),), np.array([name in affected for name in QUANTITIES]))


def combined(found: Sequence[Contradiction | None]) -> Contradiction | None:
    """Combination of a phase's contradictions, in order; omits those that affect no further quantity."""
    affected: BoolArray = np.zeros(10, dtype=bool)
    causes: list[Reason] = []
    for one in found:
        if one is not None and (one.affected & ~affected).any():
            causes += one.causes
            affected = affected | one.affected
    return Contradiction(tuple(dict.fromkeys(causes)), affected) if causes else None
