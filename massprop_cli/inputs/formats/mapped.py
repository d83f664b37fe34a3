"""A recording and its map to the table that a log is read from; what was done on the way is stated in words."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from massprop_cli.base import arrow
from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import nearest
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.base.spill import Content
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import oncycles, onrecords, onrows, reading
from massprop_cli.inputs.formats.mapfile import MapSource
from massprop_cli.inputs.formats.recording import Recording
from massprop_cli.inputs.formats.signals import Signals
from massprop_cli.inputs.tablefile import Cells, Made, Places, Table
from massprop_cli.inputs.vehicle import ACTUATORS


@dataclass(frozen=True)
class _Moments(Places):
    """How a person finds a row that a map made: by its time."""

    time_s: Sequence[float]

    def of(self, row: int) -> str:
        return f"record {row} as mapped (time_s = {self.time_s[row]:.9g})"


def table(path: Path, data: Content, source: MapSource | None) -> Table:
    """The log's table of a file that is none, or that a map is for.

    Without a map, streams that are called as the contract calls them are taken as they are. :class:`InputError` names file, path, remedy.
    """
    return of(reading.read(path, data), source)


def of(read: Recording, source: MapSource | None) -> Table:
    """The same of a recording at hand."""
    if source is None:
        return _table(read, _by_contract(read), None)
    signals = Signals(read, source)
    records = source.map.records
    if records is None:
        made = onrows.columns_of(signals)
    else:
        streams, edges = oncycles.streams_of(signals, records)
        made = onrecords.columns_of(streams, records, edges) or oncycles.columns_of(streams, records, edges)
    return _table(read, made, Made(source.source, source.sha256, tuple(_together(signals.made)), signals.sampled))


def _together(said: Sequence[str]) -> list[str]:
    """What was done, once for all keys of the map that it was done alike for."""
    keys: dict[str, list[str]] = {}
    for line in said:
        key, _, what = line.partition(": ")
        keys.setdefault(what or line, []).append(key if what else "")
    return [f"{', '.join(each)}: {what}" if each[0] else what for what, each in keys.items()]


def _by_contract(read: Recording) -> dict[str, Array]:
    """Streams whose paths end in a name of the contract, all as long as time_s."""
    found: dict[str, str] = {}
    for path in read.streams:
        name = path.replace(".", "/").rpartition("/")[2]
        known = (
            any(kind.named(name) for kind in ACTUATORS.values())
            or name in columns.FIXED
            or (name.startswith("jet_") and name.endswith("_s"))
        )
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


def _table(read: Recording, made: Mapping[str, Array], said: Made | None) -> Table:
    time_s = made[columns.TIME]
    places = _Moments(None, time_s) if said is not None else Places(None)  # type: ignore[arg-type]

    def cells(name: str, values: Array) -> Cells:
        return Cells(read.path, name, lambda: arrow.numbers(values), places)

    return Table(
        read.path, read.sha256, {name: cells(name, values) for name, values in made.items()}, len(time_s), places, read.vehicle, said
    )
