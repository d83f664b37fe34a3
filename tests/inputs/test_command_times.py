"""Commands with times of their own, in a table and in what refuses it."""

from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.actuators import actuator
from massprop_cli.inputs.tablefile import at_hand
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle

ROWS, STEP_S, ISSUED = 200, 0.01, np.arange(3, 197, 7)
"""Commands come every 0.07 s, 4 ms before the end of the record in whose row they stand."""
JET = {"name": "j", "position_m": [0.0, 0.3, 0.0], "force_n": [0.0, 0.0, 1.0]}
WHEEL = {
    "name": "w",
    "axis": [1.0, 0.0, 0.0],
    "spin_inertia_kg_m2": 1e-3,
    "locked_in_inertia": False,
    "column": "torque",
    "start_rad_s": 0.0,
}


def recorded() -> dict[str, Array]:
    """Columns of a log whose control is slower than its IMU, and in step with nothing."""
    time_s, rng = STEP_S * np.arange(1, ROWS + 1), np.random.default_rng(1)
    made: dict[str, Array] = {columns.TIME: time_s}
    made |= {name: 1e-3 * rng.normal(size=ROWS) for name in (*columns.GYRO, *columns.ACCEL)}
    for name, values in ((columns.COMMAND_TIME, time_s[ISSUED] - 0.004), (columns.jet("j"), np.full(len(ISSUED), 0.02))):
        made[name] = np.full(ROWS, np.nan)
        made[name][ISSUED] = values
    return made


def vehicle_of(made: dict[str, Array], **imu: str) -> Vehicle:
    wheels = [WHEEL] if any(name.startswith("wheel_") for name in made) else []
    return Vehicle.model_validate({"schema": 1, "cycle": {"period_s": 0.07}, "imu": imu, "jets": [JET], "wheels": wheels})


def log_of(made: dict[str, Array], **imu: str) -> Log:
    return read(at_hand(Path("log.csv"), made), vehicle_of(made, **imu))


def test_records_stay_and_commands_keep_their_times() -> None:
    log = log_of(recorded(), measures="sample")
    assert log.command_s is not None
    np.testing.assert_allclose(log.command_s, STEP_S * (ISSUED + 1) - 0.004)
    assert (log.command == 0.02).all()
    assert log.sampled == (True, True)
    # a control cycle of 70 ms is longer than what is taken together, 60 ms: half of its seven records, whole ones
    assert log.records_per_cycle == 3
    assert log.cycles == ROWS // 3
    part = log.part(10, 20)
    assert part.command_s is not None
    begin, end = STEP_S * 10 * log.records_per_cycle, STEP_S * 20 * log.records_per_cycle
    np.testing.assert_array_equal(part.command_s, log.command_s[(log.command_s >= begin) & (log.command_s < end)])


def test_records_that_are_lost_beside_them_are_put_back_where_no_command_is() -> None:
    made = recorded()
    whole = log_of(made, measures="sample")
    between = np.setdiff1d(np.arange(60, 65), ISSUED)[:3]
    kept = log_of({name: np.delete(values, between) for name, values in made.items()}, measures="sample")
    assert ["records-lost" in notice.code for notice in kept.notices] == [True]
    for name in ("time_s", "interval_s", "command_s", "command"):
        np.testing.assert_allclose(getattr(kept, name), getattr(whole, name), atol=1e-12)
    assert kept.ignored is not None
    assert np.flatnonzero(kept.ignored.any(1)).tolist() == np.unique(between // whole.records_per_cycle).tolist()
    # what was issued in a lost row is not known
    with pytest.raises(InputError, match=r"a gap of 0\.03 s"):
        log_of({name: np.delete(values, [ISSUED[8] - 1, ISSUED[8]]) for name, values in made.items()}, measures="sample")


@pytest.mark.parametrize("shared", [True, False])
def test_commands_with_the_stamps_of_records_stay_with_them_where_these_are_rebuilt(shared: bool) -> None:
    """Commands by a clock of their own keep their times: the IMU's stamps scatter, not theirs."""
    made = recorded()
    even_s = made[columns.TIME].copy()
    made[columns.TIME] += np.random.default_rng(2).normal(0, 5e-4, ROWS)
    made[columns.COMMAND_TIME][ISSUED] = made[columns.TIME][ISSUED - 1] if shared else even_s[ISSUED] - 0.004
    used = vehicle_of(made, measures="sample")
    log = read(at_hand(Path("log.csv"), made), used.model_copy(update={"imu": used.imu.model_copy(update={"clock_even": True})}))
    assert log.command_s is not None
    expected = log.time_s[ISSUED[: len(log.command_s)] - 1] if shared else even_s[ISSUED][: len(log.command_s)] - 0.004
    np.testing.assert_allclose(log.command_s, expected, atol=1e-12)
    np.testing.assert_allclose(np.diff(log.time_s), STEP_S, rtol=1e-2)


def test_wheels_take_the_torque_of_each_command() -> None:
    """Its momentum grows between commands' times, 0.07 s each, once it acts."""
    made = recorded()
    made["wheel_w_n_m"] = np.full(ROWS, np.nan)
    made["wheel_w_n_m"][ISSUED] = np.arange(len(ISSUED))
    log = log_of(made)
    wheel = vehicle_of(made).wheels[0]
    assert log.command_s is not None
    acting = actuator.LogTimes(np.append(0.0, log.time_s), log.interval_s, 0.07, log.command_s, log.command_s + 0.02, lambda _: np.zeros(3))
    time_s, momentum = wheel.momentum(log.spinning[0], acting)
    np.testing.assert_allclose(time_s[:-1], log.command_s + 0.02)
    np.testing.assert_allclose(np.diff(momentum[0]), 0.07 * np.arange(len(ISSUED)))


def without_command(made: dict[str, Array]) -> None:
    made[columns.jet("j")][ISSUED[4]] = np.nan


def astray(made: dict[str, Array]) -> None:
    made[columns.jet("j")][ISSUED[4] + 1] = 0.01


def backwards(made: dict[str, Array]) -> None:
    made[columns.COMMAND_TIME][ISSUED[4]] -= 1.0


def of_another_epoch(made: dict[str, Array]) -> None:
    made[columns.COMMAND_TIME] += 1e3


def none(made: dict[str, Array]) -> None:
    made[columns.COMMAND_TIME][:] = np.nan


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        (without_command, r"row 31, column jet_j_s: no command in a row with command_time_s; write one \(0 for none\)"),
        (astray, r"row 32, column jet_j_s: 0.01 has no command_time_s in its row; state when it was issued"),
        (backwards, r"row 31, column command_time_s: time goes back: -0.684 s after 0.246 s; sort or cut the commands"),
        (of_another_epoch, r"commands from 1000.036 to .* s, and the IMU from 0.01 to 2 s: .* bring both clocks to one epoch"),
        (none, r"column command_time_s: 0 command\(s\); a log needs at least two"),
    ],
)
def test_what_is_no_command_of_its_time_is_refused(spoilt: object, said: str) -> None:
    made = recorded()
    assert callable(spoilt)
    spoilt(made)
    with pytest.raises(InputError, match=said):
        log_of(made)


def test_an_increment_is_no_sample() -> None:
    made = recorded()
    for rate, increment in zip(columns.GYRO, columns.DELTA_THETA, strict=True):
        made[increment] = STEP_S * made.pop(rate)
    with pytest.raises(InputError, match=r"delta_theta_x_rad: an increment covers its record, but imu.measures is \"sample\""):
        log_of(made, measures="sample")
