"""Known values tested against the estimate from the log alone, and against the density of matter."""

from __future__ import annotations

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.levels import CONTRADICTION, KNOWN
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Quantity, Vehicle

DENSEST = 22590.0
"""Density of osmium, the densest matter, kg/m³."""


def density(mass: float, trace: float) -> float:
    """Least density of a body with this mass [kg] and trace of inertia [kg m²]: that of a ball, trace 6/5 m R²; kg/m³."""
    return float(mass / (4 / 3 * np.pi * (trace / mass / 1.2) ** 1.5))


def exceeds_density(values: Array, sigmas: Array) -> bool:
    """Whether a body with these quantities (10,) and sigmas (10,) would be denser than any matter."""
    used = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz", "mass")]
    if not (values[used] > 0).all() or not (sigmas[used] < KNOWN * values[used]).all():
        return False
    return density(float(values[used[-1]]), float(values[used[:-1]].sum())) > DENSEST


def contradicted_values(log_alone: Parameters, vehicle: Vehicle, phase: str) -> tuple[dict[str, str], tuple[Notice, ...]]:
    """Known quantities that the log contradicts, with the reason, and their notices; ``log_alone`` is the log's own estimate, one row."""
    said: dict[Quantity, str] = {}
    for name, z in discrepancies(log_alone, vehicle).items():
        if abs(z) > CONTRADICTION:
            said[name] = off_by(z)
    together = quantities(log_alone, vehicle)[0][0]
    for name, known in vehicle.known.items():
        off = abs(known.value - together[QUANTITIES.index(name)])
        if name != "mass" and name not in said and off > CONTRADICTION * known.sigma:
            said[name] = (
                f"is {off / known.sigma:.3g} of its sigmas from the estimate that uses the log and all known values; check each of them"
            )
    heaviest = heaviest_body(log_alone, vehicle)
    mass = vehicle.known.get("mass")
    if mass is not None and "mass" not in said and mass.value - CONTRADICTION * mass.sigma > heaviest:
        said["mass"] = f"is above {heaviest:.3g} kg, the most that any matter can have with the inertia that the log shows; check it"
    messages: dict[str, str] = {name: f"known.{name} = {vehicle.known[name].value:g} {text}" for name, text in said.items()}
    return messages, tuple(Notice("known-mismatch", f"phase {phase}: {message}") for message in messages.values())


def off_by(z: float) -> str:
    """Message on a known quantity that is ``z`` sigmas from the log's own estimate."""
    return f"is {abs(z):.3g} sigmas from the estimate of the log alone; check it, the thrust, and thrust.scale_sigma"


def discrepancies(log_alone: Parameters, vehicle: Vehicle) -> dict[Quantity, float]:
    """Sigmas between each known quantity and the log's own estimate; a mass without an estimate is compared by its reciprocal."""
    values, full = _log_alone(log_alone, vehicle)
    deviations: dict[Quantity, float] = {}
    for name, known in vehicle.known.items():
        i = QUANTITIES.index(name)
        off, variance = known.value - values[i], full[i, i] + known.sigma**2
        if name == "mass" and np.isnan(values[i]):
            off, variance = log_alone.mean[0, i] - 1 / known.value, log_alone.covariance[0, i, i] + (known.sigma / known.value**2) ** 2
        deviations[name] = float(off / np.sqrt(variance))
    return {name: z for name, z in deviations.items() if np.isfinite(z)}


def heaviest_body(log_alone: Parameters, vehicle: Vehicle) -> float:
    """Largest mass [kg] that any matter can have with the log's inertia; NaN if the log gives no inertia.

    A ball of density ρ and mass m has the least inertia, ``∫ r² dm = 3/5 m R²`` with ``m = 4/3 π ρ R³``; the integral is half the trace.
    """
    values, full = _log_alone(log_alone, vehicle)
    moments = [QUANTITIES.index(name) for name in ("ixx", "iyy", "izz")]
    most = (values[moments].sum() + CONTRADICTION * np.sqrt(full[np.ix_(moments, moments)].sum())) / 2
    return float(np.maximum(most / 0.6, 0.0) ** 0.6 * (4 / 3 * np.pi * DENSEST) ** 0.4 + vehicle.bearing_mass_kg)


def _log_alone(log_alone: Parameters, vehicle: Vehicle) -> tuple[Array, Array]:
    """(10,) quantities and (10, 10) covariance without known values; only a pedestal's mass stays."""
    kept = {name: one for name, one in vehicle.known.items() if vehicle.on_pedestal and name == "mass"}
    values, full = quantities(log_alone, vehicle.model_copy(update={"known": kept}))
    return values[0], full[0]
