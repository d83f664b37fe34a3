"""The composed flow: what each motion tells, which are chosen, and the plan flown whole."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.plan import limits as limited
from massprop_cli.plan.choose import Criterion, PlanGoal, Tried, choose
from massprop_cli.plan.motions import LEVELS, Manoeuvre, library
from massprop_cli.plan.rehearsal import Rehearsal, unheld
from massprop_cli.testbed.timeline import Segment

BLOCK_S, BLOCKS = 3.0, 20
"""Motions are chosen for blocks of this length, or for a twentieth of the time where that is less."""
ENOUGH = 0.95
"""Part of the wanted sigma that is aimed at: seeds and guesses differ by a few per cent."""
SEEDS = (1, 2, 3)
"""Draws of random pulses that limits are checked with."""
ROUNDS = 5
"""Most attempts at a whole plan."""
SEARCHED = 2
"""Bodies that single motions are flown with; the whole plan is flown with every one."""
MEMBERS = 12
"""Bodies flown at once for what they show."""
Say = Callable[[str, float], None]


@dataclass(frozen=True)
class Stretch:
    """A motion from one cycle to another."""

    motion: Manoeuvre
    start: int
    end: int

    @property
    def segments(self) -> list[Segment]:
        """In the scenario's words."""
        return self.motion.segments(self.start, self.end)


@dataclass(frozen=True)
class Planned:
    """A plan that was flown whole, with every body."""

    stretches: tuple[Stretch, ...]
    cycles: int
    wanted: PlanGoal
    information: Array
    """(G, K, n, n) of every cycle (:meth:`massprop_cli.plan.rehearsal.Rehearsal.information`), in natural sizes."""
    used: dict[str, float]
    limits: dict[str, float]
    tried: tuple[Tried, ...]
    period_s: float
    reached: bool
    any_impulse: "Planned | None" = None
    """Where it is not reached: the plan without the limit on the impulse, which shows what that limit costs."""

    @property
    def duration_s(self) -> float:
        """Of the whole plan."""
        return round(self.cycles * self.period_s, 9)

    @property
    def segments(self) -> list[Segment]:
        """Of the scenario, in order."""
        return [segment for stretch in self.stretches for segment in stretch.segments]

    def ratios(self) -> Array:
        """(K, G, n) of predicted over wanted sigma after every cycle."""
        return self.wanted.ratios(np.swapaxes(np.cumsum(self.information, 1), 0, 1))


@dataclass(frozen=True)
class Order:
    """What is asked of a plan."""

    wanted: PlanGoal
    limits: dict[str, float]
    max_cycles: int
    criterion: Criterion
    least_cycles: int
    """So many updates must be steady before an estimate counts as converged."""


class Trials:
    """Single motions, each flown once for a block of cycles however often a plan asks: what they take, and what they show."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self.rehearsal = rehearsal
        self._flown: dict[tuple[Manoeuvre, int], tuple[Array, dict[str, float]]] = {}
        self._information: dict[tuple[Manoeuvre, int], Array] = {}

    @property
    def _bodies(self) -> Array:
        return self.rehearsal.guess.bodies[:SEARCHED]

    def used(self, motion: Manoeuvre, block: int) -> dict[str, float]:
        """What a motion of ``block`` cycles takes of each limit, the most of any body."""
        if (motion, block) not in self._flown:
            self._flown[motion, block] = self.rehearsal.flown(motion.segments(0, block), block, self._bodies)
        return self._flown[motion, block][1]

    def open(self, motions: Sequence[Manoeuvre], block: int) -> list[list[Manoeuvre]]:
        """Those of motions that were flown whose information is not known yet, in groups of what :meth:`examine` takes at once."""
        some = [motion for motion in motions if (motion, block) not in self._information]
        size = MEMBERS // SEARCHED
        return [some[start : start + size] for start in range(0, len(some), size)]

    def examine(self, motions: Sequence[Manoeuvre], block: int) -> None:
        """Calculate the information of motions that were flown."""
        issued = np.concatenate([self._flown[motion, block][0] for motion in motions])
        told = self.rehearsal.information(block, issued, np.tile(self._bodies, (len(motions), 1))).sum(1)
        alone = _without_rate(told)
        for motion, one in zip(motions, alone.reshape(len(motions), SEARCHED, *alone.shape[1:]), strict=True):
            self._information[motion, block] = one

    def information(self, motion: Manoeuvre, block: int) -> Array:
        """(G, 10 or 11, the same) in natural sizes, where the rate at the start is unknown."""
        return self._information[motion, block]


def _without_rate(told: Array) -> Array:
    """(…, 10 or 11, the same) what is told of all else where the rate at the start is unknown: the Schur complement."""
    rates, rest = slice(10, 13), np.delete(np.arange(told.shape[-1]), slice(10, 13))
    across, rate = told[..., rest, rates], told[..., rates, rates]
    rate = rate + 1e-12 * np.trace(rate, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
    return np.asarray(told[..., rest[:, None], rest] - across @ np.linalg.solve(rate, np.swapaxes(across, -1, -2)))


def plan(trials: Trials, order: Order, say: Say) -> Planned:
    """Choose and fly; :class:`InputError` where no motion keeps the limits."""
    rehearsal = trials.rehearsal
    axes = rehearsal.axes
    if not axes:
        raise InputError(
            f"{rehearsal.source}: the actuators cannot drive any axis in both directions without disturbing the others; add jets"
        )
    period = rehearsal.vehicle.cycle.period_s
    block = max(min(round(BLOCK_S / period), order.max_cycles // BLOCKS), 6 + int(rehearsal.delay_cycles))
    tight, used = dict.fromkeys(order.limits, 1.0), None
    for _ in range(ROUNDS):
        tried, least = _tried(trials, order, library(axes, block), block, tight, say)
        if not tried:
            used = used or least
            break
        found = _whole(rehearsal, order, tried, block, tight.get("impulse_n_s", 1.0), say)
        passed = limited.exceeded(found.used, order.limits)
        if not passed:
            return found
        used = found.used
        tight |= {name: 0.95 * tight[name] / factor for name, factor in passed.items()}
    assert used is not None
    raise InputError(_unkept(rehearsal, order, used))


def _tried(
    trials: Trials, order: Order, motions: Sequence[Manoeuvre], block: int, tight: dict[str, float], say: Say
) -> tuple[list[Tried], dict[str, float]]:
    """Every motion at the highest level that keeps the limits, with what it tells; and what the gentlest of the others takes."""
    kept: list[Manoeuvre] = []
    least: dict[str, float] = {}
    for number, motion in enumerate(motions):
        say("flying motions", number / len(motions))
        for level in LEVELS:
            lower = replace(motion, level=level)
            used = trials.used(lower, block)
            if not limited.exceeded(used, {name: tight[name] * limit for name, limit in order.limits.items()}):
                kept.append(lower)
                break
            least = used if not least or _over(used, order) < _over(least, order) else least
    groups = trials.open(kept, block)
    for number, group in enumerate(groups):
        say("computing the information of each motion", number / len(groups))
        trials.examine(group, block)
    return [Tried(motion, trials.information(motion, block), trials.used(motion, block)) for motion in kept], least


def _over(used: dict[str, float], order: Order) -> float:
    """How many times the limit is taken that is passed farthest."""
    return max(used[name] / limit for name, limit in order.limits.items())


def _unkept(rehearsal: Rehearsal, order: Order, used: dict[str, float]) -> str:
    worst = max(order.limits, key=lambda name: used[name] / order.limits[name])
    (name, unit), beyond = limited.LIMITS[worst], unheld(rehearsal)
    remedy = "Raise the limit, or correct the guess"
    if beyond is not None:
        torque, full = beyond
        command = " (massprop balance, with a log in which the table swings while its wheels turn)" if rehearsal.vehicle.on_pedestal else ""
        remedy = (
            f"With the guess, gravity torque on the table is up to {torque:.3g} N m, and its wheels give {full:.3g} N m. Balance it "
            f"first{command}, or raise the limit"
        )
    return (
        f"{rehearsal.source}: no motion keeps the limit of {order.limits[worst]:.4g} {unit} on the {name}; "
        f"the gentlest takes {used[worst]:.3g} {unit}. {remedy}"
    )


def _whole(rehearsal: Rehearsal, order: Order, tried: Sequence[Tried], block: int, thrifty: float, say: Say) -> Planned:
    """As many blocks as it takes, flown whole with every body, and cut where all that is wanted is reached."""
    few = replace(order.wanted, bodies=order.wanted.bodies[:SEARCHED])
    most, enough = order.max_cycles // block, ENOUGH
    budget = thrifty * order.limits.get("impulse_n_s", np.inf)

    def fits(chosen: Sequence[int]) -> bool:
        return sum(tried[i].used["impulse_n_s"] for i in chosen) <= budget

    chosen: list[int] = []
    upto = most
    cheapest = int(np.argmin([one.used["impulse_n_s"] for one in tried]))
    for attempt in range(ROUNDS):
        say("flying the plan", attempt / ROUNDS)
        chosen = choose(tried, few, order.criterion, upto, enough, fits, chosen)
        found = _flown(rehearsal, order, tried, chosen, block)
        worst = float(found.ratios()[-1].max())
        if worst <= ENOUGH or len(chosen) >= most or not fits([*chosen, cheapest]):
            break
        # information grows with the time; the last attempt takes all of it
        longer = max(len(chosen) + 1, round(len(chosen) * (worst / ENOUGH) ** 2 + 0.5))
        upto, enough = most if attempt == ROUNDS - 2 else min(most, longer), 0.0
    return _cut(rehearsal, order, found)


def _flown(rehearsal: Rehearsal, order: Order, tried: Sequence[Tried], chosen: Sequence[int], block: int) -> Planned:
    stretches: list[Stretch] = []
    for number in sorted(dict.fromkeys(chosen), key=list(chosen).index):
        start = stretches[-1].end if stretches else 0
        stretches.append(Stretch(tried[number].motion, start, start + block * list(chosen).count(number)))
    least, end = min(order.least_cycles, order.max_cycles), stretches[-1].end
    if end < least and "impulse_n_s" in order.limits:
        stretches.append(Stretch(Manoeuvre("hold", (), held=stretches[-1].motion.held), end, least))
    stretches[-1] = replace(stretches[-1], end=max(stretches[-1].end, least))
    segments, cycles = [segment for stretch in stretches for segment in stretch.segments], stretches[-1].end
    bodies = rehearsal.guess.bodies
    issued, used = rehearsal.flown(segments, cycles, bodies, SEEDS)
    told = rehearsal.information(cycles, issued[: len(bodies)], bodies)
    if any(segment.motion == "random" for segment in segments):
        # what is told of the guess is the mean over draws of its pulses
        drawn = issued[len(bodies) :: len(bodies)]
        again = rehearsal.information(cycles, drawn, np.repeat(bodies[:1], len(drawn), 0))
        told[0] = np.concatenate([told[:1], again]).mean(0)
    # an estimate begins with the first cycle whose command is known
    told[:, : int(np.ceil(rehearsal.delay_cycles))] = 0.0
    return Planned(
        tuple(stretches), cycles, order.wanted, told, used, order.limits, tuple(tried), rehearsal.vehicle.cycle.period_s, reached=False
    )


def _cut(rehearsal: Rehearsal, order: Order, found: Planned) -> Planned:
    """Where every ratio is small enough, and as many updates as an estimate takes to converge."""
    worst = found.ratios().max((1, 2))
    reached = bool(worst[-1] <= 1)
    enough = np.flatnonzero(worst <= ENOUGH)
    if not len(enough):
        return replace(found, reached=reached)
    cycles = min(max(int(enough[0]) + 1, order.least_cycles), found.cycles)
    stretches = tuple(replace(s, end=min(s.end, cycles)) for s in found.stretches if s.start < cycles)
    used = found.used
    if cycles < found.cycles:
        segments = [segment for stretch in stretches for segment in stretch.segments]
        used = rehearsal.flown(segments, cycles, rehearsal.guess.bodies, SEEDS)[1]
    return replace(found, stretches=stretches, cycles=cycles, information=found.information[:, :cycles], used=used, reached=reached)
