"""Contradictions between log and vehicle file, and the quantities that each affects.

Three things contradict: a fault that has a name (a unit, a jet, the delay, a saturated sensor), a value known from elsewhere that the log
does not bear out, and a misfit without a name: what the model leaves still follows the commands or the motion after all noise was sized
(:mod:`massprop_cli.diagnosis.lackoffit`), or it would be a disturbance larger than the vehicle's own commands. A value is touched

- by a named fault, unless the log, corrected, contradicts nothing any more, tells as much as it seemed to, and gives the same value and
  sigma;
- by a contradicted known value, if it is proportional to the thrust as that one is (mass, inertia), or all for a known CG or on a pedestal,
  where the first moment has the scale of inertia;
- by a misfit that no named fault stands for, if the log claims to tell it and what the misfit may have done to it exceeds its sigma by far.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.physical import breach
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import POSITIVE, Conclusion, Estimate
from massprop_cli.diagnosis.fault import Fault
from massprop_cli.diagnosis.lackoffit import correlation, hidden_error, innovation_test
from massprop_cli.estimate.disturbances import BEYOND, UNEXPLAINED, beyond_commands
from massprop_cli.estimate.history import History
from massprop_cli.estimate.phases import LOST, deviation
from massprop_cli.estimate.quantities import by_scale, in_common
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source

HIDDEN = 5.0
"""Sigmas that the hidden error may be, being a bound: most of a misfit is no error of the values. docs/faults.md moves with it."""
TOO_SMALL = 1.5
"""... and by how much a sigma may be too small as the innovations show it."""
GROSS = 4.0
"""Mean squared innovation in a channel beyond which nothing of the phase holds: noise was sized in vain."""
MATTERS = 1e-3
"""Part of its own size below which an error of a quantity is none."""
AGREES, ALIKE = 1.0, 1.5
"""Sigmas within which a corrected value is the same, and the ratio within which its sigma is."""
STRAINED = 3.0
"""By how much wider most of the corrected sigmas may be."""
TOLD = ("converged", "not_converged")
PROPORTIONAL = (*INERTIA, "mass")


@dataclass(frozen=True)
class Contradiction:
    """What contradicts in one phase."""

    causes: tuple[Reason, ...]
    touched: BoolArray
    """(10,)"""


def by_faults(
    conclusion: Conclusion, faults: Sequence[Fault], mended: Sequence[Conclusion | None], rivals: Sequence[Array] = ()
) -> Contradiction | None:
    """Of named faults.

    ``mended`` holds what each one's remedy gives for this phase, None where there is no remedy or it is none; ``rivals`` the values (10,)
    by off-line fits if a cause is corrected instead that can't be ruled out.
    """
    if not faults:
        return None
    touched = np.ones(10, dtype=bool)
    apart = np.zeros(10, dtype=bool)
    for values in rivals:
        apart |= ~(np.abs(values - conclusion.values) <= AGREES * conclusion.sigmas)
    for found in mended:
        if found is not None and all(fault.cure is not None for fault in faults) and _settles(conclusion, found, apart):
            touched &= [not _same(conclusion.estimates[name], found.estimates[name]) for name in QUANTITIES]
    touched |= apart
    return Contradiction(tuple(dict.fromkeys(Reason.of("named-fault", message=fault.notice.message) for fault in faults)), touched)


def _settles(stated: Conclusion, mended: Conclusion, apart: BoolArray) -> bool:
    """Whether the log, corrected, contradicts nothing and tells most of what it seemed to as sharply, but for what rivals put ``apart``.

    Else there is more, or a torque stands for what is left.
    """
    if mended.contradiction:
        return False
    with np.errstate(divide="ignore", invalid="ignore"):
        wider = (mended.sigmas / stated.sigmas)[~apart]
    wider = wider[np.isfinite(wider)]
    return not wider.size or median(wider) < STRAINED


def _same(one: Estimate, other: Estimate) -> bool:
    if one.value is None or other.value is None or not one.sigma or not other.sigma or other.verdict not in TOLD:
        return False
    sigma = min(one.sigma, other.sigma)
    if one.verdict == "converged" != other.verdict:
        return False  # a doubt of the corrected log's is one of the log's
    return abs(one.value - other.value) <= AGREES * sigma and max(one.sigma, other.sigma) <= ALIKE * sigma


def by_known(history: History, vehicle: Vehicle) -> Contradiction | None:
    """Of known quantities that lie too far from what the log says."""
    if not history.contradicted:
        return None
    turned = vehicle.pivoted or any(name in CG for name in history.contradicted)  # gravity gives mass times offset
    with np.errstate(invalid="ignore"):
        moved = np.abs(history.values[-1] - history.bare[0]) > history.sigmas[-1]
    touched = moved | np.array([turned or name in PROPORTIONAL for name in QUANTITIES])
    return Contradiction(tuple(Reason.of("known-mismatch", message=message) for message in history.contradicted.values()), touched)


def by_size(conclusion: Conclusion, used: Vehicle, stated: Vehicle, samples: Source) -> Contradiction | None:
    """Of a disturbance that would be larger than what the vehicle's own commands do."""
    beyond = beyond_commands(used, stated, samples)
    if beyond is None:
        return None
    given = np.array([one.value is not None for one in conclusion.estimates.values()])
    return Contradiction((Reason.of("beyond-commands", message=UNEXPLAINED + BEYOND.format(torque=beyond[0], commanded=beyond[1])),), given)


def by_misfit(
    conclusion: Conclusion, settled: History, samples: Source, vehicle: Resolved, stated: Vehicle
) -> tuple[Contradiction | None, Array]:
    """Of a misfit that has no name; with the factors (6,) of :func:`massprop_cli.diagnosis.lackoffit.innovation_test`."""
    spread = correlation(stated)
    factors = innovation_test(settled, samples, spread)
    if settled.reference is None:
        return None, factors
    hidden = hidden_error(settled, samples, vehicle, spread)
    total = settled.information_share.sum(1)
    share = settled.information_share / np.where(total > 0, total, 1.0)[:, None]
    loose = np.sqrt(np.maximum(share @ factors**2 - 1, 0.0) * _own_variance(conclusion, vehicle))
    sizes = settled.natural_sizes.copy()
    values = conclusion.values
    sizes[POSITIVE] = np.fmin(sizes[POSITIVE], np.abs(values[POSITIVE]))
    sigma = conclusion.sigmas
    error = np.maximum(hidden / HIDDEN, loose / TOO_SMALL)  # as many sigmas as it may be
    told = np.array([e.verdict in TOLD for e in conclusion.estimates.values()])
    with np.errstate(invalid="ignore"):
        touched = told & (error > sigma) & (np.maximum(hidden, loose) > MATTERS * sizes)
    variance = float(settled.moments().variance.max())
    if variance > GROSS and told.any():
        return Contradiction((Reason.of("innovations-too-large", ratio=variance**0.5),), told), factors
    if not touched.any():
        return None, factors
    names = ", ".join(name for name, hit in zip(QUANTITIES, touched, strict=True) if hit)
    worst = int(np.nanargmax(np.where(touched, error / sigma, np.nan)))
    off = float(max(hidden[worst], loose[worst]) / sigma[worst])
    return Contradiction((Reason.of("residuals-follow", quantities=names, worst=QUANTITIES[worst], sigmas=off),), touched), factors


def unheld(conclusion: Conclusion, vehicle: Vehicle) -> dict[str, Reason]:
    """Why values are not to be called converged where the cause of a misfit is unknown: their sigmas are none of what it may do to them.

    That holds where several causes would correct the log, too, and all of them give the same value: the true one may be another. Those that
    stay are as uncertain as the thrust is stated to be, which is more.
    """
    by_noise = _own_variance(conclusion, vehicle) > conclusion.sigmas**2 / 2
    return {name: Reason("cause-unknown") for name, hit in zip(QUANTITIES, by_noise, strict=True) if hit}


def _own_variance(conclusion: Conclusion, vehicle: Vehicle) -> Array:
    """(10,) variance of each value that the log's noise makes: without the thrust's stated scale, and what is known."""
    known: dict[str, float] = {name: one.sigma for name, one in vehicle.in_phase(conclusion.phase).known.items()}
    common = in_common(by_scale(conclusion.values, vehicle), conclusion.covariance, known, vehicle)
    return np.asarray(np.maximum(conclusion.sigmas**2 - common**2, 0.0))


def by_lost(causal: History, settled: History) -> Contradiction | None:
    """Of a causal estimate that lost its way where no fit stands that could lead it, or that no fit tests."""
    if np.isnan(settled.bare[0]).all():
        told = np.isfinite(causal.bare[0])
        return Contradiction((Reason.of("fit-lost"),), told) if told.any() else None
    away = deviation(causal, settled)
    touched = away > LOST
    if not touched.any():
        return None
    worst = int(np.nanargmax(np.where(touched, away, np.nan)))
    return Contradiction((Reason.of("causal-estimate-lost", worst=QUANTITIES[worst], sigmas=float(away[worst])),), touched)


def by_no_body(conclusion: Conclusion) -> Contradiction | None:
    """An inertia that no body has: not positive definite by more than its sigmas allow, or with its mass denser than all matter."""
    found = breach(conclusion)
    if found is None or not found.certain:
        return None
    if not found.no_matter and not (found.of_inertia and conclusion.principal_moments[0] <= 0):
        return None
    touched = PROPORTIONAL if found.no_matter else INERTIA
    return Contradiction((Reason.of("no-body", breach=found.said),), np.array([name in touched for name in QUANTITIES]))


def together(found: Sequence[Contradiction | None]) -> Contradiction | None:
    """All that contradicts in a phase; a cause counts if it touches what those before it do not."""
    touched: BoolArray = np.zeros(10, dtype=bool)
    causes: list[Reason] = []
    for one in found:
        if one is not None and (one.touched & ~touched).any():
            causes += one.causes
            touched = touched | one.touched
    return Contradiction(tuple(dict.fromkeys(causes)), touched) if causes else None
