"""Oscillation test: whitened residuals against the responses of damped oscillators to the commands (flexible parts, slosh).

A flexible part or slosh follows each push late. The fit is good, but mass or inertia come out too small, by up to the oscillating part. The
regressors are responses y to the commanded wrench u, damped within one period, with periods P half an octave apart:

    y_k = Σ_j h_j u_(k−j),  h_j = exp(−j / P) (cos, sin)(2π j / P),  j = 1 … 3 P.

The two regressors per axis cover every phase. Rates are tested against the torque about each axis and the forces across it, because a part
away from the CG turns the body. Specific force is tested against the force along each axis and the torques across it. The regression needs
only correlations at each lag. The test detects oscillations far below the noise, which tests of the residuals alone cannot
(:mod:`massprop_cli.conclude.whiteness`).
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import ROUNDING, TINY, Array, BoolArray
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.whiteness import informed_by
from massprop_cli.diagnosis.lackoffit import correlation
from massprop_cli.estimate.disturbances import sized
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, deviate, threshold
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import BLOCK, Source, apart

PERIODS = 4.0 * 2.0 ** np.arange(0, 8.5, 0.5)
"""Tested periods P, cycles: 4 to 1024."""
ROTOR_SAMPLES = 40
"""Least number of logged rotor speeds in a period. Errors between the samples correlate with the commands. With eight samples, 5 of 16
error-free logs with slow motors failed the test."""
MEMORY = 3
"""Length of an oscillator's response, periods."""
REPEATED = 2
"""Least number of periods within a phase."""
INPUTS = np.array([[0, 1, 2, 3, 4, 5], [4, 5, 3, 1, 2, 0], [5, 3, 4, 2, 0, 1]])
"""(A, 6) input of each regressor, as a component of the wrench (torque x y z, force x y z), for the residuals of rate x y z and specific
force x y z: the component of the same axis, then the two across it."""
SENSORS = ("turn", "speed")
"""Motion that the gyro and the accelerometer measure."""


class Correlations(NamedTuple):
    """Sums of lagged products over a phase, for lags of 0 to L − 1 cycles; wrench about the CG: torque x y z, force x y z."""

    residual: Array
    """(A, 6, L) whitened residuals of rate and specific force times the earlier commands, for each row of ``INPUTS``."""
    command: Array
    """(6, L) commanded wrench times itself."""
    scatter: Array
    """(6,) mean squared residual."""
    cycle_s: float
    """Mean length of a cycle, s."""


def oscillation_test(
    history: History, samples: Source, used: Resolved, stated: Vehicle, widened: Array, sample_cycles: int = 0
) -> dict[str, Reason]:
    """Reasons, by quantity, against the verdict "converged": the sensor that informs it shows an oscillation.

    Residuals with the chi-square χ² along an omitted regressor bias a value by at most about χ of its sigmas from noise. A bias
    within the final sigma is no reason; ``widened`` (10,) is the final sigma over that from noise.

    ``used`` has estimated disturbances in addition to the ``stated`` ones. Rotor speeds are logged every ``sample_cycles`` cycles.
    """
    cycles = history.cycles
    periods = PERIODS[: np.searchsorted(PERIODS, (cycles.stop - cycles.start) / REPEATED, "right")]
    periods = periods[periods >= ROTOR_SAMPLES * sample_cycles]
    if history.reference is None or not len(periods):
        return {}
    sums = correlations(history, samples, used.held_axes)
    sigmas, chi_squares = significance(sums, periods, np.array([correlation(used), 1.0]))
    # an estimated disturbance is evidence of a misfit, so the false-alarm rate of the same axis may be ten times as high
    same_axis_rate = 10 * DOUBTFUL if sized(used, stated) else DOUBTFUL
    limits = np.array([threshold(same_axis_rate if n == 0 else DOUBTFUL, sigmas.size) for n in range(len(INPUTS))])
    reasons: dict[str, Reason] = {}
    for sensor, of_sensor in enumerate(sigmas.transpose(1, 0, 2)):
        row, at = divmod(int((of_sensor - limits[:, None]).argmax()), len(periods))
        if of_sensor[row, at] > limits[row]:
            period_s = float(periods[at]) * sums.cycle_s
            reason = Reason.of("oscillation", motion=SENSORS[sensor], period_s=period_s, sigmas=float(of_sensor[row, at]))
            beyond = ~(np.sqrt(chi_squares[row, sensor, at]) <= widened)
            # an oscillation across the axis moves the CG and turns the body, so both sensors are affected
            informed = informed_by(history, (np.arange(6) // 3 == sensor) | (row > 0))
            reasons |= {name: reason for name in informed if beyond[QUANTITIES.index(name)]}
    return reasons


def significance(sums: Correlations, periods: Array, spread: Array) -> tuple[Array, Array]:
    """(A, 2, P) normal deviates and chi-squares of the regressions of each sensor's residuals on the oscillators.

    By row of ``INPUTS``, sensor and period.

    ``spread`` (2,) is the largest factor by which each sensor's noise may exceed white noise at low frequency.
    """
    explained, freedom = np.array([explained_by(sums, float(period)) for period in periods]).transpose(3, 1, 2, 0)
    explained /= spread[:, None]
    count = np.maximum(freedom, 1)
    return np.where(freedom > 0, deviate(explained / count, count), 0.0), explained


def correlations(history: History, samples: Source, held_axes: Sequence[int] = ()) -> Correlations:
    """Correlations of a phase by fast Fourier transforms of blocks; residuals of ``held_axes`` count as zero."""
    reference, cycles = history.reference, history.cycles
    assert reference is not None
    whole = cycles.stop - cycles.start
    lags = min(int(MEMORY * min(PERIODS[-1], whole / REPEATED)) + 1, whole)
    size = 1 << (min(BLOCK, whole) + 2 * lags - 1).bit_length()
    spectra = np.zeros((1 + len(INPUTS), 6, size // 2 + 1), dtype=complex)
    before, power, count, duration_s = np.zeros((6, lags)), np.zeros(6), 0, 0.0
    for part in apart(cycles):
        executed = samples.part(part).executed
        wrench = executed.channels.whole @ executed.channels.wrench
        wrench[:, :3] -= np.cross(reference.cg, wrench[:, 3:])
        residual = history.normalised[part.start - cycles.start : part.stop - cycles.start]
        finite: BoolArray = np.asarray(np.isfinite(residual).all(1))
        residual = np.where(finite[:, None], residual, 0.0)
        residual[:, held_axes] = 0.0
        extended = np.hstack([before, wrench.T])
        outputs = np.fft.rfft(np.pad(np.stack([residual.T, wrench.T]), ((0, 0), (0, 0), (lags, 0))), size)
        inputs = np.fft.rfft(extended, size).conj()
        spectra += np.concatenate([outputs[0] * inputs[INPUTS], outputs[1:] * inputs])
        power, count = power + (residual**2).sum(0), count + int(finite.sum())
        before, duration_s = extended[:, -lags:], duration_s + float(executed.duration_s.sum())
    sums = np.fft.irfft(spectra, size)[..., :lags]
    return Correlations(sums[:-1], sums[-1], power / max(count, 1), duration_s / whole)


def explained_by(sums: Correlations, period: float) -> Array:
    """(A, 2, 2) for each sensor: sum of squares that oscillators of one period explain, over the mean square; degrees of freedom.

    The Gram matrix of the regressors follows from the autocorrelation R of the commands: Σ_jl h_j h_l R(j − l).
    """
    lags = min(int(MEMORY * period) + 1, sums.residual.shape[-1])
    kernel, kernel_products = _oscillator(period, lags)
    products = sums.residual[..., 1:lags] @ kernel.T
    autocorrelation = np.hstack([sums.command[:, :lags], np.zeros((6, 1)), sums.command[:, lags - 1 : 0 : -1]])
    gram = np.einsum("hgl,al->ahg", kernel_products, autocorrelation)
    power = sums.command[:, 0].reshape(2, 3)
    commanded: BoolArray = np.asarray(power > ROUNDING * power.sum(1, keepdims=True)).ravel()
    gram[~commanded] = np.eye(2)
    square = np.einsum("bah,bah->ba", products, np.linalg.solve(gram[INPUTS], products[..., None])[..., 0])
    present = sums.scatter.reshape(2, 3) > 0  # absent channels have zero residuals
    counted = commanded[INPUTS].reshape(-1, 2, 3) & present
    scatter = np.maximum(sums.scatter.reshape(2, 3).sum(1) / np.maximum(present.sum(1), 1), TINY)
    return np.stack([np.where(counted, square.reshape(-1, 2, 3), 0.0).sum(2) / scatter, 2.0 * counted.sum(2)], axis=2)


@lru_cache(64)
def _oscillator(period: float, lags: int) -> tuple[Array, Array]:
    """(2, L − 1) impulse responses h_j, j = 1 … L − 1; (2, 2, 2 L) their products Σ_j h_j h_(j+l), l = 0 … L, −L + 1 … −1."""
    response = np.exp((-1 + 2j * np.pi) * np.arange(1, lags) / period)
    kernel = np.stack([response.real, response.imag])
    spectrum = np.fft.rfft(kernel, 2 * lags)
    return kernel, np.fft.irfft(spectrum[:, None].conj() * spectrum, 2 * lags)
