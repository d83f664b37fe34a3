"""One phase of several results: added up, or fitted at once from their logs; its verdicts, and what contradicts."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from massprop_cli import ABOUT_PIVOT, PIVOT_UNITS, QUANTITIES, UNITS
from massprop_cli.base.arrays import Array
from massprop_cli.base.chance import chance
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.combine import added, fit, incommon, pivot
from massprop_cli.combine.joint import BEYOND, Joint, Piece, joint, known_object, scale_sigma
from massprop_cli.conclude.pivot import estimates_about
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Conclusion, Estimate, Verdict
from massprop_cli.diagnosis.preprocessing import Ready
from massprop_cli.estimate.pivot import about_pivot as pivot_of
from massprop_cli.inputs.vehicle import ASSUMED_KG, Phase
from massprop_cli.model.plant import BearingBody
from massprop_cli.result.build import estimate_items, matrix, physical
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import BY_OBJECT, DockedObject, ImpliedScale, PhaseItem, VehicleInfo, WarningItem, implied_of
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


class Gathered(NamedTuple):
    """Results of one phase, and what they say together."""

    name: str
    parts: Sequence[Part]
    joint: Joint
    notes: list[WarningItem]
    scale: ImpliedScale | None = None
    """Of the thrust or wheels, by an object that was added."""
    against: str = ""
    """What contradicts that object."""


class Phased(NamedTuple):
    """What came of a phase."""

    item: PhaseItem
    notes: list[WarningItem]
    explained: frozenset[str]
    """Labels of results whose logs were fitted at once and are explained by their stated noise."""
    parts: Sequence[Part]


def piece(vehicle: VehicleInfo, phase: PhaseItem, alike: Array | None = None) -> Piece:
    """One phase of a result; ``alike``: what its errors may have in common with those of others (:mod:`massprop_cli.combine.incommon`)."""
    if vehicle.environment == "pedestal":
        return pivot.piece(vehicle, phase, alike)
    values = np.array([np.nan if e.value is None or e.sigma is None else e.value for e in phase.estimates.values()])
    covariance = np.array(phase.covariance, dtype=float)
    at = np.array(vehicle.bearing_position_m)
    # gravity has no part in how the mass properties are written
    bearing = BearingBody(at, vehicle.bearing_mass_kg, 0.0) if vehicle.environment == "air_bearing" else None
    common = np.zeros(10) if alike is None else alike
    return Piece(values, covariance, phase.known, scale_sigma(vehicle, phase), bearing, alike=common)


def gathered(name: str, parts: Sequence[Part]) -> Gathered:
    """Added up, or fitted at once, without verdicts."""
    return Gathered(name, parts, *_joint(name, parts))


def phased(of: Gathered) -> Phased:
    """With verdicts, as a result has it."""
    name, parts, found = of.name, of.parts, of.joint
    vehicle = parts[0].vehicle
    against = [*_contradictions(parts, found), *([of.against] if of.against else [])]
    notes = [*of.notes, *(WarningItem(code="results-disagree", message=f"phase {name}: {message}") for message in against)]
    about_pivot: dict[str, Estimate] = {}
    values, covariance, at = found.values, found.covariance, np.array(vehicle.bearing_position_m)
    nine = found.values[:9], found.covariance[:9, :9]
    if vehicle.environment == "pedestal":
        about_pivot = {name: _estimate(i, name, of) for i, name in enumerate(ABOUT_PIVOT)}
        values, covariance = pivot.ten(values, covariance, at, pivot.weighed([part.phase for part in parts]))
        estimates = pivot.estimates(about_pivot, values, covariance)
    else:
        estimates = {quantity: _estimate(i, quantity, of) for i, quantity in enumerate(QUANTITIES)}
        turning = values - np.append(np.zeros(9), vehicle.bearing_mass_kg)
        nine = pivot_of(turning, covariance, at, turning[9])
    duration = sum(part.phase.end_s - part.phase.start_s for part in parts)
    phase = Phase(name=name, start_s=0.0, end_s=duration)
    whole = Conclusion(phase, estimates, covariance, float(values[9]) - vehicle.bearing_mass_kg, (values, covariance), nine)
    if vehicle.environment == "air_bearing":
        about_pivot = estimates_about(whole)
    about = whole.inertia_about_origin
    contradicted = any(item.verdict == "contradicted" for item in (estimates | about_pivot).values())
    item = PhaseItem(
        name=name,
        start_s=0.0,
        end_s=duration,
        estimates=estimate_items(estimates),
        covariance=matrix(covariance),
        inertia_about_origin=matrix(about) if np.isfinite(about).all() else None,
        physical=physical(whole),
        about_pivot=estimate_items(about_pivot),
        about_pivot_covariance=matrix(nine[1]) if about_pivot else None,
        innovations=None,
        contradiction="; ".join(against) if contradicted else "",
        known={quantity: pair for part in parts for quantity, pair in part.phase.known.items()},
        implied_thrust_scale=of.scale,
        alike=found.alike[: 9 if vehicle.environment == "pedestal" else 10].tolist() if found.alike.any() else [],
    )
    explained = frozenset(part.label for part, odd in zip(parts, found.strange, strict=False) if not odd)
    return Phased(item, notes, explained, parts)


def by_object(before: Gathered, after: Gathered, text: str) -> tuple[list[Phased], DockedObject]:
    """Both sides in absolute terms by the object that ``text`` states, and the object."""
    known = added.stated(text)
    vehicle = before.parts[0].vehicle
    scales = [piece(part.vehicle, part.phase).scale_sigma for of in (before, after) for part in of.parts]
    found = added.calibrated((_side(before), _side(after)), known, max(scales) if vehicle.thrust_scale_sigma > 0 else 0.0)
    against = ""
    if chance(found.chi_square, found.freedom) < RARE:
        against = (
            f"mass and place stated by --added do not fit the logs (chi-square {found.chi_square:.4g} of {found.freedom}): check its mass, "
            "its position from O in body axes, and that nothing else was changed"
        )
    scale = ImpliedScale(by=BY_OBJECT, of=implied_of(vehicle), value=found.scale[0], sigma=found.scale[1])
    sides = [
        phased(of._replace(joint=replace(of.joint, values=values, covariance=covariance), scale=scale, against=against))
        for of, (values, covariance) in zip((before, after), found.sides, strict=True)
    ]
    return sides, known_object(sides[0].item, sides[1].item, found.added, known)


def _side(of: Gathered) -> added.Side:
    vehicle, known = of.parts[0].vehicle, {name: pair for part in of.parts for name, pair in part.phase.known.items()}
    pedestal = vehicle.environment == "pedestal"
    labels = ", ".join(part.label for part in of.parts)
    return added.Side(
        labels, *of.joint.bare, np.array(vehicle.bearing_position_m), vehicle.bearing_mass_kg, pedestal, {} if pedestal else known
    )


def _joint(name: str, parts: Sequence[Part]) -> tuple[Joint, list[WarningItem]]:
    """Results added up; where one shows some axes alone, the logs are fitted at once, unless one has a discrepancy: no fit explains it."""
    pieces = _pieces(parts)
    short = [fit.partial(one, part.vehicle.environment) for one, part in zip(pieces, parts, strict=True)]
    doubted = any(part.phase.discrepancy for part in parts)
    if len(parts) == 1 or doubted or not any(short):
        return joint(pieces, wide=doubted and any(short)), []
    try:
        found = fit.fitted([fit.Behind(part.recorded.result, part.ready(), part.phase.name) for part in parts], pieces)
    except InputError as error:
        message = (
            f"phase {name}: {', '.join(part.label for part, few in zip(parts, short, strict=True) if few)} showed some axes alone, and "
            f"adds nothing to the inertia: the logs can't be fitted at once ({error})"
        )
        return joint([fit.without_inertia(one) if few else one for one, few in zip(pieces, short, strict=True)]), [
            WarningItem(code="result-partial", message=message)
        ]
    return found or joint(pieces), []


def _pieces(parts: Sequence[Part]) -> list[Piece]:
    return [piece(part.vehicle, part.phase, incommon.alike(part.recorded.result, part.phase)) for part in parts]


def _odd_one(parts: Sequence[Part]) -> str:
    """Which one of several differs, where all others agree without it and with no other one left out, as of two; else empty."""
    pieces, odd = _pieces(parts), []
    for i, part in enumerate(parts):
        rest = joint([*pieces[:i], *pieces[i + 1 :]])
        agree = chance(rest.chi_square, rest.freedom) >= RARE and not any((np.abs(one) > BEYOND).any() for one in rest.apart)
        odd += [part.label] if agree else []
    return odd[0] if len(odd) == 1 else ""


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
    if notes and (odd := _odd_one(parts)):
        notes = [f"{note} Without it all others agree." for note in notes if note.startswith(f"{odd} ")] or notes
    for part, (chi_square, freedom) in zip(parts, found.alone, strict=False):
        if chance(chi_square, freedom) < RARE:
            notes.append(
                f"{part.label} does not fit the body of the others together (chi-square {chi_square:.4g} of {freedom}); was the vehicle "
                "the same?"
            )
    names = ABOUT_PIVOT if parts[0].vehicle.environment == "pedestal" else QUANTITIES
    far = [name for name, one in zip(names, found.scatter, strict=False) if one[1] and chance(*one) < CHANCE / len(names)]
    if not notes and far:
        said = "; ".join(f"{name} {found.scatter[names.index(name)][0]:.4g} of {found.scatter[names.index(name)][1]}" for name in far)
        notes.append(f"the results scatter more than their sigmas allow (chi-square of each quantity by itself: {said})")
    if not notes and chance(found.chi_square, found.freedom) < CHANCE:
        notes.append(f"the results scatter more than their sigmas allow (chi-square {found.chi_square:.4g} of {found.freedom})")
    return notes


def _estimate(i: int, quantity: str, of: Gathered) -> Estimate:
    parts, found = of.parts, of.joint
    value, variance = found.values[i], found.covariance[i, i]
    told = bool(np.isfinite(value) and variance > 0)
    # about the pivot on a pedestal, of which the ten have no part in the motion
    items = [part.phase.about_pivot if part.vehicle.environment == "pedestal" else part.phase.estimates for part in parts]
    own = [each[quantity].verdict for each in items]
    sigma = math.sqrt(variance) if told else None
    size = _sizes(parts, found.values)[i]
    if of.scale is not None and sigma is not None and sigma > SETTLED * size:  # converged but for the scale
        own = ["not_converged" if one == "converged" else one for one in own]
    verdict, reason = _verdict(own, sigma, size)
    off = [max(abs(apart[i]), abs(pulled[i])) for apart, pulled in zip(found.apart, found.pulled, strict=True)]
    bad = [part.label for part, z in zip(parts, off, strict=True) if z > BEYOND]
    bad += [part.label for part, alone in zip(parts, found.alone, strict=False) if chance(*alone) < RARE]
    odd = found.strange or [True] * len(parts)  # what one log's own fit didn't explain, the others' body may
    bad += [part.label for part, one, may in zip(parts, own, odd, strict=True) if one == "contradicted" and may]
    if of.against:
        verdict, reason = "contradicted", Reason("object-contradicted")
    elif bad:
        verdict, reason = "contradicted", Reason.of("logs-contradicted", logs=", ".join(dict.fromkeys(bad)))
    return Estimate(float(value) if told else None, sigma, PIVOT_UNITS.get(quantity, UNITS.get(quantity, "")), verdict, None, reason)


def _sizes(parts: Sequence[Part], values: Array) -> Array:
    """(10,) natural sizes; a moment of inertia that nothing told, as on a table, adds nothing to the body's size."""
    known, pedestal = np.concatenate([np.nan_to_num(values[:6]), values[6:]]), parts[0].vehicle.environment == "pedestal"
    if pedestal or not np.isfinite(known[9]):  # a mass that nothing tells
        weighed, nominal = pivot.weighed([part.phase for part in parts]), parts[0].phase.estimates["mass"].nominal
        known[9] = weighed[0] if weighed else nominal or ASSUMED_KG
    sizes = natural_sizes(known)
    sizes[6:9] *= known[9] if pedestal else 1.0
    return sizes


def _verdict(own: Sequence[Verdict], sigma: float | None, size: float) -> tuple[Verdict, Reason]:
    if all(one == "unobservable" for one in own):
        return "unobservable", Reason("logs-unobservable")
    if sigma is None or not sigma <= INFORMED * size:
        return "not_excited", Reason("logs-not-excited")
    if "converged" in own or sigma < SETTLED / 4 * size:
        percent = float(100 * sigma / size)
        return "converged", Reason.of("logs-converged", converged=own.count("converged"), logs=len(own), percent=percent)
    return "not_converged", Reason("logs-not-converged")
