"""Flow of ``massprop plan``: read vehicle and guess, plan, and write the result."""

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
from massprop_cli.plan.planner import MotionLibrary, PlanTask, Say, SimulatedPlan
from massprop_cli.plan.rehearsal import Rehearsal

STEADY = 2
"""Smallest length of a plan, relative to the updates that must be steady for convergence; a shorter maximum time takes precedence."""
LEAST = 4
"""Smallest number of cycles after the command delay in the maximum time."""


@dataclass(frozen=True)
class PlanRequest:
    """Options of ``massprop plan``."""

    wants: tuple[Requirement, ...]
    """Wanted quantities and precisions."""
    max_time_s: float = 60.0
    criterion: Criterion = "worst"
    limits: Mapping[str, float] = field(default_factory=dict)
    """Stated limits, by the names of :data:`massprop_cli.plan.limits.LIMITS`."""
    off: tuple[str, ...] = ()
    """Names of jets that the plan does not use."""


@dataclass(frozen=True)
class WrittenPlan:
    """Contents of the files of a plan."""

    plan: PlanFile
    scenario: str
    """Text of scenario.toml."""

    @property
    def exit_code(self) -> int:
        """4 if the plan does not reach the goal, else 0."""
        return 0 if self.plan.reached else exits.NOT_CONVERGED


def make(vehicle: Path, guess_file: Path | None, request: PlanRequest, say: Say, assignments: tuple[str, ...] = ()) -> WrittenPlan:
    """Plan a test; raise :class:`InputError` if the inputs are not sufficient, or if no motion is within the limits."""
    source = vehiclefile.load(vehicle, assignments)
    guessed = guess.load(guess_file, source)
    model = rehearsal.rehearsal(source, guessed, request.off)
    task = _task(model, guessed, request)
    motions = MotionLibrary(model)
    simulated, notes = planner.plan(motions, task, say), []
    omitted = rehearsal.outside_bound(model.vehicle)
    if omitted:
        say("estimating the plan's log", 1.0)
        notes.append(
            f"the Cramér–Rao bound does not include {', '.join(omitted)}, so massprop increased the sigmas to those of an estimate of "
            "the plan's log"
        )
        simulated = _with_estimated_sigmas(model, simulated)
        if not simulated.reached:
            simulated = _with_estimated_sigmas(model, planner.plan(motions, replace(task, goal=simulated.goal), say))
    if not simulated.reached:
        simulated = replace(simulated, any_impulse=_any_impulse(motions, replace(task, goal=simulated.goal), say))
    if guessed.file.body.breaks_triangle and source.vehicle.environment.kind != "planar":
        notes.append("the guess breaks the triangle inequality of principal moments, which no real body does; check its units and signs")
    if source.vehicle.spinning and not model.by_wheels:
        notes.append(f"the {called(source.vehicle.spinning)} keep their initial speed: the plan moves the vehicle by jets or a wrench")
    if source.vehicle.thrust.failures:
        notes.append("the plan and scenario.toml ignore thrust.failures, which belong to another log")
    if request.off:
        notes.append(f"the plan and scenario.toml do not use {', '.join(request.off)}")
    made = document.document(simulated, model, source, request.criterion, request.max_time_s, notes)
    plain = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in source.vehicle.name).strip("-.")
    return WrittenPlan(made, document.scenario_toml(simulated, model, f"{plain or 'vehicle'}-plan"))


def _task(model: Rehearsal, guessed: guess.Guess, request: PlanRequest) -> PlanTask:
    """Goal and constraints from the options; raise :class:`InputError` if they contradict vehicle or guess."""
    goal = PlanGoal(request.wants, guessed.bodies, model.vehicle)
    for item, value in zip(request.wants, guessed.file.body.values[goal.index], strict=True):
        if value == 0 and item.precision is not None and item.precision.relative:
            raise InputError(
                f"--want {item}: {item.quantity} is guessed as 0, so a relative precision has no meaning; give it in "
                f"{'kg m^2' if item.quantity.startswith('i') else 'mm'}"
            )
    period = model.vehicle.cycle.period_s
    cycles = int(request.max_time_s / period * (1 + 1e-9))
    delay = int(np.ceil(model.delay_cycles))
    if cycles < delay + LEAST:
        raise InputError(
            f"--max-time {request.max_time_s:g}: is {cycles} cycles of {period:g} s, and commands act {delay} cycles later; give more time"
        )
    start_rad_s, fastest = limits.fastest_start(model.vehicle), request.limits.get("wheel_rad_s", np.inf)
    if fastest <= start_rad_s:
        raise InputError(f"--max-wheel-speed {fastest:g}: a wheel starts at {start_rad_s:g} rad/s; allow more, or start slower")
    steady = STEADY * model.vehicle.convergence.count + delay
    return PlanTask(goal, limits.allowed(model.vehicle, request.limits), cycles, request.criterion, min(steady, cycles))


def _any_impulse(motions: MotionLibrary, task: PlanTask, say: Say) -> SimulatedPlan | None:
    """The plan without the impulse limit; None if there is no such limit, or no plan within the other limits."""
    others = {name: limit for name, limit in task.limits.items() if name != "impulse_n_s"}
    if len(others) == len(task.limits):
        return None
    try:
        return planner.plan(motions, replace(task, limits=others), say)
    except InputError:
        return None


def _with_estimated_sigmas(model: Rehearsal, simulated: SimulatedPlan) -> SimulatedPlan:
    """The plan with its sigmas increased to those of an estimate of its simulated log."""
    bound_only = replace(simulated.goal, vehicle=alone(model.vehicle))
    bounds = np.array([bound_only.sigmas(simulated.information[:, :end].sum(1))[0] for end in (simulated.cycles // 2, simulated.cycles)])
    ratio, floor = rehearsal.beyond_bound(model, simulated.segments, simulated.cycles, bounds)
    increased = replace(simulated, goal=replace(simulated.goal, bound_ratio=ratio, floor=floor))
    return replace(increased, reached=bool(increased.ratios()[-1].max() <= 1))


def write(made: WrittenPlan, folder: Path, pages: dict[str, str]) -> None:
    """Write scenario.toml, ``pages`` by file name, and plan.json; the folder receives all files or none."""
    with files.staged(folder) as stage:
        for name, text in {"scenario.toml": made.scenario, **pages, "plan.json": escape.document(made.plan)}.items():
            stage.save(name, text)
        stage.place()
