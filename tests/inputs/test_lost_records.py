"""Records that a recorder lost are put back as unknown: the values stay right, and their sigmas include the loss."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import IntArray, frozen
from massprop_cli.base.errors import InputError
from massprop_cli.flow import Analysis
from massprop_cli.inputs import telemetry, vehiclefile
from massprop_cli.inputs.columns import DELTA_THETA, DELTA_V, TIME, Column
from massprop_cli.inputs.marked import contain_both
from massprop_cli.inputs.tablefile import columns_of
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.prepare.align import align
from massprop_cli.testbed import output, scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight

Columns = dict[str, Any]
SENSED = (*DELTA_THETA, *DELTA_V)
FLOWN: dict[str, SimulatedFlight] = {}


def flight(name: str) -> SimulatedFlight:
    if name not in FLOWN:
        FLOWN[name] = simulate.fly(scenario.load(name, []), [1])
    return FLOWN[name]


def columns(name: str) -> Columns:
    table = output.log_table(flight(name), 0, scenario.load(name, []).scenario)
    return {column: table.column(column).to_numpy().copy() for column in table.column_names}


def log_of(found: Columns, vehicle: Vehicle) -> Log:
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(found), sink)
    return telemetry.read(columns_of(Path("log.parquet"), sink.getvalue().to_pybytes()), vehicle)


def rows(found: Columns, keep: IntArray) -> Columns:
    return {name: values[keep] for name, values in found.items()}


def without(found: Columns, gone: IntArray) -> Columns:
    return rows(found, np.setdiff1d(np.arange(len(found[TIME])), gone))


def estimated(found: Columns, vehicle: Vehicle) -> Analysis:
    with np.errstate(all="ignore"):
        return flow.examine(log_of(found, vehicle), VehicleSource(vehicle, "", ""))


def held(found: Columns, places: IntArray, names: tuple[str, ...]) -> Columns:
    changed = {name: values.copy() for name, values in found.items()}
    for place in places:
        for name in names:
            changed[name][place : place + 3] = found[name][place - 1]
    return changed


def filled(found: Columns, places: IntArray, value: float) -> Columns:
    changed = {name: values.copy() for name, values in found.items()}
    for name in SENSED:
        changed[name][places] = value
    return changed


def lost(kind: str, found: Columns, places: IntArray) -> Columns:
    if kind == "single rows":
        return without(found, places)
    if kind == "five cycles in a row":
        return without(found, (places[:, None] + np.arange(5)).ravel())
    if kind == "rows repeated":
        return held(found, places, tuple(name for name in found if name != TIME))
    if kind == "readings repeated":
        return held(found, places, SENSED)
    return filled(found, places, {"zeros": 0.0, "empty cells": np.nan, "fill values": -9999.0}[kind])


KINDS = ["single rows", "five cycles in a row", "rows repeated", "readings repeated", "zeros", "empty cells", "fill values"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["free-flyer", pytest.param("testbed", marks=pytest.mark.thorough)])
def test_values_stay_right_and_converged_and_no_other_cause_is_named(name: str, kind: str) -> None:
    flown = flight(name)
    whole, vehicle = columns(name), flown.vehicle
    clean = estimated(whole, vehicle)
    busy = np.flatnonzero(log_of(whole, vehicle).command.any(1))
    places = np.unique(np.random.default_rng(3).choice(busy[(busy > 20) & (busy < len(whole[TIME]) - 20)], 8))
    places = places[np.diff(places, prepend=-99) > 8]
    found = estimated(lost(kind, whole, places), vehicle)
    assert {notice.code for notice in found.notices} - {notice.code for notice in clean.notices} == {"records-lost"}
    truth = dict(zip(found.conclusions[0].estimates, flown.truth[0][0], strict=True))
    for quantity, before in clean.conclusions[0].estimates.items():
        after = found.conclusions[0].estimates[quantity]
        if after.value is not None and after.sigma and before.sigma:
            assert abs(after.value - float(truth[quantity])) < 4 * after.sigma
            assert after.sigma < 6 * before.sigma  # nothing else disturbs these bodies: a rate long past tells all that acted since
    converged = [sum(one.verdict == "converged" for one in each.conclusions[0].estimates.values()) for each in (clean, found)]
    assert converged[1] >= converged[0] - 1


def test_a_row_that_is_lost_within_a_control_cycle_keeps_its_command_and_time() -> None:
    """Five records a cycle, each with its command: what the others of a cycle have is that of its first row."""
    sample = Path(__file__).parents[2] / "sample_logs" / "high-rate"
    table = pq.read_table(sample / "log.parquet")[:2000]
    whole, vehicle = {name: table.column(name).to_numpy() for name in table.column_names}, vehiclefile.load(sample / "vehicle.toml").vehicle
    log = log_of(whole, vehicle)
    each = log.records_per_cycle
    assert each > 1
    first, inner = 40 * each, 60 * each + 1
    repeated = {name: np.repeat(values[::each], each) if name.startswith("jet_") else values for name, values in whole.items()}
    for found_in, unknown in ((whole, [40]), (repeated, [])):
        found = log_of(without(found_in, np.array([first, inner])), vehicle)
        assert np.abs(found.time_s - log.time_s).max() < 1e-9
        assert found.uncommanded is not None
        assert found.ignored is not None
        np.testing.assert_array_equal(np.flatnonzero(found.uncommanded), unknown)
        np.testing.assert_array_equal(np.flatnonzero(found.ignored.all(1)), [40, 60])
        known = np.setdiff1d(np.arange(log.cycles), unknown)
        np.testing.assert_allclose(found.command[known], log.command[known], atol=1e-12)


@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize("begin", [1, 3])
def test_a_log_that_begins_within_a_control_cycle_keeps_its_commands_in_their_cycles(begin: int, every: bool) -> None:
    """Of recorders that write a command in the first row of its cycle, or in ``every`` one."""
    sample = Path(__file__).parents[2] / "sample_logs" / "high-rate"
    table = pq.read_table(sample / "log.parquet")[:2000]
    whole, vehicle = {name: table.column(name).to_numpy() for name in table.column_names}, vehiclefile.load(sample / "vehicle.toml").vehicle
    log = log_of(whole, vehicle)
    each = log.records_per_cycle
    if every:
        whole |= {name: np.repeat(values[::each], each) for name, values in whole.items() if name.startswith("jet_")}
    found = log_of(rows(whole, np.arange(begin, 2000)), vehicle)
    assert found.cycles == log.cycles
    np.testing.assert_allclose(found.time_s, log.time_s, atol=1e-9)
    np.testing.assert_allclose(found.command[1:], log.command[1:], atol=1e-12)
    assert found.ignored is not None
    np.testing.assert_array_equal(np.flatnonzero(found.ignored.all(1)), [0])


def test_an_impulse_of_an_unknown_command_has_the_largest_command_as_its_sigma() -> None:
    flown = flight("free-flyer")
    log = flown.log(0)
    flags = np.zeros(log.cycles, dtype=bool)
    flags[100] = True
    made = align(replace(log, uncommanded=flags), flown.vehicle, 1.0, 0.0)
    assert made.pulse_covariance is not None
    np.testing.assert_array_equal(np.flatnonzero(made.uncommanded), [101, 102])  # a valve closes slowly
    largest, wrench = log.command.max(0), made.channels.wrench
    both = np.sqrt(np.einsum("kaa->ka", made.pulse_covariance[[101, 102]]))
    np.testing.assert_allclose(both[0], np.sqrt(((largest[:, None] * wrench) ** 2).sum(0)), rtol=0.2)
    assert (both[1] < 0.2 * both[0] + 1e-12).all()
    assert not np.delete(made.pulse_covariance, [101, 102], 0).any()
    assert align(replace(log, command=frozen(log.command)), flown.vehicle, 1.0, 0.0).pulse_covariance is None


@pytest.mark.parametrize(
    ("gone", "said"), [(np.arange(200, 206), "a gap of 0.35 s"), (np.arange(20, 380), r"a gap of|split the log there")]
)
def test_more_than_five_cycles_in_a_row_are_a_gap(gone: IntArray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        log_of(without(columns("free-flyer"), gone), flight("free-flyer").vehicle)


def test_more_than_five_cycles_in_a_row_without_a_reading_of_the_gyro_are_one_too() -> None:
    """What turned meanwhile is in no record; the accelerometer's readings carry nothing on."""

    def blind(sensor: tuple[str, ...]) -> Log:
        made = columns("free-flyer")
        for name in sensor:
            made[name][200:206] = np.nan
        return log_of(made, flight("free-flyer").vehicle)

    with pytest.raises(InputError, match="column delta_theta_x_rad: more than 5 records in a row have no gyro reading"):
        blind(DELTA_THETA)
    ignored = blind(DELTA_V).ignored
    assert ignored is not None
    assert np.flatnonzero(ignored[:, 1]).tolist() == list(range(200, 206))


def test_a_sensor_that_repeats_often_has_lost_nothing() -> None:
    """It resolves no more: every other reading is the one before."""
    found = columns("free-flyer")
    for name in SENSED:
        found[name][1::2] = found[name][::2][: len(found[name][1::2])]
    log = log_of(found, flight("free-flyer").vehicle)
    assert [notice.code for notice in log.notices] == ["readings-held"] * 2
    assert log.ignored is None


@pytest.mark.parametrize("late", [True, False])
def test_records_that_came_late_are_told_from_lost_ones_by_the_sensor_that_is_smooth(late: bool) -> None:
    """A gyro in slow turns beside an accelerometer that shows pulses and noise alone."""
    rng = np.random.default_rng(4)
    smooth, rough = np.cumsum(rng.normal(0, 1e-3, (400, 3)), 0), rng.normal(0, 1.0, (400, 3))
    rows = np.arange(20, 390, 40)
    for increments in (smooth, rough):
        increments[rows + 1] += increments[rows] if late else 0.0
        increments[rows] = 0.0
    assert contain_both([smooth, rough], rows + 1, 2) is late
    assert contain_both([smooth], rows + 1, 2) is late


@pytest.mark.parametrize("step", [3e-4, 1e-3])
def test_readings_that_a_coarse_sensor_repeats_by_chance_are_not_lost(step: float) -> None:
    """Steps of one and of several sigmas of the noise; and a recorder that repeats rows shows beside them."""
    whole, vehicle = columns("free-flyer"), flight("free-flyer").vehicle
    coarse = whole | {name: np.round(values / step) * step for name, values in whole.items() if name.startswith("delta_theta")}
    assert not any(notice.code == "records-lost" for notice in log_of(coarse, vehicle).notices)
    rows = np.arange(50, 350, 30)
    for name in [name for name in coarse if name.startswith("delta")]:
        coarse[name][rows] = coarse[name][rows - 1]
    (said,) = [notice.message for notice in log_of(coarse, vehicle).notices if notice.code == "records-lost"]
    assert f"{len(rows)} that repeat the one before" in said


def test_a_reading_that_is_like_a_fill_value_and_not_far_from_the_others_is_one() -> None:
    """In mm/s, where the largest others are 9.999 m/s; a fill value, too, where the largest of these are a tenth."""
    whole, vehicle = columns("free-flyer"), flight("free-flyer").vehicle
    vehicle = vehicle.model_copy(update={"columns": {"delta_v_x_m_s": Column(**{"from": "delta_v_x_m_s", "scale": 1e-3})}})
    for largest, filled in ((1100.0, False), (900.0, True)):
        speeds = whole["delta_v_x_m_s"] / np.abs(whole["delta_v_x_m_s"]).max() * largest
        speeds[[100, 300]] = -9999.0, 9999.0
        found = log_of(whole | {"delta_v_x_m_s": speeds}, vehicle)
        assert any("2 with a fill value" in notice.message for notice in found.notices) == filled


def test_increments_over_the_time_since_the_record_before_hold_what_was_lost() -> None:
    """As of tools that make increments of mean rates and times: after a gap they are as much larger, and nothing is put back."""
    whole, vehicle = columns("free-flyer"), flight("free-flyer").vehicle
    made = without(whole, rows := np.array([100, 200, 300]))
    after = rows - np.arange(len(rows))
    for name in [name for name in made if name.startswith("delta")]:
        made[name][after] += whole[name][rows]
    found = log_of(made, vehicle)
    assert found.cycles == len(made[TIME])
    assert "records-lost" not in {notice.code for notice in found.notices}


@pytest.mark.parametrize("each", [5, 8])
def test_rows_that_are_missing_regularly_are_no_clock_of_another_rate(each: int) -> None:
    """Of seven records in eight cycles the mean interval is even."""
    whole, vehicle = columns("free-flyer"), flight("free-flyer").vehicle
    rows = np.arange(each, len(whole[TIME]) - 1, each)
    found, log = log_of(without(whole, rows), vehicle), log_of(whole, vehicle)
    assert [notice.code for notice in found.notices] == ["records-lost"]
    np.testing.assert_allclose(found.time_s, log.time_s, atol=1e-9)
    assert found.uncommanded is not None
    np.testing.assert_array_equal(np.flatnonzero(found.uncommanded), rows)


@pytest.mark.parametrize("later_s", [0.0, 1e-4])
def test_rows_that_stand_twice_are_left_out_and_stamps_that_do_are_refused(later_s: float) -> None:
    whole, vehicle = columns("free-flyer"), flight("free-flyer").vehicle
    twice = rows(whole, np.sort(np.append(np.arange(len(whole[TIME])), [50, 51, 51, 300])))
    twice[TIME] = twice[TIME] + later_s * np.append(0.0, np.diff(twice[TIME]) == 0)
    found, log = log_of(twice, vehicle), log_of(whole, vehicle)
    assert [notice.code for notice in found.notices] == ["clock-rebuilt"]
    for name in ("time_s", "delta_theta_imu_rad", "delta_v_imu_m_s", "command"):
        np.testing.assert_array_equal(getattr(found, name), getattr(log, name))
    twice["delta_v_x_m_s"] = twice["delta_v_x_m_s"] + np.arange(len(twice[TIME])) * 1e-9
    twice[TIME] = whole[TIME][np.searchsorted(whole[TIME], twice[TIME] - later_s)]
    with pytest.raises(InputError, match="time repeats"):
        log_of(twice, vehicle)


def test_a_clock_that_steps_by_a_record_is_asked_about() -> None:
    """Five records a cycle, commands in the first of each: a row that is put back moves all that follow."""
    sample = Path(__file__).parents[2] / "sample_logs" / "high-rate"
    table = pq.read_table(sample / "log.parquet")[:2000]
    whole, vehicle = (
        {name: table.column(name).to_numpy().copy() for name in table.column_names},
        vehiclefile.load(sample / "vehicle.toml").vehicle,
    )
    each, usual = log_of(whole, vehicle).records_per_cycle, float(np.median(np.diff(whole[TIME])))
    at = 61 * each + 2
    whole[TIME][at:] += 0.9 * usual
    step = rf"the time increases by {1.9 * usual:.6g} s at row {at}, not by {usual:.6g} s"
    said = rf"no command in the first row of its control cycle: {step}. Is a record missing there\?"
    whole_file = (
        rf"If not \(commands come every {each} rows, as if no record is missing\), the clock stepped: state imu.clock_even = true. If one"
    )
    with pytest.raises(InputError, match=rf"^[^\n]*{said} {whole_file} is missing, write a command[^\n]*$"):
        log_of(whole, vehicle)
    even = vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={"clock_even": True})})
    assert log_of(whole, even).cycles == 2000 // each
    # in every row: the command of the next cycle is in this one's last row
    every = {name: np.repeat(values[::each], each) if name.startswith("jet_") else values for name, values in whole.items()}
    with pytest.raises(InputError, match=rf"check cycle.period_s and the first row; or {step}: if no record is missing there, state"):
        log_of(every, vehicle)
    # without a step it is a command that was not written
    unwritten = {name: values.copy() for name, values in whole.items()}
    unwritten[TIME][at:] -= 0.9 * usual
    jets = [name for name in whole if name.startswith("jet_")]
    unwritten[jets[0]][60 * each] = np.nan
    with pytest.raises(InputError, match=r"no command in the first row of its control cycle; write one \(0 for none\)$"):
        log_of(unwritten, vehicle)
