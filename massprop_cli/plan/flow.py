"""From files to a plan and its files."""

from collections.abc import Mapping
from dataclasses import field, replace
from pathlib import Path

import numpy as np

from massprop_cli.base import escape, exits, files
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.estimate.quantities import alone
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.actuators.actuator import called
from massprop_cli.inputs.require import Requirement
from massprop_cli.plan import document, guess, limits, planner, rehearsal
from massprop_cli.plan.choose import Criterion, PlanGoal
from massprop_cli.plan.document import PlanFile
from massprop_cli.plan.planner import Order, Planned, Say, Trials
from massprop_cli.plan.rehearsal import Rehearsal

STEADY = 2
"""Times the updates that must be steady before a value counts as converged: a plan is not shorter than that, as far as there is time."""
LEAST = 4
"""Cycles, after those whose commands are not known yet."""


@dataclass(frozen=True)
class Asked:
    """What ``massprop plan`` was asked for."""

    wants: tuple[Requirement, ...]
    max_time_s: float = 60.0
    criterion: Criterion = "worst"
    limits: Mapping[str, float] = field(default_factory=dict)
    """As :data:`massprop_cli.plan.limits.LIMITS` names them."""
    off: tuple[str, ...] = ()


@dataclass(frozen=True)
class WrittenPlan:
    """A plan with all that is written of it."""

    plan: PlanFile
    scenario: str
    """Text of scenario.toml."""

    @property
    def exit_code(self) -> int:
        """4 where what is wanted can't be reached."""
        return 0 if self.plan.reached else exits.NOT_CONVERGED


def make(vehicle: Path, guess_file: Path | None, asked: Asked, say: Say, assignments: tuple[str, ...] = ()) -> WrittenPlan:
    """Plan; :class:`InputError` where there is nothing to plan with, or no motion keeps the limits."""
    source = vehiclefile.load(vehicle, assignments)
    guessed = guess.load(guess_file, source)
    flown = rehearsal.rehearsal(source, guessed, asked.off)
    order = _order(flown, guessed, asked)
    trials = Trials(flown)
    found, notes = planner.plan(trials, order, say), []
    uncounted = rehearsal.uncounted(flown.vehicle)
    if uncounted:
        say("estimating the plan's log", 1.0)
        notes.append(
            f"the Cramér–Rao bound does not include {', '.join(uncounted)}, so massprop increased the sigmas to those of an estimate of "
            "the plan's log"
        )
        found = _widened(flown, found)
        if not found.reached:
            found = _widened(flown, planner.plan(trials, replace(order, wanted=found.wanted), say))
    if not found.reached:
        found = replace(found, any_impulse=_any_impulse(trials, replace(order, wanted=found.wanted), say))
    if guessed.file.body.breaks_triangle and source.vehicle.environment.kind != "planar":
        notes.append("the guess breaks the triangle inequality of principal moments, which no real body does; check its units and signs")
    if source.vehicle.spinning and not flown.by_wheels:
        notes.append(f"the {called(source.vehicle.spinning)} keep their initial speed: the plan moves the vehicle by jets or a wrench")
    if source.vehicle.thrust.failures:
        notes.append("the plan and scenario.toml ignore thrust.failures, which belong to another log")
    if asked.off:
        notes.append(f"the plan and scenario.toml do not use {', '.join(asked.off)}")
    made = document.document(found, flown, source, asked.criterion, asked.max_time_s, notes)
    plain = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in source.vehicle.name).strip("-.")
    return WrittenPlan(made, document.scenario_toml(found, flown, f"{plain or 'vehicle'}-plan"))


def _order(flown: Rehearsal, guessed: guess.Guess, asked: Asked) -> Order:
    wanted = PlanGoal(asked.wants, guessed.bodies, flown.vehicle)
    for item, value in zip(asked.wants, guessed.file.body.values[wanted.index], strict=True):
        if value == 0 and item.precision is not None and item.precision.relative:
            raise InputError(
                f"--want {item}: {item.quantity} is guessed as 0, so a relative precision has no meaning; give it in "
                f"{'kg m^2' if item.quantity.startswith('i') else 'mm'}"
            )
    period = flown.vehicle.cycle.period_s
    cycles = int(asked.max_time_s / period * (1 + 1e-9))
    least = int(np.ceil(flown.delay_cycles))
    if cycles < least + LEAST:
        raise InputError(
            f"--max-time {asked.max_time_s:g}: is {cycles} cycles of {period:g} s, and commands act {least} cycles later; give more time"
        )
    begun, fastest = limits.fastest_start(flown.vehicle), asked.limits.get("wheel_rad_s", np.inf)
    if fastest <= begun:
        raise InputError(f"--max-wheel-speed {fastest:g}: a wheel starts at {begun:g} rad/s; allow more, or start slower")
    steady = STEADY * flown.vehicle.convergence.count + least
    return Order(wanted, limits.allowed(flown.vehicle, asked.limits), cycles, asked.criterion, min(steady, cycles))


def _any_impulse(trials: Trials, order: Order, say: Say) -> Planned | None:
    """The plan without the limit on the impulse; None where there is no such limit, or no plan that keeps the others."""
    others = {name: limit for name, limit in order.limits.items() if name != "impulse_n_s"}
    if len(others) == len(order.limits):
        return None
    try:
        return planner.plan(trials, replace(order, limits=others), say)
    except InputError:
        return None


def _widened(flown: Rehearsal, found: Planned) -> Planned:
    """With sigmas as the estimate of the plan's own log has them."""
    plain = replace(found.wanted, beyond=np.ones(10), vehicle=alone(flown.vehicle))
    bound = plain.sigmas(found.information.sum(1))[0]
    beyond = rehearsal.beyond_bound(flown, found.segments, found.cycles, bound)
    widened = replace(found, wanted=replace(found.wanted, beyond=beyond))
    return replace(widened, reached=bool(widened.ratios()[-1].max() <= 1))


def write(made: WrittenPlan, folder: Path, pages: dict[str, str]) -> None:
    """scenario.toml, further pages, and last plan.json, whole or not at all."""
    with files.staged(folder) as stage:
        for name, text in {"scenario.toml": made.scenario, **pages, "plan.json": escape.document(made.plan)}.items():
            stage.save(name, text)
        stage.place()
