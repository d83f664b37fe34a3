"""Measurement model of logged attitudes: the error of the attitude that the gyro carries."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import mean_rotation, rotation, times
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.compensate import Samples


class Seen(NamedTuple):
    """Measurements of K cycles by n states; nothing but noise of one in a cycle without a logged attitude."""

    observation: Array
    """(K, 3, n)"""
    offset: Array
    """(K, 3) rad"""
    noise: Array
    """(K, 3, 3) root of their noise."""


def seen(here: Samples, layout: Layout, reference: Reference) -> Seen | None:
    """Rotation vectors from the carried to the logged attitude; None where none is logged.

    When a share s of the cycle has gone by they are ``R(−θ s) φ + J(θ s) s T (ω − ω_c) + misalignment``, θ = ω T, with the error φ at the
    cycle's start and the rate ω_c that carries the attitude (:meth:`massprop_cli.model.plant.bearing.BearingBody.tilt_step`).
    """
    measured = here.measured
    if measured is None:
        return None
    gone_s = measured.share * here.executed.duration_s
    turn = (here.rate_rad_s - reference.gyro_bias) * gone_s[:, None]
    by_rate = mean_rotation(-turn) * gone_s[:, None, None]
    observation = np.zeros((len(turn), 3, layout.states))
    observation[..., layout.own(layout.tilt)], observation[..., layout.own(RATE)] = rotation(-turn), by_rate
    observation[..., layout.own(layout.misalignment)] = np.eye(3)[:, : layout.misalignment.stop - layout.misalignment.start]
    logged = np.isfinite(measured.noise_rad)
    observation[~logged] = 0.0
    offset = np.where(logged[:, None], measured.offset_rad + times(by_rate, here.carried_rad_s), 0.0)
    return Seen(observation, offset, np.where(logged, measured.noise_rad, 1.0)[:, None, None] * np.eye(3))
