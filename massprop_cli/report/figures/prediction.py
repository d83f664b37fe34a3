"""Measured and predicted rate and specific force against time, with residuals."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.report.figures import axis, palette
from massprop_cli.report.figures.innovations import BOUND, bounds
from massprop_cli.report.figures.panel import Axes, Panel, Picture
from massprop_cli.report.figures.recording import Columns, Covered, covered, over_time, sensed, thinned
from massprop_cli.report.figures.series import AxisRange, padded, parts_of, span, thin
from massprop_cli.result.historyfile import PREDICTED
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import AXES

SHOWN = {"rate": ("Rate", "rad/s"), "specific_force": ("Specific force at the IMU", "m/s²")}
"""Heading and unit of each kind."""
NOTHING = 1e-3
"""Smallest range of a panel relative to the largest value of the three axes, so that it does not magnify rounding errors."""


@dataclass(frozen=True)
class Channel:
    """Rate or specific force on one axis in one phase."""

    number: int
    """Number of the phase, from 1."""
    time_s: Array
    measured: Array
    predicted: Array
    sigma: Array
    """(K,) sigma of the residual."""

    @property
    def residual(self) -> Array:
        """(K,) measured minus predicted."""
        return np.asarray(self.measured - self.predicted)


def columns(kind: str) -> list[str]:
    """The columns of history.parquet that the figure needs."""
    return [name for letter in AXES for name in _names(kind, letter)]


def _names(kind: str, letter: str) -> tuple[str, str, str]:
    """Column names of the measured value, the predicted value, and the sigma of the residual."""
    unit = PREDICTED[kind]
    return f"{kind}_{letter}_{unit}", f"predicted_{kind}_{letter}_{unit}", f"predicted_{kind}_{letter}_sigma_{unit}"


def channel(number: int, found: Columns, kind: str, letter: str) -> Channel:
    """The channel of a phase's history."""
    return Channel(number, found["time_s"], *(found[name] for name in _names(kind, letter)))


def picture(recorded: Recorded, kind: str) -> Picture:
    """For each axis over all phases, a panel of measured and predicted values, and one of residuals."""
    parts = covered(recorded, columns(kind))
    channels = {letter: [channel(number, each, kind, letter) for number, _, each in parts] for letter in sensed(parts, kind)}
    largest = max((float(np.nanmax(np.abs(one.measured), initial=0.0)) for each in channels.values() for one in each), default=0.0)
    overlaid = {letter: _overlaid(each, NOTHING * largest) for letter, each in channels.items()}
    residual = {letter: _symmetric(each) for letter, each in channels.items()}
    powers = axis.power(overlaid.values()), axis.power(residual.values())
    panels = list[Panel]()
    for letter, each in channels.items():
        panels.append(_overlay(kind, letter, each, overlaid[letter], powers[0], parts, first=not panels))
        panels.append(_residual(kind, letter, each, residual[letter], powers[1], parts))
    return Picture(_caption(recorded, parts), tuple(panels), 2)


def _caption(recorded: Recorded, parts: list[Covered]) -> str:
    if recorded.result.provenance.method == "thesis":
        return (
            "Blue: measured, body axes. The thesis's filters predict torque and force from the motion, not the motion: see the innovations."
        )
    return (
        "Blue: measured. Orange dashes: predicted from the commands with the final values, from the start of the phase; only the initial "
        "rate, biases and tilt come from the cycles before. Below: measured − predicted, with ± 2 sigma of the stated noise (dashes). If "
        "values and vehicle file are right, the residual is noise: no trend, no pattern, 95 % between the dashes. Body "
        f"axes.{thinned(parts)}"
    )


def _overlaid(each: Sequence[Channel], least: float) -> AxisRange:
    """Range of the measured values, and of predicted values within one range of them."""
    measured = span(np.concatenate([one.measured for one in each]), least)
    height = measured.high - measured.low
    predicted = np.concatenate([one.predicted for one in each])
    near = predicted[np.isfinite(predicted)]
    near = near[(near > measured.low - height) & (near < measured.high + height)]
    return span(np.concatenate([near, [measured.low, measured.high]])) if near.size else measured


def _symmetric(each: Sequence[Channel]) -> AxisRange:
    """Symmetric range of the residuals and their bounds."""
    residual, sigma = _residuals(each)
    reach = max(float(np.abs(residual).max()), 1.3 * BOUND * float(np.median(sigma))) if residual.size else 1.0
    return padded(-reach, reach, 0.03)


def _overlay(kind: str, letter: str, each: Sequence[Channel], limits: AxisRange, power: int, parts: list[Covered], first: bool) -> Panel:
    heading, unit = SHOWN[kind]

    def paint(axes: Axes) -> None:
        over_time(axes, parts, limits, f"{heading} {letter.upper()}", unit, power)
        buckets = parts_of(len(parts))
        for one in each:
            gid = f"{kind}_{letter}-{{}}-{one.number}"
            label = one.number == each[0].number
            for name, values, colour, style in (
                ("measured", one.measured, palette.BLUE, "-"),
                ("predicted", one.predicted, palette.ORANGE, (0, (4, 2))),
            ):
                drawn = thin(values, buckets=buckets)
                legend = name if label and len(drawn) else None
                axes.plot(
                    one.time_s[drawn], values[drawn], color=colour, linewidth=1.1, linestyle=style, gid=gid.format(name), label=legend
                )
        if first:
            axes.legend(
                loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0.0, handlelength=1.6, handletextpad=0.4, columnspacing=0.8
            )

    return Panel(f"{kind}_{letter}", f"{heading} {letter.upper()}, measured and predicted, against time: {_alt_text(each, unit)}", paint)


def _residual(kind: str, letter: str, each: Sequence[Channel], limits: AxisRange, power: int, parts: list[Covered]) -> Panel:
    heading, unit = SHOWN[kind]

    def paint(axes: Axes) -> None:
        over_time(axes, parts, limits, f"{letter.upper()}: measured less predicted", unit, power)
        if not any(np.isfinite(one.residual).any() for one in each):
            axis.note(axes, "not predicted")
        for one in each:
            rows = thin(one.residual, buckets=parts_of(len(parts)))
            gid = f"{kind}_{letter}_residual-{{}}-{one.number}"
            axes.plot(one.time_s[rows], one.residual[rows], color=palette.BLUE, linewidth=0.6, gid=gid.format("residual"))
            bounds(axes, gid, one.time_s, one.sigma, parts_of(len(parts)) // 6)

    alt_text = f"{heading} {letter.upper()}, measured less predicted, against time: {_alt_text(each, unit)}"
    return Panel(f"{kind}_{letter}_residual", alt_text, paint)


def _residuals(each: Sequence[Channel]) -> tuple[Array, Array]:
    """Finite residuals of all phases, with their sigmas."""
    residual, sigma = (np.concatenate([getattr(one, name) for one in each]) for name in ("residual", "sigma"))
    known = np.isfinite(residual) & np.isfinite(sigma)
    return residual[known], sigma[known]


def _alt_text(each: Sequence[Channel], unit: str) -> str:
    residual, sigma = _residuals(each)
    if not residual.size:
        return "not predicted"
    inside = (np.abs(residual) <= BOUND * sigma).mean()
    return f"rms of the residual {np.sqrt((residual**2).mean()):.2g} {unit}; {inside:.1%} lie within ± 2 sigma, 95 % are expected"
