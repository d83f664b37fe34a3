"""Disturbances that explain innovations larger than the noise levels: whether there are any, and their size.

They are estimated once from the log. The result's settings state them; with these settings the result is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.base.levels import CHANCE, CONTRADICTION, ENOUGH
from massprop_cli.estimate.history import History
from massprop_cli.estimate.initial import early_reference
from massprop_cli.estimate.sizing import Levels
from massprop_cli.estimate.unexplained import residual_growth
from massprop_cli.inputs.estimatorsettings import UNWIDENED
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Samples, Source, gathered

EXCESS, EXCESS_SIZED, FAR = 0.2, 0.05, 6.0
"""The stated noise does not explain a mean squared normalised innovation above 1 + EXCESS and above 1 + FAR of its own sigmas √(2 / N):
sigmas would be 10 % too small, and the false-alarm probability is one in a billion. A disturbance that was estimated here, and not stated:
above 1 + EXCESS_SIZED, sigmas to 2.5 %, and above 1 + CHANCE of them."""
EXCESS_SLOW = 0.5
"""The same for the long-run variance, which matters for quantities that slow motion alone informs: their sigmas would be a fifth too small.
With a Bartlett window it is a chi-square of ν = 3/2 N / lags degrees of freedom over ν (M. B. Priestley, Spectral Analysis and Time Series,
1981). ν is small, and the tail far from normal. Once a disturbance was estimated, the normal tail is used: the log is not error-free."""
GROSS, GROSS_LEAST = 1.5, 50
"""Ratio of the differenced rates' variance to the stated one, above which disturbances are estimated before any fit; and the least number
of cycles for it, with a relative sigma of a fifth."""

ACTING = 1e-6
"""Squared commanded torque over its maximum, above which a cycle counts as commanded."""
UNEXPLAINED = "the stated noise does not explain the rates"
BEYOND = (
    ", and no disturbance does: it would be {torque:.3g} N m per cycle, and commands give {commanded:.3g} N m (rms). Check the data before "
    "the vehicle: units, axes and clock of gyro and commands, and the order of columns"
)


def misfit(histories: Sequence[History], vehicle: Resolved, sized: bool = False) -> Array:
    """(6,) variance of the normalised innovations per channel where it exceeds 1 significantly; NaN where the noise explains them.

    The larger of the plain and the long-run variance (Bartlett window over √N lags), because drag, vibration and bias are not white.
    ``sized``: some of the noise was estimated here, and its limits are stricter.
    """
    powers = [np.sum([[(z**2).sum(0), np.full(6, len(z))] for z in _clipped(history)], 0) for history in histories]
    used = [(history, power) for history, power in zip(histories, powers, strict=True) if power[1, 0] >= ENOUGH]
    if not used:
        return np.full(6, np.nan)
    white, counts = np.sum([power for _, power in used], 0)
    count = int(counts[0])
    white, lags = white / count, int(np.sqrt(count))
    long_run = np.sum([_long_run(_clipped(history), lags) for history, _ in used], 0) / count
    adapted = vehicle.environment.disturbance_torque_n_m + vehicle.environment.disturbance_walk_n_m > 0
    # strict limits apply only to estimated noise: a torque, and the accelerometer's if it was widened
    strict = sized & np.repeat([adapted, vehicle.estimator.accel_noise_scale != UNWIDENED], 3)
    least, sigmas = np.where(strict, EXCESS_SIZED, EXCESS), np.where(strict, CHANCE, FAR)
    over_white = np.where(white > 1 + np.maximum(least, sigmas * np.sqrt(2 / count)), white, 0.0)
    by_chance = 1 + FAR * np.sqrt(4 * lags / 3 / count) if sized else _chi_square_bound(1.5 * count / lags)
    over_long = np.where(long_run > max(1 + EXCESS_SLOW, by_chance), long_run, 0.0)
    if adapted:
        over_long[:3] = 0.0  # the model has a slow torque then; only its size is tested
    excess = np.maximum(over_white, over_long)
    excess[vehicle.held_axes] = 0.0  # no torque acts about these axes
    return np.where(excess > 0, excess, np.nan)


def _chi_square_bound(freedom: float) -> float:
    """Bound of a chi-square over its ``freedom``, with the tail probability of :data:`FAR` sigmas (Wilson and Hilferty 1931)."""
    spread = 2 / 9 / freedom
    return float((1 - spread + FAR * np.sqrt(spread)) ** 3)


def _clipped(history: History) -> Iterator[Array]:
    """(N, 6) whitened innovations, clipped to ±:data:`CONTRADICTION`, in parts."""
    for rows in history.whitened():
        yield np.clip(rows, -CONTRADICTION, CONTRADICTION)


def _long_run(parts: Iterable[Array], lags: int) -> Array:
    """(6,) spectral density at zero frequency of each column, times the number of rows; the mean is included.

    It is the sum of squares of moving sums over ``lags`` + 1 rows. A product of two rows that are j apart is in ``lags`` + 1 − j of
    these sums, which is its weight in the Bartlett window.
    """
    before, total = np.zeros((lags, 6)), np.zeros(6)
    for rows in chain(parts, [np.zeros((lags, 6))]):
        wide = np.vstack([before, rows])
        sums = np.cumsum(np.vstack([np.zeros(6), wide]), axis=0)
        total = total + ((sums[lags + 1 :] - sums[: -lags - 1]) ** 2).sum(0)
        before = wide[len(rows) :]
    return total / (lags + 1)


def gross_misfit(samples: Source, cycles: Sequence[slice], vehicle: Resolved) -> Array:
    """(6,) infinite in rate channels whose differenced rates show a disturbance far above the stated one; else NaN.

    The lag-one autocovariance of white gyro noise is −½ of its variance. So variance plus twice that autocovariance contains no gyro noise.
    """
    excess = np.full(6, np.nan)
    if vehicle.environment.disturbance_walk_n_m > 0 or vehicle.estimates_assumptions:
        return excess  # uncertain jets disturb the rates too
    noise = 2 * vehicle.imu.gyro_noise_rad_s**2
    for piece in cycles:
        reference = early_reference(samples, piece, vehicle)
        if reference is not None and piece.stop - piece.start > GROSS_LEAST:
            growth = residual_growth(samples, piece, reference, vehicle)
            disturbed = growth.variance + 2 * growth.lagged
            excess[:3][disturbed > GROSS * (noise + _stated_growth(samples, piece, reference, vehicle))] = np.inf
    excess[vehicle.held_axes] = np.nan
    return excess


def _stated_growth(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Array:
    """(3,) variance of the rate's growth per cycle by the stated disturbance torque and pulse errors, (rad/s)²."""
    inverse = np.linalg.inv(reference.inertia)
    impulse = vehicle.environment.disturbance_torque_n_m * median(gathered(samples, cycles, lambda here: here.executed.duration_s))
    covariance = impulse**2 * np.eye(3)
    if vehicle.thrust.pulse_sigma > 0:
        moment = plant_of(vehicle).jet_moment(reference)
        covariance = covariance + moment @ gathered(samples, cycles, _pulses).mean(0) @ moment.T
    return np.diag(inverse @ covariance @ inverse.T)


def _pulses(samples: Samples) -> Array:
    """(K, 6, 6) impulse covariance by pulse errors, without lost commands."""
    covariance = samples.executed.pulse_covariance
    if covariance is None:
        return np.zeros((len(samples), 6, 6))
    return np.where(samples.executed.uncommanded[:, None, None], 0.0, covariance)


def with_disturbances(excess: Array, vehicle: Resolved, likeliest: Callable[[Resolved], Levels]) -> Resolved:
    """The vehicle with disturbance torque or gyro noise, and accelerometer noise, that explain innovations in ``excess`` (6,).

    Torque and gyro noise have the ``likeliest`` levels (:func:`massprop_cli.estimate.sizing.likeliest_levels`); a remaining excess scales a
    torque up. Accelerometer noise is scaled per axis by the excess.
    """
    environment: dict[str, float] = {}
    imu: dict[str, float] = {}
    now = vehicle.environment
    if not np.isnan(excess[:3]).all():
        white, walk, gyro = likeliest(vehicle)
        worst = float(np.nanmax(excess[:3]))
        factor = np.sqrt(worst) if np.isfinite(worst) else 1.0
        environment = {
            "disturbance_torque_n_m": max(white, factor * now.disturbance_torque_n_m),
            "disturbance_walk_n_m": max(walk, factor * now.disturbance_walk_n_m),
        }
        imu = {"gyro_noise_rad_s": gyro * vehicle.imu.gyro_noise_rad_s}
    estimator: dict[str, Any] = {}
    if not np.isnan(excess[3:]).all():
        scale = np.array(vehicle.estimator.accel_noise_scale) * np.sqrt(np.fmax(excess[3:], 1.0))
        estimator["accel_noise_scale"] = tuple(float(f) for f in scale)
    return _changed(vehicle, environment=environment, imu=imu, estimator=estimator)


def sized(used: Vehicle, stated: Vehicle) -> bool:
    """Whether disturbances, or the accelerometer noise, were raised above the stated ones."""
    return (used.environment, used.estimator) != (stated.environment, stated.estimator)


def beyond_commands(used: Vehicle, stated: Vehicle, samples: Source) -> tuple[float, float] | None:
    """An estimated torque, N m per cycle, and the commands' (rms of the commanded cycles), if the first is larger; else None.

    A disturbance above the vehicle's own commands means that the data are not what they are assumed to be.
    """
    now = max(used.environment.disturbance_torque_n_m, used.environment.disturbance_walk_n_m)
    if now <= max(stated.environment.disturbance_torque_n_m, stated.environment.disturbance_walk_n_m):
        return None
    squares = gathered(samples, slice(0, len(samples)), _commanded)
    acting = squares[squares > ACTING * squares.max(initial=0.0)]
    commanded = float(np.sqrt(acting.mean())) if len(acting) else np.inf
    return (now, commanded) if now > commanded else None


def _commanded(samples: Samples) -> Array:
    """(K,) square of the mean torque about O that commands give in each cycle, (N m)²."""
    channels = samples.executed.channels
    torque = channels.whole @ channels.wrench[:, :3] / samples.executed.duration_s[:, None]
    return np.asarray((torque**2).sum(1))


def disturbance_notices(stated: Resolved, used: Resolved, excess: Array, samples: Source) -> list[Notice]:
    """Notices of what was added to the stated noise, and of what is still unexplained."""
    notices = []
    now, before = used.environment, stated.environment
    if (now.disturbance_torque_n_m, now.disturbance_walk_n_m) != (before.disturbance_torque_n_m, before.disturbance_walk_n_m):
        notices.append(Notice("disturbance-torque", UNEXPLAINED + _torque(stated, used, samples)))
    if used.imu.gyro_noise_rad_s != stated.imu.gyro_noise_rad_s:
        wider = used.imu.gyro_noise_rad_s / stated.imu.gyro_noise_rad_s
        notices.append(
            Notice(
                "gyro-misfit",
                f"the stated noise does not explain the rates; the gyro noise was multiplied by {wider:.3g}, to "
                f"{used.imu.gyro_noise_rad_s:.3g} rad/s. Sigmas include it. Check for vibration, coarse resolution, or a noise not stated "
                "for the mean rate of a cycle",
            )
        )
    if used.estimator.accel_noise_scale != stated.estimator.accel_noise_scale:
        x, y, z = used.estimator.accel_noise_scale
        notices.append(
            Notice(
                "accelerometer-misfit",
                f"the stated noise does not explain the specific force; it was multiplied by {x:.3g}, {y:.3g}, {z:.3g} in x, y, z. Sigmas "
                "include it as noise. Check for drag, vibration, accelerometer bias, a wrong IMU position or mounting",
            )
        )
    if not np.isnan(excess).all():
        worst = float(np.nanmax(excess))
        notices.append(
            Notice(
                "model-misfit",
                f"innovations are still {np.sqrt(worst):.3g} times as large as the model expects; sigmas are too small by about this "
                "factor",
            )
        )
    return notices


def _torque(stated: Resolved, used: Resolved, samples: Source) -> str:
    """Message on an estimated torque."""
    beyond = beyond_commands(used, stated, samples)
    if beyond is not None:
        return BEYOND.format(torque=beyond[0], commanded=beyond[1])
    parts = (("white", used.environment.disturbance_torque_n_m), ("slowly varying", used.environment.disturbance_walk_n_m))
    added = ", ".join(f"{what} {size:.3g} N m per cycle" for what, size in parts if size > 0)
    return (
        f"; a disturbance torque was added: {added}. Sigmas include it as noise. Check for a lag of the thrust, air drag, friction, thrust "
        "errors, time jitter, a wrong delay or jet"
    )


def _changed(vehicle: Resolved, **sections: dict[str, Any]) -> Resolved:
    changes = {name: getattr(vehicle, name).model_copy(update=update) for name, update in sections.items() if update}
    return vehicle.model_copy(update=changes) if changes else vehicle
