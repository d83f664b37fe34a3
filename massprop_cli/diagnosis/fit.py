"""Fit of a whole segment about a reference, with further unknowns beside the mass properties.

The filter's linear system without process noise is one least-squares problem in the state at the start: mass properties, rate, nuisances,
and extra unknowns such as a shift of the delay or a factor on a jet's thrust. Quick enough to try one hypothesis after another.
"""

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, triangle_of
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import Linear, linearise
from massprop_cli.model.parameters import natural_sizes, parameters, stepped
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Source

PASSES = 8
"""Most Gauss–Newton steps."""
SETTLED = 1e-5
"""Relative change of chi-square at which they end."""
PRIOR = 100.0
"""Prior sigma of the mass properties over their natural size."""
GROWTH = float(1 / np.finfo(float).eps)
"""Growth of an error of the rate at the start beyond which its rounding alone moves the response by the response's own size."""

TURN = 100.0
"""rad; a measured turn within one cycle, sixteen times round, beyond which commands tell nothing of the motion within."""


@dataclass(frozen=True)
class Extra:
    """Further unknowns: what one unit of each does."""

    growth: Array
    """(K − 1, 3, e) growth of the mean rate from cycle to cycle, rad/s."""
    force: Array
    """(K, 3, e) specific force, m/s²."""
    sigma: Array
    """(e,) prior sigma of each."""


@dataclass(frozen=True)
class Fit:
    """What fits best."""

    reference: Reference
    chi_square: float
    """Mean squared residual over the noise that the vehicle file states, all six channels; 1 if noise explains them."""
    standing: float
    """The same with the mass properties held at the reference and all else fitted: the two meet where the reference stands still."""
    extra: Array
    """(e,)"""
    extra_covariance: Array
    """(e, e) from the stated noise."""


def response(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> tuple[Array, Array]:
    """(K − 1, 3) growth of the rate and (K, 3) specific force that a reference expects of its commands and the measured rates."""
    system = linearise(samples, cycles, reference, vehicle)
    force = samples.part(cycles).specific_force_m_s2 - system.specific_force
    return system.steps, force + np.einsum("kij,j->ki", system.observation[:, 3:, PARAMETERS], parameters(reference))


def fit(
    samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, extra: Extra | None = None, passes: int = PASSES
) -> Fit | None:
    """Gauss–Newton from ``reference``, or one linear fit about it with no ``passes``; the extra unknowns are linear about zero.

    A step that leaves the reference worse than it was is halved, so that no fit runs away. None where the response about ``reference``
    itself does, or the rates are no body's. Noise levels must be set in ``vehicle``.
    """
    here = samples.part(cycles)
    if not np.abs(here.rate_rad_s * here.executed.duration_s[:, None]).max() < TURN:
        return None
    about = _about(samples, cycles, reference, vehicle, extra)
    if about is None:
        return None
    found, target = about
    for _ in range(passes):
        renewed = stepped(found.reference, target)
        if renewed is None:
            break
        about = _about(samples, cycles, renewed, vehicle, extra)
        if about is None or about[0].standing > found.standing * (1 + SETTLED):
            target = (parameters(found.reference) + target) / 2
            continue
        # the residual of a linear fit about a poor reference may be too small: only that of a reference that stands still counts
        before = found.chi_square
        found, target = about
        if abs(found.chi_square - before) < SETTLED * before:
            break
    return found


def _about(samples: Source, cycles: slice, reference: Reference, vehicle: Resolved, extra: Extra | None) -> tuple[Fit, Array] | None:
    """The linear fit about ``reference``, and the parameters (10,) that it finds; None where the response grows without end."""
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
    left = target - rows @ state
    # mass properties last, so that the same factorisation gives all else with these held
    free = np.concatenate([np.flatnonzero(sigma[PARAMETERS.stop :]) + PARAMETERS.stop, np.arange(*PARAMETERS.indices(len(sigma)))])
    others, size = len(free) - 10, len(free)
    scaled = rows[:, free] * sigma[free]
    prior = np.eye(size, size + 1)
    triangle = triangle_of(np.vstack([np.column_stack([scaled, left]), prior]))
    held = np.linalg.solve(triangle[:others, :others], triangle[:others, size])
    step = np.linalg.solve(triangle[:size, :size], triangle[:size, size])
    standing = ((left - scaled[:, :others] @ held) ** 2).mean()
    chi_square = float(((left - scaled @ step).reshape(-1, 6) ** 2).mean(0).mean())
    state[free] += sigma[free] * step
    root = np.zeros((len(state), size))
    root[free] = sigma[free][:, None] * np.linalg.inv(triangle[:size, :size])
    tail = root[layout.size :]
    return Fit(reference, chi_square, float(standing), state[layout.size :], tail @ tail.T), state[PARAMETERS]


def _stacked(system: Linear, vehicle: Resolved, extra: Extra | None, used: BoolArray) -> tuple[Array, Array] | None:
    """Whitened rows (6 K, n + e) and target (6 K,) in terms of the state at the start; None where that grows beyond ``GROWTH``."""
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
    """(n,) prior sigmas; zero for what is known."""
    layout = Layout.of(samples, vehicle)
    sigma = np.zeros(layout.size)
    sigma[PARAMETERS] = PRIOR * natural_sizes(reference)
    sigma[RATE] = 1.0
    sigma[layout.gyro_bias] = vehicle.imu.gyro_bias_sigma_rad_s
    sigma[layout.accel_bias] = vehicle.imu.accel_bias_sigma_m_s2
    sigma[layout.damping] = vehicle.environment.damping_sigma_n_m_s
    if samples.attitude_logged:  # the carried attitude begins as far off as one of them may be
        sigma[layout.tilt] = vehicle.imu.attitude_sigma_rad or 0.0
    return sigma
