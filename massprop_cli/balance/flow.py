"""A result's first moment, the changes that make it what is wanted, and a later result tested against them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from massprop_cli import ABOUT_PIVOT
from massprop_cli.balance import document, solve, stated
from massprop_cli.balance.document import G_CM, hang, moment
from massprop_cli.balance.solve import Hanging, MovedMoments
from massprop_cli.base.arrays import Array
from massprop_cli.base.chance import chance
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import tensor
from massprop_cli.inputs.ballast import Ballast
from massprop_cli.result.judge import INFORMED
from massprop_cli.result.read import Recorded, check_same
from massprop_cli.result.schema import PhaseItem

PERIOD_S = 60.0
"""The slower swing of a table that is left to massprop."""
SURE = 4.0
"""Sigmas by which it then hangs below its pivot at least."""
REACHED = 1e-6
"""Part of what is to be changed that is rounding."""
CHANCE = 1e-3
"""Chance of as much difference, below which what moved is not what was predicted."""


def balance(
    recorded: Recorded, ballast: Sequence[Ballast], leave: str | None, phase: str | None, after: Recorded | None, moved: Sequence[str]
) -> document.Balance:
    """What to do next; with ``after`` the check of what was done. :class:`InputError` where the results can't tell."""
    item = chosen(recorded, phase)
    before = _hanging(recorded, item, ballast)
    wanted = stated.leave(leave, before.gravity)
    check, now, later = None, before, item
    if after is not None:
        _check_alike(recorded, after)
        later = chosen(after, phase)
        done = np.array(stated.moved(moved, ballast)) if moved else _solved(before, ballast, wanted)[0]
        scale = recorded.result.vehicle.thrust_scale_sigma
        try:
            found = solve.compared(before, _hanging(after, later, ballast), ballast, done, scale)
        except np.linalg.LinAlgError:
            said = "masses, travels and sigmas do not match the first moment by orders of magnitude; check their units"
            raise InputError(f"{after.path}: {said}", "ballast") from None
        check, now = _check(found, ballast, done, bool(moved), before.gravity), found.hanging
        ballast = [_since(one, by) for one, by in zip(ballast, done.tolist(), strict=True)]
    return document.Balance(
        result=_source(recorded, item),
        after=_source(after, later) if after else None,
        vehicle=recorded.result.vehicle.name,
        gravity_m_s2=before.gravity,
        pivot_m=before.pivot.tolist(),
        now=hang(now),
        plan=_plan(now, ballast, wanted),
        check=check,
    )


def contradicted(recorded: Recorded, phase: str | None) -> str:
    """Why the first moment of a result isn't to be used; empty where it is."""
    items = chosen(recorded, phase).about_pivot
    name = next((name for name in ABOUT_PIVOT if items[name].verdict == "contradicted"), "")
    return f"{recorded.path}: {name} is contradicted: {items[name].reason}" if name else ""


def chosen(recorded: Recorded, phase: str | None) -> PhaseItem:
    """The phase of that name, or the only one; :class:`InputError` where it has no first moment about a pivot, and how to get one."""
    phases = {one.name: one for one in recorded.result.phases}
    has = ", ".join(phases)
    if phase is None and len(phases) > 1:
        raise InputError(f"{recorded.path}: has phases {has}; name one with --phase")
    if phase is not None and phase not in phases:
        raise InputError(f"{recorded.path}: has no phase {phase!r}; it has {has}. Name one of these with --phase")
    item = phases[phase or has]
    if not item.about_pivot or recorded.result.vehicle.environment != "pedestal":
        kind = recorded.result.vehicle.environment
        why = "is a joint result, which has none" if recorded.joint else f'its log is of environment.kind = "{kind}"'
        raise InputError(
            f"{recorded.path}: has no about_pivot of a fixed pedestal: {why}. Estimate a log of a table on a fixed pedestal "
            '(environment.kind = "pedestal", bearing_position_m) that is turned by wheels, jets or control moment gyros'
        )
    if item.about_pivot_covariance is None or None in (recorded.result.vehicle.gravity_m_s2, recorded.result.vehicle.initial_up):
        raise InputError(f"{recorded.path}: has no about_pivot_covariance: it was written by an earlier version; make it again")
    if tuple(item.about_pivot) != ABOUT_PIVOT:
        raise InputError(f"{recorded.path}: about_pivot holds {', '.join(item.about_pivot)}, not {', '.join(ABOUT_PIVOT)}; make it again")
    for name, one in item.about_pivot.items():
        if one.value is None or one.verdict not in (*INFORMED, "contradicted"):
            raise InputError(f"{recorded.path}: {name} is {one.verdict}: {one.reason}. Record a log that informs it, and estimate that log")
    return item


def _hanging(recorded: Recorded, item: PhaseItem, ballast: Sequence[Ballast]) -> Hanging:
    vehicle = recorded.result.vehicle
    values = np.array([item.about_pivot[name].value for name in ABOUT_PIVOT], dtype=float)
    masses = np.array([one.mass_kg or 0.0 for one in ballast])
    covariance = np.zeros((3 + len(ballast),) * 2)
    covariance[:3, :3] = np.array(item.about_pivot_covariance, dtype=float)[6:, 6:]
    covariance[range(3, 3 + len(ballast)), range(3, 3 + len(ballast))] = [one.slides * one.mass_sigma_kg**2 for one in ballast]
    up = np.array(vehicle.initial_up, dtype=float)
    upright = np.where(np.arange(3) == np.abs(up).argmax(), np.sign(up), 0.0)
    gravity, pivot = float(vehicle.gravity_m_s2 or 0.0), np.array(vehicle.bearing_position_m)
    told = np.isfinite(covariance).all() and bool(np.linalg.eigvalsh(covariance[:3, :3])[0] > 0)
    if not (told and np.linalg.eigvalsh(tensor(values[:6]))[0] > 0 and gravity > 0):
        raise InputError(
            f"{recorded.path}: about_pivot or its covariance is not of a real body: the file was edited, or its log gives too little "
            "information; estimate again"
        )
    return Hanging(values[6:], tensor(values[:6]), masses, covariance, pivot, gravity, upright)


def _check_alike(before: Recorded, after: Recorded) -> None:
    old, new = before.result, after.result
    if old.provenance.input_sha256 == new.provenance.input_sha256:
        raise InputError(f"{after.path}: is of the same log as {before.path}; name the result of a log recorded after the moves", "after")
    what = ("vehicle", "environment.bearing_position_m", "environment.gravity_m_s2", "thrust.scale_sigma")
    so = "their first moments cannot be compared. Estimate both logs with the same vehicle file"
    check_same(after.path, new, str(before.path), old, what, so)


def _since(one: Ballast, by: float) -> Ballast:
    """The ballast after it was changed."""
    if one.slides:
        return one.model_copy(update={"at_m": one.at_m + by})
    return one.model_copy(update={"max_mass_kg": max((one.max_mass_kg or 0.0) - by, 0.0)})


def _down(hanging: Hanging) -> tuple[int, float]:
    axis = int(np.abs(hanging.up).argmax())
    return axis, -float(hanging.up[axis])


def _solved(hanging: Hanging, ballast: Sequence[Ballast], wanted: Mapping[int, float]) -> tuple[Array, Array]:
    """(n,) changes, and the (3,) remainder that is asked for: by default level, and below the pivot by what is stable and slow."""
    axis, down = _down(hanging)
    aim = np.array([wanted.get(n, 0.0) for n in range(3)])
    weight = np.where((np.arange(3) == axis) & (axis not in wanted), 1.0, solve.LEVEL)
    matrix, room = solve.effects(hanging, ballast), np.array([one.room for one in ballast]).reshape(-1, 2)
    cost = np.array([1.0 if one.slides else solve.ADDING for one in ballast])
    change: Array = np.zeros(len(ballast))
    sigma = float(np.sqrt(hanging.covariance[axis, axis]))
    for _ in range(3):
        if axis not in wanted:
            aim[axis] = down * max(solve.below_for(hanging, PERIOD_S), SURE * sigma)
        change = solve.changes(matrix, room, aim - hanging.moment, weight, cost)
        left = solve.moved(hanging, ballast, change)
        if axis in wanted or SURE * np.sqrt(left.covariance[axis, axis]) <= abs(aim[axis]):
            break
        sigma = float(np.sqrt(left.covariance[axis, axis]))
    return change, aim


def _plan(hanging: Hanging, ballast: Sequence[Ballast], wanted: Mapping[int, float]) -> document.BallastPlan:
    change, aim = _solved(hanging, ballast, wanted)
    left = solve.moved(hanging, ballast, change)
    if np.linalg.eigvalsh(left.inertia)[0] <= 0:
        heavy = ", ".join(one.name for one, by in zip(ballast, change, strict=True) if by)
        raise InputError(f"moving {heavy} gives an inertia that no real body has: check its mass_kg, and its position_m from O", "ballast")
    axis, down = _down(hanging)
    allowed = REACHED * max(np.abs(aim - hanging.moment).max(), np.abs(hanging.moment).max())
    off = np.abs(left.moment - aim) > allowed
    free = axis not in wanted
    below, sigma = down * left.moment[axis], float(np.sqrt(left.covariance[axis, axis]))
    stable = not free or below >= SURE * sigma * (1 - REACHED)
    missed = [n for n in range(3) if off[n] and not (free and n == axis)]
    changes = [_change(hanging, ballast, n, by) for n, by in enumerate(change.tolist())]
    said = [f"{'xyz'[n]} stays {G_CM * (left.moment - aim)[n]:+.4g} g cm from the wanted value" for n in missed]
    said += [] if stable else [f"the CG is not certainly below the pivot ({G_CM * below:.4g} ± {G_CM * sigma:.2g} g cm)"]
    limits = [one.name for one in changes if one.at_limit]
    said += [f"at their limits: {', '.join(limits)}" if limits else "no ballast acts in that direction"] if said else []
    note = f"level, and {'xyz'[axis]} such that the longer swing period is {PERIOD_S:g} s, or at least {SURE:g} sigma below the pivot"
    if free and off[axis] and stable:
        note += "; the ballasts reach no nearer"
    default = [name for n, name in enumerate(("x", "y", "z")) if n not in wanted]
    return document.BallastPlan(
        wanted=document.WantedMoment(kg_m=aim.tolist(), g_cm=(G_CM * aim).tolist(), default=default, note=note if free else ""),
        changes=changes,
        remainder=hang(left),
        reached=not missed and stable,
        note="; ".join(said),
    )


def _change(hanging: Hanging, ballast: Sequence[Ballast], n: int, by: float) -> document.BallastChange:
    one, arm = ballast[n], np.array(ballast[n].position_m) - hanging.pivot
    low, high = one.room
    slack = REACHED * (high - low)
    spread = solve.placing(one, arm, float(hanging.masses[n]) if one.slides else by, by)
    if one.slides:
        spread = spread + by**2 * hanging.covariance[3 + n, 3 + n] * np.outer(one.direction, one.direction)
    return document.BallastChange(
        name=one.name,
        what="move" if one.slides else "add",
        by_mm=1000 * by if one.slides else None,
        to_mm=1000 * (one.at_m + by) if one.slides else None,
        add_kg=None if one.slides else by,
        moment=moment(solve.effects(hanging, ballast)[:, n] * by, spread, hanging.gravity),
        at_limit=by != 0 and (by <= low + slack or by >= high - slack),
    )


def _check(found: MovedMoments, ballast: Sequence[Ballast], change: Array, given: bool, gravity: float) -> document.MoveCheck:
    difference, none = found.measured - found.predicted, np.zeros((3, 3))
    p = chance(found.chi_square, 3)
    done = [(n, one, float(change[n])) for n, one in enumerate(ballast) if change[n]]
    return document.MoveCheck(
        moved=[
            document.Moved(name=one.name, by_mm=1000 * by if one.slides else None, add_kg=None if one.slides else by) for _, one, by in done
        ],
        source="stated" if given else "recommended",
        predicted=moment(found.predicted, none, gravity),
        measured=moment(found.measured, none, gravity),
        difference=moment(difference, found.covariance, gravity),
        sigmas=(difference / np.sqrt(np.diag(found.covariance))).tolist(),
        chi_square=found.chi_square,
        p=p,
        as_predicted=p >= CHANCE,
        masses=[
            document.RefinedMass(
                name=one.name,
                stated_kg=one.mass_kg if one.mass_kg is not None else by,
                stated_sigma_kg=one.mass_sigma_kg,
                refined_kg=float(found.masses[n]),
                refined_sigma_kg=float(found.sigmas[n]),
            )
            for n, one, by in done
        ],
        thrust_scale=found.scale[0],
        thrust_scale_sigma=found.scale[1],
    )


def failure(found: document.Balance) -> str:
    """Why the exit code is 5; empty where it is 0."""
    check = found.check
    said = [f"cannot be reached: {found.plan.note}"] if not found.plan.reached else []
    if check is not None and not check.as_predicted:
        off = ", ".join(f"{axis} {sigmas:+.2f}" for axis, sigmas in zip("xyz", check.sigmas, strict=True))
        said.insert(
            0, f"the first moment did not change as predicted: {off} sigma, chi-square {check.chi_square:.4g} of 3, p = {check.p:.2g}"
        )
    return ". ".join(said)


def _source(recorded: Recorded, item: PhaseItem) -> document.BalanceSource:
    made = recorded.result.provenance
    path = f"{recorded.name}/{Path(recorded.path).name}"
    return document.BalanceSource(path=path, phase=item.name, input_sha256=made.input_sha256, vehicle_sha256=made.vehicle_sha256)
