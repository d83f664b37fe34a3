"""What must make no difference to the final values: where the estimator starts from, and what went before the motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.estimate import offline
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Nominal, Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.plant import Reference
from massprop_cli.testbed import scenario, simulate
from tests.flight import resolved

QUIET_CYCLES = 600


def flown(*seeds: int, quiet_s: float = 0.0, moving_s: float = 15.0) -> simulate.SimulatedFlight:
    """Drifting, then motion about and along every axis."""
    end_s = quiet_s + moving_s
    plan = f'plan=[{{motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"], start_s={quiet_s}, end_s={end_s}}}]'
    return simulate.fly(scenario.load("free-flyer", [f"duration_s={end_s}", plan]), seeds)


def without_first(log: Log, cycles: int) -> Log:
    """The log as if it had begun later."""
    cut = slice(cycles * log.records_per_cycle, None)
    return replace(
        log,
        rows=log.rows - cut.start,
        time_s=log.time_s[cut],
        interval_s=log.interval_s[cut],
        delta_theta_imu_rad=log.delta_theta_imu_rad[cut],
        delta_v_imu_m_s=log.delta_v_imu_m_s[cut],
        command=log.command[cycles:],
    )


def examined(log: Log, vehicle: Vehicle) -> flow.Analysis:
    return flow.examine(log, VehicleSource(vehicle, "t", ""))


@cache
def plain() -> tuple[simulate.SimulatedFlight, flow.Analysis]:
    flight = flown(4)
    return flight, examined(flight.log(0), flight.vehicle)


def moved(found: flow.Analysis, other: flow.Analysis) -> Array:
    """By how many sigmas the ten values differ."""
    first, second = found.conclusions[0], other.conclusions[0]
    apart: Array = (second.values - first.values) / np.sqrt(np.diag(first.covariance))
    return apart


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("logs", [pytest.param(6, marks=pytest.mark.thorough)])
def test_an_unexcited_first_half_minute_changes_nothing_but_what_it_tells(logs: int) -> None:
    """Drifting tells the rate at which the motion begins, and by nothing more than that information may the values differ.

    For two estimates of which one has all the other's data and more, the difference has the difference of the covariances (Hausman 1978).
    """
    flight = flown(*range(100, 100 + logs), quiet_s=30.0, moving_s=30.0)
    apart = []
    for member in range(logs):
        log = flight.log(member)
        assert not log.command[:QUIET_CYCLES].any()
        whole, part = examined(log, flight.vehicle), examined(without_first(log, QUIET_CYCLES), flight.vehicle)
        assert {estimate_.verdict for estimate_ in whole.conclusions[0].estimates.values()} == {"converged"}
        more, less = (found.conclusions[0].covariance.diagonal() for found in (whole, part))
        change = part.conclusions[0].values - whole.conclusions[0].values
        assert abs(change[9]) < 0.01 * np.sqrt(more[9])  # the rate tells nothing of the mass
        apart.append(change[:9] / np.sqrt(less[:9] - more[:9]))
    assert (np.sum(np.square(apart), 0) < chi2.ppf(0.999, logs)).all()


@pytest.mark.parametrize("factor", [pytest.param(10.0, marks=pytest.mark.thorough), 1e-6])
def test_nominal_values_far_off_change_nothing(factor: float) -> None:
    flight, found = plain()
    true = flight.truth[0, 0]
    names = ("ixx", "iyy", "izz", "cg_x", "cg_y", "cg_z", "mass")
    far = Nominal(**{name: factor * float(true[i]) for name, i in zip(names, (0, 3, 5, 6, 7, 8, 9), strict=True)})
    stated = flight.vehicle.model_copy(update={"nominal": far})
    assert np.array_equal(moved(found, examined(flight.log(0), stated)), np.zeros(10))


@pytest.mark.parametrize(("inertia", "cg", "mass"), [(10.0, 10.0, 10.0), (10.0, 0.0, 0.1), (0.3, 0.0, 10.0)])
def test_a_reference_far_off_leads_to_the_same_fit(inertia: float, cg: float, mass: float) -> None:
    """Where the linearisation starts is of no consequence: the filter takes its own estimate as the new reference until it stands still."""
    flight, found = plain()
    history, true = found.histories[0], flight.truth[0, 0]
    far = Reference(inertia * tensor(true[:6]), cg * true[6:9], 1 / (mass * true[9]))
    again = offline.fit(found.samples, history.cycles, history.phase, far, resolved(found.vehicle)).history
    assert np.abs((again.values[-1] - history.values[-1]) / history.sigmas[-1]).max() < 0.1


def test_when_a_clock_began_to_count_makes_no_difference() -> None:
    """Of a computer's clock, which counts from 1970, numbers are 2.4e-7 s apart."""
    flight, found = plain()
    log = flight.log(0)
    end = log.time_s + 1.7e9
    other = replace(log, time_s=end, interval_s=np.diff(end, prepend=end[0] - log.interval_s[0]))
    assert np.abs(moved(found, examined(other, flight.vehicle))).max() < 0.3


@pytest.mark.parametrize("delay", [1.9999999, 2.0, 2.0000009, 2.000001, 2.0000011, 2.000002])
def test_a_delay_at_the_edge_of_a_cycle_leaves_every_cycle_an_estimate(delay: float) -> None:
    """Which is the first cycle whose command is known is asked twice, of sums that round differently."""
    flight, _ = plain()
    vehicle = flight.vehicle.model_copy(update={"cycle": flight.vehicle.cycle.model_copy(update={"command_delay_cycles": delay})})
    log = flight.log(0)
    for offset in (0.0, 1e4, 1e7):
        found = examined(replace(log, time_s=log.time_s + offset), vehicle)
        assert len(found.histories[0].values) in (log.cycles - 2, log.cycles - 3)
