"""Final values and verdicts: the sustained-convergence rule, gated on information actually gained. Doesn't touch the filter."""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Literal

import numpy as np

from massprop_cli import CG, INERTIA, QUANTITIES, UNITS
from massprop_cli.base import spill
from massprop_cli.base.arrays import Array, BoolArray, runs
from massprop_cli.base.dataclass import dataclass
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
    "cg_x": "force across X (along Y or Z), or fast turns about Y or Z",
    "cg_y": "force across Y (along X or Z), or fast turns about X or Z",
    "cg_z": "force across Z (along X or Y), or fast turns about X or Y",
    "mass": "force, pushed one way and the other",
    "moment_x": "time under gravity, at some tilts about Y and Z",
    "moment_y": "time under gravity, at some tilts about X and Z",
    "moment_z": "tilts about X and about Y",
}
"""The motion that informs each quantity, body axes."""
PLANAR = ("izz", "cg_x", "cg_y", "mass")
"""What the motion on a table depends on."""
Verdict = Literal["converged", "not_converged", "not_excited", "contradicted", "unobservable"]
PRIOR = 0.5
"""Prior sigma of the default method over the natural size: that much is known of any body of this size before the log. A moment of
inertia and the mass are positive, so their own value stands in for the natural size where it is smaller."""
POSITIVE = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz", "mass")]
HALVED = 0.5
"""A quantity is informed once its sigma is below this part of the prior's."""
RELATIVE_TOLERANCE = 0.01
SURE = 0.1
"""A sigma below this part of the tolerance makes up for steady updates that are missing, ..."""
BEGUN = 0.25
"""... but for this part of their number."""
FEW = 4.0
"""Sigmas of its own within which a value must stay of where it ends, to be called final."""
THESIS_TOLERANCE = {"inertia": 0.05, "cg": 0.05, "mass": 0.1}


@dataclass(frozen=True)
class Estimate:
    """One quantity's final value; ``None`` where nothing can be said."""

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
    """(10, 10), NaN where nothing can be said."""
    rotating_mass: float
    """kg; the mass whose CG and inertia these are (without the bearing's)."""
    bare: tuple[Array, Array]
    """(10,) values and (10, 10) covariance by the log alone: nothing known from elsewhere, thrust taken as exact. NaN as above."""
    pivot: tuple[Array, Array] | None = None
    """(9,) and (9, 9) inertia and first moment about a pivot or bearing, and their covariance; None without one."""
    about_pivot: Mapping[str, Estimate] = field(default_factory=dict)
    """The nine of :data:`massprop_cli.estimate.pivot.ABOUT_PIVOT`; empty without a pivot or bearing."""
    thrust_scale_sigma: float = 0.0
    """Relative, of an error common to all thrust: what ``covariance`` has of it beyond what is stated."""
    causes: tuple[Reason, ...] = ()
    """Why log and vehicle file contradict each other; empty where they don't."""

    @property
    def contradiction(self) -> str:
        """The causes in words."""
        return "; ".join(map(str, self.causes))

    @property
    def values(self) -> Array:
        """(10,) with NaN for what is not known."""
        return np.array([np.nan if e.value is None else e.value for e in self.estimates.values()])

    @property
    def sigmas(self) -> Array:
        """(10,) likewise."""
        return np.array([np.nan if e.sigma is None else e.sigma for e in self.estimates.values()])

    @property
    def inertia(self) -> Array:
        """(3, 3) about the CG, kg m²; NaN where not known."""
        return tensor(self.values[:6])

    @property
    def inertia_about_origin(self) -> Array:
        """(3, 3) about O, kg m²."""
        return self.inertia + parallel_axis(self.rotating_mass, self.values[6:9])

    @property
    def principal_moments(self) -> Array:
        """(3,) ascending, kg m²; NaN unless the whole inertia is informed."""
        told = all(self.estimates[name].verdict in ("converged", "not_converged") for name in INERTIA)
        return np.asarray(np.linalg.eigvalsh(self.inertia) if told and np.isfinite(self.inertia).all() else np.full(3, np.nan))


def conclude(history: History, vehicle: Vehicle) -> Conclusion:
    """Decide each quantity's value and verdict.

    By the default method the values at the phase's end; the rule decides the verdict. By the thesis's method the latched value, taken
    when the count is reached and anew each time it is reached again after a larger change (thesis, chapter 4).
    """
    thesis = vehicle.estimator.method == "thesis"
    limits, count = tolerances(history, vehicle), vehicle.convergence.count
    steady, informed = _steady(history, vehicle, limits)
    stretches = [_stretches(steady[:, i], count) for i in range(10)]
    estimates = {}
    for i, name in enumerate(QUANTITIES):
        latched = stretches[i][-1] if stretches[i] else None
        row = latched[1] if thesis and latched else len(history.time_s) - 1
        lasting = int(np.argmin(steady[::-1, i])) if not steady[:, i].all() else len(steady)
        estimates[name] = _estimate(history, i, row, latched, (lasting, count), bool(informed[i]), thesis, limits[i])
        if vehicle.environment.kind == "planar" and name not in PLANAR:
            estimates[name] = replace(estimates[name], reason=Reason("no-part"))
    if vehicle.on_air_bearing and not thesis and estimates["mass"].value is None:
        estimates |= {name: replace(estimates[name], reason=Reason("unweighed")) for name in CG if estimates[name].value is None}
    found = concluded(estimates, history.values[-1], history.covariance, history.bare, history, vehicle)
    if not thesis:
        return found
    covariance = found.covariance * np.outer(found.sigmas, found.sigmas) / np.outer(history.sigmas[-1], history.sigmas[-1])
    return replace(found, covariance=covariance, bare=(found.values, covariance))


def concluded(
    estimates: dict[str, Estimate], values: Array, covariance: Array, bare: tuple[Array, Array], history: History, vehicle: Vehicle
) -> Conclusion:
    """The conclusion with these estimates, of what was found: ``values`` (10,), (10, 10), and the same by the log alone, ``bare``."""
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
    """(9,) and (9, 9) of ten values (10,), (10, 10); None where nothing pivots."""
    if not vehicle.pivoted:
        return None
    values = values - np.append(np.zeros(9), vehicle.bearing_mass_kg)  # of what turns
    at, mass = np.array(vehicle.environment.bearing_position_m), np.nan if history.reference is None else 1 / history.reference.mu
    return about_pivot(values, covariance, at, np.array(mass))


def contradicted(conclusion: Conclusion, causes: tuple[Reason, ...], touched: BoolArray) -> Conclusion:
    """The conclusion with the quantities ``touched`` (10,) contradicted: values and sigmas stand as found, and don't hold."""
    conclusion = replace(conclusion, causes=causes)
    reason = Reason.of("contradiction", cause=conclusion.contradiction)
    estimates = {
        name: replace(e, verdict="contradicted", final_at_s=None, reason=reason) if hit and e.verdict != "unobservable" else e
        for (name, e), hit in zip(conclusion.estimates.items(), touched, strict=True)
    }
    return replace(conclusion, estimates=estimates)


def in_doubt(conclusion: Conclusion, reasons: Mapping[str, Reason]) -> Conclusion:
    """The conclusion without calling converged what there are reasons not to."""
    hanging = {name: reason for name, reason in reasons.items() if conclusion.estimates[name].verdict == "converged"}
    changed = {
        name: replace(conclusion.estimates[name], verdict="not_converged", final_at_s=None, reason=reason)
        for name, reason in hanging.items()
    }
    return replace(conclusion, estimates=conclusion.estimates | changed)


def _settled(history: History, i: int, first: int, tolerance: float) -> float:
    """The time from ``first`` on after which the value stayed near where it ended: within its tolerance and a few of its own sigmas."""
    stays = first
    for part in spill.parts(len(history.values), first):
        away = np.abs(history.values[part, i] - history.values[-1, i])
        strayed = np.flatnonzero((away > tolerance) | (away > FEW * history.sigmas[part, i]))
        stays = part.start + int(strayed[-1]) + 1 if strayed.size else stays
    return float(history.time_s[stays])


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
    value, sigma = float(history.values[row, i]), float(history.sigmas[row, i])
    share = float(history.information_share[i, history.drowned].sum())
    told = bool(np.isfinite(value) and np.isfinite(sigma) and (thesis or sigma < history.natural_sizes[i]))
    lasts = latched is not None and (thesis or latched[2] == len(history.time_s) - 1)
    verdict: Verdict
    if not history.observable[i]:
        verdict, told = "unobservable", False
        reason = _unobservable(history, i)
    elif not np.isfinite(value) and (stood := np.isfinite(history.values[:, i])).any():
        verdict, until = "not_converged", history.time_s[len(stood) - 1 - int(np.argmax(stood[::-1]))]
        reason = Reason.of("estimate-ended", until_s=float(until))
    elif not informed:
        verdict, reason = "not_excited", Reason.of("hardly-informed", wants=WANTED[QUANTITIES[i]])
    elif share > 0.5:
        verdict, reason = "not_excited", Reason.of("drowned", share=share)
    elif not lasts and not thesis and sigma < SURE * tolerance and steady[0] >= BEGUN * steady[1]:
        verdict, reason = "converged", Reason.of("precise", steady=steady[0], count=steady[1])
        latched = len(history.time_s) - steady[0], 0, 0
    elif not lasts:
        verdict, reason = "not_converged", Reason.of("unsteady", steady=steady[0], count=steady[1])
    else:
        verdict, reason = "converged", Reason("steady")
    final_at = None
    if verdict == "converged" and latched:
        final_at = float(history.time_s[latched[0]]) if thesis else _settled(history, i, latched[0], tolerance)
    return Estimate(value if told else None, sigma if told else None, UNITS[QUANTITIES[i]], verdict, final_at, reason)


def _unobservable(history: History, i: int) -> Reason:
    """Why no motion informs a quantity: for want of a sensor, or of commands."""
    if not history.unsensed[i]:
        return Reason.of("no-motion-informs", wants=WANTED[QUANTITIES[i]])
    gone = [axis for axis, unread in zip("XYZ", history.unread[3:], strict=True) if unread]
    absent = "accelerometer" if len(gone) == 3 else f"accelerometer along body {' and '.join(gone)}"
    return Reason.of("sensor-absent-mass" if QUANTITIES[i] == "mass" else "sensor-absent", absent=absent)


def _steady(history: History, vehicle: Vehicle, limits: Array) -> tuple[BoolArray, BoolArray]:
    """(K, 10) whether each quantity was informed and moved by less than its limit; (10,) whether it is informed in the end."""
    steady, before = np.empty(history.values.shape, dtype=bool), np.full((1, 10), np.nan)
    for part in spill.parts(len(steady)):
        values = history.values[part]
        informed = _informed(values, history.sigmas[part], history.natural_sizes, vehicle)
        steady[part] = (np.abs(np.diff(values, axis=0, prepend=before)) <= limits) & informed
        before = values[-1:].copy()
    return steady, informed[-1]


def _informed(values: Array, sigmas: Array, natural_sizes: Array, vehicle: Vehicle) -> BoolArray:
    """(K, 10) whether the sigma is below half the prior's: the body's own size, and for the thesis's filters their P0 as well."""
    sizes = np.tile(natural_sizes, (len(values), 1))
    sizes[:, POSITIVE] = np.minimum(sizes[:, POSITIVE], values[:, POSITIVE])
    prior = PRIOR * sizes
    if vehicle.estimator.method == "thesis":
        settings = vehicle.estimator.thesis
        prior = np.minimum(prior, np.sqrt(np.array([*settings.p1, settings.p2])))
    return np.asarray(sigmas < HALVED * prior)


def tolerances(history: History, vehicle: Vehicle) -> Array:
    """(10,) the largest step-to-step change that counts as standing still, in each quantity's unit."""
    settings = vehicle.convergence
    thesis = vehicle.estimator.method == "thesis"
    relative = settings.relative if settings.relative is not None else not thesis
    found = np.empty(10)
    for i, name in enumerate(QUANTITIES):
        kind = "inertia" if name in INERTIA else "cg" if name in CG else "mass"
        given = getattr(settings, f"{kind}_tolerance")
        found[i] = allowed(kind, given, relative) * (history.natural_sizes[i] if relative else 1.0)
    return found


def allowed(kind: str, given: float | None, relative: bool) -> float:
    """The tolerance of "inertia", "cg" or "mass": as ``given``, else a part of the natural size, or the thesis's in the unit."""
    fallback = RELATIVE_TOLERANCE if relative else THESIS_TOLERANCE[kind]
    return fallback if given is None else given


def _stretches(steady: BoolArray, count: int) -> list[tuple[int, int, int]]:
    """Runs of at least ``count`` steady updates: first row, the row at which the count was reached, last row."""
    return [(begin, begin + count - 1, end - 1) for begin, end in runs(steady).tolist() if end - begin >= count]
