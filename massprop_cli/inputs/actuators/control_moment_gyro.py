"""Control moment gyros: rotors in gimbals that change the direction of their momentum.

A rotor has the momentum h along its spin axis s, which the gimbal turns about its axis g by the logged gimbal angle δ:

    s(δ) = s₀ cos δ + (g × s₀) sin δ

h is relative to the body: constant, or J W with the logged spin speed W. I is the body's inertia about its CG with the rotors locked at
gimbal angle 0. The equation of motion of body and gyros is

    I ω̇ + d(h s)/dt + ω × (I ω + h s) = τ − c × F

It neglects the gimbals' momentum and the change of a non-axisymmetric rotor's inertia with the gimbal angle.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from massprop_cli.base.arrays import Array, frozen, spline
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs.actuators import actuator
from massprop_cli.inputs.formats.units import ANGLE, SPIN
from massprop_cli.inputs.logtable import LogTable
from massprop_cli.inputs.section import NonNegative, Positive, Real, Vector

GIMBAL = actuator.LogColumn("cmg_", "_gimbal_rad", "gimbal", ANGLE, True, False, "gimbal angle of a control moment gyro at time_s, rad")
SPEED = actuator.LogColumn(
    "cmg_", "_rad_s", "speed", SPIN, True, False, "a control moment gyro's spin speed, relative to its gimbal, at time_s, rad/s"
)
ANGLES = {180 / np.pi: "it is in degrees", np.pi / 180: "{} is in degrees", -1.0: "it has the other sign"}
"""Factor of a first gimbal angle over the stated one, and the unit or sign error that explains it."""
SQUARE = 1e-6
"""Largest cosine of the angle between two axes that count as orthogonal."""
FASTEST_RAD = 1.0
"""Largest gimbal rotation between two records; a larger one is ambiguous."""
SMOOTH = 8
"""Minimum number of linear pieces per record of a smooth curve."""
FINE_RAD = 0.002
"""Largest gimbal rotation per linear piece of the momentum; chords shorten the mean momentum by 3e-7."""

_Axis = Annotated[Vector, actuator.pointing("this axis")]


class ControlMomentGyro(actuator.MomentumDevice):
    """Single-gimbal control moment gyro: axes, and momentum of its rotor."""

    TABLE: ClassVar = "control_moment_gyros"
    NOUN: ClassVar = "control moment gyro"
    COLUMNS: ClassVar = (GIMBAL, SPEED)
    DOES: ClassVar = ("gimbal_axis", "spin_axis", "h_n_m_s", "spin_inertia_kg_m2")

    gimbal_axis: _Axis = Field(description="axis of positive gimbal angles, body axes; any length")
    spin_axis: _Axis = Field(
        description="direction of the spin momentum at gimbal angle 0, body axes; any length, orthogonal to gimbal_axis"
    )
    h_n_m_s: Positive | None = Field(
        None,
        description=("constant spin momentum relative to the body; absent: spin_inertia_kg_m2 times the speed in column cmg_NAME_rad_s"),
    )
    h_sigma_n_m_s: NonNegative = Field(0.0, description="one sigma of h_n_m_s; included in every sigma")
    spin_inertia_kg_m2: Positive | None = Field(
        None, description="spin inertia about the spin axis; together with h_n_m_s only for locked_in_inertia = false"
    )
    spin_inertia_sigma_kg_m2: NonNegative = Field(
        0.0, description="one sigma of spin_inertia_kg_m2 if the speed is logged; included in every sigma"
    )
    gimbal_sigma_rad: NonNegative = Field(
        0.0, le=0.3, description="one sigma of a constant error of the gimbal angle; included in every sigma"
    )
    gimbal_steps_s: NonNegative | None = Field(
        None,
        description=(
            "time from a record's end to a change of gimbal rate, a knot of the angle; absent: estimated from a log with "
            "one record per control cycle"
        ),
    )
    gimbal_smooth: bool = Field(False, description="whether the angle is a smooth curve through the records, without knots")
    locked_in_inertia: bool = Field(
        description=(
            "whether the body's inertia, given and reported, includes this rotor as locked at gimbal angle 0; false: "
            "without its spin inertia about spin_axis. Its mass, its transverse inertia and the gimbal are always included"
        )
    )
    start_gimbal_rad: Real | None = Field(
        None,
        description=(
            "gimbal angle at the start of the log; massprop refuses angles that start at this value in degrees or with the opposite sign"
        ),
    )
    start_rad_s: Real | None = Field(
        None,
        description=(
            "spin speed at the start of the log; massprop refuses speeds that start at this value in another unit or with the opposite sign"
        ),
    )

    @model_validator(mode="after")
    def _is_coherent(self) -> Self:
        apart = float(actuator.unit(self.gimbal_axis) @ actuator.unit(self.spin_axis))
        if abs(apart) > SQUARE:
            raise ValueError(
                f"spin_axis is {np.degrees(np.arccos(np.clip(apart, -1, 1))):.6g} degrees from gimbal_axis, not 90: give the spin axis at "
                "gimbal angle 0, orthogonal to the gimbal's"
            )
        if self.h_n_m_s is None and self.spin_inertia_kg_m2 is None:
            raise ValueError("its momentum is not stated: state h_n_m_s, or state spin_inertia_kg_m2 and log its speed")
        if self.spin_inertia_kg_m2 is None and not self.locked_in_inertia:
            raise ValueError("locked_in_inertia = false needs spin_inertia_kg_m2, which massprop takes off the body's inertia")
        return self

    @classmethod
    def draft(cls, name: str, has: actuator.LogColumn, span: str) -> list[str]:  # noqa: ARG003
        """Draft as comments, because no log gives these values."""
        return [
            "# [[control_moment_gyros]]   # each of these is needed; data sheet or drawing",
            f"# name = {json.dumps(name, ensure_ascii=False)}",
            "# gimbal_axis = [x, y, z]     # body axes",
            "# spin_axis = [x, y, z]       # of the spin momentum at gimbal angle 0, body axes",
            f"# h_n_m_s = ...              # spin momentum; or spin_inertia_kg_m2 and column {SPEED.of(name)}",
            "# locked_in_inertia = true    # or false, with spin_inertia_kg_m2, if the body's inertia is to be without it",
            "",
        ]

    @property
    def axes(self) -> Array:
        """(2, 3) spin axis at gimbal angles of 0 and 90 degrees, body axes."""
        spin = actuator.unit(self.spin_axis)
        return np.stack([spin, np.cross(actuator.unit(self.gimbal_axis), spin)])

    @property
    def beyond_reported(self) -> Array:
        """(3, 3) inertia in the equation of motion less reported inertia, kg m²; the equation locks the rotor."""
        return np.asarray((not self.locked_in_inertia) * (self.spin_inertia_kg_m2 or 0.0) * np.outer(self.axes[0], self.axes[0]))

    @property
    def unknowns(self) -> tuple[actuator.Unknown, ...]:
        """Nuisance parameters: relative spin momentum, and gimbal angle, rad, which changes the momentum by g × h."""
        stated, sigma = (self.h_n_m_s, self.h_sigma_n_m_s) if self.h_n_m_s else (self.spin_inertia_kg_m2, self.spin_inertia_sigma_kg_m2)
        by = (sigma / (stated or 1.0), np.eye(2)), (self.gimbal_sigma_rad, np.array([[0.0, -1.0], [1.0, 0.0]]))
        return tuple(actuator.Unknown(size, matrix, np.zeros(2), False) for size, matrix in by if size > 0)

    def scaled(self, factor: float) -> Self:
        """Copy with ``factor`` times the spin momentum."""
        keys = ("h_n_m_s", "spin_inertia_kg_m2")
        return self.model_copy(update={key: factor * stated for key in keys if (stated := getattr(self, key)) is not None})

    def acting(self, factors: Array) -> Self | None:
        """Copy with the given factors of the momentum along both axes; None if their magnitudes differ.

        Both negative reverse the spin; a negative second one reverses the gimbal.
        """
        first, second = factors.tolist()
        if abs(abs(first) - abs(second)) > SQUARE * abs(first):
            return None
        gimbal = self.gimbal_axis if first * second >= 0 else tuple(-part for part in self.gimbal_axis)
        spin = self.spin_axis if first >= 0 else tuple(-part for part in self.spin_axis)
        return self.scaled(max(abs(first), actuator.DEAD)).model_copy(update={"gimbal_axis": gimbal, "spin_axis": spin})

    def read(self, source: LogTable, records: int, n: int) -> "GyroLog":  # noqa: ARG002
        """Log of gimbal angles, and of speeds if the momentum is not stated. Raises :class:`InputError` for too fast a gimbal."""
        angle = source.required(GIMBAL.of(self.name))[:n]
        turn = np.abs(np.diff(np.unwrap(angle)))
        fast = np.append(False, np.maximum(turn, np.abs(np.diff(angle)) - 2 * np.pi) > FASTEST_RAD)
        message = (
            f"{{:g}} rad, after {{:g}} rad in the record before: the limit is {FASTEST_RAD:g} rad in a record; is it in radians ([columns] "
            "can scale it), are records missing?"
        ).format
        source.refuse(fast, GIMBAL.of(self.name), lambda row: message(angle[row], angle[row - 1]))
        speed = source.required(SPEED.of(self.name))[:n] if self.h_n_m_s is None else None
        return GyroLog(frozen(np.unwrap(angle)), None if speed is None else frozen(speed), None)

    @classmethod
    def check_together(cls, source: LogTable, own: Sequence[Self], logs: Sequence[actuator.MomentumLog]) -> None:
        """Raise :class:`InputError` if all first angles or speeds equal the stated ones in another unit; the motion cannot show it."""
        pairs = [(gyro, one) for gyro, one in zip(own, logs, strict=True) if isinstance(one, GyroLog)]
        angles = [(gyro.start_gimbal_rad, one.angle_rad) for gyro, one in pairs]
        actuator.refuse_other_units(source, "gimbal angle of each control moment gyro", "start_gimbal_rad", ANGLES, angles)
        speeds = [(gyro.start_rad_s, one.speed_rad_s) for gyro, one in pairs]
        actuator.refuse_other_units(source, "speed of each control moment gyro", "start_rad_s", actuator.SPEEDS, speeds)

    def momentum(self, history: actuator.MomentumLog, log: actuator.LogTimes) -> actuator.Grown:
        """Momentum in time from gimbal angles that are linear between knots, or from a smooth curve."""
        assert isinstance(history, GyroLog)
        has_start = history.before is not None
        time_s, angle = log.edge_s[1 - has_start :] + history.after_s, history.angle_rad
        speed = np.zeros_like(angle) if history.speed_rad_s is None else history.speed_rad_s
        if history.before is not None:
            angle, speed = np.append(history.before[0], angle), np.append(history.before[1], speed)
        parts = max(int(np.ceil(np.abs(np.diff(angle)).max(initial=0.0) / FINE_RAD)), SMOOTH if self.gimbal_smooth else 1)
        fine = np.arange((len(angle) - 1) * parts + 1) / parts
        knots = np.arange(len(angle), dtype=float)
        time_s, speed, angle = (
            np.interp(fine, knots, time_s),
            np.interp(fine, knots, speed),
            spline(fine, knots, angle) if self.gimbal_smooth else np.interp(fine, knots, angle),
        )
        h = (self.spin_inertia_kg_m2 or 0.0) * speed if self.h_n_m_s is None else self.h_n_m_s
        return actuator.Grown(time_s, np.stack([h * np.cos(angle), h * np.sin(angle)]))


@dataclass(frozen=True)
class GyroLog:
    """Log of one control moment gyro."""

    angle_rad: Array
    """(n,) unwrapped gimbal angle at each record's ``time_s``, rad."""
    speed_rad_s: Array | None
    """(n,) rotor speed, rad/s; None if its momentum is stated."""
    before: tuple[float, float] | None
    """Angle, rad, and speed, rad/s, at the start of the first record; None: unknown."""
    after_s: float = 0.0
    """Time of the angles' knots after the ends of records, s (:mod:`massprop_cli.prepare.tachometer`)."""
    integrated: ClassVar[bool] = False
    """Each record gives the momentum."""

    @property
    def known_before(self) -> bool:
        """Whether angle and speed before the first record are known, as in a part of a log."""
        return self.before is not None

    @property
    def moved(self) -> bool:
        """Whether the gimbal turned, or the rotor's speed changed."""
        return bool(np.ptp(self.angle_rad) > 0) or (self.speed_rad_s is not None and bool(np.ptp(self.speed_rad_s) > 0))

    def turned(self, factor: float) -> Self:
        """Copy with ``factor`` times the angle."""
        before = None if self.before is None else (factor * self.before[0], self.before[1])
        return replace(self, angle_rad=factor * self.angle_rad, before=before)

    def part(self, rows: slice) -> Self:
        """Log of the given records."""
        speed, last = self.speed_rad_s, rows.start - 1
        before = (float(self.angle_rad[last]), 0.0 if speed is None else float(speed[last])) if rows.start else self.before
        return replace(self, angle_rad=self.angle_rad[rows], speed_rad_s=None if speed is None else speed[rows], before=before)
