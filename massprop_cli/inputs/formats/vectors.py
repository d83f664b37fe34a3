"""Streams that belong together as the axes of a vector, found by their names."""

import re
from collections.abc import Iterator

from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import RecordedStream, Recording

_MARKS = (
    (re.compile(r"\[(?::,)?(\d)(?:,:)?\]$"), 0),
    (re.compile(r"\((?::,)?(\d)(?:,:)?\)$"), 1),
    (re.compile(r"(?<![a-zA-Z])([wxyzWXYZ])(?![a-zA-Z])(?!.*(?<![a-zA-Z])[wxyzWXYZ](?![a-zA-Z]))"), 0),
    (re.compile(r"([wxyzWXYZ])$"), 0),
    (re.compile(r"(?<=\D)(\d)$"), 0),
    (re.compile(r"(?<![a-zA-Z])[afmtwAFMTW]([xyzXYZ])(?=_)"), 0),
    (re.compile(r"(?<![a-zA-Z])([pqrPQR])(?![a-zA-Z])(?!.*/)"), 0),
    (re.compile(r"(roll|pitch|yaw)(?=_?(?:rate|speed|vel))", re.IGNORECASE), 0),
)
"""How names mark an axis, less the unit behind them, and from what number they count."""
_TURNS = {"roll": "p", "pitch": "q", "yaw": "r"}
_LONGEST = 1000
"""Characters of a name in which an axis is looked for, as that takes a time that grows as its square."""


@dataclass(frozen=True)
class Vector:
    """Three or four streams of one length and clock."""

    stem: str
    """Their name with * for the axis."""
    axes: str
    """What stands for it: ``xyz``, ``wxyz``, ``012``, ``pqr``."""
    streams: tuple[RecordedStream, ...]

    @property
    def paths(self) -> list[str]:
        """Of its axes, in their order."""
        return [one.path for one in self.streams]

    @property
    def unit(self) -> str:
        """As recorded, or as its name has it, behind or before the axis; one letter before the axis is none."""
        before, _, last = self.stem.rpartition("/")[2].rpartition("_")
        named = units.within(before if last == "*" else self.stem)[1]
        return self.streams[0].unit or (named if last != "*" or len(named) > 1 else "")


def vectors(read: Recording) -> list[Vector]:
    """All that are complete. A stream may be of more than one, where its name can be read in two ways."""
    groups: dict[tuple[str, int], dict[str, RecordedStream]] = {}
    for one in read.streams.values():
        for stem, axis, way in _ways(one.path):
            groups.setdefault((stem, way), {})[axis] = one
    found = []
    taken: set[tuple[str, ...]] = set()
    for (stem, _), axes in groups.items():
        for order in ("wxyz", "0123", "xyz", "012", "pqr"):
            streams = tuple(axes[axis] for axis in order if axis in axes)
            paths, kinds = tuple(one.path for one in streams), {(one.rows, one.clock, one.unit) for one in streams}
            if len(axes) == len(order) == len(streams) and len(kinds) == 1 and paths not in taken:
                taken.add(paths)
                found.append(Vector(stem, order, streams))
    return found


def _ways(path: str) -> Iterator[tuple[str, str, int]]:
    """The name without its axis, the axis, and which of the ways it was read in."""
    name = units.within(units.behind(path)[0])[0] if len(path) <= _LONGEST else ""
    for way, (mark, first) in enumerate(_MARKS):
        match = mark.search(name)
        if match:
            axis = _TURNS.get(match[1].lower(), match[1].lower())
            axis = str(int(axis) - first) if axis.isdigit() else axis
            yield f"{path[: match.start(1)]}*{path[match.end(1) :]}", axis, way
