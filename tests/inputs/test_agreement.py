"""A mapped gyro beside the logged attitude: its scale is told to a part of a percent, and refused from three on."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import agreement
from massprop_cli.inputs.tablefile import MapConversion
from massprop_cli.inputs.vehiclefile import parse
from tests import flight

STEP_S, ROWS = 0.01, 4000
VEHICLE = parse("schema = 1\n[cycle]\nperiod_s = 0.05\n", "v").vehicle
AXES = {"of a free flyer": (1.0, 1.0, 1.0), "of a table": (0.0, 0.0, 1.0)}


@cache
def turning(axes: tuple[float, ...], size: float = 0.3) -> tuple[Array, Rotation]:
    """(n, 3) rates that wander by ``size``, rad/s, slower than 1 Hz, and the attitude at the end of each row."""
    rate = gaussian_filter1d(np.random.default_rng(5).normal(size=(ROWS, 3)), 60, axis=0)
    rate *= size / rate.std(0) * np.array(axes)
    turns = [Rotation.identity()]
    for each in Rotation.from_rotvec(rate * STEP_S):
        turns.append(turns[-1] * each)
    return rate, Rotation.concatenate(turns[1:])


def check(rate: Array, turns: Rotation, without: Sequence[slice] = ()) -> None:
    quaternions = turns.as_quat()[:, [3, 0, 1, 2]]
    for rows in without:
        quaternions[rows] = np.nan
    agreement.check(Path("x.csv"), MapConversion("m.toml", "0", ()), VEHICLE, rate * STEP_S, np.zeros((ROWS, 3)), quaternions)


@pytest.mark.parametrize("axes", AXES.values(), ids=AXES)
@pytest.mark.parametrize("scale", [0.87, 0.95, 1.05, 1.14])
def test_a_gyro_that_turns_otherwise_than_the_attitude_is_refused_with_the_figure(axes: tuple[float, ...], scale: float) -> None:
    rate, turns = turning(axes)
    with pytest.raises(InputError, match=r"x.csv: \[gyro\] of m.toml turns .* as the logged attitude; correct unit or scale") as told:
        check(rate * scale, turns)
    figure = float(str(told.value).partition("turns ")[2].split()[0])
    assert figure == pytest.approx(scale, abs=4e-3)


@pytest.mark.parametrize("axes", AXES.values(), ids=AXES)
def test_a_right_gyro_is_taken_beside_a_poor_attitude(axes: tuple[float, ...]) -> None:
    rate, turns = turning(axes)
    noise = Rotation.from_rotvec(np.random.default_rng(6).normal(0, 0.02, (ROWS, 3)))
    poor = {
        "as it is": turns,
        "noisy": turns * noise,
        "a fifth of a second late": turns[np.maximum(np.arange(ROWS) - 20, 0)],
        "once in a tenth of a second": turns[np.arange(ROWS) // 10 * 10],
        "of axes 8 degrees apart": turns * Rotation.from_euler("x", 8, degrees=True),
    }
    for attitude in poor.values():
        check(rate, attitude)
    check(rate + 0.05, turns)  # a bias is no scale
    check(rate * 1.02, turns)


@pytest.mark.parametrize("scale", [1.0, 1.14])
@pytest.mark.parametrize(
    "gaps",
    [
        pytest.param([slice(1200, 1800)], id="6 s"),
        pytest.param([slice(400, 1000), slice(2000, 3500)], id="6 s and 15 s"),
        pytest.param([slice(500, 3500)], id="most of the log"),
        pytest.param([slice(500, None)], id="to the end"),
        pytest.param([slice(n, n + 150) for n in range(100, 4000, 200)], id="three quarters of every 2 s"),
        pytest.param([slice(3, None)], id="all but three"),
        pytest.param([slice(1, None)], id="all but one"),
    ],
)
def test_gaps_in_the_attitude_contradict_no_gyro_and_hide_no_scale(scale: float, gaps: list[slice]) -> None:
    """It turns by 2 rad a second about changing axes, so that a sum of increments over a gap is no turn."""
    rate, turns = turning(AXES["of a free flyer"], 2.0)
    left = ROWS - sum(len(range(ROWS)[gap]) for gap in gaps)
    if scale == 1.0 or left < 4:
        check(scale * rate, turns, gaps)
    else:
        with pytest.raises(InputError, match=r"turns 1\.1\d* ± .* times as far as the logged attitude"):
            check(scale * rate, turns, gaps)


def test_a_scale_that_a_noisy_attitude_does_not_tell_is_left_to_the_estimate() -> None:
    rate, turns = turning(AXES["of a table"])
    check(rate * 1.05, turns * Rotation.from_rotvec(np.random.default_rng(6).normal(0, 0.015, (ROWS, 3))))


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_a_few_rows_tell_no_scale(rows: int) -> None:
    rate, turns = turning(AXES["of a free flyer"])
    quaternions = turns.as_quat()[:rows, [3, 0, 1, 2]]
    agreement.check(Path("x.csv"), MapConversion("m.toml", "0", ()), VEHICLE, rate[:rows] * STEP_S, np.zeros((rows, 3)), quaternions)


def test_a_right_gyro_of_a_steady_spin_is_taken_beside_a_noisy_attitude() -> None:
    """Less its mean such a spin is nothing but noise, by which no scale is told."""
    rate = np.tile([0.0, 0.0, 0.4], (ROWS, 1))
    turns = Rotation.from_rotvec(np.outer(np.arange(1, ROWS + 1) * STEP_S, [0.0, 0.0, 0.4]))
    for seed in range(40):
        check(rate, turns * Rotation.from_rotvec(np.random.default_rng(seed).normal(0, 0.005, (ROWS, 3))))


def test_an_accelerometer_that_feels_gravity_the_other_way_is_told_so() -> None:
    rate, turns = turning(AXES["of a free flyer"])
    quaternions = turns.as_quat()[:, [3, 0, 1, 2]]
    felt = turns.inv().apply([0.0, 0.0, 9.80665])
    made, bearing = MapConversion("m.toml", "0", ()), flight.vehicle("air_bearing")
    agreement.check(Path("x.csv"), made, bearing, rate * STEP_S, felt, quaternions)
    with pytest.raises(InputError, match=r"with the opposite sign: state scale = -1.0 under \[accelerometer\]"):
        agreement.check(Path("x.csv"), made, bearing, rate * STEP_S, -felt, quaternions)
