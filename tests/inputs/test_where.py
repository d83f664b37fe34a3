"""Several sensors in the rows of one table: a map selects one; where it does not, the message names the column that numbers them."""

from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import propose, reading
from massprop_cli.inputs.logfile import read_table
from tests.streams import values

ROWS, STEP_S = 200, 0.05
RATES = np.random.default_rng(8).normal(0, 0.1, (ROWS, 3))
MAP = """
schema = 1
clock = { path = "t", unit = "s" }
[gyro]
paths = ["p", "q", "r"]
unit = "rad/s"
values = "mean"
[torque]
paths = [0, 0, "tz"]
unit = "N m"
clock = { path = "tc", unit = "s" }
[force]
paths = [0, 0, 0]
[records]
interval_s = 0.05
"""


def table(path: Path, apart_s: float = 0.0, column: str = "imu_id", ids: tuple[str, str] = ("3", "7")) -> Path:
    """Two gyros that take turns, the second so much later and off by 1 rad/s; commands beside them with a clock of their own."""
    lines = [f"t,p,q,r,{column},tc,tz"]
    for row in range(2 * ROWS):
        k, second = divmod(row, 2)
        rates = ",".join(f"{rate + second:.9f}" for rate in RATES[k])
        command = f"{STEP_S * row:.3f},{row % 7}" if row < ROWS else ","
        lines.append(f"{STEP_S * (k + 1) + second * apart_s:.4f},{rates},{ids[second]},{command}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def mapped(log: Path, text: str) -> Array:
    """The rates of its rows."""
    (log.parent / "map.toml").write_text(text, encoding="utf-8")
    found = read_table(log)
    return values(found, columns.GYRO) if columns.GYRO[0] in found.columns else values(found, columns.DELTA_THETA) / STEP_S


def select(column: str, value: str, text: str = MAP) -> str:
    return text.replace('values = "mean"', f'values = "mean"\nwhere = {{ column = "{column}", is = {value} }}')


@pytest.mark.parametrize("apart_s", [0.0, 0.003, 0.025])
@pytest.mark.parametrize("ids", [("3", "7"), ("left", "right")])
def test_a_map_selects_the_rows_of_one_sensor(ids: tuple[str, str], apart_s: float, tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", apart_s, ids=ids)
    for second, value in enumerate(ids):
        found = mapped(log, select("imu_id", value if value.isdigit() else f'"{value}"'))
        assert len(found) >= ROWS - 1
        np.testing.assert_allclose(found, (RATES + second)[: len(found)], atol=1e-8)


@pytest.mark.parametrize("even", ["", ", even = true"])
@pytest.mark.parametrize(
    ("column", "ids", "apart_s"),
    [
        *(("imu_id", ("3", "7"), apart_s) for apart_s in (0.0, 0.003, 0.025)),
        ("I", ("0", "1"), 0.0),
        ("kind", ("left", "right"), 0.0),
        ("kind", ("0", "1"), 0.003),
    ],
)
def test_two_sensors_in_one_table_are_refused(column: str, ids: tuple[str, str], apart_s: float, even: str, tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", apart_s, column, ids)
    one, other = (value if value.isdigit() else f'"{value}"' for value in ids)
    text = MAP.replace('unit = "s" }', f'unit = "s"{even} }}', 1)
    said = (
        rf"2 sensors seem to be in one table: column '{column}' has 2 values \({one}, {other}\) that alternate with the records; "
        rf'select one sensor with where = {{ column = "{column}", is = {one} }} .*; if all rows are of one sensor, '
        rf"state is = \[{one}, {other}\]"
    )
    with pytest.raises(InputError, match=said) as refused:
        mapped(log, text)
    assert "even" not in str(refused.value).partition("(")[0]


def test_rows_of_one_sensor_that_a_counter_numbers_are_kept(tmp_path: Path) -> None:
    log = table(tmp_path / "log.csv", STEP_S / 2, "sensor")
    found = mapped(log, select("sensor", "[3, 7]", MAP.replace("interval_s = 0.05", "interval_s = 0.025")))
    assert len(found) >= 2 * ROWS - 2
    for harmless in ("phase", "jet"):  # no sensor's number, and nothing is wrong with the times
        assert len(mapped(table(tmp_path / "log.csv", STEP_S / 2, harmless), MAP)) >= ROWS - 1


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("imu_id", "5", r"where: no row has 5 in column 'imu_id', which holds 3, 7; state one of these"),
        ("imu_id", '"5"', r"where: no row has \"5\" in column 'imu_id', which holds 3, 7"),
        ("imu", "3", r"where names no path of this table, 'imu'; massprop columns lists all"),
        ("imu_id", '"?"', r'gyro.where.is is still "\?"'),
        ("imu_id", "[]", r"is = \[\] selects no row; state a value"),
    ],
)
def test_a_selection_of_no_row_is_refused(column: str, value: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=rf"^[^\n]*{said}[^\n]*$"):
        mapped(table(tmp_path / "log.csv"), select(column, value))


def test_a_draft_asks_which_sensor_is_meant(tmp_path: Path) -> None:
    text = propose.draft(reading.load(table(tmp_path / "log.csv", 0.003)))
    assert 'where = { column = "imu_id", is = "?" }   # 3 or 7: rows alternate between them' in text
