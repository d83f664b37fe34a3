"""Combination of one phase of several results: by their information, or by a joint fit of their logs; verdicts and contradictions."""

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
from massprop_cli.base.levels import CONTRADICTION
from massprop_cli.combine import added, fit, incommon, pivot
from massprop_cli.combine.joint import Joint, Piece, joint, known_object, scale_sigma
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
"""Largest sigma of an informed quantity, as a part of its natural size."""
SETTLED = 0.01
"""Tolerance of convergence as a part of the natural size. A quarter of it converges without a converged log."""
CHANCE, RARE = 1e-3, 6e-5
"""Probability by chance below which a disagreement of all results, or of one result (four sigma), is reported."""


@dataclass(frozen=True)
class Part:
    """One phase of a result."""

    label: str
    recorded: Recorded
    phase: PhaseItem
    ready: Callable[[], Ready]
    """Preprocesses its log; :class:`InputError` if that is not possible."""

    @property
    def vehicle(self) -> VehicleInfo:
        """Vehicle of the result."""
        return self.recorded.result.vehicle


class Gathered(NamedTuple):
    """Combined results of one phase, without verdicts."""

    name: str
    parts: Sequence[Part]
    joint: Joint
    notes: list[WarningItem]
    scale: ImpliedScale | None = None
    """Scale of thrust or wheels by a stated object."""
    against: str = ""
    """Message if the logs contradict that object."""


class Phased(NamedTuple):
    """Combined results of one phase, with verdicts."""

    item: PhaseItem
    notes: list[WarningItem]
    explained: frozenset[str]
    """Labels of the results whose logs, jointly fitted, are explained by their stated noise."""
    parts: Sequence[Part]


def piece(vehicle: VehicleInfo, phase: PhaseItem, alike: Array | None = None) -> Piece:
    """One phase of a result; ``alike``: sigmas of errors that it shares with other results (:mod:`massprop_cli.combine.incommon`)."""
    if vehicle.environment == "pedestal":
        return pivot.piece(vehicle, phase, alike)
    values = np.array([np.nan if e.value is None or e.sigma is None else e.value for e in phase.estimates.values()])
    covariance = np.array(phase.covariance, dtype=float)
    at = np.array(vehicle.bearing_position_m)
    # the parameters of mass properties do not depend on gravity
    bearing = BearingBody(at, vehicle.bearing_mass_kg, 0.0) if vehicle.environment == "air_bearing" else None
    common = np.zeros(10) if alike is None else alike
    return Piece(values, covariance, phase.known, scale_sigma(vehicle, phase), bearing, alike=common)


def gathered(name: str, parts: Sequence[Part]) -> Gathered:
    """Combine the results of one phase."""
    return Gathered(name, parts, *_joint(name, parts))


def phased(of: Gathered) -> Phased:
    """Verdicts and warnings of a combined phase."""
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
    explained = frozenset(part.label for part, unexplained in zip(parts, found.unexplained, strict=False) if not unexplained)
    return Phased(item, notes, explained, parts)


def by_object(before: Gathered, after: Gathered, text: str) -> tuple[list[Phased], DockedObject]:
    """Both sides with the thrust scale by the object that ``text`` states, and the object."""
    known = added.stated(text)
    vehicle = before.parts[0].vehicle
    scales = [piece(part.vehicle, part.phase).scale_sigma for of in (before, after) for part in of.parts]
    found = added.calibrated((_side(before), _side(after)), known, max(scales) if vehicle.thrust_scale_sigma > 0 else 0.0)
    against = ""
    if chance(found.chi_square, found.freedom) < RARE:
        against = (
            f"mass and position stated by --added do not fit the logs (chi-square {found.chi_square:.4g} of {found.freedom}): check its "
            "mass, its position from O in body axes, and that nothing else was changed"
        )
    scale = ImpliedScale(by=BY_OBJECT, of=implied_of(vehicle), value=found.scale[0], sigma=found.scale[1])
    sides = [
        phased(of._replace(joint=replace(of.joint, values=values, covariance=covariance), scale=scale, against=against))
        for of, (values, covariance) in zip((before, after), found.sides, strict=True)
    ]
    return sides, known_object(sides[0].item, sides[1].item, found.added, known)


def _side(of: Gathered) -> added.Side:
    """Combined results as one side of a calibration by a stated object."""
    vehicle, known = of.parts[0].vehicle, {name: pair for part in of.parts for name, pair in part.phase.known.items()}
    pedestal = vehicle.environment == "pedestal"
    labels = ", ".join(part.label for part in of.parts)
    return added.Side(
        labels, *of.joint.bare, np.array(vehicle.bearing_position_m), vehicle.bearing_mass_kg, pedestal, {} if pedestal else known
    )


def _joint(name: str, parts: Sequence[Part]) -> tuple[Joint, list[WarningItem]]:
    """Combined result and its warnings. If a result informs some axes only, the logs are fitted jointly.

    A log with model discrepancy has no valid fit, so then the results are combined.
    """
    pieces = _pieces(parts)
    short = [fit.partial(one, part.vehicle.environment) for one, part in zip(pieces, parts, strict=True)]
    discrepant = any(part.phase.discrepancy for part in parts)
    if len(parts) == 1 or discrepant or not any(short):
        return joint(pieces, wide=discrepant and any(short)), []
    try:
        found = fit.fitted([fit.FittedLog(part.recorded.result, part.ready(), part.phase.name) for part in parts], pieces)
    except InputError as error:
        message = (
            f"phase {name}: {', '.join(part.label for part, few in zip(parts, short, strict=True) if few)} informs only some axes, and "
            f"massprop does not use it for the inertia, because a joint fit of the logs failed ({error})"
        )
        return joint([fit.without_inertia(one) if few else one for one, few in zip(pieces, short, strict=True)]), [
            WarningItem(code="result-partial", message=message)
        ]
    return found or joint(pieces), []


def _pieces(parts: Sequence[Part]) -> list[Piece]:
    return [piece(part.vehicle, part.phase, incommon.alike(part.recorded.result, part.phase)) for part in parts]


def _odd_one(parts: Sequence[Part]) -> str:
    """Label of the only result without which all others agree; empty if there is none or more than one."""
    pieces, odd = _pieces(parts), []
    for i, part in enumerate(parts):
        rest = joint([*pieces[:i], *pieces[i + 1 :]])
        agree = chance(rest.chi_square, rest.freedom) >= RARE and not any((np.abs(one) > CONTRADICTION).any() for one in rest.deviates)
        odd += [part.label] if agree else []
    return odd[0] if len(odd) == 1 else ""


def _contradictions(parts: Sequence[Part], found: Joint) -> list[str]:
    """Messages of results that contradict each other."""
    notes = []
    for part, deviates, pulls in zip(parts, found.deviates, found.pulls, strict=True):
        # absolute values: signs in θ are not those of the quantities
        differing = [
            f"{quantity} by {abs(z):.3g} sigma" for quantity, z in zip(QUANTITIES, deviates, strict=True) if abs(z) > CONTRADICTION
        ]
        pulled = [
            q for q, pull, z in zip(QUANTITIES, pulls, deviates, strict=True) if abs(pull) > CONTRADICTION and not abs(z) > CONTRADICTION
        ]
        if differing or pulled:
            message = f"{part.label} differs from the joint estimate of the others: {', '.join(differing) or 'in no single quantity'}"
            message += f", which pulls {', '.join(pulled)} away from it" if pulled else ""
            notes.append(f"{message}; was it the same vehicle in the same state?")
    if notes and (odd := _odd_one(parts)):
        notes = [f"{note} Without it all others agree." for note in notes if note.startswith(f"{odd} ")] or notes
    for part, (chi_square, freedom) in zip(parts, found.own_fits, strict=False):
        if chance(chi_square, freedom) < RARE:
            notes.append(
                f"{part.label} does not fit the joint body of the others (chi-square {chi_square:.4g} of {freedom}); was it the same "
                "vehicle in the same state?"
            )
    names = ABOUT_PIVOT if parts[0].vehicle.environment == "pedestal" else QUANTITIES
    far = [name for name, one in zip(names, found.scatter, strict=False) if one[1] and chance(*one) < CHANCE / len(names)]
    if not notes and far:
        said = "; ".join(f"{name} {found.scatter[names.index(name)][0]:.4g} of {found.scatter[names.index(name)][1]}" for name in far)
        notes.append(
            f"the results scatter more than their sigmas allow (chi-square of each quantity: {said}); was it the same vehicle in the same "
            "state?"
        )
    if not notes and chance(found.chi_square, found.freedom) < CHANCE:
        notes.append(
            f"the results scatter more than their sigmas allow (chi-square {found.chi_square:.4g} of {found.freedom}); was it the same "
            "vehicle in the same state?"
        )
    return notes


def _estimate(i: int, quantity: str, of: Gathered) -> Estimate:
    """Combined estimate of one quantity, number ``i``."""
    parts, found = of.parts, of.joint
    value, variance = found.values[i], found.covariance[i, i]
    finite = bool(np.isfinite(value) and variance > 0)
    items = [part.phase.about_pivot if part.vehicle.environment == "pedestal" else part.phase.estimates for part in parts]
    verdicts = [each[quantity].verdict for each in items]
    sigma = math.sqrt(variance) if finite else None
    size = _sizes(parts, found.values)[i]
    if of.scale is not None and sigma is not None and sigma > SETTLED * size:  # the logs converged without the scale's uncertainty
        verdicts = ["not_converged" if one == "converged" else one for one in verdicts]
    verdict, reason = _verdict(verdicts, sigma, size)
    distances = [max(abs(deviates[i]), abs(pulls[i])) for deviates, pulls in zip(found.deviates, found.pulls, strict=True)]
    against = [part.label for part, z in zip(parts, distances, strict=True) if z > CONTRADICTION]
    against += [part.label for part, own_fit in zip(parts, found.own_fits, strict=False) if chance(*own_fit) < RARE]
    unexplained = found.unexplained or [True] * len(parts)  # the joint fit may explain a log that its own fit did not
    against += [part.label for part, one, bad in zip(parts, verdicts, unexplained, strict=True) if one == "contradicted" and bad]
    if of.against:
        verdict, reason = "contradicted", Reason("object-contradicted")
    elif against:
        verdict, reason = "contradicted", Reason.of("logs-contradicted", logs=", ".join(dict.fromkeys(against)))
    return Estimate(float(value) if finite else None, sigma, PIVOT_UNITS.get(quantity, UNITS.get(quantity, "")), verdict, None, reason)


def _sizes(parts: Sequence[Part], values: Array) -> Array:
    """(10,) natural sizes; a moment of inertia without a value, as on a table, counts as zero."""
    known, pedestal = np.concatenate([np.nan_to_num(values[:6]), values[6:]]), parts[0].vehicle.environment == "pedestal"
    if pedestal or not np.isfinite(known[9]):
        weighed, nominal = pivot.weighed([part.phase for part in parts]), parts[0].phase.estimates["mass"].nominal
        known[9] = weighed[0] if weighed else nominal or ASSUMED_KG
    sizes = natural_sizes(known)
    sizes[6:9] *= known[9] if pedestal else 1.0
    return sizes


def _verdict(own: Sequence[Verdict], sigma: float | None, size: float) -> tuple[Verdict, Reason]:
    """Combined verdict from each log's ``own``, the combined sigma, and the natural size."""
    if all(one == "unobservable" for one in own):
        return "unobservable", Reason("logs-unobservable")
    if sigma is None or not sigma <= INFORMED * size:
        return "not_excited", Reason("logs-not-excited")
    if "converged" in own or sigma < SETTLED / 4 * size:
        percent = float(100 * sigma / size)
        return "converged", Reason.of("logs-converged", converged=own.count("converged"), logs=len(own), percent=percent)
    return "not_converged", Reason("logs-not-converged")
