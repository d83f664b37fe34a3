"""Conclusions with model discrepancy: estimates of a log that its model does not explain (:mod:`massprop_cli.estimate.discrepancy`)."""

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
from massprop_cli.conclude.verdict import Conclusion, Estimate, assembled, tolerances
from massprop_cli.diagnosis.refit import MOST_CYCLES
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
CG = QUANTITIES.index("cg_x")
AGING = "mass_rate"
"""Error parameter of falling thrust; the effect of a growing mass is the same."""
WORDS = {
    AGING: "change of all thrust over the log, or of mass and inertia with the opposite sign",
    "thrust": "thrust",
    "position": "position",
    "direction": "direction",
}
"""Names of error parameters of one component, if they differ from the names in the table."""
UNITS = {"direction": "rad"}
"""Units of error parameters of one component, if they differ from those in the table."""


IMPULSE = ("thrust", "rise", "fall")
"""Error parameters that change the impulse of a channel."""
BEYOND = 2.0
"""Largest error of one of these, in prior sigmas: a jet with less than 40 % of its thrust, or 0.6 cycles late. Larger errors refute the
vehicle file. Other error parameters may represent unmodelled effects: real flights have biases and lever arms of that size."""
NEXT_STEPS = {
    "thrust": "calibrate the thrust",
    "timing": "log commands and IMU with one clock, or state delay and lag",
    "sensor": "calibrate the IMU and state its filters",
    "mounting": "measure the position and mounting of the IMU",
    "body": "record a log in which nothing moves inside the body",
    "environment": "record a rest without commands, which shows external torques",
    COMMON: "calibrate one jet, or weigh the vehicle ([known])",
    STORED: "measure the spin inertia of a wheel, or state a known inertia ([known])",
    NOISE: "record a longer log, or stronger commands",
    UNSPANNED: "record a second log of the same kind and compare the residuals",
}
"""Most informative next step, by the largest part of the sigmas."""


class PlainFits(NamedTuple):
    """Off-line fits of every phase with the stated noise and disturbances."""

    vehicle: Resolved
    references: tuple[Reference | None, ...]
    consider: Consider
    """Stated uncertainties."""
    left: float
    """Mean squared residual over the stated noise."""


class ErrorColumn(NamedTuple):
    """One component of an error parameter."""

    name: str
    """Name in the table."""
    of: str
    """Axis or channel, if there are several."""
    usual: float
    """Usual sigma, in the vehicle file of a careful lab."""
    least: float = -np.inf
    """Least physical error, in usual sigmas."""

    def prior_sigmas(self, error: float) -> float:
        """An error in usual sigmas as one in prior sigmas."""
        return abs(error) * self.usual / BY_NAME[self.name].prior

    def words(self, error: float) -> str:
        """An error in usual sigmas, in words."""
        one, component = BY_NAME[self.name], f" ({self.of})" if self.of else ""
        # a factor on the readings corrects the inverse error of the sensor
        size = error * self.usual * (-1.0 if one.by_columns and one.unit == "1" else 1.0)
        unit = UNITS.get(self.name, one.unit)
        return f"{WORDS.get(self.name, one.what)}{component}: {f'{100 * size:+.2g} %' if unit in ('1', 'parts') else f'{size:+.2g} {unit}'}"


@dataclass(frozen=True)
class Discrepancy:
    """Estimate of one phase with the model discrepancy in its sigmas."""

    values: Array
    """(10,) quantities."""
    covariance: Array
    """(10, 10) their covariance."""
    bare: tuple[Array, Array]
    """(10,) and (10, 10) both from the log alone."""
    scale: float
    """Estimated common scale of all error parameters, in usual sigmas."""
    thrust_scale_sigma: float
    """Relative sigma of the common thrust scale, beyond the stated one; in ``covariance``, not in ``bare``."""
    shares: Mapping[str, Array]
    """(10,) sigmas by family of error parameters, by noise, and by unexplained scatter."""
    behaves_like: tuple[str, ...]
    """Freed error parameters in words: likely causes, without proof."""

    largest_impulse_error: float
    """Largest freed error of a channel's impulse, in prior sigmas."""

    @property
    def refuted(self) -> bool:
        """Whether the common scale or an impulse error is larger than in any lab."""
        return self.scale > MOST or self.largest_impulse_error > BEYOND

    def covering(self, others: Sequence[Array]) -> Discrepancy:
        """The discrepancy with sigmas that include the distance to each of ``others`` (10,), the estimates by other likely causes."""
        if not others:
            return self
        distance = np.nan_to_num(np.abs(np.array(others) - self.values)).max(0)
        shares = {**self.shares, UNSPANNED: np.hypot(self.shares[UNSPANNED], distance)}
        bare = self.bare[0], self.bare[1] + np.diag(distance**2)
        return replace(self, covariance=self.covariance + np.diag(distance**2), bare=bare, shares=shares)

    def next_step(self, which: Sequence[int]) -> str:
        """Check or experiment that reduces the sigmas of most of these quantities."""
        sources = [self.main_source(i) for i in which]
        return NEXT_STEPS[max(dict.fromkeys(sources), key=sources.count)] if sources else NEXT_STEPS[NOISE]

    def main_source(self, i: int) -> str:
        """Source of the largest part of a quantity's sigma."""
        return max(self.shares, key=lambda name: float(self.shares[name][i]))


def discrepancy(samples: Stream, timing: Timing, used: Resolved, settled: History, plain: PlainFits, i: int) -> Discrepancy | None:
    """Estimate of phase number ``i`` with all error parameters as nuisance parameters; None without a finite fit."""
    errors, units, columns = _columns(Setup(samples.log, used, timing), samples, float(settled.natural_sizes[CG]))
    fitted = partial(_fitted, samples, settled, plain.consider.about(errors), units, np.array([one.least for one in columns]))
    fit = fitted(used, settled.reference)
    if fit is None:
        return None
    if any(getattr(plain.vehicle, part) != getattr(used, part) for part in ("imu", "environment", "estimator")):
        without_disturbance = fitted(plain.vehicle, plain.references[i])
        fit = fit if without_disturbance is None else fit.widened(without_disturbance)
    vehicle = used.in_phase(settled.phase)
    # a scale common to all actuators does not change the residuals; it is as likely as a scale error of one. With wheels, the log
    # informs the thrust scale
    wheels_only = bool(vehicle.spinning) and not samples.log.command.any()
    common = 0.0 if vehicle.spinning else BY_NAME["thrust"].usual * max(fit.scale, LEAST)
    stored = BY_NAME["spin_inertia"].usual * max(fit.scale, LEAST) if wheels_only and not vehicle.knows_inertia else 0.0
    thrust = vehicle.thrust.model_copy(update={"scale_sigma": float(np.hypot(vehicle.thrust.scale_sigma, common))})
    linear = np.maximum(np.diag(fit.covariance) - fit.scatter, 0.0)[MOMENTS]
    row = Parameters(fit.mean[None], fit.covariance[None], np.sqrt(linear)[None] / fit.mean[MOMENTS])
    (values, full), bare = quantities(row, vehicle.model_copy(update={"thrust": thrust})), quantities(row, alone(vehicle))
    slope = by_scale(values[0], vehicle)
    full[0] += stored**2 * np.outer(slope, slope)
    shares = _shares(fit, columns) | {STORED if stored else COMMON: (common + stored) * np.abs(slope)}
    causes = tuple(columns[at].words(float(fit.errors[at])) for at in fit.freed)
    impulses = [columns[at].prior_sigmas(float(fit.errors[at])) for at in fit.freed if columns[at].name in IMPULSE]
    return Discrepancy(values[0], full[0], (bare[0][0], bare[1][0]), fit.scale, common, shares, causes, max(impulses, default=0.0))


def _fitted(
    samples: Stream, settled: History, consider: Consider, units: Array, least: Array, vehicle: Resolved, reference: Reference | None
) -> ErrorFit | None:
    """Fit with all error parameters and the noise and disturbances of ``vehicle``; None if it is not finite."""
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
    """(10,) sigmas of the ten quantities by noise, by unexplained scatter, and by each family of error parameters."""
    variances, families = {NOISE: found.by_noise, UNSPANNED: found.scatter}, [FAMILY[one.name] for one in columns]
    for family in dict.fromkeys(families):
        at = np.flatnonzero([one == family for one in families])
        variances[family] = np.einsum("ie,ef,if->i", found.effects[:, at], found.error_covariance[np.ix_(at, at)], found.effects[:, at])
    slope = np.ones(10)
    slope[MU] = found.mean[MU] ** -2
    return {name: slope * np.sqrt(np.maximum(variance, 0.0)) for name, variance in variances.items()}


def _columns(setup: Setup, samples: Stream, size_m: float) -> tuple[Consider, Array, tuple[ErrorColumn, ...]]:
    """Derivatives of all error parameters of a log and a vehicle of ``size_m``, (e,) usual sigmas in each column's unit, and the columns.

    Omits the parameters that the estimator already has as nuisance parameters.
    """
    variants, columns = [], list[ErrorColumn]()
    for one in TABLE:
        nuisance = one.estimated and one.sigma(setup.vehicle) > 0
        other_environment = one.environments and setup.vehicle.environment.kind not in one.environments
        preprocessed = one.shown is None and one.redone != "body"
        if one.usual == 0 or one.per_channel or nuisance or other_environment or (preprocessed and setup.log.cycles > MOST_CYCLES):
            continue
        if one.shown is None and one.apply(setup, np.zeros(one.size)) is None:
            continue  # this vehicle does not have the parameter
        for axis in range(one.size):
            changed = variant(one, setup, samples, axis)
            if changed is not None:
                variants.append(of_motion(changed, one, setup.vehicle, axis))
                usual = _usual(one, size_m)
                columns.append(ErrorColumn(one.name, "XYZ"[axis] if one.size > 1 else "", usual, one.least(setup) / usual))
    sigmas = {name: _usual(one, size_m) for name, one in BY_NAME.items() if one.per_channel}
    jets = setup.vehicle.jets if setup.log.command_kind == "jets" else ()
    pushes = channel_changes(jets, channel_wrench(setup.log, setup.vehicle), sigmas)
    names = channel_names(setup.log, setup.vehicle)
    units = np.array([*(one.usual for one in columns), *np.ones(len(pushes.channels)), BY_NAME[AGING].usual])
    columns += [ErrorColumn(kind, names[channel], sigmas[kind]) for kind, channel in zip(pushes.kinds, pushes.channels, strict=True)]
    columns.append(ErrorColumn(AGING, "", BY_NAME[AGING].usual))
    return Consider(tuple(variants), pushes=pushes, aging=True), units, tuple(columns)


def _usual(one: ErrorParameter, size_m: float) -> float:
    """Usual sigma of a parameter; of a length, for a vehicle of ``size_m``."""
    return one.usual * (size_m if one.unit == "m" else 1.0)


def with_affected(conclusion: Conclusion, found: Discrepancy, affected: BoolArray, history: History, vehicle: Vehicle) -> Conclusion:
    """The conclusion with the discrepancy's values of the quantities ``affected`` (10,) by a named fault; verdicts stay."""
    both, neither = affected[:, None] & affected, ~affected[:, None] & ~affected
    known = np.array([one.value is not None for one in conclusion.estimates.values()])
    covariance = np.where(both, found.covariance, np.where(neither, conclusion.covariance, 0.0))
    values = np.where(affected, found.values, conclusion.values)
    sigmas = np.sqrt(np.diag(covariance))
    reported, changed = affected & known & (sigmas < history.natural_sizes), affected & known
    pairs = [(float(value), float(sigma)) if given else (None, None) for value, sigma, given in zip(values, sigmas, reported, strict=True)]
    estimates = {
        name: replace(one, value=pairs[i][0], sigma=pairs[i][1]) if changed[i] else one
        for i, (name, one) in enumerate(conclusion.estimates.items())
    }
    return assembled(estimates, values, covariance, conclusion.bare, history, vehicle)


def with_discrepancy(conclusion: Conclusion, found: Discrepancy, history: History, vehicle: Vehicle) -> Conclusion:
    """The conclusion with the discrepancy's values; a converged quantity stays so if its sigma is within the tolerance."""
    known: dict[str, float] = {name: one.sigma for name, one in vehicle.known.items()}
    shared = in_common(by_scale(found.values, vehicle), found.covariance, known, vehicle)
    # the tolerance does not bound the stated uncertainty of thrust and known values
    within = np.diag(found.covariance) - np.nan_to_num(shared) ** 2 <= tolerances(history, vehicle) ** 2
    estimates = {name: _estimate(conclusion.estimates[name], found, i, bool(within[i]), history) for i, name in enumerate(QUANTITIES)}
    changed = assembled(estimates, found.values, found.covariance, found.bare, history, vehicle)
    return replace(changed, thrust_scale_sigma=found.thrust_scale_sigma)


def _estimate(one: Estimate, found: Discrepancy, i: int, within: bool, history: History) -> Estimate:
    """Estimate of quantity ``i`` with the discrepancy's value; ``within``: whether the sigma is within the tolerance."""
    if one.verdict == "unobservable":
        return one
    value, sigma, size = float(found.values[i]), float(np.sqrt(found.covariance[i, i])), float(history.natural_sizes[i])
    reported = bool(np.isfinite(value) and sigma < size)
    if one.verdict == "converged":
        kept = reported and within
        reason = Reason.of("within-discrepancy" if kept else "discrepancy", percent=100 * sigma / size, main=found.main_source(i))
        one = replace(one, verdict="converged" if kept else "not_converged", reason=reason, final_at_s=one.final_at_s if kept else None)
    return replace(one, value=value if reported else None, sigma=sigma if reported else None)
