"""One phase of several results: added up, or fitted at once from their logs; its verdicts, and what contradicts."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.combine import fit
from massprop_cli.combine.joint import BEYOND, Joint, Piece, joint
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Conclusion, Estimate, Verdict
from massprop_cli.diagnosis.preprocessing import Ready
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.plant import BearingBody
from massprop_cli.result.build import estimate_items, matrix, physical
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import PhaseItem, VehicleInfo, WarningItem
from massprop_cli.testbed.bound import natural_sizes

INFORMED = 0.5
"""Part of the natural size above which a sigma says nothing."""
SETTLED = 0.01
"""Part of the natural size that is the tolerance of convergence: a quarter of it is settled without a history."""
CHANCE, RARE = 1e-3, 6e-5
"""Chance of as much disagreement as there is, below which it is told of all together, and of one: four sigma."""


@dataclass(frozen=True)
class Part:
    """A result with the one of its phases that counts."""

    label: str
    recorded: Recorded
    phase: PhaseItem
    ready: Callable[[], Ready]
    """Its log; :class:`InputError` where that can't be had."""

    @property
    def vehicle(self) -> VehicleInfo:
        """The result's."""
        return self.recorded.result.vehicle


class Phased(NamedTuple):
    """What came of a phase."""

    item: PhaseItem
    notes: list[WarningItem]
    explained: frozenset[str]
    """Labels of results whose logs were fitted at once and are explained by their stated noise."""


def piece(label: str, vehicle: VehicleInfo, phase: PhaseItem) -> Piece:
    """One phase of a result."""
    values = np.array([np.nan if e.value is None or e.sigma is None else e.value for e in phase.estimates.values()])
    covariance = np.array(phase.covariance, dtype=float)
    at = np.array(vehicle.bearing_position_m)
    # gravity has no part in how the mass properties are written
    bearing = BearingBody(at, vehicle.bearing_mass_kg, 0.0) if vehicle.environment == "air_bearing" else None
    beyond = phase.discrepancy.thrust_scale_sigma if phase.discrepancy else 0.0
    return Piece(label, values, covariance, phase.known, float(np.hypot(vehicle.thrust_scale_sigma, beyond)), bearing)


def together_phase(name: str, parts: Sequence[Part]) -> Phased:
    """Added up, or fitted at once."""
    found, left_out = _joint(name, parts)
    bearing = parts[0].recorded.result.vehicle.bearing_mass_kg
    against = _contradictions(parts, found)
    notes = [*left_out, *(WarningItem(code="results-disagree", message=f"phase {name}: {message}") for message in against)]
    estimates = {quantity: _estimate(i, quantity, parts, found) for i, quantity in enumerate(QUANTITIES)}
    duration = sum(part.phase.end_s - part.phase.start_s for part in parts)
    phase = Phase(name=name, start_s=0.0, end_s=duration)
    whole = Conclusion(phase, estimates, found.covariance, float(found.values[9]) - bearing, (found.values, found.covariance))
    about = whole.inertia_about_origin
    contradicted = any(item.verdict == "contradicted" for item in estimates.values())
    item = PhaseItem(
        name=name,
        start_s=0.0,
        end_s=duration,
        estimates=estimate_items(estimates),
        covariance=matrix(found.covariance),
        inertia_about_origin=matrix(about) if np.isfinite(about).all() else None,
        physical=physical(whole),
        innovations=None,
        contradiction="; ".join(against) if contradicted else "",
        known={quantity: pair for part in parts for quantity, pair in part.phase.known.items()},
    )
    explained = frozenset(part.label for part, odd in zip(parts, found.strange, strict=False) if not odd)
    return Phased(item, notes, explained)


def _joint(name: str, parts: Sequence[Part]) -> tuple[Joint, list[WarningItem]]:
    """Results added up; where one tells some axes alone, the logs are fitted at once, or it is left out of what it can't be added to."""
    pieces = [piece(part.label, part.vehicle, part.phase) for part in parts]
    short = [fit.partial(one, part.vehicle.environment) for one, part in zip(pieces, parts, strict=True)]
    if len(parts) == 1 or not any(short):
        return joint(pieces), []
    try:
        found = fit.fitted([fit.Behind(part.recorded.result, part.ready(), part.phase.name) for part in parts], pieces)
    except InputError as error:
        message = (
            f"phase {name}: {', '.join(part.label for part, few in zip(parts, short, strict=True) if few)} told some axes alone, and adds "
            f"nothing to the inertia: the logs can't be fitted at once ({error})"
        )
        return joint([fit.without_inertia(one) if few else one for one, few in zip(pieces, short, strict=True)]), [
            WarningItem(code="result-partial", message=message)
        ]
    return found or joint(pieces), []


def _contradictions(parts: Sequence[Part], found: Joint) -> list[str]:
    notes = []
    for part, apart, pulled in zip(parts, found.apart, found.pulled, strict=True):
        # in θ, whose signs are not those of the quantities
        strange = [f"{quantity} by {abs(z):.3g} sigma" for quantity, z in zip(QUANTITIES, apart, strict=True) if abs(z) > BEYOND]
        along = [quantity for quantity, z, own in zip(QUANTITIES, pulled, apart, strict=True) if abs(z) > BEYOND and not abs(own) > BEYOND]
        if strange or along:
            said = f"{part.label} differs from the others together: {', '.join(strange) or 'in no quantity alone'}"
            said += f", which pulls {', '.join(along)} away from it" if along else ""
            notes.append(f"{said}; was the vehicle the same?")
    for part, (chi_square, freedom) in zip(parts, found.alone, strict=False):
        if _chance(chi_square, freedom) < RARE:
            notes.append(
                f"{part.label} does not fit the body of the others together (chi-square {chi_square:.4g} of {freedom}); was the vehicle "
                "the same?"
            )
    chance = _chance(found.chi_square, found.freedom)
    if not notes and chance < CHANCE:
        notes.append(f"the results scatter more than their sigmas allow (chi-square {found.chi_square:.4g} of {found.freedom})")
    return notes


def _chance(chi_square: float, freedom: int) -> float:
    """Of as much or more, by chance alone."""
    from scipy.special import gammaincc

    return float(gammaincc(freedom / 2, chi_square / 2)) if freedom > 0 else 1.0


def _estimate(i: int, quantity: str, parts: Sequence[Part], found: Joint) -> Estimate:
    value, variance = found.values[i], found.covariance[i, i]
    told = bool(np.isfinite(value) and variance > 0)
    own = [part.phase.estimates[quantity].verdict for part in parts]
    sigma = math.sqrt(variance) if told else None
    verdict, reason = _verdict(i, own, found, sigma)
    off = [max(abs(apart[i]), abs(pulled[i])) for apart, pulled in zip(found.apart, found.pulled, strict=True)]
    bad = [part.label for part, z in zip(parts, off, strict=True) if z > BEYOND]
    bad += [part.label for part, alone in zip(parts, found.alone, strict=False) if _chance(*alone) < RARE]
    odd = found.strange or [True] * len(parts)  # what one log's own fit didn't explain, the others' body may
    bad += [part.label for part, one, may in zip(parts, own, odd, strict=True) if one == "contradicted" and may]
    if bad:
        verdict, reason = "contradicted", Reason.of("logs-contradicted", logs=", ".join(dict.fromkeys(bad)))
    return Estimate(float(value) if told else None, sigma, UNITS[quantity], verdict, None, reason)


def _verdict(i: int, own: Sequence[Verdict], found: Joint, sigma: float | None) -> tuple[Verdict, Reason]:
    if all(one == "unobservable" for one in own):
        return "unobservable", Reason("logs-unobservable")
    # a moment of inertia that nothing told, as on a table, adds nothing to the body's size
    size = natural_sizes(np.concatenate([np.nan_to_num(found.values[:6]), found.values[6:]]))[i]
    if sigma is None or not sigma <= INFORMED * size:
        return "not_excited", Reason("logs-not-excited")
    if "converged" in own or sigma < SETTLED / 4 * size:
        percent = float(100 * sigma / size)
        return "converged", Reason.of("logs-converged", converged=own.count("converged"), logs=len(own), percent=percent)
    return "not_converged", Reason("logs-not-converged")
