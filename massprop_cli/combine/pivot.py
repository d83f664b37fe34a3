"""Combination of results on a fixed pedestal: values about the pivot, from which a known mass gives CG and inertia about the CG."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli import ABOUT_PIVOT, QUANTITIES, UNITS
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.combine import incommon
from massprop_cli.combine.joint import Piece, scale_sigma
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Estimate
from massprop_cli.estimate.pivot import with_mass
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import PhaseItem, VehicleInfo


def refuse(recorded: Sequence[Recorded]) -> None:
    """Raise :class:`InputError` if values about a pivot cannot be combined: different pivots, or a known inertia in them."""
    for one in recorded:
        if one.result.vehicle.environment != "pedestal":
            continue
        where = one.result.vehicle.bearing_position_m
        if where != recorded[0].result.vehicle.bearing_position_m:
            raise InputError(
                f"{one.path}: the pivot is at {where} m, and at {recorded[0].result.vehicle.bearing_position_m} m in {recorded[0].path}; "
                "make the results with the same environment.bearing_position_m"
            )
        for phase in one.result.phases:
            if phase.about_pivot_covariance is None:
                raise InputError(f"{one.path}: has no about_pivot with its covariance; make the result again with this version")
            known = ", ".join(f"known.{name}" for name in phase.known if name != "mass")
            if known:
                raise InputError(f"{one.path}: its values about the pivot include {known}; make the result again without it")


def piece(vehicle: VehicleInfo, phase: PhaseItem, alike: Array | None = None) -> Piece:
    """Nine quantities of one phase, without mass; ``alike``: shared sigmas of the ten (10,) or of the nine (9,)."""
    values, covariance = np.full(10, np.nan), np.full((10, 10), np.nan)
    values[:9] = [np.nan if one.value is None or one.sigma is None else one.value for one in map(phase.about_pivot.get, ABOUT_PIVOT) if one]
    covariance[:9, :9] = np.array(phase.about_pivot_covariance, dtype=float)
    common = np.zeros(9) if alike is None else alike
    if len(common) == 10:
        onto = incommon.by_ten_about_pivot(phase, 0.0, np.array(vehicle.bearing_position_m))
        common = incommon.alike_about_pivot(common, onto)
    return Piece(values, covariance, {}, scale_sigma(vehicle, phase), about_pivot=True, alike=np.append(common, 0.0))


def weighed(phases: Sequence[PhaseItem]) -> tuple[float, float] | None:
    """Weighted mean and sigma of the known masses of a body's phases, kg, each once; None without one."""
    known = list(dict.fromkeys(phase.known["mass"] for phase in phases if "mass" in phase.known))
    if not known:
        return None
    weight = np.array([1 / sigma**2 for _, sigma in known])
    return float(weight @ np.array([value for value, _ in known]) / weight.sum()), float(weight.sum() ** -0.5)


def ten(values: Array, covariance: Array, pivot: Array, mass: tuple[float, float] | None) -> tuple[Array, Array]:
    """Ten quantities (10,), (10, 10) from the nine and a known mass with its sigma, kg; NaN without a mass."""
    if mass is None or not np.isfinite(values[:9]).all():
        return np.full(10, np.nan), np.full((10, 10), np.nan)
    found = with_mass(values[None, :9], covariance[None, :9, :9], pivot, *mass)
    return found.values[0], (found.covariance + found.by_mass)[0]


def estimates(nine: Mapping[str, Estimate], values: Array, covariance: Array) -> dict[str, Estimate]:
    """Ten estimates with the verdicts of the corresponding nine."""
    if not np.isfinite(values).all():
        return {name: Estimate(None, None, UNITS[name], "unobservable", None, Reason("unweighed-pedestal")) for name in QUANTITIES}
    counterparts, ten_estimates = [*nine.values(), nine["moment_z"]], {}
    for one, name, value, variance in zip(counterparts, QUANTITIES, values, np.diag(covariance), strict=True):
        ten_estimates[name] = replace(one, value=float(value), sigma=float(np.sqrt(variance)), unit=UNITS[name])
    return ten_estimates
