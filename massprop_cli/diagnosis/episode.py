"""A jet that fails for a time: start, end and what it gives meanwhile.

The most likely windows (:mod:`massprop_cli.diagnosis.windows`) are put into the vehicle file in turn; then the log has another body, by
which the window is looked for again, until both stand.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.configfile import written
from massprop_cli.diagnosis.corrections import Correction, shown
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.refit import PART, Refit
from massprop_cli.diagnosis.screening import Screening, about_its_body, screened
from massprop_cli.diagnosis.windows import Reduced, Window
from massprop_cli.errorparameters.actuatornames import NEAR
from massprop_cli.errorparameters.setup import stating
from massprop_cli.estimate.whitening import NONE, Disturbance
from massprop_cli.inputs.equipment import Failure
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.clock import by_commands_clock, cycle_edges

LIKELY, AS_WELL = 3, 0.3
"""Jets that are put to the test, and the part of the most likely one's gain that others must have."""
ROUNDS, STANDS = 10, 0.3
"""How often a window is looked for by another body at most, and by how many of its sigmas what the jet gives moves in the end."""
SLOWLY, FAR = 0.8, 10.0
"""Parts of a misfit that a round leaves, and times pure error, above which it leads nowhere."""
MOST = 2.5
"""Times its stated thrust by which no jet gives more or less than it: one mounted the wrong way gives 2 less."""
EXACT, SURE = (0.0, -1.0), 4.0
"""Dead and reversed, and sigmas from it within which a jet is."""
LITTLE = 0.05
"""Part of its thrust that a jet gains or loses all the time."""


class Episode(NamedTuple):
    """A jet's failure, and what is left of the log with it in the vehicle file."""

    failure: Failure
    sigma: float
    """Of the thrust; 0 where it is taken as dead or reversed."""
    screening: Screening
    score: float
    """−2 log likelihood of what was measured, with the price of what was looked for."""

    @property
    def code(self) -> str:
        """Of the fault."""
        return {0.0: "jet-dead", -1.0: "jet-sign"}.get(self.failure.thrust, "thrust-scale")

    @property
    def words(self) -> str:
        """That go on "the log fits if …"."""
        jet, start_s, end_s = self.failure.jet, self.failure.start_s, self.failure.end_s
        if start_s is None:
            when = "" if end_s is None else f" until {shown(end_s)} s"
        else:
            when = f" from {shown(start_s)} s on" if end_s is None else f" from {shown(start_s)} to {shown(end_s)} s"
        if self.code == "jet-dead":
            return f"jet {jet} does not push at all{when}"
        if self.code == "jet-sign":
            return f"jet {jet} pushes the other way than stated{when}"
        return f"jet {jet} gives {self.failure.thrust:.4g} of the stated thrust{when}"

    def correction(self, vehicle: Resolved, sigmas: float = 0.0) -> Correction:
        """The key that corrects it, with its thrust so many sigmas further on."""
        further = self.failure.model_copy(update={"thrust": self.failure.thrust + sigmas * self.sigma})
        return Correction(
            (f"thrust.failures={written([one.model_dump(exclude_none=True) for one in (*vehicle.thrust.failures, further)])}",)
        )


def episodes(screening: Screening, others: Sequence[Screening] = (), cause: Refit | None = None) -> list[Episode]:
    """The failures of a jet for a time with which the log fits, the most likely first: those that are about as likely.

    None where with another ``cause`` corrected no jet seems to give another part of its thrust for a time; and those that it seems to be
    come first. One that begins, or ends, beyond what was looked at does so at the border to any of the ``others`` in which its jet does
    what is stated.
    """
    if screening.case.log.command_kind != "jets" or not screening.model.thrusting:
        return []
    found = list[Episode]()
    groups: Iterable[tuple[Disturbance, list[Window]]] = (
        (beside, _windows(screening, beside)) for beside in dict.fromkeys([NONE, *screening.free.beside])
    )
    if cause is not None and cause.screening is not None:
        begun = [_as_stated(cause, window) for window in _windows(cause.screening, NONE)]
        if not begun:
            return []
        groups = chain([(NONE, begun)], groups)
    for beside, windows in groups:
        if not found:
            found = [made for window in windows if (made := _tested(screening, window, beside)) is not None]
    found.sort(key=lambda one: one.score)
    return [_bordered(one, screening, others) for one in found if one.score < found[0].score + CLEAR]


def _bordered(one: Episode, screening: Screening, others: Sequence[Screening]) -> Episode:
    """With an edge at the border to another piece of the log in which the jet fires and everything is as stated."""
    (first_s, last_s), failure, period_s = _lasts(screening), one.failure, screening.case.vehicle.cycle.period_s
    for other in others:
        begin_s, end_s = _lasts(other)
        if not other.close or failure.jet not in other.names:
            continue
        if failure.end_s is None and begin_s > last_s - period_s:
            failure = failure.model_copy(update={"end_s": round(last_s, 6)})
        if failure.start_s is None and end_s < first_s + period_s:
            failure = failure.model_copy(update={"start_s": round(first_s, 6)})
    return one._replace(failure=failure)


def _lasts(screening: Screening) -> tuple[float, float]:
    """When a look's piece begins and ends."""
    start_s, duration_s = cycle_edges(screening.case.log, slice(screening.piece.start, screening.piece.stop))
    return float(start_s[0]), float(start_s[-1] + duration_s[-1])


def _windows(screening: Screening, beside: Disturbance) -> list[Window]:
    """The most likely of a few jets, the most likely first."""
    reduced = Reduced(screening, screening, beside)
    each = (reduced.likeliest(i) for i in range(screening.model.thrusting))
    windows = [one for one in each if one is not None and abs(one.thrust - 1) > LITTLE]
    most = max((one.gain for one in windows), default=0.0)
    return sorted((one for one in windows if one.gain > AS_WELL * most), key=lambda one: -one.gain)[:LIKELY]


def _as_stated(cause: Refit, window: Window) -> Window:
    """Of a window beside a corrected cause, what of its stated thrust the jet gives there; the rest of the log where there it gives all."""
    always = float(cause.fitted.value("thrust")[window.channel])
    thrust = always * window.thrust
    whole = abs(thrust - 1) < abs(always - 1)
    if whole and np.isinf(window.begin_s):
        return window._replace(first=window.stop, begin_s=window.end_s, end_s=np.inf, thrust=always)
    if whole and np.isinf(window.end_s):
        return window._replace(stop=window.first, end_s=window.begin_s, begin_s=-np.inf, first=0, thrust=always)
    return window._replace(thrust=thrust)


def _tested(screening: Screening, window: Window, beside: Disturbance) -> Episode | None:
    """A jet's failure near a window; None where the log doesn't fit with it."""
    found = _led(screening, window, beside)
    there = None if found is None else screened(found.screening.case, screening.piece, theta=found.screening.stated.value("theta"))
    if found is not None and there is not None and there.free.beside:
        found = _led(screening, found.window, there.free.beside[0])
        there = None if found is None else screened(found.screening.case, screening.piece, theta=found.screening.stated.value("theta"))
    if found is None or there is None:
        return None
    left = about_its_body(min(there, found.screening, key=lambda one: one.cost))
    if not left.close or (left.loud and left.misfit >= PART * screening.misfit):
        return None
    count, exact = len(_pulses(screening, window.channel)), found.failure.thrust in EXACT
    spans = count if found.failure.start_s is None or found.failure.end_s is None else count * (count - 1) / 2
    price = 2 * np.log(max(spans, 1) * len(screening.free.fired)) + np.log(2 if exact else screening.free.gyro.spare)
    score = left.free_cost + left.likelihood(left.stated.chi_square) + float(price)
    return Episode(found.failure, 0.0 if exact else found.window.sigma, left, score)


class _Mended(NamedTuple):
    """A jet's failure put into the vehicle file."""

    window: Window
    failure: Failure
    screening: Screening


def _led(screening: Screening, window: Window, beside: Disturbance) -> _Mended | None:
    """A jet's failure from a window on to where it stands; None where it leads nowhere."""
    # by the body of a log that a dead or reversed jet has spoilt it may seem to give anything
    begin = next((value for value in EXACT if abs(window.thrust - value) < 0.5 or window.thrust < value < 0), window.thrust)
    found = _mended(screening, window._replace(thrust=begin), beside, screening.stated.value("theta"))
    for _ in range(ROUNDS):
        if found is None:
            break
        reduced, theta, thrust = Reduced(screening, found.screening, beside), found.screening.stated.value("theta"), found.failure.thrust
        then = reduced.likeliest(window.channel, found.window)
        if then is None or not LITTLE < abs(then.thrust - 1) < MOST:
            return None
        near = next((value for value in EXACT if abs(then.thrust - value) < max(NEAR, SURE * then.sigma)), then.thrust)
        same = (then.first, then.stop) == (found.window.first, found.window.stop)
        if same and (thrust == near or abs(then.thrust - thrust) < STANDS * then.sigma):
            return found._replace(window=then)
        left, found = found.screening.misfit, _mended(screening, then._replace(thrust=near), beside, theta)
        if found is not None and found.screening.misfit > max(SLOWLY * left, FAR):
            return None
    return found


def _mended(screening: Screening, window: Window, beside: Disturbance, theta: Array) -> _Mended | None:
    """With a failure in the pulses of a window; None where these are none or all, or the log can't be reduced."""
    begin_s, vehicle = _pulses(screening, window.channel), screening.case.vehicle
    half, edges = vehicle.cycle.period_s / 2, np.array([window.begin_s, window.end_s])
    first, stop = (int(n) for n in np.searchsorted(begin_s, by_commands_clock(screening.case.log, vehicle, edges) - half))
    if stop <= first or stop - first == len(begin_s):
        return None
    start_s, end_s = (None if n in (0, len(begin_s)) else round(float(begin_s[n]) - half, 6) for n in (first, stop))
    jet = vehicle.jets[screening.free.fired[window.channel]]
    failure = Failure(jet=jet.name, thrust=window.thrust, start_s=start_s, end_s=end_s)
    case = screening.case._replace(vehicle=stating(vehicle, {"thrust.failures": (*vehicle.thrust.failures, failure)}))
    there = screened(case, screening.piece, (beside,), theta)
    return None if there is None or not np.array_equal(there.free.fired, screening.free.fired) else _Mended(window, failure, there)


def _pulses(screening: Screening, channel: int) -> Array:
    """(n,) when each of a channel's pulses begins, by the commands' clock."""
    log, vehicle, timing, *_ = screening.case
    begin_s = log.command_start_s + timing.delay * vehicle.cycle.period_s
    return np.asarray(begin_s[log.command[:, screening.free.fired[channel]] > 0])
