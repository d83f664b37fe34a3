"""The busiest part of a long log, where commands have times of their own."""

import numpy as np

from massprop_cli.diagnosis import segment
from massprop_cli.prepare.timing import Timing
from tests import anyimu


def test_commands_count_in_the_cycle_that_covers_their_time() -> None:
    """There are more cycles than commands, so that neither can stand for the other."""
    rng = np.random.default_rng(1)
    imu, period_s = anyimu.Imu(measures="mean"), 0.2
    own = anyimu.bodies(rng, 1)
    count = int(60.0 / period_s)
    time_s = 0.01 * np.arange(1, 6001)
    flown = anyimu.Flown(
        time_s, np.zeros((1, 6000, 3)), np.zeros((1, 6000, 3)), period_s * np.arange(count) + 0.001, np.zeros((1, count, anyimu.JETS))
    )
    flown.on_s[0, 200:210] = 0.1
    used = anyimu.vehicle_of(own, 0, flown, imu, period_s, period_s)
    log = anyimu.log_of(flown, 0, imu, used)
    assert log.cycles == 1200  # of 50 ms
    part, piece = segment.busiest(log, used, Timing(1.0, 0.0), slice(0, log.cycles), 100)
    begin, end = (part.cycle_end_s[at] for at in (piece.start, piece.stop - 1))
    assert begin < 40.0 + 0.06
    assert end > 41.8
