"""Combination of several results of one vehicle into one, phase by phase."""

import hashlib
import platform
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np

from massprop_cli import __version__
from massprop_cli.base import escape, files
from massprop_cli.base.errors import InputError
from massprop_cli.combine import assumed, logs, pivot, twice
from massprop_cli.combine.joint import docked_object, negative_mass_warnings
from massprop_cli.combine.phase import Part, Phased, by_object, gathered, phased
from massprop_cli.diagnosis.preprocessing import Ready
from massprop_cli.result import rendered
from massprop_cli.result.read import MEMBERS, Recorded, check_same, labels
from massprop_cli.result.schema import DockedObject, PhaseItem, Result, WarningItem

MISFIT = ("cause-unknown", "contradicted", "model-discrepancy", "disturbance-torque", "gyro-misfit", "accelerometer-misfit", "model-misfit")
"""Codes of misfit warnings, omitted for a log that the joint fit explains."""


def together(recorded: Sequence[Recorded], ready: Callable[[Recorded], Ready] = logs.of_result) -> Result:
    """Combine results of one vehicle; ``ready`` preprocesses the log of a result.

    :class:`InputError` if the results are of different vehicles, have different phases, or include a log twice.
    """
    twice.refuse(recorded)
    names = labels(recorded)
    _check_alike(recorded, bearing=True)
    own = [[phase.name for phase in one.result.phases] for one in recorded]
    if any(phases != own[0] for phases in own):
        other = next(i for i, phases in enumerate(own) if phases != own[0])
        raise InputError(
            f"{recorded[other].path}: has phases {', '.join(own[other])}, and {recorded[0].path} {', '.join(own[0])}; combine results with "
            "the same phases, or name those before and after docking by --before and --after"
        )
    parts = [
        [Part(label, one, one.result.phases[i], partial(ready, one)) for label, one in zip(names, recorded, strict=True)]
        for i in range(len(own[0]))
    ]
    return _result(recorded, names, [phased(gathered(own[0][i], part)) for i, part in enumerate(parts)], None)


def together_docked(
    before: Sequence[Recorded],
    after: Sequence[Recorded],
    ready: Callable[[Recorded], Ready] = logs.of_result,
    added: str | None = None,
) -> Result:
    """Combine results of the vehicle alone and with an object, and compute the object; ``added`` states it as a calibration."""
    # a log may be on both sides with different phases
    for side in (before, after):
        twice.refuse(side)
    recorded = [*before, *after]
    names = labels(recorded)
    _check_alike(recorded, bearing=False)
    for side in (before, after):
        _check_alike(side, bearing=True)
    sided = [*("before" for _ in before), *("after" for _ in after)]
    parts = [Part(label, one, _chosen(one, side), partial(ready, one)) for label, one, side in zip(names, recorded, sided, strict=True)]
    alone, joined = parts[: len(before)], parts[len(before) :]
    twice.refuse_across(*([(part.recorded, part.phase) for part in side] for side in (alone, joined)))
    both = gathered("before", alone), gathered("after", joined)
    if added is not None:
        found, docked = by_object(*both, added)
        result = _result(recorded, names, found, docked)
        result.provenance.settings["added"] = added
        return result
    single, combined = map(phased, both)
    docked = docked_object((alone[0].vehicle, joined[0].vehicle), single.item, combined.item)
    return _result(recorded, names, [single, combined], docked)


def _chosen(one: Recorded, side: str) -> PhaseItem:
    """The only phase of a result, or the one that its docked object names."""
    phases, docked = one.result.phases, one.result.docked_object
    if len(phases) == 1:
        return phases[0]
    name = None if docked is None else docked.before if side == "before" else docked.after
    for phase in phases:
        if phase.name == name:
            return phase
    raise InputError(
        f"{one.path}: has phases {', '.join(p.name for p in phases)}, and does not state which is {side} docking; estimate it again with "
        "[docking] in the vehicle file, or each phase separately"
    )


def _check_alike(recorded: Sequence[Recorded], bearing: bool) -> None:
    """Raise :class:`InputError` unless all results have the same vehicle (``bearing``: and bearing mass) and the default method."""
    pivot.refuse(recorded)
    first = recorded[0]
    what = ["vehicle", "environment", "thrust.scale_sigma", "inertia about", "products of inertia", *["bearing mass [kg]"] * bearing]
    for one in recorded:
        if one.result.provenance.method == "thesis":
            raise InputError(
                f"{one.path}: was made with --method thesis, whose sigmas are not errors; estimate again with --method default"
            )
        check_same(
            one.path, one.result, str(first.path), first.result, what, "the results are not of one vehicle. Combine results of one vehicle"
        )


def _result(recorded: Sequence[Recorded], names: Sequence[str], found: Sequence[Phased], docked: DockedObject | None) -> Result:
    notes = [*negative_mass_warnings(docked), *(note for one in found for note in one.notes)]
    explained = frozenset(names) & frozenset.intersection(*(one.explained for one in found))
    first, logs = recorded[0].result, [one.result.log for one in recorded]
    digest = hashlib.sha256("".join(sorted(one.sha256 for one in recorded)).encode()).hexdigest()
    members = sorted({log for one in recorded for log in twice.logs(one.result)})
    delays = {one.result.delay.cycles for one in recorded}
    if any(float(one.result.provenance.settings.get("cycle.command_delay_sigma_cycles", 0.0) or 0.0) > 0 for one in recorded):
        message = (
            "the joint estimate assumes an independent delay error in each log; if all logs share one delay error, sigmas are too small"
        )
        notes.append(WarningItem(code="delay-shared", message=message))
    if len(delays) > 1:
        message = f"the results use different command delays: {', '.join(f'{d:g}' for d in sorted(delays))} cycles"
        notes.append(WarningItem(code="delays-differ", message=message))
    log_warnings = [
        WarningItem(code=warning.code, message=f"{name}: {warning.message}")
        for name, one in zip(names, recorded, strict=True)
        for warning in one.result.warnings
        if name not in explained or warning.code not in MISFIT
    ]
    provenance = first.provenance.model_copy(
        update={
            "massprop": __version__,
            "input_sha256": digest,
            "settings": {"estimator.method": "default", "combined": list(names), MEMBERS: members},
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
        "phases": [one.item for one in found],
        "docked_object": docked,
        "expectations": None,
        "low_passes": [],
        "mended": [],
        "assumptions": assumed.together(found),
        "warnings": [*notes, *log_warnings],
    }
    return Result.model_validate(first.model_copy(update=update).model_dump(by_alias=True))


def write(folder: Path, found: Result, paths: Sequence[Path]) -> None:
    """Write result.json and run.json; :class:`InputError` if the folder has the result of a log."""
    if (folder / "history.parquet").exists():
        raise InputError(f"{folder}: holds the result of a log, with its history; choose another folder with --out")
    run = {"time": datetime.now(UTC).isoformat(timespec="seconds"), "host": platform.node(), "combined": [str(path) for path in paths]}
    with files.staged(folder) as stage:
        stage.save(rendered.RUN, rendered.run_text(run, {}))
        stage.save("result.json", escape.document(found))
        rendered.clear(folder)
        stage.place()
