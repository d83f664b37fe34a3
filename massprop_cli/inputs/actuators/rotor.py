"""Rotors (propellers): vehicle file table, log columns and thrust, a polynomial of x with separate lags for rising and falling x."""

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
    "rotor_", "_command", "command", PLAIN, False, True, "command of a rotor in this control cycle, the argument of its thrust_n"
)
FEW = 20
"""Minimum number of logged speeds to estimate the interpolation error between them."""
SPEED = LogColumn("rotor_", "_rad_s", "speed", SPIN, True, False, "a rotor's speed at time_s, rad/s")


class Rotor(Actuator):
    """Rotor: position, direction of thrust and rotation, thrust polynomial and lag."""

    TABLE: ClassVar = "rotors"
    NOUN: ClassVar = "rotor"
    COLUMNS: ClassVar = (COMMAND, SPEED)
    DOES: ClassVar = ("position_m", "axis", "spin", "thrust_n", "torque_ratio_m")
    THRUSTS: ClassVar = True

    position_m: Place
    axis: Annotated[Vector, pointing("the rotor's thrust")] = Field(
        description="direction of its thrust on the vehicle, body axes; any length"
    )
    spin: Literal[1, -1] = Field(
        description="1: right-handed rotation about the axis, with a left-handed drag torque on the vehicle; -1: opposite"
    )
    thrust_n: Annotated[tuple[Real, ...], Field(min_length=1, max_length=8)] = Field(
        description="coefficients c0, c1, c2, … of the thrust c0 + c1 x + c2 x² + …, N; x is the value of its column"
    )
    column: Literal["command", "speed"] = Field(
        "command", description="column of x: rotor_NAME_command, commanded for the cycle, or rotor_NAME_rad_s, measured at time_s"
    )
    torque_ratio_m: NonNegative = Field(0.0, description="drag torque about its axis over thrust")
    torque_steps_s: NonNegative | None = Field(
        None,
        description=(
            "time from a cycle's end to a change of motor torque, a knot of the speed; absent: estimated from the log. For a speed column"
        ),
    )
    lag_up_s: NonNegative | None = Field(None, description="first-order lag of x for a higher command; absent: thrust.lag_s")
    lag_down_s: NonNegative | None = Field(None, description="first-order lag of x for a lower command; absent: lag_up_s")
    nominal_v: Positive | None = Field(
        None, description="supply voltage at which thrust_n holds; commands are then scaled in proportion to column supply_v"
    )
    spin_inertia_kg_m2: Positive | None = Field(None, description="spin inertia of blades and motor about its axis; needs a logged speed")
    spin_inertia_sigma_kg_m2: NonNegative = 0.0
    locked_in_inertia: bool = Field(True, description="whether the body's inertia includes the rotor as locked")

    @model_validator(mode="after")
    def _fits_its_column(self) -> Self:
        if self.column == "speed" and (self.lag_up_s or self.lag_down_s or self.nominal_v):
            raise ValueError("a measured speed has no lag and needs no voltage: drop lag_up_s, lag_down_s and nominal_v")
        if self.column == "command" and self.spin_inertia_kg_m2 is not None:
            raise ValueError('spin_inertia_kg_m2 needs the rotor\'s speed: log it and state column = "speed", or drop spin_inertia_kg_m2')
        return self

    @property
    def wrench(self) -> Array:
        """(6,) torque about O [N m] and force [N] of one newton of thrust, body axes."""
        along = unit(self.axis)
        return np.concatenate([np.cross(self.position_m, along) - self.spin * self.torque_ratio_m * along, along])

    def lags(self, otherwise_s: float) -> tuple[float, float]:
        """Lags of rising and falling x, s; ``otherwise_s`` if not stated, 0 with a logged speed."""
        if self.column == "speed":
            return 0.0, 0.0
        up = otherwise_s if self.lag_up_s is None else self.lag_up_s
        return up, up if self.lag_down_s is None else self.lag_down_s

    @property
    def device(self) -> Wheel | None:
        """Wheel that represents the rotor's momentum; None without a stated spin inertia."""
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
        """Copy with ``factor`` times the spin inertia."""
        inertia = self.spin_inertia_kg_m2
        return self if inertia is None else self.model_copy(update={"spin_inertia_kg_m2": factor * inertia})

    @classmethod
    def draft(cls, name: str, has: LogColumn, span: str) -> list[str]:
        """Draft with the values to measure as comments."""
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
        """Log of the wheel that represents its momentum."""
        return WheelLog(frozen(source.interpolated(SPEED.of(self.name), n)), None, None)

    def held(self, asked: Array, begin_s: Array, at_once_s: Array, lag_s: float) -> "Held":
        """Values ``asked`` (K,) of x with their times: ``begin_s`` (K,) for commands, ``at_once_s`` (K,) for measured speeds."""
        measured = self.column == "speed"
        return Held(at_once_s if measured else begin_s, asked, *self.lags(lag_s), self.thrust_n, measured)

    def cycles_apart(self, source: LogTable, records: int, n: int) -> int:
        """Number of cycles per logged speed; 0 for a logged command."""
        if self.column == "command":
            return 0
        rows = source.samples(SPEED.of(self.name), n)
        return max(round(float(np.median(np.diff(rows))) / records), 1) if len(rows) > 1 else n // records

    def unsampled(self, x: Array, each: int) -> float:
        """Sigma of the thrust from interpolation between speeds ``x`` (K,), one logged in ``each`` cycles, N.

        E₂ is the rms error of a curve through every second speed at the speeds between, E₄ that of a curve through every fourth. The curve
        through all speeds then has the mean error ⅔ E₂² / E₄, for smooth speeds and for random walks (E₄ = √2 E₂). The error keeps its sign
        over m cycles, so it counts as white noise of m times the variance.
        """
        if not each or len(x) < FEW * each:
            return 0.0
        near, far = _interpolation_error(x, each), _interpolation_error(x, 2 * each)
        slope = float(np.sqrt(np.mean(np.polynomial.Polynomial(self.thrust_n).deriv()(x) ** 2)))
        return slope * each**0.5 * 2 / 3 * near * min(near / far, 1.0) if far else 0.0

    def asked(self, source: LogTable, records: int, n: int) -> Array:
        """(K,) commanded x of each cycle, or measured speed at the end of each cycle."""
        column = own_column(source, self, self.column, ", and thrust_n by that")
        return source.ends(column, records, n) if self.column == "speed" else source.per_cycle(column, records, n)


class Held(NamedTuple):
    """Command history of one rotor with its lags and thrust polynomial."""

    begin_s: Array
    """(K,) start of each interval, s."""
    asked: Array
    """(K,) commanded x in each interval, or x measured at its end."""
    up_s: float
    """Lag for rising x, s."""
    down_s: float
    """Lag for falling x, s."""
    thrust_n: Sequence[float]
    """Coefficients of the thrust polynomial, N, the constant first."""
    measured: bool = False
    """Whether values are measured at the ends of the intervals and linear in between."""


NODES, WEIGHTS = (each / 2 for each in np.polynomial.legendre.leggauss(5))
"""Gauss–Legendre nodes and weights on [−½, ½], exact for the thrust polynomial times time."""


def thrust_integrals(rotors: Sequence[Held], edges_s: Array) -> tuple[Array, Array]:
    """∫ T dt and ∫ (t − bin start) T dt over each bin of ``edges_s``, (bins, rotors) each; x starts at its first commanded value."""
    starts = {id(rotor.begin_s): rotor.begin_s for rotor in rotors}
    pieces = {key: _Pieces.of(begin_s, edges_s) for key, begin_s in starts.items()}
    bins = len(edges_s) - 1
    found = np.empty((2, bins, len(rotors)))
    for number, rotor in enumerate(rotors):
        own = pieces[id(rotor.begin_s)]
        integral, moment = _measured(rotor, own) if rotor.measured else _lagging(rotor, own)
        for part, each in zip(found, (integral, moment + own.into_s * integral), strict=True):
            part[:, number] = np.bincount(own.bins, each, bins)
    return found[0], found[1]


class _Pieces(NamedTuple):
    """Intervals between successive bin edges and command starts."""

    bins: IntArray
    """(n,) bin that contains the piece."""
    into_s: Array
    """(n,) time from the start of the bin to the start of the piece, s."""
    length_s: Array
    """(n,) length of the piece, s."""
    k: IntArray
    """(n,) command that acts in the piece."""
    since_s: Array
    """(n,) time from the start of that command to the start of the piece, s."""

    @staticmethod
    def of(begin_s: Array, edges_s: Array) -> "_Pieces":
        """Pieces of bins ``edges_s`` with commands that start at ``begin_s``."""
        inner = begin_s[(begin_s > edges_s[0]) & (begin_s < edges_s[-1])]
        points = np.sort(np.concatenate([edges_s, inner]))
        first = points[:-1]
        k = np.maximum(np.searchsorted(begin_s, first, "right") - 1, 0)
        bins = np.minimum(np.searchsorted(edges_s, first, "right") - 1, len(edges_s) - 2)
        return _Pieces(bins, first - edges_s[bins], np.diff(points), k, np.maximum(first - begin_s[k], 0.0))


def _measured(rotor: Held, pieces: _Pieces) -> tuple[Array, Array]:
    """(n,) ∫ T dt and (n,) ∫ t T dt over each piece, for x linear between measured speeds."""
    begin_s, length = rotor.begin_s, pieces.length_s
    elapsed_s = length[:, None] * (0.5 + NODES)
    end_s = np.append(begin_s[1:], 2 * begin_s[-1] - begin_s[-2:][0])
    speed = np.interp((begin_s[pieces.k] + pieces.since_s)[:, None] + elapsed_s, end_s, rotor.asked)
    thrust = np.polynomial.Polynomial(rotor.thrust_n)(speed)
    return length * (thrust @ WEIGHTS), length * ((thrust * elapsed_s) @ WEIGHTS)


def _interpolation_error(x: Array, n: int) -> float:
    """Rms difference of x (K,) from a cubic (:func:`massprop_cli.base.arrays.cubic`) through the values n and 3 n away."""
    error = x[3 * n : -3 * n] - (9 * (x[2 * n : -4 * n] + x[4 * n : -2 * n]) - x[: -6 * n] - x[6 * n :]) / 16
    return float(np.sqrt(np.mean(error**2)))


def _lagging(rotor: Held, pieces: _Pieces) -> tuple[Array, Array]:
    """(n,) ∫ T dt and (n,) ∫ t T dt over each piece, for x at ``u + d exp(−t / lag)``: thrust is a sum of ``exp(−n t / lag)``."""
    at, lag = _departures(rotor)
    k, length = pieces.k, pieces.length_s
    departure = at[k] * np.exp(-pieces.since_s / lag[k])
    polynomial = np.polynomial.Polynomial(rotor.thrust_n)
    settled = polynomial(rotor.asked)[k]
    integral, moment = settled * length, settled * length**2 / 2
    for n in range(1, len(rotor.thrust_n)) if at.any() else ():
        size, tau = (polynomial.deriv(n)(rotor.asked) / factorial(n))[k] * departure**n, (lag / n)[k]
        decayed = -np.expm1(-length / tau)
        integral += size * tau * decayed
        moment += size * tau * (tau * decayed - length * (1 - decayed))
    return integral, moment


def _departures(rotor: Held) -> tuple[Array, Array]:
    """(K,) difference d of x from the command at the start of each command, and (K,) its lag, s; d is 0 without a lag.

    With command steps s and decay factors, ``d[k + 1] = s[k + 1] + decay[k] d[k]``. The sign of d decides between rising and falling lag.
    The iteration converges, because each pass determines at least one more command.
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
