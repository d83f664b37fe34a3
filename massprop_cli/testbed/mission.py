"""Mission plan: demanded torque and force in each cycle, and their allocation to actuator commands."""

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
"""Largest error of a unit torque or force that rotors count as able to give."""
SERVED = 1e-9
"""Jets below this fraction of the largest on-time are removed from an allocation."""


@dataclass(frozen=True)
class Plan:
    """Open-loop demand and attitude hold in each cycle. Axes in the order roll pitch yaw x y z."""

    demand: Array
    """(S, K, 6) mean torque [N m] and force [N] demanded of the actuators."""
    held: BoolArray
    """(K, 3) True where the attitude controller adds its torque by actuators."""
    wheel_demand: Array
    """(S, K, 3) torque on the body demanded of momentum devices, N m."""
    held_by_wheels: BoolArray
    """(K, 3) True where the attitude controller adds its torque by momentum devices."""


@dataclass(frozen=True)
class Allocation:
    """Allocation of demanded torque and force to commands."""

    on_time_share: Array
    """(6, 2, C) fraction of full thrust of each channel per N m or N, + and −; NaN for an axis that cannot be driven alone."""
    full: Array
    """(6, 2) largest torque [N m] or force [N], + and −."""
    full_by_wheels: Array
    """(3,) largest torque by momentum devices, N m."""

    def largest(self, axis: int, by_wheels: bool) -> tuple[float, float]:
        """Largest torque or force of an axis, + and −, N m or N."""
        positive, negative = (self.full_by_wheels[axis],) * 2 if by_wheels else self.full[axis]
        return float(positive), float(negative)

    def commands(self, demand: Array) -> Array:
        """(S, …, C) fraction of the cycle or of the full value of each channel, limited to ±1, for a demand (S, …, 6)."""
        used = np.nan_to_num(self.on_time_share)
        positive, negative = np.maximum(demand, 0.0), np.maximum(-demand, 0.0)
        share = np.einsum("...a,ac->...c", positive, used[:, 0]) + np.einsum("...a,ac->...c", negative, used[:, 1])
        return np.asarray(np.clip(share, -1.0, 1.0))


def allocation(source: ScenarioSource) -> Allocation:
    """Allocation with the smallest total on-time of jets for each axis and direction; one channel per axis without jets.

    Raises :class:`InputError` if the plan drives an axis that cannot be driven without disturbing the others.
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
    allocated = Allocation(share, full, exchange.full(scenario.vehicle, scenario.actuators))
    _check_served(source, allocated)
    return allocated


def _by_rotors(source: ScenarioSource) -> tuple[Array, Array]:
    """Fields ``on_time_share`` (6, 2, R) and ``full`` (6, 2) of :class:`Allocation` about hover.

    Raises :class:`InputError` if the rotors cannot hover.
    """
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
            f"{source.source}: the rotors cannot give actuators.hover_force_n without torque about O, each between {least.min():g} and "
            f"{most.max():g} N; correct it, actuators.max_rotor_command, or the rotors"
        )
    share = np.where(served, newtons / most[:, None], np.nan).T
    reach = (room[:, None] / np.maximum(np.abs(newtons), TINY)).min(0)
    return np.stack([share, -share], 1), np.where(served, reach, 0.0)[:, None].repeat(2, 1)


def hovering(scenario: Scenario) -> Array:
    """(6,) torque about O and force of the rotors without demand, N m and N."""
    return np.concatenate([np.zeros(3), scenario.actuators.hover_force_n or (0.0,) * 3])


@lru_cache(maxsize=16)
def _on_times(wrench: bytes) -> Array:
    """(6, 2, J) on-times of :func:`_jets_for` for the bytes of a (J, 6) wrench; cached, because a planner flies one vehicle many times."""
    jets = np.frombuffer(wrench).reshape(-1, 6)
    return frozen(np.array([[_jets_for(jets, axis, sign) for sign in (1.0, -1.0)] for axis in range(6)]))


def _jets_for(wrench: Array, axis: int, sign: float) -> Array:
    """(J,) on-time fractions ≥ 0 with the smallest sum that give a unit wrench about ``axis``; NaN if there are none."""
    from scipy.optimize import linprog

    size = np.maximum(np.abs(wrench).max(0), TINY)
    target = np.zeros(6)
    target[axis] = sign
    solution = linprog(np.ones(len(wrench)), A_eq=(wrench / size).T, b_eq=target, method="highs-ds")
    if not solution.success:
        return np.full(len(wrench), np.nan)
    on_time = np.asarray(solution.x)
    chosen = on_time > SERVED * on_time.max()
    exact = np.zeros(len(wrench))
    exact[chosen] = np.linalg.lstsq((wrench / size).T[:, chosen], target, rcond=None)[0] / size[axis]
    return exact


def _check_served(source: ScenarioSource, allocated: Allocation) -> None:
    """Raise :class:`InputError` if the plan drives an axis that the vehicle cannot drive alone, both ways."""
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
                    f"{source.source}, plan segment {number}: the vehicle cannot drive {name} in both directions without disturbing other "
                    "axes; drop the axis from the plan, or add jets or wheels"
                )


def plan(scenario: Scenario, allocated: Allocation, rngs: list[np.random.Generator]) -> Plan:
    """Plan of every seed; ``rngs`` has one generator per seed."""
    period, cycles = scenario.vehicle.cycle.period_s, scenario.cycles
    planned = Plan(
        *(np.zeros((len(rngs), cycles, 6)) + hovering(scenario), np.zeros((cycles, 3), dtype=bool)),
        *(np.zeros((len(rngs), cycles, 3)), np.zeros((cycles, 3), dtype=bool)),
    )
    for segment in scenario.plan:
        start, end = segment.cycles(period)
        end, by_wheels = min(end, cycles), scenario.turned_by_wheels(segment)
        demand, held = (planned.wheel_demand, planned.held_by_wheels) if by_wheels else (planned.demand, planned.held)
        if segment.motion == "hold" or segment.closed_loop:
            held[start:end] |= np.isin(TURNS, segment.driven)
        if segment.motion in ("hold", "coast"):
            continue
        for axis in [AXES.index(name) for name in segment.driven]:
            both_ways = allocated.largest(axis, by_wheels)
            # a negative level starts in the negative direction
            full = both_ways if segment.level > 0 else reversed(both_ways)
            positive, negative = ((segment.torque_n_m or segment.force_n or segment.level * most) for most in full)
            for member, rng in enumerate(rngs):
                pattern = _pattern(segment, end - start, rng)
                demand[member, start:end, axis] += np.where(pattern > 0, positive, negative) * pattern
    return planned


def _pattern(segment: Segment, cycles: int, rng: np.random.Generator) -> Array:
    """(cycles,) sign of the demand: −1, 0 or +1."""
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
