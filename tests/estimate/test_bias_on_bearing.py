"""On a bearing a gyro's bias carries the integrated attitude off: the estimate is none the worse for it, from whatever cycle it begins."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.layout import PARAMETERS, RATE, Layout
from massprop_cli.model.linearise import linearise
from massprop_cli.model.parameters import parameters
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario, simulate

NOISELESS = ("sensors.gyro_noise_rad_s=1e-9", "sensors.accel_noise_m_s2=1e-9")


def settings(bias: float) -> tuple[str, ...]:
    return f"vehicle.imu.gyro_bias_sigma_rad_s={bias}", f"sensors.gyro_bias_rad_s=[{bias}, {-bias}, {bias / 2}]"


def errors(seeds: int, *more: str) -> Array:
    """(seeds, phases, 10) final errors in sigmas."""
    source = scenario.load("testbed", more)
    flight = simulate.fly(source, list(range(1, seeds + 1)))
    found = []
    for k in range(seeds):
        analysis = flow.examine(flight.log(k), VehicleSource(flight.vehicle, "", ""))
        assert analysis.notices == ()
        each = [(own.values - source.scenario.truth.values) / np.sqrt(np.diag(own.covariance)) for own in analysis.conclusions]
        found.append(each)
    return np.array(found)


@pytest.mark.parametrize("bias", [1e-3, 3e-3])
def test_errors_are_within_their_sigmas_and_nothing_is_warned_of(bias: float) -> None:
    """0.06 and 0.17 degrees per second, over 16 seeds. Root mean square of all errors 0.7 to 1.3 sigma, the mean of none beyond 0.8."""
    found = errors(16, *settings(bias))[:, 0]
    assert 0.7 < np.sqrt((found**2).mean()) < 1.3
    assert np.abs(found.mean(0)).max() < 0.8


def test_a_phase_that_begins_later_is_as_good() -> None:
    """By then the attitude is 12 mrad off, which is no error of where that phase begins."""
    late = '[{name = "late", start_s = 8.0, end_s = 24.0}]'
    found = errors(8, *settings(1e-3), f"vehicle.phases={late}")[:, 0]
    assert 0.7 < np.sqrt((found**2).mean()) < 1.3


def test_the_equations_hold_at_the_truth_to_the_second_order() -> None:
    """Without noise, at the true body, bias and attitude: what is left of rate and specific force goes with the bias' square."""
    left = []
    for bias in (2.5e-4, 1e-3):
        source = scenario.load("testbed", (*settings(bias), *NOISELESS))
        flight, seen = (
            simulate.fly(source, [1]),
            simulate.fly(scenario.load("testbed", (*settings(bias), *NOISELESS, "sensors.log_attitude=true")), [1]),
        )
        stream = Stream.of(flight.log(0), flight.vehicle, Timing(2.0, 0.0))
        here = stream.part(slice(0, len(stream)))
        truth, real = source.scenario.truth.values, np.array([bias, -bias, bias / 2])
        reference = Reference(tensor(truth[:6]), truth[6:9], 1 / truth[9], gyro_bias=real)
        vehicle = Resolved.stated(flight.vehicle)
        assert vehicle is not None
        system, layout = linearise(stream, slice(0, len(stream)), reference, vehicle), Layout.of(stream, vehicle)
        state = np.zeros((len(here), layout.size))
        state[:, PARAMETERS], state[:, RATE], state[:, layout.gyro_bias] = parameters(reference), here.rate_rad_s - real, real
        true_up = Stream.of(seen.log(0), seen.vehicle, Timing(2.0, 0.0)).part(slice(0, len(stream))).up_b[:-1]
        # u_true = u + u × φ; what of φ is along the vertical does nothing
        state[:, layout.tilt] = np.cross(true_up, here.up_b[:-1])
        rest = system.measured - np.einsum("kij,kj->ki", system.observation, state)
        left.append(np.abs(rest[:, 3:]).mean(0).max())
    assert left[0] < 1e-5  # of 5e-4 times 9.8, which an error of half a milliradian is
    assert left[1] < 30 * left[0]
