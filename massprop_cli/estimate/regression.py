"""The mass properties that a phase's triangle gives, and what it tells of them cycle by cycle.

What the cycles have said is the triangle of :mod:`massprop_cli.estimate.triangle`; the ten values are a few Gauss–Newton steps on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, grown, triangle_of
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.estimate import quantities
from massprop_cli.estimate.innovationsahead import beyond, in_units, unexpected
from massprop_cli.estimate.kalman import State
from massprop_cli.estimate.nuisance import Taken, ordered
from massprop_cli.estimate.rows import Parameters, Posed, Response, Rows, TriangleSolution
from massprop_cli.estimate.triangle import LOOSE, PULL, Run, Triangle
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.plant import Reference
from massprop_cli.model.plant.plant import MOMENT, MU
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.model.system import random_walk
from massprop_cli.prepare.compensate import Source

ROUNDED = 1e3 * float(np.finfo(float).eps)
"""Information on 1/m beside that of what draws it, as 1, below which it is rounding."""
PASSES = 4
"""How often in a row cycles are taken in anew."""
CHECKPOINT = 64
"""Cycles from which on they may be, next time."""
STALE = 0.1
"""Largest second-order error of what is linear about the reference, in sigmas, before it is renewed."""
ASTRAY = 0.4
"""... and of a value given on the way, before a block is ended for it."""
INCONSISTENT = 60.0
"""More chi-square than the gyroscopic coupling's eighteen free coefficients would leave by chance: the search has got lost."""
CLEAR = 0.15
"""Relative sigma below which a row's 1/m may be orders of magnitude from the estimate it is taken about: by chance it is not so far."""
EXACT = 1e-3
"""Part of a known mass that is none."""
KNOWN = 0.1
"""Relative sigma below which an axis' response counts as known."""
RATIO = 1e-6
"""Relative sigma to which a free swing may tell ratios of inertia."""
HEAVIER = 10.0
"""Factor on the mass that no step of the search may exceed; where the data don't tell the mass, beside where the search began."""
STEPS = 6
"""Most Gauss–Newton steps on a triangle."""
STUCK = 3.0
"""Sigmas of a step that the search wants and can't take, as it leads to no body: so far from where it should be its values mean nothing."""
STILL = 0.1
"""A step of fewer sigmas is the last."""


class Regression(Triangle):
    """Of one phase: solves its triangle, and says what that tells."""

    def __init__(self, samples: Source, cycles: slice, vehicle: Resolved, consider: Consider, phi_map: ResponseMap | None = None) -> None:
        super().__init__(samples, cycles, vehicle, consider, phi_map)
        self._last: tuple[Run, Array, Array, Array] | None = None

    def again(self, ring: list[Run], reference: Reference) -> list[Run]:
        """The cycles of the ring anew, about a reference that they give themselves from ``reference`` on."""
        oldest, end = ring[0], ring[-1].at
        for _ in range(PASSES):
            begun = replace(oldest, reference=reference, estimate=reference, moved=end)
            ring = [begun, *(run for run, _ in self.through(begun, [*range(oldest.at + CHECKPOINT, end, CHECKPOINT), end]))]
            ring[-1] = self.improved(ring[-1])
            if self.stands(ring[-1]):
                break
            reference = ring[-1].estimate
        return ring

    def improved(self, run: Run) -> Run:
        """With the estimate that the triangle gives; what the data don't tell stays near where the search began.

        A search that is stuck begins there anew.
        """
        found, chi_square = self._improved(run, self.phi_map.plant.theta(run.estimate))
        if found.stuck:
            anew, left = self._improved(run, self.phi_map.plant.theta(run.centre))
            found = anew if left < chi_square else found
        return found

    def _improved(self, run: Run, theta: Array) -> tuple[Run, float]:
        """By a search from ``theta``, and chi-square of what that leaves."""
        phi_map, bound, most = self.phi_map, run.bound, np.inf
        response: Array | None = None
        if not bound:
            theta, others, response, chi_square, stuck = self._searched(run, theta, bound=False)
            bound, most = self._each_axis_is_known(run, theta), chi_square + INCONSISTENT
        tied, begun, _, left, tied_stuck = self._searched(run, theta, bound=True)
        if bound or left < most:
            theta, others, response, chi_square, stuck = tied, begun, None, left, tied_stuck
        layout, reference = Layout.of(self.samples, self.vehicle), run.reference
        phi, pivoted = phi_map.coefficients(theta)[0], phi_map.plant.pivoted
        # on a slope steps have no derivative by the bias, and led astray
        bias = (
            self.state(run, layout.gyro_bias, phi, others, reference.gyro_bias)
            if pivoted or not phi_map.plant.tilt_count
            else reference.gyro_bias
        )
        scale = self.state(run, layout.scale, phi, others, reference.scale)
        damping = self.state(run, layout.damping, phi, others, reference.damping)
        # until commands alone tell each axis, a steady torque may be anything; on a bearing the weight that it holds up may be as much
        told = layout.torque if bound or pivoted else slice(0, 0)
        pushed = self.state(run, told, phi, others, reference.acceleration)
        estimate = replace(phi_map.reference(theta, bias), response=response, scale=scale, damping=damping, acceleration=pushed)
        drawn = others[self.uncertain :] / self.prior[self.prior > 0][: self.free]
        return replace(run, estimate=estimate, bound=bound, stuck=stuck, unexplained=chi_square - float(drawn @ drawn)), chi_square

    def state(self, run: Run, block: slice, phi: Array, others: Array, before: Array) -> Array:
        """The states of a block in the last cycle, by φ (N,) and by ``others``; what they were ``before`` where there are none yet."""
        if block.stop == block.start or run.state is None:
            return before
        mean = run.state.mean[Layout.in_states(block)]
        return mean[:, 0] + mean[:, 1 : 1 + self.phi_map.size] @ phi + mean[:, mean.shape[1] - len(others) :] @ others

    def _searched(self, run: Run, theta: Array, bound: bool) -> tuple[Array, Array, Array, float, bool]:
        """Gauss–Newton on the triangle from ``theta``.

        θ, the geometry and the states' beginnings, Φ (3, C), chi-square of the rest, and whether the search is stuck.
        """
        count = self._nuisances(bound)
        for _ in range(STEPS):
            centre, scale = self._pull(theta, run)
            triangle = self._posed(run, theta, scale, centre, bound)
            last = triangle[count + 9, count + 9 :]
            freed, last[1:2] = self._freed(theta, scale, last[0], last[1:2], (centre - theta) / scale, quantities.UNTOLD)
            last[0] *= freed
            solved = np.linalg.solve(triangle[: count + 10, : count + 10], triangle[: count + 10, count + 10])
            least, own = self._lightest(theta, centre, scale, triangle, solved[-1]), triangle[: count + 9]
            if solved[-1] < least:
                solved = np.append(np.linalg.solve(own[:, : count + 9], own[:, count + 10] - least * own[:, count + 9]), least)
            before, theta = theta, self.phi_map.stepped(theta, scale * solved[count:])
            if (triangle[count : count + 10, count + 10] ** 2).sum() < STILL**2:
                break
        # what is left of the last step, where it was taken as far as it leads to a body
        wanted = triangle[count : count + 10, count : count + 10] @ (solved[count:] - (theta - before) / scale)
        stuck = bool((wanted**2).sum() > STUCK**2)
        phi, coupling = self.phi_map.coefficients(theta)[0], self.phi_map.coupling
        if not bound:
            phi[coupling] = self.phi_map.coefficients(before)[0][coupling] + LOOSE * solved[self.free : count - self.uncertain]
        response = phi[: 3 * self.phi_map.plant.channels].reshape(3, -1)
        others = np.concatenate([solved[count - self.uncertain : count], solved[: self.free]])
        return theta, others, response, float(triangle[count + 10, count + 10] ** 2), stuck

    def _freed(self, theta: Array, scale: Array, own: Array, right: Array, drawn: Array, faint: float) -> tuple[Array, Array]:
        """What the data alone tell of 1/m, the last unknown of a triangle, where they tell it to better than ``faint``, relative.

        One sigma of what draws it to ``drawn`` is ``scale``, over which both are, and so as small as itself: where a search began at a
        mass many times too large, that would hold it down.
        ``own`` (...,) the last of the triangle's diagonal, ``right`` (..., 1 + e) what stands right of it. The factor on the first, and
        what the second becomes.
        """
        left = np.sqrt(np.maximum(own**2 - 1, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            alone = right * (own / left)[..., None]
            alone[..., 0] -= drawn[MU] / left
            told = scale[MU] < faint * (theta[MU] * left + scale[MU] * alone[..., 0])
        told &= (self.weighed is None) & (left**2 > ROUNDED)
        return np.where(told, left / own, 1.0), np.where(told[..., None], alone, right)

    def _lightest(self, theta: Array, centre: Array, scale: Array, triangle: Array, solved: float) -> float:
        """The least step of 1/m, over ``scale``: what doesn't tell it may want less than none, and must keep nothing else from moving."""
        last = triangle.shape[1] - 2 - self.assumed
        told = theta[MU] + scale[MU] * solved > scale[MU] / abs(triangle[last, last])
        least = theta[MU] / HEAVIER if told else min(theta[MU], max(theta[MU], centre[MU]) / HEAVIER)
        return float((least - theta[MU]) / scale[MU])

    def _each_axis_is_known(self, run: Run, theta: Array) -> bool:
        """Without the gyroscopic coupling."""
        if self._inertia_is_known:
            return True
        axes = [i for i in MOMENTS if self.phi_map.plant.observable[i]]
        return bool((self._sigmas(run, theta)[axes] < KNOWN * theta[axes]).all())

    @property
    def _inertia_is_known(self) -> bool:
        """Whether it is from elsewhere, where a free swing tells no more of it than ratios."""
        return not self.phi_map.plant.translates and self.vehicle.knows_inertia

    def _sigmas(self, run: Run, theta: Array) -> Array:
        """(10,) one sigma of each of θ by the data alone."""
        scale = self._scale(theta)
        return self._sigma_of(self._posed(run, theta, scale), scale)

    def _sigma_of(self, triangle: Array, scale: Array) -> Array:
        """(10,) of the departures that end a triangle's unknowns."""
        count = triangle.shape[1] - 11 - self.assumed
        own = triangle[count : count + 10, count : count + 10]
        return np.asarray(scale * np.sqrt((np.linalg.inv(own) ** 2).sum(1)))

    def stands(self, run: Run, most: float = STALE) -> bool:
        """Whether the second order that was neglected, relative move times move in sigmas, doesn't show."""
        reference = run.reference
        elapsed = self.samples.part(slice(run.at - 1, run.at)).executed.end_s[0] - self.begun_s
        if np.any((run.estimate.gyro_bias - reference.gyro_bias) ** 2 * elapsed > most * self.vehicle.imu.gyro_noise_rad_s):
            return False
        theta, scale, triangle = self._about(run)
        sigma = self._sigma_of(triangle, scale)
        return self._told_by_torque(run, theta, sigma) <= most and not self._stale(theta[None], sigma[None], reference, most).any()

    def _told_by_torque(self, run: Run, theta: Array, sigma: Array) -> float:
        """What the accelerometer seems to tell of the CG by a steady torque that isn't the reference's, over what is known of it.

        Of ``ω̇ × c`` in the specific force, c is told by the reference's ω̇.
        """
        if not self.phi_map.plant.translates:
            return 0.0
        turning = run.estimate.acceleration - run.reference.acceleration
        lever = theta[MU] if self.phi_map.plant.pivoted else 1.0
        count, noise = run.at - self.cycles.start, self.vehicle.noise[3:].min()
        return float(count * (turning @ turning) * (lever * sigma[MOMENT].max() / noise) ** 2)

    def still(self, run: Run, most: float) -> bool:
        """Whether another pass would change nothing. In free flight the response is linear in 1/m, so that it is the same about any."""
        if not self.phi_map.plant.pivoted:
            run = replace(run, reference=replace(run.reference, mu=run.estimate.mu))
        return self.stands(run, most)

    def _stale(self, theta: Array, sigma: Array, reference: Reference, most: float) -> BoolArray:
        """(K,) whether θ (K, 10) ± ``sigma`` is so far from a reference, where it is known, that what is of second order shows.

        What is small beside the reference is known to be so.
        """
        phi_map = self.phi_map
        about = phi_map.plant.theta(reference)
        scales = phi_map.scales(theta)
        known = sigma < KNOWN * np.maximum(scales, phi_map.scales(about))
        if self._inertia_is_known:  # then data tell its ratios, and those better than any of it
            free = sigma[..., :9] > KNOWN * scales[..., :9]
            sigma = sigma.copy()
            sigma[..., :9] = np.where(free, RATIO * scales[..., :9], sigma[..., :9])
            known[..., :9] |= free
        if phi_map.plant.pivoted:  # what the weight does to it is much where the CG is off by little
            scales[..., MOMENT] *= PULL["balanced cg"]
        far = known & ((theta - about) ** 2 > most * sigma * scales)
        return np.asarray(far.any(1))

    def row(self, run: Run) -> Parameters:
        """The estimate of a run, one row."""
        theta, scale, whole = self._about(run)
        triangle = whole[None, : self._nuisances(run.bound) + 10]
        told = self._sensed(run, theta, scale, triangle)
        found = self._told(run, theta, scale, triangle, told, () if run.state is None else (run.state,))
        return Rows.untold(1).parameters if run.stuck else found

    def linear(self, run: Run) -> tuple[Array, Array]:
        """(10,) by how much what a run has taken in departs from its estimate, linear about that, and (10,) its variance."""
        theta, scale, triangle = self._about(run)
        own = self._nuisances(run.bound)
        root = self.phi_map.plant.slopes(theta) * scale @ np.linalg.inv(triangle[own : own + 10, own : own + 10])
        return root @ triangle[own : own + 10, own + 10], (root**2).sum(1)

    def _about(self, run: Run) -> tuple[Array, Array, Array]:
        """(10,) θ of a run's estimate, its prior's sigmas, and the triangle about them."""
        if self._last is None or self._last[0] is not run:
            theta = self.phi_map.plant.theta(run.estimate)
            scale = self._scale(theta)
            self._last = run, theta, scale, self._posed(run, theta, scale)
        return self._last[1:]

    def response(self, run: Run) -> Response:
        """What each assumption does to the estimate and to the fit."""
        (_, scale, triangle), own = self._about(run), self._nuisances(run.bound)
        theta = self.phi_map.plant.theta(run.estimate)
        end = own + 10
        shift = scale[:, None] * np.linalg.solve(triangle[own:end, own:end], triangle[own:end, end + 1 :])
        left = triangle[end:, end:]
        root = np.linalg.inv(triangle[:end, :end])[self._damping]
        damping = np.column_stack([root @ triangle[:end, end], np.sqrt((root**2).sum(1))])
        return Response(self.phi_map.plant.slopes(theta) @ shift, left.T @ left, self._added(theta, scale, triangle[:end, :end]), damping)

    @property
    def _damping(self) -> IntArray:
        """Which of the unknown beginnings are damping's, which stays as it begins."""
        block, states = Layout.of(self.samples, self.vehicle).damping, RATE.start + np.flatnonzero(self.prior > 0)
        return np.flatnonzero((states >= block.start) & (states < block.stop))

    def _added(self, theta: Array, scale: Array, triangle: Array) -> dict[str, Array]:
        """(10,) variance of the state parameters that damping and each kind of uncertain geometry add: beside their being known."""
        slopes, of = self.phi_map.plant.slopes(theta) * scale, np.full(len(triangle), "", dtype=object)
        of[len(of) - 10 - self.uncertain : len(of) - 10], of[self._damping] = self.consider.kinds, "damping"

        def variance(kept: BoolArray) -> Array:
            root = slopes @ np.linalg.inv(triangle_of(triangle[:, kept])[-10:, -10:])
            return np.asarray((root**2).sum(1))

        return {kind: variance(of == of) - variance(of != kind) for kind in dict.fromkeys(of[of != ""])}

    def posed(self, before: Run, taken: Taken) -> Posed:
        """A block's rows about the estimate before it, and the triangle after each of its cycles, with what it tells."""
        theta, scale, triangle = self._about(before)
        each, count = self._each(before, taken), self._nuisances(before.bound) + 10
        triangles = grown(triangle[:count], each)
        return Posed(theta, scale, each, triangles, self._sensed(before, theta, scale, triangles[1:]))

    def _each(self, before: Run, taken: Taken) -> Array:
        """(K, m, n + 11 + e) a block's rows about the estimate before it."""
        theta, scale, _ = self._about(before)
        white = ordered(taken.white, self.phi_map.size, self.free).reshape(*taken.white.shape[:2], -1)
        return self._reduced(white, theta, scale, before.bound)

    def astray(self, before: Run, posed: Posed) -> int | None:
        """The first cycle of a block whose estimate is too far from the reference about which the block was taken in."""
        far = np.flatnonzero(self._stale(posed.told.theta, posed.told.sigma, before.reference, ASTRAY))
        return int(far[0]) if far.size else None

    def rows(self, before: Run, taken: Taken, posed: Posed) -> Rows:
        """Estimates after each cycle of a block, about the one before it."""
        each, triangles, end = posed.rows, posed.triangles, self._nuisances(before.bound) + 11
        found = Rows.untold(len(each)).parameters
        if not before.stuck:
            found = self._told(before, posed.theta, posed.scale, triangles[1:], posed.told, taken.states)
        return Rows(found, *self._in_units(before, taken, *beyond(triangles[:-1, :, :end], each[..., :end])))

    def innovations(self, before: Run, taken: Taken) -> Rows:
        """The same without the estimates."""
        end = self._nuisances(before.bound) + 11
        each, (_, _, triangle) = self._each(before, taken)[..., :end], self._about(before)
        found = unexpected(triangle[: end - 1, :end], each)
        return Rows(Rows.untold(len(each)).parameters, *self._in_units(before, taken, *found))

    def _in_units(self, before: Run, taken: Taken, unexplained: Array, spread: Array) -> tuple[Array, Array, Array]:
        executed = self.samples.part(slice(before.at, before.at + len(unexplained))).executed
        return in_units(executed, before.estimate, before.state is None, unexplained, spread, taken.root)

    def _sensed(self, run: Run, theta: Array, scale: Array, triangles: Array) -> TriangleSolution:
        """What triangles (K, n + 10, n + 11 + e) about ``theta`` tell."""
        count = triangles.shape[1] - 10
        own = triangles[:, count:, count:]
        root, right = scale[:, None] * np.linalg.inv(own[..., :10]), own[..., 10:].copy()
        freed, right[:, MU] = self._freed(theta, scale, own[:, MU, MU], right[:, MU], np.zeros(10), CLEAR)
        root[..., MU] /= freed[:, None]
        steps = root @ right
        step = steps[..., :1]
        covariance = root @ root.transpose(0, 2, 1)
        centre, sigmas = self._pull(theta, run)
        pull = np.tile(np.diag(sigmas**2), (len(triangles), 1, 1))
        if self.weighed is not None:  # where the log doesn't tell the mass, the rest is judged beside the known one
            faint = covariance[:, MU, MU] > (quantities.FAINT * max(self.weighed, theta[MU])) ** 2
            pull[faint, MU, MU] = (EXACT * self.weighed) ** 2
        else:  # a search that began orders of magnitude away draws no mass that the log tells
            mu = theta[MU] + step[:, MU, 0]
            clear = (mu > 0) & (covariance[:, MU, MU] < (quantities.UNTOLD * mu) ** 2)
            pull[clear, MU, MU] = np.maximum(pull[clear, MU, MU], mu[clear] ** 2)
        sensible = step - covariance @ np.linalg.solve(covariance + pull, step + (theta - centre)[:, None])
        return TriangleSolution(root, steps, self.phi_map.nearest(theta, sensible[..., 0]), np.sqrt(np.einsum("kii->ki", covariance)))

    def _told(
        self, run: Run, theta: Array, scale: Array, triangles: Array, told: TriangleSolution, states: tuple[State, ...]
    ) -> Parameters:
        """The state parameters of K triangles (K, n + 10, n + 11 + e) about ``theta``."""
        count = triangles.shape[1] - 10
        # I and c are curved in θ: each row is turned into them where it stands, but for what the data don't tell
        root, step, at, sigma = told
        slopes = self.phi_map.plant.slopes(at)
        mean = self.phi_map.plant.parameters(at) + np.einsum("kij,kj->ki", slopes, theta + step[..., 0] - at)
        root, shift = slopes @ root, slopes @ step[..., 1:]
        apart = slopes * self._split(run, at, sigma)[:, None, :]
        covariance = root @ root.transpose(0, 2, 1) + apart @ apart.transpose(0, 2, 1)
        if states and random_walk(self.vehicle).any():
            # what has drifted since the beginning is a state, affine in φ and in the states' beginnings
            given = np.stack([state.mean[-10:] for state in states])
            by_phi, by_beginning = given[..., 1 : 1 + self.phi_map.size], given[..., given.shape[2] - self.free :]
            assumed = given[..., 1 + self.phi_map.size : given.shape[2] - self.free]
            assumed, geometry = assumed[..., : self.assumed], -assumed[..., self.assumed :]
            among = np.concatenate([by_beginning, by_phi, -given[..., :1], assumed, geometry], -1)
            affine = self._reduced(among, theta, scale, run.bound)
            among = affine[..., : count + 10] @ np.linalg.inv(triangles[..., : count + 10])
            moved = among @ triangles[..., count + 10 :]
            mean = mean + moved[..., 0] - affine[..., count + 10]
            shift = shift + moved[..., 1:] + assumed
            among[..., count:] += root
            drifted = np.stack([state.root[-10:] @ state.root[-10:].T for state in states])
            covariance = among @ among.transpose(0, 2, 1) + apart @ apart.transpose(0, 2, 1) + drifted
        if self.consider.covariance.any():
            shift = shift[..., : len(self.consider.covariance)]
            covariance = covariance + shift @ self.consider.covariance @ shift.transpose(0, 2, 1)
        relative = sigma[:, MOMENTS] / np.maximum(at[:, MOMENTS], np.finfo(float).tiny)
        return Parameters(mean, covariance, np.minimum(relative, 1e6))

    def _split(self, run: Run, theta: Array, sigma: Array) -> Array:
        """(K, 10) error of c or κ, as its product with J is split about the reference: its own move, where another axis' J is faint."""
        if not self.phi_map.plant.translates:  # what the accelerometer feels is linear in θ
            return np.zeros_like(theta)
        relative = np.minimum(sigma[:, MOMENTS] / np.maximum(theta[:, MOMENTS], np.finfo(float).tiny), 1.0)
        relative[:, ~self.phi_map.plant.observable[MOMENTS]] = 0.0
        found = np.zeros_like(theta)
        found[:, MOMENT] = (theta - self.phi_map.plant.theta(run.reference))[:, MOMENT] * np.maximum(
            relative[:, [1, 2, 0]], relative[:, [2, 0, 1]]
        )
        return found
