"""Disturbances that explain what the noise levels can't: whether there are any, and how large.

They come from a first pass over the log, are stated in the result's settings, and reproduce the result when given back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.estimate.history import History
from massprop_cli.estimate.initial import beginning
from massprop_cli.estimate.sizing import Levels
from massprop_cli.estimate.unexplained import residual_growth
from massprop_cli.inputs.estimatorsettings import UNWIDENED
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import Samples, Source, gathered

EXCESS, CERTAIN = 0.2, 6.0
"""Mean squared normalised innovation above 1 + this, and above so many of its own sigmas √(2 / N), is a misfit of the stated noise: sigmas
would be 10 % too small, and chance does that once in a billion. Below it the file's statement is believed."""
EXCESS_SIZED, CERTAIN_SIZED = EXCESS / 4, 3.0
"""The same of a disturbance that was sized here: nobody stated it, so it is held to 2.5 % of sigma."""
EXCESS_SLOW = 0.5
"""The same of the long-run variance: it matters to what is told by slow motion alone, whose sigmas would be a fifth too small. Under a
Bartlett window it is a chi-square of ν = 3/2 N / lags degrees of freedom over ν (M. B. Priestley, Spectral Analysis and Time Series, 1981);
ν is small, and its tail far from a normal one's. Where something was sized already, a normal one's counts: the log is no clean one."""
LEAST = 20
"""Cycles that say anything of a variance: it scatters by a third of itself over so many."""
CLIP = 4.0
"""Normalised innovations count up to this: a few outliers while the filter starts don't size a disturbance. One normal deviate in 16,000
is beyond it."""
GROSS, GROSS_LEAST = 1.5, 50
"""Disturbances are sized at once, before any fit, where the differenced rates vary by this many times what is stated, over more cycles than
this: a variance scatters by a fifth of itself over so many."""

ACTING = 1e-6
"""Part of the largest square of a commanded torque above which a cycle counts as commanded."""
UNEXPLAINED = "the stated noise does not explain the rates"
BEYOND = (
    ", and no disturbance does: it would be {torque:.3g} N m per cycle, and commands give {commanded:.3g} N m (rms). Doubt the data before "
    "the vehicle: units, axes and clock of the gyro and of the commands, and which column is which"
)


def misfit(histories: Sequence[History], vehicle: Resolved, sized: bool = False) -> Array:
    """(6,) variance of the normalised innovations per channel where it is in excess of 1, NaN where noise explains them.

    The larger of the plain and the long-run variance (Bartlett window over √N lags): drag, vibration and bias are not white. ``sized``:
    some of the noise was found here; what is stated is believed more.
    """
    powers = [np.sum([[(z**2).sum(0), np.full(6, len(z))] for z in _clipped(history)], 0) for history in histories]
    told = [(history, power) for history, power in zip(histories, powers, strict=True) if power[1, 0] >= LEAST]
    if not told:
        return np.full(6, np.nan)
    white, counts = np.sum([power for _, power in told], 0)
    count = int(counts[0])
    white, lags = white / count, int(np.sqrt(count))
    long_run = np.sum([_long_run(_clipped(history), lags) for history, _ in told], 0) / count
    adapted = vehicle.environment.disturbance_torque_n_m + vehicle.environment.disturbance_walk_n_m > 0
    # what nobody sized is believed as stated: a torque, and the accelerometer's noise beside one that was
    strict = sized & np.repeat([adapted, vehicle.estimator.accel_noise_scale != UNWIDENED], 3)
    least, sigmas = np.where(strict, EXCESS_SIZED, EXCESS), np.where(strict, CERTAIN_SIZED, CERTAIN)
    over_white = np.where(white > 1 + np.maximum(least, sigmas * np.sqrt(2 / count)), white, 0.0)
    by_chance = 1 + CERTAIN * np.sqrt(4 * lags / 3 / count) if sized else _by_chance(1.5 * count / lags)
    over_long = np.where(long_run > max(1 + EXCESS_SLOW, by_chance), long_run, 0.0)
    if adapted:
        over_long[:3] = 0.0  # a slow torque is in the model by then; only its size is judged
    excess = np.maximum(over_white, over_long)
    excess[vehicle.held_axes] = 0.0  # no torque acts there, nor does the body tell of them
    return np.where(excess > 0, excess, np.nan)


def _by_chance(freedom: float) -> float:
    """What a chi-square over its ``freedom`` exceeds as rarely as a normal deviate does :data:`CERTAIN` (Wilson and Hilferty 1931)."""
    spread = 2 / 9 / freedom
    return float((1 - spread + CERTAIN * np.sqrt(spread)) ** 3)


def _clipped(history: History) -> Iterator[Array]:
    """(N, 6) whitened innovations up to :data:`CLIP`, part by part."""
    for rows in history.whitened():
        yield np.clip(rows, -CLIP, CLIP)


def _long_run(parts: Iterable[Array], lags: int) -> Array:
    """(6,) spectral density at zero frequency of each column times the count of rows, mean included.

    Sums over windows of so many lags and one more, at all places, have squares in which each product of rows stands as often as Bartlett's
    window has it weigh: in L + 1 − lag of them.
    """
    before, total = np.zeros((lags, 6)), np.zeros(6)
    for rows in chain(parts, [np.zeros((lags, 6))]):
        wide = np.vstack([before, rows])
        summed = np.cumsum(np.vstack([np.zeros(6), wide]), axis=0)
        total = total + ((summed[lags + 1 :] - summed[: -lags - 1]) ** 2).sum(0)
        before = wide[len(rows) :]
    return total / (lags + 1)


def gross_misfit(samples: Source, cycles: Sequence[slice], vehicle: Resolved) -> Array:
    """(6,) infinite in the rate channels if a look at the differenced rates shows far more disturbance than is stated, else NaN.

    White gyro noise has lag-one autocovariance −½ of its variance, so variance plus twice the lag-one autocovariance is what it leaves.
    """
    excess = np.full(6, np.nan)
    if vehicle.environment.disturbance_walk_n_m > 0 or vehicle.uncertain_geometry:
        return excess  # what jets do otherwise than stated shows in the rates too
    noise = 2 * vehicle.imu.gyro_noise_rad_s**2
    for piece in cycles:
        reference = beginning(samples, piece, vehicle)
        if reference is not None and piece.stop - piece.start > GROSS_LEAST:
            e = residual_growth(samples, piece, reference, vehicle)
            left = e.variance + 2 * e.lagged
            excess[:3][left > GROSS * (noise + _stated_growth(samples, piece, reference, vehicle))] = np.inf
    excess[vehicle.held_axes] = np.nan
    return excess


def _stated_growth(samples: Source, cycles: slice, reference: Reference, vehicle: Vehicle) -> Array:
    """(3,) variance of the rate's growth per cycle that the stated disturbance torque and pulse errors cause, (rad/s)²."""
    inverse = np.linalg.inv(reference.inertia)
    impulse = vehicle.environment.disturbance_torque_n_m * median(gathered(samples, cycles, lambda here: here.executed.duration_s))
    covariance = impulse**2 * np.eye(3)
    if vehicle.thrust.pulse_sigma > 0:
        moment = plant_of(vehicle).jet_moment(reference)
        covariance = covariance + moment @ gathered(samples, cycles, _pulses).mean(0) @ moment.T
    return np.diag(inverse @ covariance @ inverse.T)


def _pulses(samples: Samples) -> Array:
    found = samples.executed.pulse_covariance
    return np.zeros((len(samples), 6, 6)) if found is None else np.where(samples.executed.uncommanded[:, None, None], 0.0, found)


def with_disturbances(excess: Array, vehicle: Resolved, likeliest: Callable[[Resolved], Levels]) -> Resolved:
    """The vehicle with disturbance torque and noise of gyro and accelerometer sized so that innovations in ``excess`` (6,) are explained.

    Disturbance torque or the gyro's noise: at the ``likeliest`` level (:func:`massprop_cli.estimate.sizing.likeliest_levels`); what is
    still missing then raises a torque. Accelerometer noise: widened per axis by the excess.
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
    """Whether disturbances, or the accelerometer's noise, were raised beyond what is stated."""
    return (used.environment, used.estimator) != (stated.environment, stated.estimator)


def beyond_commands(used: Vehicle, stated: Vehicle, samples: Source) -> tuple[float, float] | None:
    """A torque that was sized, N m per cycle, and that of the commands (rms of those that give any), where it is the larger.

    What disturbs a vehicle more in each cycle than its own commands do is no disturbance of it: the log is not what it is taken for.
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
    """What was added to the stated noise, and what is still not explained."""
    found = []
    now, before = used.environment, stated.environment
    if (now.disturbance_torque_n_m, now.disturbance_walk_n_m) != (before.disturbance_torque_n_m, before.disturbance_walk_n_m):
        found.append(Notice("disturbance-torque", UNEXPLAINED + _torque(stated, used, samples)))
    if used.imu.gyro_noise_rad_s != stated.imu.gyro_noise_rad_s:
        wider = used.imu.gyro_noise_rad_s / stated.imu.gyro_noise_rad_s
        found.append(
            Notice(
                "gyro-misfit",
                f"the stated noise does not explain the rates; the gyro's was widened by {wider:.3g}, to {used.imu.gyro_noise_rad_s:.3g} "
                "rad/s. Sigmas include it. Look for vibration, coarse counts, or a noise stated of another rate than a cycle's mean",
            )
        )
    if used.estimator.accel_noise_scale != stated.estimator.accel_noise_scale:
        x, y, z = used.estimator.accel_noise_scale
        found.append(
            Notice(
                "accelerometer-misfit",
                f"the stated noise does not explain the specific force; it was widened by {x:.3g}, {y:.3g}, {z:.3g} in x, y, z. "
                "Sigmas include it as noise. Look for drag, vibration, accelerometer bias, a wrong IMU position or mounting",
            )
        )
    if not np.isnan(excess).all():
        worst = float(np.nanmax(excess))
        found.append(
            Notice(
                "model-misfit",
                f"innovations are still {np.sqrt(worst):.3g} times as large as the model expects; sigmas are too small by about that",
            )
        )
    return found


def _torque(stated: Resolved, used: Resolved, samples: Source) -> str:
    """What is said of a torque that was sized."""
    beyond = beyond_commands(used, stated, samples)
    if beyond is not None:
        return BEYOND.format(torque=beyond[0], commanded=beyond[1])
    parts = (("white", used.environment.disturbance_torque_n_m), ("slowly varying by", used.environment.disturbance_walk_n_m))
    added = ", ".join(f"{what} {size:.3g} N m per cycle" for what, size in parts if size > 0)
    return (
        f"; a disturbance torque was added: {added}. Sigmas include it as noise. "
        "Look for a lag of the thrust, damping by air, friction, thrust errors, times that scatter, a wrong delay or jet"
    )


def _changed(vehicle: Resolved, **sections: dict[str, Any]) -> Resolved:
    changes = {name: getattr(vehicle, name).model_copy(update=update) for name, update in sections.items() if update}
    return vehicle.model_copy(update=changes) if changes else vehicle
