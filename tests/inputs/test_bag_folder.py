"""The folder of a ROS 2 bag is a log like its file, in one piece or split as recorders split it."""

from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import reading
from massprop_cli.inputs.logfile import read_table
from tests.inputs.everyformat import FORMATS, written


def listing(folder: Path, *names: str) -> None:
    lines = ["rosbag2_bagfile_information:", "  version: 9", "  relative_file_paths:", *(f"    - {name}" for name in names)]
    (folder / "metadata.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize("name", ["ROS 2 bag", "mcap of ROS 2"])
def test_a_folder_gives_what_its_file_gives(name: str, tmp_path: Path) -> None:
    path, map_file = written(name, tmp_path)
    plain = read_table(path, map_file)
    folder = tmp_path / "run"
    folder.mkdir()
    path.rename(folder / f"run_0{path.suffix}")
    listing(folder, f"run_0{path.suffix}")
    table = read_table(folder, map_file)
    assert (table.path, table.sha256, table.rows) == (folder, plain.sha256, plain.rows)
    for column, cells in plain.columns.items():
        np.testing.assert_array_equal(table.columns[column].numbers(), cells.numbers())


def test_a_map_stands_beside_the_folder(tmp_path: Path) -> None:
    path, map_file = written("mcap of ROS 2", tmp_path)
    folder = tmp_path / "run"
    folder.mkdir()
    path.rename(folder / "run_0.mcap")
    listing(folder, "run_0.mcap")
    assert map_file is not None
    map_file.rename(tmp_path / "run.map.toml")
    assert read_table(folder).rows > 0


def test_split_files_follow_one_another(tmp_path: Path) -> None:
    """Each topic's messages, in the order of metadata.yaml."""
    path, _ = written("mcap of ROS 2", tmp_path)
    whole = reading.load(path)
    (tmp_path / "run_0.mcap").write_bytes(path.read_bytes())
    (tmp_path / "run_1.mcap").write_bytes(path.read_bytes())
    listing(tmp_path, "run_1.mcap", '"run_0.mcap"')
    assert reading.files(tmp_path) == [tmp_path / "run_1.mcap", tmp_path / "run_0.mcap"]
    both = reading.load(tmp_path)
    assert set(both.streams) == set(whole.streams)
    for name, stream in both.streams.items():
        own = whole.streams[name]
        assert (stream.rows, stream.clock, stream.unit) == (2 * own.rows, own.clock, own.unit)
        np.testing.assert_array_equal(stream.values, np.tile(own.values, 2))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ((), "names no .mcap or .db3 file"),
        (("run_0.db3",), "no such file, though metadata.yaml names it"),
        (("run_0.db3.zstd",), "is compressed as a whole"),
    ],
)
def test_an_incomplete_folder_is_refused_in_one_line(names: tuple[str, ...], said: str, tmp_path: Path) -> None:
    listing(tmp_path, *names)
    with pytest.raises(InputError, match=rf"^[^\n]*{said}[^\n]*$"):
        read_table(tmp_path)


def test_a_folder_without_metadata_is_its_only_file(tmp_path: Path) -> None:
    path, map_file = written("ROS 2 bag", tmp_path)
    plain, folder = read_table(path, map_file), tmp_path / "run"
    folder.mkdir()
    path.rename(folder / "run_0.db3")
    table = read_table(folder, map_file)
    assert (table.path, table.sha256, table.rows) == (folder, plain.sha256, plain.rows)
    (folder / "run_1.db3").write_bytes((folder / "run_0.db3").read_bytes())
    for read in (reading.load, read_table):
        with pytest.raises(InputError, match=r"holds 2 files of ROS 2 bags and no metadata.yaml; [^\n]*ros2 bag reindex [^\n]*/run_0.db3$"):
            read(folder)


def test_any_other_folder_is_still_no_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder; name the log file itself"):
        read_table(tmp_path)


def test_the_formats_that_are_tested_are_there() -> None:
    assert {"ROS 2 bag", "mcap of ROS 2"} <= set(FORMATS)
