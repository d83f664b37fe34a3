"""Lack-of-fit tests: regression of residuals on commands and motion, and the largest error that a misfit may hide.

A wrong model leaves residuals that follow what drives the motion, while unstated noise does not. So residuals are regressed on *probes*:
each channel's commands, those of neighbouring cycles, rates and their products, gravity, a constant. The sum of squares Q that d probes
explain in a channel is tested against chance.

- :func:`innovation_test` tests whitened innovations about the final estimate.
- :func:`hidden_error` tests plain least-squares residuals, since sized disturbances absorb a misfit of the innovations. Its pure error is
  that of the residuals. It bounds the error of the values by the case that the explained residual √Q is aligned with the regressors A as
  badly as possible:

    δ_i² = [(AᵀA)⁻¹]_ii Q .
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, IntArray, last_before, singular, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import times
from massprop_cli.diagnosis.design import CYCLES_PER_COLUMN
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
"""Delays of the commands among the probes, cycles. Later commands are left out, since a controller responds to disturbances."""
CHANNELS = 6
"""Tested channels: rate x y z, specific force x y z."""
WANDER, LEAST_WANDER = 21, 3
"""Cycles within which slow variation is negligible, but pulses begin and end; least cycles of a mean."""


def correlation(stated: Vehicle) -> float:
    """Factor by which correlated noise may exceed white noise in the explained squares.

    The error of a pulse, or the torque of a cycle, enters two rate steps, half in each: (1 + z⁻¹) / 2 has twice its mean power at low
    frequency.
    """
    return 2.0 if stated.thrust.pulse_sigma > 0 or stated.environment.disturbance_torque_n_m > 0 else 1.0


def innovation_test(history: History, samples: Source, spread: float = 1.0) -> Array:
    """(6,) √(Q/d) of each channel's whitened innovations if it is significant, else 1: rate x y z, specific force x y z.

    It is the factor by which the channel's sigmas are too small. Noise gives 1, or up to ``spread`` (:func:`correlation`).
    """
    first, end, count = history.cycles.start, history.cycles.stop, 0
    folded: Array | None = None
    for start in range(first, end, BLOCK):
        cycles = slice(start, min(start + BLOCK, end))
        innovation = history.normalised[cycles.start - first : cycles.stop - first]
        finite = np.isfinite(innovation).all(1)
        rows = np.hstack([_probes(samples, cycles, _whole), innovation])[finite]
        folded, count = triangle_of(rows if folded is None else np.vstack([folded, rows])), count + int(finite.sum())
    if folded is None:
        return np.ones(6)
    # a triangle has the same inner products as its rows
    basis = _orthonormal(folded[:, :-6])
    if basis.shape[1] == 0 or count < CYCLES_PER_COLUMN * basis.shape[1]:
        return np.ones(6)
    mean = ((basis.T @ folded[:, -6:]) ** 2).mean(0)
    return np.where(deviate(mean / spread, basis.shape[1]) > threshold(REFUTED, CHANNELS), np.sqrt(mean), 1.0)


def hidden_error(history: History, samples: Source, vehicle: Resolved, spread: float = 1.0) -> Array:
    """(10,) largest hidden error of each quantity, in its unit; 0 where the misfit is chance.

    Rates and specific force have one each, weighted by their information (``history.information_share``).
    """
    reference = history.reference
    if reference is None or any(getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields):
        return np.zeros(10)  # a stated change of the body leaves residuals
    if vehicle.estimates_assumptions:
        return np.zeros(10)  # plain residuals contain the estimated errors of jets and IMU; innovations do not
    share = history.information_share
    # known slow variation: a slow torque, biases, and on a bearing the integrated attitude
    tilted = vehicle.pivoted
    slow = tilted or vehicle.environment.disturbance_walk_n_m > 0
    biased = slow or vehicle.imu.accel_bias_sigma_m_s2 > 0  # a slow torque accelerates the IMU
    within = _wander_cycles(reference, vehicle)
    rates, forces = _folded(samples, history.cycles, reference, vehicle, (slow * within, biased * within))
    squares = _hidden_squares(rates, share[:, :3], spread), _hidden_squares(forces, share[:, 3:], spread)
    weight = np.stack([share[:, :3].sum(1), share[:, 3:].sum(1)])
    error: Array = np.sqrt((weight * np.stack(squares)).sum(0))
    error[MU] /= reference.mu**2
    return error


def _wander_cycles(reference: Reference, vehicle: Resolved) -> int:
    """Cycles within which slow variation is negligible: :data:`WANDER`, or fewer if a slow torque soon exceeds the noise.

    N cycles of a torque walk of q per cycle have a variance of N (J T q)². Noise in a rate step has 2 σ² and that of a white torque.
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
    """Rows of rates and of specific force of a phase, reduced to triangles part by part.

    ``quick``: cycles of the moving mean that is subtracted from each; 0: none.
    """
    folded: list[_MeasurementRows] = []
    for part in blocks(cycles):
        # a moving mean needs neighbours
        wide = slice(max(part.start - WANDER, cycles.start), min(part.stop + WANDER, cycles.stop))
        first, last = part.start - wide.start, part.stop - wide.start
        kinds = zip(_rows(samples, wide, reference, vehicle), quick, (last - 1, last - (part.stop < cycles.stop)), strict=True)
        # the mean is subtracted before weighting
        part_rows = [
            (rows.without_mean(weight, within) if within else rows).weighted(weight).part(slice(first, end))
            for (rows, weight), within, end in kinds
        ]
        folded = (
            [one.joined(other).folded() for one, other in zip(folded, part_rows, strict=True)]
            if folded
            else [one.folded() for one in part_rows]
        )
    rates, forces = folded
    return rates, forces


def _rows(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved
) -> tuple[tuple[_MeasurementRows, Array], tuple[_MeasurementRows, Array]]:
    """Rows and weights of rates, one row per step between cycles, and of specific force, one row per cycle."""
    system, here = linearise(samples, cycles, reference, vehicle), samples.part(cycles)
    growth = np.diff(here.rate_rad_s, axis=0) - system.steps
    felt: Array = system.specific_force - times(system.observation[:, 3:, PARAMETERS], parameters(reference))
    if len(reference.scale):
        felt -= times(system.observation[:, 3:, Layout.of(samples, vehicle).scale], reference.scale)
    damping = Layout.of(samples, vehicle).damping
    if damping.stop > damping.start:  # estimated damping, which the steps contain
        felt -= times(system.observation[:, 3:, damping], reference.damping)
    if plant_of(vehicle).tilt_sigma > 0:
        felt = without_tilt(system, felt, Layout.of(samples, vehicle).tilt)
    if biased_attitude(samples.attitude_logged, vehicle):  # the attitude error by the estimated bias
        block, error = Layout.of(samples, vehicle).tilt, here.attitude_error_rad
        tilt = error[..., 0] + times(error[..., 1:4], reference.gyro_bias)
        growth -= times(system.transition[:, RATE, block], tilt[:-1])
        felt -= times(system.observation[:, 3:, block], tilt)
    turning, pushing = _weights(here, system.moment_to_rate, reference, vehicle)
    rates = _MeasurementRows.of_all(system.transition[:, RATE, PARAMETERS], growth, _probes(samples, cycles, _window)[:-1])
    forces = _MeasurementRows.of_all(system.observation[:, 3:, PARAMETERS], felt, _probes(samples, cycles, _whole))
    rate_ignored, force_ignored = np.split(here.executed.ignored & ~samples.unread, 2, 1)
    steps, whole = _last_used(np.asarray((rate_ignored[1:] | rate_ignored[:-1]).any(1))), _last_used(np.asarray(force_ignored.any(1)))
    return (rates.of(steps), turning[:, steps]), (forces.of(whole), pushing[:, whole])


def _last_used(ignored: BoolArray) -> IntArray | slice:
    """(N,) row numbers, with the last used row in place of each ignored one."""
    return last_before(~ignored) if ignored.any() else slice(None)  # no copy


def _weights(here: Samples, to_rate: Array, reference: Reference, vehicle: Resolved) -> tuple[Array, Array]:
    """(3, K − 1) and (3, K) weights that give each row the least stated noise of its axis.

    ``to_rate`` (K − 1, 3, 3): response of the rate to an impulse of moment in each step.
    """
    torque = vehicle.environment.disturbance_torque_n_m * here.executed.duration_s[1:, None, None]
    impulse = torque**2 * np.eye(3)
    if here.executed.pulse_covariance is not None:
        moment = plant_of(vehicle).jet_moment(reference)
        pulses = moment @ here.executed.pulse_covariance @ moment.T
        impulse = impulse + (pulses[:-1] + pulses[1:]) / 2
    rate_variance = 2 * vehicle.imu.gyro_noise_rad_s**2 + np.einsum("kij,kjl,kil->ik", to_rate, impulse, to_rate)
    force_variance = vehicle.imu.accel_noise_m_s2**2 + np.einsum("kii->ik", specific_force_noise(here, reference, vehicle))
    return np.sqrt(_quietest(rate_variance) / rate_variance), np.sqrt(_quietest(force_variance) / force_variance)


def _quietest(variance: Array) -> Array:
    return np.asarray(variance.min(1, keepdims=True))


@dataclass(frozen=True)
class _MeasurementRows:
    """Least-squares rows of one kind of measurement: ``count`` rows, reduced to N."""

    by_axis: Array
    """(3, N, 11) for each axis: regressors of the ten parameters, and residual."""
    probes: Array
    """(A, N, d) probes; A is 3, or 1 if they are the same for each axis."""
    count: int

    @staticmethod
    def of_all(regressors: Array, residual: Array, probes: Array) -> _MeasurementRows:
        """Rows of regressors (N, 3, 10), residuals (N, 3) and common probes (N, d)."""
        return _MeasurementRows(np.concatenate([np.moveaxis(regressors, 1, 0), residual.T[..., None]], -1), probes[None], len(residual))

    def weighted(self, weight: Array) -> _MeasurementRows:
        """Rows times weights (3, N)."""
        alike = len(self.probes) == 1 and (weight == weight[0]).all()
        return _MeasurementRows(self.by_axis * weight[..., None], self.probes * (weight[:1] if alike else weight)[..., None], self.count)

    def of(self, rows: IntArray | slice) -> _MeasurementRows:
        """Selected rows, with the count unchanged."""
        return _MeasurementRows(self.by_axis[:, rows], self.probes[:, rows], self.count)

    def without_mean(self, weight: Array, within: int) -> _MeasurementRows:
        """Rows less their moving mean over ``within`` rows, by weights (3, N)."""
        square = weight[..., None] ** 2
        return _MeasurementRows(
            _without_mean(self.by_axis, square, within), _without_mean(self._probes_by_axis, square, within), self.count
        )

    def part(self, rows: slice) -> _MeasurementRows:
        selected = self.of(rows)
        return _MeasurementRows(selected.by_axis, selected.probes, selected.by_axis.shape[1])

    def joined(self, other: _MeasurementRows) -> _MeasurementRows:
        both = [one.probes for one in (self, other)]
        if len(both[0]) != len(both[1]):
            both = [one._probes_by_axis for one in (self, other)]
        return _MeasurementRows(np.concatenate([self.by_axis, other.by_axis], 1), np.concatenate(both, 1), self.count + other.count)

    @property
    def _probes_by_axis(self) -> Array:
        return np.broadcast_to(self.probes, (3, *self.probes.shape[1:]))

    def folded(self) -> _MeasurementRows:
        """The same inner products as triangles of orthogonal factorisations."""
        width = self.probes.shape[2]
        if len(self.probes) == 1:
            upper = triangle_of(np.hstack([self.probes[0], *self.by_axis]))
            return _MeasurementRows(np.stack(np.split(upper[:, width:], 3, axis=1)), upper[None, :, :width], self.count)
        each = [triangle_of(np.hstack(pair)) for pair in zip(self.probes, self.by_axis, strict=True)]
        return _MeasurementRows(np.stack([upper[:, width:] for upper in each]), np.stack([upper[:, :width] for upper in each]), self.count)


def _hidden_squares(rows: _MeasurementRows, share: Array, spread: float) -> Array:
    """(10,) δ² of one kind of measurement."""
    regressors, residual = rows.by_axis[..., :10], rows.by_axis[..., 10]
    size = np.sqrt((regressors**2).sum((0, 1)))
    sensitive = size > 0
    if not sensitive.any():
        return np.zeros(10)
    flat = (regressors[..., sensitive] / size[sensitive]).reshape(-1, int(sensitive.sum()))
    left, values, right = singular(flat)
    determined = values > 1e-6 * values.max(initial=0.0)
    left, values, right = left[:, determined], values[determined], right[determined]
    residual = residual - (left @ (left.T @ residual.ravel())).reshape(residual.shape)
    bases = [_orthonormal(probes) for probes in rows.probes] * (3 // len(rows.probes))
    count = np.array([basis.shape[1] for basis in bases])
    if not count.all() or rows.count < CYCLES_PER_COLUMN * count.max():
        return np.zeros(10)
    explained = np.array([((basis.T @ of_axis) ** 2).sum() for basis, of_axis in zip(bases, residual, strict=True)])
    pure = spread * np.maximum(((residual**2).sum(1) - explained) / (rows.count - count), TINY)
    excess = np.where(deviate(explained / count / pure, count) > threshold(REFUTED, CHANNELS), explained - count * pure, 0.0)
    square = np.zeros(10)
    gain = ((right / values[:, None]) ** 2).sum(0) / size[sensitive] ** 2
    total = np.maximum(share[sensitive].sum(1), TINY)
    square[sensitive] = gain * (share[sensitive] @ excess) / total
    return square


def _without_mean(values: Array, weight: Array, within: int) -> Array:
    """(3, N, c) values less their mean, by ``weight`` (3, N, 1), over the ``within`` rows around each."""
    count = values.shape[1]
    half = min(within, count - 1) // 2
    first = np.maximum(np.arange(count) - half, 0)
    last = np.minimum(np.arange(count) + half + 1, count)

    def around(summed: Array) -> Array:
        total = np.concatenate([np.zeros_like(summed[:, :1]), np.cumsum(summed, axis=1)], 1)
        return np.asarray(total[:, last] - total[:, first])

    return np.asarray(values - around(weight * values) / around(weight))


def _whole(executed: Aligned) -> Array:
    """(K, C) impulse of each channel in each cycle."""
    return executed.channels.whole


def _window(executed: Aligned) -> Array:
    """(K, C) impulse of each channel under the triangular window of the step out of each cycle; zeros in the last."""
    channels, impulses = executed.channels, np.zeros_like(executed.channels.whole)
    impulses[:-1] = channels.step
    return impulses


def _probes(samples: Source, cycles: slice, commands: Callable[[Aligned], Array]) -> Array:
    """(K, d) probes: commands now and :data:`LAGS` cycles ago, rates and their products, vertical, constant.

    The rates are those of the previous cycle. Noise of a cycle's own rate is part of its residual, and would count as misfit if a steady
    spin has little but noise.
    """
    preceding = min(cycles.start, max(LAGS))
    here = samples.part(slice(cycles.start - preceding, cycles.stop))
    impulses, lagged = commands(here.executed), []
    for lag in LAGS:
        shifted = np.roll(impulses, lag, axis=0)
        shifted[:lag] = 0.0  # before the start of the log
        lagged.append(shifted)
    rate = np.concatenate([here.rate_rad_s[:1], here.rate_rad_s[:-1]])
    return np.hstack([*lagged, rate, products(rate), here.up_b[:-1], np.ones((len(rate), 1))])[preceding:]


def _orthonormal(columns: Array) -> Array:
    """(N, r) orthonormal basis of the columns' span."""
    size = np.sqrt((columns**2).sum(0))
    left, values, _ = singular(columns[:, size > 0] / size[size > 0])
    return left[:, values > 1e-6 * values.max(initial=0.0)]
