"""Candidate motions of a plan: pulses on one axis or several, with attitude hold about the other axes."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from massprop_cli.base.dataclass import dataclass
from massprop_cli.testbed.timeline import AXES, TURNS, Axis, Segment

SHARES = {"alternating": (12, 6, 2), "random": (12,), "steady": (1,)}
"""Numbers of pulses in a block for motions of several axes. Short pulses keep the travel small; long ones build up the rates that are most
informative of inertia. With few random pulses, the information would depend on the draw."""
SINGLE = {"alternating": (6, 2), "random": (12,), "steady": (1,)}
"""Numbers of pulses in a block for motions of one axis, which suit a small impulse or one wanted quantity."""
Kind = Literal["alternating", "random", "steady", "hold"]
KINDS: tuple[Kind, ...] = ("alternating", "random", "steady")
LEVELS = (1.0, 0.5, 0.25, 0.1)
"""Parts of the full torque and force, tried from the largest."""
STAGGER = (1.0, 1.4, 1.8, 1.2, 1.6, 2.0)
"""Factors on the period of each axis in a motion of several, so that their commands are linearly independent."""


@dataclass(frozen=True)
class Manoeuvre:
    """A motion without its start and end."""

    kind: Kind
    axes: tuple[Axis, ...]
    every_cycles: int = 1
    level: float = 1.0
    held: tuple[Axis, ...] = ("roll", "pitch", "yaw")
    """Rotation axes that the actuators can hold while they drive others."""

    def __str__(self) -> str:
        every = {"alternating": f", sign changes every {self.every_cycles} cycles", "random": f", drawn every {self.every_cycles} cycles"}
        if self.kind == "hold":
            return "hold"
        part = "" if self.level == 1 else f", {100 * self.level:g} % of full"
        staggered = " and more" if self.kind == "alternating" and len(self.axes) > 1 else ""
        return f"{self.kind} {', '.join(self.axes)}{every.get(self.kind, '')}{staggered}{part}"

    def segments(self, start: int, end: int) -> list[Segment]:
        """Scenario segments from cycle ``start`` to ``end``; rotation axes that are not driven are held."""
        driven = [segment for axes, every in self._driven() for segment in self._pulses(axes, every, start, end)] if self.axes else []
        held = tuple(axis for axis in self.held if axis not in self.axes)
        hold = [Segment(motion="hold", axes=held, start_cycle=start, end_cycle=end)] if held else []
        return driven + hold or [Segment(motion="coast", start_cycle=start, end_cycle=end)]

    def _pulses(self, axes: tuple[Axis, ...], every: int, start: int, end: int) -> list[Segment]:
        """Segments of some axes. An alternating force begins with half a pulse of opposite sign, so that the mean velocity is zero."""
        half = every // 2
        if self.kind != "alternating" or half == 0 or set(axes) <= set(TURNS) or start + half >= end:
            return [self._segment(axes, every, start, end)]
        first = replace(self, kind="steady", level=-self.level)
        return [first._segment(axes, 1, start, start + half), self._segment(axes, 2 * half, start + half, end)]

    def _driven(self) -> list[tuple[tuple[Axis, ...], int]]:
        """Groups of axes with one command, and the pulse length of each, cycles."""
        if self.kind == "alternating" and len(self.axes) > 1:
            return [((axis,), max(round(self.every_cycles * STAGGER[AXES.index(axis)]), 1)) for axis in self.axes]
        turns, pushes = (tuple(a for a in self.axes if (a in TURNS) == turning) for turning in (True, False))
        return [(axes, self.every_cycles) for axes in (turns, pushes) if axes]

    def _segment(self, axes: tuple[Axis, ...], every: int, start: int, end: int) -> Segment:
        pattern = {} if self.kind == "steady" else {"every_cycles": every}
        if self.kind == "random":
            pattern["max_cycles"] = max(every - 1, 1)
        return Segment.model_validate(
            {
                "motion": self.kind,
                "axes": axes,
                "start_cycle": start,
                "end_cycle": end,
                "closed_loop": set(axes) <= set(TURNS),
                "level": self.level,
                **pattern,
            }
        )


def motions_of(axes: Sequence[Axis], block: int) -> list[Manoeuvre]:
    """All motions of the axes at full level, for a block of ``block`` cycles."""
    turns, pushes = (tuple(axis for axis in axes if (axis in TURNS) == turning) for turning in (True, False))
    sets = list(dict.fromkeys([*((axis,) for axis in axes), turns, pushes, tuple(axes)]))
    return [
        Manoeuvre(kind, chosen, count, held=turns)
        for chosen in sets
        if chosen
        for kind in KINDS
        for count in dict.fromkeys(max(round(block / share), 1) for share in (SINGLE if len(chosen) == 1 else SHARES)[kind])
        if kind != "steady" or len(chosen) == 1
    ]
