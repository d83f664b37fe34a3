"""Reaction wheels: vehicle file table, log columns and momentum.

A wheel turns about a body-fixed axis a with the momentum ``h = J W`` along it, J its spin inertia, W its speed relative to the body. I is
the body's inertia about its CG with the wheel locked. The equation of motion of body and wheel is

    I ω̇ + a J Ẇ + ω × (I ω + a J W) = τ − c × F          with logged speed W
    (I − J a aᵀ) ω̇ + a T + ω × ((I − J a aᵀ) ω + a h) = τ − c × F,   ḣ = T,  h = J (W + a · ω)          with logged torque T on the wheel
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from massprop_cli.base.arrays import Array, IntArray, frozen
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.actuators import actuator
from massprop_cli.inputs.formats.units import SPIN, TORQUE
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.section import NonNegative, Positive, Real, Vector

SPEED = actuator.LogColumn("wheel_", "_rad_s", "speed", SPIN, True, True, "a wheel's speed relative to the body at time_s, rad/s")
ON_WHEEL = actuator.LogColumn(
    "wheel_", "_n_m", "torque", TORQUE, False, True, "torque on a wheel over this control cycle, N m; the body feels the opposite"
)
FOR_A_PARABOLA = 8
"""Minimum number of records for extrapolation by a parabola; with fewer it is too noisy."""
DISTINCT, WHOLE = 10, 1e-4
"""Minimum number of distinct values to detect a quantisation step, and tolerance of whole multiples in steps."""
STANDS = 16
"""Maximum number of records with one count in which the speed counts as linear."""
BENDS = 0.05
"""Maximum fraction of records at which the second difference of counts exceeds 1, for speeds that count as linear between counts."""


def step_of(values: Array) -> float:
    """Quantisation step of ``values``; 0 if they are not whole multiples of one step."""
    apart = np.diff(np.unique(values))
    if len(apart) < DISTINCT:
        return 0.0
    counts = values / apart.min()
    return float(apart.min()) if np.abs(counts - counts.round()).max() < WHOLE else 0.0


def dequantised(counts: Array) -> tuple[Array, Array, IntArray]:
    """(n,) estimated values of quantised ``counts`` (n,), (n,) their variances, and (n,) number of records with the same count.

    Where a count changes by one, the value is midway between both counts at an unknown time between the two records. It is linear between
    such times, and a parabola where it turns back. The time is uniform within a record, so the variance of a count that lasts L records is
    1/(12 L²). It is 1/24 where the value turns back or the count lasts long, and 1/12 where counts change faster.
    """
    places, edge = np.arange(len(counts)), np.flatnonzero(np.diff(counts))
    run = np.searchsorted(edge, places)
    length = np.diff(edge, prepend=-1, append=len(counts) - 1)[run]
    change = np.concatenate([[0.0], np.diff(counts)[edge], [0.0]])
    enters, leaves = change[run], change[run + 1]
    part = (places - np.append(-1, edge)[run] - 0.5) / length
    inner = (np.abs(enters) == 1) & (np.abs(leaves) == 1)
    on = inner & (enters == leaves)
    values = np.where(on, counts + enters * (part - 0.5), counts - inner * enters * (part - 0.5) ** 2 * 2)
    variance = np.where(on & (length <= STANDS), 1 / length**2, np.where(inner, 0.5, 1.0)) / 12
    return values, variance, length


class Wheel(actuator.MomentumDevice):
    """Reaction wheel: axis, spin inertia, and the meaning of its log column."""

    TABLE: ClassVar = "wheels"
    NOUN: ClassVar = "wheel"
    COLUMNS: ClassVar = (SPEED, ON_WHEEL)
    DOES: ClassVar = ("axis", "spin_inertia_kg_m2")

    axis: Annotated[Vector, actuator.pointing("the wheel's axis")] = Field(description="direction of positive speed, body axes; any length")
    axis_sigma_rad: NonNegative = Field(0.0, le=0.3, description="one sigma of its direction about each axis across it; estimated")
    spin_inertia_kg_m2: Positive = Field(description="spin inertia about its axis")
    spin_inertia_sigma_kg_m2: NonNegative = Field(0.0, description="one sigma of spin_inertia_kg_m2; included in every sigma")
    locked_in_inertia: bool = Field(
        description=(
            "whether the body's inertia, given and reported, includes this wheel as locked; false: without its spin inertia"
            " about its axis. The wheel's mass and transverse inertia are always included"
        )
    )
    column: Literal["speed", "torque"] = Field(
        "speed",
        description=(
            "logged quantity: wheel_NAME_rad_s, speed relative to the body at time_s, or wheel_NAME_n_m, torque on the wheel over the cycle"
        ),
    )
    speed_sigma_rad_s: NonNegative = Field(0.0, description="white noise of each logged speed, one sigma. For a speed column")
    speed_step_rad_s: NonNegative | None = Field(
        None, description="quantisation step of logged speeds; absent: estimated from the log. For a speed column"
    )
    between_counts: bool = Field(
        True,
        description=(
            "whether a quantised speed is interpolated from the times at which its count changes, which needs later "
            "readings; false: each speed is its count. For a speed column"
        ),
    )
    speed_window_s: NonNegative = Field(
        0.0, description="averaging time of each logged speed, as with counted pulses; 0: instantaneous. For a speed column"
    )
    speed_latency_s: NonNegative = Field(
        0.0, description="time from the end of that average, or from the instantaneous speed, to time_s. For a speed column"
    )
    torque_steps_s: NonNegative | None = Field(
        None,
        description=(
            "time from a record's end to a step of the torque on the wheel, a knot of the speed; absent: estimated from the"
            " log. For a speed column"
        ),
    )
    holds: Literal["torque", "speed"] | None = Field(
        None,
        description=(
            "quantity that the wheel's drive holds constant between two readings: motor torque (its relative speed then "
            "changes with the body rate), or acceleration relative to the body; absent: estimated from the log. For a speed"
            " column"
        ),
    )
    speed_error_in_noise: bool = Field(
        False,
        description=(
            "whether imu.gyro_noise_rad_s and environment.disturbance_torque_n_m include the effect of speed_sigma_rad_s "
            "and speed_step_rad_s, as in the settings of a result"
        ),
    )
    torque_is: Literal["commanded", "measured"] = Field(
        "commanded",
        description=("meaning of a torque column: a commanded torque acts after cycle.command_delay_cycles, a measured torque at once"),
    )
    torque_scale_sigma: NonNegative = Field(0.0, description="relative uncertainty of a torque column; included in every sigma")
    start_rad_s: Real | None = Field(
        None,
        description=(
            "speed relative to the body when the first torque of the log acts (a commanded torque acts after the delay); "
            "absent: first cell of wheel_NAME_rad_s. For a torque column. massprop refuses speeds that start at this value "
            "in another unit or with the opposite sign"
        ),
    )
    start_sigma_rad_s: NonNegative = Field(0.0, description="one sigma of start_rad_s; included in every sigma")
    coulomb_friction_n_m: NonNegative = Field(
        0.0, description="friction torque opposite to the speed, of constant size. For a torque column"
    )
    viscous_friction_n_m_s: NonNegative = Field(0.0, description="friction torque over speed, opposite to it. For a torque column")

    @classmethod
    def draft(cls, name: str, has: actuator.LogColumn, span: str) -> list[str]:  # noqa: ARG003
        """Draft as comments, because no log gives these values."""
        return [
            "# [[wheels]]            # each of these is needed; data sheet or drawing",
            f"# name = {json.dumps(name, ensure_ascii=False)}",
            f'# column = "{has.key}"',
            "# axis = [x, y, z]            # of positive speed, body axes",
            "# spin_inertia_kg_m2 = ...    # about that axis",
            "# locked_in_inertia = false   # or true, if the body's inertia is to have the wheel in it as if it were locked",
            "",
        ]

    @property
    def direction(self) -> Array:
        """(3,) unit vector of the axis, body axes."""
        return actuator.unit(self.axis)

    @property
    def axes(self) -> Array:
        """(1, 3) unit vector of the axis, body axes."""
        return self.direction[None]

    @property
    def beyond_reported(self) -> Array:
        """(3, 3) inertia in the equation of motion less reported inertia, kg m²; the equation locks a wheel with logged speed."""
        locked = self.spin_inertia_kg_m2 * np.outer(self.direction, self.direction)
        return np.asarray((int(self.column == "speed") - int(self.locked_in_inertia)) * locked)

    @property
    def free_inertia(self) -> Array:
        """(1,) spin inertia if the motor torque is constant between speed readings, so that J (W + a · ω) grows evenly, kg m²; else 0."""
        exact = not (self.speed_latency_s or self.speed_window_s or self.torque_steps_s or self.holds == "speed")
        return np.array([self.spin_inertia_kg_m2 * (exact and self.column == "speed")])

    @property
    def unknowns(self) -> tuple[actuator.Unknown, ...]:
        """Nuisance parameters: spin inertia (relative) by speed; initial speed, rad/s, and torque (relative) by torque; axis, rad."""
        relative = self.spin_inertia_sigma_kg_m2 / self.spin_inertia_kg_m2
        if self.column == "speed":
            found = [actuator.Unknown(relative, np.eye(1), np.zeros(1), False)]
        else:
            start = float(np.hypot(self.start_sigma_rad_s, relative * (self.start_rad_s or 0.0)))
            begun = actuator.Unknown(start, np.zeros((1, 1)), np.array([self.spin_inertia_kg_m2]), False)
            found = [begun, actuator.Unknown(self.torque_scale_sigma, np.eye(1), np.zeros(1), True)]
        lines = np.linalg.svd(self.axes)[2][1:]  # two directions orthogonal to the axis
        found += [actuator.Unknown(self.axis_sigma_rad, np.eye(1), np.zeros(1), False, line[None]) for line in lines]
        return tuple(one for one in found if one.sigma > 0)

    def scaled(self, factor: float) -> Self:
        """Copy with ``factor`` times the spin inertia."""
        return self.model_copy(update={"spin_inertia_kg_m2": factor * self.spin_inertia_kg_m2})

    def acting(self, factors: Array) -> Self:
        """Copy with the given factor of the momentum; a negative factor reverses the axis."""
        x, y, z = self.axis
        size = max(abs(float(factors[0])), actuator.DEAD)
        axis = (-x, -y, -z) if factors[0] < 0 else self.axis
        return self.model_copy(update={"axis": axis, "spin_inertia_kg_m2": size * self.spin_inertia_kg_m2})

    def read(self, source: LogTable, records: int, n: int) -> "WheelLog":
        """Log of the wheel from the column that the vehicle file states. Raises :class:`InputError` without an initial speed."""
        column, speed = actuator.own_column(source, self, self.column), SPEED.of(self.name)
        if self.column == "speed":
            return WheelLog(frozen(source.required(column)[:n]), None, None)
        start = self.start_rad_s
        if start is None and source.has(speed):
            first = float(source.optional(speed)[0])
            start = first if np.isfinite(first) else None
        if start is None:
            raise InputError(
                f"{source.table.path}: the speed of wheel {self.name!r} at its first torque is not known; state start_rad_s under its "
                f"[[wheels]], or write its speed into the first cell of column {speed!r}"
            )
        return WheelLog(None, frozen(source.per_cycle(column, records, n)), start)

    @classmethod
    def check_together(cls, source: LogTable, own: Sequence[Self], logs: Sequence[actuator.MomentumLog]) -> None:
        """Raise :class:`InputError` if all first speeds equal the stated ones in another unit or sign; the motion cannot show it."""
        pairs = [(wheel.start_rad_s, one.speed_rad_s) for wheel, one in zip(own, logs, strict=True) if isinstance(one, WheelLog)]
        actuator.refuse_other_units(source, "speed of each wheel", "start_rad_s", actuator.SPEEDS, pairs)

    def dequantised_speed(self, speed: Array) -> tuple[Array, Array, IntArray]:
        """Results of :func:`dequantised` for logged speeds (n,): speeds, rad/s, their variances, and records per count.

        Speeds stay as logged if ``between_counts`` is false, or if counts show that the speed is not linear between them.
        """
        step = step_of(speed) if self.speed_step_rad_s is None else self.speed_step_rad_s
        if step == 0:
            return speed, np.full(len(speed), self.speed_sigma_rad_s**2), np.ones(len(speed), dtype=int)
        counts = np.round(speed / step)
        values, variance, length = dequantised(counts)
        if not self.between_counts or np.mean(np.abs(np.diff(counts, 2)) > 1) > BENDS:
            values, variance = counts, np.full(len(counts), 1 / 12)
        return step * values, self.speed_sigma_rad_s**2 + step**2 * variance, length

    def scatter(self, history: actuator.MomentumLog, weight: Array) -> float:
        """Sigma of the momentum from tachometer noise and quantisation, N m s."""
        if not isinstance(history, WheelLog) or history.speed_rad_s is None or self.speed_error_in_noise:
            return 0.0
        _, variance, length = self.dequantised_speed(history.speed_rad_s)
        # a quantisation error is constant while a count lasts, so its variance counts once per record of the count
        noise = self.speed_sigma_rad_s**2
        each = noise + length * (variance - noise)
        return self.spin_inertia_kg_m2 * float(np.sqrt(np.average(each, weights=weight if weight.any() else None)))

    def momentum(self, history: actuator.MomentumLog, log: actuator.LogTimes) -> actuator.Grown:
        """Momentum in time: relative to the body at the speed's knots, or total by integration of torque less friction."""
        assert isinstance(history, WheelLog)
        if history.speed_rad_s is not None:
            speed, has_start = history.speed_rad_s, history.start_rad_s is not None
            at = log.edge_s[1 - has_start :] + history.after_s
            return actuator.Grown(at, self.spin_inertia_kg_m2 * np.append([history.start_rad_s] * has_start, speed)[None])
        at = log.delayed_s if self.torque_is == "commanded" else log.at_once_s
        time_s = np.append(at, at[-1] + log.period_s)
        return actuator.Grown(time_s, self._driven(history, time_s, log)[None])

    def _turning_at(self, log: actuator.LogTimes, moment_s: float) -> float:
        """Body rate about the axis at ``moment_s``, when the first torque acts, rad/s; from earlier records, which exclude that torque.

        Extrapolated by a parabola (a line for few records) through two cycles; without earlier records, the first record's rate.
        """
        end_s, cycle = log.edge_s[1:], round(log.period_s / log.interval_s[0])
        last = int(np.searchsorted(end_s, moment_s + 1e-6 * log.interval_s[0], "right"))
        used = slice(max(last - 2 * cycle, 0), max(last, 1))
        interval = log.interval_s[used]
        rate = log.turn_rad(used) @ self.direction / interval
        since = end_s[used] - interval / 2 - moment_s
        degree = 2 if len(rate) >= FOR_A_PARABOLA else min(len(rate) - 1, 1)
        return float(np.linalg.lstsq(np.vander(since, degree + 1), rate, rcond=None)[0][-1])

    def _driven(self, history: "WheelLog", time_s: Array, log: actuator.LogTimes) -> Array:
        """(M + 1,) total momentum at ``time_s`` from torque less friction, N m s; the body rate is linear between these times."""
        assert history.torque_n_m is not None
        assert history.start_rad_s is not None
        inertia, length_s, speed = self.spin_inertia_kg_m2, np.diff(time_s), history.start_rad_s
        about = self._turning_at(log, float(time_s[0]))
        if self.coulomb_friction_n_m == 0 and self.viscous_friction_n_m_s == 0:
            return np.asarray(inertia * (speed + about) + np.append(0.0, np.cumsum(history.torque_n_m * length_s)))
        turned = np.append(0.0, np.cumsum(log.turn_rad(slice(None)) @ self.direction))
        mean = np.diff(np.interp(time_s, log.edge_s, turned)) / length_s
        turning = np.concatenate([[about], (mean[:-1] + mean[1:]) / 2, mean[-1:]])
        found = [speed]
        for torque, length, change in zip(history.torque_n_m.tolist(), length_s.tolist(), np.diff(turning).tolist(), strict=True):
            found.append(self.rubbed(found[-1], torque / inertia - change / length, length))
        return np.asarray(inertia * (found + turning))

    def rubbed(self, speed: float, pulled: float, length_s: float) -> float:
        """Speed relative to the body after ``length_s``, rad/s, with the acceleration u = ``pulled``, rad/s², and friction.

        ``Ω̇ = u − c sign Ω − k Ω``. A wheel at rest stays at rest while |u| ≤ c.
        """
        c, k = self.coulomb_friction_n_m / self.spin_inertia_kg_m2, self.viscous_friction_n_m_s / self.spin_inertia_kg_m2
        while length_s > 0:
            side = np.sign(speed) if speed else np.sign(pulled) * (abs(pulled) > c)
            grows = pulled - c * side
            since = -float(np.expm1(-k * length_s)) / k if k else length_s
            end = speed * float(np.exp(-k * length_s)) + grows * since
            if side == 0 or end * side > 0 or speed == grows == 0:
                return end if side else 0.0
            # the wheel stops when Ω + u (e^kt − 1)/k = 0
            length_s -= float(np.log1p(-k * speed / grows)) / k if k else -speed / grows
            speed = 0.0
        return speed


@dataclass(frozen=True)
class WheelLog:
    """Log of one wheel: speed, or torque and initial speed."""

    speed_rad_s: Array | None
    """(n,) speed relative to the body at each record's ``time_s``, rad/s; None if the torque is logged."""
    torque_n_m: Array | None
    """(M,) torque on the wheel for each row of commands, N m; None if the speed is logged."""
    start_rad_s: float | None
    """Speed at the start of the log, or when the first logged torque acts, rad/s; None: unknown."""
    corrected: bool = False
    """Whether speeds are estimates at knots instead of tachometer readings (:mod:`massprop_cli.prepare.tachometer`)."""
    after_s: float = 0.0
    """Time of the knots after the ends of records, s."""

    @property
    def integrated(self) -> bool:
        """Whether the momentum is integrated from torque."""
        return self.speed_rad_s is None

    @property
    def known_before(self) -> bool:
        """Whether the speed at the start of the log is known."""
        return self.integrated or self.start_rad_s is not None

    @property
    def moved(self) -> bool:
        """Whether a torque was commanded or the speed changed."""
        return bool(self.torque_n_m.any()) if self.torque_n_m is not None else bool(np.ptp(np.asarray(self.speed_rad_s)) > 0)

    def part(self, rows: slice) -> Self:
        """Log of the given records. Raises ValueError for a torque log, whose speed depends on all earlier records."""
        if self.speed_rad_s is None:
            raise ValueError("the speed of a wheel whose torque was logged follows from its whole log")
        before = float(self.speed_rad_s[rows.start - 1]) if rows.start else self.start_rad_s
        return replace(self, speed_rad_s=self.speed_rad_s[rows], start_rad_s=before)
