"""Reading and preprocessing the log of a result again, with a check that log and vehicle file are the same."""

from collections.abc import Callable
from pathlib import Path

from massprop_cli.base import configfile
from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.preprocessing import Ready, ready
from massprop_cli.inputs import clipped, logfile, telemetry, vehiclefile
from massprop_cli.inputs.tablefile import Table
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.result import rendered
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Result

EMBEDDED = "(embedded vehicle)"
SIZED = ("environment.disturbance", "estimator.adapt_noise", "estimator.accel_noise_scale")
"""Prefixes of settings that a log's estimate chose by its misfit; a joint fit may not need them."""


def of_result(one: Recorded) -> Ready:
    """Preprocess the log that the result's run.json names; :class:`InputError` if it is missing or has changed."""
    run = rendered.run(one.path.parent)
    place, vehicle, mapped = (str(run.get(key) or "") for key in ("log", "vehicle", "map"))
    if not place:
        raise InputError(f"{one.path.parent}: has no run.json that names its log; make the result again")
    log = Path(place)
    if not log.is_file():
        raise InputError(f"{log}: no such file; combine needs the log of the result, so put it back")
    table = logfile.read_table(log, Path(mapped) if mapped else None)
    explicit = None if not vehicle or vehicle.endswith(EMBEDDED) else Path(vehicle)
    return of_table(one.result, table, lambda given: vehiclefile.find(log, explicit, table.embedded_vehicle, given))


def of_table(result: Result, table: Table, vehicle: Callable[[list[str]], VehicleSource]) -> Ready:
    """Preprocess a log's table; ``vehicle`` returns its vehicle with assignments. :class:`InputError` if either has changed."""
    if table.sha256 != result.provenance.input_sha256:
        raise InputError(f"{table.path}: changed after the result was made; make the result again")
    source = vehicle(_assignments(result))
    if source.sha256 != result.provenance.vehicle_sha256:
        raise InputError(f"{source.source}: changed after the result was made; make the result again")
    return ready(clipped.with_unstated(telemetry.read(table, source.vehicle)), source, lambda *_: None)


def _assignments(result: Result) -> list[str]:
    """KEY=VALUE settings by option or estimated from the log, without disturbances."""
    sources, settings = result.provenance.setting_sources, result.provenance.settings
    kept = [key for key, where in sources.items() if where == "option" or (where == "log" and not key.startswith(SIZED))]
    return [f"{key}={configfile.written(settings[key])}" for key in kept if settings[key] is not None]


def sized(result: Result, stated: Vehicle) -> Vehicle:
    """The vehicle with the disturbances of the log's own estimate."""
    sources, settings = result.provenance.setting_sources, result.provenance.settings
    found = [key for key, where in sources.items() if where == "log" and key.startswith(SIZED) and settings[key] is not None]
    return vehiclefile.changed(stated, [f"{key}={configfile.written(settings[key])}" for key in found])
