"""On a bearing a gyro's bias carries the integrated attitude off: the estimate is none the worse for it, from whatever cycle it begins."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.estimate import kernelflight
from massprop_cli.export import resolve
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.kernel import kernel
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import linearise
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.attitude import world_up_b
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario, simulate

NOISELESS = ("sensors.gyro_noise_rad_s=1e-9", "sensors.accel_noise_m_s2=1e-9")


def settings(bias: float) -> tuple[str, ...]:
    return f"vehicle.imu.gyro_bias_sigma_rad_s={bias}", f"sensors.gyro_bias_rad_s=[{bias}, {-bias}, {bias / 2}]"


LATE = 'phases=[{name = "late", start_s = 8.0, end_s = 24.0}]'


@cache
def flown(seeds: int, *more: str) -> tuple[Array, simulate.SimulatedFlight]:
    """The truth (10,), and a flight of each seed."""
    source = scenario.load("testbed", more)
    return source.scenario.truth.values, simulate.fly(source, list(range(1, seeds + 1)))


def errors(found: tuple[Array, simulate.SimulatedFlight], *stated: str) -> Array:
    """(seeds, 10) final errors in sigmas."""
    truth, flight = found
    z = []
    for k in range(len(flight.seeds)):
        analysis = flow.examine(flight.log(k), VehicleSource(changed(flight.vehicle, stated), "", ""))
        assert analysis.notices == ()
        own = analysis.conclusions[0]
        z.append((own.values - truth) / np.sqrt(np.diag(own.covariance)))
    return np.array(z)


@pytest.mark.parametrize(("bias", "seeds"), [(1e-3, 4), pytest.param(3e-3, 8, marks=[pytest.mark.thorough, pytest.mark.seeds])])
def test_errors_are_within_their_sigmas_and_nothing_is_warned_of(bias: float, seeds: int) -> None:
    """0.06 and 0.17 degrees per second. Errors are 0.7 to 1.3 sigma in the root mean square, no mean over n seeds is beyond 3.2 / √n."""
    z = errors(flown(seeds, *settings(bias)))
    assert 0.7 < np.sqrt((z**2).mean()) < 1.3
    assert np.abs(z.mean(0)).max() < 3.2 / np.sqrt(seeds)


QUIET = ("duration_s=60.0", "sensors.gyro_noise_rad_s=1e-5", "vehicle.imu.gyro_noise_rad_s=1e-5", "vehicle.imu.gyro_bias_sigma_rad_s=1e-3")


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("bias", [(0.002, -0.0026, 0.0004), (-0.0006, -0.0001, 0.0016), (0.0, 0.0, 0.0)])
def test_a_quiet_gyro_shows_nothing_of_how_the_attitude_was_carried(bias: tuple[float, ...]) -> None:
    """For a minute: what levelling took for the bias had left 5 of 10 such logs a torque, or no cause that explains them."""
    truth, flight = flown(1, *QUIET, f"sensors.gyro_bias_rad_s={list(bias)}")
    log, source = flight.log(0), VehicleSource(flight.vehicle, "", "")
    found = flow.examine(log, source)
    z = (found.conclusions[0].values - truth) / found.conclusions[0].sigmas
    assert (found.notices, np.abs(z).max() < 4) == ((), True)
    known = flow.examine(log, VehicleSource(changed(flight.vehicle, [f"imu.gyro_bias_rad_s={list(bias)}"]), "", ""))
    assert any(bias) or known.vehicle.imu.gyro_bias_rad_s != (0.0, 0.0, 0.0)
    apart = (found.conclusions[0].values - known.conclusions[0].values) / found.conclusions[0].sigmas
    assert np.abs(apart).max() < 0.1


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_phase_that_begins_later_is_as_good() -> None:
    """By then the attitude is 12 mrad off, which is no error of where that phase begins."""
    assert 0.7 < np.sqrt((errors(flown(4, *settings(1e-3)), LATE) ** 2).mean()) < 1.3


def left_over(bias: float) -> tuple[Array, Array]:
    """(3,) of specific force, m/s², and (3,) of rates' growth, rad/s: what the equations leave at the true body, bias and attitude."""
    real = np.array([bias, -bias, bias / 2])
    truth, flight = flown(1, *NOISELESS)
    log, used = flight.log(0), changed(flight.vehicle, [f"imu.gyro_bias_sigma_rad_s={bias}"])
    log = replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad + real * log.interval_s[:, None])
    stream = Stream.of(log, used, Timing(2.0, 0.0))
    whole = slice(0, len(stream))
    here, true_up = stream.part(whole), world_up_b(flight.attitude_wxyz[0, :-1])
    reference = Reference(tensor(truth[:6]), truth[6:9], 1 / truth[9], gyro_bias=real)
    vehicle = Resolved.stated(used)
    assert vehicle is not None
    system, layout = linearise(stream, whole, reference, vehicle), Layout.of(stream, vehicle)
    state = np.zeros((len(here), layout.size))
    state[:, PARAMETERS], state[:, RATE], state[:, layout.gyro_bias] = parameters(reference), here.rate_rad_s - real, real
    # u_true = u + u × φ; what of φ is along the vertical does nothing
    state[:, layout.tilt] = np.cross(true_up, here.up_b[:-1])
    felt = system.measured - np.einsum("kij,kj->ki", system.observation, state)
    moved = np.einsum("kij,kj->ki", system.transition, state[:-1]) + system.drive
    return np.abs(felt[:, 3:]).mean(0), np.abs(state[1:, RATE] - moved[:, RATE]).mean(0)


@pytest.mark.thorough
def test_the_equations_hold_at_the_truth_to_the_second_order() -> None:
    """Without noise what is left goes with the bias' square: four times the bias leaves some 16 times as much."""
    (felt, grown), (more_felt, more_grown) = left_over(2.5e-4), left_over(1e-3)
    assert felt.max() < 1e-5  # m/s²; half a milliradian of tilt is 5e-3
    assert (more_felt < 25 * felt + 1e-6).all()
    assert grown.max() < 1e-8  # rad/s
    assert (more_grown < 25 * grown + 1e-9).all()


@pytest.mark.thorough
def test_noise_carries_the_attitude_off_before_a_phase_begins_too() -> None:
    """A coarse gyro beside a sharp accelerometer, a CG 4 mm out: in eight seconds noise turns the vertical by 0.3 mrad."""
    coarse = [f"{where}.gyro_noise_rad_s=5e-4" for where in ("sensors", "vehicle.imu")]
    sharp = [f"{where}.accel_noise_m_s2=3e-3" for where in ("sensors", "vehicle.imu")]
    z = errors(flown(4, *coarse, *sharp, "truth.cg_z=-0.004"), LATE)
    assert 0.7 < np.sqrt((z**2).mean()) < 1.3
    assert np.abs(z).max() < 4.0


@pytest.mark.thorough
def test_the_equations_hold_for_an_error_of_one_cycles_rate() -> None:
    """By it the vertical that the equations use turns within that cycle, and stays turned; the states say so."""
    moving = "truth.cg_z=-0.008", "vehicle.cycle.period_s=0.1", "initial.rate_rad_s=[0.1, -0.1, 0.1]"
    flight = simulate.fly(scenario.load("testbed", [*NOISELESS, *moving]), [1])
    log, truth, vehicle = flight.log(0), flight.truth[0][0], Resolved.stated(flight.vehicle)
    assert vehicle is not None
    reference = Reference(tensor(truth[:6]), truth[6:9], 1 / truth[9])

    true = Stream.of(log, flight.vehicle, Timing(2.0, 0.0)).part(slice(0, log.cycles))

    def left(turned: Array) -> tuple[Array, Array]:
        """At the true rates, and the error that the attitude has of these gyro increments."""
        stream = Stream.of(replace(log, delta_theta_imu_rad=turned), flight.vehicle, Timing(2.0, 0.0))
        whole = slice(0, len(stream))
        here, system, layout = stream.part(whole), linearise(stream, whole, reference, vehicle), Layout.of(stream, vehicle)
        state = np.zeros((len(here), layout.size))
        state[:, PARAMETERS], state[:, RATE] = parameters(reference), true.rate_rad_s
        state[:, layout.tilt] = np.cross(true.up_b[:-1], here.up_b[:-1])
        moved = np.einsum("kij,kj->ki", system.transition, state[:-1]) + system.drive
        return state[1:, RATE] - moved[:, RATE], (system.measured - np.einsum("kij,kj->ki", system.observation, state))[:, 3:]

    grown, felt = left(log.delta_theta_imu_rad)
    error, cycle = 1e-4, 100
    for axis in range(3):
        turned = log.delta_theta_imu_rad.copy()
        turned[cycle, axis] += error * 0.1
        more, more_felt = left(turned)
        # the weight makes 1.5 % of it of the rate in one cycle, which is to be known to a fifteenth
        assert np.abs(more - grown).max() < 1e-3 * error
        assert np.abs(more_felt - felt).max() < 1e-2 * 9.8 * 0.1 * error


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
@pytest.mark.parametrize(("bias", "most"), [(1e-3, 0.2), (1e-2, 0.5)])
def test_on_board_the_estimate_frees_the_attitude_of_the_bias(bias: float, most: float) -> None:
    """Of logs without noise errors are below ``most`` sigmas; 0.01 rad/s carry the attitude off by 14 degrees."""
    truth, flight = flown(2, *settings(bias), *NOISELESS)
    resolved = resolve.stated(VehicleSource(flight.vehicle, "", ""))
    for k in range(2):
        log, leg = flight.log(k), resolved.phases[0]
        whole = slice(0, log.cycles)
        said = kernelflight.Flight(resolved.commands, leg.vehicle, leg.rule).step(kernelflight.cycles_of(log, whole, whole), last=True)
        assert np.abs((said.values[-1] - truth) / said.sigmas[-1]).max() < most
