"""Least-squares fit of a segment about a reference, with extra unknowns in addition to the mass properties.

Without process noise the filter's linear system is one least-squares problem in the initial state: mass properties, rate, nuisance
parameters, and extra unknowns such as a change of the delay.
"""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import ITERATIONS
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import Linear, linearise
from massprop_cli.model.parameters import natural_sizes, parameters, stepped
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source

SETTLED = 1e-5
"""Relative change of chi-square at which they end."""
PRIOR = 100.0
"""Prior sigma of the mass properties over their natural size."""
GROWTH = float(1 / np.finfo(float).eps)
"""Growth of an initial rate error at which its rounding error reaches the size of the response."""

TURN = 100.0
"""Largest measured turn within one cycle, rad. Beyond, sixteen revolutions, commands do not determine the intra-cycle motion."""


@dataclass(frozen=True)
class Extra:
    """Extra unknowns: the response to one unit of each of e."""

    growth: Array
    """(K − 1, 3, e) growth of the mean rate from cycle to cycle, rad/s."""
    force: Array
    """(K, 3, e) specific force, m/s²."""
    sigma: Array
    """(e,) prior sigmas."""


@dataclass(frozen=True)
class Fit:
    """Best fit."""

    reference: Reference
    chi_square: float
    """Mean squared residual over stated noise, over all six channels; 1 if noise explains the residuals."""
    chi_square_at_reference: float
    """The same with the mass properties fixed at the reference and all else fitted. Both agree at a converged reference."""
    extra: Array
    """(e,) extra unknowns."""
    extra_covariance: Array
    """(e, e) their covariance from the stated noise."""


def response(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array]:
    """(K − 1, 3) growth of the rate and (K, 3) specific force that a reference predicts from commands and measured rates."""
    system = linearise(samples, cycles, reference, vehicle)
    force = samples.part(cycles).specific_force_m_s2 - system.specific_force
    return system.steps, force + np.einsum("kij,j->ki", system.observation[:, 3:, PARAMETERS], parameters(reference))


def fit(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, extra: Extra | None = None, passes: int = ITERATIONS
) -> Fit | None:
    """Fit a segment by Gauss–Newton from ``reference``; with ``passes`` 0, by one linear fit about it.

    Extra unknowns are linear about zero. A step that makes the reference worse is halved. The result is None if the response about
    ``reference`` diverges, or if the measured turn exceeds :data:`TURN`. ``vehicle`` must state noise levels.
    """
    here = samples.part(cycles)
    if not np.abs(here.rate_rad_s * here.executed.duration_s[:, None]).max() < TURN:
        return None
    linear = _about(samples, cycles, reference, vehicle, extra)
    if linear is None:
        return None
    best, target = linear
    for _ in range(passes):
        moved = stepped(best.reference, target)
        if moved is None:
            break
        linear = _about(samples, cycles, moved, vehicle, extra)
        if linear is None or linear[0].chi_square_at_reference > best.chi_square_at_reference * (1 + SETTLED):
            target = (parameters(best.reference) + target) / 2
            continue
        # a linear fit about a poor reference may give too small a residual, so convergence is judged at accepted references
        before = best.chi_square
        best, target = linear
        if abs(best.chi_square - before) < SETTLED * before:
            break
    return best


def _about(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, extra: Extra | None) -> tuple[Fit, Array] | None:
    """Linear fit about ``reference``, and its parameters (10,); None if the response diverges."""
    system = linearise(samples, cycles, reference, vehicle)
    layout = Layout.of(samples, vehicle)
    count = 0 if extra is None else extra.growth.shape[-1]
    used = ~samples.part(cycles).executed.ignored
    stacked = _stacked(system, vehicle, extra, used)
    if stacked is None:
        return None
    rows, target = stacked
    sigma = np.concatenate([_prior(samples, reference, vehicle), extra.sigma if extra else np.zeros(0)])
    state = np.zeros(layout.size + count)
    state[PARAMETERS], state[RATE] = parameters(reference), samples.part(cycles).rate_rad_s[0]
    residual = target - rows @ state
    # mass properties come last, so that the leading part of the triangle gives all else with these fixed
    free = np.concatenate([np.flatnonzero(sigma[PARAMETERS.stop :]) + PARAMETERS.stop, np.arange(*PARAMETERS.indices(len(sigma)))])
    nuisances, size = len(free) - 10, len(free)
    scaled = rows[:, free] * sigma[free]
    prior = np.eye(size, size + 1)
    triangle = triangle_of(np.vstack([np.column_stack([scaled, residual]), prior]))
    others_step = np.linalg.solve(triangle[:nuisances, :nuisances], triangle[:nuisances, size])
    step = np.linalg.solve(triangle[:size, :size], triangle[:size, size])
    standing = ((residual - scaled[:, :nuisances] @ others_step) ** 2).mean()
    chi_square = float(((residual - scaled @ step).reshape(-1, 6) ** 2).mean(0).mean())
    state[free] += sigma[free] * step
    root = np.zeros((len(state), size))
    root[free] = sigma[free][:, None] * np.linalg.inv(triangle[:size, :size])
    tail = root[layout.size :]
    return Fit(reference, chi_square, float(standing), state[layout.size :], tail @ tail.T), state[PARAMETERS]


def _stacked(system: Linear, vehicle: Resolved, extra: Extra | None, used: BoolArray) -> tuple[Array, Array] | None:
    """Whitened rows (6 K, n + e) and target (6 K,) in the initial state; None if a rate error grows beyond :data:`GROWTH`."""
    cycles, size = len(system.measured), system.drive.shape[1]
    count = 0 if extra is None else extra.growth.shape[-1]
    to_state, offset = np.zeros((cycles, size, size + count)), np.zeros((cycles, size, 1))
    to_state[0] = np.eye(size, size + count)
    for k in range(cycles - 1):
        to_state[k + 1] = system.transition[k] @ to_state[k]
        offset[k + 1, :, 0] = system.transition[k] @ offset[k, :, 0] + system.drive[k]
        if extra is not None:
            to_state[k + 1, RATE, size:] += extra.growth[k]
        growth = to_state[k + 1, RATE, RATE]
        if not np.vdot(growth, growth) < GROWTH**2:
            return None
    rows = system.observation @ to_state
    target = system.measured - (system.observation @ offset)[..., 0]
    if extra is not None:
        rows[:, 3:, size:] += extra.force
    noise = np.repeat([vehicle.imu.gyro_noise_rad_s, vehicle.imu.accel_noise_m_s2], 3)
    weight = used / noise
    return (rows * weight[..., None]).reshape(-1, size + count), (target * weight).ravel()


def _prior(samples: Source, reference: Reference, vehicle: Vehicle) -> Array:
    """(n,) prior sigmas of the initial state; zero for what is known."""
    layout = Layout.of(samples, vehicle)
    sigma = np.zeros(layout.size)
    sigma[PARAMETERS] = PRIOR * natural_sizes(reference)
    sigma[RATE] = 1.0
    sigma[layout.gyro_bias] = vehicle.imu.gyro_bias_sigma_rad_s
    sigma[layout.accel_bias] = vehicle.imu.accel_bias_sigma_m_s2
    sigma[layout.damping] = vehicle.environment.damping_sigma_n_m_s
    if samples.attitude_logged:  # the integrated attitude starts with the error of one logged attitude
        sigma[layout.tilt] = vehicle.imu.attitude_sigma_rad or 0.0
    return sigma
