"""Which way is up: a logged attitude against the gyro that turns it and the gravity that is felt; on a table, the IMU against both."""

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import matrices, rotation_vector, turns_between
from massprop_cli.base.rigidbody import times
from massprop_cli.check.finding import Finding, finding
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle

MISFIT = 0.2
"""Part of the gyro's turning by which the logged one may differ, but for white noise of both."""
LEAST = 8
"""Logged turns of which anything is said."""
STILL = 1e-3
"""rad; below this much turning in all, nothing can be said."""
TILTED = 0.05
"""rad between the mean specific force and the vertical: pushes of jets average out to less."""


ROCKING = 0.05
"""Part of the yaw rate that the other two may be on a table: an IMU that is three degrees out of level."""


def _fault(code: str, said: str, remedy: str) -> Finding:
    return finding("attitude", code, "fault", said, remedy)


def on_table(log: Log, vehicle: Vehicle) -> list[Finding]:
    """Findings of an IMU that should turn about the body's Z alone and feel gravity along it; nothing but on a table."""
    if vehicle.environment.kind != "planar":
        return []
    mount, found = np.array(vehicle.imu.body_from_imu), []
    felt = (log.delta_v_imu_m_s @ mount.T / log.interval_s[:, None]).mean(0)
    off = float(np.linalg.norm(felt - [0.0, 0.0, vehicle.environment.gravity_m_s2])) if all(log.axes[3:]) else 0.0
    if off > TILTED * vehicle.environment.gravity_m_s2:
        said = f"the accelerometer feels {', '.join(f'{x:.4g}' for x in felt)} m/s^2 along the body's X, Y and Z on the mean; Z points up"
        remedy = "correct imu.body_from_imu, the accelerometer's signs and unit, or environment.gravity_m_s2"
        found.append(_fault("table-gravity", said, remedy))
    rate = log.delta_theta_imu_rad @ mount.T / log.interval_s[:, None]
    slow = rate - rate.mean(0)
    noise = (vehicle.imu.gyro_noise_rad_s or 0.0) * np.sqrt(log.records_per_cycle)
    rocking, yaw = (float(np.sqrt(max((part**2).sum(1).mean() - part.shape[1] * noise**2, 0.0))) for part in (slow[:, :2], slow[:, 2:]))
    if rocking > ROCKING * yaw and rocking > noise:
        said = f"the vehicle yaws by {yaw:.3g} rad/s (rms), and the gyro shows {rocking:.3g} rad/s about the axes that lie in the table"
        found.append(_fault("table-rocking", said, "correct imu.body_from_imu; or see to the pads, on which the vehicle rocks"))
    return found


def attitude(log: Log, vehicle: Vehicle) -> list[Finding]:
    """Findings of logged quaternions; nothing where none are logged."""
    if log.attitude_wxyz is None:
        return []
    mount = np.array(vehicle.imu.body_from_imu)
    found = []
    rows = np.flatnonzero(np.isfinite(log.attitude_wxyz[:, 0]))
    turned = np.diff(np.cumsum(log.delta_theta_imu_rad @ mount.T, 0)[rows], axis=0)
    logged = rotation_vector(turns_between(log.attitude_wxyz[rows]))
    if len(logged) < LEAST:
        return []
    size = float(np.sqrt((turned**2).sum()))
    # what wanders slowly is the gyro's bias, which has a warning of its own
    off = turned - logged - (turned - logged).mean(0)
    noise = (vehicle.imu.gyro_noise_rad_s or 0.0) * vehicle.cycle.period_s / np.sqrt(log.records_per_cycle)
    # and white noise of the attitude itself comes back in the next turn with the other sign
    scatter = max(float(-(off[1:] * off[:-1]).mean()), 0.0)
    left = float(np.sqrt(max((off**2).sum() - off.size * (noise**2 + 2 * scatter), 0.0)))
    if np.sqrt((turned**2).sum()) > STILL and left > MISFIT * size:
        inverse = float(np.sqrt(((turned + logged - (turned + logged).mean(0)) ** 2).sum()))
        hint = "it turns the other way: is it body from world? Give its conjugate" if inverse < left / 2 else "are both in the same axes?"
        said = f"the logged attitude turns otherwise than the gyro: {100 * left / max(size, STILL):.3g} % of its turning is unexplained"
        found.append(_fault("attitude-gyro", said, f"{hint} (quat_* is wxyz, world from body; imu.body_from_imu)"))
    if vehicle.pivoted and all(log.axes[3:]):
        found += _gravity(log, mount)
    return found


def _gravity(log: Log, mount: Array) -> list[Finding]:
    assert log.attitude_wxyz is not None
    rows = np.isfinite(log.attitude_wxyz[:, 0])
    felt = (log.delta_v_imu_m_s @ mount.T / log.interval_s[:, None])[rows]
    world = times(matrices(log.attitude_wxyz[rows]), felt).mean(0)
    angle = float(np.arctan2(np.hypot(world[0], world[1]), world[2]))
    if angle <= TILTED:
        return []
    said = f"specific force in world axes is {angle:.3g} rad ({np.degrees(angle):.3g}°) off the vertical on the mean"
    remedy = "correct the attitude's reference (Z up), imu.body_from_imu, or the accelerometer's signs"
    return [_fault("attitude-gravity", said, remedy)]
