"""Precisions that no plan promises: of a CG that torques may be about, and of a table that swings."""

import re
from pathlib import Path

import pytest

from massprop_cli.base import configfile
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.require import precise
from massprop_cli.plan import flow
from massprop_cli.plan.flow import PlanRequest
from massprop_cli.testbed import output, scenario


@pytest.mark.parametrize(("more", "cg_x", "exit_code"), [("", 0.0, 4), ("", 0.004, 0), ("[thrust]\nwrench_point_m = [0, 0, 0]\n", 0.0, 0)])
def test_a_cg_that_may_be_where_torques_are_about_is_not_promised(more: str, cg_x: float, exit_code: int, tmp_path: Path) -> None:
    """As in an estimate of the plan's own log; unless the guess is 4 mm from O, or the point is stated."""
    sensors = "[cycle]\nperiod_s = 0.05\n[imu]\ngyro_noise_rad_s = 1e-3\naccel_noise_m_s2 = 0.05\n"
    (tmp_path / "vehicle.toml").write_text(f"schema = 1\nname = 'wrench'\n{sensors}{more}")
    body = f"[body]\nixx = 0.02\niyy = 0.03\nizz = 0.04\nmass = 2.0\ncg_x = {cg_x}\n"
    (tmp_path / "guess.toml").write_text(f"{body}[actuators]\nmax_torque_n_m = [0.05, 0.05, 0.05]\nmax_force_n = [2.0, 2.0, 2.0]\n")
    options = PlanRequest(precise("cg_x 2 mm, mass 5 %"), max_time_s=1.0)
    made = flow.make(tmp_path / "vehicle.toml", tmp_path / "guess.toml", options, lambda *_: None)
    assert made.exit_code == exit_code
    assert made.plan.quantities["mass"].reached_at_s is not None
    said = "the CG is at O if commanded torques are about O, and is unknown if they are about the CG; state thrust.wrench_point_m"
    assert (f"cg_x, cg_y, cg_z will not converge: {said}" in made.plan.notes) == (exit_code == 4)
    assert (made.plan.limited_by == f"cg_x will not converge: {said}") == (exit_code == 4)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("cg_x", [0.003, 0.0005])
def test_a_table_that_its_wheels_can_not_hold_level_is_to_be_balanced_first(cg_x: float, tmp_path: Path) -> None:
    """Its weight of 12 kg at that arm against 0.02 N m; and what the gentlest motion takes is above the limit."""
    (tmp_path / "vehicle.toml").write_text(output.vehicle_toml(scenario.load("pedestal").scenario.vehicle))
    body = f"[body]\nixx = 0.32\niyy = 0.36\nizz = 0.41\ncg_x = {cg_x}\ncg_z = 0.019\nmass = 12.0\n"
    (tmp_path / "guess.toml").write_text(f"spread = 0.0\ncg_spread_m = 0.0\n{body}[actuators]\nmax_wheel_torque_n_m = 0.02\n")
    options = PlanRequest(precise("ixx 1 %"), max_time_s=12.0, limits={"tilt_rad": 0.2})
    with pytest.raises(InputError) as refused:
        flow.make(tmp_path / "vehicle.toml", tmp_path / "guess.toml", options, lambda *_: None)
    found = re.search(r"gentlest takes ([\d.]+) rad\. .* by up to ([\d.]+) N m, and its wheels give 0\.02 N m\. (.*)", str(refused.value))
    assert found is not None
    assert float(found[1]) > 0.2
    assert float(found[2]) == pytest.approx(12 * 9.80665 * cg_x, rel=2e-3)
    assert found[3] == "Balance it first (massprop balance, with a log in which the table swings while its wheels turn), or raise the limit"


def test_no_plan_promises_more_than_an_uncertain_thrust_leaves(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text(output.vehicle_toml(scenario.load("free-flyer").scenario.vehicle))
    vehicle = vehiclefile.load(tmp_path / "vehicle.toml").vehicle
    stronger = {f"jets.{i}.force_n": [1.02 * part for part in jet.force_n] for i, jet in enumerate(vehicle.jets)}
    (tmp_path / "guess.toml").write_text("[body]\nixx = 0.6\niyy = 2.7\nizz = 2.4\nmass = 22.0\n")
    options, stated = PlanRequest(precise("ixx 3 %"), max_time_s=5.0), (f"uncertain={configfile.written([stronger])}",)
    made = flow.make(tmp_path / "vehicle.toml", tmp_path / "guess.toml", options, lambda *_: None, stated).plan
    assert made.quantities["ixx"].sigma > 0.019 * 0.6  # a hundredth of that by the noise alone
    assert made.quantities["ixx"].longer["4"] > 0.019 * 0.6  # no log tells it, however long


@pytest.mark.thorough
def test_what_a_longer_log_tells_better_is_said_so(tmp_path: Path) -> None:
    (tmp_path / "vehicle.toml").write_text(output.vehicle_toml(scenario.load("free-flyer").scenario.vehicle))
    (tmp_path / "guess.toml").write_text("[body]\nixx = 0.6\niyy = 2.7\nizz = 2.4\nmass = 22.0\n")
    options = PlanRequest(precise("ixx 5 %"), max_time_s=5.0)
    made = flow.make(tmp_path / "vehicle.toml", tmp_path / "guess.toml", options, lambda *_: None, ("thrust.pulse_sigma=0.05",)).plan
    item = made.quantities["ixx"]
    assert made.beyond_bound["ixx"] > 5
    assert item.longer["4"] == pytest.approx(item.sigma / 2, rel=0.25)
