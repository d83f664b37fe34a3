"""Values of a log that does not fit, with sigmas that include why (:mod:`massprop_cli.estimate.discrepancy`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Conclusion, Estimate, concluded, tolerances
from massprop_cli.errorparameters.parameter import ErrorParameter
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import BY_NAME, FAMILY, TABLE
from massprop_cli.estimate.discrepancy import LEAST, MOST, ErrorFit, error_fit
from massprop_cli.estimate.history import History
from massprop_cli.estimate.quantities import alone, by_scale, in_common, quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.geometry import channel_changes
from massprop_cli.model.layout import MU
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider, of_motion, variant
from massprop_cli.prepare.actuators import channel_names, channel_wrench
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing

UNSPANNED, NOISE = "what no error parameter explains", "noise"
COMMON, STORED = "scale common to all thrust", "scale common to all stored momentum"
LONG = 30_000
"""Cycles beyond which parameters for which the log is read anew are left to the scatter of stretches: each reading holds a hundred bytes of
every cycle."""
CG = QUANTITIES.index("cg_x")
AGING = "mass_rate"
"""Of thrust that falls as of mass that grows: in a log they are the same."""
WORDS = {
    AGING: "change of all thrust over the log, or of mass and inertia the other way",
    "thrust": "thrust",
    "position": "place",
    "direction": "direction",
}
"""Of what one component is said otherwise than of all."""
UNITS = {"direction": "rad"}
"""Of what has another unit elsewhere."""


IMPULSE = ("thrust", "rise", "fall")
"""Error parameters by which a channel's impulse is another than stated."""
BEYOND = 2.0
"""Prior sigmas of one of these, where it stands out, beyond which what is stated is refuted: of a jet that gives less than 40 %, or takes
0.6 cycles more to open. Others may stand for what no error parameter is: real flights have biases and places of that size."""
TELLS = {
    "thrust": "a calibration of the thrust",
    "timing": "commands and IMU on one clock, or a stated delay and lag",
    "sensor": "a calibration of the IMU, and its filter stated",
    "mounting": "where and how the IMU is mounted, measured",
    "body": "a log in which nothing moves within the body",
    "environment": "a rest without commands, for what acts by itself",
    COMMON: "one calibrated jet, or a weighed vehicle ([known])",
    STORED: "the spin inertia of a wheel, measured, or a known inertia ([known])",
    NOISE: "a longer log, or stronger commands",
    UNSPANNED: "a second log of the same kind, to see what repeats",
}
"""Most informative next step, by what makes most of the sigmas."""


class PlainFits(NamedTuple):
    """Off-line fits of every phase with the noise that is stated, beside those with disturbances that were sized."""

    vehicle: Resolved
    references: tuple[Reference | None, ...]
    consider: Consider
    """What is stated to be uncertain."""
    left: float
    """Mean squared residual, over the noise."""


class ErrorColumn(NamedTuple):
    """One component of an error parameter."""

    name: str
    """In the table."""
    of: str
    """The axis or the channel, if it has several."""
    usual: float
    """One sigma of it in the vehicle file of a careful lab."""
    least: float = -np.inf
    """Least physical error, in this sigma."""

    def beyond(self, error: float) -> float:
        """Of an error in its usual sigma, so many prior ones."""
        return abs(error) * self.usual / BY_NAME[self.name].prior

    def said(self, error: float) -> str:
        """In words, of an error in its usual sigma."""
        one, own = BY_NAME[self.name], f" ({self.of})" if self.of else ""
        # a reading times a factor is one of a sensor that shows less
        size = error * self.usual * (-1.0 if one.by_columns and one.unit == "1" else 1.0)
        unit = UNITS.get(self.name, one.unit)
        return f"{WORDS.get(self.name, one.what)}{own}: {f'{100 * size:+.2g} %' if unit in ('1', 'parts') else f'{size:+.2g} {unit}'}"


@dataclass(frozen=True)
class Discrepancy:
    """Of one phase."""

    values: Array
    """(10,)"""
    covariance: Array
    """(10, 10)"""
    bare: tuple[Array, Array]
    """The same by the log alone."""
    scale: float
    """Common size of all error parameters as the log tells it, of their usual sigmas."""
    thrust_scale_sigma: float
    """Of the error common to all thrust, beyond what is stated; in ``covariance``, and not in ``bare``."""
    shares: Mapping[str, Array]
    """By family, and of noise and of what nothing explains: (10,) sigmas."""
    behaves_like: tuple[str, ...]
    """What the log tells by itself of single error parameters, in words: likely causes, and no proof of one."""

    farthest: float
    """The largest of these in the impulse of a channel, over what may physically be (its prior)."""

    @property
    def refuted(self) -> bool:
        """Whether errors would have to be far beyond any that a lab makes: all together, or one that stands out."""
        return self.scale > MOST or self.farthest > BEYOND

    def covering(self, others: Sequence[Array]) -> Discrepancy:
        """With the values (10,) that causes give which explain the log, and can't be told apart, within one sigma."""
        if not others:
            return self
        away = np.nan_to_num(np.abs(np.array(others) - self.values)).max(0)
        shares = {**self.shares, UNSPANNED: np.hypot(self.shares[UNSPANNED], away)}
        bare = self.bare[0], self.bare[1] + np.diag(away**2)
        return replace(self, covariance=self.covariance + np.diag(away**2), bare=bare, shares=shares)

    def tells(self, which: Sequence[int]) -> str:
        """The one check or experiment that would tell most of these quantities."""
        mains = [self.main(i) for i in which]
        return TELLS[max(dict.fromkeys(mains), key=mains.count)] if mains else TELLS[NOISE]

    def main(self, i: int) -> str:
        """What makes most of a quantity's sigma."""
        return max(self.shares, key=lambda name: float(self.shares[name][i]))


def discrepancy(samples: Stream, timing: Timing, used: Resolved, settled: History, plain: PlainFits, i: int) -> Discrepancy | None:
    """Of phase number ``i``; None where there is no fit, or nothing finite."""
    supposed, units, columns = _columns(Setup(samples.log, used, timing), samples, float(settled.natural_sizes[CG]))
    fitted = partial(_fitted, samples, settled, plain.consider.about(supposed), units, np.array([one.least for one in columns]))
    fit = fitted(used, settled.reference)
    if fit is None:
        return None
    if any(getattr(plain.vehicle, part) != getattr(used, part) for part in ("imu", "environment", "estimator")):  # by what was sized
        free = fitted(plain.vehicle, plain.references[i])
        fit = fit if free is None else fit.widened(free)
    vehicle = used.in_phase(settled.phase)
    # an error common to all that turns the body leaves no trace; it is as likely as one of each. Wheels tell it of thrust
    alone_spinning = bool(vehicle.spinning) and not samples.log.command.any()
    common = 0.0 if vehicle.spinning else BY_NAME["thrust"].usual * max(fit.scale, LEAST)
    spun = BY_NAME["spin_inertia"].usual * max(fit.scale, LEAST) if alone_spinning and not vehicle.knows_inertia else 0.0
    thrust = vehicle.thrust.model_copy(update={"scale_sigma": float(np.hypot(vehicle.thrust.scale_sigma, common))})
    linear = np.maximum(np.diag(fit.covariance) - fit.scatter, 0.0)[MOMENTS]
    row = Parameters(fit.mean[None], fit.covariance[None], np.sqrt(linear)[None] / fit.mean[MOMENTS])
    (values, full), bare = quantities(row, vehicle.model_copy(update={"thrust": thrust})), quantities(row, alone(vehicle))
    scaled = by_scale(values[0], vehicle)
    full[0] += spun**2 * np.outer(scaled, scaled)
    shares = _shares(fit, columns) | {STORED if spun else COMMON: (common + spun) * np.abs(scaled)}
    said = tuple(columns[at].said(float(fit.errors[at])) for at in fit.freed)
    farthest = max((columns[at].beyond(float(fit.errors[at])) for at in fit.freed if columns[at].name in IMPULSE), default=0.0)
    return Discrepancy(values[0], full[0], (bare[0][0], bare[1][0]), fit.scale, common, shares, said, farthest)


def _fitted(
    samples: Stream, settled: History, consider: Consider, units: Array, least: Array, vehicle: Resolved, reference: Reference | None
) -> ErrorFit | None:
    """Beside all error parameters, with the noise and the disturbances of ``vehicle``; None where nothing finite comes of it."""
    if reference is None:
        return None
    with np.errstate(all="ignore"):
        try:
            found = error_fit(samples, settled.cycles, reference, vehicle.in_phase(settled.phase), consider, units, least)
        except np.linalg.LinAlgError:
            return None
    finite = np.isfinite(found.mean).all() and np.isfinite(found.covariance).all() and found.mean[MU] > 0
    return found if finite else None


def _shares(found: ErrorFit, columns: Sequence[ErrorColumn]) -> dict[str, Array]:
    """Of each family of error parameters, of noise and of the rest: (10,) sigmas of the ten quantities that it makes by itself."""
    variances, families = {NOISE: found.by_noise, UNSPANNED: found.scatter}, [FAMILY[one.name] for one in columns]
    for family in dict.fromkeys(families):
        own = np.flatnonzero([one == family for one in families])
        variances[family] = np.einsum("ie,ef,if->i", found.effects[:, own], found.error_covariance[np.ix_(own, own)], found.effects[:, own])
    slope = np.ones(10)
    slope[MU] = found.mean[MU] ** -2
    return {name: slope * np.sqrt(np.maximum(variance, 0.0)) for name, variance in variances.items()}


def _columns(setup: Setup, samples: Stream, size_m: float) -> tuple[Consider, Array, tuple[ErrorColumn, ...]]:
    """All error parameters that a log and its vehicle, so large, may have; but for what the estimator has as an unknown anyhow.

    With (e,) what one usual sigma is in each column's unit.
    """
    variants, columns = [], list[ErrorColumn]()
    for one in TABLE:
        unknown = one.estimated and one.sigma(setup.vehicle) > 0
        elsewhere = one.environments and setup.vehicle.environment.kind not in one.environments
        anew = one.shown is None and one.redone != "body"
        if one.usual == 0 or one.per_channel or unknown or elsewhere or (anew and setup.log.cycles > LONG):
            continue
        if one.shown is None and one.apply(setup, np.zeros(one.size)) is None:
            continue  # it has no part in this vehicle
        for axis in range(one.size):
            changed = variant(one, setup, samples, axis)
            if changed is not None:
                variants.append(of_motion(changed, one, setup.vehicle, axis))
                usual = _usual(one, size_m)
                columns.append(ErrorColumn(one.name, "XYZ"[axis] if one.size > 1 else "", usual, one.least(setup) / usual))
    sigmas = {name: _usual(one, size_m) for name, one in BY_NAME.items() if one.per_channel}
    jets = setup.vehicle.jets if setup.log.command_kind == "jets" else ()
    pushes = channel_changes(jets, channel_wrench(setup.log, setup.vehicle), sigmas)
    named = channel_names(setup.log, setup.vehicle)
    units = np.array([*(one.usual for one in columns), *np.ones(len(pushes.channels)), BY_NAME[AGING].usual])
    columns += [ErrorColumn(kind, named[channel], sigmas[kind]) for kind, channel in zip(pushes.kinds, pushes.channels, strict=True)]
    columns.append(ErrorColumn(AGING, "", BY_NAME[AGING].usual))
    return Consider(tuple(variants), pushes=pushes, aging=True), units, tuple(columns)


def _usual(one: ErrorParameter, size_m: float) -> float:
    return one.usual * (size_m if one.unit == "m" else 1.0)


def with_touched(conclusion: Conclusion, told: Discrepancy, which: BoolArray, history: History, vehicle: Vehicle) -> Conclusion:
    """The conclusion with these values of ``which`` (10,) quantities, and the verdicts that it had: as a named fault leaves them."""
    both, neither = which[:, None] & which, ~which[:, None] & ~which
    known = np.array([one.value is not None for one in conclusion.estimates.values()])
    covariance = np.where(both, told.covariance, np.where(neither, conclusion.covariance, 0.0))
    values = np.where(which, told.values, conclusion.values)
    sigmas = np.sqrt(np.diag(covariance))
    given, which = which & known & (sigmas < history.natural_sizes), which & known
    estimates = {
        name: replace(one, value=float(values[i]) if given[i] else None, sigma=float(sigmas[i]) if given[i] else None) if which[i] else one
        for i, (name, one) in enumerate(conclusion.estimates.items())
    }
    return concluded(estimates, values, covariance, conclusion.bare, history, vehicle)


def with_discrepancy(conclusion: Conclusion, told: Discrepancy, history: History, vehicle: Vehicle) -> Conclusion:
    """The conclusion with these values; called converged where it was, and the whole sigma is within the tolerance."""
    known: dict[str, float] = {name: one.sigma for name, one in vehicle.known.items()}
    shared = in_common(by_scale(told.values, vehicle), told.covariance, known, vehicle)
    # what is stated of the thrust, or known, is as uncertain as it is stated to be, whatever the tolerance
    within = np.diag(told.covariance) - np.nan_to_num(shared) ** 2 <= tolerances(history, vehicle) ** 2
    estimates = {name: _estimate(conclusion.estimates[name], told, i, bool(within[i]), history) for i, name in enumerate(QUANTITIES)}
    found = concluded(estimates, told.values, told.covariance, told.bare, history, vehicle)
    return replace(found, thrust_scale_sigma=told.thrust_scale_sigma)


def _estimate(one: Estimate, found: Discrepancy, i: int, within: bool, history: History) -> Estimate:
    if one.verdict == "unobservable":
        return one
    value, sigma, size = float(found.values[i]), float(np.sqrt(found.covariance[i, i])), float(history.natural_sizes[i])
    told = bool(np.isfinite(value) and sigma < size)
    if one.verdict == "converged":
        kept = told and within
        reason = Reason.of("within-discrepancy" if kept else "discrepancy", percent=100 * sigma / size, main=found.main(i))
        one = replace(one, verdict="converged" if kept else "not_converged", reason=reason, final_at_s=one.final_at_s if kept else None)
    return replace(one, value=value if told else None, sigma=sigma if told else None)
