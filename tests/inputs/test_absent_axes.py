"""Which IMU axes a log may lack, how a misspelt column is told from an absent one, and columns without a reading."""

from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.columns import ACCEL, DELTA_THETA, DELTA_V, GYRO
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.logtable import resembles
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.testbed import output, scenario, simulate
from tests.refusal import Edit, added, both, flight, renamed, save, vehicle_text, without

GONE = (False,) * 3
HERE = (True,) * 3


def log_of(folder: Path, edit: Edit, sample: str = "free-flyer", *settings: str) -> Log:
    path = save(edit(flight(sample)), folder / "log.parquet")
    return read(read_table(path), vehiclefile.parse(vehicle_text(sample), "vehicle.toml", settings).vehicle)


def table_log(folder: Path, edit: Edit, *settings: str) -> Log:
    """Of a vehicle on a table."""
    source = scenario.load("planar", ("duration_s=5", "plan=[]", *settings))
    flown = simulate.fly(source, [1])
    path = save(edit(output.log_table(flown, 0, source.scenario)), folder / "log.parquet")
    return read(read_table(path), flown.vehicle)


def test_a_log_may_lack_the_accelerometer_or_some_of_its_axes(tmp_path: Path) -> None:
    whole = log_of(tmp_path, without("event") if "event" in flight().column_names else lambda table: table)
    alone, partly = log_of(tmp_path, without(*DELTA_V)), log_of(tmp_path, without("delta_v_y_m_s"))
    assert (whole.axes, alone.axes, partly.axes) == (HERE + HERE, HERE + GONE, (*HERE, True, False, True))
    np.testing.assert_array_equal(alone.delta_v_imu_m_s, 0.0)
    np.testing.assert_array_equal(partly.delta_v_imu_m_s, whole.delta_v_imu_m_s * [1.0, 0.0, 1.0])
    np.testing.assert_array_equal(alone.delta_theta_imu_rad, whole.delta_theta_imu_rad)
    assert not alone.notices


def test_an_axis_may_be_a_rate_beside_increments_of_others(tmp_path: Path) -> None:
    whole, mixed = (log_of(tmp_path, edit) for edit in (lambda table: table, both(without("delta_v_y_m_s"), added(accel_y_m_s2=0.5))))
    assert mixed.force_columns == (DELTA_V[0], ACCEL[1], DELTA_V[2])
    np.testing.assert_allclose(mixed.delta_v_imu_m_s[:, 1], 0.5 * whole.interval_s)


def test_on_a_table_the_yaw_rate_alone_is_needed(tmp_path: Path) -> None:
    log = table_log(tmp_path, without(*DELTA_THETA[:2], *DELTA_V))
    assert log.axes == (False, False, True, *GONE)
    both_rates = both(without(*DELTA_THETA, *DELTA_V), added(gyro_z_rad_s=0.1))
    np.testing.assert_allclose(table_log(tmp_path, both_rates).delta_theta_imu_rad[:, 2], 0.1 * log.interval_s)
    with pytest.raises(InputError, match=r"'delta_theta_z_rad' is missing; a log needs the rate about body Z\. Add it") as refused:
        table_log(tmp_path, without(DELTA_THETA[2]))
    assert "\n" not in str(refused.value)


def test_absent_gyro_axes_of_an_imu_that_is_a_little_askew_show_what_the_yaw_makes_of_them(tmp_path: Path) -> None:
    """By 2 degrees about body Y: body rates are those of the yaw alone, and all of it."""
    angle = np.radians(2.0)
    cos, sin = float(np.cos(angle)), float(np.sin(angle))
    turned = f"vehicle.imu.body_from_imu=[[{cos}, 0, {sin}], [0, 1, 0], [{-sin}, 0, {cos}]]"
    still = ("sensors.gyro_noise_rad_s=0.0", "sensors.accel_noise_m_s2=0.0", "initial.rate_rad_s=[0, 0, 0.3]")
    whole, alone = (table_log(tmp_path, edit, turned, *still) for edit in (lambda table: table, without(*DELTA_THETA[:2])))
    np.testing.assert_allclose(alone.delta_theta_imu_rad, whole.delta_theta_imu_rad, atol=1e-12)
    with pytest.raises(InputError, match="needs the rate about body Z"):
        table_log(tmp_path, without(*DELTA_THETA[:2]), "vehicle.imu.body_from_imu=[[0, 0, 1], [0, 1, 0], [-1, 0, 0]]")


@pytest.mark.parametrize(("gone", "first"), [(DELTA_THETA, DELTA_THETA[0]), (DELTA_THETA[1:2], DELTA_THETA[1])])
def test_elsewhere_all_three_rates_are_needed(tmp_path: Path, gone: tuple[str, ...], first: str) -> None:
    with pytest.raises(InputError, match=f"'{first}' is missing; a log needs all three axes of the gyro"):
        log_of(tmp_path, without(*gone))


def test_the_thesis_method_needs_both_sensors_whole(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="needs all three axes of gyro and accelerometer"):
        log_of(tmp_path, without(*DELTA_V), "free-flyer", "estimator.method=thesis")


@pytest.mark.parametrize("name", ["delta_v_x_mps", "accel_x_m_s", "ax_mps2", "accX", "imu.acceleration.x", "Delta_V_x"])
def test_a_column_that_looks_like_an_absent_one_is_pointed_out(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=rf"'delta_v_x_m_s' is missing; the nearest unused column is '{name}'; rename it"):
        log_of(tmp_path, renamed("delta_v_x_m_s", name))


@pytest.mark.parametrize(
    "name", ["event", "battery_v", "wheel_x_rad_s", "cmg_x_gimbal_rad", "max_acc", "temperature", "gyro_temp_c", "mode"]
)
def test_other_columns_are_not_taken_for_absent_ones(name: str) -> None:
    assert not any(resembles(column, name) for column in (*DELTA_THETA, *DELTA_V, *GYRO, *ACCEL))


def test_columns_of_zeros_count_as_absent_and_a_notice_says_so(tmp_path: Path) -> None:
    def zeros(*names: str) -> Edit:
        return both(without(*names), added(**dict.fromkeys(names, 0.0)))

    log = log_of(tmp_path, zeros(*DELTA_V))
    (notice,) = log.notices
    assert (log.axes, notice.code) == (HERE + GONE, "empty-columns")
    assert "delta_v_x_m_s, delta_v_y_m_s, delta_v_z_m_s; if the sensor works" in notice.message
    partly = table_log(tmp_path, zeros(*DELTA_THETA[:2], DELTA_V[2]))
    assert partly.axes == (False, False, True, True, True, False)
    assert "delta_theta_x_rad, delta_theta_y_rad, delta_v_z_m_s" in partly.notices[0].message


def test_a_rate_that_is_needed_and_reads_zero_is_a_rate_of_zero(tmp_path: Path) -> None:
    """As of a free flyer that yaws alone, seen by a gyro without noise."""
    log = log_of(tmp_path, both(without(DELTA_THETA[0]), added(delta_theta_x_rad=0.0)))
    assert log.axes == HERE + HERE
    assert not log.notices
