"""What must be said of a fault, and what a fault is."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from fault_vehicles import Case, Subject

from massprop_cli.inputs.notice import Notice

RIVALS = "rival"
"""A message that weighs rivals against what it names does so from this word on."""
EVEN = ", or else "
"""Between causes of one kind that a log can't tell apart: two jets that always fire together, say. One of them must be right."""
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
CAUSES = frozenset(
    {
        *("jet-sign", "jet-dead", "jet-position", "jet-direction", "jets-swapped", "thrust-scale", "command-sign"),
        *("thrust-rise", "thrust-droop", "thrust-lag", "delay-mismatch", "clock-drift"),
        *("gyro-units", "gyro-scale", "gyro-sign", "gyro-bias", "gyro-filter", "gyro-saturated"),
        *("accel-units", "accel-scale", "accel-bias", "accel-filter", "accelerometer-saturated", "outliers", "sensor-frozen"),
        *("imu-mounting", "imu-position", "attitude-start", "bearing-position", "gravity", "mass-change", "phase-border", "fuel-use"),
        *("steady-torque", "disturbance-torque", "periodic-torque", "rate-torque"),
        *("column-kind", "accel-axes", "wrench-point", "commands-limited", "commands-normalised", "gravity-felt"),
    }
)
"""Codes that name a cause."""
SIZED = frozenset({"disturbance-torque"})
"""Codes that name one, and also stand beside others for what was sized as noise: never counted as wrong."""


@dataclass(frozen=True)
class Number:
    """A number that the message must state."""

    value: float
    within: float

    def among(self, text: str) -> bool:
        """Whether a text states it."""
        return any(abs(float(found) - self.value) <= self.within for found in NUMBER.findall(text))


@dataclass(frozen=True)
class Due:
    """A warning that names a cause correctly."""

    codes: tuple[str, ...]
    """Any of these."""
    words: tuple[str | Number, ...] = ()
    """All of these."""
    channels: frozenset[str] = frozenset()
    """Jets or components of the wrench that may be named, at least one of them and no innocent one; empty: none is asked for."""

    def met_by(self, notice: Notice, channels: Sequence[str], guilty: frozenset[str] = frozenset()) -> bool:
        """Whether a warning is it; ``channels`` are the names of all, of which another fault has made some ``guilty``, too."""
        return any(self._met(notice.code, said, channels, guilty) for said in notice.message.partition(RIVALS)[0].split(EVEN))

    def _met(self, code: str, said: str, channels: Sequence[str], guilty: frozenset[str]) -> bool:
        named = {name for name in channels if re.search(rf"(?<!\w){re.escape(name)}(?!\w)", said)}
        return (
            code in self.codes
            and all(word.among(said) if isinstance(word, Number) else word in said for word in self.words)
            and (not self.channels or (bool(named & self.channels) and named <= self.channels | guilty))
        )


@dataclass(frozen=True)
class Drawn:
    """A fault with its random jet, axis, sign, size and time."""

    case: Case
    dues: tuple[Due, ...]
    """All of them; none where no log can tell it, so that any cause named is wrong."""
    what: str
    """For a reader."""


@dataclass(frozen=True)
class Fault:
    """A kind of fault."""

    name: str
    what: str
    draw: Callable[[Subject, np.random.Generator], Drawn | None]
    """None where a vehicle can't have it."""


def due(code: str, *words: str | Number, channels: Sequence[str] = ()) -> tuple[Due, ...]:
    """One due warning."""
    return (Due((code,), words, frozenset(channels)),)
