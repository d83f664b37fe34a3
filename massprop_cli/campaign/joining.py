"""Combined results of a campaign, as its file requests them: selection of the logs, and combination as in `massprop combine`."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from massprop_cli.base import escape, exits, foldername
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.escape import line
from massprop_cli.campaign import campaignfile, location, outcome, work
from massprop_cli.campaign.outcome import Outcome
from massprop_cli.campaign.place import RESULTS, Place
from massprop_cli.campaign.plan import Job
from massprop_cli.campaign.work import Produced
from massprop_cli.inputs.require import Requirement

if TYPE_CHECKING:
    from massprop_cli.diagnosis.preprocessing import Ready
    from massprop_cli.inputs.vehiclefile import VehicleSource
    from massprop_cli.result.read import Recorded
    from massprop_cli.result.schema import Result


@dataclass(frozen=True)
class Joining:
    """Logs for one combined result: either ``logs``, or those ``before`` and ``after`` docking."""

    name: str
    logs: tuple[Job, ...]
    before: tuple[Job, ...]
    after: tuple[Job, ...]
    require: tuple[Requirement, ...]
    added: str | None = None

    @property
    def allow_contradicted(self) -> bool:
        """Whether a contradiction is accepted: any of the logs accepts it."""
        return any(job.settings.allow_contradicted for job in self.jobs)

    @property
    def jobs(self) -> tuple[Job, ...]:
        """The jobs of all logs."""
        return (*self.logs, *self.before, *self.after)


def joinings(named: Sequence[str], jobs: Sequence[Job]) -> list[Joining]:
    """The combined results that the campaign files among ``named`` request.

    Raise :class:`InputError` if a name is in use or a pattern matches too few logs.
    """
    requested: list[Joining] = []
    taken = {foldername.same(job.name): f"a log's ({job.shown})" for job in jobs}
    for place in named:
        if not place.lower().endswith(".toml") or Path(place).is_dir():
            continue
        base = location.folder(place)
        below = [(job, location.below(job.log, base)) for job in jobs]
        for number, stated in enumerate(campaignfile.load(place).combine):
            where = f"{place}: combine.{number}"
            name = foldername.safe(stated.name)
            if foldername.same(name) in taken:
                raise InputError(f"{where}.name = {stated.name!r}: is {taken[foldername.same(name)]} already; choose another")
            taken[foldername.same(name)] = f"combine.{number}'s"
            sides = {key: _matching(below, getattr(stated, key), f"{where}.{key}") for key in ("logs", "before", "after")}
            if len(sides["logs"]) == 1:
                raise InputError(f"{where}.logs = {list(stated.logs)}: matches only one log, {sides['logs'][0].shown}; name two or more")
            requested.append(Joining(name, **sides, require=stated.require or (), added=stated.added))
    return requested


def _matching(below: Sequence[tuple[Job, str]], patterns: tuple[str, ...], where: str) -> tuple[Job, ...]:
    """The jobs whose path below the campaign file's folder matches a pattern."""
    matches = tuple(job for job, path in below if campaignfile.matches(patterns, path))
    if patterns and not matches:
        raise InputError(f"{where} = {list(patterns)}: matches none of the {len(below)} logs; correct the pattern")
    return matches


def joined(one: Joining, place: Place) -> Produced:
    """Combine the logs into a result folder and an outcome; logs that cannot be combined give exit code 3."""
    from massprop_cli import job as judge
    from massprop_cli.campaign import kept

    try:
        result = _combined(one, place)
    except InputError as error:
        return Produced(Outcome(fingerprint=outcome.UNKEPT, exit_code=exits.INPUT, message=line(str(error)), input_sha256=None))
    unmet = judge.unmet(result, judge.Demands(one.require, allow_contradicted=one.allow_contradicted))
    combined = kept.of_result(result, unmet, kept.joint_bodies(result), ["result.json"], "combined")
    return Produced(combined, {"result.json": escape.document(result).encode()})


def _combined(one: Joining, place: Place) -> Result:
    """The combined result; raise :class:`InputError` if the logs cannot be combined."""
    import numpy as np

    from massprop_cli.combine import flow

    recorded = {job.name: _recorded(job, place) for job in one.jobs}
    jobs = {job.name: job for job in one.jobs}

    def ready(result: Recorded) -> Ready:
        return _ready(jobs[result.name], result.result)

    with np.errstate(all="ignore"):
        if one.logs:
            return flow.together([recorded[job.name] for job in one.logs], ready)
        before, after = ([recorded[job.name] for job in side] for side in (one.before, one.after))
        return flow.together_docked(before, after, ready, one.added)


def _recorded(job: Job, place: Place) -> Recorded:
    """Read a log's result from the campaign; raise :class:`InputError` if there is none."""
    from massprop_cli.result.read import Recorded, result_of

    where = f"{RESULTS}/{job.name}/result.json"
    try:
        content = place.read(where)
    except FileNotFoundError:
        raise InputError(f"{job.shown}: has no result to combine; see its own row") from None
    try:
        result = result_of(content.decode("utf-8", "replace"), where)
    except InputError as error:
        raise InputError(f"{error} (massprop batch --force)") from None
    return Recorded(Path(where), result, {}, hashlib.sha256(content).hexdigest())


def _ready(job: Job, result: Result) -> Ready:
    """Preprocess the log of a result again."""
    from massprop_cli.combine import logs

    inputs = work.gather(job)
    table = work.table_of(job, inputs)

    def vehicle(given: list[str]) -> VehicleSource:
        stated = replace(job, settings=replace(job.settings, assignments=tuple(given)))
        return work.vehicle_of(stated, inputs, table.embedded_vehicle)

    return logs.of_table(result, table, vehicle)
