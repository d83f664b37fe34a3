"""Hypotheses about the recording of a log: keys on which the motion depends nonlinearly.

Their values are those of least free-response cost (:func:`massprop_cli.diagnosis.freeresponse.costs_with`), which takes milliseconds.
The result is then refitted like any other hypothesis.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, frozen, median
from massprop_cli.base.levels import CLEAR
from massprop_cli.diagnosis import wheelfriction
from massprop_cli.diagnosis.commandlimits import limits
from massprop_cli.diagnosis.comparison import ROUGHLY, Fitted
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import NEAR, MeasuredMotion, costs_with, line_minimum, motion_of, sigma_at
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.inspection import MOSTLY
from massprop_cli.diagnosis.keyhypothesis import KeyHypothesis, KeyValues
from massprop_cli.diagnosis.lowpasses import other_low_passes
from massprop_cli.diagnosis.refit import Refit, refitted
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.errorparameters.table import PRIORS
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.actuators import LATE

SHORT = (0.05, 0.1, 0.2, 0.3, 0.4)
"""Shortest valve openings that are searched, cycles."""
EARLIER = (1, 2, 3)
"""Cycles by which commands of a jet may be logged before those of a jet that fires with it, or all commands after they act."""
SHARPENED, FARTHEST = 4, 3.0
"""Most rounds that maximise the likelihood over key values, of at least two; largest step of each in sigmas."""
NEARLY, LEFT = 0.5, 0.01
"""Score over the stated cost, above which values are not maximised further; variance of a disturbance torque over the stated one, above
which a correction does not explain it."""
ANOTHER = 0.25
"""Change of the delay by a refit, cycles, beyond which the cause is a delay."""
AS_NOISE, FAR_OFF = 0.26, 1.1
"""Logarithms of noise ratios: within 1.3 noise is as stated; beyond 3 in both sensors it is not."""


def recording_refits(screening: Screening, single_causes: Sequence[Refit]) -> list[Refit]:
    """Refits of recording hypotheses that explain more of the motion than the stated case and the causes ``single_causes``.

    A correct one leaves no disturbance torque. Next to a torque many hypotheses would explain a part.
    """
    case = screening.case
    motion = motion_of(case.timing.of(case.log, case.vehicle))
    fitting = (refit.case for refit in single_causes if refit.fits)
    comparable = (one for one in fitting if one.log is case.log and one.vehicle.imu == case.vehicle.imu)
    least_cost = min(_cost(one, motion, {}) for one in (case, *comparable))
    refits = []
    candidates = [(one, least_cost - CLEAR) for one in _key_hypotheses(case, motion)]
    candidates += [
        (one, np.inf) for one in (*_limit_hypotheses(case, motion), *_before_twin(case), *wheelfriction.friction_hypotheses(case, motion))
    ]
    for one, limit in candidates:
        if limit == np.inf or _cost(case, None if one.codes == ("accel-axes",) else motion, one.key_values, one.delay_change) < limit:
            refit = _maximised(screening, one.fitted(screening))
            # a refit that moves the delay is a hypothesis about the delay
            refits += [refit] if refit is not None and abs(refit.case.timing.delay - case.timing.delay - one.delay_change) < ANOTHER else []
    return _undisturbed(screening, refits)


def low_pass_refits(screening: Screening) -> list[Refit]:
    """Refits of other cutoffs and latencies that explain more of the motion."""
    return _undisturbed(
        screening, [_maximised(screening, one.fitted(screening)) for one in other_low_passes(screening.case, screening.piece)]
    )


def _undisturbed(screening: Screening, refits: Sequence[Refit | None]) -> list[Refit]:
    """Refits that leave no disturbance torque."""
    return [one for one in refits if one is not None and one.screening is not None and not _disturbed(one.screening, screening)]


def _disturbed(corrected: Screening, stated: Screening) -> bool:
    """Whether a correction leaves a disturbance torque of similar size, although none is stated.

    The variance of K cycles of white steps w and of a random walk with steps v is K w + K³ v / 3.
    """
    environment, count = stated.case.vehicle.environment, stated.piece.stop - stated.piece.start
    if max(environment.disturbance_torque_n_m, environment.disturbance_walk_n_m) > 0:
        return False
    after, before = (
        sum(count * torque.white + count**3 / 3 * torque.walk for torque in one.free.disturbances) for one in (corrected, stated)
    )
    return bool(after > LEFT * before)


def _maximised(screening: Screening, fit: Fitted) -> Refit | None:
    """Refit with key values of maximum likelihood.

    Free responses use rates cycle by cycle, while momentum accumulates. Each value is maximised along a parabola, in steps of one sigma.
    """
    best, key_values = refitted(screening, fit), fit.hypothesis.key_values
    if best is None or best.score > NEARLY * screening.cost:
        return best
    directions = [
        {key: np.array(further[key]) - np.array(key_values[key]) for key in further} for further in fit.hypothesis.sigma_key_values
    ]
    for round_ in range(SHARPENED):
        before = best.score
        for steps in directions:
            moved = partial(_moved, screening, best.fitted, steps)
            scores = [np.inf if one is None else one.score for one in (moved(-1.0), best, moved(1.0))]
            curvature = scores[0] - 2 * scores[1] + scores[2]
            if not np.isfinite(curvature) or curvature <= 0:
                continue
            at_minimum = moved(float(np.clip((scores[0] - scores[2]) / (2 * curvature), -FARTHEST, FARTHEST)))
            if at_minimum is not None and at_minimum.score < scores[1] - ROUGHLY:
                best = at_minimum
        if round_ and best.score > before - CLEAR:
            break
    return best


def _moved(screening: Screening, fit: Fitted, steps: Mapping[str, Array], sigmas: float) -> Refit | None:
    values = {key: np.maximum(np.array(fit.hypothesis.key_values[key]) + sigmas * step, 0).tolist() for key, step in steps.items()}
    states = {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
    return refitted(screening, replace(fit, hypothesis=replace(fit.hypothesis, key_values={**fit.hypothesis.key_values, **states})))


def units_by_noise(screening: Screening) -> list[Refit]:
    """Refit of units of both sensors that make their noise as stated, in a log that fits either way.

    A larger body moves the same way with less motion, so only the noise shows the unit.
    """
    ratio = np.sqrt(screening.free.pure_error / screening.noise).reshape(2, 3)
    log_ratio = np.log([median(own) for own in ratio])

    def distance(unit: Hypothesis) -> float:
        sizes = [abs(float(np.linalg.det(turn))) ** (1 / 3) for turn in (unit.gyro, unit.accelerometer)]
        return float(np.abs(log_ratio - np.log(sizes)).max())

    units = [one for one in screening.imu_hypotheses if one.code == "column-kind"]
    nearest = min(units, key=distance, default=None)
    if nearest is None or distance(nearest) > AS_NOISE or np.abs(log_ratio).min() < FAR_OFF:
        return []
    refit = refitted(screening, screening.unfitted(nearest))
    return [] if refit is None or refit.screening is None or not refit.screening.fits_closely else [replace(refit, fits=True)]


def _key_hypotheses(case: Case, motion: MeasuredMotion) -> Iterator[KeyHypothesis]:
    """Recording hypotheses."""
    if case.vehicle.imu.accel_axes == "imu":
        yield KeyHypothesis(("accel-axes",), {"imu.accel_axes": "start"})
    if any(wheel.column == "speed" for wheel in case.vehicle.wheels):
        yield _tachometers_later(case, motion)
    if case.log.command_kind == "jets" and case.log.command.any():
        yield from _pulses_elsewhere(case, motion)
        yield from _short_pulses(case, motion)
        yield from (_later(case, motion, jet) for jet in _likeliest_later(case))


def _limit_hypotheses(case: Case, motion: MeasuredMotion) -> Iterator[KeyHypothesis]:
    """Limits of a commanded wrench, with another delay if that explains more, since limiting shifts the commands in time."""
    limits_stated = limits(case, motion) if case.log.command_kind == "wrench" and case.vehicle.thrust.wrench_limits is None else None
    if limits_stated is None:
        return
    change, delay_open = _delay_with(case, motion, limits_stated.key_values), case.vehicle.cycle.command_delay_cycles == "auto"
    limits_delayed = limits(case, motion, change) if delay_open or abs(change) > NEAR else None
    if limits_delayed is None or not delay_open:
        yield KeyHypothesis(("commands-limited",), limits_stated.key_values, limits_stated.sigma_key_values)
    if limits_delayed is not None and (delay_open or limits_delayed.cost < limits_stated.cost - CLEAR):
        codes = ("commands-limited",) if delay_open else ("commands-limited", "delay-mismatch")
        yield KeyHypothesis(codes, limits_delayed.key_values, limits_delayed.sigma_key_values, limits_delayed.delay_change, PRIORS["delay"])


def _delay_with(case: Case, motion: MeasuredMotion, states: KeyValues) -> float:
    """Change of the delay of least cost with these key values, cycles."""

    def cost(change: float) -> float:
        return _cost(case, motion, states, change) if case.timing.delay + change >= 0 else np.inf

    return line_minimum(cost, (0.0, -case.timing.delay), ANOTHER, NEAR / 4)


def _pulses_elsewhere(case: Case, motion: MeasuredMotion) -> Iterator[KeyHypothesis]:
    """Pulses elsewhere in the cycle, with the delay as stated or one that keeps their mean time."""
    on, cycle = case.log.command[:, : len(case.vehicle.jets)], case.vehicle.cycle
    idle = 1 - float((on**2).sum() / max(on.sum(), TINY)) / cycle.period_s
    for at in [at for at in LATE if at != cycle.pulse_at] if idle > NEAR else []:
        states: KeyValues = {"cycle.pulse_at": at}
        cost = partial(_cost, case, motion, states)
        change = (LATE[cycle.pulse_at] - LATE[at]) * idle
        change = line_minimum(cost, (change,), 0.1, NEAR / 4) if cost(0.0) > cost(change) else 0.0
        if case.timing.delay + change >= 0:
            yield KeyHypothesis(("pulse-position",), states, delay_change=change, delay_sigma=PRIORS["delay"] if change else 0.0)


def _short_pulses(case: Case, motion: MeasuredMotion) -> Iterator[KeyHypothesis]:
    """Short pulses that last a least time or do not open the valve, by the value of least cost."""
    on, period_s = case.log.command[:, : len(case.vehicle.jets)], case.vehicle.cycle.period_s
    shortest = float(on[on > 0].min(initial=period_s)) / period_s
    for key in ("thrust.least_on_s", "thrust.dead_on_s"):
        if case.setup.value(key)[0] == 0 and shortest < SHORT[-1]:

            def cost(cycles: float, key: str = key) -> float:
                return _cost(case, motion, {key: max(cycles, 0.0) * period_s})

            cycles_best = line_minimum(cost, [cycles for cycles in SHORT if cycles > shortest], SHORT[0], NEAR / 8)
            further: KeyValues = {key: (cycles_best + sigma_at(cost, cycles_best)) * period_s}
            yield KeyHypothesis(("short-pulses",), {key: cycles_best * period_s}, (further,) if key == "thrust.least_on_s" else ())


def _later(case: Case, motion: MeasuredMotion, jet: int) -> KeyHypothesis:
    """Pulses of one jet later, by the value of least cost."""
    return _all_later(case, motion, "jet-late", {f"jets.{jet}.delay_s": case.vehicle.jets[jet].delay_s}, (0.5, 1.0, 1.5, 2.0), 0.5)


def _tachometers_later(case: Case, motion: MeasuredMotion) -> KeyHypothesis:
    """Wheel speeds later than stated, all by one value of least cost, as by a motor controller's filter or a bus."""
    by_speed = {n: wheel.speed_latency_s for n, wheel in enumerate(case.vehicle.wheels) if wheel.column == "speed"}
    stated_s = {f"wheels.{n}.speed_latency_s": latency_s for n, latency_s in by_speed.items()}
    return _all_later(case, motion, "speed-late", stated_s, (0.1, 0.2, 0.4, 0.8, 1.6), 0.2)


def _all_later(
    case: Case, motion: MeasuredMotion, code: str, stated_s: Mapping[str, float], starts: Sequence[float], step: float
) -> KeyHypothesis:
    """Keys later than stated by one value of least cost, from the ``starts`` on, cycles."""

    def states(cycles: float) -> KeyValues:
        return {key: max(stated + cycles * case.vehicle.cycle.period_s, 0.0) for key, stated in stated_s.items()}

    def cost(cycles: float) -> float:
        return _cost(case, motion, states(cycles))

    change = line_minimum(cost, starts, step, NEAR)
    return KeyHypothesis((code,), states(change), (states(change + sigma_at(cost, change)),))


def _before_twin(case: Case) -> Iterator[KeyHypothesis]:
    """Each jet whose commands are those of another one some cycles earlier, so that both may act together.

    Free responses cannot show it, since the other jet's coefficient describes both.
    """
    if case.log.command_kind != "jets":
        return
    on, period_s = case.log.command[:, : len(case.vehicle.jets)], case.vehicle.cycle.period_s
    for cycles in EARLIER:
        alike = (on[cycles:, :, None] == on[:-cycles, None, :]).mean(0) > MOSTLY
        for jet in np.flatnonzero((alike & ~np.eye(len(alike), dtype=bool)).any(0) & on.any(0)).tolist():
            at = case.vehicle.jets[jet].delay_s + cycles * period_s
            key = f"jets.{jet}.delay_s"
            yield KeyHypothesis(("jet-late",), {key: at}, ({key: at + NEAR * period_s},))


def _likeliest_later(case: Case) -> list[int]:
    """Jets for which a delay of one cycle explains most; several if they are commanded alike.

    The motion is regressed on the impulses of all jets, plus the change of one jet's by a cycle.
    """
    samples = case.timing.of(case.log, case.vehicle)
    impulses, rate, jets = samples.executed.channels, samples.rate_rad_s, len(case.vehicle.jets)
    body = np.hstack([products(rate), samples.up_b[:-1], np.ones((len(rate), 1))])
    first = int(np.argmax(samples.executed.usable)) + 1
    gains = np.zeros(jets)
    for motion, impulse, body_columns in (
        (np.diff(rate, axis=0), impulses.step[:, :jets], (body[1:] + body[:-1]) / 2),
        (samples.specific_force_m_s2, impulses.whole[:, :jets], body),
    ):
        regressors = np.hstack([impulse, body_columns])[first:]
        basis = np.linalg.qr(regressors[:, np.ptp(regressors, axis=0) > 0])[0]
        residual, delayed = (one - basis @ (basis.T @ one) for one in (motion[first:], (np.roll(impulse, 1, 0) - impulse)[first:]))
        explained = (delayed.T @ residual) ** 2 / np.maximum(np.outer((delayed**2).sum(0), (residual**2).sum(0)), TINY)
        gains -= len(residual) * np.log1p(-np.minimum(explained, 1 - ROUNDING)).sum(1)
    return np.flatnonzero(gains > max(gains.max(initial=0.0) - ROUGHLY, CLEAR)).tolist()


def logged_after(case: Case) -> int:
    """Control cycles by which commands acted before they were logged; 0 if that does not explain far more."""
    if case.log.command_kind not in ("jets", "wrench") or case.log.command_s is not None:
        return 0
    delay = int(case.timing.delay)  # a shift within the delay
    motion = motion_of(case.timing.of(case.log, case.vehicle))

    def cost(cycles: int) -> float:
        shifted = np.vstack([case.log.command[cycles:], np.zeros((cycles, case.log.command.shape[1]))])
        return _cost(case._replace(log=replace(case.log, command=frozen(shifted))), motion, {})

    best = min((*range(delay + 1), *(delay + cycles for cycles in EARLIER)), key=cost)
    # a smaller delay explains commands that were logged before they acted
    return best if best > delay and cost(best) < cost(0) - case.log.cycles else 0


def _cost(case: Case, motion: MeasuredMotion | None, states: KeyValues, later: float = 0.0) -> float:
    return sum(costs_with(case.setup, states, later, motion=motion))
