"""``massprop batch``."""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from massprop_cli.base import exits
from massprop_cli.base.errors import UsageError
from massprop_cli.cli import options
from massprop_cli.cli.guard import check_junit, fail, folder_of_its_own, guarded, put_junit
from massprop_cli.cli.terminal import console, put, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from massprop_cli.campaign.plan import Job
    from massprop_cli.campaign.summary import Summary


CHECKS = "checks"
"""Subfolder of the campaign folder for --check."""
_RUN = "Execution"


@guarded
def batch(
    context: typer.Context,
    paths: Annotated[
        list[str],
        typer.Argument(metavar="PATH...", help="Logs, folders (recursive), globs, campaign files; also as URLs.", show_default=False),
    ],
    out: Annotated[
        str, options.option("Campaign folder or URL.", options.OUTPUT, metavar="FOLDER", envvar="MASSPROP_OUT")
    ] = "massprop-out",
    jobs: Annotated[
        int | None, options.option("Number of processes (default: one per core).", _RUN, min=1, envvar="MASSPROP_JOBS", metavar="N")
    ] = None,
    cluster: Annotated[
        str | None,
        options.option("Run on the workers of this dask scheduler, tcp://HOST:PORT.", _RUN, metavar="ADDRESS", envvar="MASSPROP_CLUSTER"),
    ] = None,
    force: Annotated[bool, options.option("Estimate all logs again, also unchanged ones.", _RUN, "--force")] = False,
    fail_fast: Annotated[bool, options.option("Stop at the first log whose exit code is not 0.", _RUN, "--fail-fast")] = False,
    vehicle: Annotated[
        str | None, options.option("Vehicle file (TOML) of all logs.", options.INPUT, metavar="FILE", envvar="MASSPROP_VEHICLE")
    ] = None,
    map_file: Annotated[
        str | None, options.option("Map file (TOML) of all logs.", options.INPUT, "--map", metavar="FILE", envvar="MASSPROP_MAP")
    ] = None,
    method: options.Method = None,
    delay: options.Delay = None,
    assign: options.Assign = None,
    require: Annotated[
        str | None,
        options.option(
            "Exit 4 unless these converge with this precision in every phase of every log ('all').",
            options.DEMANDS,
            metavar="ixx,mass<2%,...",
        ),
    ] = None,
    expect: Annotated[
        str | None, options.option("Expected values (TOML, JSON or a truth.json); exit 5 unless met.", options.DEMANDS, metavar="FILE")
    ] = None,
    baseline: Annotated[
        str | None,
        options.option("campaign.json of an earlier campaign (file or URL); exit 5 if results differ.", options.DEMANDS, metavar="FILE"),
    ] = None,
    max_sigma: Annotated[
        float, options.option("Allowed difference from the baseline, in sigmas.", options.DEMANDS, min=0, metavar="SIGMAS")
    ] = 4.0,
    tolerance: Annotated[
        Path | None, options.option("Allowed difference from the baseline, by quantity.", options.DEMANDS, metavar="FILE")
    ] = None,
    allow_contradicted: options.AllowContradicted = False,
    junit: options.Junit = None,
    check: Annotated[
        bool, options.option("Only check each log, like massprop check; writes FOLDER/checks.", options.OUTPUT, "--check")
    ] = False,
    report: Annotated[bool, options.option("Render report.html for each log (1 to 2 s each).", options.OUTPUT, "--report")] = False,
    as_json: Annotated[bool, options.as_json("campaign.json")] = False,
    quiet: Annotated[bool, options.quiet("No table, no line per log.")] = False,
    no_color: options.NoColor = False,
) -> None:
    """Estimate a campaign of logs in parallel. After an interrupt, run the command again to continue.

    Writes results/NAME for each log, campaign.html, campaign.parquet and campaign.json. Skips logs whose content, vehicle file, settings
    and massprop version did not change. A failed log is a row with its error. With --check, check.json of each log in FOLDER/checks has its
    findings and expected sigmas, without values. Exit code: the worst of all logs. 1: bug; 3: unusable input; 4: a required quantity is not
    converged; 5: not as expected, or beyond the baseline; 6: log and vehicle file contradict each other.

    Examples:
        massprop batch flights --junit massprop.junit.xml
        massprop batch flights --require all --baseline massprop-out/campaign.json
        massprop batch "flights/*/log.parquet" --jobs 2 --report --out review
    """
    source = context.get_parameter_source("jobs")
    if cluster is not None and source is not None and source.name == "COMMANDLINE":
        raise UsageError(f"--jobs {jobs}: is for this machine; with --cluster its workers decide how many logs run at a time")
    from massprop_cli.inputs.require import requirements

    required = requirements(require)
    options.check_sigmas(max_sigma)
    if check:
        _without_values({"--expect": expect, "--baseline": baseline, "--report": report or None})
    from massprop_cli.campaign import location, urlplace
    from massprop_cli.campaign.place import LocalPlace

    # a check replaces no result
    out = location.join(out, CHECKS) if check else out
    folder = urlplace.at(out)
    folder_of_its_own(folder.folder if isinstance(folder, LocalPlace) else None)
    check_junit(junit)
    assignments = options.assignments(context, {"method": method, "delay": delay}, assign)
    from massprop_cli.campaign import baseline as baselines
    from massprop_cli.campaign import discover, joining, run, summary
    from massprop_cli.campaign import junit as suites
    from massprop_cli.campaign.cluster import ClusterExecutor
    from massprop_cli.campaign.plan import Settings
    from massprop_cli.campaign.runner import LocalExecutor
    from massprop_cli.cli.terminal import steps
    from massprop_cli.inputs import tolerancefile

    over = Settings(
        vehicle=vehicle,
        map=map_file,
        assignments=tuple(assignments),
        expect=expect,
        require=required,
        report=report,
        check=check,
        allow_contradicted=allow_contradicted,
    )
    name, planned = discover.plan(paths, over)
    _check(planned)
    wanted = [] if check else joining.joinings(paths, planned)
    earlier = baselines.read(baseline) if baseline is not None else None
    allowed = tolerancefile.load(tolerance, max_sigma)
    if earlier is not None:
        allowed.check(baselines.phases(earlier))
    against = None if earlier is None else partial(baselines.compare, earlier=earlier, gate=allowed)
    executor = LocalExecutor(jobs) if cluster is None else ClusterExecutor(cluster)
    # Ctrl-C then stops the workers and releases the store's lock
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with folder.lock():
        try:
            with steps(planned, quiet) as told:
                found = run.campaign(
                    name, planned, folder, executor, force=force, fail_fast=fail_fast, baseline=against, told=told, joinings=wanted
                )
        except KeyboardInterrupt:
            fail(f"interrupted; finished results are in {out}; run the same command to continue", exits.INTERRUPTED)
        if junit is not None:
            put_junit(junit, suites.text(folder, found))
    _report_to_github(found)
    if as_json:
        sys.stdout.writelines(summary.to_json(found))
    elif not quiet:
        from massprop_cli.campaign import terminal

        terminal.show(found, console(no_color))
        put(location.join(out, "campaign.html"))
    _exit(found)


def _without_values(given: dict[str, object]) -> None:
    """Raise :class:`UsageError` for an option that needs values, which a check does not give."""
    for option, value in given.items():
        if value is not None:
            raise UsageError(f"{option}: a check gives no values; leave it out, or run batch without --check")


def _check(planned: Sequence[Job]) -> None:
    """Parse vehicle, map and expect files of the whole campaign first, because an error in one would fail each log."""
    from massprop_cli.campaign import location
    from massprop_cli.inputs import expect, vehiclefile

    for stated in dict.fromkeys(job.settings for job in planned):
        if stated.vehicle is not None:
            vehiclefile.parse(location.read_text(stated.vehicle, "vehicle file"), stated.vehicle, stated.assignments)
        if stated.map is not None:
            from massprop_cli.inputs.formats import mapfile

            mapfile.parse(location.read_text(stated.map, "map file"), stated.map)
        if stated.expect is not None:
            expect.parse(location.read_text(stated.expect, "expect file"), location.path(stated.expect))


def _report_to_github(found: Summary) -> None:
    """Write job summary and annotations on GitHub Actions."""
    file, actions = os.environ.get("GITHUB_STEP_SUMMARY"), os.environ.get("GITHUB_ACTIONS")
    if not file and actions != "true":
        return
    from massprop_cli.campaign import markdown

    if file:
        try:
            markdown.append_summary(Path(file), found)
        except OSError as error:
            say(f"warning: the job summary {file} cannot be written ({error.strerror or error})")
    if actions == "true":
        for line in markdown.commands(found):
            typer.echo(line, err=True)


def _exit(found: Summary) -> None:
    if found.exit_code == 0:
        return
    from massprop_cli.campaign import page

    failed, joint = (sum(1 for one in some if one.outcome is not None and one.outcome.exit_code) for some in (found.logs, found.combined))
    beyond = len(found.baseline.beyond) if found.baseline else 0
    parts = [f"{failed} of {len(found.logs)} logs failed ({page.counts(found)})"] if failed else []
    parts += [f"{joint} of {len(found.combined)} combined results failed"] if joint else []
    parts += (
        [f"{beyond} beyond the baseline: {'; '.join(item.message for item in found.baseline.beyond[:3])}"]
        if found.baseline and beyond
        else []
    )
    fail("; ".join(parts) + ("; and more" if beyond > 3 else ""), found.exit_code or exits.NOT_EXPECTED)
