"""Joint fit of several logs of one body, for logs that inform some axes only: their results are not Gaussian and cannot be combined."""

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
"""Largest relative sigma of a moment of inertia of a result that is Gaussian in J = I⁻¹."""
CONVERGED = 2.0
"""Largest chi-square per measurement of a converged fit; above it, another start is tried."""
UNINFORMED = 1.0
"""Largest sigma of a reported quantity, as a part of its natural size."""


@dataclass(frozen=True)
class FittedLog:
    """A result with its preprocessed log and one of its phases."""

    result: Result
    ready: Ready
    phase: str


def partial(piece: Piece, environment: EnvironmentKind) -> bool:
    """Whether a result informs inertia and CG in some axes only, of those that move in its environment."""
    moving = [i for i, name in enumerate(QUANTITIES[:9]) if environment != "planar" or name in PLANAR]
    moments = [i for i in moving if i in (0, 3, 5)]
    sigma = np.sqrt(np.diag(piece.covariance))
    finite = np.isfinite(piece.values[moving]).all() and np.isfinite(sigma[moving]).all()
    return not (finite and (sigma[moments] < KNOWN * np.abs(piece.values[moments])).all())


def without_inertia(piece: Piece) -> Piece:
    """The result without its inertia, which is not Gaussian."""
    values, covariance = _without(piece.values, piece.covariance, np.arange(10) < 6)
    return replace(piece, values=values, covariance=covariance)


def _without(values: Array, covariance: Array, omitted: BoolArray) -> tuple[Array, Array]:
    """Values and covariance with NaN for the ``omitted`` quantities (10,)."""
    return np.where(omitted, np.nan, values), np.where(omitted[:, None] | omitted, np.nan, covariance)


def fitted(fitted_logs: Sequence[FittedLog], pieces: Sequence[Piece]) -> Joint | None:
    """Joint fit of all logs, with common thrust uncertainty and known values once; None if no log has motion.

    Logs with a misfit are fitted again with the disturbances that their own estimates needed.
    """
    members = [_member(one, one.ready.stated) for one in fitted_logs]
    found = _fit(members)
    if found is None:
        return None
    unexplained = [_has_misfit(one, member, found) for one, member in zip(fitted_logs, members, strict=True)]
    if any(unexplained):
        chosen = zip(fitted_logs, members, unexplained, strict=True)
        members = [_member(one, logs.sized(one.result, one.ready.stated)) if misfit else member for one, member, misfit in chosen]
        found = _fit(members) or found
    bare = _quantities(found, members[0].vehicle)
    values, covariance = with_shared(*bare, pieces)
    chi_square, freedom = (sum(part) for part in zip(*found.apart, strict=True))
    unknown = tuple(np.full(10, np.nan) for _ in pieces)
    return Joint(
        values,
        covariance,
        bare,
        float(chi_square),
        int(freedom) - int(np.isfinite(values).sum()),
        unknown,
        unknown,
        found.apart,
        tuple(unexplained),
    )


def _member(one: FittedLog, vehicle: Vehicle) -> Member:
    """One log of the joint fit, with the noise levels of ``vehicle``."""
    ready = one.ready
    used, _ = noiselevels.with_noise_levels(ready.samples, [cycles for _, cycles in ready.phases], vehicle)
    phase, cycles = next((phase, cycles) for phase, cycles in ready.phases if phase.name == one.phase)
    return Member(ready.samples, cycles, used.in_phase(phase), ready.consider)


def _fit(members: Sequence[Member]) -> Fit | None:
    """Joint fit from the first log's initial estimate that converges; else the fit with the least chi-square. None without motion."""
    rows = 6 * sum(member.cycles.stop - member.cycles.start for member in members)
    best: Fit | None = None
    for member in members:
        start = early_reference(member.samples, member.cycles, member.vehicle)
        if start is None:
            continue
        found = Jointly(members).fit(start)
        if best is None or found.chi_square < best.chi_square:
            best = found
        if found.converged and found.chi_square < CONVERGED * rows:
            break
    return best


def _has_misfit(one: FittedLog, member: Member, found: Fit) -> bool:
    """Whether the stated noise does not explain a log with a body of its own."""
    phase = next(phase for phase, _ in one.ready.phases if phase.name == one.phase)
    own = offline.fit(member.samples, member.cycles, phase, found.reference, member.vehicle, member.consider, 1, tied=True)
    return not np.isnan(disturbances.misfit([own.history], member.vehicle)).all()


def _quantities(found: Fit, vehicle: Vehicle) -> tuple[Array, Array]:
    """(10,) quantities and (10, 10) covariance from the logs alone; on a pedestal the nine about the pivot, and no mass."""
    values, covariance = quantities(found.parameters, alone(vehicle))
    if vehicle.on_pedestal:
        nine, spread = about_pivot(values, covariance, np.array(vehicle.environment.bearing_position_m), 1 / found.parameters.mean[:, MU])
        values, covariance = np.full((1, 10), np.nan), np.full((1, 10, 10), np.nan)
        values[:, :9], covariance[:, :9, :9] = nine, spread
    return _without(values[0], covariance[0], np.sqrt(np.diag(covariance[0])) > UNINFORMED * natural_sizes(values[0]))
