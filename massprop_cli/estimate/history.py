"""Result of every estimator: one row per control cycle of one phase."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, IntArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.moments import Moments
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.prepare.stream import Stream

if TYPE_CHECKING:
    from massprop_cli.estimate.residual import Residual


class Stages(NamedTuple):
    """Estimates from the first part of a log, up to S of its cycles, linear about its last estimate: ixx … izz, CG and 1/m."""

    ends: IntArray
    """(S,) end of each part, exclusive."""
    mean: Array
    """(S, 10) departure from the last estimate."""
    variance: Array
    """(S, 10) variance of each."""


@dataclass(frozen=True)
class History:
    """The estimate after each cycle; NaN where there is none yet.

    An off-line fit that is not itself a result has only the last row of the estimates, but all normalised innovations.
    """

    phase: Phase
    cycles: slice
    """The log's cycles, one per row."""
    time_s: Array
    """(K,) end of each cycle, s."""
    values: Array
    """(K, 10) ixx … mass, SI units."""
    sigmas: Array
    """(K, 10) one sigma of each."""
    covariance: Array
    """(10, 10) covariance of the last row."""
    innovation: Array
    """(K, 6) torque [N m] and force [N], measured minus predicted."""
    innovation_sigma: Array
    """(K, 6) their predicted sigmas."""
    normalised: Array
    """(K, 6) whitened innovations of rate and specific force: independent standard normal if the model holds; 0 in absent channels."""
    natural_sizes: Array
    """(10,) natural size of each quantity: trace of inertia, √(trace/mass) for the CG, mass."""
    information_share: Array
    """(10, 6) share of each channel in the information on each quantity: rate x y z, specific force x y z."""
    drowned: BoolArray
    """(6,) channels in which disturbances exceed the response to the commands."""
    observable: BoolArray
    """(10,) whether some motion of this vehicle informs the quantity, by this method."""
    bare: tuple[Array, Array]
    """(10,) and (10, 10) the last row from the log alone: without known values and without the common scale of the thrust."""
    pivot: Array | None = None
    """(K, 18) values and sigmas about a fixed pivot (:mod:`massprop_cli.estimate.pivot`); None without one."""
    reference: Reference | None = None
    """Reference of the last row's linearisation; None without one."""
    unsensed: BoolArray = field(default_factory=lambda: np.zeros(10, dtype=bool))
    """(10,) quantities that would be observable if the log had all channels."""
    unread: BoolArray = field(default_factory=lambda: np.zeros(6, dtype=bool))
    """(6,) channels that the log doesn't have."""
    notices: tuple[Notice, ...] = ()
    contradicted: Mapping[str, str] = field(default_factory=dict)
    """Known quantities that the log contradicts, with the reason."""
    unexplained: float = np.inf
    """Chi-square of an off-line fit, without the part by which initial states depart from their prior."""
    residual: Residual | None = None
    """Post-fit residuals of an off-line fit."""
    stages: Callable[[], Stages] | None = None
    """Estimates of an off-line fit from the first part of the log."""

    def __post_init__(self) -> None:
        rows = len(self.time_s)
        if not all(len(a) == rows for a in (self.values, self.sigmas, self.innovation, self.innovation_sigma)):
            raise ValueError("history arrays differ in length")

    def whitened(self) -> Iterator[Array]:
        """(N, 6) normalised innovations of the cycles that have them, in parts."""
        for part in spill.parts(len(self.normalised)):
            rows = self.normalised[part]
            yield rows[np.isfinite(rows).all(1)]

    def moments(self) -> Moments:
        """Moments of the normalised innovations."""
        moments = Moments(6)
        for rows in self.whitened():
            moments.add(rows)
        return moments

    def chi_square(self) -> float:
        """Sum of the squared normalised innovations."""
        moments = self.moments()
        return float(np.nansum(moments.count * moments.variance))

    @property
    def noise_free(self) -> bool:
        """Whether all residuals together are below one sigma, as in a log without noise."""
        return min(self.chi_square(), self.unexplained) < 1.0


def phase_cycles(phase: Phase, end_s: Array, usable: BoolArray) -> slice:
    """Cycles with ``start_s < time_s <= end_s`` whose executed command is known; empty if there are none."""
    inside = np.flatnonzero(usable & (end_s > phase.start_s + 1e-9) & (end_s <= phase.end_s + 1e-9))
    return slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)


def phases_of(log: Log, used: Vehicle, samples: Stream) -> list[tuple[Phase, slice]]:
    """Each phase of the vehicle file, or the whole log, with its cycles; :class:`InputError` if a phase has too few."""
    start_s, length = cycle_edges(log, slice(0, log.cycles))
    start, end = round(float(start_s[0]), 9) + 0.0, round(float(start_s[-1] + length[-1]), 9)  # + 0.0: no minus zero
    phases = []
    for phase in used.phases or (Phase.model_construct(name="all", start_s=start, end_s=end),):
        cycles = phase_cycles(phase, start_s + length, (start_s >= samples.usable_s) & (start_s + length <= samples.until_s))
        if cycles.stop - cycles.start < 2:
            raise InputError(
                f"{log.path}: phase {phase.name!r} ({phase.start_s:g} to {phase.end_s:g} s) holds "
                f"{cycles.stop - cycles.start} usable cycles; "
                f"the log runs from {start:g} to {end:g} s. Correct [[phases]] in the vehicle file"
            )
        phases.append((phase, cycles))
    return phases
