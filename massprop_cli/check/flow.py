"""Check of a log: its table, its signals and an estimate."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from massprop_cli import __version__, flow, job
from massprop_cli.base import exits, files
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.check.finding import Check, ExpectedQuantity, Finding, Grade, Subject, finding
from massprop_cli.check.signals import attitude, commands, never_fired, on_table, sampling, sensors
from massprop_cli.flow import Analysis
from massprop_cli.inputs import logfile, telemetry, vehiclefile
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.require import Requirement
from massprop_cli.inputs.tablefile import Place, Table
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.report import timing, vocabulary
from massprop_cli.result import build, judge
from massprop_cli.result.schema import Result

IMU = ("gyro", "accel", "imu", "sensor", "outliers")
"""Prefixes of notice codes about the IMU."""
TIMING = (
    "delay-mismatch",
    "clock-drift",
    "thrust-lag",
    "thrust-rise",
    "long-interval",
    "cycle-period",
    "cycle-pace",
    "clock-rebuilt",
    "records-doubled",
    "records-lost",
    "timing-untold",
)
"""Codes of notices about timing."""
NOTES = (
    "noise-floor",
    "cycle-pace",
    "long-interval",
    "clock-rebuilt",
    "records-doubled",
    "records-lost",
    "unphysical-inertia",
    "no-docked-object",
    "docked-mass",
)
"""Codes of notices that do not invalidate the values."""
OVERSTATED = 0.5
"""Mean squared normalised innovation below which the stated noise, and with it each sigma, is too large."""
WANTED_BEFORE = ("not_excited", "unobservable")


def check(
    log_path: Path,
    vehicle_path: Path | None,
    wants: Sequence[Requirement],
    assignments: Sequence[str],
    say: flow.Progress | None = None,
    map_file: Path | None = None,
    *,
    allow_contradicted: bool = False,
) -> Check:
    """Check a log file. Raises :class:`InputError` only if there is no table or no vehicle file."""
    files.check_name(str(log_path))
    table = logfile.read_table(log_path, map_file)
    source = vehiclefile.find(log_path, vehicle_path, table.embedded_vehicle, assignments)
    return of_table(table, source, wants, assignments, say, allow_contradicted=allow_contradicted)


def of_table(
    table: Table,
    source: VehicleSource,
    wants: Sequence[Requirement],
    assignments: Sequence[str] = (),
    say: flow.Progress | None = None,
    *,
    allow_contradicted: bool = False,
) -> Check:
    """Check a table with a given vehicle."""
    vehicle, place = source.vehicle, table.place
    found = sampling(_times(table, vehicle), place)
    unusable = any(one.grade == "unusable" for one in found)
    with np.errstate(all="ignore"):
        try:
            with vehiclefile.refused(table.path, source):
                log = telemetry.read(table, vehicle)
                # reading corrected the time stamps and added a notice
                found, unusable = [one for one in found if one.grade != "unusable"], False
                found += seen(log, vehicle, place)
                estimated = flow.examine(log, source, assignments, say)
                result = build.result(estimated)
        except InputError as error:
            # findings already name the time stamps
            found += [] if unusable else [finding("reading", "unusable", "unusable", str(error), "")]
            return _document(table, vehicle, found, [], exits.INPUT)
    found = with_estimate(found, estimated, result, vehicle)
    expected = _expected(result, wants)
    found += _idle(log, vehicle, expected)
    unmet = job.unmet(result, job.Demands(tuple(wants), allow_contradicted=allow_contradicted))
    return _document(table, vehicle, found, expected, unmet.exit_code, result)


def seen(log: Log, vehicle: Vehicle, place: Place) -> list[Finding]:
    """Findings from the signals alone, before any estimate; ``place`` names a row."""
    return [*sensors(log, vehicle, place), *commands(log, vehicle, place), *attitude(log, vehicle), *on_table(log, vehicle)]


def with_estimate(found: Sequence[Finding], estimated: Analysis, result: Result, vehicle: Vehicle) -> list[Finding]:
    """Findings with those of an estimate; ``result`` is its document. Skips codes that have a finding already."""
    codes = {one.code for one in found}
    # the missing commands are the cause
    codes |= {"cause-unknown"} if "nothing-commanded" in codes else set()
    named = {fault.notice.code for fault in estimated.faults if fault.cure is not None}
    every = [*found, *(_of_notice(notice, notice.code in named) for notice in estimated.notices if notice.code not in codes)]
    return every if any(one.grade == "fault" for one in every) else [*every, *_overstated_noise(result, vehicle)]


def _times(table: Table, vehicle: Vehicle) -> Array:
    """(n,) time column, s; empty if it is missing or not numeric."""
    column = vehicle.columns.get("time_s")
    name, scale = (column.from_, column.scale) if column is not None else ("time_s", 1.0)
    if name not in table.columns:
        return np.zeros(0)
    try:
        return table.columns[name].numbers() * scale
    except InputError:
        return np.zeros(0)


def _of_notice(notice: Notice, named: bool) -> Finding:
    subject: Subject = "timing" if notice.code in TIMING else "imu" if notice.code.startswith(IMU) else "model"
    what, _, remedy = notice.message.partition(". ")
    grade: Grade = "note" if notice.code in NOTES else "fault"
    sure = "the log passes its test with the correction; the message lists rivals" if named else "measured in this log"
    return finding(subject, notice.code, grade, what if remedy else notice.message, remedy, sure=sure)


def _overstated_noise(result: Result, vehicle: Vehicle) -> list[Finding]:
    """Notes on sensors whose innovations scatter far less than the stated noise."""
    found = []
    for kind, key, part in (("gyro", "gyro_noise_rad_s", slice(0, 3)), ("accelerometer", "accel_noise_m_s2", slice(3, 6))):
        stated = getattr(vehicle.imu, key)
        read = [phase.innovations.channel_variance[part] for phase in result.phases if phase.innovations is not None]
        ratios = [float(np.mean(own)) for of_phase in read if (own := [ratio for ratio in of_phase if ratio is not None])]
        disturbed = any((vehicle.environment.disturbance_torque_n_m, vehicle.environment.disturbance_walk_n_m, vehicle.thrust.pulse_sigma))
        if not stated or disturbed or not ratios or max(ratios) >= OVERSTATED:
            continue
        level = stated * np.sqrt(np.mean(ratios))
        text = f"the {kind} noise is {level:.2g}, but {stated:.2g} is stated: sigmas are too large"
        remedy, sure = (
            f"state imu.{key} = {level:.2g}, or leave it out and massprop estimates it",
            f"{np.mean(ratios):.2g} of the expected variance",
        )
        found.append(finding("imu", f"{kind}-noise-overstated", "note", text, remedy, sure=sure))
    return found


def _expected(result: Result, wants: Sequence[Requirement]) -> list[ExpectedQuantity]:
    asked = {item.quantity: item for item in wants}
    found = []
    for phase in result.phases:
        alone = result.model_copy(update={"phases": [phase], "docked_object": None})
        for name, item in judge.items(phase).items():
            want = asked.get(name)
            precision = want.precision if want is not None else None
            limit = precision.sigma(item.value) if precision is not None and item.value is not None else None
            short = [] if want is None else job.unmet(alone, job.Demands((want,), allow_contradicted=True)).phrases
            found.append(
                ExpectedQuantity(
                    phase=phase.name,
                    quantity=name,
                    unit=item.unit,
                    sigma=item.sigma,
                    verdict=item.verdict,
                    wanted=None if want is None else precision.written if precision is not None else "",
                    wanted_sigma=limit,
                    reached=None if want is None else not short,
                    reason=short[0] if short else item.reason,
                )
            )
    return found


def _idle(log: Log, vehicle: Vehicle, expected: Sequence[ExpectedQuantity]) -> list[Finding]:
    """Note on channels without commands, if a wanted quantity lacks excitation."""
    missing = sorted({one.quantity for one in expected if one.reached is False and one.verdict in WANTED_BEFORE})
    idle = never_fired(log, vehicle)
    if not missing or not idle:
        return []
    motions = "; ".join(dict.fromkeys(f"{name}: {vocabulary.motion_for(name)}" for name in missing))
    text = f"never commanded: {', '.join(idle)}; {', '.join(missing)} cannot be estimated without motion"
    return [finding("excitation", "never-fired", "note", text, f"add the missing motion ({motions}); massprop plan designs it")]


def _document(
    table: Table, vehicle: Vehicle, found: list[Finding], expected: list[ExpectedQuantity], code: int, result: Result | None = None
) -> Check:
    usable = code != exits.INPUT
    return Check(
        schema="massprop/check/1",
        massprop=__version__,
        log=table.path.name,
        input_sha256=table.sha256,
        vehicle=vehicle.name,
        rows=table.rows,
        usable=usable,
        fit=usable and code == 0 and not any(one.grade == "fault" for one in found),
        findings=found,
        expected=expected,
        delay="" if result is None else timing.detected_delay(result.delay),
        low_passes=[] if result is None else timing.low_passes(result),
        exit_code=code,
    )


def message(found: Check) -> str:
    """Reason of an exit code other than 0, on one line; empty for 0."""
    if found.exit_code == exits.INPUT:
        bad = [one for one in found.findings if one.grade == "unusable"]
        first = bad[0]
        where = f" ({first.where})" if first.where else ""
        more = f"; and {len(bad) - 1} more" if len(bad) > 1 else ""
        text = first.what if first.code == "unusable" else f"{found.log}: {first.what}{where}; {first.remedy}"
        return f"{text}{more}"
    if found.exit_code == exits.CONTRADICTED:
        faults = ["; ".join(filter(None, (one.what, one.remedy))) for one in found.findings if one.grade == "fault"]
        return f"{found.log}: the log contradicts the vehicle file: {next(iter(faults), 'no cause was found')}"
    short = [one.reason for one in found.expected if one.reached is False]
    return f"wanted but not reached: {'; '.join(short)}" if short else ""
