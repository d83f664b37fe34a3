"""What the vehicle file says to be uncertain by other values of any of its keys: consider parameters of one sigma each."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.inputs.reread import reread
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import alternative
from massprop_cli.model.layout import Layout
from massprop_cli.model.sensitivity import Consider, Restated
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing


@dataclass(frozen=True)
class Alternative:
    """A log and its vehicle file, one sigma of something uncertain away from those that are used."""

    log: Log
    values: Mapping[str, Any]
    """Of dotted keys of the vehicle file."""


def uncertain(
    consider: Consider, log: Log, stated: Vehicle, timing: Timing, samples: Stream, besides: Sequence[Alternative] = ()
) -> Consider:
    """With what is stated to be ``uncertain``, with the skew of the gyro's axes, and with alternatives ``besides``; all independent.

    :class:`InputError` where an alternative has other states than the vehicle as stated: a sigma of a bias, say.
    """
    each = [Alternative(log, values) for values in stated.uncertain]
    each += [Alternative(_sheared(log, shear), {}) for shear in _shears(stated.imu.gyro_skew_sigma_rad)]
    variants = [_restated(one, log, stated, timing, samples) for one in (*each, *besides)]
    if not variants:
        return consider
    covariance = np.eye(len(consider.variants) + len(variants))
    covariance[: len(consider.variants), : len(consider.variants)] = consider.covariance
    return replace(consider, variants=(*consider.variants, *variants), covariance=covariance)


def _restated(one: Alternative, log: Log, stated: Vehicle, timing: Timing, samples: Stream) -> Restated:
    vehicle = alternative(stated, one.values)
    read = reread(log, stated.columns, vehicle.columns) if one.log is log else one.log
    before, after = stated_timing(stated, timing), stated_timing(vehicle, timing)
    moved = Timing(*(max(used + there - here, 0.0) for used, there, here in zip(timing, after, before, strict=True)))
    there = Stream.of(read, vehicle, moved)
    if Layout.of(there, vehicle) != Layout.of(samples, stated):
        raise InputError(f"uncertain: {', '.join(one.values)}: changes what is estimated, not what is stated; state it for itself")
    return Restated(there, vehicle)


def _shears(size: float) -> list[Array]:
    """(3, 3) each pair of axes out of square by ``size``, rad; none of 0.

    An axis that leans over turns and shears; the turn is a mounting's, and the shear is taken on by the inertia, unseen.
    """
    pairs = itertools.combinations(np.eye(3), 2) if size > 0 else ()
    return [np.eye(3) + size * (np.outer(a, b) + np.outer(b, a)) for a, b in pairs]


def _sheared(log: Log, shear: Array) -> Log:
    return replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad @ shear.T)
