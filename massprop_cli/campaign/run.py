"""Run of a campaign: keep valid results, process the other logs and write each result when it is ready, then write the tables."""

from collections.abc import Callable, Sequence
from contextlib import closing

from massprop_cli.base.dataclass import dataclass
from massprop_cli.campaign import joining, outcome, summary
from massprop_cli.campaign.joining import Joining
from massprop_cli.campaign.outcome import CampaignRow, CompressedRows, Outcome, row
from massprop_cli.campaign.place import RESULTS, Place
from massprop_cli.campaign.plan import Job
from massprop_cli.campaign.runner import Executor, Task
from massprop_cli.campaign.summary import Baseline, Summary


@dataclass(frozen=True)
class LogDone:
    """Report of one log whose outcome is in place."""

    index: int
    """Index of its job."""
    outcome: Outcome
    kept: bool
    """Whether an earlier result was valid and kept."""


OnLogDone = Callable[[LogDone], None]


def work(
    jobs: Sequence[Job], place: Place, executor: Executor, *, force: bool = False, fail_fast: bool = False, told: OnLogDone | None = None
) -> CompressedRows:
    """Process all jobs, in a locked place; a row per job in their order, without an outcome for a job not tried.

    A result with an unchanged fingerprint is kept, unless ``force``. With ``fail_fast``, the first exit code other than 0 ends the run.
    ``told`` is called after each log.
    """
    rows = CompressedRows(row(job, None) for job in jobs)
    kept = {} if force else _kept(jobs, place)
    tasks = [Task(job, None if n not in kept else kept[n][0]) for n, job in enumerate(jobs)]
    with closing(executor.run(tasks)) as results:  # type: ignore[type-var]
        for index, produced in results:
            if produced is not None:
                place.put_folder(jobs[index].name, produced.files)
            one = outcome.unpacked(Outcome, kept[index][1]) if produced is None else produced.outcome
            rows[index] = row(jobs[index], one)
            if told is not None:
                told(LogDone(index, one, produced is None))
            if fail_fast and one.exit_code:
                break
    return rows


def _joined(one: Joining, place: Place) -> CampaignRow:
    """Combine logs, write the result folder, and return its row."""
    produced = joining.joined(one, place)
    place.put_folder(one.name, produced.files)
    return CampaignRow(name=one.name, log=", ".join(job.shown for job in one.jobs), tags=["combined"], outcome=produced.outcome)


def _kept(jobs: Sequence[Job], place: Place) -> dict[int, tuple[str, bytes]]:
    """Fingerprints and packed outcomes of the complete results in the place, by the index of their job."""
    folders = place.folders()
    kept = {}
    for index, job in enumerate(jobs):
        if outcome.FILE in folders.get(job.name, ()):
            one = outcome.from_json(place.read(f"{RESULTS}/{job.name}/{outcome.FILE}"))
            if one is not None and one.fingerprint != outcome.UNKEPT and folders[job.name] >= set(one.files):
                kept[index] = one.fingerprint, outcome.packed(one)
    return kept


def campaign(
    name: str,
    jobs: Sequence[Job],
    place: Place,
    executor: Executor,
    *,
    force: bool = False,
    fail_fast: bool = False,
    baseline: Callable[[CompressedRows], Baseline] | None = None,
    told: OnLogDone | None = None,
    joinings: Sequence[Joining] = (),
) -> Summary:
    """Process all jobs, combine logs, and write the campaign's tables and page in a locked place; campaign.json is last."""
    from massprop_cli.campaign import page, parquet

    rows = work(jobs, place, executor, force=force, fail_fast=fail_fast, told=told)
    combined = [_joined(one, place) for one in joinings]
    whole = summary.summary(name, rows, None if baseline is None else baseline(rows), combined)
    place.put_file("campaign.parquet", [parquet.parquet(whole)])
    place.put_file("campaign.csv", map(str.encode, parquet.csv_rows(whole)))
    place.put_file("campaign.html", map(str.encode, page.page(whole)))
    place.put_file("campaign.json", map(str.encode, summary.to_json(whole)))
    return whole
