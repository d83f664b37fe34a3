"""A plan flown with all its noise and estimated, as its log will be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.plan.rehearsal import Rehearsal
from massprop_cli.testbed.simulate import fly
from massprop_cli.testbed.timeline import Segment

SEEDS = (1, 2)


def uncounted(vehicle: Vehicle) -> list[str]:
    """Keys of the vehicle file that widen sigmas and are no noise of the IMU: the bound doesn't count them."""
    stated = {
        "environment.disturbance_torque_n_m": vehicle.environment.disturbance_torque_n_m,
        "environment.disturbance_walk_n_m": vehicle.environment.disturbance_walk_n_m,
        "environment.damping_sigma_n_m_s": vehicle.environment.damping_sigma_n_m_s,
        "thrust.pulse_sigma": vehicle.thrust.pulse_sigma,
        "thrust.lag_sigma_s": vehicle.thrust.lag_sigma_s,
        "cycle.command_delay_sigma_cycles": vehicle.cycle.command_delay_sigma_cycles,
        "imu.gyro_lag_sigma_s": vehicle.imu.gyro_lag_sigma_s,
        "imu.accel_lag_sigma_s": vehicle.imu.accel_lag_sigma_s,
        "imu.gyro_bias_sigma_rad_s": vehicle.imu.gyro_bias_sigma_rad_s,
        "imu.accel_bias_sigma_m_s2": vehicle.imu.accel_bias_sigma_m_s2,
    }
    return [key for key, value in stated.items() if value > 0]


def beyond_bound(rehearsal: Rehearsal, segments: Sequence[Segment], cycles: int, bound: Array) -> Array:
    """(10,) sigmas of an estimate by the log alone over those of the ``bound`` (10,), at least 1; 1 where it says nothing.

    Root mean square over :data:`SEEDS`: what the log's own pulses and noise do to it differs.
    """
    source = rehearsal.scenario(segments, cycles)
    flight = fly(source, SEEDS)
    found = []
    for member in range(len(SEEDS)):
        estimated = flow.examine(flight.log(member), VehicleSource(flight.vehicle, rehearsal.source, ""))
        found.append(np.sqrt(np.diag(estimated.conclusions[0].bare[1])) / bound)
    ratio = np.sqrt((np.array(found) ** 2).mean(0))
    return np.asarray(np.where(np.isfinite(ratio), np.maximum(ratio, 1.0), 1.0))
