"""Residual whiteness: autocorrelation and kurtosis of whitened innovations where a disturbance is estimated as noise.

An estimated disturbance (:mod:`massprop_cli.estimate.disturbances`) adds its covariance to every sigma. These sigmas are valid only if the
disturbance is white and normal. A flexible part, slosh or a lost command is not, and may move a value by far more than its sigma. Two
tests for each sensor, over its three axes:

    Q = N Σ r_k², k = 1 … 11,   chi-square of one degree of freedom per term (Box & Pierce 1970), r_k the autocorrelation at lag k,
    K = Σ z⁴ / N / (Σ z² / N)² − 3, the largest of the axes,   normal with a variance of 24 / N.

Q of the rates omits r_1: a white torque changes the rate in two steps, half in each, so that its r_1 is ½. The variance of the other terms
is then larger by half.
"""

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import TINY, Array, BoolArray
from massprop_cli.base.levels import CONTRADICTION, ENOUGH
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, deviate, threshold
from massprop_cli.inputs.estimatorsettings import UNWIDENED
from massprop_cli.model.resolved import Resolved

LAGS = range(1, 12)
"""Lags of the autocorrelation, cycles."""
COLOURED = 0.25
"""Least Σ r_k² of a correlated residual, in addition to the test of Q. No real disturbance is exactly white, and a long log shows a small
correlation. Oscillation gives 0.3 to 5."""
HEAVY = 3.0
"""Largest K of normal residuals: K of a channel in which one cycle in a hundred has 3.5 times the noise."""
PART = 0.2
"""Share of the information on a quantity from the failed sensor, above which the quantity loses its verdict."""
SENSORS = ("rates", "specific force")
FREEDOM, SPREAD = np.array([30, 33]), np.array([1.5, 1.0])
"""Degrees of freedom of Q by sensor (three axes of ten and of eleven lags), and the factor on Q that a white torque causes."""


def whiteness_test(history: History, used: Resolved) -> dict[str, Reason]:
    """Reasons, by quantity, against the verdict "converged": the residuals that its sigma treats as noise are not white and normal.

    Heavy-tailed rates concern all quantities.
    """
    disturbed = used.environment.disturbance_torque_n_m + used.environment.disturbance_walk_n_m > 0
    tachometer_noise = any(wheel.speed_error_in_noise for wheel in used.wheels)
    correlations, tails, count = autocorrelation_and_kurtosis(history.normalised, 1.0 if tachometer_noise else TINY)
    power, kurtosis = (correlations**2).sum(0).reshape(2, 3).sum(1), tails.reshape(2, 3).max(1)
    widened = used.estimator.accel_noise_scale != UNWIDENED
    correlated = (power > COLOURED) & (deviate(count * power / FREEDOM / SPREAD, FREEDOM) > threshold(DOUBTFUL, len(SENSORS)))
    failed = (np.array([disturbed, widened]) & correlated) | (kurtosis > HEAVY)
    if not failed.any():
        return {}
    sensor = int(np.argmax(failed))
    of_sensor = correlations[:, 3 * sensor : 3 * sensor + 3]
    lag, axis = np.unravel_index(np.argmax(np.abs(of_sensor)), of_sensor.shape)
    reason = (
        Reason.of("noise-heavy-tailed", sensor=SENSORS[sensor], kurtosis=float(kurtosis[sensor]))
        if kurtosis[sensor] > HEAVY
        else Reason.of("noise-correlated", sensor=SENSORS[sensor], correlation=float(of_sensor[lag, axis]), lag=LAGS[lag])
    )
    # outliers of the rates may come from wrong commands, and these also drive the specific force
    affected = QUANTITIES if kurtosis[0] > HEAVY else informed_by(history, np.repeat(failed, 3))
    return dict.fromkeys(affected, reason)


def informed_by(history: History, channels: BoolArray) -> list[str]:
    """Quantities of whose information the ``channels`` (6,) give more than :data:`PART`."""
    total = history.information_share.sum(1)
    share = history.information_share[:, channels].sum(1) / np.where(total > 0, total, 1.0)
    return [name for name, part in zip(QUANTITIES, share, strict=True) if part > PART]


def autocorrelation_and_kurtosis(normalised: Array, least: float = TINY) -> tuple[Array, Array, int]:
    """(11, 6) r_k and (6,) K of whitened innovations (K, 6), and the number of complete cycles; zeros if there are too few.

    ``least`` is a lower bound of the variance in both. With coarse counts the variance is small, and a few cycles give all of it.
    """
    rows = normalised[np.isfinite(normalised).all(1)]
    count = len(rows)
    if count < 2 * ENOUGH:
        return np.zeros((len(LAGS), 6)), np.zeros(6), count
    clipped = np.clip(rows, -CONTRADICTION, CONTRADICTION)
    power = np.maximum((clipped**2).sum(0), least * count)
    correlations = np.array([(clipped[lag:] * clipped[:-lag]).sum(0) / power for lag in LAGS])
    correlations[0, :3] = 0.0
    return correlations, (rows**4).mean(0) / np.maximum((rows**2).mean(0) ** 2, least) - 3, count
