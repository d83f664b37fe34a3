"""Lack-of-fit tests: innovations against commands and motion, and the largest error that a misfit may hide.

A model that is wrong (a delay, a rise, a low-pass, a jet, a tilt, a lever arm, a torque that nobody stated) leaves residuals that follow
what drives the motion: each channel's commands, those of neighbouring cycles, rates and their products, gravity, a constant. Noise that
nobody stated does not. So residuals are regressed on such *probes*, and the sum of squares Q that d of them explain in a channel is held
against chance (lack of fit against pure error, as regression analysis has it).
:func:`innovation_test` looks into the whitened innovations about the final estimate. Where disturbances were sized until innovations
fit, the misfit is in the disturbances, so :func:`hidden_error` looks into what plain least squares leaves of rate growth and specific
force, with the pure error taken from the residuals themselves. As much of a misfit may have gone into the values as is still
visible: the least-squares error that a residual of size √Q, aligned with the regressors as badly as can be, would cause,

    δ_i² = [(AᵀA)⁻¹]_ii Q .
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, IntArray, last_before, singular, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import times
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import REFUTED, deviate, threshold
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.model.layout import MU, PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import linearise, without_tilt
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.system import specific_force_noise
from massprop_cli.prepare.align import Aligned
from massprop_cli.prepare.compensate import BLOCK, Samples, Source, biased_attitude, blocks

LAGS = (0, 1, 2)
"""Cycles by which commands are shifted: pulses that come late or smeared. Not those still to come: a controller's answer to a disturbance
follows it."""
CHANNELS = 6
"""That are tested: rate x y z, specific force x y z."""
WANDER, LEAST_WANDER = 21, 3
"""Cycles within which what wanders hardly moves, and pulses begin and end; the fewest over which a mean is one."""
SPARE = 3
"""Residuals that there must be for each probe."""


def correlation(stated: Vehicle) -> float:
    """By how much the squares that motion explains of what is left may exceed those of white noise where the model holds.

    A pulse's error and a cycle's torque turn the rate in two steps, half in each: (1 + z⁻¹) / 2 has twice its mean power where it is slow.
    """
    return 2.0 if stated.thrust.pulse_sigma > 0 or stated.environment.disturbance_torque_n_m > 0 else 1.0


def innovation_test(history: History, samples: Source, spread: float = 1.0) -> Array:
    """(6,) √(Q/d) of each channel's whitened innovations where it is more than chance, else 1: rate x y z, specific force x y z.

    By so much are the sigmas too small that the channel gives: noise and model promise 1 for each direction, or up to ``spread``
    (:func:`correlation`).
    """
    first, end, count = history.cycles.start, history.cycles.stop, 0
    folded: Array | None = None
    for start in range(first, end, BLOCK):
        cycles = slice(start, min(start + BLOCK, end))
        innovation = history.normalised[cycles.start - first : cycles.stop - first]
        told = np.isfinite(innovation).all(1)
        rows = np.hstack([_probes(samples, cycles, _whole), innovation])[told]
        folded, count = triangle_of(rows if folded is None else np.vstack([folded, rows])), count + int(told.sum())
    if folded is None:
        return np.ones(6)
    # a triangle stands for its rows: whatever is orthogonal to them, and all their products, are the same
    basis = _orthonormal(folded[:, :-6])
    if basis.shape[1] == 0 or count < SPARE * basis.shape[1]:
        return np.ones(6)
    mean = ((basis.T @ folded[:, -6:]) ** 2).mean(0)
    return np.where(deviate(mean / spread, basis.shape[1]) > threshold(REFUTED, CHANNELS), np.sqrt(mean), 1.0)


def hidden_error(history: History, samples: Source, vehicle: Resolved, spread: float = 1.0) -> Array:
    """(10,) by how much each quantity may be off through what the model does not hold, in its unit; 0 where nothing but chance is left.

    Rates and specific force each give their own; they count as each told the quantity (``history.information_share``).
    """
    reference = history.reference
    if reference is None or any(getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields):
        return np.zeros(10)  # a body that is stated to change leaves what it should
    if vehicle.estimates_assumptions:
        return np.zeros(10)  # plain least squares leaves what the regression finds of jets and IMU: the innovations are without it
    share = history.information_share
    # what wanders and is known to: a slow torque, biases, and on a bearing the attitude that the gyro gives
    tilted = vehicle.pivoted
    slow = tilted or vehicle.environment.disturbance_walk_n_m > 0
    biased = slow or vehicle.imu.accel_bias_sigma_m_s2 > 0  # a slow torque swings the IMU
    within = _within(reference, vehicle)
    rates, forces = _folded(samples, history.cycles, reference, vehicle, (slow * within, biased * within))
    parts = _hidden(rates, share[:, :3], spread), _hidden(forces, share[:, 3:], spread)
    weight = np.stack([share[:, :3].sum(1), share[:, 3:].sum(1)])
    found: Array = np.sqrt((weight * np.stack(parts)).sum(0))
    found[MU] /= reference.mu**2
    return found


def _within(reference: Reference, vehicle: Resolved) -> int:
    """Cycles within which what wanders hardly moves: :data:`WANDER`, or fewer where a slow torque soon makes more than the noise.

    N cycles of a walk of q per cycle have a variance of N (J T q)², noise in a step of the rate 2 σ² and that of a white torque.
    """
    stated = vehicle.environment
    if stated.disturbance_walk_n_m == 0:
        return WANDER
    turned = vehicle.cycle.period_s * float(np.linalg.norm(np.linalg.inv(reference.inertia), axis=1).max())
    noise = 2 * vehicle.imu.gyro_noise_rad_s**2 + (turned * stated.disturbance_torque_n_m) ** 2
    return int(np.clip(noise / (turned * stated.disturbance_walk_n_m) ** 2, LEAST_WANDER, WANDER))


def _folded(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, quick: tuple[int, int]
) -> tuple[_MeasurementRows, _MeasurementRows]:
    """Rows of rates and of specific force of a phase, folded part by part; ``quick``: cycles within which they wander little; 0: not."""
    found: list[_MeasurementRows] = []
    for part in blocks(cycles):
        # what is quick needs its neighbours
        wide = slice(max(part.start - WANDER, cycles.start), min(part.stop + WANDER, cycles.stop))
        first, last = part.start - wide.start, part.stop - wide.start
        kinds = zip(_rows(samples, wide, reference, vehicle), quick, (last - 1, last - (part.stop < cycles.stop)), strict=True)
        # what wanders is the same under every weight, so it goes before rows are weighted
        now = [
            (rows.quick(weight, within) if within else rows).weighted(weight).part(slice(first, end))
            for (rows, weight), within, end in kinds
        ]
        found = [one.joined(other).folded() for one, other in zip(found, now, strict=True)] if found else [one.folded() for one in now]
    rates, forces = found
    return rates, forces


def _rows(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved
) -> tuple[tuple[_MeasurementRows, Array], tuple[_MeasurementRows, Array]]:
    """Of rates, a row for each step between two of the cycles, and of specific force, a row for each cycle; each with their weights."""
    system, here = linearise(samples, cycles, reference, vehicle), samples.part(cycles)
    growth = np.diff(here.rate_rad_s, axis=0) - system.steps
    felt: Array = system.specific_force - times(system.observation[:, 3:, PARAMETERS], parameters(reference))
    if len(reference.scale):
        felt -= times(system.observation[:, 3:, Layout.of(samples, vehicle).scale], reference.scale)
    damping = Layout.of(samples, vehicle).damping
    if damping.stop > damping.start:  # what was found of it, which the steps have already
        felt -= times(system.observation[:, 3:, damping], reference.damping)
    if plant_of(vehicle).tilt_sigma > 0:
        felt = without_tilt(system, felt, Layout.of(samples, vehicle).tilt)
    if biased_attitude(samples.attitude_logged, vehicle):  # the attitude is off by what the bias that was found has made of it
        block, error = Layout.of(samples, vehicle).tilt, here.attitude_error_rad
        tilt = error[..., 0] + times(error[..., 1:4], reference.gyro_bias)
        growth -= times(system.transition[:, RATE, block], tilt[:-1])
        felt -= times(system.observation[:, 3:, block], tilt)
    turning, pushing = _weights(here, system.moment_to_rate, reference, vehicle)
    rates = _MeasurementRows.of_all(system.transition[:, RATE, PARAMETERS], growth, _probes(samples, cycles, _window)[:-1])
    forces = _MeasurementRows.of_all(system.observation[:, 3:, PARAMETERS], felt, _probes(samples, cycles, _whole))
    out, away = np.split(here.executed.ignored & ~samples.unread, 2, 1)
    steps, whole = _held(np.asarray((out[1:] | out[:-1]).any(1))), _held(np.asarray(away.any(1)))
    return (rates.of(steps), turning[:, steps]), (forces.of(whole), pushing[:, whole])


def _held(ignored: BoolArray) -> IntArray | slice:
    """(N,) each row; in the place of one that is not used the one before it once more, so that what wanders goes on."""
    return last_before(~ignored) if ignored.any() else slice(None)  # nothing is copied


def _weights(here: Samples, to_rate: Array, reference: Reference, vehicle: Resolved) -> tuple[Array, Array]:
    """(3, K − 1) and (3, K) weights that make each row as noisy as the quietest along its axis, of what is stated.

    ``to_rate`` (K − 1, 3, 3) is what an impulse of moment in each step does to the rate.
    """
    torque = vehicle.environment.disturbance_torque_n_m * here.executed.duration_s[1:, None, None]
    impulse = torque**2 * np.eye(3)
    if here.executed.pulse_covariance is not None:
        moment = plant_of(vehicle).jet_moment(reference)
        pulses = moment @ here.executed.pulse_covariance @ moment.T
        impulse = impulse + (pulses[:-1] + pulses[1:]) / 2
    turned = 2 * vehicle.imu.gyro_noise_rad_s**2 + np.einsum("kij,kjl,kil->ik", to_rate, impulse, to_rate)
    pushed = vehicle.imu.accel_noise_m_s2**2 + np.einsum("kii->ik", specific_force_noise(here, reference, vehicle))
    return np.sqrt(_quietest(turned) / turned), np.sqrt(_quietest(pushed) / pushed)


def _quietest(variance: Array) -> Array:
    return np.asarray(variance.min(1, keepdims=True))


@dataclass(frozen=True)
class _MeasurementRows:
    """Of one kind of measurement; ``count`` rows, which N stand for."""

    own: Array
    """(3, N, 11) along each axis: regressors on the ten parameters, and what is left."""
    probes: Array
    """(A, N, d); A is 3, or 1 of probes that are the same along each axis."""
    count: int

    @staticmethod
    def of_all(regressors: Array, residual: Array, probes: Array) -> _MeasurementRows:
        """Of regressors (N, 3, 10), what is left (N, 3) and probes (N, d) that are the same along each axis."""
        return _MeasurementRows(np.concatenate([np.moveaxis(regressors, 1, 0), residual.T[..., None]], -1), probes[None], len(residual))

    def weighted(self, weight: Array) -> _MeasurementRows:
        """By weights (3, N)."""
        alike = len(self.probes) == 1 and (weight == weight[0]).all()
        return _MeasurementRows(self.own * weight[..., None], self.probes * (weight[:1] if alike else weight)[..., None], self.count)

    def of(self, rows: IntArray | slice) -> _MeasurementRows:
        """These rows, which stand for as many as before."""
        return _MeasurementRows(self.own[:, rows], self.probes[:, rows], self.count)

    def quick(self, weight: Array, within: int) -> _MeasurementRows:
        """Less what wanders beyond so many rows, as rows of weights (3, N) show it."""
        square = weight[..., None] ** 2
        return _MeasurementRows(_quick(self.own, square, within), _quick(self._probes_by_axis, square, within), self.count)

    def part(self, rows: slice) -> _MeasurementRows:
        found = self.of(rows)
        return _MeasurementRows(found.own, found.probes, found.own.shape[1])

    def joined(self, other: _MeasurementRows) -> _MeasurementRows:
        both = [one.probes for one in (self, other)]
        if len(both[0]) != len(both[1]):
            both = [one._probes_by_axis for one in (self, other)]
        return _MeasurementRows(np.concatenate([self.own, other.own], 1), np.concatenate(both, 1), self.count + other.count)

    @property
    def _probes_by_axis(self) -> Array:
        return np.broadcast_to(self.probes, (3, *self.probes.shape[1:]))

    def folded(self) -> _MeasurementRows:
        """As the triangles of orthogonal factorisations, with the same sums of products."""
        width = self.probes.shape[2]
        if len(self.probes) == 1:
            upper = triangle_of(np.hstack([self.probes[0], *self.own]))
            return _MeasurementRows(np.stack(np.split(upper[:, width:], 3, axis=1)), upper[None, :, :width], self.count)
        each = [triangle_of(np.hstack(pair)) for pair in zip(self.probes, self.own, strict=True)]
        return _MeasurementRows(np.stack([upper[:, width:] for upper in each]), np.stack([upper[:, :width] for upper in each]), self.count)


def _hidden(rows: _MeasurementRows, share: Array, spread: float) -> Array:
    """(10,) δ² of one kind of measurement."""
    regressors, residual = rows.own[..., :10], rows.own[..., 10]
    size = np.sqrt((regressors**2).sum((0, 1)))
    seen = size > 0
    if not seen.any():
        return np.zeros(10)
    flat = (regressors[..., seen] / size[seen]).reshape(-1, int(seen.sum()))
    left, values, right = singular(flat)
    kept = values > 1e-6 * values.max(initial=0.0)
    left, values, right = left[:, kept], values[kept], right[kept]
    residual = residual - (left @ (left.T @ residual.ravel())).reshape(residual.shape)
    bases = [_orthonormal(probes) for probes in rows.probes] * (3 // len(rows.probes))
    count = np.array([basis.shape[1] for basis in bases])
    if not count.all() or rows.count < SPARE * count.max():
        return np.zeros(10)
    explained = np.array([((basis.T @ own) ** 2).sum() for basis, own in zip(bases, residual, strict=True)])
    pure = spread * np.maximum(((residual**2).sum(1) - explained) / (rows.count - count), TINY)
    excess = np.where(deviate(explained / count / pure, count) > threshold(REFUTED, CHANNELS), explained - count * pure, 0.0)
    found = np.zeros(10)
    gain = ((right / values[:, None]) ** 2).sum(0) / size[seen] ** 2
    told = np.maximum(share[seen].sum(1), TINY)
    found[seen] = gain * (share[seen] @ excess) / told
    return found


def _quick(values: Array, weight: Array, within: int) -> Array:
    """(3, N, c) less the mean, by ``weight`` (3, N, 1), of the ``within`` rows around each."""
    count = values.shape[1]
    half = min(within, count - 1) // 2
    first = np.maximum(np.arange(count) - half, 0)
    last = np.minimum(np.arange(count) + half + 1, count)

    def around(summed: Array) -> Array:
        total = np.concatenate([np.zeros_like(summed[:, :1]), np.cumsum(summed, axis=1)], 1)
        return np.asarray(total[:, last] - total[:, first])

    return np.asarray(values - around(weight * values) / around(weight))


def _whole(executed: Aligned) -> Array:
    """(K, C) what each command channel did in each cycle."""
    return executed.channels.whole


def _window(executed: Aligned) -> Array:
    """(K, C) the same under the triangular window of the step out of each cycle; zeros in the last."""
    channels, found = executed.channels, np.zeros_like(executed.channels.whole)
    found[:-1] = channels.step
    return found


def _probes(samples: Source, cycles: slice, commands: Callable[[Aligned], Array]) -> Array:
    """(K, d) what a wrong model could leave: commands, now and :data:`LAGS` ago, rates and their products, the vertical, a constant.

    The rates are those of the cycle before: noise in a cycle's own is in what is left of it, and would be taken for a misfit where a
    spin is so steady that nothing but noise is left of it beside the constant.
    """
    before = min(cycles.start, max(LAGS))
    here = samples.part(slice(cycles.start - before, cycles.stop))
    told, lagged = commands(here.executed), []
    for lag in LAGS:
        shifted = np.roll(told, lag, axis=0)
        shifted[:lag] = 0.0  # beyond the log's beginning
        lagged.append(shifted)
    rate = np.concatenate([here.rate_rad_s[:1], here.rate_rad_s[:-1]])
    return np.hstack([*lagged, rate, products(rate), here.up_b[:-1], np.ones((len(rate), 1))])[before:]


def _orthonormal(columns: Array) -> Array:
    """(N, r) basis of what the columns span."""
    size = np.sqrt((columns**2).sum(0))
    left, values, _ = singular(columns[:, size > 0] / size[size > 0])
    return left[:, values > 1e-6 * values.max(initial=0.0)]
