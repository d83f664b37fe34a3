"""The composed flow: what is there already is kept, the rest is worked and put in place one by one, then come the tables."""

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
    """One log is done."""

    index: int
    """Of its job."""
    outcome: Outcome
    kept: bool
    """It was there already, and nothing has changed."""


Told = Callable[[LogDone], None]


def work(
    jobs: Sequence[Job], place: Place, executor: Executor, *, force: bool = False, fail_fast: bool = False, told: Told | None = None
) -> CompressedRows:
    """Work all jobs, in a place whose lock is held; a row for each in their order, without an outcome for those not tried.

    A result whose fingerprint holds is kept, unless ``force``; ``fail_fast``: the first exit code ends it; ``told`` hears of each log.
    """
    found = CompressedRows(row(job, None) for job in jobs)
    kept = {} if force else _kept(jobs, place)
    tasks = [Task(job, None if n not in kept else kept[n][0]) for n, job in enumerate(jobs)]
    with closing(executor.run(tasks)) as results:  # type: ignore[type-var]
        for index, produced in results:
            if produced is not None:
                place.put_folder(jobs[index].name, produced.files)
            one = outcome.unpacked(Outcome, kept[index][1]) if produced is None else produced.outcome
            found[index] = row(jobs[index], one)
            if told is not None:
                told(LogDone(index, one, produced is None))
            if fail_fast and one.exit_code:
                break
    return found


def _joined(one: Joining, place: Place) -> CampaignRow:
    produced = joining.joined(one, place)
    place.put_folder(one.name, produced.files)
    return CampaignRow(name=one.name, log=", ".join(job.shown for job in one.jobs), tags=["combined"], outcome=produced.outcome)


def _kept(jobs: Sequence[Job], place: Place) -> dict[int, tuple[str, bytes]]:
    """Fingerprints and packed outcomes of the whole results that are in place, by the index of their job."""
    there = place.folders()
    found = {}
    for index, job in enumerate(jobs):
        if outcome.FILE in there.get(job.name, ()):
            one = outcome.from_json(place.read(f"{RESULTS}/{job.name}/{outcome.FILE}"))
            if one is not None and one.fingerprint != outcome.UNKEPT and there[job.name] >= set(one.files):
                found[index] = one.fingerprint, outcome.packed(one)
    return found


def campaign(
    name: str,
    jobs: Sequence[Job],
    place: Place,
    executor: Executor,
    *,
    force: bool = False,
    fail_fast: bool = False,
    baseline: Callable[[CompressedRows], Baseline] | None = None,
    told: Told | None = None,
    joinings: Sequence[Joining] = (),
) -> Summary:
    """Work all jobs, combine, and write the campaign's tables and page, campaign.json last; the place's lock is held."""
    from massprop_cli.campaign import page, parquet

    rows = work(jobs, place, executor, force=force, fail_fast=fail_fast, told=told)
    combined = [_joined(one, place) for one in joinings]
    found = summary.summary(name, rows, None if baseline is None else baseline(rows), combined)
    place.put_file("campaign.parquet", [parquet.parquet(found)])
    place.put_file("campaign.csv", map(str.encode, parquet.csv_rows(found)))
    place.put_file("campaign.html", map(str.encode, page.page(found)))
    place.put_file("campaign.json", map(str.encode, summary.to_json(found)))
    return found
