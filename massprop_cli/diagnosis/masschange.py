"""A sudden change of the mass properties as the cause of a misfit: two bodies, one before and one after it."""

from collections.abc import Callable, Sequence

import numpy as np

from massprop_cli.base.levels import MAIN_PART, SLIGHT
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis import change
from massprop_cli.diagnosis.corrections import Correction
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.fault import Diagnosis, Fault
from massprop_cli.diagnosis.refit import MOST_CYCLES
from massprop_cli.diagnosis.screening import Screening, busiest, relinearised, screened
from massprop_cli.diagnosis.undisturbed import Undisturbed
from massprop_cli.estimate.initial import first_reference
from massprop_cli.inputs.notice import Notice
from massprop_cli.model.plant.plant import MU

COMMANDED = 30.0
"""Least significance, in sigmas, of a motion that follows the commands. Vehicles moved by their commands have hundreds, commands of another
recording six, and commands shifted by some cycles 20."""

Segments = Callable[[], Undisturbed | None]
"""Deferred search for undisturbed segments, evaluated once."""


def likeliest_change(case: Case, piece: slice) -> tuple[int, float] | None:
    """Cycle and time, s, from which on another body explains most."""
    samples = case.timing.of(case.log, case.vehicle)
    reference = first_reference(samples, piece, case.vehicle)
    at = None if reference is None else change.change_cycle(samples, piece, reference, case.vehicle)
    return None if at is None else (at, round(float(samples.executed.start_s[at]), 9))


def mass_change(screening: Screening, torque: Screening, segments: Segments, less_than: float = np.inf) -> Diagnosis | None:
    """Another body from some moment on; ``torque`` is the screening of one body under a torque.

    None if two bodies leave no less than ``less_than`` of excess chi-square.
    """
    log, piece = screening.case.whole or (screening.case.log, screening.piece)
    case, piece = busiest(screening.case._replace(log=log), piece, MOST_CYCLES)
    change_at = likeliest_change(case, piece)
    if change_at is None:
        return None
    at, time = change_at
    each = (screened(*busiest(case, part), screening.free.disturbances) for part in (slice(piece.start, at), slice(at, piece.stop)))
    sides = [side and relinearised(side) for side in each]
    if not all(side is not None and side.fits for side in sides):
        return None
    excess = sum(side.excess for side in sides if side is not None)
    if excess > MAIN_PART * torque.excess or excess >= less_than:
        return None  # the sides fit only because they are shorter, or something else explains as much
    kept = segments()
    if kept is not None and (len(kept.kept_s) > 1 or kept.command_significance < COMMANDED):
        return None  # a temporary disturbance, or uncommanded motion, gives no evidence of another body
    thrust, imu = _thrust_alternative(screening, sides), _imu_alternative(screening, sides)
    message = (
        f"the log fits if the mass properties change suddenly at {time:.6g} s, as by docking or release{thrust}{imu}; state [[phases]] "
        "that end and begin there (estimator.split_on_change = true does it): estimates across the change are not valid"
    ) + ("; [known] values then apply to neither part: state them under [[phases]]" if case.vehicle.known else "")
    correction = None if imu else Correction(("estimator.split_on_change=true",))
    return Diagnosis((Fault(Notice("mass-change", message), correction, time),))


def _thrust_alternative(screening: Screening, sides: Sequence[Screening | None]) -> str:
    """Text that all thrust may change instead, if all that answers it changes in one proportion."""
    kind = screening.case.vehicle.environment.kind
    answers = [5, MU] if kind == "planar" else [0, 3, 5] + [MU] * (kind == "free")
    before, after = (side.stated.value("theta")[answers] for side in sides if side is not None)
    ratios = after / before
    ratio = float(ratios.mean())
    if not screening.model.thrusting or np.ptp(ratios) > SLIGHT * ratio or abs(ratio - 1) < SLIGHT:
        return ""
    return f", or if all thrust is {ratio:.3g} of its former value from then on, as by another supply pressure"


def _imu_alternative(screening: Screening, sides: Sequence[Screening | None]) -> str:
    """Text that another IMU may record instead, if only the CG changes and no thrust determines it."""
    before, after = (side.stated.value("theta") for side in sides if side is not None)
    turned = np.abs(tensor(after[:6]) @ np.linalg.inv(tensor(before[:6])) - np.eye(3)).max()
    if screening.model.thrusting or screening.model.bearing is not None or turned > SLIGHT:
        return ""
    where = "only the CG changes, and no thrust shows where it is: then estimate each part with its own imu.position_m"
    return f", or if another IMU, at another position, records from then on ({where})"
