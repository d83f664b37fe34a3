"""Measurement model of logged attitudes: each measures the error of the attitude that the gyro propagates."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import mean_rotation, rotation, times
from massprop_cli.model.layout import RATE, Layout
from massprop_cli.model.plant import Reference
from massprop_cli.prepare.compensate import Samples


class AttitudeMeasurements(NamedTuple):
    """Measurements of K cycles with n states; a cycle without a logged attitude has a zero Jacobian and unit noise."""

    observation: Array
    """(K, 3, n) measurement Jacobian."""
    offset: Array
    """(K, 3) measured value, rad."""
    noise: Array
    """(K, 3, 3) root of the noise covariance, rad."""


def attitude_measurements(here: Samples, layout: Layout, reference: Reference) -> AttitudeMeasurements | None:
    """Rotation vectors from the propagated to the logged attitude; None if the log holds no attitudes.

    After a share s of the cycle the rotation vector is ``R(−θ s) φ + J(θ s) s T (ω − ω_c) + misalignment``, θ = ω T. φ is the attitude
    error at the cycle's start and ω_c the rate that propagates the attitude
    (:meth:`massprop_cli.model.plant.bearing.BearingBody.tilt_step`).
    """
    measured = here.measured
    if measured is None:
        return None
    elapsed_s = measured.share * here.executed.duration_s
    turn = (here.rate_rad_s - reference.gyro_bias) * elapsed_s[:, None]
    by_rate = mean_rotation(-turn) * elapsed_s[:, None, None]
    observation = np.zeros((len(turn), 3, layout.states))
    observation[..., layout.in_states(layout.tilt)], observation[..., layout.in_states(RATE)] = rotation(-turn), by_rate
    observation[..., layout.in_states(layout.misalignment)] = np.eye(3)[:, : layout.misalignment.stop - layout.misalignment.start]
    logged = np.isfinite(measured.noise_rad)
    observation[~logged] = 0.0
    offset = np.where(logged[:, None], measured.offset_rad + times(by_rate, here.carried_rad_s), 0.0)
    return AttitudeMeasurements(observation, offset, np.where(logged, measured.noise_rad, 1.0)[:, None, None] * np.eye(3))
