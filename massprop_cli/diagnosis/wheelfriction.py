"""Friction of wheels whose torque is logged, by maximum likelihood of the free response.

Gauss–Newton steps minimise the residuals of :mod:`massprop_cli.diagnosis.freeresponse`. Friction opposes the speed.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import MeasuredMotion, cost, summed_residuals
from massprop_cli.diagnosis.keyhypothesis import KeyHypothesis, KeyValues
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.errorparameters.setup import stating
from massprop_cli.inputs.actuators.wheel import WheelLog

ROUNDS, STEP = 12, 5e-3
"""Most Gauss–Newton steps; step of their difference quotients over the largest torque."""
SHORTER, STILL = (1.0, 0.5, 0.25, 0.1), 0.1
"""Parts of a step that are tested; least decrease of −2 log likelihood for another step."""
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
        return dict(zip(entries, (np.maximum(parts, 0) * sizes).tolist(), strict=True))

    def residuals(parts: Array) -> Array:
        return summed_residuals(motion, case.log, stating(case.vehicle, states(parts)), case.timing)

    parts = np.array([case.setup.value(key)[0] for key in entries]) / sizes
    initial = current = residuals(parts)
    for _ in range(ROUNDS):
        weights = 1 / np.sqrt((current**2).mean(0) + TINY)
        slopes = np.stack([((residuals(parts + STEP * unit) - current) * weights).ravel() / STEP for unit in np.eye(len(parts))], 1)
        # prior sigma: the largest torque
        rows, target = np.vstack([slopes, np.eye(len(parts))]), np.append(-(current * weights).ravel(), -parts)
        step = _nonnegative(rows, target + rows @ parts) - parts
        next_parts, next_residuals = min(
            ((at, residuals(at)) for at in (parts + part * step for part in SHORTER)), key=lambda one: cost(one[1])
        )
        if cost(next_residuals) > cost(current) - STILL:
            break
        parts, current = next_parts, next_residuals
    if cost(current) > cost(initial) - CLEAR:
        return []
    variance, directions = np.linalg.eigh(np.linalg.inv(rows.T @ rows))
    one_sigma = tuple(states(_moved_within(parts, sigma * along)) for sigma, along in zip(np.sqrt(variance), directions.T, strict=True))
    return [KeyHypothesis(("wheel-friction",), states(parts), one_sigma)]


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


def _moved_within(parts: Array, step: Array) -> Array:
    """A step in the direction with more room above 0, within it."""
    room = [min([1.0, *(parts[down] / -way[down])]) for way in (step, -step) for down in [way < 0]]
    return np.asarray(parts + (step * room[0] if room[0] >= room[1] else -step * room[1]))


def _nonnegative(rows: Array, target: Array) -> Array:
    """Least-squares solution of ``rows`` x = ``target`` with x ≥ 0, by removing negative components."""
    free, solution = np.ones(rows.shape[1], dtype=bool), np.zeros(rows.shape[1])
    while free.any():
        solution[:] = 0
        solution[free] = np.linalg.lstsq(rows[:, free], target, rcond=None)[0]
        if (solution >= 0).all():
            break
        free &= solution >= 0
    return np.maximum(solution, 0)
