"""Which vectors of a recording may be which quantity, by their names and then by their units; a unit goes before any name."""

import re
from collections.abc import Mapping, Sequence

from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.formats import units
from massprop_cli.inputs.formats.vectors import Vector


def _words(some: str) -> str:
    """As whole words, which ``_`` and capitals part: the ``ref`` of ``rate_ref`` and ``rateRef``, not that of ``refined``."""
    return rf"(?<![a-zA-Z])(?:{some})(?![a-z])|(?<=[a-z])(?:{'|'.join(word.capitalize() for word in some.split('|'))})(?![a-z])"


_NEVER = re.compile(
    r"(?i:(?<!un)bias|offset|varian|covar|error|temperature|filtered_out|limit|noise|disturb|reset|clip|count|status|fft|freq|valid|vibrat)|"
    + _words("std|temp|dist|err|rms")
)
"""What no quantity is."""
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
"""What may be a command, or what a controller was told to reach."""
_NO_ATTITUDE = re.compile(r"(?i:delta|error|reset|setpoint|desired|reference|target)|" + _words("sp|des|ref|cmd|std|err"))


@dataclass(frozen=True)
class VectorName:
    """How a vector is known."""

    key: str
    called: re.Pattern[str]
    rates: Mapping[str, float]
    increments: Mapping[str, float]
    never: re.Pattern[str]

    @property
    def known(self) -> dict[str, float]:
        """All its units."""
        return {**self.rates, **self.increments}


SENSORS = (
    VectorName(
        "gyro",
        re.compile(r"gyro?|ang(ular)?_?(vel|rate)|omega|d(elta)?_?(theta|ang)|body_?rate|/xyz$|(?<![a-z])[wg]_?\*|^\*$", re.IGNORECASE),
        units.RATE,
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


def candidates(quantity: VectorName, found: Sequence[Vector]) -> tuple[list[Vector], bool]:
    """Those that may be it, with a recorded unit before others; and whether it is settled that the only one is."""
    some = [v for v in found if len(v.streams) == 3 and not (_NEVER.search(v.stem) or quantity.never.search(v.stem))]
    named = [v for v in some if _is_called(quantity, v)]
    if not named:
        # an angle is seldom an increment, and a velocity still less; G is what some write for g, and others for gauss
        named = [v for v in some if units.factor(v.unit, quantity.rates) is not None and v.unit.strip("[]() ") != "G"]
    if quantity in COMMANDS:
        named = [v for v in named if _COMMANDED.search(v.stem)] or named
    named.sort(key=lambda v: units.factor(v.unit, quantity.known) is None)
    return named, len(named) == 1 and not _IN_DOUBT.search(named[0].stem)


def attitudes(found: Sequence[Vector]) -> list[Vector]:
    """Those that may be a logged quaternion."""
    called = re.compile(r"quat|orient|attitude|\bq\b|q\*|/q\[", re.IGNORECASE)
    return [v for v in found if len(v.streams) == 4 and called.search(v.stem) and not _NO_ATTITUDE.search(v.stem)]


def _is_called(quantity: VectorName, vector: Vector) -> bool:
    """By its name, where its unit is not another quantity's."""
    unit = vector.unit
    if (vector.streams[0].unit or len(unit) > 1) and units.is_any(unit) and units.factor(unit, quantity.known) is None:
        return False
    others = [other for other in (*SENSORS, *COMMANDS) if other is not quantity and other.called.search(vector.stem)]
    by_axes = quantity.key == "gyro" and vector.axes == "pqr"
    return by_axes or (bool(quantity.called.search(vector.stem)) and not others)
