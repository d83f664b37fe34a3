"""Streams that are the axes of a vector, and the quantity that they may be, by unit or name."""

import re
from collections.abc import Iterator, Mapping, Sequence

from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.recording import RecordedStream, Recording

_MARKS = (
    (re.compile(r"\[(?::,)?(\d)(?:,:)?\]$"), 0),
    (re.compile(r"\((?::,)?(\d)(?:,1)*(?:,:)?\)$"), 1),
    (re.compile(r"(?<![a-zA-Z])([wxyzWXYZ])(?![a-zA-Z])(?!.*(?<![a-zA-Z])[wxyzWXYZ](?![a-zA-Z]))"), 0),
    (re.compile(r"([wxyzWXYZ])$"), 0),
    (re.compile(r"(?<=\D)(\d)$"), 0),
    (re.compile(r"(?<![a-zA-Z])[afmtwAFMTW]([xyzXYZ])(?=_)"), 0),
    (re.compile(r"(?<![a-zA-Z])([pqrPQR])(?![a-zA-Z])(?!.*/)"), 0),
    (re.compile(r"(roll|pitch|yaw)(?=_?(?:rate|speed|vel))", re.IGNORECASE), 0),
)
"""Patterns that mark an axis in a name without unit, and the first number of numbered axes."""
_RATE_AXES = {"roll": "p", "pitch": "q", "yaw": "r"}
_LONGEST = 1000
"""Maximum length of a name that is searched for an axis, because the time grows with its square."""


@dataclass(frozen=True)
class Vector:
    """Three or four streams of equal length and clock."""

    stem: str
    """Common name, with * for the axis."""
    axes: str
    """Labels of the axes: ``xyz``, ``wxyz``, ``012``, ``pqr``."""
    streams: tuple[RecordedStream, ...]

    @property
    def paths(self) -> list[str]:
        """Paths of the axes, in order."""
        return [one.path for one in self.streams]

    @property
    def unit(self) -> str:
        """Unit as recorded, or from the name; a single letter before the axis is not a unit."""
        before, _, last = self.stem.rpartition("/")[2].rpartition("_")
        named = units.without_name_unit(before if last == "*" else self.stem)[1]
        return self.streams[0].unit or (named if last != "*" or len(named) > 1 else "")


def vectors(read: Recording) -> list[Vector]:
    """All complete vectors; a stream may be in several if its name is ambiguous."""
    groups: dict[tuple[str, int], dict[str, RecordedStream]] = {}
    for one in read.streams.values():
        for stem, axis, way in _axis_marks(one.path):
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


def _axis_marks(path: str) -> Iterator[tuple[str, str, int]]:
    """Name with * for the axis, the axis, and the index of the pattern, for each pattern that matches."""
    name = units.without_name_unit(units.without_suffix_unit(path)[0])[0] if len(path) <= _LONGEST else ""
    for way, (mark, first) in enumerate(_MARKS):
        match = mark.search(name)
        if match:
            axis = _RATE_AXES.get(match[1].lower(), match[1].lower())
            axis = str(int(axis) - first) if axis.isdigit() else axis
            yield f"{path[: match.start(1)]}*{path[match.end(1) :]}", axis, way


def _words(some: str) -> str:
    """Pattern for whole words, separated by ``_`` or capitals: ``ref`` in ``rate_ref`` and ``rateRef``, not in ``refined``."""
    return rf"(?<![a-zA-Z])(?:{some})(?![a-z])|(?<=[a-z])(?:{'|'.join(word.capitalize() for word in some.split('|'))})(?![a-z])"


_NEVER = re.compile(
    r"(?i:(?<!un)bias|offset|varian|covar|error|temperature|filtered_out|limit|noise|disturb|reset|clip|count|status|fft|freq|valid|vibrat)|"
    + _words("std|temp|dist|err|rms")
)
"""Names of no quantity."""
_NO_SENSOR = re.compile(
    r"(?i:setpoint|desired|command|reference|target|demand|(?<![a-z])mag|euler|wheel|ang(?:ular)?_?acc|dot(?![a-z]))|"
    + r"(?i:(?<=[_.])world(?![a-z/])|relative|chief|free_?acc)|(?<=[a-z])World|"
    + _words("sp|des|ref|cmd|rw|esc|alpha|hat|rel|eci|ned|enu")
)
_NO_COMMAND = re.compile(
    r"(?i:measured|unallocated|estimate|actual|feedback|external|gravity|friction|residual|wheel|gripper|contact|aero|(?<![a-z])drag|magnet|dipole)|"
    + _words("meas|est|ext|gg|hat|rw|mtq")
)
_COMMANDED = re.compile(r"(?i:setpoint|desired|command|demand)|" + _words("sp|des|cmd"))
_IN_DOUBT = re.compile(r"(?i:reference|target)|" + _words("ref"))
"""Names of commands or of controller references."""
_NO_ATTITUDE = re.compile(r"(?i:delta|error|reset|setpoint|desired|reference|target)|" + _words("sp|des|ref|cmd|std|err"))


@dataclass(frozen=True)
class VectorName:
    """Names and units of a vector quantity."""

    key: str
    called: re.Pattern[str]
    rates: Mapping[str, float]
    increments: Mapping[str, float]
    never: re.Pattern[str]

    @property
    def known(self) -> dict[str, float]:
        """All units."""
        return {**self.rates, **self.increments}


SENSORS = (
    VectorName(
        "gyro",
        re.compile(r"gyro?|ang(ular)?_?(vel|rate)|omega|d(elta)?_?(theta|ang)|body_?rate|/xyz$|(?<![a-z])[wg]_?\*|^\*$", re.IGNORECASE),
        units.SPIN,
        units.ANGLE,
        _NO_SENSOR,
    ),
    VectorName(
        "accelerometer",
        re.compile(r"acc|specific_?force|delta_?v|(?<![a-z])(?:dv|a)_?\*", re.IGNORECASE),
        units.ACCELERATION,
        units.SPEED,
        _NO_SENSOR,
    ),
)
COMMANDS = (
    VectorName("torque", re.compile(r"torque|moment|tau|(?:^|(?<=cmd_))[mt]_?\*", re.IGNORECASE), units.TORQUE, {}, _NO_COMMAND),
    VectorName("force", re.compile(r"force(?!.*specific)|thrust|(?<![a-z])f_?\*", re.IGNORECASE), units.FORCE, {}, _NO_COMMAND),
)


def fitting(quantity: VectorName, found: Sequence[Vector]) -> tuple[list[Vector], bool]:
    """Vectors that may be the quantity, those with a recorded unit first; and whether the choice is certain."""
    some = [v for v in found if len(v.streams) == 3 and not (_NEVER.search(v.stem) or quantity.never.search(v.stem))]
    named = [v for v in some if _name_fits(quantity, v)]
    if not named:
        # angles are rarely increments, velocities even less; G may mean g or gauss
        named = [v for v in some if units.factor(v.unit, quantity.rates) is not None and v.unit.strip("[]() ") != "G"]
    if quantity in COMMANDS:
        named = [v for v in named if _COMMANDED.search(v.stem)] or named
    named.sort(key=lambda v: units.factor(v.unit, quantity.known) is None)
    return named, len(named) == 1 and not _IN_DOUBT.search(named[0].stem)


def attitudes(found: Sequence[Vector]) -> list[Vector]:
    """Vectors that may be a logged quaternion."""
    called = re.compile(r"quat|orient|attitude|\bq\b|q\*|/q\[", re.IGNORECASE)
    return [v for v in found if len(v.streams) == 4 and called.search(v.stem) and not _NO_ATTITUDE.search(v.stem)]


def _name_fits(quantity: VectorName, vector: Vector) -> bool:
    """Whether the name fits, and the unit is not another quantity's."""
    unit = vector.unit
    if (vector.streams[0].unit or len(unit) > 1) and units.is_any(unit) and units.factor(unit, quantity.known) is None:
        return False
    others = [other for other in (*SENSORS, *COMMANDS) if other is not quantity and other.called.search(vector.stem)]
    by_axes = quantity.key == "gyro" and vector.axes == "pqr"
    return by_axes or (bool(quantity.called.search(vector.stem)) and not others)
