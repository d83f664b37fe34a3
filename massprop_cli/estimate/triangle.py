"""Square-root information of a phase: whitened rows on the coefficients φ, as a triangle of constant size.

The response is linear in the coefficients φ of :mod:`massprop_cli.model.plant` for any mass properties. A filter on the nuisance states
(:mod:`massprop_cli.estimate.nuisance`) turns the log into residuals ``w + W φ``, white and of unit variance. Their orthogonal factorisation
is a triangle, which can be linearised about any θ.

While an axis has no excitation, noise in the measured rates looks like its inertia's gyroscopic coupling. So the coefficients of that
coupling, J Γ(I), are free until the commands alone determine each axis' response; from then on they follow from the inertia (``tied``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field, replace

import numpy as np

from massprop_cli.base.arrays import Array, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.estimate import compiled
from massprop_cli.estimate.kalman import State
from massprop_cli.estimate.nuisance import Whitened, filtered, initial_state, prior_rows, regression_rows
from massprop_cli.model import kernelargs
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.plant.plant import MU
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.model.system import System, initial_states, prior, random_walk, system_of
from massprop_cli.prepare.compensate import Source

KNOWN_MASS_SIGMA = 0.5
"""Prior sigma of a known mass' reciprocal on a bearing, relative. There the weight gives the first moment, and the product of first moment
and 1/m is linear within this range. Any log that informs the mass gives a smaller sigma."""
FREE_COUPLING = 3.0
"""Prior sigma of the free coefficients of the gyroscopic coupling, which are ratios of moments of inertia."""
PULL_SIGMA = {"response": 0.2, "cg": 1.0, "balanced cg": 0.02, "mu": 1.0}
"""Sigma of each of θ about the initial reference, in natural sizes: what the data do not inform stays there. A body on a bearing is
balanced."""
ROUNDED = 1e3 * float(np.finfo(float).eps)
"""Information on 1/m over that of its prior, below which it is rounding."""
HEAVIER = 10.0
"""Most factor on the mass in one step; if the data do not inform the mass, relative to the initial reference."""
FORGOTTEN = 100.0
"""Growth of an initial rate error, above which that initial rate informs the present one less than the model's own rounding."""


@dataclass(frozen=True)
class Run:
    """Information of the cycles before ``at``, and the estimate that it gives."""

    at: int
    reference: Reference
    """Reference about which the cycles, and those to come, are linearised."""
    estimate: Reference
    """The estimate; what the data do not inform stays near ``centre``."""
    centre: Reference
    """The initial reference of the search."""
    tied: bool
    """Whether the gyroscopic coupling follows from the inertia: the commands alone determine each axis."""
    relinearised_at: int
    """Cycle at which the reference last changed."""
    state: State | None
    """Nuisance states, a column for each column of the system and each unknown initial state; None before the first cycle."""
    triangle: Array
    """(M + 1 + e + u, the same) of whitened rows: M = m + N initial states and φ, measured value, assumptions, unknown geometry."""
    stuck: bool = False
    """Whether the search ended where no further step leads to a rigid body, though the data require one."""
    unexplained: float = np.inf
    """Chi-square of the estimate, without the part by which initial states depart from their prior."""
    values: Array = field(default_factory=lambda: np.zeros(0))
    """(r,) estimates of the ``uncertain`` values, in sigmas from the stated ones."""


class Triangle:
    """Square-root information of one phase: processes cycles, and linearises their information about a θ."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider, phi_map: ResponseMap | None = None) -> None:
        self.samples, self.cycles, self.vehicle, self.consider = samples, cycles, vehicle, consider
        self.phi_map = phi_map or ResponseMap(plant_of(vehicle))
        first = samples.part(slice(cycles.start, cycles.start + 1))
        self.begun_s, self._attitude_error = float(first.executed.start_s[0]), first.attitude_error_rad
        self.prior = prior(samples, vehicle)
        self.drifting = bool(random_walk(vehicle).any())
        self.unknowns = int((self.prior > 0).sum())
        """m, the number of unknown initial states."""
        self.assumptions = consider.columns(len(samples.wrench))
        """e, the number of assumptions."""
        self.geometry_unknowns = len(consider.kinds)
        """u, the number of unknowns of the geometry, each in units of its sigma."""
        known = vehicle.known.get("mass")
        self.known_mu = 1 / known.value if known is not None and self.phi_map.plant.pivoted else None
        """1/kg, reciprocal of a known mass on a support; None without one."""
        self.in_kernel = phi_map is None and compiled.supports(samples, vehicle, consider)
        """Whether the compiled kernel processes the cycles."""
        self._pull_of: tuple[Reference, Array, Array] | None = None

    def begin(self, reference: Reference) -> Run:
        """The run before the first cycle."""
        size = self.unknowns + self.phi_map.size + 1 + self.assumptions + self.geometry_unknowns
        known = prior_rows(self.prior, size)
        triangle = np.vstack([known, np.zeros((size - len(known), size))])
        return Run(self.cycles.start, reference, reference, reference, False, self.cycles.start, None, triangle)

    def process(self, run: Run, end: int) -> tuple[Run, Whitened]:
        """Process the cycles from ``run.at`` to ``end``."""
        if self.in_kernel:
            return self._compiled(run, end)
        return self._process(run, end, self._system(run.at, end, run.reference))

    def process_each(self, run: Run, stops: Sequence[int]) -> Iterator[tuple[Run, Whitened]]:
        """Process the cycles from ``run.at`` up to each of ``stops``; the system is computed once."""
        first = max(run.at - 1, self.cycles.start)
        system = self._system(run.at, stops[-1], run.reference)
        for stop in stops:
            run, whitened = self._process(run, stop, system.part(max(run.at - 1, first) - first, stop - first))
            yield run, whitened

    def phase_system(self, reference: Reference) -> System:
        """The system of all cycles of the phase."""
        return self._system(self.cycles.start, self.cycles.stop, reference)

    def segment_triangle(self, start: Run, whole: System, cycles: slice) -> Array:
        """(N + 1, N + 1) triangle of a segment's information on φ, with unknown initial states; the last element is the post-fit residual.

        ``start`` is a run before the phase's first cycle, ``whole`` the system of all cycles of the phase.
        """
        part = whole.part(cycles.start - self.cycles.start, cycles.stop - self.cycles.start)
        part = replace(part, initial=initial_states(self.samples.part(cycles), self.samples, self.vehicle))
        run, _ = self._process(replace(start, at=cycles.start), cycles.stop, part)
        return run.triangle[self.unknowns :, self.unknowns :]

    def _system(self, first: int, end: int, reference: Reference) -> System:
        """The system of the cycles from ``first``, with the step that leads into it."""
        cycles = slice(max(first - 1, self.cycles.start), end)
        return system_of(self.samples, cycles, reference, self.vehicle, self.consider, self.phi_map)

    def _compiled(self, run: Run, end: int) -> tuple[Run, Whitened]:
        """Process the cycles from ``run.at`` to ``end`` by the compiled kernel (massprop_cli/kernel/offline.c)."""
        started = run.state is not None
        cycles = kernelargs.cycle_numbers(self.samples.part(slice(run.at - started, end)))
        width, states = len(run.triangle), len(self.prior)
        state = run.state or State(np.zeros((states, width)), np.zeros((states, states)))
        arguments = (
            compiled.vehicle_numbers(self.samples, self.vehicle),
            kernelargs.reference_numbers(run.reference, self.phi_map),
            self._attitude_error,
        )
        mean, root, triangle, innovations, roots = kernelargs.filtered(*arguments, cycles, (*state, run.triangle), started)
        run = replace(run, at=end, state=State(mean, root), triangle=triangle)
        return self._with_rate_reset(run), Whitened(innovations, roots, ())

    def _process(self, run: Run, end: int, system: System) -> tuple[Run, Whitened]:
        state, whitened = filtered(run.state or initial_state(self.prior, system), system, run.state is None, self.drifting)
        triangle = triangle_of(np.vstack([run.triangle, regression_rows(whitened.innovations, self.phi_map.size, self.unknowns)]))
        return self._with_rate_reset(replace(run, at=end, state=state, triangle=triangle)), whitened

    def _with_rate_reset(self, run: Run) -> Run:
        """The run with an unknown rate once an initial rate error has grown ``FORGOTTEN`` times; in free flight without process noise."""
        turn = slice(-self.unknowns, 3 - self.unknowns or None)
        if run.state is None or run.state.root.any() or self.phi_map.plant.pivoted:
            return run  # process noise and gravity limit the initial rate's weight
        if np.abs(run.state.mean[:3, turn]).max() < FORGOTTEN:
            return run
        # only the triangle's first rows hold the initial rate's prior
        triangle = run.triangle.copy()
        triangle[:3] = prior_rows(self.prior, len(triangle))[:3]
        mean = run.state.mean.copy()
        mean[:3], mean[:3, turn] = 0.0, np.eye(3)
        return replace(run, state=State(mean, run.state.root), triangle=triangle)

    def _on_theta(self, rows: Array, theta: Array, scale: Array, tied: bool, reference: Reference | None = None) -> Array:
        """Rows on initial states and φ, (…, M + 1 + e + u), as rows on nuisance parameters and θ, (…, n + 11 + e).

        θ is a departure over ``scale``. Nuisance parameters are the initial states, the geometry and, unless ``tied``, the coefficients of
        the gyroscopic coupling (departure over ``FREE_COUPLING``).

        With ``uncertain`` values the slopes are those at the ``reference``, as the values' columns are: elsewhere the log would seem to
        inform what it cannot tell from the mass properties.
        """
        phi, slopes = self.phi_map.coefficients(theta)
        if reference is not None and self.consider.restated:
            slopes = self.phi_map.coefficients(self.phi_map.plant.theta(reference))[1]
        columns = rows[..., self.unknowns : self.unknowns + self.phi_map.size]
        right = rows[..., self.unknowns + self.phi_map.size :].copy()
        right[..., 0] -= columns @ phi
        right, geometry = right[..., : 1 + self.assumptions], -right[..., 1 + self.assumptions :]
        parts = [rows[..., : self.unknowns], geometry, columns @ (slopes * scale), right]
        if not tied:
            coupling = self.phi_map.coupling
            without_coupling = slopes * scale
            without_coupling[coupling] = 0.0
            parts[1:3] = [FREE_COUPLING * columns[..., coupling], geometry, columns @ without_coupling]
        return np.concatenate(parts, -1)

    def _nuisance_count(self, tied: bool) -> int:
        return self.unknowns + self.geometry_unknowns + (0 if tied else len(self.phi_map.coupling))

    def _posed(self, run: Run, theta: Array, scale: Array, centre: Array | None = None, tied: bool | None = None) -> Array:
        """(n + 11 + …, n + 11 + e) triangle about ``theta`` of a run's information, with a prior of sigma ``scale`` about ``centre``."""
        # a search that is far from the reference needs the slopes at its own θ
        reference = run.reference if tied is None else None
        tied = run.tied if tied is None else tied
        rows, count = self._on_theta(run.triangle, theta, scale, tied, reference), self._nuisance_count(tied) + 10
        known = np.eye(count - self.unknowns, rows.shape[1], self.unknowns)
        if centre is not None:
            known[-10:, count] = (centre - theta) / scale
        return triangle_of(np.vstack([rows, known]))

    def ordered(self, whitened: Whitened) -> Array:
        """(r K, M + 1 + e + u) whitened rows of K cycles, in the triangle's order."""
        return regression_rows(whitened.innovations, self.phi_map.size, self.unknowns)

    def with_assumptions(self, each: Sequence[Array], theta: Array) -> tuple[list[Array], Array]:
        """Rows on nuisance parameters, θ, assumptions and measured value, for each triangle of ``each``; and the prior sigmas (10,) of θ.

        θ is a departure in prior sigmas. The first triangle is the information before the first cycle.
        """
        scale, count = self._prior_sigma(theta), self._nuisance_count(tied=True) + 10
        rows = [self._on_theta(one, theta, scale, tied=True) for one in each]
        rows[0] = np.vstack([rows[0], np.eye(count - self.unknowns, rows[0].shape[1], self.unknowns)])
        order = np.r_[:count, count + 1 : count + 1 + self.assumptions, count]
        return [one[:, order] for one in rows], scale

    def _pull(self, theta: Array, run: Run) -> tuple[Array, Array]:
        """(10,) θ of the initial reference, and (10,) sigmas of the pull towards it."""
        if self._pull_of is None or self._pull_of[0] is not run.centre:
            centre = self.phi_map.plant.theta(run.centre)
            centre[MU] = centre[MU] if self.known_mu is None else self.known_mu
            self._pull_of = run.centre, centre, self.phi_map.sizes(centre)
        _, centre, sizes = self._pull_of
        cg = PULL_SIGMA["balanced cg" if self.phi_map.plant.pivoted else "cg"]
        pull = np.array([*[PULL_SIGMA["response"]] * 6, *[cg] * 3, PULL_SIGMA["mu"]])
        pull *= np.maximum(self.phi_map.sizes(theta), sizes)
        return centre, self._within_known_mass(theta, pull)

    def _prior_sigma(self, theta: Array) -> Array:
        """(10,) prior sigma of each of θ."""
        return self._within_known_mass(theta, self.vehicle.estimator.prior_scale * self.phi_map.sizes(theta))

    def _within_known_mass(self, theta: Array, sigma: Array) -> Array:
        """(10,) sigmas of θ, that of mu limited by a known mass; the log may still give another mass."""
        if self.known_mu is not None:
            sigma[MU] = min(sigma[MU], KNOWN_MASS_SIGMA * max(self.known_mu, theta[MU]))
        return sigma

    def _without_mass_prior(
        self, theta: Array, scale: Array, diagonal: Array, right: Array, centre: Array, faint: float
    ) -> tuple[Array, Array]:
        """Factor on the last diagonal element of a triangle, and the elements right of it, without the prior of 1/m.

        The prior is removed where the data alone give 1/m with a relative sigma below ``faint``. Its sigma is proportional to 1/m itself.
        If a search starts from a mass that is many times too large, this prior would keep 1/m down. ``diagonal`` (...,) and ``right`` (...,
        1 + e) are elements of the triangle, ``centre`` the prior's mean over ``scale``.
        """
        information = np.sqrt(np.maximum(diagonal**2 - 1, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            alone = right * (diagonal / information)[..., None]
            alone[..., 0] -= centre[MU] / information
            informed = scale[MU] < faint * (theta[MU] * information + scale[MU] * alone[..., 0])
        informed &= (self.known_mu is None) & (information**2 > ROUNDED)
        return np.where(informed, information / diagonal, 1.0), np.where(informed[..., None], alone, right)

    def _least_mu_step(self, theta: Array, centre: Array, scale: Array, triangle: Array, solved: float) -> float:
        """Lower bound of the step of 1/m, over ``scale``; an uninformed 1/m may tend below zero, and must not stop the other parameters."""
        last = triangle.shape[1] - 2 - self.assumptions
        informed = theta[MU] + scale[MU] * solved > scale[MU] / abs(triangle[last, last])
        least = theta[MU] / HEAVIER if informed else min(theta[MU], max(theta[MU], centre[MU]) / HEAVIER)
        return float((least - theta[MU]) / scale[MU])
