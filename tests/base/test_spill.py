"""Large arrays: the same numbers as any, in memory only while they are worked on."""

import gc
import hashlib
import mmap
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.base import spill

ROWS = 100_000


def resident() -> int:
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's account of memory")
def test_memory_does_not_grow_with_a_large_array_that_is_worked_on_in_parts() -> None:
    many = spill.empty(200 * spill.PART, 10)  # 131 MB
    before, most = resident(), 0
    for part in spill.parts(len(many)):
        many[part] = np.arange(part.start, part.stop)[:, None]
        most = max(most, resident())
    assert most - before < 20e6
    assert (many[:, 3] == np.arange(len(many))).all()
    assert resident() - before > 100e6  # a whole column touches all pages, and they are counted
    spill.give_back()
    assert resident() - before < 20e6
    assert many[-1, 9] == len(many) - 1


def test_a_large_array_goes_with_its_file() -> None:
    before = len(spill._held)
    large = spill.empty(ROWS, 10)
    part = large[5:7]
    assert len(spill._held) == before + 1
    part[...] = 4.0
    del large
    gc.collect()
    spill.give_back()
    assert (part == 4.0).all()
    del part
    gc.collect()
    assert len(spill._held) == before


def test_a_small_array_lies_in_no_file() -> None:
    before = len(spill._held)
    small = spill.empty(1200, 10)
    assert small.shape == (1200, 10)
    assert len(spill._held) == before


@pytest.mark.parametrize("why", ["no room", "no folder"])
def test_where_there_can_be_no_file_it_is_an_array_like_any_other(why: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def full(*_: int) -> None:
        raise OSError(28, "No space left on device")

    if why == "no room":
        monkeypatch.setattr(os, "posix_fallocate", full)
    else:
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    before = len(spill._held)
    found = spill.empty(ROWS, 10)
    found[...] = 2.0
    spill.give_back()
    assert (found == 2.0).all()
    assert len(spill._held) == before


def test_parts_are_all_rows_once() -> None:
    rows = [row for part in spill.parts(20_000, 5) for row in range(part.start, part.stop)]
    assert rows == list(range(5, 20_000))
    assert list(spill.parts(0)) == []


@pytest.mark.parametrize("size", [1000, spill.LARGE + 1000])
def test_a_file_is_copied_as_it_is_and_not_as_it_becomes(size: int, tmp_path: Path) -> None:
    path = tmp_path / "log"
    told = bytes(np.random.default_rng(1).integers(0, 256, size, dtype=np.uint8))
    path.write_bytes(told + b"more")
    with path.open("rb") as file:
        data = spill.copied(file, size)
    path.write_bytes(b"")
    assert len(data) == size
    assert data[:] == told
    assert spill.digest(data) == hashlib.sha256(told).hexdigest()
    assert b"".join(spill.pieces(data, 10)) == told[10:]


@pytest.mark.parametrize("size", [1000, spill.LARGE + 1000])
def test_a_file_that_ends_while_it_is_read_is_refused(size: int, tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(bytes(500))
    with path.open("rb") as file, pytest.raises(OSError, match=f"it ended after 500 of {size} bytes while it was read"):
        spill.copied(file, size)


def test_pieces_end_with_lines_where_there_are_some(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spill, "PIECE", 8)
    assert list(spill.pieces(b"a,b\n1,2\n3,4\n5,6")) == [b"a,b\n1,2\n", b"3,4\n5,6"]
    assert list(spill.pieces(b"0123456789")) == [b"01234567", b"89"]
