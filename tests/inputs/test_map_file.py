"""Where a map is found, and that results tell of it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli import job
from massprop_cli.base import escape
from massprop_cli.base.errors import InputError
from massprop_cli.campaign import discover, work
from massprop_cli.campaign.outcome import Outcome
from massprop_cli.campaign.plan import Settings
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import mapfile
from massprop_cli.inputs.logfile import read_table
from tests.commandline import succeeded

SAMPLES = Path(__file__).parents[2] / "sample_logs"

IDENTITY = """
schema = 1
clock = { path = "t_ms", unit = "ms" }
[gyro]
paths = ["p", "q", "r"]
unit = "deg"
values = "increment"
[accelerometer]
paths = ["dvx", "dvy", "dvz"]
unit = "m/s"
values = "increment"
"""


def _renamed(tmp_path: Path, rows: int = 120) -> Path:
    """The first rows of a sample log under other names, and its map and vehicle file beside."""
    table = pq.read_table(SAMPLES / "free-flyer" / "log.parquet").slice(0, rows).replace_schema_metadata()
    names = dict(zip(("time_s", *columns.DELTA_THETA, *columns.DELTA_V), ("t_ms", *"pqr", "dvx", "dvy", "dvz"), strict=True))
    jets = [name.removeprefix("jet_").removesuffix("_s") for name in table.column_names if name.startswith("jet_")]
    text = IDENTITY + "".join(f'[jets.{name}]\npath = "jet_{name}_s"\nunit = "s"\n' for name in jets)
    other: dict[str, Any] = {names.get(name, name): table.column(name).to_numpy() for name in table.column_names}
    other |= {name: other[name] / np.pi * 180 for name in "pqr"} | {"t_ms": other["t_ms"] * 1e3}
    pq.write_table(pa.table(other), tmp_path / "own.parquet")
    (tmp_path / "map.toml").write_text(text)
    (tmp_path / "vehicle.toml").write_text((SAMPLES / "free-flyer" / "vehicle.toml").read_text())
    (tmp_path / "plain").mkdir()
    pq.write_table(table, tmp_path / "plain" / "log.parquet")
    (tmp_path / "plain" / "vehicle.toml").write_text((SAMPLES / "free-flyer" / "vehicle.toml").read_text())
    return tmp_path / "own.parquet"


def _numbers(found: Any) -> list[float]:
    if isinstance(found, dict):
        return [value for item in found.values() for value in _numbers(item)]
    if isinstance(found, list):
        return [value for item in found for value in _numbers(item)]
    return [float(found)] if isinstance(found, (int, float)) else []


def test_a_map_beside_the_log_is_found_and_told_of(tmp_path: Path) -> None:
    own = _renamed(tmp_path)
    mine = job.of_file(own)
    plain = job.of_file(tmp_path / "plain" / "log.parquet")
    np.testing.assert_allclose(
        _numbers(mine.result.model_dump(mode="json")["phases"]),
        _numbers(plain.result.model_dump(mode="json")["phases"]),
        rtol=1e-6,
        atol=1e-9,
    )
    assert mine.result.provenance.map_sha256 is not None
    assert plain.result.provenance.map_sha256 is None
    succeeded(tmp_path, "estimate", "own.parquet", "--out", "out")
    told = json.loads((tmp_path / "out" / "run.json").read_text())
    assert told["map"] == "map.toml"
    assert (tmp_path / "out" / "result.json").read_text() == escape.document(mine.result)


def test_a_campaign_takes_maps_by_name_in_its_file_and_beside_logs(tmp_path: Path) -> None:
    own = _renamed(tmp_path, 120)
    text = (tmp_path / "map.toml").read_text()
    (tmp_path / "map.toml").unlink()
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "own.toml").write_text(text)
    (tmp_path / "campaign.toml").write_text('schema = 1\nlogs = ["own.parquet"]\nmap = "maps/own.toml"\n')

    def worked(named: Path, known: str | None = None, map_file: Path | None = None) -> Outcome | None:
        _, (one,) = discover.plan([str(named)], Settings(map=None if map_file is None else str(map_file)))
        produced = work.process(one, known)
        return None if produced is None else produced.outcome

    refused, said = worked(own), "column 'time_s' is missing"
    assert refused is not None
    assert (refused.exit_code, said in refused.message) == (3, True)
    in_file, by_name = worked(tmp_path / "campaign.toml"), worked(own, map_file=tmp_path / "maps" / "own.toml")
    assert in_file is not None
    assert by_name is not None
    assert (in_file.exit_code, by_name.exit_code) == (0, 0)
    (tmp_path / "own.map.toml").write_text(text)
    beside = worked(own)
    assert beside is not None
    assert beside.bodies == in_file.bodies
    # a map that is changed makes the log be done again
    assert worked(own, beside.fingerprint) is None
    (tmp_path / "own.map.toml").write_text(text + "# more\n")
    assert worked(own, beside.fingerprint) is not None


def test_a_map_within_a_parquet_file_goes_before_one_beside_it(tmp_path: Path) -> None:
    own = _renamed(tmp_path)
    text = (tmp_path / "map.toml").read_text()
    (tmp_path / "map.toml").write_text(text.replace('"dvx"', '"dvw"'))
    table = pq.read_table(own).replace_schema_metadata({b"massprop.map": text.encode()})
    pq.write_table(table, own)
    found = read_table(own)
    assert found.made is not None
    assert "embedded map" in found.made.map
    with pytest.raises(InputError, match=r"'dvw': no such path.*map.toml"):
        read_table(own, tmp_path / "map.toml")


def test_the_map_file_of_the_documentation_is_one() -> None:
    text = (SAMPLES.parent / "docs" / "formats.md").read_text(encoding="utf-8")
    shown = text.split("```toml\n")[1].split("```")[0]
    said = mapfile.parse(shown, "docs/formats.md").map
    assert said.records is not None
    assert said.force is not None
    assert said.force.frame == "world"


def test_all_questions_that_are_left_in_a_draft_are_told_at_once_by_their_lines() -> None:
    asked = IDENTITY.replace('unit = "ms"', 'unit = "?"').replace('["p", "q", "r"]', '["p", "?", "r"]').replace('"increment"', '"?"')
    with pytest.raises(InputError, match=r'^own\.map\.toml, line 3: clock\.unit is still "\?"; so are lines 5, 7, 11; answer each'):
        mapfile.parse(asked, "own.map.toml")
    with pytest.raises(InputError, match=r'^own\.map\.toml, line 3: clock\.path is still "\?"; answer each'):
        mapfile.parse(IDENTITY.replace('path = "t_ms", unit = "ms"', 'path = "?", unit = "?"'), "own.map.toml")
    # three columns of one letter are no question
    torque = '[torque]\npaths = [0, 0, 0]\nunit = "N m"\n[force]\npaths = [0, 0, 0]\nunit = "N"\n'
    assert mapfile.parse(IDENTITY.replace('["p", "q", "r"]', '"?"') + torque, "own.map.toml").map.gyro.paths == "?"
