"""What is told of a campaign while it runs: a bar with the time left on a terminal, else a line per log in the campaign's order."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from massprop_cli.cli.terminal import say

if TYPE_CHECKING:
    from massprop_cli.campaign.plan import Job
    from massprop_cli.campaign.run import Step, Told


@contextmanager
def steps(jobs: Sequence[Job], quiet: bool) -> Iterator[Told | None]:
    """Hears of each log; silent if ``quiet``."""
    if quiet:
        yield None
        return
    lines = _Lines(jobs)
    if not sys.stderr.isatty():
        yield lines.told
        lines.rest()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(compact=True))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("logs", total=len(jobs))
        failed = 0

        def told(step: Step) -> None:
            nonlocal failed
            failed += bool(step.outcome.exit_code)
            bar.update(task, advance=1, description=f"logs, {failed} failed" if failed else "logs")
            if step.outcome.exit_code:
                lines.say(step)

        yield told


class _Lines:
    """One line per log. A log that is done before those that go before it waits for them, so that the order is always the same."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._jobs = jobs
        self._next = 0
        self._waiting: dict[int, Step] = {}

    def told(self, step: Step) -> None:
        self._waiting[step.index] = step
        while self._next in self._waiting:
            self.say(self._waiting.pop(self._next))
            self._next += 1

    def rest(self) -> None:
        """Those whose turn did not come, after --fail-fast."""
        for _, step in sorted(self._waiting.items()):
            self.say(step)

    def say(self, step: Step) -> None:
        from massprop_cli.campaign.outcome import state

        job, found = self._jobs[step.index], step.outcome
        doubts = f" ({', '.join(dict.fromkeys(found.warnings))})" if found.warnings else ""
        what = f"exit {found.exit_code}: {found.message}" if found.exit_code else f"{state(found)}{doubts}"
        kept = ", unchanged" if step.kept else ""
        say(f"[{step.index + 1}/{len(self._jobs)}] {job.name}{kept}: {what}")
