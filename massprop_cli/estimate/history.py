"""What every estimator hands on: one row per control cycle of one phase."""

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
    """What a log says up to S of its cycles, all about its last estimate: of ixx … izz, CG and 1/m."""

    ends: IntArray
    """(S,) the cycle before which each ends."""
    mean: Array
    """(S, 10) departure from that estimate."""
    variance: Array
    """(S, 10)"""


@dataclass(frozen=True)
class History:
    """The estimate after each cycle. NaN where nothing can be said yet.

    An off-line fit that is no result itself has the last row of values and of what goes with them alone, and all normalised innovations.
    """

    phase: Phase
    cycles: slice
    """Which of the log's cycles these are."""
    time_s: Array
    """(K,) end of each cycle."""
    values: Array
    """(K, 10) ixx … mass, SI."""
    sigmas: Array
    """(K, 10) one standard deviation of each."""
    covariance: Array
    """(10, 10) of the last row."""
    innovation: Array
    """(K, 6) torque [N m] and force [N], measured less predicted."""
    innovation_sigma: Array
    """(K, 6) what the filter expected of them."""
    normalised: Array
    """(K, 6) innovations in rate and specific force, whitened: independent standard normal if the model holds; 0 of channels unread."""
    natural_sizes: Array
    """(10,) the size that each quantity has by nature: trace (inertia), sqrt(trace/mass) (CG), mass."""
    information_share: Array
    """(10, 6) which part of the information on each quantity each channel brought: rate x y z, specific force x y z."""
    drowned: BoolArray
    """(6,) channels in which disturbances outweigh what the commands explain."""
    observable: BoolArray
    """(10,) whether some motion of this vehicle could inform the quantity by this method."""
    bare: tuple[Array, Array]
    """(10,) and (10, 10) the last row by the log alone: without what is known from elsewhere and without the thrust's common scale."""
    pivot: Array | None = None
    """(K, 18) values and sigmas of what is about a fixed pivot (:mod:`massprop_cli.estimate.pivot`); None without one."""
    reference: Reference | None = None
    """About which the last row was linearised, where it was."""
    unsensed: BoolArray = field(default_factory=lambda: np.zeros(10, dtype=bool))
    """(10,) quantities that would be observable if the log had all channels."""
    unread: BoolArray = field(default_factory=lambda: np.zeros(6, dtype=bool))
    """(6,) channels that the log doesn't have."""
    notices: tuple[Notice, ...] = ()
    belied: Mapping[str, str] = field(default_factory=dict)
    """Known quantities that the log contradicts, each with why."""
    unexplained: float = np.inf
    """Of an off-line fit: chi-square, without what unknown beginnings add by standing off what is stated of them."""
    residual: Residual | None = None
    """Of an off-line fit: what its values leave of rate and specific force."""
    stages: Callable[[], Stages] | None = None
    """Of an off-line fit: what parts of the log say."""

    def __post_init__(self) -> None:
        rows = len(self.time_s)
        if not all(len(a) == rows for a in (self.values, self.sigmas, self.innovation, self.innovation_sigma)):
            raise ValueError("history arrays differ in length")

    def whitened(self) -> Iterator[Array]:
        """(N, 6) normalised innovations of the cycles that have them, part by part."""
        for part in spill.parts(len(self.normalised)):
            rows = self.normalised[part]
            yield rows[np.isfinite(rows).all(1)]

    def moments(self) -> Moments:
        """Of :meth:`whitened`."""
        found = Moments(6)
        for rows in self.whitened():
            found.add(rows)
        return found

    def left(self) -> float:
        """Sum of the squares of all that is left, in sigmas of the noise: chi-square."""
        found = self.moments()
        return float(np.nansum(found.count * found.variance))

    @property
    def silent(self) -> bool:
        """Whether all that is left is less than one sigma, as of a log without noise."""
        return min(self.left(), self.unexplained) < 1.0


def phase_cycles(phase: Phase, end_s: Array, usable: BoolArray) -> slice:
    """The cycles with ``start_s < time_s <= end_s`` whose executed command is known; empty where there are none."""
    inside = np.flatnonzero(usable & (end_s > phase.start_s + 1e-9) & (end_s <= phase.end_s + 1e-9))
    return slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)


def phases_of(log: Log, used: Vehicle, samples: Stream) -> list[tuple[Phase, slice]]:
    """Each phase of the vehicle file, or the whole log, with its cycles; :class:`InputError` where one holds too few."""
    begun, length = cycle_edges(log, slice(0, log.cycles))
    start, end = round(float(begun[0]), 9) + 0.0, round(float(begun[-1] + length[-1]), 9)  # + 0.0: no minus zero
    found = []
    for phase in used.phases or (Phase.model_construct(name="all", start_s=start, end_s=end),):
        cycles = phase_cycles(phase, begun + length, (begun >= samples.usable_s) & (begun + length <= samples.until_s))
        if cycles.stop - cycles.start < 2:
            raise InputError(
                f"{log.path}: phase {phase.name!r} ({phase.start_s:g} to {phase.end_s:g} s) holds "
                f"{cycles.stop - cycles.start} usable cycles; "
                f"the log runs from {start:g} to {end:g} s. Correct [[phases]] in the vehicle file"
            )
        found.append((phase, cycles))
    return found
