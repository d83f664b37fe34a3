"""What many logs cost the process that runs a campaign."""

import gc
import io
import json
import tracemalloc
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext

import pyarrow.parquet as pq
import pytest

from massprop_cli.campaign import parquet
from massprop_cli.campaign import run as flow
from massprop_cli.campaign.outcome import CompressedRows
from massprop_cli.campaign.plan import Job
from massprop_cli.campaign.runner import Task
from massprop_cli.campaign.summary import Summary, summary, to_json
from massprop_cli.campaign.work import Produced
from tests.campaign.test_ci import failed
from tests.campaign.test_pool import row

PER_LOG = 3000
"""Bytes that another log may take; a row in the open takes 15,000."""


class Nowhere:
    """A place that keeps nothing but how much it was given."""

    def __init__(self) -> None:
        self.sizes: dict[str, int] = {}

    def lock(self) -> AbstractContextManager[None]:
        return nullcontext()

    def folders(self) -> Mapping[str, frozenset[str]]:
        return {}

    def read(self, path: str) -> bytes:
        raise FileNotFoundError(path)

    def put_folder(self, name: str, files: Mapping[str, bytes]) -> None:
        pass

    def put_file(self, path: str, content: Iterable[bytes]) -> None:
        self.sizes[path] = sum(map(len, content))


class Ready:
    """An executor for which every log is done at once."""

    def run(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Produced | None]]:
        for index in range(len(tasks)):
            found = row(index % 20, 16.0, input_sha256=f"{index:064d}").outcome
            assert found is not None
            yield index, Produced(found)


def peak(logs: int) -> int:
    """Most bytes held at a time by a campaign."""
    place = Nowhere()
    # as in a process of its own: what other tests hold puts off the collection of cycles
    gc.collect()
    gc.freeze()
    tracemalloc.start()
    flow.campaign("many", [Job(f"log-{n}", f"/logs/log-{n}.parquet", f"log-{n}.parquet") for n in range(logs)], place, Ready())
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    gc.unfreeze()
    assert place.sizes["campaign.json"] > 1500 * logs
    assert place.sizes["campaign.html"] > 1500 * logs
    return most


@pytest.mark.thorough
def test_a_campaign_takes_little_more_memory_for_more_logs() -> None:
    peak(10)  # imports
    few, many = peak(130), peak(230)
    assert many - few < PER_LOG * 100


def test_text_written_in_pieces_is_that_of_the_whole() -> None:
    for rows in ([], [row(1, 16.0)], [row(n, 16.0 + 0.01 * n) for n in range(5)] + [failed(1)]):
        found = summary("night", rows)
        text = "".join(to_json(found))
        assert text == json.dumps(found.model_dump(by_alias=True, mode="json"), indent=1, ensure_ascii=False) + "\n"
        assert json.loads(text)["logs"] == [one.model_dump(by_alias=True, mode="json") for one in rows]
        back = Summary.model_validate_json(text)
        assert isinstance(back.logs, CompressedRows)
        assert list(back.logs) == rows
        assert back == found


def test_a_table_written_in_parts_is_that_of_all_rows() -> None:
    rows = [*(row(n, 16.0) for n in range(300)), failed(1), row(301, 17.0)]
    file = pq.ParquetFile(io.BytesIO(parquet.parquet(summary("night", rows))))
    read = file.read()
    assert file.num_row_groups == 2
    assert read["name"].to_pylist() == [one.name for one in rows]
    assert read["mass"].to_pylist() == [16.0] * 300 + [None, 17.0]
