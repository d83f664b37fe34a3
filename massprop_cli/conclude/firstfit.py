"""First fits of a log: gyro bias and tachometer noise, which later fits use as known.

The estimators are linear about the integrated attitude. Errors of second order remain: tilt times heading and g φ²/2; on a table, slope
times heading. So the log is preprocessed again without the gyro bias that the first fit estimates.

An error e of a momentum device's momentum, N m s, changes the rate by I⁻¹ e. The next record reverses it, so it is white noise of the rate.
The gyroscopic torque of the total momentum H = I ω + h changes by (I⁻¹ e) × H, a white torque that nothing reverses.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CERTAIN, CLEAR, ITERATIONS, STILL
from massprop_cli.base.rigidbody import cross
from massprop_cli.diagnosis.preprocessing import Ready, about_values, ready
from massprop_cli.errorparameters.setup import stating
from massprop_cli.estimate.phases import AsStated, Progress, as_stated
from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.prepare.compensate import Samples, Source, biased_attitude, gathered
from massprop_cli.prepare.tachometer import change_sigmas

LITTLE = 0.01
"""Largest change of the bias at convergence, in its stated sigmas."""
NEGLIGIBLE = 1.005
"""Factor on the gyro noise below which tachometer noise is omitted: a tenth of the gyro noise, with a torque that adds less than a tenth to
a variance."""


class _First(NamedTuple):
    """Preprocessed log and its fit with the stated noise."""

    begun: Ready
    plain: AsStated


def first_fits(log: Log, source: VehicleSource, say: Progress) -> tuple[Ready, AsStated | None]:
    """Preprocess a log and fit it with the stated noise and disturbances; no fit by the thesis's method."""
    begun = ready(log, source, say)
    if begun.stated.estimator.method == "thesis":
        return begun, None

    first, driven = _with_wheel_drive(_fitted(begun), log, source, say)

    def with_bias(bias: Array) -> _First:
        known = tuple((np.array(begun.stated.imu.body_from_imu).T @ bias).tolist())
        return _fitted(ready(log, replace(driven, vehicle=stating(driven.vehicle, {"imu.gyro_bias_rad_s": known})), say))

    return _with_unsampled_thrust(_with_tachometer_noise(_with_gyro_bias(first, with_bias)))


def _fitted(begun: Ready) -> _First:
    """Fit with the log read about the estimates of its ``uncertain`` values; as stated where one leaves the stated sigma altogether."""
    stated = first = _First(begun, as_stated(begun.samples, begun.phases, begun.stated, begun.consider))
    now = np.array([one.about for one in begun.consider.restated])
    if not now.size or now.any():
        return first
    longest = int(np.argmax([piece.stop - piece.start for piece in begun.pieces]))
    movable = np.array([one.movable for one in begun.consider.restated])
    for _ in range(ITERATIONS):
        fit = first.plain.fits[longest]
        at = now if fit is None else np.where(movable, fit.values, 0.0)
        if np.abs(at - now).max() < STILL:
            break
        if not np.abs(at).max() < CERTAIN:
            return stated
        try:
            about = about_values(begun, at.tolist())
        except InputError:
            break
        first, now = _First(about, as_stated(about.samples, about.phases, about.stated, about.consider)), at
    return first


def _with_wheel_drive(first: _First, log: Log, source: VehicleSource, say: Progress) -> tuple[_First, VehicleSource]:
    """Let wheel drives hold a speed ramp instead of a torque, if the vehicle file does not state it and the fit improves clearly."""
    unstated = [f"wheels.{n}.holds" for n, wheel in enumerate(first.begun.stated.wheels) if wheel.holds is None]
    if not unstated or not first.begun.samples.free_inertia.any() or not log.command.any():
        return first, source
    with_speed = replace(source, vehicle=stating(source.vehicle, dict.fromkeys(unstated, "speed")))
    other = _fitted(ready(log, with_speed, say))
    if not other.plain.chi_square < first.plain.chi_square - CLEAR:
        return first, source
    message = (
        "holds of wheels is not stated; the log fits best if their drives hold the acceleration and not the torque, and massprop assumed it"
    )
    return other._replace(begun=other.begun._replace(notices=[*other.begun.notices, Notice("noise-estimated", message)])), with_speed


def _with_gyro_bias(first: _First, with_bias: Callable[[Array], _First]) -> _First:
    """Fit with the estimated gyro bias if the attitude is integrated from the gyro.

    ``with_bias`` fits with a bias (3,), rad/s, body axes.
    """
    stated, samples = first.begun.stated, first.begun.samples
    sigma = stated.imu.gyro_bias_sigma_rad_s
    if sigma == 0 or any(stated.imu.gyro_bias_rad_s):
        return first
    if stated.environment.kind == "planar":
        # a sliding body rotates about Z only: mean rates about X and Y are bias, which the lever arm would turn into force
        level = gathered(samples, slice(0, len(samples)), lambda part: part.rate_rad_s).mean(0) * (1.0, 1.0, 0.0)
        first = with_bias(level) if np.linalg.norm(level) < CERTAIN * sigma else first
        sloped = stated.environment.table_tilt_sigma_rad > 0 and first.plain.misfit
        return _with_yaw_bias(first, lambda bias: with_bias(bias + level)) if sloped else first
    fit = first.plain.fits[0]
    if fit is None or fit.history.reference is None or not biased_attitude(samples.attitude_logged, stated):
        return first
    bias, found = np.zeros(3), first
    for _ in range(ITERATIONS):
        (fit, *_) = found.plain.fits
        step = None if fit is None or fit.history.reference is None else fit.history.reference.gyro_bias
        if step is None or (found is not first and np.linalg.norm(step) < LITTLE * sigma):
            break
        bias = bias + step
        if not np.linalg.norm(bias) < CERTAIN * sigma:
            return first
        found = with_bias(bias)
    return found


def _with_yaw_bias(first: _First, with_bias: Callable[[Array], _First]) -> _First:
    """Fit with the yaw bias at the minimum of the parabola through three fits, if the stated noise then explains the log."""
    step = np.array([0.0, 0.0, first.begun.stated.imu.gyro_bias_sigma_rad_s])
    before, now, after = (one.plain.left for one in (with_bias(-step), first, with_bias(step)))
    curvature = before - 2 * now + after
    sigmas = (before - after) / (2 * curvature) if curvature > 0 else np.inf
    if not abs(sigmas) < CERTAIN:
        return first
    found = with_bias(sigmas * step)
    return first if found.plain.misfit else found


def _with_tachometer_noise(first: _First) -> _First:
    """Fit with the errors of logged momentum as noise of both sensors and as a torque, in addition to the stated ones."""
    begun, devices = first.begun, first.begun.stated.spinning
    weight = (begun.log.delta_theta_imu_rad**2).sum(1) / begun.log.interval_s
    momentum_sigmas = np.array([device.scatter(logged, weight) for device, logged in zip(devices, begun.log.spinning, strict=True)])
    reference = next((fit.history.reference for fit in first.plain.fits if fit is not None), None)
    if reference is None or not momentum_sigmas.any():
        return first
    by_axis = (momentum_sigmas / np.sqrt(begun.log.records_per_cycle)).repeat([len(device.axes) for device in devices])[:, None]
    rate_sigmas = by_axis * np.concatenate([device.axes for device in devices]) @ np.linalg.inv(reference.inertia)
    imu, added = first.plain.used.imu, (_largest(rate_sigmas**2), _specific_force_sigma(begun, reference))
    level = float(np.hypot(imu.gyro_noise_rad_s, added[0])), float(np.hypot(imu.accel_noise_m_s2, added[1]))
    if level[0] < NEGLIGIBLE * imu.gyro_noise_rad_s and level[1] < NEGLIGIBLE * imu.accel_noise_m_s2:
        return first
    gyroscopic = _gyroscopic_torque_sigma(rate_sigmas, begun.samples, reference.inertia)
    torque = float(np.hypot(begun.stated.environment.disturbance_torque_n_m, gyroscopic))
    notice = Notice(
        "noise-estimated",
        f"wheel speeds have errors (tachometer steps, or speed_sigma_rad_s and speed_step_rad_s): {added[0]:.3g} rad/s of the body's "
        f"rate. massprop adds them to the noise: gyro {level[0]:.3g} rad/s, accelerometer {level[1]:.3g} m/s^2, and a white torque of "
        f"{torque:.3g} N m per cycle for the error of the stored momentum",
    )
    counted = tuple(wheel.model_copy(update={"speed_error_in_noise": True}) for wheel in begun.stated.wheels)
    noise = {"imu.gyro_noise_rad_s": level[0], "imu.accel_noise_m_s2": level[1], "environment.disturbance_torque_n_m": torque}
    stated = stating(begun.stated.model_copy(update={"wheels": counted}), noise)
    return _fitted(begun._replace(stated=stated, notices=[*begun.notices, notice]))


def _specific_force_sigma(begun: Ready, reference: Reference) -> float:
    """Sigma of the specific force, m/s², from errors of the wheels' speed changes within a cycle, along the axis where it is largest."""
    stated, samples = begun.stated, begun.samples.part(slice(0, 1))
    _, response = plant_of(stated).wrench_response(reference, np.eye(6), samples.up_b[:1], np.array(stated.imu.position_m))
    squares = [np.zeros(3)]
    for wheel, change in zip(stated.spinning, change_sigmas(begun.log, stated), strict=True):
        if isinstance(wheel, Wheel) and change > 0:
            squares.append((response[0, :, :3] @ wheel.direction * wheel.spin_inertia_kg_m2 * change / stated.cycle.period_s) ** 2)
    return _largest(np.array(squares))


def _with_unsampled_thrust(first: _First) -> _First:
    """Fit with the thrust errors between samples of the rotor speeds as a white torque and as noise of the specific force."""
    begun, rotors = first.begun, first.begun.stated.rotors
    sampled = zip(rotors, begun.log.command.T, begun.log.cycles_apart, strict=True) if begun.log.cycles_apart else ()
    sigmas = np.array([rotor.unsampled(speed, cycles) for rotor, speed, cycles in sampled])
    reference = next((fit.history.reference for fit in first.plain.fits if fit is not None), None)
    if reference is None or not sigmas.any():
        return first
    wrench = begun.stated.rotor_wrench * sigmas[:, None]
    environment, imu = begun.stated.environment, first.plain.used.imu
    torque = _largest((wrench[:, :3] - np.cross(reference.cg, wrench[:, 3:])) ** 2)
    levels = {
        "environment.disturbance_torque_n_m": float(np.hypot(environment.disturbance_torque_n_m, torque)),
        "imu.accel_noise_m_s2": float(np.hypot(imu.accel_noise_m_s2, _largest(wrench[:, 3:] ** 2) * reference.mu)),
    }
    return _fitted(begun._replace(stated=stating(begun.stated, levels)))


def _gyroscopic_torque_sigma(rate_sigmas: Array, samples: Source, inertia: Array) -> float:
    """Sigma of (I⁻¹ e) × H, N m, about the axis where it is largest; ``rate_sigmas`` (a, 3) is I⁻¹ e by device axis, rad/s."""

    def square(part: Samples) -> Array:
        stored = part.executed.stored
        assert stored is not None
        momentum = part.rate_rad_s @ inertia + stored.mean.mean(1) @ stored.axis
        return np.asarray((cross(rate_sigmas[:, None], momentum[None]) ** 2).sum(0))

    return _largest(gathered(samples, slice(0, len(samples)), square).mean(0, keepdims=True))


def _largest(squares: Array) -> float:
    """Root of the sum of squares (n, 3) along the axis where it is largest."""
    return float(np.sqrt(squares.sum(0).max()))
