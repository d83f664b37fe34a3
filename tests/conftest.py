"""Results of sample logs that several reports are tested on, and one thread of linear algebra for each worker."""

from __future__ import annotations

import os

# before anything imports numpy: on matrices this small a second thread only waits, and takes a core from the other worker
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import pytest

from massprop_cli.result.read import Recorded
from tests.recording import record


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--kills", type=int, default=6, help="how often tests/cli/test_kill.py ends each command")


@pytest.fixture(scope="session")
def flyer(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("flyer"), "free-flyer/log.parquet")


@pytest.fixture(scope="session")
def docking(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("docking"), "docking/log.parquet")
