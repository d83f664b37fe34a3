"""Known values tested against the estimate from the log alone, and against physical bounds."""

from __future__ import annotations

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Quantity, Vehicle

MISMATCH = 4.0
"""A known quantity further than this many sigmas from the log's own estimate is pointed out."""
DENSEST = 22590.0
"""kg/m³, osmium: of a given mass no body has less inertia than a ball of it."""


TOLD = 0.1
"""Relative sigma up to which mass and inertia tell of what they may be."""


def density(mass: float, trace: float) -> float:
    """kg/m³ of the ball of this mass and sum of principal moments, ΣI = 6/5 m R²: no body of less radius of gyration is less dense."""
    return float(mass / (4 / 3 * np.pi * (trace / mass / 1.2) ** 1.5))


def of_no_matter(values: Array, sigmas: Array) -> bool:
    """Whether no matter is as dense as a body of these quantities (10,) and their sigmas."""
    own = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz", "mass")]
    if not (values[own] > 0).all() or not (sigmas[own] < TOLD * values[own]).all():
        return False
    return density(float(values[own[-1]]), float(values[own[:-1]].sum())) > DENSEST


def belied(told: Parameters, vehicle: Vehicle, phase: str) -> tuple[dict[str, str], tuple[Notice, ...]]:
    """Known quantities that the log does not bear out, each with why, and what is said; ``told`` is what the log alone says, one row."""
    said: dict[Quantity, str] = {}
    for name, z in discrepancies(told, vehicle).items():
        if abs(z) > MISMATCH:
            said[name] = off_by(z)
    together = quantities(told, vehicle)[0][0]
    for name, known in vehicle.known.items():
        off = abs(known.value - together[QUANTITIES.index(name)])
        if name != "mass" and name not in said and off > MISMATCH * known.sigma:
            said[name] = (
                f"lies {off / known.sigma:.3g} of its sigmas from what the log makes of all known values together; check each of them"
            )
    heaviest = heaviest_body(told, vehicle)
    weighed = vehicle.known.get("mass")
    if weighed is not None and "mass" not in said and weighed.value - MISMATCH * weighed.sigma > heaviest:
        said["mass"] = f"is more than {heaviest:.3g} kg, of which the densest matter already has more inertia than the log shows; check it"
    found: dict[str, str] = {name: f"known.{name} = {vehicle.known[name].value:g} {text}" for name, text in said.items()}
    return found, tuple(Notice("known-mismatch", f"phase {phase}: {message}") for message in found.values())


def off_by(z: float) -> str:
    """What is said of a known quantity so many sigmas from what the log alone says."""
    return f"lies {abs(z):.3g} sigmas from what the log alone says; check it, the thrust, and thrust.scale_sigma"


def discrepancies(told: Parameters, vehicle: Vehicle) -> dict[Quantity, float]:
    """How many sigmas each known quantity lies from what the log alone says of it; a mass that it doesn't tell by its reciprocal."""
    values, full = _alone(told, vehicle)
    found: dict[Quantity, float] = {}
    for name, known in vehicle.known.items():
        i = QUANTITIES.index(name)
        off, variance = known.value - values[i], full[i, i] + known.sigma**2
        if name == "mass" and np.isnan(values[i]):
            off, variance = told.mean[0, i] - 1 / known.value, told.covariance[0, i, i] + (known.sigma / known.value**2) ** 2
        found[name] = float(off / np.sqrt(variance))
    return {name: z for name, z in found.items() if np.isfinite(z)}


def heaviest_body(told: Parameters, vehicle: Vehicle) -> float:
    """Mass [kg] above which no matter is so dense as to have as little inertia as the log shows; NaN where it shows none.

    A ball of density ρ and mass m has ``∫ r² dm = 3/5 m R²``, ``m = 4/3 π ρ R³``, the least of all bodies; that integral is half the trace.
    """
    values, full = _alone(told, vehicle)
    moments = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz")]
    most = (values[moments].sum() + MISMATCH * np.sqrt(full[np.ix_(moments, moments)].sum())) / 2
    return float(np.maximum(most / 0.6, 0.0) ** 0.6 * (4 / 3 * np.pi * DENSEST) ** 0.4 + vehicle.bearing_mass_kg)


def _alone(told: Parameters, vehicle: Vehicle) -> tuple[Array, Array]:
    own = {name: one for name, one in vehicle.known.items() if vehicle.on_pedestal and name == "mass"}
    values, full = quantities(told, vehicle.model_copy(update={"known": own}))
    return values[0], full[0]
