"""Rotors (propellers) as a vehicle file states them, and their thrust: a polynomial of a speed that lags its command, up and down apart."""

import json
from collections.abc import Sequence
from math import factorial
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from massprop_cli.base.arrays import Array, IntArray, frozen, recursion
from massprop_cli.inputs.actuators.actuator import Actuator, LogColumn, own_column, pointing, unit
from massprop_cli.inputs.actuators.wheel import Wheel, WheelLog
from massprop_cli.inputs.formats.units import PLAIN, SPIN
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.section import NonNegative, Place, Positive, Real, Vector

COMMAND = LogColumn(
    "rotor_", "_command", "command", PLAIN, False, True, "what a rotor is commanded in this control cycle, as its thrust_n takes it"
)
FEW = 20
"""Logged speeds from which on it is known how a rotor turns between them."""
SPEED = LogColumn("rotor_", "_rad_s", "speed", SPIN, True, False, "a rotor's speed at time_s, rad/s")


class Rotor(Actuator):
    """One rotor: where it is, which way it pushes and turns, its thrust by command or speed, how fast that follows."""

    TABLE: ClassVar = "rotors"
    NOUN: ClassVar = "rotor"
    COLUMNS: ClassVar = (COMMAND, SPEED)
    DOES: ClassVar = ("position_m", "axis", "spin", "thrust_n", "torque_ratio_m")
    THRUSTS: ClassVar = True

    position_m: Place
    axis: Annotated[Vector, pointing("the rotor's thrust")] = Field(
        description="direction of its thrust on the vehicle, body axes; of any length"
    )
    spin: Literal[1, -1] = Field(
        description="1: it turns right-handed about the axis, and its drag turns the vehicle left-handed; -1: the other way"
    )
    thrust_n: Annotated[tuple[Real, ...], Field(min_length=1, max_length=8)] = Field(
        description="coefficients c0, c1, c2, … of its thrust in N: c0 + c1 x + c2 x² + …, x the number in its column"
    )
    column: Literal["command", "speed"] = Field(
        "command", description="x: rotor_NAME_command, as commanded for the cycle, or rotor_NAME_rad_s, as measured at time_s"
    )
    torque_ratio_m: NonNegative = Field(0.0, description="drag torque about its axis over thrust")
    torque_steps_s: NonNegative | None = Field(
        None,
        description="from a cycle's end until its motor is told otherwise, so that its speed bends there; absent: found in the log. For a "
        "speed column",
    )
    lag_up_s: NonNegative | None = Field(None, description="first-order lag of x behind a command that is higher; absent: thrust.lag_s")
    lag_down_s: NonNegative | None = Field(None, description="the same behind one that is lower; absent: lag_up_s")
    nominal_v: Positive | None = Field(
        None, description="supply voltage that thrust_n holds for; commands count in proportion to column supply_v then"
    )
    spin_inertia_kg_m2: Positive | None = Field(None, description="about its axis, of blades and motor; needs its speed")
    spin_inertia_sigma_kg_m2: NonNegative = 0.0
    locked_in_inertia: bool = Field(True, description="whether the body's inertia has it in it as if it were locked")

    @model_validator(mode="after")
    def _fits_its_column(self) -> Self:
        if self.column == "speed" and (self.lag_up_s or self.lag_down_s or self.nominal_v):
            raise ValueError("a measured speed has no lag and needs no voltage: drop lag_up_s, lag_down_s and nominal_v")
        if self.column == "command" and self.spin_inertia_kg_m2 is not None:
            raise ValueError('spin_inertia_kg_m2 needs the rotor\'s speed: log it and state column = "speed", or drop spin_inertia_kg_m2')
        return self

    @property
    def wrench(self) -> Array:
        """(6,) torque about O and force of one newton of thrust."""
        along = unit(self.axis)
        return np.concatenate([np.cross(self.position_m, along) - self.spin * self.torque_ratio_m * along, along])

    def lags(self, otherwise_s: float) -> tuple[float, float]:
        """Of rising and of falling thrust, s."""
        if self.column == "speed":
            return 0.0, 0.0
        up = otherwise_s if self.lag_up_s is None else self.lag_up_s
        return up, up if self.lag_down_s is None else self.lag_down_s

    @property
    def device(self) -> Wheel | None:
        """What turns with it, where its spin inertia is stated."""
        if self.spin_inertia_kg_m2 is None:
            return None
        x, y, z = self.axis
        return Wheel(
            name=self.name,
            axis=(self.spin * x, self.spin * y, self.spin * z),
            spin_inertia_kg_m2=self.spin_inertia_kg_m2,
            spin_inertia_sigma_kg_m2=self.spin_inertia_sigma_kg_m2,
            locked_in_inertia=self.locked_in_inertia,
            torque_steps_s=self.torque_steps_s,
        )

    def scaled(self, factor: float) -> Self:
        """The same with so many times its spin inertia."""
        inertia = self.spin_inertia_kg_m2
        return self if inertia is None else self.model_copy(update={"spin_inertia_kg_m2": factor * inertia})

    @classmethod
    def draft(cls, name: str, has: LogColumn, span: str) -> list[str]:
        """What has to be measured of it as comments."""
        return [
            "[[rotors]]",
            f"name = {json.dumps(name, ensure_ascii=False)}   # column {has.of(name)}{span and ': '}{span}",
            *['column = "speed"   # as measured; its command is not logged'] * (has is SPEED),
            "# position_m = [x, y, z]    # of its hub from O, body axes, m: drawing or ruler",
            "# axis = [x, y, z]          # of its thrust on the vehicle, body axes",
            "# spin = 1                  # if it turns right-handed about that axis; else -1: look at it turn",
            "# thrust_n = [c0, c1, c2]   # c0 + c1 x + c2 x^2 of the number x in its column, N: press on a scale at several x, or "
            "data sheet",
            "# torque_ratio_m = ...      # drag torque over thrust, m: a test stand; left out, none",
            "",
        ]

    def read(self, source: LogTable, records: int, n: int) -> WheelLog:  # noqa: ARG002
        """The speed of what turns with it."""
        return WheelLog(frozen(source.between(SPEED.of(self.name), n)), None, None)

    def held(self, asked: Array, begin_s: Array, at_once_s: Array, lag_s: float) -> "Held":
        """Of what is asked for in cycles (K,) that act from ``begin_s`` on as commanded; as measured, at once."""
        measured = self.column == "speed"
        return Held(at_once_s if measured else begin_s, asked, *self.lags(lag_s), self.thrust_n, measured)

    def cycles_apart(self, source: LogTable, records: int, n: int) -> int:
        """How many cycles of ``records`` one logged speed stands for; 0 of a command."""
        if self.column == "command":
            return 0
        rows = source.samples(SPEED.of(self.name), n)
        return max(round(float(np.median(np.diff(rows))) / records), 1) if len(rows) > 1 else n // records

    def unsampled(self, x: Array, each: int) -> float:
        """One sigma of thrust [N] by what a rotor did between speeds ``x`` (K,), of which one in ``each`` cycles was logged.

        A curve through every second speed misses those between by E₂ (rms), one through every fourth by E₄. So a curve through all misses
        what lies between two by ⅔ E₂² / E₄ in the mean, whether the speed is smooth or wanders (E₄ = √2 E₂). The error keeps its sign over
        m cycles: that counts as white noise of m times the variance in each.
        """
        if not each or len(x) < FEW * each:
            return 0.0
        near, far = _beside_curve(x, each), _beside_curve(x, 2 * each)
        slope = float(np.sqrt(np.mean(np.polynomial.Polynomial(self.thrust_n).deriv()(x) ** 2)))
        return slope * each**0.5 * 2 / 3 * near * min(near / far, 1.0) if far else 0.0

    def asked(self, source: LogTable, records: int, n: int) -> Array:
        """(K,) what it is told in each cycle, as its thrust_n takes it; or its measured speed at the end of each."""
        column = own_column(source, self, self.column, ", and thrust_n by that")
        return source.ends(column, records, n) if self.column == "speed" else source.per_cycle(column, records, n)


class Held(NamedTuple):
    """What is asked for from each time to the next, or measured at the next; the lags behind it, and the thrust that it makes."""

    begin_s: Array
    asked: Array
    up_s: float
    down_s: float
    thrust_n: Sequence[float]
    """Coefficients of the polynomial, the constant first."""
    measured: bool = False
    """Whether each was measured at the next one's time, and it changes evenly in between."""


NODES, WEIGHTS = (each / 2 for each in np.polynomial.legendre.leggauss(5))
"""Of Gauss's rule from −½ to ½, exact for a thrust of :attr:`Rotor.thrust_n` times the time."""


def thrust_integrals(rotors: Sequence[Held], edges_s: Array) -> tuple[Array, Array]:
    """∫ T dt and ∫ (t − bin start) T dt over each bin of ``edges_s``, (bins, rotors) each; before its first command a rotor stood there."""
    begun = {id(rotor.begin_s): rotor.begin_s for rotor in rotors}
    pieces = {key: _Pieces.of(begin_s, edges_s) for key, begin_s in begun.items()}
    bins = len(edges_s) - 1
    found = np.empty((2, bins, len(rotors)))
    for number, rotor in enumerate(rotors):
        own = pieces[id(rotor.begin_s)]
        integral, moment = _measured(rotor, own) if rotor.measured else _lagging(rotor, own)
        for part, each in zip(found, (integral, moment + own.into_s * integral), strict=True):
            part[:, number] = np.bincount(own.bins, each, bins)
    return found[0], found[1]


class _Pieces(NamedTuple):
    """Time from each bin's edge or command to the next."""

    bins: IntArray
    """(n,) in which bin a piece is; the last piece is in the last."""
    into_s: Array
    """From the bin's beginning to the piece's."""
    length_s: Array
    k: IntArray
    """(n,) whose command holds in a piece."""
    since_s: Array
    """From that command to the piece's beginning."""

    @staticmethod
    def of(begin_s: Array, edges_s: Array) -> "_Pieces":
        """Of commands that act from ``begin_s`` on."""
        inner = begin_s[(begin_s > edges_s[0]) & (begin_s < edges_s[-1])]
        points = np.sort(np.concatenate([edges_s, inner]))
        first = points[:-1]
        k = np.maximum(np.searchsorted(begin_s, first, "right") - 1, 0)
        bins = np.minimum(np.searchsorted(edges_s, first, "right") - 1, len(edges_s) - 2)
        return _Pieces(bins, first - edges_s[bins], np.diff(points), k, np.maximum(first - begin_s[k], 0.0))


def _measured(rotor: Held, pieces: _Pieces) -> tuple[Array, Array]:
    """∫ T dt and ∫ t T dt over each piece, where it changes evenly between speeds."""
    begin_s, length = rotor.begin_s, pieces.length_s
    gone_s = length[:, None] * (0.5 + NODES)
    end_s = np.append(begin_s[1:], 2 * begin_s[-1] - begin_s[-2:][0])
    speed = np.interp((begin_s[pieces.k] + pieces.since_s)[:, None] + gone_s, end_s, rotor.asked)
    thrust = np.polynomial.Polynomial(rotor.thrust_n)(speed)
    return length * (thrust @ WEIGHTS), length * ((thrust * gone_s) @ WEIGHTS)


def _beside_curve(x: Array, n: int) -> float:
    """By how much x (K,), rms, is off a curve (:func:`massprop_cli.base.arrays.cubic`) through those n, 3 n, … away."""
    found = x[3 * n : -3 * n] - (9 * (x[2 * n : -4 * n] + x[4 * n : -2 * n]) - x[: -6 * n] - x[6 * n :]) / 16
    return float(np.sqrt(np.mean(found**2)))


def _lagging(rotor: Held, pieces: _Pieces) -> tuple[Array, Array]:
    """The same where it is at ``x + d exp(−t / lag)``, so that thrust is a sum of ``exp(−n t / lag)``."""
    at, lag = _departures(rotor)
    k, length = pieces.k, pieces.length_s
    left = at[k] * np.exp(-pieces.since_s / lag[k])
    polynomial = np.polynomial.Polynomial(rotor.thrust_n)
    settled = polynomial(rotor.asked)[k]
    integral, moment = settled * length, settled * length**2 / 2
    for n in range(1, len(rotor.thrust_n)) if at.any() else ():
        size, tau = (polynomial.deriv(n)(rotor.asked) / factorial(n))[k] * left**n, (lag / n)[k]
        gone = -np.expm1(-length / tau)
        integral += size * tau * gone
        moment += size * tau * (tau * gone - length * (1 - gone))
    return integral, moment


def _departures(rotor: Held) -> tuple[Array, Array]:
    """(K,) by how much it is over what is asked for as each command begins, and the lag (s) with which that goes; nothing without a lag.

    Of steps s and of what is kept until the next, ``d[k + 1] = s[k + 1] + kept[k] d[k]``. Which lag it is, up or down, d itself tells: from
    the first command on one more is right each time.
    """
    length, steps = np.diff(rotor.begin_s, append=rotor.begin_s[-1]), -np.diff(rotor.asked, prepend=rotor.asked[0])
    rising = steps < 0
    while True:
        lag = np.where(rising, rotor.up_s, rotor.down_s)
        lags = np.where(lag > 0, lag, 1.0)
        found = recursion(steps, np.roll(np.exp(-length / lags) * (lag > 0), 1))
        before, rising = rising, found < 0
        if rotor.up_s == rotor.down_s or (rising == before).all():
            return found * (lag > 0), lags
