"""First fits of a log: the gyro bias, and the noise of tachometers, that later fits use as known.

The estimators are linear about the attitude as carried. What gravity alone tells of a gyro's bias is put astray by thrust and rotation, and
what is left is of second order: tilt times heading, and g φ²/2; on a table, the slope times the heading. So the log is read again less the
bias that a first fit finds.

An error e of a device's momentum, N m s, is one of the rate by I⁻¹ e, which the next record takes back: white in the rate. But the
total momentum H = I ω + h turns by the rate that all this gives, so (I⁻¹ e) × H is a white torque, whose sum is not taken back.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross
from massprop_cli.diagnosis.preprocessing import Ready, ready
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.errorparameters.setup import stating
from massprop_cli.estimate.phases import AsStated, Progress, as_stated
from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.prepare.compensate import Samples, Source, biased_attitude, gathered
from massprop_cli.prepare.tachometer import change_sigmas

NO_BIAS = 6.0
"""Sigmas of a gyro's bias beyond which what a fit finds stands for something else."""
PULLED, LITTLE = 4, 0.01
"""Times that a bias is looked for, and part of what is stated of it that is none: where a weight hangs far below its pivot, what turns its
pull in the body's axes is far from linear."""
NOTHING = 1.005
"""Factor on the gyro's noise below which what tachometers add is none: a tenth of it, whose torque adds less than a tenth to a variance."""


class _First(NamedTuple):
    begun: Ready
    plain: AsStated


def first_fits(log: Log, source: VehicleSource, say: Progress) -> tuple[Ready, AsStated | None]:
    """A log as it is estimated from, and the fits that nothing was sized for; none by the thesis's method."""
    begun = ready(log, source, say)
    if begun.stated.estimator.method == "thesis":
        return begun, None

    first, driven = _as_driven(_fitted(begun), log, source, say)

    def less(bias: Array) -> _First:
        known = tuple((np.array(begun.stated.imu.body_from_imu).T @ bias).tolist())
        return _fitted(ready(log, replace(driven, vehicle=stating(driven.vehicle, {"imu.gyro_bias_rad_s": known})), say))

    return _with_unsampled_thrust(_with_scattered_speeds(_without_its_bias(first, less)))


def _fitted(begun: Ready) -> _First:
    return _First(begun, as_stated(begun.samples, begun.phases, begun.stated, begun.consider))


def _as_driven(first: _First, log: Log, source: VehicleSource, say: Progress) -> tuple[_First, VehicleSource]:
    """The fit, and the vehicle file, with what the wheels' drives hold between readings, where nothing states it and thrust shows it."""
    own = [f"wheels.{n}.holds" for n, wheel in enumerate(first.begun.stated.wheels) if wheel.holds is None]
    if not own or not first.begun.samples.free_inertia.any() or not log.command.any():
        return first, source
    held = replace(source, vehicle=stating(source.vehicle, dict.fromkeys(own, "speed")))
    other = _fitted(ready(log, held, say))
    if not other.plain.chi_square < first.plain.chi_square - CLEAR:
        return first, source
    said = "holds of wheels is not stated; the log shows that their drives hold the growth of their speed, and not a torque"
    return other._replace(begun=other.begun._replace(notices=[*other.begun.notices, Notice("noise-estimated", said)])), held


def _without_its_bias(first: _First, less: Callable[[Array], _First]) -> _First:
    """Less the gyro's bias, where that turns the weight's pull in the body's axes; ``less`` one (3,) in rad/s, body axes."""
    stated, samples = first.begun.stated, first.begun.samples
    sigma = stated.imu.gyro_bias_sigma_rad_s
    if sigma == 0 or any(stated.imu.gyro_bias_rad_s):
        return first
    if stated.environment.kind == "planar":
        # a body that slides turns about Z alone: what the gyro shows of X and Y is bias, which the lever arm would turn into force
        level = gathered(samples, slice(0, len(samples)), lambda part: part.rate_rad_s).mean(0) * (1.0, 1.0, 0.0)
        first = less(level) if np.linalg.norm(level) < NO_BIAS * sigma else first
        sloped = stated.environment.table_tilt_sigma_rad > 0 and first.plain.misfit
        return _without_its_yaw_bias(first, lambda bias: less(bias + level)) if sloped else first
    fit = first.plain.fits[0]
    if fit is None or fit.history.reference is None or not biased_attitude(samples.attitude_logged, stated):
        return first
    bias, found = np.zeros(3), first
    for _ in range(PULLED):
        (fit, *_) = found.plain.fits
        left = None if fit is None or fit.history.reference is None else fit.history.reference.gyro_bias
        if left is None or (found is not first and np.linalg.norm(left) < LITTLE * sigma):
            break
        bias = bias + left
        if not np.linalg.norm(bias) < NO_BIAS * sigma:
            return first
        found = less(bias)
    return found


def _without_its_yaw_bias(first: _First, less: Callable[[Array], _First]) -> _First:
    """Less the bias about Z with which the log fits, where there is one: what three fits leave is quadratic in it."""
    step = np.array([0.0, 0.0, first.begun.stated.imu.gyro_bias_sigma_rad_s])
    before, now, after = (one.plain.left for one in (less(-step), first, less(step)))
    bent = before - 2 * now + after
    parts = (before - after) / (2 * bent) if bent > 0 else np.inf
    if not abs(parts) < NO_BIAS:
        return first
    found = less(parts * step)
    return first if found.plain.misfit else found


def _with_scattered_speeds(first: _First) -> _First:
    """Errors of logged momentum as noise of both sensors and as a torque, beside what is stated of these."""
    begun, devices = first.begun, first.begun.stated.spinning
    weight = (begun.log.delta_theta_imu_rad**2).sum(1) / begun.log.interval_s
    sizes = np.array([device.scatter(said, weight) for device, said in zip(devices, begun.log.spinning, strict=True)])
    reference = next((fit.history.reference for fit in first.plain.fits if fit is not None), None)
    if reference is None or not sizes.any():
        return first
    each = (sizes / np.sqrt(begun.log.records_per_cycle)).repeat([len(device.axes) for device in devices])[:, None]
    scattered = each * np.concatenate([device.axes for device in devices]) @ np.linalg.inv(reference.inertia)
    own, added = first.plain.used.imu, (_largest(scattered**2), _felt(begun, reference))
    level = float(np.hypot(own.gyro_noise_rad_s, added[0])), float(np.hypot(own.accel_noise_m_s2, added[1]))
    if level[0] < NOTHING * own.gyro_noise_rad_s and level[1] < NOTHING * own.accel_noise_m_s2:
        return first
    torque = float(np.hypot(begun.stated.environment.disturbance_torque_n_m, _turned(scattered, begun.samples, reference.inertia)))
    notice = Notice(
        "noise-estimated",
        f"speeds of wheels scatter as their tachometers count or as is stated (speed_sigma_rad_s, speed_step_rad_s): {added[0]:.3g} rad/s "
        f"of the body's rate; with it the gyro's noise counts as {level[0]:.3g} rad/s, and the accelerometer's as {level[1]:.3g} m/s^2. "
        f"What it turns the stored momentum astray by counts as a white torque of {torque:.3g} N m per cycle",
    )
    counted = tuple(wheel.model_copy(update={"speed_error_in_noise": True}) for wheel in begun.stated.wheels)
    noise = {"imu.gyro_noise_rad_s": level[0], "imu.accel_noise_m_s2": level[1], "environment.disturbance_torque_n_m": torque}
    stated = stating(begun.stated.model_copy(update={"wheels": counted}), noise)
    return _fitted(begun._replace(stated=stated, notices=[*begun.notices, notice]))


def _felt(begun: Ready, reference: Reference) -> float:
    """m/s², one sigma of the specific force by errors of how wheels' speeds change within a cycle, of the axis where it is largest."""
    stated, samples = begun.stated, begun.samples.part(slice(0, 1))
    _, felt = plant_of(stated).wrench_response(reference, np.eye(6), samples.up_b[:1], np.array(stated.imu.position_m))
    squares = [np.zeros(3)]
    for wheel, change in zip(stated.spinning, change_sigmas(begun.log, stated), strict=True):
        if isinstance(wheel, Wheel) and change > 0:
            squares.append((felt[0, :, :3] @ wheel.direction * wheel.spin_inertia_kg_m2 * change / stated.cycle.period_s) ** 2)
    return _largest(np.array(squares))


def _with_unsampled_thrust(first: _First) -> _First:
    """What rotors whose speeds are measured did between samples: as a white torque, and as noise of the specific force."""
    begun, rotors = first.begun, first.begun.stated.rotors
    known = zip(rotors, begun.log.command.T, begun.log.cycles_apart, strict=True) if begun.log.cycles_apart else ()
    sigmas = np.array([rotor.unsampled(x, each) for rotor, x, each in known])
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


def _turned(scattered: Array, samples: Source, inertia: Array) -> float:
    """N m, one sigma of (I⁻¹ e) × H about the axis where it is largest, of errors (a, 3) of the rate, rad/s."""

    def square(part: Samples) -> Array:
        stored = part.executed.stored
        assert stored is not None
        momentum = part.rate_rad_s @ inertia + stored.mean.mean(1) @ stored.axis
        return np.asarray((cross(scattered[:, None], momentum[None]) ** 2).sum(0))

    return _largest(gathered(samples, slice(0, len(samples)), square).mean(0, keepdims=True))


def _largest(squares: Array) -> float:
    """The root of the sum of squares (n, 3) of the axis where that is largest."""
    return float(np.sqrt(squares.sum(0).max()))
