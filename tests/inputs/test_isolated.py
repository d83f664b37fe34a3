"""What another's library does over a hostile file ends its own process alone, and is told in one line."""

import tempfile
from importlib import import_module
from pathlib import Path

import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import reading
from tests.hostile import packed_chunk
from tests.inputs.everyformat import written
from tests.targets import CORPUS

pytestmark = pytest.mark.apart


def kept(name: str, folder: Path, suffix: str) -> Path:
    """A file that a fuzzer found."""
    path = folder / f"log{suffix}"
    path.write_bytes((CORPUS / "recording" / name).read_bytes()[1:])
    return path


def test_a_crash_of_the_library_is_no_crash_of_the_program_and_leaves_nothing_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import_module("h5py")
    path = kept("matlab-that-crashes", tmp_path, ".mat")
    aside = tmp_path / "aside"
    aside.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(aside))
    with pytest.raises(InputError, match=rf"^{path}: not a readable MATLAB file \(its reader crashed, or took more than 8 s or 768 MiB\)"):
        reading.load(path)
    assert list(aside.iterdir()) == []


def test_what_unpacks_to_more_than_it_says_gets_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(packed_chunk(2**30, 1000))
    with pytest.raises(InputError, match=r"not a readable MCAP file .its reader crashed, or took more than 8 s or 76"):
        reading.load(path)


def test_a_reader_that_goes_on_for_ever_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sqlite3

    path, _ = written("ROS 2 bag", tmp_path)
    with sqlite3.connect(path) as bag:
        bag.executescript(
            "ALTER TABLE schema RENAME TO old; CREATE VIEW schema AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
            "SELECT max(x) AS schema_version FROM c"
        )
    bag.close()
    monkeypatch.setenv("MASSPROP_MAX_READER_SECONDS", "1")
    with pytest.raises(InputError, match=r"took more than 1 s or .* set MASSPROP_MAX_READER_SECONDS"):
        reading.load(path)


def test_no_module_of_the_current_folder_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, _ = written("hdf5", tmp_path)
    for name in ("h5py", "numpy", "json"):
        (tmp_path / f"{name}.py").write_text("import os; os.mkdir('run')")
    monkeypatch.chdir(tmp_path)
    assert "clock" in reading.load(path).streams
    assert not (tmp_path / "run").exists()


def test_a_stream_that_is_damaged_spoils_no_other(tmp_path: Path) -> None:
    import h5py
    import numpy as np

    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["good"] = np.arange(4.0)
        file.create_dataset("bad", data=np.arange(1000.0), compression="gzip")
        at = file["bad"].id.get_chunk_info(0).byte_offset
    whole = bytearray(path.read_bytes())
    whole[at : at + 50] = bytes(50)
    path.write_bytes(whole)
    streams = reading.load(path).streams
    assert streams["good"].values.tolist() == [0, 1, 2, 3]
    with pytest.raises(InputError, match=r"log.h5, 'bad': holds no numbers that can be read \(.*filter.*\)"):
        _ = streams["bad"].values
