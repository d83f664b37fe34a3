"""Multicopters in mid-flight, flown by a simulator that shares no code with the estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.analysis import Analysis
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate import compiled, engine
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.kernel import Kernel, kernel
from massprop_cli.model import kernelargs, regressors
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.stream import Stream
from massprop_cli.testbed import bound, scenario, simulate
from tests import anypedestal, anyrotors, cramerrao, faulty
from tests.testbed.test_rotors import rotors


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.numerical
def test_every_quantity_converges_within_its_sigma() -> None:
    """Four that turn by up to 0.2 rad a cycle: of 40 values one rms in a thousand is beyond 1.4 or below 0.65."""
    rng = np.random.default_rng(7)
    own = anyrotors.multicopters(rng, 4)
    flown = anyrotors.fly(rng, own, 0.0125, 1000)
    z = []
    for body in range(4):
        used = anyrotors.vehicle_of(own, body, flown)
        found = flow.examine(anypedestal.log_of(rng, own, body, flown, used), VehicleSource(used, "", ""))
        (conclusion,) = found.conclusions
        assert not found.notices
        assert {one.verdict for one in conclusion.estimates.values()} == {"converged"}
        z.append((conclusion.values - own.ten[body]) / conclusion.sigmas)
    assert 0.65 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.numerical
@pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
def test_the_compiled_kernel_says_the_same() -> None:
    rng = np.random.default_rng(7)
    own = anyrotors.multicopters(rng, 1)
    flown = anyrotors.fly(rng, own, 0.0125, 400)
    vehicle = Resolved.stated(anyrotors.vehicle_of(own, 0, flown))
    assert vehicle is not None
    log = anypedestal.log_of(rng, own, 0, flown, vehicle)
    samples, cycles, phase = Stream.of(log, vehicle, stated_timing(vehicle)), slice(20, 400), Phase(name="all", start_s=0.0, end_s=1.0)
    assert compiled.supports(samples, vehicle, Consider())
    by_kernel = engine.replay(samples, cycles, phase, vehicle)
    with pytest.MonkeyPatch.context() as numpy_alone:
        for module in (compiled, regressors):
            numpy_alone.setattr(module, "kernel", lambda: Kernel(None, "numpy"))
        assert not compiled.supports(samples, vehicle, Consider())
        by_numpy = engine.replay(samples, cycles, phase, vehicle)
    assert np.isfinite(by_kernel.values[-1]).all()
    assert np.nanmax(np.abs(by_kernel.values - by_numpy.values) / by_numpy.sigmas) < 1e-6


def analysed(seed: int, period_s: float, seldom: int = 1, held: bool = False, measured: bool = True) -> tuple[Analysis, Array]:
    """One of them with its delay left to the log, and errors over sigmas; speeds are logged in one cycle of ``seldom``."""
    rng = np.random.default_rng(seed)
    own = anyrotors.multicopters(rng, 1 if measured else 2)
    flown = anyrotors.fly(rng, own, period_s, 1000, measured)
    since = (np.arange(1000) - 1) % seldom
    speeds = flown.issued[:, np.maximum(np.arange(1000) - since, 0)]
    flown = replace(flown, issued=speeds if held else np.where((since == 0)[None, :, None], speeds, np.nan))
    used = anyrotors.vehicle_of(own, 0, flown)
    source = VehicleSource(changed(used, ['cycle.command_delay_cycles="auto"']), "", "")
    found = flow.examine(anypedestal.log_of(rng, own, 0, flown, used), source)
    (conclusion,) = found.conclusions
    return found, (conclusion.values - own.ten[0]) / conclusion.sigmas


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("seed", [3, pytest.param(5, marks=pytest.mark.thorough)])
def test_measured_speeds_need_no_delay_and_converge(seed: int) -> None:
    found, z = analysed(seed, 0.005)
    assert not found.notices
    assert {one.verdict for one in found.conclusions[0].estimates.values()} == {"converged"}
    assert np.abs(z).max() < 3.5


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(("seed", "held"), [pytest.param(6, True, marks=pytest.mark.thorough), (7, False)], ids=["held", "empty between"])
def test_speeds_logged_in_one_cycle_of_four_give_values_within_their_sigmas(seed: int, held: bool) -> None:
    """50 Hz beside an IMU of 200 Hz: what rotors do in between widens the sigmas, and no cause is named."""
    found, z = analysed(seed, 0.005, 4, held)
    assert not {notice.code for notice in found.notices} - {"model-discrepancy"}
    assert np.abs(z).max() < 3.5
    assert np.median(found.conclusions[0].sigmas[:1] / found.conclusions[0].values[:1]) < 0.05


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.numerical
def test_a_delay_is_found_where_the_first_fit_runs_away() -> None:
    found, z = analysed(1, 0.0125, measured=False)
    assert not found.notices
    assert found.detected is not None
    assert found.detected.at.delay == pytest.approx(1.0, abs=4 * found.detected.sigma.delay)
    assert np.abs(z).max() < 3.5


@pytest.mark.numerical
@pytest.mark.parametrize(
    ("settings", "seeds"),
    [
        pytest.param((), 2, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param((), 20, marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param(
            (*(f"vehicle.rotors.{i}.nominal_v=12.0" for i in range(4)), "actuators.supply_v=[12.6, 10.5]"),
            6,
            marks=[pytest.mark.thorough, pytest.mark.seeds],
        ),
    ],
    ids=["two", "twenty", "sagging supply"],
)
def test_a_simulated_multicopter_is_estimated_within_its_sigmas(settings: tuple[str, ...], seeds: int) -> None:
    """Errors over sigmas of 10 values a log are 1 rms within four standard errors, as if three in ten were independent; no warning.

    The same log without noise gives the truth to 0.1 sigma. Sigmas are those of the Cramér-Rao bound, or up to a tenth above.
    """
    source = scenario.load("multicopter", settings)
    flight = simulate.fly(source, range(1, seeds + 1))
    z, converged = [], 0
    for member in range(seeds):
        found = faulty.examined(flight.log(member), flight.vehicle)
        (conclusion,) = found.conclusions
        assert not found.notices
        converged += sum(one.verdict == "converged" for one in conclusion.estimates.values())
        z.append((conclusion.values - flight.truth[member, 0]) / conclusion.sigmas)
    assert converged >= 0.98 * 10 * seeds
    assert abs(np.sqrt(np.mean(np.square(z))) - 1) < 4 / np.sqrt(2 * 3 * seeds)
    ratio = conclusion.sigmas / np.sqrt(np.diag(cramerrao.cramer_rao(source, flight, seeds - 1)[0]))
    assert ratio.min() > 0.99
    assert ratio.max() < 1.1
    perfect = simulate.fly(bound.noise_free(source), [1])
    (twin,) = faulty.examined(perfect.log(0), perfect.vehicle).conclusions
    assert np.abs((twin.values - perfect.truth[0, 0]) / twin.sigmas).max() < 0.1


def test_the_compiled_kernel_does_not_know_what_rotors_store() -> None:
    """What turns with a rotor is a wheel to the equations, of which the vehicle file has none."""
    spun = (
        rotors(column='"speed"', spin_inertia_kg_m2="3e-5"),
        "actuators={max_rotor_command=1000.0, hover_force_n=[0, 0, 15.7], lag_s=0.04}",
    )
    used = scenario.load("multicopter", spun).scenario.vehicle
    assert kernelargs.unsupported(used).startswith("[[rotors]] store momentum")


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.numerical
def test_simulated_speeds_at_an_eighth_of_the_lag_give_values_within_their_sigmas() -> None:
    """Speeds and the rotors' momentum; massprop takes the change between two speeds as even, and counts its error: z is below 1 rms."""
    turns = (
        '{motion="random", axes=["roll", "pitch", "yaw"], level=0.2, every_cycles=32, max_cycles=24, closed_loop=true, start_s=1, end_s=12}'
    )
    pushes = '{motion="random", axes=["z"], level=0.3, every_cycles=40, max_cycles=32, start_s=4, end_s=12}'
    settings = (
        rotors(column='"speed"', spin_inertia_kg_m2="3e-5"),
        "actuators={max_rotor_command=1000.0, hover_force_n=[0, 0, 15.7], lag_s=0.04}",
        f'plan=[{{motion="hold", start_s=0, end_s=1}}, {turns}, {pushes}]',
        *("duration_s=12", "vehicle.cycle.period_s=0.005", "vehicle.imu.gyro_noise_rad_s=4e-3", "vehicle.imu.accel_noise_m_s2=0.1"),
    )
    flight = simulate.fly(scenario.load("multicopter", settings), range(1, 7))
    z = []
    for member in range(6):
        found = faulty.examined(flight.log(member), flight.vehicle)
        (conclusion,) = found.conclusions
        assert not found.notices
        z.append((conclusion.values - flight.truth[member, 0]) / conclusion.sigmas)
    assert np.abs(z).max() < 3.5
    assert 0.2 < np.sqrt(np.mean(np.square(z))) < 1.1


@pytest.mark.seeds
@pytest.mark.thorough
def test_commands_that_were_lost_leave_values_converged_and_within_their_sigmas() -> None:
    """What a rotor did meanwhile lasts as long as its lag. With its full thrust in their place nothing converged."""
    rng = np.random.default_rng(3)
    own = anyrotors.multicopters(rng, 1)
    flown = anyrotors.fly(rng, own, 0.0125, 600)
    used = anyrotors.vehicle_of(own, 0, flown)
    log = anypedestal.log_of(rng, own, 0, flown, used)
    lost = np.isin(np.arange(log.cycles), [80, 81, 260, 410])
    known = np.maximum.accumulate(np.where(lost, 0, np.arange(log.cycles)))
    less = replace(log, command=log.command[known], uncommanded=lost, ignored=np.stack([lost, lost], 1))
    found = flow.examine(less, VehicleSource(used, "", ""))
    (whole, part) = (flow.examine(log, VehicleSource(used, "", "")).conclusions[0], found.conclusions[0])
    assert not found.notices
    assert {one.verdict for one in part.estimates.values()} == {"converged"}
    assert np.abs((part.values - own.ten[0]) / part.sigmas).max() < 4
    assert (part.sigmas < 1.6 * whole.sigmas).all()
