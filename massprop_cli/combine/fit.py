"""Several logs of one body fitted at once, where one alone doesn't tell every axis: its result can't be added to others."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.combine import logs
from massprop_cli.combine.joint import Joint, Piece, with_shared
from massprop_cli.conclude.verdict import PLANAR
from massprop_cli.diagnosis.preprocessing import Ready
from massprop_cli.estimate import disturbances, noiselevels, offline
from massprop_cli.estimate.initial import early_reference
from massprop_cli.estimate.jointly import JointFit as Fit
from massprop_cli.estimate.jointly import Jointly, Member
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.estimate.quantities import alone, quantities
from massprop_cli.inputs.equipment import EnvironmentKind
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import MU
from massprop_cli.result.schema import Result
from massprop_cli.testbed.bound import natural_sizes

KNOWN = 0.1
"""Relative sigma of a moment of inertia above which a result is no Gaussian in J = I⁻¹: it is not added, its log is."""
LEFT = 2.0
"""Chi-square per measurement that a fit may leave; with more it has got lost, and is begun elsewhere."""
UNTOLD = 1.0
"""Part of its natural size above which a sigma says nothing at all."""


@dataclass(frozen=True)
class Behind:
    """A result with its log made ready, and the phase of it that counts."""

    result: Result
    ready: Ready
    phase: str


def partial(piece: Piece, environment: EnvironmentKind) -> bool:
    """Whether a result tells inertia and CG in some axes alone, of those that its environment lets move."""
    moving = [i for i, name in enumerate(QUANTITIES[:9]) if environment != "planar" or name in PLANAR]
    moments = [i for i in moving if i in (0, 3, 5)]
    sigma = np.sqrt(np.diag(piece.covariance))
    told = np.isfinite(piece.values[moving]).all() and np.isfinite(sigma[moving]).all()
    return not (told and (sigma[moments] < KNOWN * np.abs(piece.values[moments])).all())


def without_inertia(piece: Piece) -> Piece:
    """What it can add where its log can't be had."""
    values, covariance = _without(piece.values, piece.covariance, np.arange(10) < 6)
    return replace(piece, values=values, covariance=covariance)


def _without(values: Array, covariance: Array, untold: BoolArray) -> tuple[Array, Array]:
    """NaN where nothing is told."""
    return np.where(untold, np.nan, values), np.where(untold[:, None] | untold, np.nan, covariance)


def fitted(behind: Sequence[Behind], pieces: Sequence[Piece]) -> Joint | None:
    """What all logs say at once, with what is shared once; None where they don't move at all."""
    members = [_member(one, one.ready.stated) for one in behind]
    found = _fit(members)
    if found is None:
        return None
    strange = [_misfits(one, member, found) for one, member in zip(behind, members, strict=True)]
    if any(strange):
        chosen = zip(behind, members, strange, strict=True)
        members = [_member(one, logs.sized(one.result, one.ready.stated)) if odd else member for one, member, odd in chosen]
        found = _fit(members) or found
    bare = _quantities(found, members[0].vehicle)
    values, covariance = with_shared(*bare, pieces)
    chi_square, freedom = (sum(part) for part in zip(*found.apart, strict=True))
    untold = tuple(np.full(10, np.nan) for _ in pieces)
    return Joint(
        values,
        covariance,
        bare,
        float(chi_square),
        int(freedom) - int(np.isfinite(values).sum()),
        untold,
        untold,
        found.apart,
        tuple(strange),
    )


def _member(one: Behind, vehicle: Vehicle) -> Member:
    ready = one.ready
    used, _ = noiselevels.with_noise_levels(ready.samples, [cycles for _, cycles in ready.phases], vehicle)
    phase, cycles = next((phase, cycles) for phase, cycles in ready.phases if phase.name == one.phase)
    return Member(ready.samples, cycles, used.in_phase(phase), ready.consider)


def _fit(members: Sequence[Member]) -> Fit | None:
    """Begun about what one log after the other gives, until all are explained; else the one that leaves least."""
    rows = 6 * sum(member.cycles.stop - member.cycles.start for member in members)
    best: Fit | None = None
    for member in members:
        start = early_reference(member.samples, member.cycles, member.vehicle)
        if start is None:
            continue
        found = Jointly(members).fit(start)
        if best is None or found.chi_square < best.chi_square:
            best = found
        if found.converged and found.chi_square < LEFT * rows:
            break
    return best


def _misfits(one: Behind, member: Member, found: Fit) -> bool:
    """Whether a log isn't explained by its stated noise, whatever the body."""
    phase = next(phase for phase, _ in one.ready.phases if phase.name == one.phase)
    own = offline.fit(member.samples, member.cycles, phase, found.reference, member.vehicle, member.consider, 1, tied=True)
    return not np.isnan(disturbances.misfit([own.history], member.vehicle)).all()


def _quantities(found: Fit, vehicle: Vehicle) -> tuple[Array, Array]:
    """(10,), (10, 10) by the logs alone; on a pedestal the nine about the pivot, and no mass."""
    values, covariance = quantities(found.parameters, alone(vehicle))
    if vehicle.on_pedestal:
        nine, spread = about_pivot(values, covariance, np.array(vehicle.environment.bearing_position_m), 1 / found.parameters.mean[:, MU])
        values, covariance = np.full((1, 10), np.nan), np.full((1, 10, 10), np.nan)
        values[:, :9], covariance[:, :9, :9] = nine, spread
    return _without(values[0], covariance[0], np.sqrt(np.diag(covariance[0])) > UNTOLD * natural_sizes(values[0]))
