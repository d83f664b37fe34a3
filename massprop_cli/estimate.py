"""The default estimator: a square-root Kalman filter on the linear response, run through a phase cycle by cycle.

The equations are linear about a reference (:mod:`massprop_cli.linearise`). The reference comes from the cycles seen so far
(:mod:`massprop_cli.start`); when the estimate has moved so far from it that the neglected second order would show, the filter takes its
own estimate as the new reference and goes once more through the cycles it has seen. So every row depends on its own and earlier cycles
only, no starting value is needed, and the last rows equal a Gauss–Newton (maximum-likelihood) fit of all data so far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from massprop_cli.arrays import Array
from massprop_cli.compensate import Samples
from massprop_cli.history import History
from massprop_cli.kalman import Innovation, State, predict, update
from massprop_cli.linearise import CG, MU, PARAMETERS, RATE, Layout, Linear, linearise, natural_sizes, parameters, stepped
from massprop_cli.observability import excitation, observable
from massprop_cli.plant import BearingBody, Reference, plant_of
from massprop_cli.posterior import alone, discrepancies, quantities
from massprop_cli.sensitivity import Consider, fed
from massprop_cli.start import first_reference
from massprop_cli.telemetry import Notice
from massprop_cli.vehicle import Phase, Vehicle

BLOCK = 64
"""Cycles linearised at a time."""
FIRST = 16
"""Least number of cycles between attempts to find a first reference."""
MISMATCH = 4.0
"""A known quantity further than this many sigmas from the log's own estimate is pointed out."""
STALE = 0.02
"""Largest second-order error of the linearisation, in sigmas, before the reference is renewed."""


SETTLINGS = 8
"""Most passes of the off-line fit."""


@dataclass(frozen=True)
class _Run:
    """The filter after some cycle of a phase."""

    reference: Reference
    state: State
    since: int
    """The cycle at which the reference was taken."""


@dataclass(frozen=True)
class Row:
    """What the filter knew after one cycle: state entries, their covariance, innovation in rate and specific force."""

    reference: Reference
    mean: Array
    covariance: Array
    innovation: Innovation | None


def replay(
    samples: Samples,
    cycles: slice,
    phase: Phase,
    vehicle: Vehicle,
    consider: Consider = Consider(),  # noqa: B008  a constant: it is frozen
    progress: Callable[[float], None] | None = None,
) -> History:
    """Run the filter through ``cycles`` (non-empty). Noise levels must be set in ``vehicle`` (:mod:`massprop_cli.noise`).

    What is uncertain in ``consider`` enters every sigma. ``progress`` is told the part done, 0 to 1, after every block.
    """
    rows: list[Row | None] = []
    run: _Run | None = None
    begin = cycles.start
    while begin < cycles.stop:
        wait = max(FIRST, (begin - cycles.start) // 200)  # in proportion, so that a long quiet stretch doesn't cost its square
        due = begin + (wait if run is None else BLOCK)
        end = min(due, cycles.stop)
        if progress is not None:
            progress((begin - cycles.start) / (cycles.stop - cycles.start))
        if run is None:
            rows += [None] * (end - begin)
            # at due times only: an attempt at the log's end would give its last row what a longer log has not yet
            reference = first_reference(samples, slice(cycles.start, end), vehicle) if end == due else None
            if reference is not None:
                run, again = _from_start(samples, slice(cycles.start, end), reference, vehicle, consider)
                rows[-1] = again[-1]
            begin = end
            continue
        found, run, begin = _advance(samples, slice(cycles.start, end), begin, run, vehicle, consider)
        rows += found
    return _history(samples, cycles, phase, vehicle, rows)


def settle(
    samples: Samples,
    cycles: slice,
    phase: Phase,
    reference: Reference,
    vehicle: Vehicle,
    consider: Consider = Consider(),  # noqa: B008
) -> History:
    """The off-line fit: the filter with the whole phase at hand, from ``reference`` on.

    Repeated about its own last estimate until that stands still, which is Gauss–Newton on the likelihood of all data; its rows are not
    causal.
    """
    for _ in range(SETTLINGS):
        run, rows = _from_start(samples, cycles, reference, vehicle, consider)
        if not _stale(run.state, reference, samples, cycles, vehicle):
            break
        reference = _renewed(run.state, reference, samples, cycles, vehicle)
    return _history(samples, cycles, phase, vehicle, rows)


@dataclass(frozen=True)
class Response:
    """What one unit of each of e assumptions would have changed."""

    shift: Array
    """(10, e) of the state parameters at the end."""
    misfit: Array
    """(e, e) Gram matrix of what it would leave in the whitened innovations: its diagonal is chi-square for one unit."""


def respond(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle, driven: Array, measured: Array) -> Response:
    """One pass of the filter about ``reference`` that carries derivatives of drive (K − 1, n, e) and of measurements (K, 6, e)."""
    system = linearise(samples, cycles, reference, vehicle)
    noise = _Noise.of(samples, cycles, reference, vehicle, system)
    state = _initial(samples, cycles, reference, vehicle)
    mean = np.zeros((len(state.mean), measured.shape[2]))
    mean[RATE] = measured[0, :3]
    state = State(mean, state.root)
    state, innovation = update(state, measured[0, 3:], system.observation[0, 3:], noise.measurement[0, 3:, 3:])
    misfit = innovation.normalised.T @ innovation.normalised
    for k in range(1, len(measured)):
        state = predict(state, system.transition[k - 1], driven[k - 1], None if noise.process is None else noise.process[k - 1])
        state, innovation = update(state, measured[k], system.observation[k], noise.measurement[k])
        white = innovation.normalised
        misfit = misfit + white.T @ white
    return Response(state.mean[PARAMETERS], misfit)


def _advance(
    samples: Samples, seen: slice, begin: int, run: _Run, vehicle: Vehicle, consider: Consider
) -> tuple[list[Row | None], _Run, int]:
    """Take the cycles from ``begin`` to the end of ``seen``, or up to the one after which the reference had to be renewed."""
    system = linearise(samples, slice(begin - 1, seen.stop), run.reference, vehicle)
    noise = _Noise.of(samples, slice(begin - 1, seen.stop), run.reference, vehicle, system)
    feed = fed(system, samples, slice(begin - 1, seen.stop), run.reference, vehicle, consider.variants)
    rows: list[Row | None] = []
    state = run.state
    for k in range(1, seen.stop - begin + 1):
        state, row = _cycle(state, system, feed, noise, k, run.reference, consider)
        rows.append(row)
        cycle = begin + k
        if cycle - run.since >= max(4, (run.since - seen.start) // 50) and _stale(
            state, run.reference, samples, slice(seen.start, cycle), vehicle
        ):
            reference = _renewed(state, run.reference, samples, slice(seen.start, cycle), vehicle)
            run, again = _from_start(samples, slice(seen.start, cycle), reference, vehicle, consider)
            rows[-1] = again[-1]
            return rows, run, cycle
    return rows, replace(run, state=state), seen.stop


def _from_start(samples: Samples, seen: slice, reference: Reference, vehicle: Vehicle, consider: Consider) -> tuple[_Run, list[Row | None]]:
    """The filter through ``seen``, from a fresh covariance, about ``reference``."""
    system = linearise(samples, seen, reference, vehicle)
    noise = _Noise.of(samples, seen, reference, vehicle, system)
    feed = fed(system, samples, seen, reference, vehicle, consider.variants)
    measured = feed[1]
    state = _initial(samples, seen, reference, vehicle)
    shifts = np.zeros((len(state.mean), len(consider.variants)))
    shifts[RATE] = measured[0, :3, 1:]
    state = State(np.column_stack([state.mean, shifts]), state.root)
    state, _ = update(state, measured[0, 3:], system.observation[0, 3:], noise.measurement[0, 3:, 3:])
    rows: list[Row | None] = [_row(reference, state, None, consider)]
    for k in range(1, seen.stop - seen.start):
        state, row = _cycle(state, system, feed, noise, k, reference, consider)
        rows.append(row)
    return _Run(reference, state, seen.stop), rows


def _cycle(
    state: State, system: Linear, feed: tuple[Array, Array], noise: _Noise, k: int, reference: Reference, consider: Consider
) -> tuple[State, Row]:
    process = None if noise.process is None else noise.process[k - 1]
    state = predict(state, system.transition[k - 1], feed[0][k - 1], process)
    state, innovation = update(state, feed[1][k], system.observation[k], noise.measurement[k])
    return state, _row(reference, state, Innovation(innovation.value[:, 0], innovation.root), consider)


def _row(reference: Reference, state: State, innovation: Innovation | None, consider: Consider) -> Row:
    root, shift = state.root[PARAMETERS], state.mean[PARAMETERS, 1:]
    covariance = root @ root.T
    if consider.variants:
        covariance = covariance + shift @ consider.covariance @ shift.T
    return Row(reference, state.mean[:, 0], covariance, innovation)


@dataclass(frozen=True)
class _Noise:
    """Square roots of the noise covariances: process (K − 1, n, q) or None, measurement (K, 6, 6)."""

    process: Array | None
    measurement: Array

    @staticmethod
    def of(samples: Samples, cycles: slice, reference: Reference, vehicle: Vehicle, system: Linear) -> _Noise:
        duration = samples.executed.duration_s[cycles]
        layout = Layout.of(samples, vehicle)
        columns = []
        if vehicle.environment.disturbance_torque_n_m > 0:
            impulse = vehicle.environment.disturbance_torque_n_m * duration[1:, None, None]
            columns.append(_rate_columns(system.moment_to_rate * impulse, layout))
        if layout.torque.stop > layout.torque.start:
            walk = np.zeros((len(duration) - 1, layout.size, 3))
            walk[:, layout.torque] = vehicle.environment.disturbance_walk_n_m * np.eye(3)
            columns.append(walk)
        drift = np.array([getattr(vehicle.drift, name) for name in type(vehicle.drift).model_fields])
        if drift.any():
            drift[MU] *= reference.mu**2
            step = np.zeros((len(duration) - 1, layout.size, 10))
            step[:, PARAMETERS] = np.diag(drift) * np.sqrt(duration[1:])[:, None, None]
            columns.append(step)
        measurement = np.zeros((len(duration), 6, 6))
        scale = np.array(vehicle.estimator.accel_noise_scale or (1.0, 1.0, 1.0))
        stated = np.concatenate([[vehicle.imu.gyro_noise_rad_s] * 3, scale * (vehicle.imu.accel_noise_m_s2 or 0.0)])
        measurement[:] = np.diag(stated.astype(float))
        if samples.executed.pulse_covariance is not None:
            rate, force = _pulse_noise(samples.executed.pulse_covariance[cycles], reference, vehicle, system, duration)
            columns.append(_rate_columns(rate, layout))
            measurement[:, 3:, 3:] = np.linalg.cholesky(measurement[:, 3:, 3:] ** 2 + force)
        return _Noise(np.concatenate(columns, -1) if columns else None, measurement)


def _rate_columns(block: Array, layout: Layout) -> Array:
    columns = np.zeros((len(block), layout.size, 3))
    columns[:, RATE] = block
    return columns


def _pulse_noise(covariance: Array, reference: Reference, vehicle: Vehicle, system: Linear, duration: Array) -> tuple[Array, Array]:
    """Root of the rate's process noise (K − 1, 3, 3) and covariance of the specific force (K, 3, 3) from pulse errors.

    A pulse's error enters the rate once; here it enters with the step out of its cycle, and the accelerometer's share counts as
    independent of it.
    """
    moment = plant_of(vehicle).jet_moment(reference)
    values, axes = np.linalg.eigh(moment @ covariance[:-1] @ moment.T)
    root = system.moment_to_rate @ (axes * np.sqrt(np.clip(values, 0, None))[:, None, :])
    force = reference.mu**2 * covariance[:, 3:, 3:] / (duration**2)[:, None, None]
    return root, force


def _initial(samples: Samples, seen: slice, reference: Reference, vehicle: Vehicle) -> State:
    """The prior: parameters wide about the reference, the rate as first measured, nuisances at zero."""
    layout = Layout.of(samples, vehicle)
    mean, root = np.zeros(layout.size), np.zeros((layout.size, layout.size))
    mean[PARAMETERS] = parameters(reference)
    mean[RATE] = samples.rate_rad_s[seen.start]
    root[PARAMETERS, PARAMETERS] = np.diag(vehicle.estimator.prior_scale * natural_sizes(reference))
    root[RATE, RATE] = (vehicle.imu.gyro_noise_rad_s or 0.0) * np.eye(3)
    root[layout.gyro_bias, layout.gyro_bias] = _diagonal(vehicle.imu.gyro_bias_sigma_rad_s, layout.gyro_bias)
    if layout.gyro_bias.stop > layout.gyro_bias.start:
        root[RATE, layout.gyro_bias] = -vehicle.imu.gyro_bias_sigma_rad_s * np.eye(3)
    root[layout.accel_bias, layout.accel_bias] = _diagonal(vehicle.imu.accel_bias_sigma_m_s2, layout.accel_bias)
    root[layout.torque, layout.torque] = _diagonal(_torque_size(samples, seen), layout.torque)
    return State(mean, root)


def _diagonal(sigma: float, block: slice) -> Array:
    return sigma * np.eye(block.stop - block.start)


def _torque_size(samples: Samples, seen: slice) -> float:
    """Root mean square executed torque, N m."""
    torque = samples.executed.impulse[seen, :3] / samples.executed.duration_s[seen, None]
    return float(np.sqrt((torque**2).mean()))


def _reach(reference: Reference, samples: Samples, seen: slice, vehicle: Vehicle) -> Array:
    """(10,) how far a parameter may move before the response changes by its own size.

    On a bearing gravity turns a CG offset into a torque as large as the jets', so the CG's reach is the torque over the weight.
    """
    reach = natural_sizes(reference)
    plant = plant_of(vehicle)
    if isinstance(plant, BearingBody) and plant.gravity > 0:
        weight = plant.rotating_mass(reference) * plant.gravity
        reach[CG] = np.minimum(reach[CG], _torque_size(samples, seen) / weight)
    return reach


def _stale(state: State, reference: Reference, samples: Samples, seen: slice, vehicle: Vehicle) -> bool:
    """Whether the neglected second order, relative move times move in sigmas, would show."""
    bias = Layout.of(samples, vehicle).gyro_bias
    elapsed = samples.executed.end_s[seen.stop - 1] - samples.executed.start_s[seen.start]
    bias_error = (state.mean[bias, 0] - reference.gyro_bias[: bias.stop - bias.start]) ** 2 * elapsed
    if np.any(bias_error > STALE * (vehicle.imu.gyro_noise_rad_s or 0.0)):
        return True
    move = np.abs(_sensible(state, reference) - parameters(reference))
    sigma = np.sqrt((state.root[PARAMETERS] ** 2).sum(1))
    return bool(np.any(move**2 > STALE * sigma * _reach(reference, samples, seen, vehicle)))


def _sensible(state: State, reference: Reference) -> Array:
    """(10,) the parameters, with those that the data don't tell kept near the reference.

    That is the estimate conditioned on the reference with a sigma of a tenth of its natural size.
    """
    root = state.root[PARAMETERS]
    covariance = root @ root.T
    pull = covariance + np.diag((0.1 * natural_sizes(reference)) ** 2)
    mean = state.mean[PARAMETERS, 0]
    sensible: Array = mean - covariance @ np.linalg.solve(pull, mean - parameters(reference))
    return sensible


def _renewed(state: State, reference: Reference, samples: Samples, seen: slice, vehicle: Vehicle) -> Reference:
    """The estimate as a reference; where that is no body, one found from the data anew."""
    bias = Layout.of(samples, vehicle).gyro_bias
    gyro_bias = state.mean[bias, 0] if bias.stop > bias.start else np.zeros(3)
    return stepped(reference, _sensible(state, reference), gyro_bias) or first_reference(samples, seen, vehicle) or reference


def _history(samples: Samples, cycles: slice, phase: Phase, vehicle: Vehicle, rows: list[Row | None]) -> History:
    count = len(rows)
    mean, covariance = np.full((count, 10), np.nan), np.full((count, 10, 10), np.nan)
    innovation, sigma, normalised = (np.full((count, 6), np.nan) for _ in range(3))
    duration = samples.executed.duration_s[cycles]
    for k, row in enumerate(rows):
        if row is None:
            continue
        mean[k], covariance[k] = row.mean[PARAMETERS], row.covariance
        if row.innovation is not None:
            scale = np.zeros((6, 6))
            scale[:3, :3], scale[3:, 3:] = row.reference.inertia / duration[k], np.eye(3) / row.reference.mu
            normalised[k] = row.innovation.normalised
            innovation[k] = scale @ row.innovation.value
            sigma[k] = np.sqrt(((scale @ row.innovation.root) ** 2).sum(1))
    values, full = quantities(mean, covariance, vehicle)
    last = rows[-1]
    bare = quantities(mean[-1:], covariance[-1:], alone(vehicle))
    apart = {name: z for name, z in discrepancies(mean[-1], covariance[-1], vehicle).items() if abs(z) > MISMATCH}
    sizes: Array = np.full(10, np.nan)
    share: Array = np.zeros((10, 6))
    drowned, seen = np.zeros(6, dtype=bool), np.ones(10, dtype=bool)
    if last is not None:
        sizes = natural_sizes(last.reference)
        sizes[MU] = 1 / last.reference.mu
        share, drowned = excitation(samples, cycles, last.reference, vehicle)
        seen = observable(samples.executed.capability, last.reference, vehicle)
    return History(
        phase=phase,
        cycles=cycles,
        time_s=samples.executed.end_s[cycles],
        values=values,
        sigmas=np.sqrt(np.einsum("kii->ki", full)),
        covariance=full[-1],
        innovation=innovation,
        innovation_sigma=sigma,
        normalised=normalised,
        natural_sizes=sizes,
        information_share=share,
        drowned=drowned,
        observable=seen,
        bare=(bare[0][0], bare[1][0]),
        reference=None if last is None else last.reference,
        belied=tuple(apart),
        notices=tuple(
            Notice(
                "known-mismatch",
                f"phase {phase.name}: known.{name} = {vehicle.known[name].value:g} lies {abs(z):.3g} sigmas from what the log alone says; "
                "check it, the thrust, and thrust.scale_sigma",
            )
            for name, z in apart.items()
        ),
    )
