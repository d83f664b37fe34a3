"""The seam of actuators: a table of the vehicle file, its columns in a log, and the momentum that it holds in time.

The angular momentum of body and devices about the CG is ``I ω + Σ h``. Each device's h has components along axes that stand still in the
body: one axis for a wheel, two for a rotor that a gimbal turns. The body feels ``−(ḣ + ω × h)``.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, NamedTuple, Protocol, Self

import numpy as np
from pydantic import AfterValidator, Field

from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import nearest
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.section import Section, Vector

DEAD = 1e-9
"""Part of its momentum that stands for a device that does nothing, since a vehicle file takes no 0."""
NEAR = 0.02
"""Relative tolerance within which a first reading is the stated value in another unit."""
SPEEDS = {
    30 / np.pi: "it is in rpm",
    np.pi / 30: "{} is in rpm",
    180 / np.pi: "it is in deg/s",
    1 / (2 * np.pi): "it is in revolutions per second",
    -1.0: "it has the other sign",
    -30 / np.pi: "it is in rpm, and has the other sign",
}
"""How many times what is stated of it a first speed is, and why."""


class LogColumn(NamedTuple):
    """A column that a log has of each actuator of one kind; the actuator's name stands in its middle."""

    start: str
    end: str
    key: str
    """What the vehicle file calls it."""
    units: Mapping[str, float]
    """In which a recording may have it, as factors to SI."""
    instant: bool
    """Whether it is read at ``time_s``; else it holds over a control cycle."""
    nullable: bool
    """Whether a cell may be empty."""
    description: str

    def of(self, name: str) -> str:
        """The column of one actuator."""
        return f"{self.start}{name}{self.end}"

    def named(self, column: str) -> str | None:
        """The actuator that a column is called after; None where it is another column."""
        fits = column.startswith(self.start) and column.endswith(self.end) and len(column) > len(self.start) + len(self.end)
        return column.removeprefix(self.start).removesuffix(self.end) if fits else None


class Actuator(Section):
    """One of the vehicle's actuators."""

    TABLE: ClassVar[str]
    """Of the vehicle file."""
    NOUN: ClassVar[str]
    COLUMNS: ClassVar[tuple[LogColumn, ...]]
    """Where a log has several of one actuator, it is read by the first."""
    DOES: ClassVar[tuple[str, ...]]
    """Keys that say what it does to the vehicle: those of another one, where two are swapped."""
    THRUSTS: ClassVar[bool] = False
    """Whether it is commanded in place of jets or a wrench."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$")

    @classmethod
    def named(cls, column: str) -> str | None:
        """The actuator of this kind that a column is called after; None where it is another column."""
        return next((name for one in cls.COLUMNS if (name := one.named(column)) is not None), None)

    @classmethod
    @abstractmethod
    def draft(cls, name: str, has: LogColumn, span: str) -> list[str]:
        """Lines of a drafted vehicle file for an actuator of which the log has a column that runs over ``span`` (empty: unknown)."""

    @property
    @abstractmethod
    def device(self) -> MomentumDevice | None:
        """What of it stores momentum that is known."""

    @abstractmethod
    def read(self, source: LogTable, records: int, n: int) -> MomentumLog:
        """What n rows of a log, ``records`` to a cycle, say of its device; :class:`InputError` names column and remedy."""

    @classmethod
    def check_together(cls, source: LogTable, own: Sequence[Self], said: Sequence[MomentumLog]) -> None:
        """:class:`InputError` where the columns of all of this kind contradict what the vehicle file states of them."""

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """The same with so many times the momentum."""

    def acting(self, factors: Array) -> Self | None:
        """The same whose momentum along each of its axes is so many times as much; None where nothing stated of it could be so."""
        return self.scaled(float(factors[0])) if (factors == factors[0]).all() and factors[0] > 0 else None


class MomentumDevice(Actuator):
    """An actuator that turns the vehicle by momentum that it stores."""

    @property
    def device(self) -> MomentumDevice | None:
        """Itself."""
        return self

    @property
    @abstractmethod
    def axes(self) -> Array:
        """(a, 3) unit vectors that stand still in the body, along which its momentum has components."""

    @property
    @abstractmethod
    def beyond_reported(self) -> Array:
        """(3, 3) what the inertia in the equations has of it beyond the inertia that is reported, kg m²."""

    @property
    @abstractmethod
    def unknowns(self) -> tuple[Unknown, ...]:
        """Errors of what is stated of it that a log may tell, with sigmas above 0."""

    @abstractmethod
    def momentum(self, said: MomentumLog, log: LogTimes) -> Grown:
        """What it holds in time."""

    @property
    def free_inertia(self) -> Array:
        """(a,) by how much its momentum along each axis follows the body's rate between two readings of its speed, kg m²."""
        return np.zeros(len(self.axes))

    def scatter(self, said: MomentumLog, weight: Array) -> float:  # noqa: ARG002
        """One sigma [N m s] by which its momentum scatters from record to record, each of the ``weight`` (n,) of its rate squared: 0."""
        return 0.0

    @property
    def channels(self) -> tuple[str, ...]:
        """(a,) names of its axes."""
        return (self.name,) if len(self.axes) == 1 else tuple(f"{self.name} {number}" for number in range(1, len(self.axes) + 1))


class Unknown(NamedTuple):
    """An error ε of what is stated of a device: it holds ``ε (by (h − h₀) + constant)`` more, along its axes or along ``across``."""

    sigma: float
    by: Array
    """(a, a)"""
    constant: Array
    """(a,) N m s"""
    since_start: bool
    """Whether h₀ is the momentum that the log began with; else it is 0."""
    across: Array | None = None
    """(a, 3) instead of its axes: where an error turns them to."""

    @property
    def scales(self) -> bool:
        """Whether it is a relative error of all torque that the device gives."""
        return self.across is None and bool((self.by == np.eye(len(self.by))).all())


class Grown(NamedTuple):
    """Momentum (a, P) [N m s] at times (P,) [s] by the commands' clock, between which it grows evenly."""

    time_s: Array
    momentum: Array


@dataclass(frozen=True)
class LogTimes:
    """When a log's n records and M rows of commands are, and how the body turned."""

    edge_s: Array
    """(n + 1,) start of the first record and end of each, by the commands' clock."""
    interval_s: Array
    """(n,) length of each record."""
    period_s: float
    """Of a control cycle."""
    at_once_s: Array
    """(M,) from when on what was measured acts, by the commands' clock."""
    delayed_s: Array
    """(M,) from when on what was commanded acts."""
    turn_rad: Callable[[slice], Array]
    """(…, 3) by which the body turned in some records, body axes."""


class MomentumLog(Protocol):
    """What a log says of one device."""

    @property
    def integrated(self) -> bool:
        """Whether its momentum follows from all of the log."""

    @property
    def known_before(self) -> bool:
        """Whether it is known from before the first record's end."""

    @property
    def moved(self) -> bool:
        """Whether anything was asked of it."""

    def part(self, rows: slice) -> Self:
        """Of some records; ValueError where it is integrated."""


def refuse_strangers(source: LogTable, columns: Mapping[str, str], known: Sequence[str], noun: str, table: str) -> None:
    """:class:`InputError` where one of ``columns`` is called after something that the vehicle file does not have, by their names."""
    for column, name in columns.items():
        if name not in known:
            hint = nearest(name, known, f"the nearest {noun} is") or f"; it has no [[{table}]] at all"
            raise InputError(
                f"{source.table.path}: column {column!r} names a {noun} that the vehicle file lacks{hint}. Add it to the vehicle file"
            )


def called(devices: Sequence[MomentumDevice]) -> str:
    """What a sentence calls all of them: wheels, say."""
    return " and ".join(dict.fromkeys(f"{device.NOUN}s" for device in devices))


def own_column(source: LogTable, actuator: Actuator, key: str, otherwise: str = "") -> str:
    """The column ``key`` of an actuator that may have either; :class:`InputError` where the log has another one alone."""
    column = next(one for one in actuator.COLUMNS if one.key == key).of(actuator.name)
    other = next((one for one in actuator.COLUMNS if one.key != key and source.has(one.of(actuator.name))), None)
    if other is not None and not source.has(column):
        raise InputError(
            f"{source.table.path}: {actuator.NOUN} {actuator.name!r} has column {source.name(other.of(actuator.name))!r} and no "
            f'{column!r}; state column = "{other.key}" under its [[{actuator.TABLE}]]{otherwise}'
        )
    return column


def refuse_other_units(
    source: LogTable, what: str, key: str, factors: Mapping[float, str], pairs: Sequence[tuple[float | None, Array | None]]
) -> None:
    """:class:`InputError` where the readings of all ``pairs`` (stated, readings) begin at what ``key`` states times one of ``factors``."""
    known = [(stated, float(readings[0])) for stated, readings in pairs if stated and readings is not None]
    for factor, why in factors.items():
        if known and all(abs(first - factor * stated) < NEAR * abs(factor * stated) for stated, first in known):
            raise InputError(
                f"{source.table.path}: the first {what} is {factor:.4g} times the {key} of the vehicle file: {why.format(key)}; correct "
                f"the {what.partition(' of ')[0]}s, or {key}"
            )


def unit(axis: Vector) -> Array:
    """(3,) of length one."""
    return np.asarray(np.array(axis) / np.linalg.norm(axis))


def pointing(what: str) -> AfterValidator:
    """Of an axis in a file, which must have a length."""

    def checked(axis: Vector) -> Vector:
        if not any(axis):
            raise ValueError(f"points nowhere; give the direction of {what} in body axes")
        return axis

    return AfterValidator(checked)
