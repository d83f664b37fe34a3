"""Results that several tests of pages look at."""

from __future__ import annotations

import pytest

from massprop_cli.report import html
from massprop_cli.result.read import Recorded
from tests.recording import record
from tests.report.page import Page


@pytest.fixture(scope="session")
def refined(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("refined"), "scenarios/refined/log.parquet")


@pytest.fixture(scope="session")
def bearing(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("bearing"), "air-bearing/log.parquet")


@pytest.fixture(scope="session")
def flyer_page(flyer: Recorded) -> Page:
    return Page(html.page([flyer]))


@pytest.fixture(scope="session")
def docking_page(docking: Recorded) -> Page:
    return Page(html.page([docking]))
