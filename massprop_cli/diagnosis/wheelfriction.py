"""Friction of wheels whose torque is logged, by maximum likelihood of the free response.

It minimises the residuals of :mod:`massprop_cli.diagnosis.freeresponse`. Friction opposes the speed.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.levels import CLEAR
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import MeasuredMotion, bounded_fit, cost, one_sigma_further, summed_residuals
from massprop_cli.diagnosis.keyhypothesis import KeyHypothesis, KeyValues
from massprop_cli.errorparameters.setup import stating
from massprop_cli.inputs.actuators.wheel import WheelLog

KEYS = ("coulomb_friction_n_m", "viscous_friction_n_m_s")


def friction_hypotheses(case: Case, motion: MeasuredMotion) -> list[KeyHypothesis]:
    """Hypothesis of wheel friction with its key values of least cost; empty if it does not explain clearly more."""
    entries, sizes = _sizes(case)
    try:
        return _friction_hypotheses(case, motion, entries, sizes) if entries else []
    except (InputError, np.linalg.LinAlgError):
        return []  # the log is too short


def _friction_hypotheses(case: Case, motion: MeasuredMotion, entries: Sequence[str], sizes: Array) -> list[KeyHypothesis]:
    def states(parts: Array) -> KeyValues:
        return dict(zip(entries, (parts * sizes).tolist(), strict=True))

    def residuals(parts: Array) -> Array:
        return summed_residuals(motion, case.log, stating(case.vehicle, states(parts)), case.timing)

    start = np.array([case.setup.value(key)[0] for key in entries]) / sizes
    bounds = np.zeros(len(entries)), np.full(len(entries), np.inf)
    found = bounded_fit(residuals, start, *bounds)
    if found.cost > cost(residuals(start)) - CLEAR:
        return []
    one_sigma = tuple(map(states, one_sigma_further(found.values, found.covariance, *bounds)))
    return [KeyHypothesis(("wheel-friction",), states(found.values), one_sigma)]


def _sizes(case: Case) -> tuple[list[str], Array]:
    """Friction keys of the wheels, and the value of each that equals the largest torque."""
    entries, sizes = [], []
    for n, (wheel, wheel_log) in enumerate(zip(case.vehicle.wheels, case.log.spinning, strict=False)):
        if not isinstance(wheel_log, WheelLog) or wheel_log.torque_n_m is None or not wheel_log.moved:
            continue
        largest = float(np.abs(wheel_log.torque_n_m).max())
        speed_change = np.cumsum(wheel_log.torque_n_m) * case.vehicle.cycle.period_s / wheel.spin_inertia_kg_m2
        fastest = float(np.abs((wheel_log.start_rad_s or 0.0) + speed_change).max())
        entries += [f"wheels.{n}.{key}" for key in KEYS]
        sizes += [largest, largest / fastest]
    return entries, np.array(sizes)
