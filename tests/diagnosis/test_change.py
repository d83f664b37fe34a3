"""The most likely moment of a sudden change, and what stretches of a log say together, against the whole log and the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.base.arrays import Array, frozen
from massprop_cli.base.levels import ENOUGH
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis import change
from massprop_cli.estimate.triangle import Triangle
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.responsemap import ResponseMap
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.timing import Timing
from tests import faulty, flight
from tests.flight import resolved
from tests.flown import fly
from tests.model.test_linearise import reference


def docked(log: Log, used: Vehicle, true: Array) -> tuple[Samples, Vehicle, Reference, int]:
    """A log over a docking as if it were one phase, a reference of neither body, and the cycle at which it happens."""
    samples = Timing(float(used.cycle.command_delay_cycles), 0.0).of(log, used)
    about = Reference(1.5 * tensor(true[:6]), true[6:9] + 0.01, 0.8 / true[9])
    at = int(np.searchsorted(samples.executed.start_s, used.phases[0].end_s - 1e-6))
    return samples, used, about, at


def stretch(samples: Samples, cycles: slice, about: Reference, used: Vehicle) -> Array:
    """What a stretch says of φ, reduced by itself."""
    alone = Triangle(samples, cycles, resolved(used), Consider())
    return alone.segment_triangle(alone.begin(about), alone.phase_system(about), cycles)


def test_the_docking_of_the_sample_is_where_the_change_is_found() -> None:
    samples, used, about, at = docked(*faulty.sample("docking"), faulty.truth("docking"))
    found = change.change_cycle(samples, slice(2, len(samples)), about, resolved(used))
    assert found is not None
    assert abs(found - at) <= 3


@pytest.mark.seeds
@pytest.mark.thorough
def test_the_docking_is_where_the_change_is_found() -> None:
    flown = fly("docking", seeds=tuple(range(1, 11)))
    for member in range(3):
        samples, used, about, at = docked(flown.log(member), flown.vehicle, flown.truth[member, 0])
        found = change.change_cycle(samples, slice(2, len(samples)), about, resolved(used))
        assert found is not None
        assert abs(found - at) <= 3


@pytest.mark.thorough
def test_a_docking_before_the_busiest_cycles_of_a_long_log_is_named() -> None:
    """Little is commanded before it, and more cycles after it than hypotheses are tried on."""
    motion = 'motion="random", axes=["roll", "pitch", "yaw", "x", "y", "z"]'
    before = f"{{{motion}, every_cycles=8, max_cycles=2, start_cycle=0, end_cycle=500}}"
    after = f"{{{motion}, every_cycles=5, max_cycles=4, start_cycle=520, end_cycle=1900}}"
    docks = "docked={ixx=0.2, iyy=0.3, izz=0.3, mass=4.0, cg_x=0.4, cg_y=0.1}", 'events=[{kind="dock", cycle=500}]'
    one_phase = 'vehicle.phases=[{name="all", start_s=0.0, end_s=95.0}]'
    flown = fly("free-flyer", "duration_s=95.0", f"plan=[{before}, {after}]", *docks, one_phase)
    (said,) = [notice.message for notice in faulty.examined(flown.log(0), flown.vehicle).notices if notice.code == "mass-change"]
    assert abs(float(said.split("suddenly at ")[1].split(" s")[0]) - 500 * 0.05) <= 0.1


def test_where_the_cg_alone_changes_and_nothing_pushes_it_may_be_another_imu() -> None:
    """The spare IMU, 0.3 m from the first, records from half time on: no thrust tells that the CG stays."""
    turns = 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=40}]', "duration_s=40"
    near = np.array(fly("wheels", *turns).vehicle.imu.position_m)
    first, spare = (
        fly("wheels", *turns, f"vehicle.imu.position_m={(near + by).tolist()}") for by in (np.zeros(3), np.array([0, 0.24, 0.18]))
    )
    log = first.log(0)
    half = len(log.time_s) // 2
    other = replace(log, delta_v_imu_m_s=frozen(np.vstack([log.delta_v_imu_m_s[:half], spare.log(0).delta_v_imu_m_s[half:]])))
    analysis = faulty.examined(other, first.vehicle)
    (said,) = [notice.message for notice in analysis.notices if notice.code == "mass-change"]
    assert "another IMU" in said
    assert abs(float(said.split("suddenly at ")[1].split(" s")[0]) - 20) < 0.2
    assert not analysis.mended


def test_nothing_is_said_of_a_stretch_too_short_to_have_two_sides() -> None:
    samples, used, about, _ = docked(*faulty.sample("docking"), faulty.truth("docking"))
    assert change.change_cycle(samples, slice(2, 2 + 4 * ENOUGH - 1), about, resolved(used)) is None


def test_the_body_that_fits_a_triangle_is_the_one_that_flew() -> None:
    """Chi-square of the best body is what the noise leaves, and a tenth more inertia fits far worse."""
    flown = flight.standard("free", 320)
    samples, used = flown.samples(np.random.default_rng(3)), flown.used
    phi_map = ResponseMap(plant_of(used))
    about = reference(flight.TRUTH)
    triangle = stretch(samples, slice(2, 320), about, used)
    (left,) = change.least_chi_squares(triangle[None], about, resolved(used))
    rows = 6 * 318
    assert left == pytest.approx(rows - 19, abs=4 * np.sqrt(2 * rows))
    other = Reference(1.1 * about.inertia, about.cg, about.mu)
    heavier = phi_map.plant.theta(other)
    by_phi, measured = triangle[:, :-1], triangle[:, -1]
    assert ((measured - by_phi @ phi_map.coefficients(heavier)[0]) ** 2).sum() > 100 * left
    assert change.least_chi_squares(triangle[None], other, resolved(used)) == pytest.approx(left, rel=1e-3)


def test_two_stretches_say_together_what_their_rows_say() -> None:
    flown = flight.standard("free", 320)
    samples, used, about = flown.samples(np.random.default_rng(4)), flown.used, reference(flight.TRUTH)
    one, other = (stretch(samples, piece, about, used) for piece in (slice(2, 160), slice(160, 320)))
    both = change.joined(one, other)
    np.testing.assert_allclose(both.T @ both, one.T @ one + other.T @ other, rtol=1e-9, atol=1e-9 * np.abs(both.T @ both).max())


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_a_stretch_of_a_longer_log_says_what_it_says_by_itself(kind: str) -> None:
    flown = flight.standard(kind, 320)
    samples, used, about = flown.samples(np.random.default_rng(6)), flown.used, reference(flight.TRUTH)
    longer = Triangle(samples, slice(2, 320), resolved(used), Consider())
    begun, whole = longer.begin(about), longer.phase_system(about)
    for cycles in (slice(2, 60), slice(60, 200), slice(200, 320)):
        found, alone = longer.segment_triangle(begun, whole, cycles), stretch(samples, cycles, about, used)
        np.testing.assert_allclose(found.T @ found, alone.T @ alone, rtol=1e-9, atol=1e-9 * np.abs(alone.T @ alone).max())
