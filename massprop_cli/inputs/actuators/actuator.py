"""Interface of actuators: table in the vehicle file, columns in a log, and stored momentum in time.

The angular momentum of body and devices about the CG is ``I ω + Σ h``. Each device's h has components along body-fixed axes: one for a
wheel, two for a rotor in a gimbal. The torque on the body is ``−(ḣ + ω × h)``.
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
"""Momentum factor that represents a dead device, since a vehicle file does not accept 0."""
NEAR = 0.02
"""Relative tolerance within which a first reading counts as the stated value in another unit."""
SPEEDS = {
    30 / np.pi: "it is in rpm",
    np.pi / 30: "{} is in rpm",
    180 / np.pi: "it is in deg/s",
    1 / (2 * np.pi): "it is in revolutions per second",
    -1.0: "it has the other sign",
    -30 / np.pi: "it is in rpm, and has the other sign",
}
"""Factor of a first reading over the stated speed, and the unit or sign error that explains it."""


class LogColumn(NamedTuple):
    """A log column of each actuator of one kind: prefix, actuator name, suffix."""

    start: str
    """Prefix of the column name."""
    end: str
    """Suffix of the column name."""
    key: str
    """Name of the quantity in the vehicle file."""
    units: Mapping[str, float]
    """Accepted units, with factors to SI."""
    instant: bool
    """Whether the value is at ``time_s``; otherwise it holds over a control cycle."""
    nullable: bool
    """Whether a cell may be empty."""
    description: str

    def of(self, name: str) -> str:
        """Column name of the actuator ``name``."""
        return f"{self.start}{name}{self.end}"

    def named(self, column: str) -> str | None:
        """Actuator name in a column name; None for other columns."""
        fits = column.startswith(self.start) and column.endswith(self.end) and len(column) > len(self.start) + len(self.end)
        return column.removeprefix(self.start).removesuffix(self.end) if fits else None


class Actuator(Section):
    """One of the vehicle's actuators."""

    TABLE: ClassVar[str]
    """Table of the vehicle file."""
    NOUN: ClassVar[str]
    """Noun for messages."""
    COLUMNS: ClassVar[tuple[LogColumn, ...]]
    """Possible log columns; the first has priority."""
    DOES: ClassVar[tuple[str, ...]]
    """Keys that describe its effect on the vehicle; a wiring swap exchanges them."""
    THRUSTS: ClassVar[bool] = False
    """Whether its commands replace those of jets or a wrench."""

    name: str = Field(min_length=1, pattern=r"^[^\x00-\x1f\x7f]+$")

    @classmethod
    def named(cls, column: str) -> str | None:
        """Name of the actuator of this kind in a column name; None for other columns."""
        return next((name for one in cls.COLUMNS if (name := one.named(column)) is not None), None)

    @classmethod
    @abstractmethod
    def draft(cls, name: str, has: LogColumn, span: str) -> list[str]:
        """Lines of a drafted vehicle file for an actuator of which the log has a column that runs over ``span`` (empty: unknown)."""

    @property
    @abstractmethod
    def device(self) -> MomentumDevice | None:
        """Momentum device of the actuator; None if it stores no known momentum."""

    @abstractmethod
    def read(self, source: LogTable, records: int, n: int) -> MomentumLog:
        """Log of its device from n rows, ``records`` per cycle. Raises :class:`InputError` with column and remedy."""

    @classmethod
    def check_together(cls, source: LogTable, own: Sequence[Self], logs: Sequence[MomentumLog]) -> None:
        """Raise :class:`InputError` if the logs of all actuators of this kind contradict the vehicle file."""

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """Copy with ``factor`` times the momentum."""

    def acting(self, factors: Array) -> Self | None:
        """Copy whose momentum along each axis has the given factor; None if no values of its keys give that."""
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
        """(a, 3) body-fixed unit vectors along which its momentum has components."""

    @property
    @abstractmethod
    def beyond_reported(self) -> Array:
        """(3, 3) inertia of the device in the equation of motion less its inertia in the reported value, kg m²."""

    @property
    @abstractmethod
    def unknowns(self) -> tuple[Unknown, ...]:
        """Errors of its stated values with positive sigma, as nuisance parameters."""

    @abstractmethod
    def momentum(self, history: MomentumLog, log: LogTimes) -> Grown:
        """Its momentum in time."""

    @property
    def free_inertia(self) -> Array:
        """(a,) spin inertia J along each axis if J (W + a · ω) grows evenly between speed readings, kg m²; 0 otherwise."""
        return np.zeros(len(self.axes))

    def scatter(self, history: MomentumLog, weight: Array) -> float:  # noqa: ARG002
        """Sigma of its momentum's white noise per record, N m s; ``weight`` (n,) weights the records. Zero unless overridden."""
        return 0.0

    @property
    def channels(self) -> tuple[str, ...]:
        """(a,) names of its axes."""
        return (self.name,) if len(self.axes) == 1 else tuple(f"{self.name} {number}" for number in range(1, len(self.axes) + 1))


class Unknown(NamedTuple):
    """Error ε of a stated value of a device, which adds the momentum ``ε (by (h − h₀) + constant)`` along its axes or ``across``."""

    sigma: float
    """Prior sigma of ε."""
    by: Array
    """(a, a) factor of the momentum."""
    constant: Array
    """(a,) constant part, N m s."""
    since_start: bool
    """True: h₀ is the momentum at the start of the log; False: h₀ is 0."""
    across: Array | None = None
    """(a, 3) directions of the added momentum if they are not the axes."""

    @property
    def scales(self) -> bool:
        """Whether ε is a relative error of the device's torque."""
        return self.across is None and bool((self.by == np.eye(len(self.by))).all())


class Grown(NamedTuple):
    """Momentum of a device in time, linear between given times."""

    time_s: Array
    """(P,) times on the commands' clock, s."""
    momentum: Array
    """(a, P) momentum, N m s."""


@dataclass(frozen=True)
class LogTimes:
    """Times of n records and M rows of commands, and the body's rotation."""

    edge_s: Array
    """(n + 1,) start of the first record and end of each record on the commands' clock, s."""
    interval_s: Array
    """(n,) length of each record, s."""
    period_s: float
    """Length of a control cycle, s."""
    at_once_s: Array
    """(M,) start of the effect of measured values on the commands' clock, s."""
    delayed_s: Array
    """(M,) start of the effect of commands on the commands' clock, s."""
    turn_rad: Callable[[slice], Array]
    """Function that gives the (…, 3) rotation of the body in the given records, body axes, rad."""


class MomentumLog(Protocol):
    """Log of one momentum device."""

    @property
    def integrated(self) -> bool:
        """Whether its momentum is integrated over the log."""

    @property
    def known_before(self) -> bool:
        """Whether its momentum is known before the end of the first record."""

    @property
    def moved(self) -> bool:
        """Whether its momentum changed or a torque was commanded."""

    def part(self, rows: slice) -> Self:
        """Log of the given records. Raises ValueError if the momentum is integrated."""


def refuse_strangers(source: LogTable, columns: Mapping[str, str], known: Sequence[str], noun: str, table: str) -> None:
    """Raise :class:`InputError` if one of ``columns`` (column: actuator name) names an actuator that is not in ``known``."""
    for column, name in columns.items():
        if name not in known:
            hint = nearest(name, known, f"the nearest {noun} is") or f"; it has no [[{table}]]"
            raise InputError(
                f"{source.table.path}: column {column!r} names a {noun} that the vehicle file lacks{hint}. Add it to the vehicle file"
            )


def called(devices: Sequence[MomentumDevice]) -> str:
    """Plural noun of all devices for messages."""
    return " and ".join(dict.fromkeys(f"{device.NOUN}s" for device in devices))


def own_column(source: LogTable, actuator: Actuator, key: str, otherwise: str = "") -> str:
    """Column ``key`` of an actuator. Raises :class:`InputError` if the log has only another column of it."""
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
    """Raise :class:`InputError` if the first readings of all ``pairs`` (stated, readings) equal the stated values times one factor."""
    known = [(stated, float(readings[0])) for stated, readings in pairs if stated and readings is not None]
    for factor, why in factors.items():
        if known and all(abs(first - factor * stated) < NEAR * abs(factor * stated) for stated, first in known):
            raise InputError(
                f"{source.table.path}: the first {what} is {factor:.4g} times the {key} of the vehicle file: {why.format(key)}; correct "
                f"the {what.partition(' of ')[0]}s, or {key}"
            )


def unit(axis: Vector) -> Array:
    """(3,) unit vector along ``axis``."""
    return np.asarray(np.array(axis) / np.linalg.norm(axis))


def pointing(what: str) -> AfterValidator:
    """Validator that refuses an axis of length zero."""

    def checked(axis: Vector) -> Vector:
        if not any(axis):
            raise ValueError(f"has length 0; give the direction of {what} in body axes")
        return axis

    return AfterValidator(checked)
