"""Estimate of a phase's mass properties: Gauss–Newton steps on the triangle of :mod:`massprop_cli.estimate.triangle`, cycle by cycle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, grown, triangle_of
from massprop_cli.base.levels import CHANCE, KNOWN, STILL, UNINFORMED
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.estimate import quantities
from massprop_cli.estimate.innovations import in_units, innovations_given, sequential_innovations
from massprop_cli.estimate.kalman import State
from massprop_cli.estimate.nuisance import Whitened, regression_rows
from massprop_cli.estimate.rows import AssumptionResponse, Parameters, Posed, Rows, TriangleSolution
from massprop_cli.estimate.triangle import FREE_COUPLING, PULL_SIGMA, Run, Triangle
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.plant import Reference
from massprop_cli.model.plant.plant import MOMENT, MU
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.model.system import random_walk
from massprop_cli.prepare.compensate import Source

PASSES, STEPS = 4, 6
"""Most relinearisations in a row, and most Gauss–Newton steps on a triangle; fewer than elsewhere, as the kernel takes them in flight."""
CHECKPOINT = 64
"""Cycles between the runs from which a later relinearisation may start."""
ASTRAY = 0.4
"""... and of a causal estimate, before its block ends early."""
INCONSISTENT = 60.0
"""Excess of chi-square over that with free gyroscopic coupling, above which the search has diverged; its eighteen coefficients give less by
chance."""
CLEAR = 0.15
"""Relative sigma of 1/m below which a causal estimate of it may differ from the linearisation's by orders of magnitude."""
EXACT = 1e-3
"""Relative sigma of a known mass that counts as exact."""
RATIO = 1e-6
"""Relative sigma that a free oscillation may reach for ratios of inertia."""


class Regression(Triangle):
    """Regression of one phase: solves its triangle for the mass properties and their covariance."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider, phi_map: ResponseMap | None = None) -> None:
        super().__init__(samples, cycles, vehicle, consider, phi_map)
        self._last: tuple[Run, Array, Array, Array] | None = None

    def relinearised(self, ring: list[Run], reference: Reference) -> list[Run]:
        """Process the cycles of the ring again, about the reference that they give from ``reference`` on."""
        oldest, end = ring[0], ring[-1].at
        for _ in range(PASSES):
            begun = replace(oldest, reference=reference, estimate=reference, relinearised_at=end)
            ring = [begun, *(run for run, _ in self.process_each(begun, [*range(oldest.at + CHECKPOINT, end, CHECKPOINT), end]))]
            ring[-1] = self.solved(ring[-1])
            if self.reference_is_close(ring[-1]):
                break
            reference = ring[-1].estimate
        return ring

    def solved(self, run: Run) -> Run:
        """The run with the estimate that its triangle gives; a search that is stuck starts again from the initial reference."""
        solved, chi_square = self._solved_from(run, self.phi_map.plant.theta(run.estimate))
        if solved.stuck:
            restarted, other = self._solved_from(run, self.phi_map.plant.theta(run.centre))
            solved = restarted if other < chi_square else solved
        return solved

    def _solved_from(self, run: Run, theta: Array) -> tuple[Run, float]:
        """The run with the estimate of a search from ``theta``, and its chi-square."""
        phi_map, tied, limit = self.phi_map, run.tied, np.inf
        response: Array | None = None
        if not tied:
            theta, others, response, chi_square, stuck = self._gauss_newton(run, theta, tied=False)
            tied, limit = self._axes_are_known(run, theta), chi_square + INCONSISTENT
        theta_tied, others_tied, _, chi_square_tied, stuck_tied = self._gauss_newton(run, theta, tied=True)
        if tied or chi_square_tied < limit:
            theta, others, response, chi_square, stuck = theta_tied, others_tied, None, chi_square_tied, stuck_tied
        values: Array = np.zeros(0)
        if self.consider.restated:
            theta, values = self._with_values_as_read(run, theta, tied)
        layout, reference = Layout.of(self.samples, self.vehicle), run.reference
        phi, pivoted = phi_map.coefficients(theta)[0], phi_map.plant.pivoted
        # on a slope the derivative of a step with respect to the bias is missing, and the search diverged
        bias = (
            self.state(run, layout.gyro_bias, phi, others, reference.gyro_bias)
            if pivoted or not phi_map.plant.tilt_count
            else reference.gyro_bias
        )
        scale = self.state(run, layout.scale, phi, others, reference.scale)
        damping = self.state(run, layout.damping, phi, others, reference.damping)
        # a steady torque is unknown until the commands determine each axis; on a support it may balance the weight
        block = layout.torque if tied or pivoted else slice(0, 0)
        acceleration = self.state(run, block, phi, others, reference.acceleration)
        estimate = replace(phi_map.reference(theta, bias), response=response, scale=scale, damping=damping, acceleration=acceleration)
        departure = others[self.geometry_unknowns :] / self.prior[self.prior > 0][: self.unknowns]
        unexplained = chi_square - float(departure @ departure)
        return replace(run, estimate=estimate, tied=tied, stuck=stuck, unexplained=unexplained, values=values), chi_square

    def _with_values_as_read(self, run: Run, theta: Array, tied: bool) -> tuple[Array, Array]:
        """(10,) θ of the estimate if each ``uncertain`` value is the one with which the log is read; (r,) estimates of these values.

        The equations hold about these together. About θ with the values' estimates they would not: a weight moment of a shifted pivot
        would be another one.
        """
        count, values = self._nuisance_count(tied), self.consider.restated
        first, end, scale = count - self.geometry_unknowns, count + 10, self._prior_sigma(theta)
        restated = slice(first + len(self.consider.imu), first + len(self.consider.imu) + len(values))
        rows = self._posed(run, theta, scale, tied=tied)[first:end]
        if not np.isfinite(rows).all():  # the search has diverged
            return theta, np.full(len(values), np.nan)
        others = np.delete(np.arange(first, end), np.arange(restated.start, restated.stop) - first)
        right = rows[:, end] - rows[:, restated] @ [one.about for one in values]
        step = np.linalg.lstsq(rows[:, others], right)[0][-10:]
        theta = self.phi_map.stepped(theta, scale * step)
        triangle = self._posed(replace(run, tied=tied), theta, self._prior_sigma(theta))
        return theta, np.linalg.solve(triangle[:end, :end], triangle[:end, end])[restated]

    def state(self, run: Run, block: slice, phi: Array, others: Array, before: Array) -> Array:
        """The states of ``block`` in the last cycle, with φ (N,) and ``others`` solved for; ``before`` if the run has none."""
        if block.stop == block.start or run.state is None:
            return before
        mean = run.state.mean[Layout.in_states(block)]
        return mean[:, 0] + mean[:, 1 : 1 + self.phi_map.size] @ phi + mean[:, mean.shape[1] - len(others) :] @ others

    def _gauss_newton(self, run: Run, theta: Array, tied: bool) -> tuple[Array, Array, Array, float, bool]:
        """Gauss–Newton steps on the triangle from ``theta``.

        Returns θ, geometry and initial states, Φ (3, C), chi-square, and whether the search is stuck.
        """
        count = self._nuisance_count(tied)
        for _ in range(STEPS):
            centre, scale = self._pull(theta, run)
            triangle = self._posed(run, theta, scale, centre, tied)
            last = triangle[count + 9, count + 9 :]
            factor, last[1:2] = self._without_mass_prior(theta, scale, last[0], last[1:2], (centre - theta) / scale, UNINFORMED)
            last[0] *= factor
            solved = np.linalg.solve(triangle[: count + 10, : count + 10], triangle[: count + 10, count + 10])
            least, others = self._least_mu_step(theta, centre, scale, triangle, solved[-1]), triangle[: count + 9]
            if solved[-1] < least:
                solved = np.append(np.linalg.solve(others[:, : count + 9], others[:, count + 10] - least * others[:, count + 9]), least)
            before, theta = theta, self.phi_map.stepped(theta, scale * solved[count:])
            if (triangle[count : count + 10, count + 10] ** 2).sum() < STILL**2:
                break
        # the part of the last step that was cut, because it led to no rigid body
        missing = triangle[count : count + 10, count : count + 10] @ (solved[count:] - (theta - before) / scale)
        stuck = bool((missing**2).sum() > CHANCE**2)
        phi, coupling = self.phi_map.coefficients(theta)[0], self.phi_map.coupling
        if not tied:
            phi[coupling] = (
                self.phi_map.coefficients(before)[0][coupling] + FREE_COUPLING * solved[self.unknowns : count - self.geometry_unknowns]
            )
        response = phi[: 3 * self.phi_map.plant.channels].reshape(3, -1)
        others = np.concatenate([solved[count - self.geometry_unknowns : count], solved[: self.unknowns]])
        return theta, others, response, float(triangle[count + 10, count + 10] ** 2), stuck

    def _axes_are_known(self, run: Run, theta: Array) -> bool:
        """Whether each axis' response is known without the gyroscopic coupling."""
        if self._inertia_is_known:
            return True
        axes = [i for i in MOMENTS if self.phi_map.plant.observable[i]]
        return bool((self._sigmas(run, theta)[axes] < KNOWN * theta[axes]).all())

    @property
    def _inertia_is_known(self) -> bool:
        """Whether the inertia is known where motion alone gives only its ratios."""
        return not self.phi_map.plant.translates and self.vehicle.knows_inertia

    def _sigmas(self, run: Run, theta: Array) -> Array:
        """(10,) sigma of each of θ, without the pull towards the initial reference."""
        scale = self._prior_sigma(theta)
        return self._sigma_of(self._posed(run, theta, scale), scale)

    def _sigma_of(self, triangle: Array, scale: Array) -> Array:
        """(10,) sigma of θ, whose departures are the last unknowns of ``triangle``."""
        count = triangle.shape[1] - 11 - self.assumptions
        by_theta = triangle[count : count + 10, count : count + 10]
        return np.asarray(scale * np.sqrt((np.linalg.inv(by_theta) ** 2).sum(1)))

    def reference_is_close(self, run: Run, limit: float = STILL) -> bool:
        """Whether the neglected second order, relative change times change, is below ``limit`` sigmas."""
        reference = run.reference
        elapsed = self.samples.part(slice(run.at - 1, run.at)).executed.end_s[0] - self.begun_s
        if np.any((run.estimate.gyro_bias - reference.gyro_bias) ** 2 * elapsed > limit * self.vehicle.imu.gyro_noise_rad_s):
            return False
        theta, scale, triangle = self._about_estimate(run)
        sigma = self._sigma_of(triangle, scale)
        return self._spurious_cg(run, theta, sigma) <= limit and not self._nonlinear(theta[None], sigma[None], reference, limit).any()

    def _spurious_cg(self, run: Run, theta: Array, sigma: Array) -> float:
        """Apparent information on the CG by a steady torque that differs from the reference's, over the CG's information.

        In ``ω̇ × c`` of the specific force, the reference's ω̇ informs c.
        """
        if not self.phi_map.plant.translates:
            return 0.0
        acceleration = run.estimate.acceleration - run.reference.acceleration
        lever = theta[MU] if self.phi_map.plant.pivoted else 1.0
        count, noise = run.at - self.cycles.start, self.vehicle.noise[3:].min()
        return float(count * (acceleration @ acceleration) * (lever * sigma[MOMENT].max() / noise) ** 2)

    def converged(self, run: Run, limit: float) -> bool:
        """Whether another pass would not change the estimate. In free flight 1/m is excluded: the response is linear in it."""
        if not self.phi_map.plant.pivoted:
            run = replace(run, reference=replace(run.reference, mu=run.estimate.mu))
        return self.reference_is_close(run, limit)

    def _nonlinear(self, theta: Array, sigma: Array, reference: Reference, limit: float) -> BoolArray:
        """(K,) whether the second order of θ (K, 10) about ``reference`` exceeds ``limit`` sigmas, in any element that is known.

        An element is known if its sigma is small against its scale, of θ or of the reference.
        """
        phi_map = self.phi_map
        about = phi_map.plant.theta(reference)
        scales = phi_map.scales(theta)
        known = sigma < KNOWN * np.maximum(scales, phi_map.scales(about))
        if self._inertia_is_known:  # data inform ratios of inertia much better than the inertia
            free = sigma[..., :9] > KNOWN * scales[..., :9]
            sigma = sigma.copy()
            sigma[..., :9] = np.where(free, RATIO * scales[..., :9], sigma[..., :9])
            known[..., :9] |= free
        if phi_map.plant.pivoted:  # a small CG offset has a large effect through the weight
            scales[..., MOMENT] *= PULL_SIGMA["balanced cg"]
        far = known & ((theta - about) ** 2 > limit * sigma * scales)
        return np.asarray(far.any(1))

    def row(self, run: Run) -> Parameters:
        """The state parameters of a run's estimate, one row."""
        theta, scale, whole = self._about_estimate(run)
        triangle = whole[None, : self._nuisance_count(run.tied) + 10]
        solution = self._solution(run, theta, scale, triangle)
        parameters = self._parameters(run, theta, scale, triangle, solution, () if run.state is None else (run.state,))
        return Rows.empty(1).parameters if run.stuck else parameters

    def linear(self, run: Run) -> tuple[Array, Array]:
        """(10,) departure of the state parameters from a run's estimate, linear about that estimate, and (10,) its variance."""
        theta, scale, triangle = self._about_estimate(run)
        first = self._nuisance_count(run.tied)
        root = self.phi_map.plant.slopes(theta) * scale @ np.linalg.inv(triangle[first : first + 10, first : first + 10])
        return root @ triangle[first : first + 10, first + 10], (root**2).sum(1)

    def _about_estimate(self, run: Run) -> tuple[Array, Array, Array]:
        """(10,) θ of a run's estimate, (10,) its prior sigmas, and the triangle about that θ."""
        if self._last is None or self._last[0] is not run:
            theta = self.phi_map.plant.theta(run.estimate)
            scale = self._prior_sigma(theta)
            self._last = run, theta, scale, self._posed(run, theta, scale)
        return self._last[1:]

    def assumption_response(self, run: Run) -> AssumptionResponse:
        """Response of estimate and fit to each assumption."""
        (_, scale, triangle), first = self._about_estimate(run), self._nuisance_count(run.tied)
        theta = self.phi_map.plant.theta(run.estimate)
        end = first + 10
        shift = scale[:, None] * np.linalg.solve(triangle[first:end, first:end], triangle[first:end, end + 1 :])
        residuals = triangle[end:, end:]
        root = np.linalg.inv(triangle[:end, :end])[self._damping]
        damping = np.column_stack([root @ triangle[:end, end], np.sqrt((root**2).sum(1))])
        added = self._added_variance(theta, scale, triangle[:end, :end])
        return AssumptionResponse(self.phi_map.plant.slopes(theta) @ shift, residuals.T @ residuals, added, damping)

    @property
    def _damping(self) -> IntArray:
        """Indices of the damping among the unknown initial states; damping is constant."""
        block, states = Layout.of(self.samples, self.vehicle).damping, RATE.start + np.flatnonzero(self.prior > 0)
        return np.flatnonzero((states >= block.start) & (states < block.stop))

    def _added_variance(self, theta: Array, scale: Array, triangle: Array) -> dict[str, Array]:
        """(10,) variance of the state parameters by each kind of uncertain geometry and by damping, over that with the value known."""
        slopes, kinds = self.phi_map.plant.slopes(theta) * scale, np.full(len(triangle), "", dtype=object)
        kinds[len(kinds) - 10 - self.geometry_unknowns : len(kinds) - 10], kinds[self._damping] = self.consider.kinds, "damping"

        def variance(kept: BoolArray) -> Array:
            root = slopes @ np.linalg.inv(triangle_of(triangle[:, kept])[-10:, -10:])
            return np.asarray((root**2).sum(1))

        return {kind: variance(kinds == kinds) - variance(kinds != kind) for kind in dict.fromkeys(kinds[kinds != ""])}

    def posed(self, before: Run, whitened: Whitened) -> Posed:
        """Rows of a block about the estimate before it, the triangle after each of its cycles, and their solutions."""
        theta, scale, triangle = self._about_estimate(before)
        rows, count = self._block_rows(before, whitened), self._nuisance_count(before.tied) + 10
        triangles = grown(triangle[:count], rows)
        return Posed(theta, scale, rows, triangles, self._solution(before, theta, scale, triangles[1:]))

    def _block_rows(self, before: Run, whitened: Whitened) -> Array:
        """(K, m, n + 11 + e) rows of a block about the estimate before it."""
        theta, scale, _ = self._about_estimate(before)
        rows = regression_rows(whitened.innovations, self.phi_map.size, self.unknowns).reshape(*whitened.innovations.shape[:2], -1)
        return self._on_theta(rows, theta, scale, before.tied, before.reference)

    def first_nonlinear(self, before: Run, posed: Posed) -> int | None:
        """Index of the first cycle of a block whose estimate is too far from the block's reference."""
        far = np.flatnonzero(self._nonlinear(posed.solution.theta, posed.solution.sigma, before.reference, ASTRAY))
        return int(far[0]) if far.size else None

    def rows(self, before: Run, whitened: Whitened, posed: Posed) -> Rows:
        """Estimates and innovations after each cycle of a block, about the estimate before it."""
        triangles, end = posed.triangles, self._nuisance_count(before.tied) + 11
        parameters = Rows.empty(len(posed.rows)).parameters
        if not before.stuck:
            parameters = self._parameters(before, posed.theta, posed.scale, triangles[1:], posed.solution, whitened.states)
        innovations = innovations_given(triangles[:-1, :, :end], posed.rows[..., :end])
        return Rows(parameters, *self._in_units(before, whitened, *innovations))

    def innovations(self, before: Run, whitened: Whitened) -> Rows:
        """Innovations after each cycle of a block, without estimates."""
        end = self._nuisance_count(before.tied) + 11
        rows, (_, _, triangle) = self._block_rows(before, whitened)[..., :end], self._about_estimate(before)
        innovations = sequential_innovations(triangle[: end - 1, :end], rows)
        return Rows(Rows.empty(len(rows)).parameters, *self._in_units(before, whitened, *innovations))

    def _in_units(self, before: Run, whitened: Whitened, innovations: Array, spread: Array) -> tuple[Array, Array, Array]:
        executed = self.samples.part(slice(before.at, before.at + len(innovations))).executed
        return in_units(executed, before.estimate, before.state is None, innovations, spread, whitened.root)

    def _solution(self, run: Run, theta: Array, scale: Array, triangles: Array) -> TriangleSolution:
        """Solution of triangles (K, n + 10, n + 11 + e) about ``theta``."""
        count = triangles.shape[1] - 10
        by_theta = triangles[:, count:, count:]
        root, right = scale[:, None] * np.linalg.inv(by_theta[..., :10]), by_theta[..., 10:].copy()
        factor, right[:, MU] = self._without_mass_prior(theta, scale, by_theta[:, MU, MU], right[:, MU], np.zeros(10), CLEAR)
        root[..., MU] /= factor[:, None]
        steps = root @ right
        step = steps[..., :1]
        covariance = root @ root.transpose(0, 2, 1)
        centre, sigmas = self._pull(theta, run)
        pull = np.tile(np.diag(sigmas**2), (len(triangles), 1, 1))
        if self.known_mu is not None:  # where the log does not inform the mass, it is as the known one
            faint = covariance[:, MU, MU] > (quantities.MASS_WEAK * max(self.known_mu, theta[MU])) ** 2
            pull[faint, MU, MU] = (EXACT * self.known_mu) ** 2
        else:  # an initial reference that is orders of magnitude off must not pull a mass that the log informs
            mu = theta[MU] + step[:, MU, 0]
            clear = (mu > 0) & (covariance[:, MU, MU] < (UNINFORMED * mu) ** 2)
            pull[clear, MU, MU] = np.maximum(pull[clear, MU, MU], mu[clear] ** 2)
        pulled = step - covariance @ np.linalg.solve(covariance + pull, step + (theta - centre)[:, None])
        return TriangleSolution(root, steps, self.phi_map.nearest(theta, pulled[..., 0]), np.sqrt(np.einsum("kii->ki", covariance)))

    def _parameters(
        self, run: Run, theta: Array, scale: Array, triangles: Array, solution: TriangleSolution, states: tuple[State, ...]
    ) -> Parameters:
        """State parameters of K triangles (K, n + 10, n + 11 + e) about ``theta``."""
        count = triangles.shape[1] - 10
        # inertia and CG are curved in θ: each row is linearised about its own θ, as far as the data inform it
        root, step, at, sigma = solution
        slopes = self.phi_map.plant.slopes(at)
        mean = self.phi_map.plant.parameters(at) + np.einsum("kij,kj->ki", slopes, theta + step[..., 0] - at)
        root, shift = slopes @ root, slopes @ step[..., 1:]
        product_error = slopes * self._product_error(run, at, sigma)[:, None, :]
        covariance = root @ root.transpose(0, 2, 1) + product_error @ product_error.transpose(0, 2, 1)
        if states and random_walk(self.vehicle).any():
            # the drift since the first cycle is a state, affine in φ and in the initial states
            means = np.stack([state.mean[-10:] for state in states])
            by_phi, by_initial = means[..., 1 : 1 + self.phi_map.size], means[..., means.shape[2] - self.unknowns :]
            assumed = means[..., 1 + self.phi_map.size : means.shape[2] - self.unknowns]
            assumed, geometry = assumed[..., : self.assumptions], -assumed[..., self.assumptions :]
            drift = np.concatenate([by_initial, by_phi, -means[..., :1], assumed, geometry], -1)
            affine = self._on_theta(drift, theta, scale, run.tied, run.reference)
            gain = affine[..., : count + 10] @ np.linalg.inv(triangles[..., : count + 10])
            moved = gain @ triangles[..., count + 10 :]
            mean = mean + moved[..., 0] - affine[..., count + 10]
            shift = shift + moved[..., 1:] + assumed
            gain[..., count:] += root
            drifted = np.stack([state.root[-10:] @ state.root[-10:].T for state in states])
            covariance = gain @ gain.transpose(0, 2, 1) + product_error @ product_error.transpose(0, 2, 1) + drifted
        if self.consider.covariance.any():
            shift = shift[..., : len(self.consider.covariance)]
            covariance = covariance + shift @ self.consider.covariance @ shift.transpose(0, 2, 1)
        relative = sigma[:, MOMENTS] / np.maximum(at[:, MOMENTS], np.finfo(float).tiny)
        return Parameters(mean, covariance, np.minimum(relative, 1e6))

    def _product_error(self, run: Run, theta: Array, sigma: Array) -> Array:
        """(K, 10) error of c or κ because its product with J is linearised: its change, where another axis' J is poorly known."""
        if not self.phi_map.plant.translates:  # the specific force is linear in θ
            return np.zeros_like(theta)
        relative = np.minimum(sigma[:, MOMENTS] / np.maximum(theta[:, MOMENTS], np.finfo(float).tiny), 1.0)
        relative[:, ~self.phi_map.plant.observable[MOMENTS]] = 0.0
        error = np.zeros_like(theta)
        error[:, MOMENT] = (theta - self.phi_map.plant.theta(run.reference))[:, MOMENT] * np.maximum(
            relative[:, [1, 2, 0]], relative[:, [2, 0, 1]]
        )
        return error
