"""CSV and Parquet files to columns: what is read in another way for its size is read as the same numbers."""

import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli.base import spill
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import tablefile
from massprop_cli.inputs.tablefile import columns_of

CELLS = ("0.1", "-1.7976931348623157e308", "4.9406564584124654e-324", " 2.5", "3.0 ", "nan", "", "7", "1e5", "0.30000000000000004", "-0.0")


def numbers(text: str, name: str) -> np.ndarray:
    return columns_of(Path("log.csv"), text.encode()).columns[name].numbers()


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("last", [True, False])
def test_numbers_are_the_same_to_the_last_bit_beside_a_column_of_texts(end: str, last: bool) -> None:
    """Beside a note every cell is read as a text and converted; here Python does the same."""
    lines = ["a,b,note", *(f"{cell},1,x" for cell in CELLS)]
    noted = end.join(lines) + end * last
    plain = end.join(line.rsplit(",", 1)[0] for line in lines) + end * last
    expected = np.array([float(cell or "nan") for cell in CELLS])
    for text in (noted, plain):
        np.testing.assert_array_equal(numbers(text, "a").view(np.int64), expected.view(np.int64))


@pytest.mark.parametrize("cut", [";", "\t"])
def test_decimal_commas_beside_whole_numbers(cut: str) -> None:
    np.testing.assert_array_equal(numbers(f"a{cut}b\n1,5{cut}2\n-0,25{cut}3\n", "a"), [1.5, -0.25])


def test_a_row_is_found_by_its_line_where_lines_are_blank() -> None:
    table = columns_of(Path("log.csv"), b"a,b\n\n1,2\n3,4\n\n5,6\n")
    assert [table.place(row) for row in range(table.rows)] == ["line 3", "line 4", "line 6"]
    table = columns_of(Path("log.csv"), b"a,b\n1,2\n3,4\n")
    assert [table.place(row) for row in range(table.rows)] == ["line 2", "line 3"]


def parquet(columns: dict[str, list[float]]) -> bytes:
    held = io.BytesIO()
    pq.write_table(pa.table(columns), held, compression="none", use_dictionary=False)
    return held.getvalue()


def test_a_damaged_column_is_refused_when_it_is_read_and_no_other() -> None:
    whole = parquet({"a": [1.0, 2.0], "b": [3.0, 4.0]})
    at = whole.index(np.array([3.0, 4.0]).tobytes())
    # the header of a page before its numbers
    damaged = columns_of(Path("log.parquet"), whole[: at - 4] + b"\xff\xff\xff\xff" + whole[at:])
    np.testing.assert_array_equal(damaged.columns["a"].numbers(), [1.0, 2.0])
    with pytest.raises(InputError, match=r"log.parquet: not a readable Parquet file \(.+\); copy it again"):
        damaged.columns["b"].numbers()


@pytest.mark.parametrize("piece", [4, 7, 64, 2**22])
def test_lines_are_counted_alike_in_pieces_and_at_once(piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where any line is odd, all of the file is looked at at once."""
    monkeypatch.setattr(spill, "PIECE", piece)
    draw = np.random.default_rng(piece)
    parts = [b"a,b", b"1,2", b"\n", b"\r\n", b"\n\n", b"\r", b"  ", b"\t", b'"x\ny",3', "\u00b5,4".encode(), b"\xff", b"\xef\xbb\xbf"]
    plain = 0
    for trial in range(3000):
        few = parts[:3] if trial % 2 else parts
        data = b"a,b\n" + b"".join(few[i] for i in draw.integers(0, len(few), draw.integers(1, 12)))
        found = tablefile._plain_lines(data)
        if found is not None:
            header, lines = tablefile._any_lines(Path("log.csv"), data)
            assert (found[0], list(found[1])) == (header, list(lines)), data
            plain += 1
    assert plain > 300


def test_a_long_csv_file_is_read_block_by_block_as_at_once() -> None:
    """Nulls are NaN, and the last line needs no end."""
    values = np.random.default_rng(2).standard_normal((60_000, 4))
    values[::7, 2] = np.nan
    rows = "\r\n".join(",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in values)
    table = columns_of(Path("log.csv"), f"a,b,c,d\r\n{rows}".encode())
    assert table.rows == len(values)
    for column, name in zip(values.T, "abcd", strict=True):
        assert np.array_equal(table.columns[name].numbers(), column, equal_nan=True)
