"""Conversion of a recording to a log's table by its map, with a description of each conversion."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import nearest
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns, tablefile
from massprop_cli.inputs.formats import listing, oncycles, resample
from massprop_cli.inputs.formats.mapfile import MapSource
from massprop_cli.inputs.formats.recording import RecordedStream, Recording
from massprop_cli.inputs.formats.signals import QuantitySignal, Signals
from massprop_cli.inputs.tablefile import MapConversion, Table
from massprop_cli.inputs.vehicle import ACTUATORS

_SHOWN = 5
"""Maximum number of streams in one line."""


def of(read: Recording, source: MapSource | None) -> Table:
    """Table of a log from a recording, by its map or standard names of streams. Raises :class:`InputError` with file, path and remedy."""
    if source is None:
        return replace(tablefile.at_hand(read.path, _by_contract(read)), sha256=read.sha256, embedded_vehicle=read.vehicle)
    signals = Signals(read, source)
    records = source.map.records
    if records is None:
        made = _on_rows(signals)
    else:
        streams, edges = oncycles.streams_of(signals, records)
        made = oncycles.at_own_times(streams, records, edges) or oncycles.on_cycles_of(streams, records, edges)
    signals.conversions.extend(_unmapped(signals))
    heading = source.map.attitude is not None and source.map.attitude.order == "heading"
    by = MapConversion(source.source, source.sha256, tuple(_merged(signals.conversions)), signals.sampled, heading)
    time_s = made[columns.TIME]
    found = tablefile.at_hand(read.path, made, lambda row: f"record {row} as mapped (time_s = {time_s[row]:.9g})")
    return replace(found, sha256=read.sha256, embedded_vehicle=read.vehicle, made=by)


def _on_rows(signals: Signals) -> dict[str, Array]:
    """Columns of a log whose streams share one clock; the file's rows are the records."""
    source = signals.map
    imu = signals.imu()
    gyro = imu[0][0]
    for signal, _ in imu:
        _on_gyro_clock(gyro, signal, signals)
    made: dict[str, Array] = {columns.TIME: gyro.times.s} | signals.as_recorded(imu)
    attitude = None
    if source.attitude is not None:
        attitude = _on_gyro_clock(gyro, signals.attitude(source.attitude), signals).values
        made |= dict(zip(columns.QUATERNION, resample.z_up(attitude, source.attitude.world).T, strict=True))
    for key, wrench, known, names in signals.wrenches():
        values = _on_gyro_clock(gyro, signals.vector(key, wrench, known), signals).values
        if wrench.frame == "world" and attitude is not None:
            values = resample.into_body(values, attitude)
            signals.conversions.append(f"{key}: turned from world into body axes with the logged attitude of the same row")
        made |= dict(zip(names, values.T, strict=True))
    for name, jet in source.jets.items():
        on, share = signals.jet(name, jet)
        if share:
            raise signals.refused(on, "a valve's state is summed over control cycles; state [records] in the map")
        made[columns.jet(name)] = _on_gyro_clock(gyro, on, signals).values[:, 0]
    for signal, column, _, _ in signals.spinners():
        made[column] = _on_gyro_clock(gyro, signal, signals).values[:, 0]
    return made


def _on_gyro_clock(gyro: QuantitySignal, signal: QuantitySignal, signals: Signals) -> QuantitySignal:
    """Return ``signal``. Raises :class:`InputError` if it is not on the gyro's clock."""
    own, its = signal.times, gyro.times
    if own is not its and (len(own.s) != len(its.s) or (own.s != its.s).any()):
        rows = " of other rows (where)" if own.path == its.path else ""
        problem = f"its clock {own.path!r}{rows} is not the gyro's, {its.path!r}; state [records] in the map, onto which both are put"
        raise signals.refused(signal, problem)
    return signal


def _unmapped(signals: Signals) -> list[str]:
    """Line about unmapped streams that are numbered like mapped actuators, because an estimate needs all thrust that acted; else empty."""
    used = {str(one.path) for table in ("jets", *ACTUATORS) for one in getattr(signals.map, table).values()}
    numbered = {_number(path) for path in used if _number(path) != path}
    streams = signals.recording.streams
    like = [path for path in streams if path not in used and _number(path) in numbered and _varies(streams[path])]
    if not like:
        return []
    shown = ", ".join(map(repr, like[:_SHOWN])) + (f" and {len(like) - _SHOWN} more" if len(like) > _SHOWN else "")
    return [f"{shown}: numbered like commands that are mapped, and not mapped. Map each that acted on the vehicle"]


def _number(path: str) -> str:
    """Path with 0 for each number in its last part."""
    above, mark, name = path.rpartition("/")
    return above + mark + re.sub(r"\d+", "0", name)


def _varies(stream: RecordedStream) -> bool:
    values = listing.numbers(stream)
    held = np.zeros(0) if values is None else values[np.isfinite(values)]
    return bool(held.size) and bool(held.min() < held.max())


def _merged(conversions: Sequence[str]) -> list[str]:
    """Conversions, with equal ones of several keys in one line."""
    keys: dict[str, list[str]] = {}
    for line in conversions:
        key, _, what = line.partition(": ")
        keys.setdefault(what or line, []).append(key if what else "")
    return [f"{', '.join(each)}: {what}" if each[0] else what for what, each in keys.items()]


def _by_contract(read: Recording) -> dict[str, Array]:
    """Columns from streams whose paths end in a standard name; all must have the length of time_s."""
    found: dict[str, str] = {}
    for path in read.streams:
        name = path.replace(".", "/").rpartition("/")[2]
        known = any(kind.named(name) for kind in ACTUATORS.values()) or name in columns.FIXED or columns.is_jet(name)
        if known and name in found:
            raise InputError(
                f"{read.path}: both {found[name]!r} and {path!r} are called {name}; say which is meant in a map file: "
                f"massprop columns {read.path} drafts one"
            )
        if known and name != columns.EVENT:
            found[name] = path
    if columns.TIME not in found:
        hint = nearest(columns.TIME, read.streams, "the nearest path is")
        raise InputError(
            f"{read.path}: has no {columns.TIME}{hint}, and no map says what its {len(read.streams)} streams are; massprop columns "
            f"{read.path} drafts one, to be saved beside it as map.toml or named with --map"
        )
    made: dict[str, Array] = {name: np.asarray(read.streams[path].values, np.float64) for name, path in found.items()}
    rows = len(made[columns.TIME])
    for name, values in made.items():
        if len(values) != rows:
            raise InputError(
                f"{read.path}, {found[name]!r}: {len(values)} samples beside {rows} of {columns.TIME}; streams with clocks of their own "
                f"need a map, which massprop columns {read.path} drafts"
            )
    return made
