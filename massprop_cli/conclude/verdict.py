"""Final values and verdicts by the sustained-convergence rule (thesis, chapter 4), for quantities that the log informs."""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Literal

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES, UNITS
from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, runs
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CONTRADICTION
from massprop_cli.base.rigidbody import parallel_axis, tensor
from massprop_cli.conclude.reason import Reason
from massprop_cli.estimate.history import History
from massprop_cli.estimate.pivot import about_pivot
from massprop_cli.inputs.vehicle import Phase, Vehicle

WANTED = {
    "ixx": "torque about X",
    "ixy": "torque about X and about Y",
    "ixz": "torque about X and about Z",
    "iyy": "torque about Y",
    "iyz": "torque about Y and about Z",
    "izz": "torque about Z",
    "cg_x": "force across X (along Y or Z), or fast rotation about Y or Z",
    "cg_y": "force across Y (along X or Z), or fast rotation about X or Z",
    "cg_z": "force across Z (along X or Y), or fast rotation about X or Y",
    "mass": "force in both directions",
    "moment_x": "time under gravity, at several tilts about Y and Z",
    "moment_y": "time under gravity, at several tilts about X and Z",
    "moment_z": "tilts about X and about Y",
}
"""The motion that informs each quantity, body axes."""
PLANAR = ("izz", "cg_x", "cg_y", "mass")
"""Quantities that affect the motion on a table."""
Verdict = Literal["converged", "not_converged", "not_excited", "contradicted", "unobservable"]
PRIOR = 0.5
"""Prior sigma of the default method over the natural size. For moments of inertia and mass, which are positive, the value replaces the
natural size if it is smaller."""
POSITIVE = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz", "mass")]
HALVED = 0.5
"""Largest sigma of an informed quantity, as a part of the prior sigma."""
RELATIVE_TOLERANCE = 0.01
"""Default tolerance as a part of the natural size."""
PRECISE = 0.1
"""Largest sigma, as a part of the tolerance, of a quantity that converges without the full number of steady updates, ..."""
LEAST_STEADY = 0.25
"""... and the part of that number that it needs."""
THESIS_TOLERANCE = {"inertia": 0.05, "cg": 0.05, "mass": 0.1}
"""Tolerances of the thesis, kg m², m, kg."""


@dataclass(frozen=True)
class Estimate:
    """Final value of one quantity; value and sigma are ``None`` if it has no estimate."""

    value: float | None
    sigma: float | None
    unit: str
    verdict: Verdict
    final_at_s: float | None
    reason: Reason


@dataclass(frozen=True)
class Conclusion:
    """The ten quantities of one phase."""

    phase: Phase
    estimates: dict[str, Estimate]
    covariance: Array
    """(10, 10), NaN without an estimate."""
    rotating_mass: float
    """Mass that CG and inertia refer to, without the bearing's, kg."""
    bare: tuple[Array, Array]
    """(10,) and (10, 10) values and covariance from the log alone, without known values and with exact thrust; NaN without an estimate."""
    pivot: tuple[Array, Array] | None = None
    """(9,) and (9, 9) inertia and first moment about a pivot or bearing, and their covariance; None without one."""
    about_pivot: Mapping[str, Estimate] = field(default_factory=dict)
    """Estimates of :data:`massprop_cli.ABOUT_PIVOT`; empty without a pivot or bearing."""
    thrust_scale_sigma: float = 0.0
    """Relative sigma of the common thrust scale in ``covariance``, beyond the stated one."""
    causes: tuple[Reason, ...] = ()
    """Contradictions between log and vehicle file."""

    @property
    def contradiction(self) -> str:
        """The causes in words."""
        return "; ".join(map(str, self.causes))

    @property
    def values(self) -> Array:
        """(10,) values; NaN without an estimate."""
        return np.array([np.nan if e.value is None else e.value for e in self.estimates.values()])

    @property
    def sigmas(self) -> Array:
        """(10,) sigmas; NaN without an estimate."""
        return np.array([np.nan if e.sigma is None else e.sigma for e in self.estimates.values()])

    @property
    def inertia(self) -> Array:
        """(3, 3) inertia about the CG, kg m²; NaN without an estimate."""
        return tensor(self.values[:6])

    @property
    def inertia_about_origin(self) -> Array:
        """(3, 3) inertia about O, kg m²."""
        return self.inertia + parallel_axis(self.rotating_mass, self.values[6:9])

    @property
    def principal_moments(self) -> Array:
        """(3,) principal moments, ascending, kg m²; NaN unless the whole inertia is informed."""
        informed = all(self.estimates[name].verdict in ("converged", "not_converged") for name in INERTIA)
        return np.asarray(np.linalg.eigvalsh(self.inertia) if informed and np.isfinite(self.inertia).all() else np.full(3, np.nan))


def conclude(history: History, vehicle: Vehicle) -> Conclusion:
    """Values and verdicts of a phase.

    The default method takes the values at the end of the phase. The thesis's method takes the value at which the number of steady updates
    was last reached (thesis, chapter 4).
    """
    thesis = vehicle.estimator.method == "thesis"
    limits, count = tolerances(history, vehicle), vehicle.convergence.count
    steady, informed = _steady(history, vehicle, limits)
    steady_runs = [_steady_runs(steady[:, i], count) for i in range(10)]
    estimates = {}
    for i, name in enumerate(QUANTITIES):
        latched = steady_runs[i][-1] if steady_runs[i] else None
        row = latched[1] if thesis and latched else len(history.time_s) - 1
        last_steady = int(np.argmin(steady[::-1, i])) if not steady[:, i].all() else len(steady)
        estimates[name] = _estimate(history, i, row, latched, (last_steady, count), bool(informed[i]), thesis, limits[i])
        if vehicle.environment.kind == "planar" and name not in PLANAR:
            estimates[name] = replace(estimates[name], reason=Reason("no-part"))
    if vehicle.on_air_bearing and not thesis and estimates["mass"].value is None:
        estimates |= {name: replace(estimates[name], reason=Reason("unweighed")) for name in CG if estimates[name].value is None}
    conclusion = assembled(estimates, history.values[-1], history.covariance, history.bare, history, vehicle)
    if not thesis:
        return conclusion
    sigmas = conclusion.sigmas
    covariance = conclusion.covariance * np.outer(sigmas, sigmas) / np.outer(history.sigmas[-1], history.sigmas[-1])
    return replace(conclusion, covariance=covariance, bare=(conclusion.values, covariance))


def assembled(
    estimates: dict[str, Estimate], values: Array, covariance: Array, bare: tuple[Array, Array], history: History, vehicle: Vehicle
) -> Conclusion:
    """Conclusion with these estimates, from ``values`` (10,) with ``covariance`` (10, 10), and both from the log alone (``bare``)."""
    given = np.array([one.value is not None for one in estimates.values()])
    both, mass = given[:, None] & given, estimates["mass"].value
    return Conclusion(
        history.phase,
        estimates,
        covariance=np.where(both, covariance, np.nan),
        rotating_mass=np.nan if mass is None else mass - vehicle.bearing_mass_kg,
        bare=(np.where(given, bare[0], np.nan), np.where(both, bare[1], np.nan)),
        pivot=_about_its_pivot(values, covariance, history, vehicle),
    )


def _about_its_pivot(values: Array, covariance: Array, history: History, vehicle: Vehicle) -> tuple[Array, Array] | None:
    """(9,) and (9, 9) inertia and first moment about the pivot, from the ten values and their covariance; None without a pivot."""
    if not vehicle.pivoted:
        return None
    values = values - np.append(np.zeros(9), vehicle.bearing_mass_kg)  # only this mass rotates
    at, mass = np.array(vehicle.environment.bearing_position_m), np.nan if history.reference is None else 1 / history.reference.mu
    return about_pivot(values, covariance, at, np.array(mass))


def contradicted(conclusion: Conclusion, causes: tuple[Reason, ...], affected: BoolArray) -> Conclusion:
    """The conclusion with the verdict "contradicted" of the quantities ``affected`` (10,); values and sigmas stay."""
    conclusion = replace(conclusion, causes=causes)
    reason = Reason.of("contradiction", cause=conclusion.contradiction)
    estimates = {
        name: replace(e, verdict="contradicted", final_at_s=None, reason=reason) if hit and e.verdict != "unobservable" else e
        for (name, e), hit in zip(conclusion.estimates.items(), affected, strict=True)
    }
    return replace(conclusion, estimates=estimates)


def in_doubt(conclusion: Conclusion, reasons: Mapping[str, Reason]) -> Conclusion:
    """The conclusion with "not_converged" for every converged quantity that has a reason against it."""
    demoted = {
        name: replace(conclusion.estimates[name], verdict="not_converged", final_at_s=None, reason=reason)
        for name, reason in reasons.items()
        if conclusion.estimates[name].verdict == "converged"
    }
    return replace(conclusion, estimates=conclusion.estimates | demoted)


def _final_time(history: History, i: int, first: int, tolerance: float) -> float:
    """Time, s, from row ``first`` on, after which the value stays within its tolerance and :data:`CONTRADICTION` of the last value."""
    row = first
    for part in spill.parts(len(history.values), first):
        distance = np.abs(history.values[part, i] - history.values[-1, i])
        outside = np.flatnonzero((distance > tolerance) | (distance > CONTRADICTION * history.sigmas[part, i]))
        row = part.start + int(outside[-1]) + 1 if outside.size else row
    return float(history.time_s[row])


def _estimate(
    history: History,
    i: int,
    row: int,
    latched: tuple[int, int, int] | None,
    steady: tuple[int, int],
    informed: bool,
    thesis: bool,
    tolerance: float,
) -> Estimate:
    """Estimate of quantity ``i`` with the value of ``row``.

    ``latched``: last run of steady updates, as by :func:`_steady_runs`. ``steady``: number of steady updates at the end, and the required
    one.
    """
    value, sigma = float(history.values[row, i]), float(history.sigmas[row, i])
    share = float(history.information_share[i, history.drowned].sum())
    reported = bool(np.isfinite(value) and np.isfinite(sigma) and (thesis or sigma < history.natural_sizes[i]))
    is_steady = latched is not None and (thesis or latched[2] == len(history.time_s) - 1)
    verdict: Verdict
    if not history.observable[i]:
        verdict, reported = "unobservable", False
        reason = _unobservable(history, i)
    elif not np.isfinite(value) and (finite := np.isfinite(history.values[:, i])).any():
        verdict, until = "not_converged", history.time_s[len(finite) - 1 - int(np.argmax(finite[::-1]))]
        reason = Reason.of("estimate-ended", until_s=float(until))
    elif not informed:
        verdict, reason = "not_excited", Reason.of("hardly-informed", wants=WANTED[QUANTITIES[i]])
    elif share > 0.5:
        verdict, reason = "not_excited", Reason.of("drowned", share=share)
    elif not is_steady and not thesis and sigma < PRECISE * tolerance and steady[0] >= LEAST_STEADY * steady[1]:
        verdict, reason = "converged", Reason.of("precise", steady=steady[0], count=steady[1])
        latched = len(history.time_s) - steady[0], 0, 0
    elif not is_steady:
        verdict, reason = "not_converged", Reason.of("unsteady", steady=steady[0], count=steady[1])
    else:
        verdict, reason = "converged", Reason("steady")
    final_at = None
    if verdict == "converged" and latched:
        final_at = float(history.time_s[latched[0]]) if thesis else _final_time(history, i, latched[0], tolerance)
    return Estimate(value if reported else None, sigma if reported else None, UNITS[QUANTITIES[i]], verdict, final_at, reason)


def _unobservable(history: History, i: int) -> Reason:
    """Reason why no motion informs a quantity: an absent sensor, or the commands."""
    if not history.unsensed[i]:
        return Reason.of("no-motion-informs", wants=WANTED[QUANTITIES[i]])
    axes = [axis for axis, unread in zip("XYZ", history.unread[3:], strict=True) if unread]
    absent = "accelerometer" if len(axes) == 3 else f"accelerometer along body {' and '.join(axes)}"
    return Reason.of("sensor-absent-mass" if QUANTITIES[i] == "mass" else "sensor-absent", absent=absent)


def _steady(history: History, vehicle: Vehicle, limits: Array) -> tuple[BoolArray, BoolArray]:
    """(K, 10) whether each quantity is informed and its step is within the limit; (10,) whether it is informed in the last cycle."""
    steady, before = np.empty(history.values.shape, dtype=bool), np.full((1, 10), np.nan)
    for part in spill.parts(len(steady)):
        values = history.values[part]
        informed = _informed(values, history.sigmas[part], history.natural_sizes, vehicle)
        steady[part] = (np.abs(np.diff(values, axis=0, prepend=before)) <= limits) & informed
        before = values[-1:].copy()
    return steady, informed[-1]


def _informed(values: Array, sigmas: Array, natural_sizes: Array, vehicle: Vehicle) -> BoolArray:
    """(K, 10) whether the sigma is below half the prior sigma; the thesis's filters also have the prior P0."""
    sizes = np.tile(natural_sizes, (len(values), 1))
    sizes[:, POSITIVE] = np.minimum(sizes[:, POSITIVE], values[:, POSITIVE])
    prior = PRIOR * sizes
    if vehicle.estimator.method == "thesis":
        settings = vehicle.estimator.thesis
        prior = np.minimum(prior, np.sqrt(np.array([*settings.p1, settings.p2])))
    return np.asarray(sigmas < HALVED * prior)


def tolerances(history: History, vehicle: Vehicle) -> Array:
    """(10,) largest change from step to step of a steady quantity, in its unit."""
    settings = vehicle.convergence
    thesis = vehicle.estimator.method == "thesis"
    relative = settings.relative if settings.relative is not None else not thesis
    limits = np.empty(10)
    for i, name in enumerate(QUANTITIES):
        kind = "inertia" if name in INERTIA else "cg" if name in CG else "mass"
        stated = getattr(settings, f"{kind}_tolerance")
        limits[i] = tolerance_of(kind, stated, relative) * (history.natural_sizes[i] if relative else 1.0)
    return limits


def tolerance_of(kind: str, stated: float | None, relative: bool) -> float:
    """Tolerance of "inertia", "cg" or "mass": the ``stated`` one or the default; ``relative`` to the natural size, or in its unit."""
    default = RELATIVE_TOLERANCE if relative else THESIS_TOLERANCE[kind]
    return default if stated is None else stated


def _steady_runs(steady: BoolArray, count: int) -> list[tuple[int, int, int]]:
    """Runs of at least ``count`` steady updates: first row, row at which the count is reached, last row."""
    return [(begin, begin + count - 1, end - 1) for begin, end in runs(steady).tolist() if end - begin >= count]
