"""Names of columns as laboratories write them: a draft of the map reads the axis and the unit out of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.inputs.formats import propose, units
from massprop_cli.inputs.formats.recording import Recording, stream

NAMES = {
    ("gyro", "deg/s"): """g*_dps gyro_*_dps gyro*_dps gyr_*_dps Gyr@_deg_s w*_deg_s *#_deg_s *#_dps body_rate_*_dps ang_vel_*_deg_per_s
        rate_*_dps rates_*_deg_s imu_g*_dps gyro_dps_* Gyro@_dps G@_DPS imu0_gyro_*_degps gyro_*_deg_sec IMU1_W@_deg_s bodyRate@_dps
        gyro_*_degrees_per_second $_rate_dps $rate_deg_s g_*_dps imu/g*_dps""",
    ("gyro", "rad/s"): """w*_rad_s w_*_rads omega_*_radps omega_*_rad_s *#_rad_s angular_velocity_*_rad_per_s gyro_*_rad_sec
        rotation_rate_*_rad_s imu_*_rad_s""",
    ("gyro", "mdeg/s"): "imu_gyro_*_mdps g*_mdps",
    ("gyro", "rad"): "dtheta_*_rad delta_angle_*_rad",
    ("accelerometer", "g"): "a*_g acc_*_g imu_a*_g a_*_g A@_G n*_g imu/a*_g",
    ("accelerometer", "mg"): "acc_*_mg accel_mg_* xl_*_mg",
    ("accelerometer", "m/s^2"): """accel_*_m_s2 a*_mps2 a*_ms2 acc@_mss Acc@_m_s2 accelerometer_*_m_per_s2 lin_acc_*_mps2 a_*_m_s2
        specific_force_*_m_s2 sf_*_m_s2 acc_*_m_s_2 acc_*_m_s^2 linear_acceleration_*_m_per_s_squared""",
    ("accelerometer", "m/s"): "dv_*_m_s delta_v*_m_s",
    ("torque", "N m"): "torque_*_nm tau_*_n_m torque_cmd_*_Nm cmd_t*_nm",
    ("torque", "mN m"): "T*_mNm t*_mnm",
    ("torque", "uN m"): "M*_uN_m",
    ("force", "N"): "f*_n force_*_n cmd_f*_n force_*_newton",
    ("force", "mN"): "F*_mN thrust_*_mn",
}
"""``*`` an axis, ``@`` in capitals, ``*#`` one of p, q, r, ``$`` of roll, pitch, yaw."""
OTHERS = "b*_mG mag_*_mG vel_*_rpm pos_*_mm quat_*_n euler_*_deg a_ref_*_g"
"""No sensor's, whatever unit they have."""


def _paths(name: str) -> list[str]:
    axes = zip("xyz", "XYZ", "pqr", ("roll", "pitch", "yaw"), strict=True)
    return [name.replace("*#", "#").replace("*", a).replace("@", b).replace("#", c).replace("$", d) for a, b, c, d in axes]


def _drafted(*names: str) -> str:
    time, values = np.arange(400) * 0.01, np.sin(np.arange(400.0))
    named = [stream(path, values, clock="t") for name in names for path in _paths(name)]
    return propose.draft(Recording(Path("x.csv"), "0", "csv", {one.path: one for one in (stream("t", time, "t", "s"), *named)}))


@pytest.mark.parametrize(("key", "unit", "name"), [(*known, name) for known, names in NAMES.items() for name in names.split()])
def test_axis_and_unit_are_read_from_a_name(key: str, unit: str, name: str) -> None:
    """Beside another sensor, whose columns are called likewise."""
    draft = _drafted(name, "a*_g" if key == "gyro" else "g*_dps")
    section = draft.partition(f"[{key}]\n")[2].partition("\n\n")[0]
    assert f"paths = {json.dumps(_paths(name))}" in section
    assert f'\nunit = "{unit}"   # by its name' in section


def test_a_unit_makes_no_sensor_of_what_is_called_otherwise() -> None:
    draft = _drafted("w*_dps", "acc_*_mg", *OTHERS.split())
    assert 'paths = ["wx_dps", "wy_dps", "wz_dps"]' in draft
    assert 'paths = ["acc_x_mg", "acc_y_mg", "acc_z_mg"]' in draft
    assert units.without_name_unit("gain_g") == ("gain", "g")
    assert units.without_name_unit("rads") == ("rads", "")
    assert units.without_name_unit("gx_counts") == ("gx_counts", "")
