"""Whiteness and normality of residuals where a disturbance was estimated as noise.

Where the stated noise doesn't explain a log, disturbances are sized until it does (:mod:`massprop_cli.estimate.disturbances`), and their
covariance goes into every sigma. That is honest of noise alone. A flexible part or sloshing answers a push for many cycles, and a command
that was not executed leaves a few steps as large as the command: both are no white torque, and may move a value by far more than its sigma.
So the whitened innovations that are left are tested against what they claim to be, sensor by sensor, by two tests:

    Q = N Σ r_k², k = 1 … 11, of three axes,   chi-square of as many degrees of freedom (Box & Pierce 1970), r_k their autocorrelation,
    K = Σ z⁴ / N / (Σ z² / N)² − 3, the largest of the axes,   normal with a variance of 24 / N.

Of rates not r_1, which is ½ for a torque that is white from cycle to cycle and turns the rate in two steps, half in each; the others
scatter by half as much again then.
"""

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import TINY, Array, BoolArray
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.disturbances import CLIP
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, deviate, threshold
from massprop_cli.inputs.estimatorsettings import UNWIDENED
from massprop_cli.model.resolved import Resolved

LAGS = range(1, 12)
"""Cycles over which what is left may follow itself."""
LEAST = 60
"""Cycles that tell."""
COLOURED = 0.25
"""Σ r_k² from which on a residual is correlated, where Q is beyond chance too. No real disturbance is quite white, and of a long log a
little shows; a part that swings leaves 0.3 to 5."""
HEAVY = 3.0
"""K beyond which a few cycles are most of what is left: that of a channel of which one cycle in a hundred has 3.5 times the noise."""
PART = 0.2
"""Of the information on a quantity that such a sensor gives."""
SENSORS = ("rates", "specific force")
FREEDOM, SPREAD = np.array([30, 33]), np.array([1.5, 1.0])
"""Of Q: three axes of ten lags and of eleven; and what a torque that is white from cycle to cycle multiplies it by."""


def unlike_noise(history: History, used: Resolved) -> dict[str, Reason]:
    """Why values are not to be called converged whose sigmas rest on disturbances that are no noise, by quantity; all where rates jump."""
    disturbed = used.environment.disturbance_torque_n_m + used.environment.disturbance_walk_n_m > 0
    counted = any(wheel.speed_error_in_noise for wheel in used.wheels)
    along, tail, count = left(history.normalised, 1.0 if counted else TINY)
    power, heavy = (along**2).sum(0).reshape(2, 3).sum(1), tail.reshape(2, 3).max(1)
    widened = used.estimator.accel_noise_scale != UNWIDENED
    correlated = (power > COLOURED) & (deviate(count * power / FREEDOM / SPREAD, FREEDOM) > threshold(DOUBTFUL, len(SENSORS)))
    failed = (np.array([disturbed, widened]) & correlated) | (heavy > HEAVY)
    if not failed.any():
        return {}
    worst = int(np.argmax(failed))
    own = along[:, 3 * worst : 3 * worst + 3]
    lag, axis = np.unravel_index(np.argmax(np.abs(own)), own.shape)
    reason = (
        Reason.of("noise-heavy-tailed", sensor=SENSORS[worst], kurtosis=float(heavy[worst]))
        if heavy[worst] > HEAVY
        else Reason.of("noise-correlated", sensor=SENSORS[worst], correlation=float(own[lag, axis]), lag=LAGS[lag])
    )
    # a few cycles that turned the body otherwise than commanded: the same commands push it, wrong as they may be
    hanging = QUANTITIES if heavy[0] > HEAVY else resting(history, np.repeat(failed, 3))
    return dict.fromkeys(hanging, reason)


def resting(history: History, channels: BoolArray) -> list[str]:
    """Quantities on which so many of the six ``channels`` give much of the information."""
    total = history.information_share.sum(1)
    share = history.information_share[:, channels].sum(1) / np.where(total > 0, total, 1.0)
    return [name for name, part in zip(QUANTITIES, share, strict=True) if part > PART]


def left(normalised: Array, least: float = TINY) -> tuple[Array, Array, int]:
    """(11, 6) r_k and (6,) K of whitened innovations (K, 6), and how many cycles tell; zeros of too few.

    Over their variance, or the ``least`` that it counts for: what is left of coarse counts is as much as is expected in a few cycles alone.
    """
    rows = normalised[np.isfinite(normalised).all(1)]
    count = len(rows)
    if count < LEAST:
        return np.zeros((len(LAGS), 6)), np.zeros(6), count
    clipped = np.clip(rows, -CLIP, CLIP)
    power = np.maximum((clipped**2).sum(0), least * count)
    along = np.array([(clipped[lag:] * clipped[:-lag]).sum(0) / power for lag in LAGS])
    along[0, :3] = 0.0
    return along, (rows**4).mean(0) / np.maximum((rows**2).mean(0) ** 2, least) - 3, count
