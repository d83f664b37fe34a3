"""Square-root information of a phase: whitened rows on φ, kept as a triangle of constant size.

The response is linear in the coefficients φ of :mod:`massprop_cli.model.plant` whatever the mass properties are, so what a small filter on
all else (:mod:`massprop_cli.estimate.nuisance`) leaves of the log is ``w + W φ``, white and of unit variance. These rows are kept as the
triangle of an orthogonal factorisation, and posed about any θ when its departure from there is asked for.

Until an axis has been driven, noise in the measured rates looks like what its inertia would do through the gyroscopic coupling. So that
coupling, J Γ(I), stays free of the inertia until the commands alone tell each axis' response.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.estimate import compiled
from massprop_cli.estimate.kalman import State
from massprop_cli.estimate.nuisance import Taken, filtered, known_rows, ordered, unknown_beginnings
from massprop_cli.model import kernelargs
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.plant.plant import MU
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.model.system import System, initial_states, prior, random_walk, system_of
from massprop_cli.prepare.compensate import Source

WEIGHED = 0.5
"""Part of a known mass' reciprocal that is one sigma of it on a bearing, where the weight's moment tells the CG, and its product with that
reciprocal shows: linear within it, and less than any log tells that tells a mass at all."""
LOOSE = 3.0
"""One sigma of the coefficients of the gyroscopic coupling while they are free: ratios of moments of inertia."""
PULL = {"response": 0.2, "cg": 1.0, "balanced cg": 0.02, "mu": 1.0}
"""Of its natural size, one sigma of the pull of each of θ towards where the search began: what the data don't tell stays there. What turns
on a bearing is balanced."""
GROWN = 100.0
"""Growth of an error along the motion beyond which what a rate long past says of the present one is lost in the model's own rounding."""


@dataclass(frozen=True)
class Run:
    """All that is kept of the cycles before ``at``."""

    at: int
    reference: Reference
    """About which they, and those to come, are taken in."""
    estimate: Reference
    """What they told; what they don't tell stays near the centre."""
    centre: Reference
    """Where the search began."""
    bound: bool
    """Whether each axis is known without the gyroscopic coupling, so that this may be taken as what the inertia makes it."""
    moved: int
    """The cycle at which the reference was last moved."""
    state: State | None
    """Of the nuisances, with a column for each column of the system and each state's own unknown beginning; None before the first cycle."""
    triangle: Array
    """(M + 1 + e + u, the same) of whitened rows: on the M = m + N unknown beginnings and φ; measured, by assumptions, by the geometry."""
    stuck: bool = False
    """Whether the search for the estimate ended where no further step leads to a body, though the data want one."""
    unexplained: float = np.inf
    """Chi-square of the estimate, without what biases and other unknown beginnings add to it by standing off what is stated of them."""


class Triangle:
    """Of one phase: takes cycles in, and poses what they say."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider, phi_map: ResponseMap | None = None) -> None:
        self.samples, self.cycles, self.vehicle, self.consider = samples, cycles, vehicle, consider
        self.phi_map = phi_map or ResponseMap(plant_of(vehicle))
        first = samples.part(slice(cycles.start, cycles.start + 1))
        self.begun_s, self._attitude_error = float(first.executed.start_s[0]), first.attitude_error_rad
        self.prior = prior(samples, vehicle)
        self.drifting = bool(random_walk(vehicle).any())
        self.free = int((self.prior > 0).sum())
        """m, the states whose beginning is unknown."""
        self.assumed = consider.columns(len(samples.wrench))
        """e, the assumptions."""
        self.uncertain = len(consider.kinds)
        """u, the unknowns of the geometry, each in its own sigmas."""
        known = vehicle.known.get("mass")
        self.weighed = 1 / known.value if known is not None and self.phi_map.plant.pivoted else None
        """1/kg, of a mass that is known from elsewhere, on a bearing."""
        self.in_kernel = phi_map is None and compiled.holds(samples, vehicle, consider)
        """Whether the compiled kernel takes the cycles in, as in flight."""
        self._begun: tuple[Reference, Array, Array] | None = None

    def begin(self, reference: Reference) -> Run:
        """Before the first cycle."""
        size = self.free + self.phi_map.size + 1 + self.assumed + self.uncertain
        known = known_rows(self.prior, size)
        triangle = np.vstack([known, np.zeros((size - len(known), size))])
        return Run(self.cycles.start, reference, reference, reference, False, self.cycles.start, None, triangle)

    def take(self, run: Run, end: int) -> tuple[Run, Taken]:
        """The cycles from ``run.at`` to ``end``."""
        if self.in_kernel:
            return self._compiled(run, end)
        return self._with(run, end, self._system(run.at, end, run.reference))

    def through(self, run: Run, stops: Sequence[int]) -> Iterator[tuple[Run, Taken]]:
        """The cycles from ``run.at`` up to each of ``stops``, of a system that is computed once."""
        first = max(run.at - 1, self.cycles.start)
        system = self._system(run.at, stops[-1], run.reference)
        for stop in stops:
            run, taken = self._with(run, stop, system.part(max(run.at - 1, first) - first, stop - first))
            yield run, taken

    def whole(self, reference: Reference) -> System:
        """Of all cycles of the phase."""
        return self._system(self.cycles.start, self.cycles.stop, reference)

    def stretch(self, begun: Run, whole: System, cycles: slice) -> Array:
        """(N + 1, N + 1) triangle of what a stretch says of φ, all nuisances unknown at its start; last, what is left.

        ``begun`` is a run before its first cycle, ``whole`` the system of all cycles of the phase.
        """
        part = whole.part(cycles.start - self.cycles.start, cycles.stop - self.cycles.start)
        part = replace(part, initial=initial_states(self.samples.part(cycles), self.samples, self.vehicle))
        run, _ = self._with(replace(begun, at=cycles.start), cycles.stop, part)
        return run.triangle[self.free :, self.free :]

    def _system(self, first: int, end: int, reference: Reference) -> System:
        """Of the cycles from ``first`` on, with the step that leads into it."""
        cycles = slice(max(first - 1, self.cycles.start), end)
        return system_of(self.samples, cycles, reference, self.vehicle, self.consider, self.phi_map)

    def _compiled(self, run: Run, end: int) -> tuple[Run, Taken]:
        """The cycles from ``run.at`` to ``end`` by the compiled kernel (massprop_cli/kernel/offline.c)."""
        begun = run.state is not None
        fed = kernelargs.cycle_numbers(self.samples.part(slice(run.at - begun, end)))
        width, states = len(run.triangle), len(self.prior)
        state = run.state or State(np.zeros((states, width)), np.zeros((states, states)))
        given = compiled.table(self.samples, self.vehicle), kernelargs.reference_numbers(run.reference, self.phi_map), self._attitude_error
        mean, root, triangle, white, roots = kernelargs.filtered(*given, fed, (*state, run.triangle), begun)
        run = replace(run, at=end, state=State(mean, root), triangle=triangle)
        return self._renewed(run), Taken(white, roots, ())

    def _with(self, run: Run, end: int, system: System) -> tuple[Run, Taken]:
        state, taken = filtered(run.state or unknown_beginnings(self.prior, system), system, run.state is None, self.drifting)
        triangle = triangle_of(np.vstack([run.triangle, ordered(taken.white, self.phi_map.size, self.free)]))
        return self._renewed(replace(run, at=end, state=state, triangle=triangle)), taken

    def _renewed(self, run: Run) -> Run:
        """With the rate unknown again once an error of where it began has grown ``GROWN`` times: a free body's motion forgets."""
        turn = slice(-self.free, 3 - self.free or None)
        if run.state is None or run.state.root.any() or self.phi_map.plant.pivoted:
            return run  # beside a disturbance it forgets by itself
        if np.abs(run.state.mean[:3, turn]).max() < GROWN:
            return run
        # the triangle's first rows alone hold the old beginning; all others are what it leaves
        triangle = run.triangle.copy()
        triangle[:3] = known_rows(self.prior, len(triangle))[:3]
        mean = run.state.mean.copy()
        mean[:3], mean[:3, turn] = 0.0, np.eye(3)
        return replace(run, state=State(mean, run.state.root), triangle=triangle)

    def _reduced(self, rows: Array, theta: Array, scale: Array, bound: bool) -> Array:
        """Rows (…, M + 1 + e + u) on beginnings and φ as rows on nuisances and θ's departure over ``scale``: (…, n + 11 + e).

        Nuisances are the beginnings, unless ``bound`` the coefficients of the gyroscopic coupling (their departure over ``LOOSE``), and
        what is uncertain of the geometry.
        """
        phi, slopes = self.phi_map.coefficients(theta)
        by_phi = rows[..., self.free : self.free + self.phi_map.size]
        left = rows[..., self.free + self.phi_map.size :].copy()
        left[..., 0] -= by_phi @ phi
        left, geometry = left[..., : 1 + self.assumed], -left[..., 1 + self.assumed :]
        parts = [rows[..., : self.free], geometry, by_phi @ (slopes * scale), left]
        if not bound:
            coupling = self.phi_map.coupling
            held = slopes * scale
            held[coupling] = 0.0
            parts[1:3] = [LOOSE * by_phi[..., coupling], geometry, by_phi @ held]
        return np.concatenate(parts, -1)

    def _nuisances(self, bound: bool) -> int:
        return self.free + self.uncertain + (0 if bound else len(self.phi_map.coupling))

    def _posed(self, run: Run, theta: Array, scale: Array, centre: Array | None = None, bound: bool | None = None) -> Array:
        """(n + 11 + …, n + 11 + e) triangle about ``theta`` of all that a run has taken in, with a prior of ``scale`` about ``centre``."""
        bound = run.bound if bound is None else bound
        rows, count = self._reduced(run.triangle, theta, scale, bound), self._nuisances(bound) + 10
        known = np.eye(count - self.free, rows.shape[1], self.free)
        if centre is not None:
            known[-10:, count] = (centre - theta) / scale
        return triangle_of(np.vstack([rows, known]))

    def ordered(self, taken: Taken) -> Array:
        """(r K, M + 1 + e + u) whitened rows of K cycles, as they stand in a triangle."""
        return ordered(taken.white, self.phi_map.size, self.free)

    def beside_assumptions(self, each: Sequence[Array], theta: Array) -> tuple[list[Array], Array]:
        """Rows on nuisances, θ's departure over its prior sigmas (10,), assumptions and what was measured; and these sigmas.

        Of triangles, the first of which says what is known before the first cycle.
        """
        scale, own = self._scale(theta), self._nuisances(bound=True) + 10
        rows = [self._reduced(one, theta, scale, bound=True) for one in each]
        rows[0] = np.vstack([rows[0], np.eye(own - self.free, rows[0].shape[1], self.free)])
        order = np.r_[:own, own + 1 : own + 1 + self.assumed, own]
        return [one[:, order] for one in rows], scale

    def _pull(self, theta: Array, run: Run) -> tuple[Array, Array]:
        """(10,) where the search began, and (10,) one sigma of the pull towards it."""
        if self._begun is None or self._begun[0] is not run.centre:
            centre = self.phi_map.plant.theta(run.centre)
            centre[MU] = centre[MU] if self.weighed is None else self.weighed
            self._begun = run.centre, centre, self.phi_map.sizes(centre)
        _, centre, sizes = self._begun
        cg = PULL["balanced cg" if self.phi_map.plant.pivoted else "cg"]
        pull = np.array([*[PULL["response"]] * 6, *[cg] * 3, PULL["mu"]])
        pull *= np.maximum(self.phi_map.sizes(theta), sizes)
        return centre, self._weighed(theta, pull)

    def _scale(self, theta: Array) -> Array:
        """(10,) one sigma of each of θ before anything is known."""
        return self._weighed(theta, self.vehicle.estimator.prior_scale * self.phi_map.sizes(theta))

    def _weighed(self, theta: Array, sigma: Array) -> Array:
        """(10,) sigmas of θ, that of mu not beyond what a known mass leaves; where the log tells another, it is heard."""
        if self.weighed is not None:
            sigma[MU] = min(sigma[MU], WEIGHED * max(self.weighed, theta[MU]))
        return sigma
