"""Results of sample logs that several reports are tested on."""

from __future__ import annotations

import pytest

from massprop_cli.report.read import Recorded
from tests.recording import record


@pytest.fixture(scope="session")
def flyer(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("flyer"), "free-flyer/log.parquet")


@pytest.fixture(scope="session")
def docking(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("docking"), "docking/log.parquet")
