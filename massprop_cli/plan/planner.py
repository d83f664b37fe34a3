"""Planning: information of each motion, choice of motions, and simulation of the whole plan."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.plan import limits as limited
from massprop_cli.plan.choose import Candidate, Criterion, PlanGoal, choose
from massprop_cli.plan.motions import LEVELS, Manoeuvre, motions_of
from massprop_cli.plan.rehearsal import Rehearsal, excess_gravity_torque
from massprop_cli.testbed.timeline import Segment

BLOCK_S, BLOCKS = 3.0, 20
"""Length of a block, s, and smallest number of blocks in the longest plan; a block is the shorter of the two."""
TARGET = 0.95
"""Aimed ratio of predicted to wanted sigma; the margin covers differences of a few per cent between seeds and guesses."""
SEEDS = (1, 2, 3)
"""Seeds of the random pulses in the check of the limits."""
ROUNDS = 5
"""Largest number of attempts at a whole plan."""
SEARCHED = 2
"""Number of bodies in the simulation of single motions; the simulation of the whole plan includes all bodies."""
MEMBERS = 12
"""Number of members in one calculation of information."""
Say = Callable[[str, float], None]
"""Report of progress: activity and completed part."""


@dataclass(frozen=True)
class TimelineMotion:
    """A motion with its start and end, control cycles."""

    motion: Manoeuvre
    start: int
    end: int

    @property
    def segments(self) -> list[Segment]:
        """Segments of the scenario."""
        return self.motion.segments(self.start, self.end)


@dataclass(frozen=True)
class SimulatedPlan:
    """A plan with the results of its simulation with all bodies."""

    timeline: tuple[TimelineMotion, ...]
    cycles: int
    goal: PlanGoal
    information: Array
    """(G, K, n, n) information matrix of each cycle (:meth:`massprop_cli.plan.rehearsal.Rehearsal.information`), in natural sizes."""
    used: dict[str, float]
    """Largest use of each limit over all bodies and seeds."""
    limits: dict[str, float]
    candidates: tuple[Candidate, ...]
    period_s: float
    reached: bool
    any_impulse: "SimulatedPlan | None" = None
    """If the goal is not reached: the plan without the impulse limit, which shows the effect of that limit."""

    @property
    def duration_s(self) -> float:
        """Duration, s."""
        return round(self.cycles * self.period_s, 9)

    @property
    def segments(self) -> list[Segment]:
        """Segments of the scenario, in order."""
        return [segment for part in self.timeline for segment in part.segments]

    def ratios(self) -> Array:
        """(K, G, n) ratio of predicted to wanted sigma after each cycle."""
        return self.goal.ratios(np.swapaxes(np.cumsum(self.information, 1), 0, 1))


@dataclass(frozen=True)
class PlanTask:
    """Goal and constraints of a plan."""

    goal: PlanGoal
    limits: dict[str, float]
    max_cycles: int
    criterion: Criterion
    least_cycles: int
    """Smallest length; an estimate needs this many cycles to count as converged."""


class MotionLibrary:
    """Simulations of single motions, cached by motion and block length: use of the limits, and information."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self.rehearsal = rehearsal
        self._flown: dict[tuple[Manoeuvre, int], tuple[Array, dict[str, float]]] = {}
        self._information: dict[tuple[Manoeuvre, int], Array] = {}

    @property
    def _bodies(self) -> Array:
        return self.rehearsal.guess.bodies[:SEARCHED]

    def used(self, motion: Manoeuvre, block: int) -> dict[str, float]:
        """Largest use of each limit by a motion of ``block`` cycles over all bodies."""
        if (motion, block) not in self._flown:
            self._flown[motion, block] = self.rehearsal.flown(motion.segments(0, block), block, self._bodies)
        return self._flown[motion, block][1]

    def pending(self, motions: Sequence[Manoeuvre], block: int) -> list[list[Manoeuvre]]:
        """The motions whose information is not calculated, in groups for :meth:`calculate`."""
        some = [motion for motion in motions if (motion, block) not in self._information]
        size = MEMBERS // SEARCHED
        return [some[start : start + size] for start in range(0, len(some), size)]

    def calculate(self, motions: Sequence[Manoeuvre], block: int) -> None:
        """Calculate the information of simulated motions."""
        issued = np.concatenate([self._flown[motion, block][0] for motion in motions])
        whole = self.rehearsal.information(block, issued, np.tile(self._bodies, (len(motions), 1))).sum(1)
        information = _without_rate(whole)
        for motion, one in zip(motions, information.reshape(len(motions), SEARCHED, *information.shape[1:]), strict=True):
            self._information[motion, block] = one

    def information(self, motion: Manoeuvre, block: int) -> Array:
        """(G, 10 or 11, 10 or 11) information matrix in natural sizes, with the initial rate eliminated."""
        return self._information[motion, block]


def _without_rate(information: Array) -> Array:
    """(…, n − 3, n − 3) information with the initial rate eliminated as a nuisance parameter: the Schur complement of (…, n, n)."""
    rates, others = slice(10, 13), np.delete(np.arange(information.shape[-1]), slice(10, 13))
    cross, rate = information[..., others, rates], information[..., rates, rates]
    rate = rate + 1e-12 * np.trace(rate, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    return np.asarray(information[..., others[:, None], others] - cross @ np.linalg.solve(rate, np.swapaxes(cross, -1, -2)))


def plan(library: MotionLibrary, task: PlanTask, say: Say) -> SimulatedPlan:
    """Choose motions and simulate the plan; raise :class:`InputError` if no motion is within the limits."""
    rehearsal = library.rehearsal
    axes = rehearsal.axes
    if not axes:
        raise InputError(
            f"{rehearsal.source}: the actuators cannot drive any axis in both directions without disturbing the others; add jets"
        )
    period = rehearsal.vehicle.cycle.period_s
    block = max(min(round(BLOCK_S / period), task.max_cycles // BLOCKS), 6 + int(rehearsal.delay_cycles))
    reduction, used = dict.fromkeys(task.limits, 1.0), None
    for _ in range(ROUNDS):
        candidates, least = _candidates(library, task, motions_of(axes, block), block, reduction, say)
        if not candidates:
            used = used or least
            break
        simulated = _plan_within_time(rehearsal, task, candidates, block, reduction.get("impulse_n_s", 1.0), say)
        exceeded = limited.exceeded(simulated.used, task.limits)
        if not exceeded:
            return simulated
        used = simulated.used
        reduction |= {name: 0.95 * reduction[name] / factor for name, factor in exceeded.items()}
    assert used is not None
    raise InputError(_limit_message(rehearsal, task, used))


def _candidates(
    library: MotionLibrary, task: PlanTask, motions: Sequence[Manoeuvre], block: int, reduction: dict[str, float], say: Say
) -> tuple[list[Candidate], dict[str, float]]:
    """Each motion at the highest level within the reduced limits, and the least use of the limits by a motion that exceeds them.

    ``reduction``: factor on each limit, since a sequence of motions may use more than each motion alone.
    """
    chosen: list[Manoeuvre] = []
    least: dict[str, float] = {}
    for number, motion in enumerate(motions):
        say("flying motions", number / len(motions))
        for level in LEVELS:
            lower = replace(motion, level=level)
            used = library.used(lower, block)
            if not limited.exceeded(used, {name: reduction[name] * limit for name, limit in task.limits.items()}):
                chosen.append(lower)
                break
            least = used if not least or _largest_ratio(used, task) < _largest_ratio(least, task) else least
    groups = library.pending(chosen, block)
    for number, group in enumerate(groups):
        say("computing the information of each motion", number / len(groups))
        library.calculate(group, block)
    return [Candidate(motion, library.information(motion, block), library.used(motion, block)) for motion in chosen], least


def _largest_ratio(used: dict[str, float], task: PlanTask) -> float:
    """Largest ratio of use to limit."""
    return max(used[name] / limit for name, limit in task.limits.items())


def _limit_message(rehearsal: Rehearsal, task: PlanTask, used: dict[str, float]) -> str:
    """Message that even the gentlest motion exceeds a limit, with a remedy."""
    worst = max(task.limits, key=lambda name: used[name] / task.limits[name])
    (name, unit), excess = limited.LIMITS[worst], excess_gravity_torque(rehearsal)
    remedy = "Raise the limit, or correct the guess"
    if excess is not None:
        torque, full = excess
        command = " (massprop balance, with a log in which the table swings while its wheels turn)" if rehearsal.vehicle.on_pedestal else ""
        remedy = (
            f"With the guess, gravity torque on the table is up to {torque:.3g} N m, and its wheels give {full:.3g} N m. Balance it "
            f"first{command}, or raise the limit"
        )
    return (
        f"{rehearsal.source}: no motion keeps the limit of {task.limits[worst]:.4g} {unit} on the {name}; "
        f"the gentlest takes {used[worst]:.3g} {unit}. {remedy}"
    )


def _plan_within_time(
    rehearsal: Rehearsal, task: PlanTask, candidates: Sequence[Candidate], block: int, reduction: float, say: Say
) -> SimulatedPlan:
    """Choose and simulate increasing numbers of blocks until the goal is reached, then shorten the plan.

    ``reduction``: factor on the impulse limit.
    """
    searched = replace(task.goal, bodies=task.goal.bodies[:SEARCHED])
    most, enough = task.max_cycles // block, TARGET
    budget = reduction * task.limits.get("impulse_n_s", np.inf)

    def allowed(chosen: Sequence[int]) -> bool:
        return sum(candidates[i].used["impulse_n_s"] for i in chosen) <= budget

    chosen: list[int] = []
    upto = most
    cheapest = int(np.argmin([one.used["impulse_n_s"] for one in candidates]))
    for attempt in range(ROUNDS):
        say("flying the plan", attempt / ROUNDS)
        chosen = choose(candidates, searched, task.criterion, upto, enough, allowed, chosen)
        simulated = _simulated(rehearsal, task, candidates, chosen, block)
        worst = float(simulated.ratios()[-1].max())
        if worst <= TARGET or len(chosen) >= most or not allowed([*chosen, cheapest]):
            break
        # information is proportional to time; the last attempt uses all the time
        longer = max(len(chosen) + 1, round(len(chosen) * (worst / TARGET) ** 2 + 0.5))
        upto, enough = most if attempt == ROUNDS - 2 else min(most, longer), 0.0
    return _shortened(rehearsal, task, simulated)


def _simulated(rehearsal: Rehearsal, task: PlanTask, candidates: Sequence[Candidate], chosen: Sequence[int], block: int) -> SimulatedPlan:
    """Simulate the chosen blocks with all bodies; blocks of one motion are consecutive."""
    timeline: list[TimelineMotion] = []
    for number in sorted(dict.fromkeys(chosen), key=list(chosen).index):
        start = timeline[-1].end if timeline else 0
        timeline.append(TimelineMotion(candidates[number].motion, start, start + block * list(chosen).count(number)))
    least, end = min(task.least_cycles, task.max_cycles), timeline[-1].end
    if end < least and "impulse_n_s" in task.limits:
        timeline.append(TimelineMotion(Manoeuvre("hold", (), held=timeline[-1].motion.held), end, least))
    timeline[-1] = replace(timeline[-1], end=max(timeline[-1].end, least))
    segments, cycles = [segment for part in timeline for segment in part.segments], timeline[-1].end
    bodies = rehearsal.guess.bodies
    issued, used = rehearsal.flown(segments, cycles, bodies, SEEDS)
    information = rehearsal.information(cycles, issued[: len(bodies)], bodies)
    if any(segment.motion == "random" for segment in segments):
        # the guess takes the mean information over the seeds of the random pulses
        other_seeds = issued[len(bodies) :: len(bodies)]
        of_other_seeds = rehearsal.information(cycles, other_seeds, np.repeat(bodies[:1], len(other_seeds), 0))
        information[0] = np.concatenate([information[:1], of_other_seeds]).mean(0)
    # an estimate starts with the first cycle whose executed command is in the log
    information[:, : int(np.ceil(rehearsal.delay_cycles))] = 0.0
    period = rehearsal.vehicle.cycle.period_s
    return SimulatedPlan(tuple(timeline), cycles, task.goal, information, used, task.limits, tuple(candidates), period, reached=False)


def _shortened(rehearsal: Rehearsal, task: PlanTask, simulated: SimulatedPlan) -> SimulatedPlan:
    """End the plan when all ratios reach the target, but not before the smallest length of the task."""
    worst = simulated.ratios().max((1, 2))
    reached = bool(worst[-1] <= 1)
    enough = np.flatnonzero(worst <= TARGET)
    if not len(enough):
        return replace(simulated, reached=reached)
    cycles = min(max(int(enough[0]) + 1, task.least_cycles), simulated.cycles)
    timeline = tuple(replace(part, end=min(part.end, cycles)) for part in simulated.timeline if part.start < cycles)
    used = simulated.used
    if cycles < simulated.cycles:
        segments = [segment for part in timeline for segment in part.segments]
        used = rehearsal.flown(segments, cycles, rehearsal.guess.bodies, SEEDS)[1]
    information = simulated.information[:, :cycles]
    return replace(simulated, timeline=timeline, cycles=cycles, information=information, used=used, reached=reached)
