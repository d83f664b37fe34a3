"""What a log gives if what is wrong with it is mended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude import split
from massprop_cli.conclude.analysis import Analysis, MendedAnswer
from massprop_cli.conclude.contradict import Fault
from massprop_cli.conclude.estimated import estimated
from massprop_cli.conclude.judge import judged
from massprop_cli.conclude.verdict import conclude
from massprop_cli.diagnosis import outliers
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import offline
from massprop_cli.estimate.history import phases_of
from massprop_cli.estimate.noiselevels import with_noise_levels
from massprop_cli.estimate.phases import Progress
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.stream import Stream

if TYPE_CHECKING:
    from massprop_cli.diagnosis.corrections import Correction


FOUND = {
    "imu": ("gyro_noise_rad_s", "accel_noise_m_s2", "gyro_outliers_s", "accel_outliers_s"),
    "environment": ("disturbance_torque_n_m", "disturbance_walk_n_m"),
    "estimator": ("accel_noise_scale",),
}
"""What an estimate finds of noise."""


def mended(found: Analysis, say: Progress) -> list[MendedAnswer]:
    """One answer for each named fault that has a cure."""
    return [answer for fault in _distinct(found.faults) if (answer := _mended(found, fault, say)) is not None]


def _distinct(faults: Sequence[Fault]) -> list[Fault]:
    """One of those that the same cure mends."""
    return [fault for i, fault in enumerate(faults) if fault.cure is not None and fault.cure not in [f.cure for f in faults[:i]]]


def _mended(found: Analysis, fault: Fault, say: Progress) -> MendedAnswer | None:
    """The log examined again with the fault mended; None where it can't be."""
    say("with the fault mended", 1.0)
    cure = fault.cure
    if cure is None:
        return None
    try:
        log, source = cure.log(found.log), found.source
        if fault.change_s is not None:
            source = split.at(found, fault.change_s)
        else:
            source = replace(source, vehicle=vehiclefile.changed(source.vehicle, cure.settings))
        again = estimated(log, source, (), say, check=False)
        around = [_beside(found, again, near) for near in fault.around]
        rivals = tuple(_beside(found, again, rival, offline.SETTLINGS) for rival in fault.rivals)
        again = judged(_widened(again, around), [])
    except InputError:
        return None
    settings = (*cure.settings, *cure.column_settings(found.log, found.source.vehicle.columns))
    return MendedAnswer(fault, settings, again.conclusions, rivals)


def _beside(found: Analysis, mended: Analysis, cure: Correction, passes: int = 1) -> list[Array]:
    """(10,) what so many passes on from the mended fit of each phase give with another cure instead; NaN where there is none."""
    vehicle = _as_noisy(vehiclefile.changed(found.source.vehicle, cure.settings), mended.vehicle)
    samples = Stream.of(outliers.without(cure.log(found.log), vehicle), vehicle, stated_timing(vehicle, mended.timing))
    phases = phases_of(samples.log, vehicle, samples)
    used, _ = with_noise_levels(samples, [cycles for _, cycles in phases], vehicle)
    references = [settled.reference for settled in mended.settled]
    return [
        np.full(10, np.nan) if reference is None else offline.value(samples, cycles, reference, used.in_phase(phase), passes)
        for (phase, cycles), reference in zip(phases, references, strict=True)
    ]


def _as_noisy(vehicle: Vehicle, used: Vehicle) -> Vehicle:
    """With the noise, the disturbances and the outliers that were found of another, so that its values differ by its cure alone."""
    parts = {name: {key: getattr(getattr(used, name), key) for key in keys} for name, keys in FOUND.items()}
    return vehicle.model_copy(update={name: getattr(vehicle, name).model_copy(update=keys) for name, keys in parts.items()})


def _widened(found: Analysis, around: Sequence[Sequence[Array]]) -> Analysis:
    """With sigmas that hold by how much the values move if each unknown of what was mended is one sigma further on."""
    if not around:
        return found
    histories = []
    for i, (history, settled) in enumerate(zip(found.histories, found.settled, strict=True)):
        moved = np.stack([values[i] - settled.values[-1] for values in around], 1)
        sigmas = spill.empty(*history.sigmas.shape)
        for part in spill.parts(len(sigmas)):
            sigmas[part] = np.sqrt(history.sigmas[part] ** 2 + (moved**2).sum(1))
        histories.append(replace(history, sigmas=sigmas, covariance=history.covariance + moved @ moved.T))
    return replace(found, histories=tuple(histories), conclusions=tuple(conclude(history, found.vehicle) for history in histories))
