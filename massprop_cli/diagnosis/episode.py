"""A temporary failure of a jet: start, end, and thrust meanwhile.

The best windows (:mod:`massprop_cli.diagnosis.windows`) are applied to the vehicle file in turn. Then the body is fitted again, and the
window with it, until both converge.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import written
from massprop_cli.base.levels import CLEAR, ITERATIONS, SLIGHT, STILL
from massprop_cli.diagnosis.corrections import Correction, time_text
from massprop_cli.diagnosis.refit import PART, Refit
from massprop_cli.diagnosis.screening import Screening, relinearised, screened
from massprop_cli.diagnosis.windows import Window, WindowRegression
from massprop_cli.errorparameters.actuatornames import NEAR
from massprop_cli.errorparameters.setup import stating
from massprop_cli.estimate.whitening import NONE, Disturbance
from massprop_cli.inputs.equipment import Failure
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.clock import by_commands_clock, cycle_edges

LIKELY, AS_WELL = 3, 0.3
"""Jets that are tested; least gain of a window over that of the best one."""
SLOWLY, FAR = 0.8, 10.0
"""Ratio of successive misfits, and misfit over pure error, beyond both of which an iteration is abandoned."""
MOST = 2.5
"""Largest difference of a jet's thrust from the stated one; a reversed jet differs by 2."""
EXACT, SURE = (0.0, -1.0), 4.0
"""Exact thrust factors, dead and reversed; sigmas within which a thrust is rounded to them."""


class Episode(NamedTuple):
    """A jet's temporary failure, and the screening with it applied."""

    failure: Failure
    sigma: float
    """Sigma of the thrust factor; 0 for a dead or reversed jet."""
    screening: Screening
    score: float
    """−2 log likelihood of the measurements, with penalties."""

    @property
    def code(self) -> str:
        """Code of the fault."""
        return {0.0: "jet-dead", -1.0: "jet-sign"}.get(self.failure.thrust, "thrust-scale")

    @property
    def words(self) -> str:
        """Text that continues "the log fits if …"."""
        jet, start_s, end_s = self.failure.jet, self.failure.start_s, self.failure.end_s
        if start_s is None:
            when = "" if end_s is None else f" until {time_text(end_s)} s"
        else:
            when = f" from {time_text(start_s)} s on" if end_s is None else f" from {time_text(start_s)} to {time_text(end_s)} s"
        if self.code == "jet-dead":
            return f"jet {jet} does not push at all{when}"
        if self.code == "jet-sign":
            return f"jet {jet} pushes opposite to the stated direction{when}"
        return f"jet {jet} gives {self.failure.thrust:.4g} of the stated thrust{when}"

    def correction(self, vehicle: Resolved, sigmas: float = 0.0) -> Correction:
        """The key that corrects it, with the thrust ``sigmas`` further."""
        failure = self.failure.model_copy(update={"thrust": self.failure.thrust + sigmas * self.sigma})
        return Correction(
            (f"thrust.failures={written([one.model_dump(exclude_none=True) for one in (*vehicle.thrust.failures, failure)])}",)
        )


def episodes(screening: Screening, others: Sequence[Screening] = (), cause: Refit | None = None) -> list[Episode]:
    """Temporary failures with which the log fits, the best first, without clearly worse ones.

    With a corrected ``cause``, its windows come first, and there are no failures without one. An open start or end is set at the edge of
    any of the ``others`` in which the jet works as stated.
    """
    if screening.case.log.command_kind != "jets" or not screening.model.thrusting:
        return []
    failures = list[Episode]()
    groups: Iterable[tuple[Disturbance, list[Window]]] = (
        (disturbance, _windows(screening, disturbance)) for disturbance in dict.fromkeys([NONE, *screening.free.disturbances])
    )
    if cause is not None and cause.screening is not None:
        by_cause = [_as_stated(cause, window) for window in _windows(cause.screening, NONE)]
        if not by_cause:
            return []
        groups = chain([(NONE, by_cause)], groups)
    for disturbance, windows in groups:
        if not failures:
            failures = [failure for window in windows if (failure := _failure(screening, window, disturbance)) is not None]
    failures.sort(key=lambda failure: failure.score)
    return [_with_known_edges(failure, screening, others) for failure in failures if failure.score < failures[0].score + CLEAR]


def _with_known_edges(one: Episode, screening: Screening, others: Sequence[Screening]) -> Episode:
    """The failure with its open start or end at the edge of another segment, if the jet works there."""
    (first_s, last_s), failure, period_s = _span_s(screening), one.failure, screening.case.vehicle.cycle.period_s
    for other in others:
        begin_s, end_s = _span_s(other)
        if not other.fits_closely or failure.jet not in other.names:
            continue
        if failure.end_s is None and begin_s > last_s - period_s:
            failure = failure.model_copy(update={"end_s": round(last_s, 6)})
        if failure.start_s is None and end_s < first_s + period_s:
            failure = failure.model_copy(update={"start_s": round(first_s, 6)})
    return one._replace(failure=failure)


def _span_s(screening: Screening) -> tuple[float, float]:
    """Start and end of a screening's segment, s."""
    start_s, duration_s = cycle_edges(screening.case.log, slice(screening.piece.start, screening.piece.stop))
    return float(start_s[0]), float(start_s[-1] + duration_s[-1])


def _windows(screening: Screening, disturbance: Disturbance) -> list[Window]:
    """Windows of the jets with the most gain, the best first."""
    regression = WindowRegression(screening, screening, disturbance)
    candidates = (regression.best_window(i) for i in range(screening.model.thrusting))
    windows = [one for one in candidates if one is not None and abs(one.thrust - 1) > SLIGHT]
    best_gain = max((one.gain for one in windows), default=0.0)
    return sorted((one for one in windows if one.gain > AS_WELL * best_gain), key=lambda one: -one.gain)[:LIKELY]


def _as_stated(cause: Refit, window: Window) -> Window:
    """A window next to a corrected cause, relative to the stated thrust; the rest of the log if the jet works in the window."""
    overall = float(cause.fitted.value("thrust")[window.channel])
    thrust = overall * window.thrust
    works = abs(thrust - 1) < abs(overall - 1)
    if works and np.isinf(window.begin_s):
        return window._replace(first=window.stop, begin_s=window.end_s, end_s=np.inf, thrust=overall)
    if works and np.isinf(window.end_s):
        return window._replace(stop=window.first, end_s=window.begin_s, begin_s=-np.inf, first=0, thrust=overall)
    return window._replace(thrust=thrust)


def _failure(screening: Screening, window: Window, disturbance: Disturbance) -> Episode | None:
    """Failure of a jet near a window; None if the log does not fit with it."""
    applied = _iterated(screening, window, disturbance)
    screening_again = (
        None if applied is None else screened(applied.screening.case, screening.piece, theta=applied.screening.stated.value("theta"))
    )
    if applied is not None and screening_again is not None and screening_again.free.disturbances:
        applied = _iterated(screening, applied.window, screening_again.free.disturbances[0])
        screening_again = (
            None if applied is None else screened(applied.screening.case, screening.piece, theta=applied.screening.stated.value("theta"))
        )
    if applied is None or screening_again is None:
        return None
    corrected = relinearised(min(screening_again, applied.screening, key=lambda one: one.cost))
    if not corrected.fits_closely or (corrected.far_exceeds_noise and corrected.misfit >= PART * screening.misfit):
        return None
    count, exact = len(_pulses(screening, window.channel)), applied.failure.thrust in EXACT
    spans = count if applied.failure.start_s is None or applied.failure.end_s is None else count * (count - 1) / 2
    price = 2 * np.log(max(spans, 1) * len(screening.free.fired)) + np.log(2 if exact else screening.free.gyro.spare)
    score = corrected.free_cost + corrected.likelihood(corrected.stated.chi_square) + float(price)
    return Episode(applied.failure, 0.0 if exact else applied.window.sigma, corrected, score)


class _AppliedFailure(NamedTuple):
    """A jet's failure applied to the vehicle file."""

    window: Window
    failure: Failure
    screening: Screening


def _iterated(screening: Screening, window: Window, disturbance: Disturbance) -> _AppliedFailure | None:
    """Iterate a failure from a window; None if it does not converge."""
    # a dead or reversed jet disturbs the initial body, and so its apparent thrust
    initial = next((value for value in EXACT if abs(window.thrust - value) < 0.5 or window.thrust < value < 0), window.thrust)
    applied = _applied(screening, window._replace(thrust=initial), disturbance, screening.stated.value("theta"))
    for _ in range(ITERATIONS):
        if applied is None:
            break
        regression, theta, thrust = (
            WindowRegression(screening, applied.screening, disturbance),
            applied.screening.stated.value("theta"),
            applied.failure.thrust,
        )
        next_window = regression.best_window(window.channel, applied.window)
        if next_window is None or not SLIGHT < abs(next_window.thrust - 1) < MOST:
            return None
        rounded = next(
            (value for value in EXACT if abs(next_window.thrust - value) < max(NEAR, SURE * next_window.sigma)), next_window.thrust
        )
        unchanged = (next_window.first, next_window.stop) == (applied.window.first, applied.window.stop)
        if unchanged and (thrust == rounded or abs(next_window.thrust - thrust) < STILL * next_window.sigma):
            return applied._replace(window=next_window)
        misfit, applied = applied.screening.misfit, _applied(screening, next_window._replace(thrust=rounded), disturbance, theta)
        if applied is not None and applied.screening.misfit > max(SLOWLY * misfit, FAR):
            return None
    return applied


def _applied(screening: Screening, window: Window, disturbance: Disturbance, theta: Array) -> _AppliedFailure | None:
    """Apply a failure to the pulses in a window; None if these are none or all, or if the log cannot be reduced."""
    begin_s, vehicle = _pulses(screening, window.channel), screening.case.vehicle
    half_s, edges = vehicle.cycle.period_s / 2, np.array([window.begin_s, window.end_s])
    first, stop = (int(n) for n in np.searchsorted(begin_s, by_commands_clock(screening.case.log, vehicle, edges) - half_s))
    if stop <= first or stop - first == len(begin_s):
        return None
    start_s, end_s = (None if n in (0, len(begin_s)) else round(float(begin_s[n]) - half_s, 6) for n in (first, stop))
    jet = vehicle.jets[screening.free.fired[window.channel]]
    failure = Failure(jet=jet.name, thrust=window.thrust, start_s=start_s, end_s=end_s)
    case = screening.case._replace(vehicle=stating(vehicle, {"thrust.failures": (*vehicle.thrust.failures, failure)}))
    corrected = screened(case, screening.piece, (disturbance,), theta)
    return (
        None
        if corrected is None or not np.array_equal(corrected.free.fired, screening.free.fired)
        else _AppliedFailure(window, failure, corrected)
    )


def _pulses(screening: Screening, channel: int) -> Array:
    """(n,) start of each pulse of a channel by the commands' clock, s."""
    log, vehicle, timing, *_ = screening.case
    begin_s = log.command_start_s + timing.delay * vehicle.cycle.period_s
    return np.asarray(begin_s[log.command[:, screening.free.fired[channel]] > 0])
