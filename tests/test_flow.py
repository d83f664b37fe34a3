"""What the composed flow says where one of its parts can't go on."""

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES, flow
from massprop_cli.inputs.actuators.wheel import WheelLog
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import faulty
from tests.flown import fly


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_delay_that_is_sought_is_found_beside_what_hides_it() -> None:
    """In degrees, as a new log often comes, commands explain nothing of the motion; the delay is no fault of its own beside that."""
    log, used = faulty.sample("air-bearing", 15.0)
    wrong = replace(log, delta_theta_imu_rad=np.degrees(log.delta_theta_imu_rad))
    found = faulty.examined(wrong, faulty.stated(used, 'cycle.command_delay_cycles="auto"'))
    assert not any(one.verdict == "converged" for one in found.conclusions[0].estimates.values())
    assert [notice.code for notice in found.notices] == ["gyro-units"]
    (answer,) = found.mended
    truth = dict(zip(QUANTITIES, faulty.truth("air-bearing"), strict=True))
    for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        one = answer.conclusions[0].estimates[name]
        assert one.verdict == "converged"
        assert abs((one.value or 0.0) - truth[name]) < 4 * (one.sigma or 0.0)


def test_a_reading_that_is_none_of_the_motion_is_named_where_it_hides_the_delay() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    turned = log.delta_theta_imu_rad.copy()
    turned[300] = -50.0
    found = faulty.examined(replace(log, delta_theta_imu_rad=turned), faulty.stated(used, 'cycle.command_delay_cycles="auto"'))
    assert not any(one.verdict == "converged" for one in found.conclusions[0].estimates.values())
    assert [notice.code for notice in found.notices][:2] == ["timing-untold", "outliers"]


@pytest.mark.thorough
@pytest.mark.seeds
def test_wheels_that_are_logged_backwards_are_named_where_nothing_is_told() -> None:
    """A lab had been asked for more of the torque that it had commanded already."""
    turns = 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], every_cycles=5, max_cycles=4, start_s=0.0, end_s=20.0}]'
    flown = fly("wheels", "duration_s=20.0", turns, seeds=(1,))
    log, source = flown.log(0), VehicleSource(flown.vehicle, "", "")
    backwards = tuple(WheelLog(-np.asarray(one.speed_rad_s), None, None) for one in log.spinning if isinstance(one, WheelLog))
    other = flow.examine(replace(log, spinning=backwards), source)
    assert not any(one.verdict == "converged" for one in other.conclusions[0].estimates.values())
    assert [notice.code for notice in other.notices] == ["command-sign"]
    assert flow.examine(log, source).notices == ()
    # of wheels that hardly turn the body neither way tells anything
    stopped = tuple(WheelLog(np.zeros(log.rows), None, None) for _ in log.spinning)
    rng = np.random.default_rng(1)
    still = replace(log, delta_theta_imu_rad=1e-5 * rng.normal(size=(log.rows, 3)), spinning=stopped)
    assert "command-sign" not in [notice.code for notice in flow.examine(still, source).notices]
