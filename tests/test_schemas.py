"""The schemas on disk are the code's, and hold its bounds."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
from typer.testing import CliRunner

from massprop_cli import schemas
from massprop_cli.cli import app

ROOT = Path(__file__).parents[1]


def test_schemas_on_disk_agree_with_the_code() -> None:
    for name in schemas.NAMES:
        assert json.loads((ROOT / "schemas" / f"{name}.schema.json").read_text()) == schemas.schema(name)
        jsonschema.Draft202012Validator.check_schema(schemas.schema(name))
        assert json.loads(CliRunner().invoke(app, ["schema", name]).stdout) == schemas.schema(name)


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [("imu", "gyro_noise_rad_s", -1e-4), ("cycle", "command_delay_cycles", -1), ("imu", "position_m", [0, 0, 2e6])],
)
def test_schemas_hold_the_bounds_that_massprop_holds(table: str, key: str, value: object) -> None:
    vehicle = tomllib.loads((ROOT / "sample_logs" / "free-flyer" / "vehicle.toml").read_text())
    validator = jsonschema.Draft202012Validator(schemas.schema("vehicle"))
    assert validator.is_valid(vehicle)
    vehicle[table][key] = value
    assert not validator.is_valid(vehicle)
