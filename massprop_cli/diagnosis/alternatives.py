"""What the vehicle file says to be uncertain by other values of any of its keys: consider parameters of one sigma each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehiclefile import alternative
from massprop_cli.model.layout import Layout
from massprop_cli.model.sensitivity import Consider, Restated
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing


def uncertain(consider: Consider, setup: Setup, samples: Stream) -> Consider:
    """With what is stated to be ``uncertain``, each independent of all others.

    :class:`InputError` where an alternative has other states than the vehicle as stated: a sigma of a bias, say.
    """
    if not setup.vehicle.uncertain:
        return consider
    variants = [_restated(values, setup, samples) for values in setup.vehicle.uncertain]
    known = len(consider.variants)
    covariance = np.eye(known + len(variants))
    covariance[:known, :known] = consider.covariance
    return replace(consider, variants=(*consider.variants, *variants), covariance=covariance)


def _restated(values: Mapping[str, Any], setup: Setup, samples: Stream) -> Restated:
    log, stated, timing = setup.log, setup.vehicle, setup.timing
    vehicle = alternative(stated, values)
    before, after = stated_timing(stated, timing), stated_timing(vehicle, timing)
    moved = Timing(*(max(used + there - here, 0.0) for used, there, here in zip(timing, after, before, strict=True)))
    there = Stream.of(_read(log, values), vehicle, moved)
    if Layout.of(there, vehicle) != Layout.of(samples, stated):
        raise InputError(f"uncertain: {', '.join(values)}: changes what is estimated, not what is stated; state it for itself")
    return Restated(there, vehicle)


def _read(log: Log, values: Mapping[str, Any]) -> Log:
    """The log with the alternative's factors on what it holds."""
    gyro, accelerometer, command = (values.get(f"{name}_factors") for name in ("gyro", "accel", "command"))
    return replace(
        log,
        delta_theta_imu_rad=log.delta_theta_imu_rad if gyro is None else log.delta_theta_imu_rad @ np.array(gyro).T,
        delta_v_imu_m_s=log.delta_v_imu_m_s if accelerometer is None else log.delta_v_imu_m_s @ np.array(accelerometer).T,
        command=log.command if command is None or log.command_kind != "wrench" else log.command * np.array(command),
    )
