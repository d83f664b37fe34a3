"""massprop from Python: typed results, and pandas tables for notebooks.

>>> from massprop_cli import estimate_log, run_campaign
>>> found = estimate_log("sample_logs/free-flyer/log.parquet")
>>> found.result.phases[0].estimates["mass"].value          # the whole of result.json, typed
>>> found.table                                              # a row per phase and quantity
>>> found.history.plot(x="time_s", y="ixx")                  # a row per cycle
>>> campaign = run_campaign(["flights/", "bench/*.csv"], "campaign", jobs=2)
>>> campaign.table.groupby("vehicle")["mass"].describe()     # a row per log and phase
>>> campaign.pooled                                          # what each vehicle's logs say together

Units are SI, inertia is about the CG in body axes, products are tensor elements, the CG is from O.
"""

import io
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from massprop_cli.base import configfile
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import baseline as baselines
from massprop_cli.campaign import discover, joining, location, run, urlplace
from massprop_cli.campaign.cluster import ClusterExecutor
from massprop_cli.campaign.outcome import Outcome
from massprop_cli.campaign.plan import Settings
from massprop_cli.campaign.pooled import Pooled
from massprop_cli.campaign.run import LogDone
from massprop_cli.campaign.runner import LocalExecutor
from massprop_cli.campaign.summary import Summary
from massprop_cli.inputs import expect
from massprop_cli.inputs.require import requirements
from massprop_cli.inputs.tolerancefile import Gate
from massprop_cli.job import Demands, Judged, of_file
from massprop_cli.result import historyfile, judge

Where = str | Path
Delay = float | Literal["auto"]


@dataclass(frozen=True)
class LogEstimate(Judged):
    """One log, estimated: result, analysis, and what the command line would have ended with (exit_code, message)."""

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row per phase (or docked object) and quantity: value, sigma, unit, verdict, final_at_s, reason, expected, met."""
        rows = [
            {"phase": part.removeprefix("phase "), "quantity": name}
            | item.model_dump(include={"value", "sigma", "unit", "verdict", "final_at_s", "reason", "nominal"})
            | {"expected": item.expected.value if item.expected else None, "met": item.expected.met if item.expected else None}
            for part, body in judge.parts(self.result)
            for name, item in judge.items(body).items()
        ]
        return pd.DataFrame(rows).set_index(["phase", "quantity"])

    @cached_property
    def history(self) -> pd.DataFrame:
        """A row per cycle and phase: the columns of history.parquet, NaN where nothing can be said."""
        return pd.read_parquet(io.BytesIO(historyfile.content(self.analysis)))


@dataclass(frozen=True)
class Campaign:
    """Many logs, estimated; results are in ``folder``."""

    folder: str
    """Or URL."""
    summary: Summary
    """The whole of campaign.json."""

    @property
    def exit_code(self) -> int:
        """What the command line would have ended with."""
        return self.summary.exit_code

    @property
    def outcomes(self) -> dict[str, Outcome | None]:
        """By the name of the log: exit code, message, values. None: not tried."""
        return {row.name: row.outcome for row in self.summary.logs}

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row per log and phase, one with its message for each log without a result: the columns of campaign.parquet."""
        return pd.read_parquet(io.BytesIO(location.read(location.join(self.folder, "campaign.parquet"), "campaign.parquet")))

    @cached_property
    def pooled(self) -> pd.DataFrame:
        """A row per vehicle, phase and quantity: weighted mean, sigma, chi-square, p-value, trend, names of outliers."""
        columns = ["vehicle", "phase", "quantity", *Pooled.model_fields]
        rows = [
            {"vehicle": pool.vehicle, "phase": pool.name, "quantity": name}
            | dict(item)
            | {"outliers": [stray.log for stray in item.outliers]}
            for pool in self.summary.pooled
            for name, item in pool.items.items()
        ]
        return pd.DataFrame(rows, columns=columns).set_index(["vehicle", "phase", "quantity"])


def estimate_log(
    path: Where,
    vehicle: Where | None = None,
    *,
    method: Literal["default", "thesis"] | None = None,
    delay: Delay | None = None,
    refine: bool = False,
    expected: Where | None = None,
    require: str | Sequence[str] = (),
    allow_contradicted: bool = False,
    settings: Mapping[str, object] | None = None,
    map_file: Where | None = None,
) -> LogEstimate:
    """Estimate one log; writes nothing.

    ``vehicle`` names a vehicle file and ``map_file`` a map file (else the log's own), ``expected`` an expect file, ``require`` quantities
    that must converge ("all"), and how precisely ("mass<2%, ixx"). What misses either, or a log that contradicts its vehicle file (unless
    ``allow_contradicted``), doesn't raise, but stands in ``exit_code`` and ``message``. ``delay`` is in control cycles, ``settings`` holds
    dotted keys of the vehicle file, for instance ``{"imu.gyro_noise_rad_s": 1e-4}``. Where the input can't be used,
    :class:`massprop_cli.InputError` names file, place, value and remedy.
    """
    held = expect.load(Path(expected)) if expected is not None else None
    demands = Demands(requirements(require), held, allow_contradicted)
    stated = [*_assignments(method, delay, settings), *(["estimator.refine=true"] if refine else [])]
    found = of_file(
        Path(path), None if vehicle is None else Path(vehicle), stated, demands, map_file=None if map_file is None else Path(map_file)
    )
    return LogEstimate(found.result, found.analysis, found.unmet)


def run_campaign(
    paths: Where | Sequence[Where],
    out: Where = "massprop-out",
    *,
    jobs: int | None = None,
    cluster: str | None = None,
    force: bool = False,
    fail_fast: bool = False,
    vehicle: Where | None = None,
    method: Literal["default", "thesis"] | None = None,
    delay: Delay | None = None,
    expected: Where | None = None,
    require: str | Sequence[str] = (),
    allow_contradicted: bool = False,
    settings: Mapping[str, object] | None = None,
    report: bool = False,
    check: bool = False,
    baseline: Where | None = None,
    told: Callable[[LogDone], None] | None = None,
    map_file: Where | None = None,
) -> Campaign:
    """Estimate logs, folders, globs or campaign files as ``massprop batch`` does, in ``jobs`` processes (default: one per core).

    ``cluster`` is the address of a dask scheduler whose workers do it instead. Paths, ``out``, ``vehicle``, ``map_file``, ``expected`` and
    ``baseline`` (a campaign.json, or the folder that holds it) may be URLs.

    ``check`` says of each log whether it is fit, and estimates nothing; then ``out`` holds check.json in place of results.

    Results of an earlier run in ``out`` that still hold are kept. A log that can't be used doesn't raise: it is an outcome with
    exit_code 3. ``told`` hears of each log as it is done. Raises :class:`massprop_cli.InputError` where no log is found, or
    another batch is at work in ``out``.
    """
    named = [paths] if isinstance(paths, (str, Path)) else paths
    files = {key: None if file is None else str(file) for key, file in (("vehicle", vehicle), ("map", map_file), ("expect", expected))}
    stated = tuple(_assignments(method, delay, settings))
    asked = requirements(require)
    over = Settings(**files, assignments=stated, require=asked, report=report, check=check, allow_contradicted=allow_contradicted)
    name, planned = discover.plan([str(path) for path in named], over)
    earlier = None if baseline is None else baselines.read(str(baseline))
    held_against = None if earlier is None else partial(baselines.compare, earlier=earlier, gate=Gate())
    joined = [] if check else joining.joinings([str(path) for path in named], planned)
    place = urlplace.at(str(out))
    executor = LocalExecutor(jobs) if cluster is None else ClusterExecutor(cluster)
    with place.lock():
        found = run.campaign(
            name, planned, place, executor, force=force, fail_fast=fail_fast, baseline=held_against, told=told, joinings=joined
        )
    return Campaign(str(out), found)


def _assignments(method: str | None, delay: Delay | None, settings: Mapping[str, object] | None) -> list[str]:
    given: dict[str, Any] = dict(settings or {})
    given |= {"estimator.method": method} if method is not None else {}
    given |= {"cycle.command_delay_cycles": delay} if delay is not None else {}
    return [assignment for key, value in given.items() for assignment in _flat(key, value)]


def _flat(key: str, value: object) -> list[str]:
    """One assignment for each key of a mapping, so that those beside them stay as the vehicle file has them."""
    if isinstance(value, Mapping) and value:
        return [assignment for below, child in value.items() for assignment in _flat(f"{key}.{below}", child)]
    try:
        return [f"{key}={configfile.written(value)}"]
    except InputError as error:
        raise InputError(f"setting {key}: {error}", option="settings") from None
