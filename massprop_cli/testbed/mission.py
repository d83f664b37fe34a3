"""The mission plan: what is demanded about and along each axis in each cycle, and the on-times that serve it."""

from functools import lru_cache

import numpy as np

from massprop_cli.base.arrays import TINY, Array, BoolArray, frozen
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.testbed import exchange
from massprop_cli.testbed.conditions import full_thrust
from massprop_cli.testbed.scenario import Scenario, ScenarioSource
from massprop_cli.testbed.timeline import AXES, TURNS, Segment

MISSED = 1e-6
"""By which rotors may miss a unit of torque or force."""
SERVED = 1e-9
"""Jets with less than this part of the largest on-time are left out."""


@dataclass(frozen=True)
class Plan:
    """Open-loop demand and where the attitude is held. Axes in the order roll pitch yaw x y z."""

    demand: Array
    """(S, K, 6) mean torque [N m] and force [N] that the pulses of the plan ask for in each cycle."""
    held: BoolArray
    """(K, 3) where the attitude controller adds its torque."""
    wheel_demand: Array
    """(S, K, 3) the same torque on the body by what stores momentum."""
    held_by_wheels: BoolArray
    """(K, 3)"""


@dataclass(frozen=True)
class Allocation:
    """How demanded torque and force become commands."""

    on_time_share: Array
    """(6, 2, C) part of full thrust of each command channel for one unit about an axis, + and −; NaN where an axis can't be served."""
    full: Array
    """(6, 2) largest torque [N m] or force [N] in each direction."""
    full_by_wheels: Array
    """(3,) largest torque by what stores momentum, N m."""

    def largest(self, axis: int, by_wheels: bool) -> tuple[float, float]:
        """Torque or force about an axis, + and −."""
        positive, negative = (self.full_by_wheels[axis],) * 2 if by_wheels else self.full[axis]
        return float(positive), float(negative)

    def commands(self, demand: Array) -> Array:
        """(S, …, C) part of the cycle that each channel is on, or of its full value, from (S, …, 6) demand; limited to 1."""
        used = np.nan_to_num(self.on_time_share)
        positive, negative = np.maximum(demand, 0.0), np.maximum(-demand, 0.0)
        share = np.einsum("...a,ac->...c", positive, used[:, 0]) + np.einsum("...a,ac->...c", negative, used[:, 1])
        return np.asarray(np.clip(share, -1.0, 1.0))


def allocation(source: ScenarioSource) -> Allocation:
    """Jets of least on-time for each axis and direction, or one channel per axis for a vehicle without jets.

    :class:`InputError` where the plan drives an axis that the jets can't serve without disturbing the others.
    """
    scenario = source.scenario
    full = None
    if scenario.vehicle.rotors:
        share, full = _by_rotors(source)
    elif scenario.vehicle.jets:
        share = _on_times((scenario.vehicle.jet_wrench * scenario.vehicle.environment.moving).tobytes())
    else:
        limits = np.concatenate([scenario.actuators.max_torque_n_m or (0.0,) * 3, scenario.actuators.max_force_n or (0.0,) * 3])
        unit = np.diag(1 / np.where(limits > 0, limits, np.nan))
        share = np.where(limits[:, None, None] > 0, np.stack([unit, -unit], 1), np.nan)
    if full is None:
        peak = np.abs(share).max(-1)
        full = np.where(np.isnan(peak), 0.0, 1 / np.where(peak > 0, peak, np.nan))
    found = Allocation(share, full, exchange.full(scenario.vehicle, scenario.actuators))
    _check_served(source, found)
    return found


def _by_rotors(source: ScenarioSource) -> tuple[Array, Array]:
    """(6, 2, R) share of full thrust and (6, 2) most of :class:`Allocation`, from hovering; :class:`InputError` where that can't be."""
    vehicle, real = source.scenario.vehicle, source.scenario.actuators
    least, most = full_thrust(vehicle, real)
    wrench = vehicle.rotor_wrench.T * vehicle.environment.moving[:, None]
    newtons = np.linalg.pinv(wrench)  # (R, 6)
    served = np.abs(wrench @ newtons - np.eye(6)).max(0) < MISSED
    force = hovering(source.scenario)
    hover = newtons @ force
    room = np.minimum(hover - least, most - hover)
    if not (served[force != 0].all() and (room > 0).all()):
        raise InputError(
            f"{source.source}: the rotors can't give actuators.hover_force_n without torque about O, each between {least.min():g} and "
            f"{most.max():g} N; correct it, actuators.max_rotor_command, or the rotors"
        )
    share = np.where(served, newtons / most[:, None], np.nan).T
    reach = (room[:, None] / np.maximum(np.abs(newtons), TINY)).min(0)
    return np.stack([share, -share], 1), np.where(served, reach, 0.0)[:, None].repeat(2, 1)


def hovering(scenario: Scenario) -> Array:
    """(6,) torque about O and force that rotors give where the plan asks for nothing."""
    return np.concatenate([np.zeros(3), scenario.actuators.hover_force_n or (0.0,) * 3])


@lru_cache(maxsize=16)
def _on_times(wrench: bytes) -> Array:
    """(6, 2, J) of :func:`_jets_for` of the bytes of a (J, 6) wrench: a plan flies one vehicle many times."""
    jets = np.frombuffer(wrench).reshape(-1, 6)
    return frozen(np.array([[_jets_for(jets, axis, sign) for sign in (1.0, -1.0)] for axis in range(6)]))


def _jets_for(wrench: Array, axis: int, sign: float) -> Array:
    """(J,) on-time parts, all ≥ 0 and of least sum, whose wrench is one unit about ``axis``; NaN if there are none."""
    from scipy.optimize import linprog

    size = np.maximum(np.abs(wrench).max(0), TINY)
    target = np.zeros(6)
    target[axis] = sign
    found = linprog(np.ones(len(wrench)), A_eq=(wrench / size).T, b_eq=target, method="highs-ds")
    if not found.success:
        return np.full(len(wrench), np.nan)
    on_time = np.asarray(found.x)
    chosen = on_time > SERVED * on_time.max()
    exact = np.zeros(len(wrench))
    exact[chosen] = np.linalg.lstsq((wrench / size).T[:, chosen], target, rcond=None)[0] / size[axis]
    return exact


def _check_served(source: ScenarioSource, allocated: Allocation) -> None:
    moving = source.scenario.vehicle.environment.moving
    for number, segment in enumerate(source.scenario.plan, 1):
        if segment.motion == "coast":
            continue
        for name in segment.driven:
            axis = AXES.index(name)
            if segment.motion == "hold" and not moving[axis]:
                continue  # the table holds it
            if 0.0 in allocated.largest(axis, source.scenario.turned_by_wheels(segment)):
                raise InputError(
                    f"{source.source}, plan segment {number}: the vehicle can't drive {name} both ways without disturbing other axes; "
                    "drop the axis from the plan, or add jets or wheels"
                )


def plan(scenario: Scenario, allocated: Allocation, rngs: list[np.random.Generator]) -> Plan:
    """The plan's demand for every seed; ``rngs`` one generator per seed."""
    period, cycles = scenario.vehicle.cycle.period_s, scenario.cycles
    found = Plan(
        *(np.zeros((len(rngs), cycles, 6)) + hovering(scenario), np.zeros((cycles, 3), dtype=bool)),
        *(np.zeros((len(rngs), cycles, 3)), np.zeros((cycles, 3), dtype=bool)),
    )
    for segment in scenario.plan:
        start, end = segment.cycles(period)
        end, by_wheels = min(end, cycles), scenario.turned_by_wheels(segment)
        demand, held = (found.wheel_demand, found.held_by_wheels) if by_wheels else (found.demand, found.held)
        if segment.motion == "hold" or segment.closed_loop:
            held[start:end] |= np.isin(TURNS, segment.driven)
        if segment.motion in ("hold", "coast"):
            continue
        for axis in [AXES.index(name) for name in segment.driven]:
            ways = allocated.largest(axis, by_wheels)
            # of a negative level the first way is the other one
            full = ways if segment.level > 0 else reversed(ways)
            positive, negative = ((segment.torque_n_m or segment.force_n or segment.level * most) for most in full)
            for member, rng in enumerate(rngs):
                pattern = _pattern(segment, end - start, rng)
                demand[member, start:end, axis] += np.where(pattern > 0, positive, negative) * pattern
    return found


def _pattern(segment: Segment, cycles: int, rng: np.random.Generator) -> Array:
    """(cycles,) −1, 0 or +1."""
    if segment.motion == "steady":
        return np.ones(cycles)
    cycle = np.arange(cycles)
    turn = cycle // segment.every_cycles
    if segment.motion == "alternating":
        return 1.0 - 2.0 * (turn % 2)
    draws = int(turn[-1]) + 1
    sign = 2.0 * rng.integers(0, 2, draws) - 1
    length = rng.integers(1, segment.max_cycles + 1, draws)
    return np.where(cycle % segment.every_cycles < length[turn], sign[turn], 0.0)
