"""Tables and configuration of any content end in a result or in :class:`InputError`; ``-m slow`` tries seven times as many."""

import io
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from massprop_cli import job
from massprop_cli.base import escape
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import equipment, logfile, telemetry, vehiclefile
from tests.hostile import SAMPLE, flight
from tests.targets import flyer

VEHICLE = tomllib.loads((SAMPLE / "vehicle.toml").read_text(encoding="utf-8"))
NUMBERS = st.floats() | st.floats(-1e-300, 1e-300) | st.sampled_from([0.0, -0.0, 5e-324, 1e-30, 1e30, 1e150, 1e308, -1.0])
CELLS = st.none() | NUMBERS
COLUMNS = st.one_of(
    st.lists(CELLS, min_size=40, max_size=40).map(lambda cells: pa.array(cells, pa.float64())),
    st.lists(st.integers(-(2**63), 2**63 - 1), min_size=40, max_size=40).map(lambda cells: pa.array(cells, pa.int64())),
    st.lists(NUMBERS.map(str) | st.text(max_size=5), min_size=40, max_size=40).map(lambda cells: pa.array(cells, pa.string())),
    st.lists(st.booleans(), min_size=40, max_size=40).map(pa.array),
    NUMBERS.map(lambda number: pa.array([number] * 40, pa.float64())),
)
LEAVES = (
    NUMBERS
    | st.integers()
    | st.text(max_size=20)
    | st.booleans()
    | st.lists(NUMBERS, max_size=4)
    | st.dictionaries(st.text(max_size=5), NUMBERS)
)
quick = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
long = settings(max_examples=210, deadline=None, suppress_health_check=list(HealthCheck))


@st.composite
def tables(draw: Any) -> Any:
    """A good log with some columns replaced, renamed or gone."""
    table = flight(40)
    for _ in range(draw(st.integers(1, 3))):
        index = draw(st.integers(0, table.num_columns - 1))
        name = draw(st.just(table.column_names[index]) | st.text(min_size=1, max_size=10))
        table = table.set_column(index, name, draw(COLUMNS))
    return table


@st.composite
def vehicles(draw: Any) -> dict[str, Any]:
    """A good vehicle file with some values replaced."""
    data: dict[str, Any] = tomllib.loads(tomli_w.dumps(VEHICLE))
    for _ in range(draw(st.integers(1, 3))):
        node: Any = data
        while True:
            key = draw(st.sampled_from(list(node) if isinstance(node, dict) else range(len(node))))
            if not isinstance(node[key], (dict, list)) or not node[key] or draw(st.integers(0, 9)) == 0:
                break
            node = node[key]
        node[key] = draw(LEAVES)
    for section, name in draw(st.lists(st.sampled_from(SETTINGS), max_size=3)):
        if isinstance(data.setdefault(section, {}), dict):
            data[section][name] = draw(NUMBERS)
    return data


SETTINGS = [
    (section, name)
    for section, model in (
        ("cycle", equipment.Cycle),
        ("imu", equipment.Imu),
        ("environment", equipment.Environment),
        ("thrust", equipment.Thrust),
    )
    for name in model.model_fields
]


def takes(table: Any) -> None:
    out = io.BytesIO()
    pq.write_table(table, out)
    try:
        with np.errstate(all="ignore"):  # as a job has it
            log = telemetry.read(logfile.parse(Path("log.parquet"), out.getvalue()), flyer())
    except InputError:
        return
    for values in (log.time_s, log.interval_s, log.delta_theta_imu_rad, log.delta_v_imu_m_s, log.command):
        assert np.isfinite(values).all()


def estimates(data: dict[str, Any], rows: int = 60) -> None:
    out = io.BytesIO()
    pq.write_table(flight(rows), out)
    try:
        source = vehiclefile.parse(tomli_w.dumps(data), "vehicle.toml")
        judged = job.of_table(logfile.parse(Path("log.parquet"), out.getvalue()), source)
    except InputError:
        return
    escape.document(judged.result)
    for item in judged.result.phases[0].estimates.values():
        assert item.sigma is None or (item.sigma > 0 and math.isfinite(item.sigma))


@quick
@given(tables())
def test_a_table_of_any_content_is_a_log_of_numbers_or_refused(table: Any) -> None:
    takes(table)


@pytest.mark.parametrize("rows", range(1, 9))
def test_a_log_of_few_rows_ends_in_a_result_or_is_refused(rows: int) -> None:
    estimates(VEHICLE, rows)


@pytest.mark.slow
@quick
@given(vehicles())
def test_a_vehicle_of_any_content_ends_in_a_result_or_is_refused(data: dict[str, Any]) -> None:
    estimates(data)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.slow
@long
@given(tables())
def test_seven_times_as_many_tables(table: Any) -> None:
    takes(table)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.slow
@long
@given(vehicles())
def test_seven_times_as_many_vehicles(data: dict[str, Any]) -> None:
    estimates(data)
