"""What ``massprop plan`` hands over: plan.json and the scenario that ``massprop simulate`` flies. The models below are the schema."""

from typing import Any, Literal

import numpy as np
from pydantic import Field

from massprop_cli import CG, QUANTITIES, UNITS, __version__
from massprop_cli.base import configfile
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.judge import near_origin
from massprop_cli.conclude.reason import Reason
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.plan import limits as limited
from massprop_cli.plan.choose import Criterion, PlanGoal
from massprop_cli.plan.planner import ENOUGH, Planned, Stretch
from massprop_cli.plan.rehearsal import Rehearsal
from massprop_cli.result.schema import Item
from massprop_cli.testbed.bound import natural_sizes

UNTOLD = 0.5
"""A sigma above this part of a quantity's natural size says nothing of it, as in the verdicts of an estimate."""
LONGER = (2.0, 4.0)
POINTS = 200
"""Times of the course that is told."""
TEACHES = 1.02
"""A stretch teaches a quantity whose sigma were so many times as large without it."""
FOREVER = 1e6
LESS = 0.95
"""Part of a ratio that a plan with any impulse must come below for the impulse to be what limits: seeds and guesses differ by less."""
UNREACHED = {"told": "not by this plan", "ratio": None, "reached_at_s": None}
"""Of a quantity that an estimate of the plan's own log does not give."""


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
    found: Planned, rehearsal: Rehearsal, vehicle: VehicleSource, criterion: Criterion, max_time_s: float, notes: list[str]
) -> PlanFile:
    """Everything told of a plan."""
    period = rehearsal.vehicle.cycle.period_s
    wanted, sums = found.wanted, np.cumsum(found.information, 1)
    ratios, last = found.ratios(), wanted.sigmas(sums[:, -1])
    every = sum(one.information.mean(0) for one in found.tried)
    ever = wanted.sigmas(np.tile(every * FOREVER, (len(wanted.bodies), 1, 1)))[0]
    sizes = natural_sizes(wanted.bodies[0])
    longer = {f"{factor:g}": wanted.sigmas(factor * sums[:, -1])[0] for factor in LONGER}
    quantities = {
        name: _quantity(
            i, wanted, ratios, last[:, i], {factor: float(sigma[i]) for factor, sigma in longer.items()}, period, UNTOLD * sizes[i], ever[i]
        )
        for i, name in enumerate(QUANTITIES)
    }
    hidden = _hidden(wanted.bodies[0], last[0], quantities, rehearsal)
    quantities |= {name: quantities[name].model_copy(update=UNREACHED) for name in hidden}
    unreached = [name for name in hidden if quantities[name].wanted]
    reached = found.reached and not unreached
    why = f"will not converge: {Reason.of('wrench-point-untold')}"
    return PlanFile(
        schema="massprop/plan/1",
        massprop=__version__,
        vehicle=vehicle.vehicle.name,
        vehicle_sha256=vehicle.sha256,
        guess=rehearsal.source,
        bodies=len(wanted.bodies),
        criterion=criterion,
        duration_s=found.duration_s,
        max_time_s=max_time_s,
        reached=reached,
        limited_by="" if reached else f"{', '.join(unreached)} {why}" if unreached else _limited_by(found, quantities, rehearsal, ever),
        quantities=quantities,
        timeline=[_stretch(stretch, found, last, period) for stretch in found.stretches],
        limits={
            name: LimitItem(allowed=found.limits.get(name), used=value, unit=limited.LIMITS[name][1]) for name, value in found.used.items()
        },
        **_course(found, sums, sizes, period),
        beyond_bound={name: float(factor) for name, factor in zip(QUANTITIES, wanted.beyond, strict=True) if factor > 1},
        notes=[*notes, *([f"{', '.join(hidden)} {why}"] if hidden else [])],
    )


def _hidden(body: Array, sigmas: Array, quantities: dict[str, QuantityItem], rehearsal: Rehearsal) -> list[str]:
    """The CG, where an estimate of the plan's own log will not say whether it is at O."""
    own = [QUANTITIES.index(name) for name in CG]
    told = all(quantities[name].told == "well" for name in CG)
    return [*CG] if rehearsal.point_untold and told and near_origin(body[own], sigmas[own], natural_sizes(body)[own[0]]) else []


def _quantity(
    i: int, wanted: PlanGoal, ratios: Array, last: Array, longer: dict[str, float], period: float, untold: float, ever: float
) -> QuantityItem:
    """``ratios`` (K, bodies, requirements), ``last`` (bodies,) its sigma at the end, ``ever`` after all time; ``untold``: says nothing."""
    stated = {item.quantity: (n, item) for n, item in enumerate(wanted.requirements)}
    n, item = stated.get(QUANTITIES[i], (0, None))
    precision = item.precision if item is not None else None
    met = np.flatnonzero(ratios[:, :, n].max(1) <= 1) if precision else np.zeros(0, dtype=int)
    return QuantityItem(
        unit=UNITS[QUANTITIES[i]],
        guess=float(wanted.bodies[0, i]),
        sigma=float(last[0]),
        worst_sigma=float(last.max()),
        wanted=precision.written if precision else None,
        wanted_sigma=float(wanted.limits[0, n]) if precision else None,
        ratio=float(ratios[-1, :, n].max()) if precision else None,
        reached_at_s=float((met[0] + 1) * period) if len(met) else None,
        longer=longer,
        told="well" if last[0] <= untold else "by no motion of this vehicle" if ever > untold else "not by this plan",
    )


def _stretch(stretch: Stretch, found: Planned, last: Array, period: float) -> StretchItem:
    rest = np.delete(found.information, slice(stretch.start, stretch.end), 1).sum(1)
    without = found.wanted.sigmas(rest)[0] / last[0]
    teaches = {name: float(min(factor, 1e6)) for name, factor in zip(QUANTITIES, without, strict=True) if factor >= TEACHES}
    return StretchItem(
        start_s=round(stretch.start * period, 9), end_s=round(stretch.end * period, 9), motion=str(stretch.motion), teaches=teaches
    )


def _course(found: Planned, sums: Array, sizes: Array, period: float) -> dict[str, Any]:
    every = max(found.cycles // POINTS, 1)
    chosen = [*list(range(every - 1, found.cycles - 1, every)), found.cycles - 1]
    sigmas = found.wanted.sigmas(np.swapaxes(sums[:, chosen], 0, 1))[:, 0]
    course = {name: [float(sigma) if sigma <= UNTOLD * sizes[i] else None for sigma in sigmas[:, i]] for i, name in enumerate(QUANTITIES)}
    return {"time_s": [round((k + 1) * period, 9) for k in chosen], "course": course}


def _limited_by(found: Planned, quantities: dict[str, QuantityItem], rehearsal: Rehearsal, ever: Array) -> str:
    """One sentence on the worst quantity; ``ever`` (10,) are the sigmas after all time."""
    name, item = max(((n, q) for n, q in quantities.items() if q.ratio is not None), key=lambda pair: pair[1].ratio or 0.0)
    ratio, i = item.ratio or 0.0, QUANTITIES.index(name)
    best = f"{name} comes to ± {item.worst_sigma:.3g} {item.unit} in {found.duration_s:g} s at worst, {ratio:.3g} times the wanted sigma"
    if item.told == "by no motion of this vehicle":
        return f"no motion of this vehicle makes {name} observable ({', '.join(rehearsal.axes)} can be driven)"
    if ever[i] > (item.wanted_sigma or 0.0):
        told = rehearsal.vehicle.thrust.scale_sigma and not rehearsal.by_wheels
        key = "thrust.scale_sigma" if told else "the information of all motions"
        return f"{best}; {key} keeps it above ± {ever[i]:.3g} {item.unit} for any duration: weigh the vehicle ([known]) or ask for less"
    return best + (_by_impulse(found, ratio) or _by_time(found, ratio))


def _by_impulse(found: Planned, ratio: float) -> str:
    """What more impulse would reach; empty where the impulse does not limit."""
    allowed, freely = found.limits.get("impulse_n_s"), found.any_impulse
    if allowed is None or freely is None:
        return ""
    remaining = float(freely.ratios()[-1].max())
    if freely.used["impulse_n_s"] <= allowed or remaining > LESS * ratio:
        return ""
    longer = max(remaining, 1.0) ** 2
    # that plan spends freely; information also grows with the impulse of the one at hand
    needed = min(freely.used["impulse_n_s"] * longer / ENOUGH, allowed * ratio**2)
    reached = f" with {allowed:g} N s; about {needed:.3g} N s"
    if longer == 1.0:
        return f"{reached} would reach it (--max-impulse)"
    return f"{reached} in {freely.duration_s * longer:.3g} s would reach it (--max-impulse, --max-time)"


def _by_time(found: Planned, ratio: float) -> str:
    """How long would reach it: information grows with the time."""
    share = {key: found.used[key] / limit for key, limit in found.limits.items() if key != "impulse_n_s"}
    gentle = any(stretch.motion.level < 1 for stretch in found.stretches)
    by = f" with the limit on the {limited.LIMITS[max(share, key=lambda key: share[key])][0]}" if share and gentle else ""
    return f"{by}; about {found.duration_s * ratio**2:.3g} s would reach it (--max-time)"


def scenario_toml(found: Planned, rehearsal: Rehearsal, name: str) -> str:
    """The scenario that ``massprop simulate`` flies: the guess as its truth, the vehicle in it."""
    scenario = rehearsal.scenario(found.segments, found.cycles, name).scenario
    content = scenario.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    vehicle = {key: value for key, value in content.pop("vehicle").items() if value not in ([], {})}
    return configfile.toml({key: value for key, value in content.items() if value != {}} | {"vehicle": vehicle})
