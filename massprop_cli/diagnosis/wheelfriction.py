"""Friction of wheels whose torque is logged: what of it explains the motion, with nothing known of the body.

By Gauss–Newton steps on what free coefficients leave (:mod:`massprop_cli.diagnosis.freeresponse`); friction is against the speed alone.
"""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import TINY, Array
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import MeasuredMotion, cost, summed
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.supposed import States, Supposed
from massprop_cli.errorparameters.setup import stating
from massprop_cli.inputs.actuators.wheel import WheelLog

ROUNDS, STEP = 12, 5e-3
"""Gauss–Newton steps at most; the part of the largest torque behind their derivatives."""
SHORTER, STILL = (1.0, 0.5, 0.25, 0.1), 0.1
"""Parts of a step that are tried; by how much −2 log likelihood must fall for another one."""
KEYS = ("coulomb_friction_n_m", "viscous_friction_n_m_s")


def supposed(case: Case, motion: MeasuredMotion) -> list[Supposed]:
    """Friction of each wheel that explains most, and each combination that was sought one sigma away; nothing where none explains more."""
    entries, sizes = _sizes(case)
    try:
        return _supposed(case, motion, entries, sizes) if entries else []
    except (InputError, np.linalg.LinAlgError):
        return []  # a log that is too short to tell


def _supposed(case: Case, motion: MeasuredMotion, entries: Sequence[str], sizes: Array) -> list[Supposed]:
    def states(parts: Array) -> States:
        return dict(zip(entries, (np.maximum(parts, 0) * sizes).tolist(), strict=True))

    def left(parts: Array) -> Array:
        return summed(motion, case.log, stating(case.vehicle, states(parts)), case.timing)

    parts = np.array([case.setup.value(key)[0] for key in entries]) / sizes
    begun = now = left(parts)
    for _ in range(ROUNDS):
        white = 1 / np.sqrt((now**2).mean(0) + TINY)
        slopes = np.stack([((left(parts + STEP * unit) - now) * white).ravel() / STEP for unit in np.eye(len(parts))], 1)
        # as large as the largest torque at most, say
        rows, ahead = np.vstack([slopes, np.eye(len(parts))]), np.append(-(now * white).ravel(), -parts)
        step = _bounded(rows, ahead + rows @ parts) - parts
        moved, then = min(((at, left(at)) for at in (parts + part * step for part in SHORTER)), key=lambda one: cost(one[1]))
        if cost(then) > cost(now) - STILL:
            break
        parts, now = moved, then
    if cost(now) > cost(begun) - CLEAR:
        return []
    variance, directions = np.linalg.eigh(np.linalg.inv(rows.T @ rows))
    further = tuple(states(_beside(parts, sigma * along)) for sigma, along in zip(np.sqrt(variance), directions.T, strict=True))
    return [Supposed(("wheel-friction",), states(parts), further)]


def _sizes(case: Case) -> tuple[list[str], Array]:
    """Keys of the wheels' friction, and what of each would be as much as the largest torque on its wheel."""
    entries, sizes = [], []
    for n, (wheel, said) in enumerate(zip(case.vehicle.wheels, case.log.spinning, strict=False)):
        if not isinstance(said, WheelLog) or said.torque_n_m is None or not said.moved:
            continue
        most = float(np.abs(said.torque_n_m).max())
        gained = np.cumsum(said.torque_n_m) * case.vehicle.cycle.period_s / wheel.spin_inertia_kg_m2
        fastest = float(np.abs((said.start_rad_s or 0.0) + gained).max())
        entries += [f"wheels.{n}.{key}" for key in KEYS]
        sizes += [most, most / fastest]
    return entries, np.array(sizes)


def _beside(parts: Array, step: Array) -> Array:
    """A step further on the one way or the other, or as far as none falls below 0."""
    room = [min([1.0, *(parts[down] / -way[down])]) for way in (step, -step) for down in [way < 0]]
    return np.asarray(parts + (step * room[0] if room[0] >= room[1] else -step * room[1]))


def _bounded(rows: Array, told: Array) -> Array:
    """The least-squares solution of ``rows`` x = ``told`` that is nowhere below 0, by leaving out what would be."""
    own, found = np.ones(rows.shape[1], dtype=bool), np.zeros(rows.shape[1])
    while own.any():
        found[:] = 0
        found[own] = np.linalg.lstsq(rows[:, own], told, rcond=None)[0]
        if (found >= 0).all():
            break
        own &= found >= 0
    return np.maximum(found, 0)
