"""Results read, checked to be of one vehicle, added up phase by phase, and written as one result."""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from massprop_cli import CG, QUANTITIES, UNITS, __version__
from massprop_cli.base import files
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.combine.joint import BEYOND, Joint, Piece, joint
from massprop_cli.conclude import docking
from massprop_cli.conclude.physical import nearest_consistent, physical_note
from massprop_cli.conclude.verdict import Conclusion, Estimate, Verdict
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.report.labels import labels
from massprop_cli.result import rendered
from massprop_cli.result import schema as results
from massprop_cli.result.read import Recorded, read
from massprop_cli.result.schema import DockedObject, EstimateItem, PhaseItem, Physical, Result, WarningItem
from massprop_cli.testbed.bound import natural_sizes

INFORMED = 0.5
"""Part of the natural size above which a sigma says nothing."""
SETTLED = 0.01
"""Part of the natural size that is the tolerance of convergence: a quarter of it is settled without a history."""
CHANCE = 1e-3
"""Chance of as much disagreement as there is, below which it is told."""


@dataclass(frozen=True)
class Part:
    """A result with the one of its phases that counts."""

    label: str
    recorded: Recorded
    phase: PhaseItem


def combine(paths: Sequence[Path]) -> Result:
    """One result of several of one vehicle, phase by phase; :class:`InputError` where they are not of one vehicle."""
    recorded = _read(paths)
    names = labels(recorded)
    _check_alike(recorded, bearing=True)
    own = [[phase.name for phase in one.result.phases] for one in recorded]
    if any(phases != own[0] for phases in own):
        other = next(i for i, phases in enumerate(own) if phases != own[0])
        raise InputError(
            f"{recorded[other].path}: has phases {', '.join(own[other])}, and {recorded[0].path} {', '.join(own[0])}; combine results with "
            "the same phases, or name those before and after docking by --before and --after"
        )
    parts = [[Part(label, one, one.result.phases[i]) for label, one in zip(names, recorded, strict=True)] for i in range(len(own[0]))]
    phases, notes = zip(*[_phase(own[0][i], part) for i, part in enumerate(parts)], strict=True)
    return _result(recorded, names, list(phases), None, [note for some in notes for note in some])


def combine_docked(before: Sequence[Path], after: Sequence[Path]) -> Result:
    """The vehicle alone, with the object, and the object itself, each of any number of results."""
    # a log may hold both: its phases are told apart
    sides = _read(before), _read(after)
    recorded = [*sides[0], *sides[1]]
    names = labels(recorded)
    _check_alike(recorded, bearing=False)
    found = []
    for name, first, stop in (("before", 0, len(sides[0])), ("after", len(sides[0]), len(recorded))):
        chosen = [Part(label, one, _chosen(one, name)) for label, one in zip(names[first:stop], recorded[first:stop], strict=True)]
        found.append((chosen, *_phase(name, chosen)))
    (alone, single, first_notes), (joined, combined, more_notes) = found
    docked = _docked(alone, single, joined, combined)
    return _result(recorded, names, [single, combined], docked, [*first_notes, *more_notes])


def _read(paths: Sequence[Path]) -> list[Recorded]:
    recorded = [read(path) for path in {path.resolve(): path for path in paths}.values()]
    _check_twice(recorded)
    _check_exact(recorded)
    return recorded


def _check_twice(recorded: Sequence[Recorded]) -> None:
    seen: dict[str, Recorded] = {}
    for one in recorded:
        digest = one.result.provenance.input_sha256
        if digest in seen:
            raise InputError(f"{one.path}: is of the same log as {seen[digest].path}; its information would count twice. Name it once")
        seen[digest] = one


def _check_exact(recorded: Sequence[Recorded]) -> None:
    """What is uncertain of jets and IMU is the same in all logs, and no result says how each of its values follows it."""
    for one in recorded:
        uncertain = [assumption.code for assumption in one.result.assumptions if assumption.code.startswith("uncertain-")]
        if len(recorded) > 1 and uncertain:
            raise InputError(
                f"{one.path}: its sigmas hold an uncertain geometry ({', '.join(dict.fromkeys(uncertain))}), which all logs have in common "
                "and which would count as if it were another in each; estimate them without the sigmas of jets and imu to combine them"
            )


def _chosen(one: Recorded, side: str) -> PhaseItem:
    """The only phase, or the one that the result's own docked object names."""
    phases, docked = one.result.phases, one.result.docked_object
    if len(phases) == 1:
        return phases[0]
    name = None if docked is None else docked.before if side == "before" else docked.after
    for phase in phases:
        if phase.name == name:
            return phase
    raise InputError(
        f"{one.path}: has phases {', '.join(p.name for p in phases)}, and does not say which is {side} docking; "
        "estimate it with [docking] in the vehicle file, or each phase for itself"
    )


def _check_alike(recorded: Sequence[Recorded], bearing: bool) -> None:
    first = recorded[0]
    for one in recorded:
        made, vehicle, old = one.result.provenance.settings.get("estimator.method"), one.result.vehicle, first.result.vehicle
        if made == "thesis":
            raise InputError(f"{one.path}: was made by --method thesis, whose sigmas are no errors; make it again by the default")
        stated = {
            "vehicle": (vehicle.name, old.name),
            "environment": (vehicle.environment, old.environment),
            "thrust.scale_sigma": (vehicle.thrust_scale_sigma, old.thrust_scale_sigma),
            "inertia about": (one.result.conventions.inertia_about, first.result.conventions.inertia_about),
            "products of inertia": (one.result.conventions.products_of_inertia, first.result.conventions.products_of_inertia),
        }
        if bearing:
            stated["bearing mass [kg]"] = (vehicle.bearing_mass_kg, old.bearing_mass_kg)
        for what, (mine, theirs) in stated.items():
            if mine != theirs:
                raise InputError(
                    f"{one.path}: {what} is {mine!r}, and {theirs!r} in {first.path}; they are not of one vehicle. Combine results of one"
                )


def _piece(part: Part) -> Piece:
    values = np.array([np.nan if e.value is None or e.sigma is None else e.value for e in part.phase.estimates.values()])
    covariance = np.array(part.phase.covariance, dtype=float)
    return Piece(part.label, values, covariance, part.phase.known, part.recorded.result.vehicle.thrust_scale_sigma)


def _phase(name: str, parts: Sequence[Part]) -> tuple[PhaseItem, list[WarningItem]]:
    found = joint([_piece(part) for part in parts])
    bearing = parts[0].recorded.result.vehicle.bearing_mass_kg
    notes = _contradictions(name, parts, found)
    estimates = {quantity: _estimate(i, quantity, parts, found) for i, quantity in enumerate(QUANTITIES)}
    duration = sum(part.phase.end_s - part.phase.start_s for part in parts)
    phase = Phase(name=name, start_s=0.0, end_s=duration)
    plain = {quantity: Estimate(item.value, item.sigma, item.unit, item.verdict, None, item.reason) for quantity, item in estimates.items()}
    whole = Conclusion(phase, plain, found.covariance, float(found.values[9]) - bearing, (found.values, found.covariance))
    known = bool(np.isfinite(whole.principal_moments).all())
    note = physical_note(whole)
    about = whole.inertia_about_origin
    contradicted = any(item.verdict == "contradicted" for item in estimates.values())
    item = PhaseItem(
        name=name,
        start_s=0.0,
        end_s=duration,
        estimates=estimates,
        covariance=_matrix(found.covariance),
        inertia_about_origin=_matrix(about) if np.isfinite(about).all() else None,
        physical=Physical(
            consistent=not note if known else None,
            principal_moments=[float(moment) for moment in whole.principal_moments] if known else None,
            note=note,
            nearest_consistent=_matrix(nearest_consistent(whole.inertia)) if note else None,
        ),
        innovations=None,
        contradiction="; ".join(note.message for note in notes) if contradicted else "",
        known={quantity: pair for part in parts for quantity, pair in part.phase.known.items()},
    )
    return item, notes


def _contradictions(name: str, parts: Sequence[Part], found: Joint) -> list[WarningItem]:
    notes = []
    for part, apart in zip(parts, found.apart, strict=True):
        strange = [f"{quantity} by {z:+.3g} sigma" for quantity, z in zip(QUANTITIES, apart, strict=True) if abs(z) > BEYOND]
        if strange:
            message = f"phase {name}: {part.label} differs from the others together: {', '.join(strange)}; was the vehicle the same?"
            notes.append(WarningItem(code="results-disagree", message=message))
    chance = _chance(found.chi_square, found.freedom)
    if not notes and chance < CHANCE:
        message = f"phase {name}: the results scatter more than their sigmas allow (chi-square {found.chi_square:.4g} of {found.freedom})"
        notes.append(WarningItem(code="results-disagree", message=message))
    return notes


def _chance(chi_square: float, freedom: int) -> float:
    """Of as much or more, by chance alone."""
    from scipy.special import gammaincc

    return float(gammaincc(freedom / 2, chi_square / 2)) if freedom > 0 else 1.0


def _estimate(i: int, quantity: str, parts: Sequence[Part], found: Joint) -> EstimateItem:
    value, variance = found.values[i], found.covariance[i, i]
    told = bool(np.isfinite(value) and variance > 0)
    own = [part.phase.estimates[quantity].verdict for part in parts]
    sigma = math.sqrt(variance) if told else None
    verdict, reason = _verdict(i, own, found, sigma)
    bad = [part.label for part, apart in zip(parts, found.apart, strict=True) if abs(apart[i]) > BEYOND]
    bad += [part.label for part, one in zip(parts, own, strict=True) if one == "contradicted"]
    if bad:
        verdict, reason = "contradicted", f"contradicted by or in {', '.join(dict.fromkeys(bad))}"
    return EstimateItem(
        value=float(value) if told else None, sigma=sigma, unit=UNITS[quantity], verdict=verdict, final_at_s=None, reason=reason
    )


def _verdict(i: int, own: Sequence[Verdict], found: Joint, sigma: float | None) -> tuple[Verdict, str]:
    if all(one == "unobservable" for one in own):
        return "unobservable", "no motion of this vehicle could tell it in any of the logs"
    # a moment of inertia that nothing told, as on a table, adds nothing to the body's size
    size = natural_sizes(np.concatenate([np.nan_to_num(found.values[:6]), found.values[6:]]))[i]
    if sigma is None or not sigma <= INFORMED * size:
        return "not_excited", "no log's motion told it, nor do all together"
    if "converged" in own or sigma < SETTLED / 4 * size:
        return (
            "converged",
            f"{own.count('converged')} of {len(own)} logs converged; together ± {100 * sigma / size:.2g} % of its natural size",
        )
    return "not_converged", "informed, but converged in no log, and together above a quarter of the tolerance"


def _docked(alone: Sequence[Part], single: PhaseItem, joined: Sequence[Part], combined: PhaseItem) -> DockedObject:
    """Combined less alone, with one thrust scale for both; each rotating mass is without its bearing's."""
    bearings = [side[0].recorded.result.vehicle.bearing_mass_kg for side in (alone, joined)]
    scale = alone[0].recorded.result.vehicle.thrust_scale_sigma
    values, joint_covariance = np.empty(20), np.zeros((20, 20))
    for half, phase in enumerate((single, combined)):
        part = slice(10 * half, 10 * half + 10)
        values[part] = [np.nan if item.value is None else item.value for item in phase.estimates.values()]
        joint_covariance[part, part] = np.array(phase.covariance, dtype=float)
    if not single.known and not combined.known:
        # known values calibrate each side's scale for itself; without, it is common
        scaled = np.array([value if name not in CG else 0.0 for value, name in zip(values, (*QUANTITIES, *QUANTITIES), strict=True)])
        joint_covariance[:10, 10:] = scale**2 * np.outer(scaled[:10], scaled[10:])
        joint_covariance[10:, :10] = joint_covariance[:10, 10:].T
    values[[9, 19]] -= bearings
    found = docking.difference(values[:10], values[10:])
    slope = docking.difference_slope(values[:10], values[10:])
    covariance = slope @ joint_covariance @ slope.T
    told = bool(np.isfinite(found).all() and np.isfinite(covariance).all())
    verdicts = [item.verdict for phase in (single, combined) for item in phase.estimates.values()]
    verdict: Verdict = "contradicted" if "contradicted" in verdicts else "converged" if set(verdicts) == {"converged"} else "not_converged"
    reason = {"converged": "both sides converged", "contradicted": "a side is contradicted"}.get(
        verdict, "not every quantity of both sides converged"
    )
    estimates = {
        name: EstimateItem(
            value=float(found[i]) if told else None,
            sigma=float(np.sqrt(covariance[i, i])) if told else None,
            unit=UNITS[name],
            verdict=verdict,
            final_at_s=None,
            reason=reason,
        )
        for i, name in enumerate(QUANTITIES)
    }
    contradiction = "; ".join(f"phase {phase.name}: {phase.contradiction}" for phase in (single, combined) if phase.contradiction)
    return DockedObject(
        before=single.name, after=combined.name, estimates=estimates, covariance=_matrix(covariance), contradiction=contradiction
    )


def _result(
    recorded: Sequence[Recorded], names: Sequence[str], phases: list[PhaseItem], docked: DockedObject | None, notes: list[WarningItem]
) -> Result:
    first, logs = recorded[0].result, [one.result.log for one in recorded]
    digest = hashlib.sha256("".join(sorted(one.sha256 for one in recorded)).encode()).hexdigest()
    delays = {one.result.delay.cycles for one in recorded}
    if any(float(one.result.provenance.settings.get("cycle.command_delay_sigma_cycles", 0.0) or 0.0) > 0 for one in recorded):
        message = "the command delay's uncertainty counts as if each log had its own; if it is one and the same, sigmas are too small"
        notes.append(WarningItem(code="delay-shared", message=message))
    if len(delays) > 1:
        notes.append(
            WarningItem(
                code="delays-differ", message=f"the logs were taken with delays of {', '.join(f'{d:g}' for d in sorted(delays))} cycles"
            )
        )
    told = [
        WarningItem(code=warning.code, message=f"{name}: {warning.message}")
        for name, one in zip(names, recorded, strict=True)
        for warning in one.result.warnings
    ]
    provenance = first.provenance.model_copy(
        update={
            "massprop": __version__,
            "input_sha256": digest,
            "settings": {"estimator.method": "default", "combined": list(names)},
            "setting_sources": {},
            "versions": {"python": platform.python_version(), "numpy": np.__version__},
        }
    )
    log = first.log.model_copy(
        update={
            "path": f"{len(recorded)} logs",
            "rows": sum(one.rows for one in logs),
            "cycles": sum(one.cycles for one in logs),
            "duration_s": sum(one.duration_s for one in logs),
        }
    )
    update = {
        "provenance": provenance,
        "log": log,
        "phases": phases,
        "docked_object": docked,
        "expectations": None,
        "mended": [],
        "assumptions": [],
        "warnings": [*notes, *told],
    }
    return Result.model_validate(first.model_copy(update=update).model_dump(by_alias=True))


def _matrix(values: Array) -> list[list[float | None]]:
    return [[float(cell) if np.isfinite(cell) else None for cell in row] for row in values]


def write(folder: Path, found: Result, paths: Sequence[Path]) -> None:
    """result.json and run.json, whole; never over the result of a log."""
    if (folder / "history.parquet").exists():
        raise InputError(f"{folder}: holds the result of a log, with its history; choose another folder with --out")
    run = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "host": platform.node(), "combined": [str(path) for path in paths]}
    try:
        with files.held(folder), files.staged(folder) as stage:
            stage.save(rendered.RUN, partial(files.save_text, content=rendered.run_text(run, {})))
            stage.save("result.json", partial(files.save_text, content=results.to_json(found)))
            rendered.clear(folder)
            stage.place()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); choose another folder with --out") from None
