"""The table of error parameters: what no declaration may lack, and what each does to log and vehicle file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprop_cli.diagnosis.kernelfits import BLOCKS
from massprop_cli.errorparameters.parameter import ErrorParameter, Wording
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import BY_COLUMN, BY_NAME, CODES, ENTRIES, TABLE, checked
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.prepare.timing import Timing
from tests import flight
from website.errorparameters import PAGE, page

GOOD: dict[str, Any] = {
    "name": "made-up",
    "code": "made-up",
    "what": "something",
    "unit": "m",
    "prior": 0.1,
    "key": "imu.position_m",
    "sigma_key": "imu.position_sigma_m",
    "wording": Wording("it is off", "correct it"),
}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"lowest": 1.0, "highest": 1.0}, "no value lies between 1 and 1"),
        ({"lowest": 0.2, "highest": -0.2}, "no value lies between 0.2 and -0.2"),
        ({"sigma_key": None}, "no key of the sigma, and no reason"),
        ({"key": None}, "no key of the value, and no reason"),
        ({"key": "imu.no_such_key"}, "the vehicle file has no such key"),
        ({"sigma_key": "no_such_section.sigma"}, "the vehicle file has no such key"),
        ({"key": "jets.weight_n"}, "the vehicle file has no such key"),
        ({"prior": -0.1}, "the prior sigma -0.1 is none"),
        ({"wording": Wording("it is off")}, "without a sentence or a remedy"),
    ],
)
def test_what_cannot_be_fails_as_it_is_declared(wrong: dict[str, Any], said: str) -> None:
    ErrorParameter(**GOOD)
    with pytest.raises(ValueError, match=said):
        ErrorParameter(**{**GOOD, **wrong})


def test_a_table_that_lacks_an_entry_or_has_one_twice_fails() -> None:
    assert checked(TABLE) == TABLE
    with pytest.raises(ValueError, match=r"declared twice: \['delay'\]; not declared: \[\]"):
        checked((*TABLE, BY_NAME["delay"]))
    with pytest.raises(ValueError, match=r"not declared: \['gyro_turn'\]"):
        checked([one for one in TABLE if one.name != "gyro_turn"])


def test_a_reason_stands_for_a_missing_key() -> None:
    ErrorParameter(**{**GOOD, "sigma_key": None, "no_sigma": "it is measured to a micrometre"})


def setup() -> Setup:
    flown = flight.standard()
    low_passes = [f"imu.{sensor}_filter.{key}" for sensor in ("gyro", "accel") for key in ("order=2", "cutoff_hz=30")]
    keys = [*low_passes, "imu.gyro_lag_s=0.01", "imu.accel_lag_s=0.01", "thrust.droop=0.02", "thrust.cycle_droop=0.02"]
    return Setup(flown.log(), changed(flown.used, keys), Timing(2.0, 0.3), tuple(range(len(flown.used.jets))), (10.0, 20.0))


def keyed() -> list[ErrorParameter]:
    return [one for one in TABLE if one.key is not None and one.change is None and not one.environments]


@pytest.mark.parametrize("one", keyed(), ids=lambda one: one.name)
def test_a_value_grows_by_the_error_in_its_keys_unit_and_stays_in_range(one: ErrorParameter) -> None:
    stated = setup()
    assert one.key is not None
    error = one.prior * np.arange(1, one.size + 1) / 10
    found = one.apply(stated, error)
    assert found is not None
    grown = np.broadcast_to(one.scale(stated.vehicle) * error, stated.value(one.key).shape)
    np.testing.assert_allclose(found.value(one.key) - stated.value(one.key), grown, rtol=1e-9)
    others = {other.key for other in keyed()} - {one.key}
    assert all(np.array_equal(found.value(key), stated.value(key)) for key in others if key is not None)
    if np.isfinite(one.lowest):
        below = one.apply(stated, error - 100.0)
        assert below is not None
        assert (below.value(one.key) == one.lowest).all()
    if np.isfinite(one.highest):
        assert one.apply(stated, error + 100.0) is None


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_low_pass_grows_by_its_time_constant_and_never_turns_round(sensor: str) -> None:
    stated, one = setup(), BY_NAME[f"{sensor}_cutoff"]
    longer, shorter = (one.apply(stated, np.array([by])) for by in (0.1, -100.0))
    assert longer is not None
    assert shorter is not None
    key = f"imu.{sensor}_filter.cutoff_hz"
    lag_s = 1 / (2 * np.pi * 30.0)
    assert longer.value(key)[0] == pytest.approx(1 / (2 * np.pi * (lag_s + 0.1 * stated.period_s)))
    assert 30.0 < shorter.value(key)[0] < 1000.0
    assert one.apply(stated._replace(vehicle=changed(flight.standard().used, [])), np.array([0.1])) is None


def test_a_factor_and_a_direction_leave_other_jets_as_they_are() -> None:
    stated = replace_fired(setup(), (1, 4))
    force = stated.value("jets.force_n")
    weak = BY_NAME["thrust"].apply(stated, np.array([-0.25, -2.0]))
    assert weak is not None
    np.testing.assert_allclose(weak.value("jets.force_n")[[1, 4]], force[[1, 4]] * [[0.75], [-1.0]])
    turned = BY_NAME["direction"].apply(stated, np.array([0.3, 0.3, 0.3, 0.0, 0.0, 0.0]))
    assert turned is not None
    size = np.linalg.norm(turned.value("jets.force_n"), axis=1)
    np.testing.assert_allclose(size, np.linalg.norm(force, axis=1))
    for other in (weak, turned):
        np.testing.assert_array_equal(np.delete(other.value("jets.force_n"), [1, 4], 0), np.delete(force, [1, 4], 0))
    # what is computed of the jets follows them
    np.testing.assert_allclose(weak.vehicle.jet_wrench[4, 3:], -force[4])


def replace_fired(stated: Setup, fired: tuple[int, ...]) -> Setup:
    return stated._replace(fired=fired)


def test_a_clock_that_drifts_takes_from_the_delay_what_has_run_up_before_the_stretch() -> None:
    stated = setup()
    cycle_s = stated.period_s
    found = BY_NAME["drift"].apply(stated, np.array([0.4]))
    assert found is not None
    np.testing.assert_allclose(found.vehicle.imu.clock_drift_ppm, 0.4 * cycle_s / 20.0 * 1e6)
    np.testing.assert_allclose(found.timing.delay, 2.0 - 0.4 * 10.0 / 20.0)


def test_a_bias_is_taken_off_in_the_imus_axes() -> None:
    stated = setup()
    bias = np.array([0.01, -0.02, 0.03])
    found = BY_NAME["gyro_bias"].apply(stated, bias)
    assert found is not None
    own = np.array(stated.vehicle.imu.body_from_imu).T @ bias
    taken = stated.log.delta_theta_imu_rad - found.log.delta_theta_imu_rad
    np.testing.assert_allclose(taken, own * stated.log.interval_s[:, None], atol=1e-15)
    assert found.log.delta_v_imu_m_s is stated.log.delta_v_imu_m_s


def test_every_column_of_a_parameter_is_one_of_the_regression() -> None:
    assert BY_COLUMN.keys() <= set(BLOCKS)
    assert not BY_COLUMN.keys() & {"channels", "products", "constant", "up", "level"}


def test_only_entries_of_x_and_what_moves_several_are_hypotheses() -> None:
    assert {one.name for one in TABLE if one.prior > 0} == {*ENTRIES, "mounting", "wrench_point"} - {"slope"}
    assert all(set(one.moved) <= set(ENTRIES) for one in TABLE if one.prior > 0)


def test_the_page_of_assumptions_has_every_step() -> None:
    text = (PAGE.parent / "assumptions.md").read_text(encoding="utf-8")
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| ")]
    for one in TABLE:
        if one.step is not None and not one.step.part_of:
            (row,) = [row for row in rows if one.step.code in row[1].replace(",", " ").split()]
            assert row[3].strip().startswith(one.step.words.partition(" along")[0].partition(" about")[0]), one.name


def test_the_page_is_the_table() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m website.errorparameters"
    assert all(f"(warnings/{code}.md)" in page() for code in CODES)


def test_what_is_a_part_of_nothing_has_no_least_error() -> None:
    """Of a bearing that moves nothing along, whose log may misfit as well as another."""
    flown = flight.standard("air_bearing", 60)
    setup = Setup(flown.log(), changed(flown.used, ["environment.bearing_mass_kg=0"]), Timing(2.0, 0.3))
    assert BY_NAME["bearing_mass_kg"].least(setup) == -np.inf
