"""Contents of plan.json and scenario.toml, the output of ``massprop plan``. The models below are the schema."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from pydantic import Field

from massprop_cli import CG, QUANTITIES, UNITS, __version__
from massprop_cli.base import configfile
from massprop_cli.base.arrays import ROUNDING, Array
from massprop_cli.conclude.judge import near_origin
from massprop_cli.conclude.reason import Reason
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.plan import limits as limited
from massprop_cli.plan.choose import Criterion, PlanGoal
from massprop_cli.plan.planner import TARGET, SimulatedPlan, TimelineMotion
from massprop_cli.plan.rehearsal import Rehearsal
from massprop_cli.result.schema import Item
from massprop_cli.testbed.bound import natural_sizes

UNOBSERVABLE = 0.5
"""Largest sigma of an observable quantity, relative to its natural size, as in the verdicts of an estimate."""
LONGER = (2.0, 4.0)
"""Factors on the duration for which plan.json predicts sigmas."""
POINTS = 200
"""Approximate number of times in the course of sigmas."""
INFORMS = 1.02
"""Smallest listed ratio of a quantity's sigma without a motion to its sigma with it."""
FOREVER = 1e6
"""Factor on the information of one block of each candidate, for the sigma after any duration."""
IMPULSE_LIMITS = 0.95
"""Largest ratio of worst ratios, without to with the impulse limit, at which that limit is the cause; seeds and guesses differ by less."""
UNREACHED = {"told": "not by this plan", "ratio": None, "reached_at_s": None}
"""Fields of a quantity for which an estimate of the plan's log gives no value."""


class QuantityItem(Item):
    """What is predicted of one quantity."""

    unit: str
    guess: float
    sigma: float = Field(description="one standard deviation at the end, of the body that is guessed; the Cramér–Rao bound")
    worst_sigma: float = Field(description="the largest over the bodies that it may be")
    wanted: str | None = Field(description='as it was stated, "2%"; null where nothing is wanted')
    wanted_sigma: float | None = Field(description="of the body that is guessed, in the unit")
    ratio: float | None = Field(
        description="the worst over all bodies of predicted over wanted sigma: 1 or less is reached; null where the log gives no value"
    )
    reached_at_s: float | None = Field(description="when it is reached with every body; null where it is not")
    longer: dict[str, float] = Field(description="sigma if every stretch lasted so many times as long")
    told: Literal["well", "not by this plan", "by no motion of this vehicle"] = Field(
        description="whether the sigma is below half the natural size and an estimate gives the value, or any motion could make it so"
    )


class StretchItem(Item):
    """One stretch of the timeline."""

    start_s: float
    end_s: float
    motion: str
    teaches: dict[str, float] = Field(description="how many times as large the sigma of each quantity were without this stretch, from 1.02")


class LimitItem(Item):
    """One limit."""

    allowed: float | None = Field(description="null where nothing limits it")
    used: float = Field(description="the most of all bodies and seeds that were flown")
    unit: str


class PlanFile(Item):
    """The whole of plan.json."""

    schema_: Literal["massprop/plan/1"] = Field("massprop/plan/1", alias="schema")
    massprop: str
    vehicle: str
    vehicle_sha256: str
    guess: str
    bodies: int = Field(description="that the vehicle may be, flown one by one")
    criterion: Criterion
    duration_s: float
    max_time_s: float
    reached: bool = Field(description="every precision that is wanted, with every body")
    limited_by: str = Field(description="what keeps it from being reached; empty where it is")
    quantities: dict[str, QuantityItem]
    timeline: list[StretchItem]
    limits: dict[str, LimitItem]
    time_s: list[float] = Field(description="of the course of sigmas")
    course: dict[str, list[float | None]] = Field(
        description="sigma at each time, of the body that is guessed; null before anything is estimated"
    )
    beyond_bound: dict[str, float] = Field(description="factor on the bound of what the vehicle file states beside the IMU's noise")
    notes: list[str]


def document(
    simulated: SimulatedPlan, rehearsal: Rehearsal, vehicle: VehicleSource, criterion: Criterion, max_time_s: float, notes: list[str]
) -> PlanFile:
    """The content of plan.json."""
    period = rehearsal.vehicle.cycle.period_s
    goal, sums = simulated.goal, np.cumsum(simulated.information, 1)
    bound = replace(goal, bound_ratio=np.ones(10), floor=np.zeros(10)).sigmas(sums[:, -1])[0]
    ratios, final = simulated.ratios(), goal.sigmas(sums[:, -1])
    all_motions = sum(one.information.mean(0) for one in simulated.candidates)
    limiting = goal.sigmas(np.tile(all_motions * FOREVER, (len(goal.bodies), 1, 1)))[0]
    sizes = natural_sizes(goal.bodies[0])
    longer = {f"{factor:g}": goal.sigmas(factor * sums[:, -1])[0].tolist() for factor in LONGER}
    quantities = {}
    for i, name in enumerate(QUANTITIES):
        longer_sigmas = {factor: sigmas[i] for factor, sigmas in longer.items()}
        quantities[name] = _quantity(i, goal, ratios, final[:, i], longer_sigmas, period, UNOBSERVABLE * sizes[i], limiting[i])
    ambiguous = _ambiguous_cg(goal.bodies[0], final[0], quantities, rehearsal)
    quantities |= {name: quantities[name].model_copy(update=UNREACHED) for name in ambiguous}
    unreached = [name for name in ambiguous if quantities[name].wanted]
    reached = simulated.reached and not unreached
    why = f"will not converge: {Reason.of('wrench-point-untold')}"
    limited_by = (
        "" if reached else f"{', '.join(unreached)} {why}" if unreached else _limited_by(simulated, quantities, rehearsal, limiting)
    )
    return PlanFile(
        schema="massprop/plan/1",
        massprop=__version__,
        vehicle=vehicle.vehicle.name,
        vehicle_sha256=vehicle.sha256,
        guess=rehearsal.source,
        bodies=len(goal.bodies),
        criterion=criterion,
        duration_s=simulated.duration_s,
        max_time_s=max_time_s,
        reached=reached,
        limited_by=limited_by,
        quantities=quantities,
        timeline=[_timeline_item(part, simulated, final, period) for part in simulated.timeline],
        limits={
            name: LimitItem(allowed=simulated.limits.get(name), used=value, unit=limited.LIMITS[name][1])
            for name, value in simulated.used.items()
        },
        **_course(simulated, sums, sizes, period),
        beyond_bound={name: float(factor) for name, factor in zip(QUANTITIES, final[0] / bound, strict=True) if factor > 1 + ROUNDING},
        notes=[*notes, *([f"{', '.join(ambiguous)} {why}"] if ambiguous else [])],
    )


def _ambiguous_cg(body: Array, sigmas: Array, quantities: dict[str, QuantityItem], rehearsal: Rehearsal) -> list[str]:
    """The CG's names if an estimate cannot decide whether the CG is at O, because the wrench point is unknown; else empty."""
    index = [QUANTITIES.index(name) for name in CG]
    if not rehearsal.wrench_point_unknown or any(quantities[name].told != "well" for name in CG):
        return []
    return [*CG] if near_origin(body[index], sigmas[index], natural_sizes(body)[index[0]]) else []


def _quantity(
    i: int, goal: PlanGoal, ratios: Array, final: Array, longer: dict[str, float], period: float, unobservable: float, limiting: float
) -> QuantityItem:
    """Prediction of quantity ``i``, SI.

    ``ratios`` (K, G, n): predicted over wanted sigma; ``final`` (G,): sigmas at the end; ``longer``: sigma by factor on the duration;
    ``unobservable``: largest sigma of an observable value; ``limiting``: sigma after any duration.
    """
    stated = {item.quantity: (n, item) for n, item in enumerate(goal.requirements)}
    n, item = stated.get(QUANTITIES[i], (0, None))
    precision = item.precision if item is not None else None
    met = np.flatnonzero(ratios[:, :, n].max(1) <= 1) if precision else np.zeros(0, dtype=int)
    return QuantityItem(
        unit=UNITS[QUANTITIES[i]],
        guess=float(goal.bodies[0, i]),
        sigma=float(final[0]),
        worst_sigma=float(final.max()),
        wanted=precision.written if precision else None,
        wanted_sigma=float(goal.limits[0, n]) if precision else None,
        ratio=float(ratios[-1, :, n].max()) if precision else None,
        reached_at_s=float((met[0] + 1) * period) if len(met) else None,
        longer=longer,
        told="well" if final[0] <= unobservable else "by no motion of this vehicle" if limiting > unobservable else "not by this plan",
    )


def _timeline_item(part: TimelineMotion, simulated: SimulatedPlan, final: Array, period: float) -> StretchItem:
    """A motion of the timeline, with the sigmas without it relative to ``final`` (G, 10)."""
    others = np.delete(simulated.information, slice(part.start, part.end), 1).sum(1)
    without = simulated.goal.sigmas(others)[0] / final[0]
    teaches = {name: float(min(factor, 1e6)) for name, factor in zip(QUANTITIES, without, strict=True) if factor >= INFORMS}
    return StretchItem(start_s=round(part.start * period, 9), end_s=round(part.end * period, 9), motion=str(part.motion), teaches=teaches)


def _course(simulated: SimulatedPlan, sums: Array, sizes: Array, period: float) -> dict[str, Any]:
    """Sigmas of the guess against time, from the cumulative information ``sums`` (G, K, n, n); None while unobservable."""
    every = max(simulated.cycles // POINTS, 1)
    chosen = [*list(range(every - 1, simulated.cycles - 1, every)), simulated.cycles - 1]
    sigmas = simulated.goal.sigmas(np.swapaxes(sums[:, chosen], 0, 1))[:, 0]
    course = {
        name: [float(sigma) if sigma <= UNOBSERVABLE * sizes[i] else None for sigma in sigmas[:, i]] for i, name in enumerate(QUANTITIES)
    }
    return {"time_s": [round((k + 1) * period, 9) for k in chosen], "course": course}


def _limited_by(simulated: SimulatedPlan, quantities: dict[str, QuantityItem], rehearsal: Rehearsal, limiting: Array) -> str:
    """One sentence on the quantity with the worst ratio; ``limiting`` (10,) are the sigmas after any duration."""
    name, item = max(((n, q) for n, q in quantities.items() if q.ratio is not None), key=lambda pair: pair[1].ratio or 0.0)
    ratio, i = item.ratio or 0.0, QUANTITIES.index(name)
    duration = simulated.duration_s
    best = f"{name} comes to ± {item.worst_sigma:.3g} {item.unit} in {duration:g} s at worst, {ratio:.3g} times the wanted sigma"
    if item.told == "by no motion of this vehicle":
        return f"no motion of this vehicle makes {name} observable ({', '.join(rehearsal.axes)} can be driven)"
    if limiting[i] > (item.wanted_sigma or 0.0):
        by_thrust = rehearsal.vehicle.thrust.scale_sigma and not rehearsal.by_wheels
        key = "thrust.scale_sigma" if by_thrust else "the information of all motions"
        return f"{best}; {key} keeps it above ± {limiting[i]:.3g} {item.unit} for any duration: weigh the vehicle ([known]) or ask for less"
    return best + (_by_impulse(simulated, ratio) or _by_time(simulated, ratio))


def _by_impulse(simulated: SimulatedPlan, ratio: float) -> str:
    """The impulse that reaches the goal; empty if the impulse limit is not the cause."""
    allowed, unlimited = simulated.limits.get("impulse_n_s"), simulated.any_impulse
    if allowed is None or unlimited is None:
        return ""
    remaining = float(unlimited.ratios()[-1].max())
    if unlimited.used["impulse_n_s"] <= allowed or remaining > IMPULSE_LIMITS * ratio:
        return ""
    longer = max(remaining, 1.0) ** 2
    # two estimates, and the smaller counts: the unlimited plan does not save impulse, and information is proportional to impulse
    needed = min(unlimited.used["impulse_n_s"] * longer / TARGET, allowed * ratio**2)
    reached = f" with {allowed:g} N s; about {needed:.3g} N s"
    if longer == 1.0:
        return f"{reached} would reach it (--max-impulse)"
    return f"{reached} in {unlimited.duration_s * longer:.3g} s would reach it (--max-impulse, --max-time)"


def _by_time(simulated: SimulatedPlan, ratio: float) -> str:
    """The duration that reaches the goal: information is proportional to time."""
    share = {key: simulated.used[key] / limit for key, limit in simulated.limits.items() if key != "impulse_n_s"}
    reduced = any(part.motion.level < 1 for part in simulated.timeline)
    by = f" with the limit on the {limited.LIMITS[max(share, key=lambda key: share[key])][0]}" if share and reduced else ""
    return f"{by}; about {simulated.duration_s * ratio**2:.3g} s would reach it (--max-time)"


def scenario_toml(simulated: SimulatedPlan, rehearsal: Rehearsal, name: str) -> str:
    """The text of scenario.toml: the plan with the guess as the truth, and the vehicle."""
    scenario = rehearsal.scenario(simulated.segments, simulated.cycles, name).scenario
    content = scenario.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    vehicle = {key: value for key, value in content.pop("vehicle").items() if value not in ([], {})}
    return configfile.toml({key: value for key, value in content.items() if value != {}} | {"vehicle": vehicle})
