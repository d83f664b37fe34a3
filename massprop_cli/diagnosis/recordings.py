"""Hypotheses of how a log was recorded: keys in which the motion is far from linear.

Free coefficients (:func:`massprop_cli.diagnosis.freeresponse.unexplained_with`) say in milliseconds how much commands explain under any of
them. The one that explains most is put to the test like any other hypothesis.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, frozen, median
from massprop_cli.diagnosis import wheelfriction
from massprop_cli.diagnosis.commandlimits import limits
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import NEAR, MeasuredMotion, line_minimum, motion_of, sigma_at, unexplained_with
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.inspection import MOSTLY
from massprop_cli.diagnosis.lowpasses import other_low_passes
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.refit import Refit, tried
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.supposed import States, Supposed
from massprop_cli.errorparameters.table import PRIORS
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.actuators import LATE

SHORT = (0.05, 0.1, 0.2, 0.3, 0.4)
"""Cycles that valves may take at least."""
EARLIER = (1, 2, 3)
"""Cycles by which commands of one jet may be logged before those of another one that fires with it, or all of them after they act."""
SHARPENED, FARTHEST = 4, 3.0
"""Rounds at most, two at least, in which values are moved to the greatest likelihood; sigmas by which one may be moved in each."""
MORE = 0.1
"""By how much values that are moved must explain more."""
NEARLY, LEFT = 0.5, 0.01
"""Part of the cost of what is stated, above which values are not about right, and moved no further. And of the variance of a torque beside
the log, above which a correction doesn't explain it."""
ANOTHER = 0.25
"""Cycles by which a delay that is found with something else is another one."""
AS_NOISE, FAR_OFF = 0.26, 1.1
"""Logarithms of the factors within which noise is what is stated, and beyond which it is another in both sensors: 1.3 and 3."""


def otherwise(screening: Screening, alone: Sequence[Refit]) -> list[Refit]:
    """What explains more of the motion than what is stated, and than what of ``alone`` explains it, put to the test.

    Such a fault leaves nothing once it is corrected: beside a torque of its own it would be one of many that leave less.
    """
    case = screening.case
    motion = motion_of(case.timing.of(case.log, case.vehicle))
    fitting = (refit.case for refit in alone if refit.fits)
    seen_alike = (one for one in fitting if one.log is case.log and one.vehicle.imu == case.vehicle.imu)
    least = min(_left(one, motion, {}) for one in (case, *seen_alike))
    found = []
    every = [(one, least - CLEAR) for one in _supposed(case, motion)]
    every += [(one, np.inf) for one in (*_limited(case, motion), *_before_its_twin(case), *wheelfriction.supposed(case, motion))]
    for one, most in every:
        if most == np.inf or _left(case, None if one.codes == ("accel-axes",) else motion, one.states, one.later) < most:
            refit = _sharpened(screening, one.fitted(screening))
            # what is led to another delay is that delay
            found += [refit] if refit is not None and abs(refit.case.timing.delay - case.timing.delay - one.later) < ANOTHER else []
    return _undisturbed(screening, found)


def otherwise_filtered(screening: Screening) -> list[Refit]:
    """Other cutoffs and latencies than stated that explain more of the motion, put to the test."""
    return _undisturbed(
        screening, [_sharpened(screening, one.fitted(screening)) for one in other_low_passes(screening.case, screening.piece)]
    )


def _undisturbed(screening: Screening, refits: Sequence[Refit | None]) -> list[Refit]:
    return [one for one in refits if one is not None and one.screening is not None and not _disturbed(one.screening, screening)]


def _disturbed(corrected: Screening, stated: Screening) -> bool:
    """Whether a torque beside a log is left of about the size that there was before it was corrected, where the vehicle file states none.

    By the variance that K cycles of it give the rate: K w + K³ v / 3, of steps w and of steps v of what it grows by.
    """
    environment, count = stated.case.vehicle.environment, stated.piece.stop - stated.piece.start
    if max(environment.disturbance_torque_n_m, environment.disturbance_walk_n_m) > 0:
        return False
    now, before = (sum(count * torque.white + count**3 / 3 * torque.walk for torque in one.free.beside) for one in (corrected, stated))
    return bool(now > LEFT * before)


def _sharpened(screening: Screening, found: Fitted) -> Refit | None:
    """With the values that free coefficients found moved to the greatest likelihood: they take rates cycle by cycle, and momentum adds up.

    By parabolas along each that was sought, by what is one sigma of the former.
    """
    best, begun = tried(screening, found), found.hypothesis.states
    if best is None or best.score > NEARLY * screening.cost:
        return best
    directions = [{key: np.array(further[key]) - np.array(begun[key]) for key in further} for further in found.hypothesis.further]
    for round_ in range(SHARPENED):
        before = best.score
        for steps in directions:
            moved = partial(_moved, screening, best.fitted, steps)
            left = [np.inf if one is None else one.score for one in (moved(-1.0), best, moved(1.0))]
            bent = left[0] - 2 * left[1] + left[2]
            if not np.isfinite(bent) or bent <= 0:
                continue
            tip = moved(float(np.clip((left[0] - left[2]) / (2 * bent), -FARTHEST, FARTHEST)))
            if tip is not None and tip.score < left[1] - MORE:
                best = tip
        if round_ and best.score > before - CLEAR:
            break
    return best


def _moved(screening: Screening, found: Fitted, steps: Mapping[str, Array], by: float) -> Refit | None:
    values = {key: np.maximum(np.array(found.hypothesis.states[key]) + by * step, 0).tolist() for key, step in steps.items()}
    states = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    return tried(screening, replace(found, hypothesis=replace(found.hypothesis, states={**found.hypothesis.states, **states})))


def by_noise(screening: Screening) -> list[Refit]:
    """Units of both sensors that make their noise what is stated, of a log that fits either way: a larger body moves alike by less."""
    ratio = np.sqrt(screening.free.pure / screening.noise).reshape(2, 3)
    away = np.log([median(own) for own in ratio])

    def off(supposed: Hypothesis) -> float:
        sizes = [abs(float(np.linalg.det(turn))) ** (1 / 3) for turn in (supposed.gyro, supposed.accelerometer)]
        return float(np.abs(away - np.log(sizes)).max())

    units = [one for one in screening.turns if one.code == "column-kind"]
    nearest = min(units, key=off, default=None)
    if nearest is None or off(nearest) > AS_NOISE or np.abs(away).min() < FAR_OFF:
        return []
    refit = tried(screening, screening.supposing(nearest))
    return [] if refit is None or refit.screening is None or not refit.screening.close else [replace(refit, fits=True)]


def _supposed(case: Case, motion: MeasuredMotion) -> Iterator[Supposed]:
    """What is put to the test."""
    if case.vehicle.imu.accel_axes == "imu":
        yield Supposed(("accel-axes",), {"imu.accel_axes": "start"})
    if any(wheel.column == "speed" for wheel in case.vehicle.wheels):
        yield _tachometers_later(case, motion)
    if case.log.command_kind == "jets" and case.log.command.any():
        yield from _pulses_elsewhere(case, motion)
        yield from _short_pulses(case, motion)
        yield from (_later(case, motion, jet) for jet in _likeliest_later(case))


def _limited(case: Case, motion: MeasuredMotion) -> Iterator[Supposed]:
    """Of a commanded wrench no more than some limits acting, and with another delay where that explains more: what is cut off moves it."""
    found = limits(case, motion) if case.log.command_kind == "wrench" and case.vehicle.thrust.wrench_limits is None else None
    if found is None:
        return
    later, sought = _delay_beside(case, motion, found.states), case.vehicle.cycle.command_delay_cycles == "auto"
    again = limits(case, motion, later) if sought or abs(later) > NEAR else None
    if again is None or not sought:
        yield Supposed(("commands-limited",), found.states, found.further)
    if again is not None and (sought or again.cost < found.cost - CLEAR):
        codes = ("commands-limited",) if sought else ("commands-limited", "delay-mismatch")
        yield Supposed(codes, again.states, again.further, again.later, PRIORS["delay"])


def _delay_beside(case: Case, motion: MeasuredMotion, states: States) -> float:
    """By how many cycles later commands act beside these keys, as far as they explain most."""

    def left(by: float) -> float:
        return _left(case, motion, states, by) if case.timing.delay + by >= 0 else np.inf

    return line_minimum(left, (0.0, -case.timing.delay), ANOTHER, NEAR / 4)


def _pulses_elsewhere(case: Case, motion: MeasuredMotion) -> Iterator[Supposed]:
    """With the delay as stated, or one by which pulses act about when they now do in the mean."""
    on, cycle = case.log.command[:, : len(case.vehicle.jets)], case.vehicle.cycle
    idle = 1 - float((on**2).sum() / max(on.sum(), TINY)) / cycle.period_s
    for at in [at for at in LATE if at != cycle.pulse_at] if idle > NEAR else []:
        states: States = {"cycle.pulse_at": at}
        left = partial(_left, case, motion, states)
        by = (LATE[cycle.pulse_at] - LATE[at]) * idle
        by = line_minimum(left, (by,), 0.1, NEAR / 4) if left(0.0) > left(by) else 0.0
        if case.timing.delay + by >= 0:
            yield Supposed(("pulse-position",), states, later=by, loose=PRIORS["delay"] if by else 0.0)


def _short_pulses(case: Case, motion: MeasuredMotion) -> Iterator[Supposed]:
    """With short pulses that last as long as valves take at least, or for which they do not open, by what explains most."""
    on, period_s = case.log.command[:, : len(case.vehicle.jets)], case.vehicle.cycle.period_s
    shortest = float(on[on > 0].min(initial=period_s)) / period_s
    for key in ("thrust.least_on_s", "thrust.dead_on_s"):
        if case.setup.value(key)[0] == 0 and shortest < SHORT[-1]:

            def left(cycles: float, key: str = key) -> float:
                return _left(case, motion, {key: max(cycles, 0.0) * period_s})

            by = line_minimum(left, [cycles for cycles in SHORT if cycles > shortest], SHORT[0], NEAR / 8)
            further: States = {key: (by + sigma_at(left, by)) * period_s}
            yield Supposed(("short-pulses",), {key: by * period_s}, (further,) if key == "thrust.least_on_s" else ())


def _later(case: Case, motion: MeasuredMotion, jet: int) -> Supposed:
    """With pulses of one jet later by what explains most."""
    return _all_later(case, motion, "jet-late", {f"jets.{jet}.delay_s": case.vehicle.jets[jet].delay_s}, (0.5, 1.0, 1.5, 2.0), 0.5)


def _tachometers_later(case: Case, motion: MeasuredMotion) -> Supposed:
    """With speeds of wheels later than stated, all by as much, as of one motor controller's filter or bus: by what explains most."""
    by_speed = {n: wheel.speed_latency_s for n, wheel in enumerate(case.vehicle.wheels) if wheel.column == "speed"}
    stated_s = {f"wheels.{n}.speed_latency_s": latency_s for n, latency_s in by_speed.items()}
    return _all_later(case, motion, "speed-late", stated_s, (0.1, 0.2, 0.4, 0.8, 1.6), 0.2)


def _all_later(
    case: Case, motion: MeasuredMotion, code: str, stated_s: Mapping[str, float], begun: Sequence[float], step: float
) -> Supposed:
    """With all of these keys later than stated by as much, from so many cycles ``begun`` on, by what explains most."""

    def states(cycles: float) -> States:
        return {key: max(stated + cycles * case.vehicle.cycle.period_s, 0.0) for key, stated in stated_s.items()}

    def left(cycles: float) -> float:
        return _left(case, motion, states(cycles))

    by = line_minimum(left, begun, step, NEAR)
    return Supposed((code,), states(by), (states(by + sigma_at(left, by)),))


def _before_its_twin(case: Case) -> Iterator[Supposed]:
    """Each jet whose commands are those of another one some cycles earlier, which may act together.

    Free coefficients explain as much by that other one alone, which gives all that both do, so they do not tell.
    """
    if case.log.command_kind != "jets":
        return
    on, period_s = case.log.command[:, : len(case.vehicle.jets)], case.vehicle.cycle.period_s
    for cycles in EARLIER:
        alike = (on[cycles:, :, None] == on[:-cycles, None, :]).mean(0) > MOSTLY
        for jet in np.flatnonzero((alike & ~np.eye(len(alike), dtype=bool)).any(0) & on.any(0)).tolist():
            at = case.vehicle.jets[jet].delay_s + cycles * period_s
            key = f"jets.{jet}.delay_s"
            yield Supposed(("jet-late",), {key: at}, ({key: at + NEAR * period_s},))


def _likeliest_later(case: Case) -> list[int]:
    """The jets of which a pulse a cycle later explains most, if any does: some may be commanded alike.

    By regression of the motion on what all of them do, beside what one does a cycle later.
    """
    samples = case.timing.of(case.log, case.vehicle)
    acted, rate, jets = samples.executed.channels, samples.rate_rad_s, len(case.vehicle.jets)
    load = np.hstack([products(rate), samples.up_b[:-1], np.ones((len(rate), 1))])
    first = int(np.argmax(samples.executed.usable)) + 1
    gained = np.zeros(jets)
    for moved, did, beside in (
        (np.diff(rate, axis=0), acted.step[:, :jets], (load[1:] + load[:-1]) / 2),
        (samples.specific_force_m_s2, acted.whole[:, :jets], load),
    ):
        causes = np.hstack([did, beside])[first:]
        base = np.linalg.qr(causes[:, np.ptp(causes, axis=0) > 0])[0]
        rest, later = (one - base @ (base.T @ one) for one in (moved[first:], (np.roll(did, 1, 0) - did)[first:]))
        explained = (later.T @ rest) ** 2 / np.maximum(np.outer((later**2).sum(0), (rest**2).sum(0)), TINY)
        gained -= len(rest) * np.log1p(-np.minimum(explained, 1 - ROUNDING)).sum(1)
    return np.flatnonzero(gained > max(gained.max(initial=0.0) - MORE, CLEAR)).tolist()


def logged_after(case: Case) -> int:
    """Control cycles that commands are to be moved up by, as they explain far more if they acted before they were logged; else 0."""
    if case.log.command_kind not in ("jets", "wrench") or case.log.command_s is not None:
        return 0
    delay = int(case.timing.delay)  # which undoes fewer
    motion = motion_of(case.timing.of(case.log, case.vehicle))

    def left(cycles: int) -> float:
        sooner = np.vstack([case.log.command[cycles:], np.zeros((cycles, case.log.command.shape[1]))])
        return _left(case._replace(log=replace(case.log, command=frozen(sooner))), motion, {})

    best = min((*range(delay + 1), *(delay + cycles for cycles in EARLIER)), key=left)
    # what a smaller delay explains was logged before it acted
    return best if best > delay and left(best) < left(0) - case.log.cycles else 0


def _left(case: Case, motion: MeasuredMotion | None, states: States, later: float = 0.0) -> float:
    return sum(unexplained_with(case.setup, states, later, motion=motion))
